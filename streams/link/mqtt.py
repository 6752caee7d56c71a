"""Frames from an MQTT broker: QoS 1, kept session, acknowledged after the commit.

The payload is the frame of TCP. The number committed last is published, retained, under ``TOPIC/committed``; a sender
keeps its blocks until it reads their number there. docs/reference/wire.md has the protocol.
"""

from __future__ import annotations

import contextlib
import logging
import re
import ssl
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from streams.link.arrivals import Ticket
from streams.link.receiver import Receiver
from streams.link.refusals import JUMP, LINK
from streams.link.sender import LinkError
from streams.link.wire import ACK, JumpError, WireError
from streams.types.spec import Address, NetworkSpec, SourceError, SourceSpec

_LOG = logging.getLogger(__name__)
COMMITTED = "/committed"
"""Suffix of the topic with the number committed last."""
_KEEPALIVE_S = 30
_MAX_SECRET_BYTES = 4096


@dataclass(frozen=True)
class _Token:
    """The message to acknowledge, valid on the connection over which it came."""

    connection: int
    message: int


class MqttReceiver(Receiver):
    """Subscribes to the topics of one or several sources at one broker.

    Retained messages, which may be of any age, are acknowledged and ignored. A payload without a valid checksum is
    acknowledged as well, so that it is not delivered for ever, and is the :meth:`problem`; the next frame states the
    gap.
    """

    def __init__(self, specs: Sequence[SourceSpec], network: NetworkSpec | None = None) -> None:
        """Take the sources that share a broker, each with a topic of its own.

        Raises:
            SourceError: as :class:`Receiver`, a topic is given twice, or paho-mqtt is missing.
        """
        super().__init__(specs, network, "mqtt://HOST:PORT/TOPIC")
        if len(self._arrivals.streams) != len(specs):
            raise SourceError(f"{self._where}: several sources have the same topic")
        # The broker keeps the session under this id over restarts.
        self._client_id = self._network.client_id or "spallwatch-" + re.sub(r"[^A-Za-z0-9_.-]", "-", self.name)
        self._client = make_client(self._address, self._network, self._client_id, self._where)
        self._connection = 0
        self._connected = self._failed = False
        self._cause: str | None = None
        self._problem = f"{self.name}: not connected to the broker yet"

    def _start(self) -> None:
        """Connect in the background; an unreachable broker is tried again."""
        client = self._client
        client.manual_ack_set(True)
        client.on_connect = self._on_connect
        client.on_disconnect = self._on_disconnect
        client.on_connect_fail = self._on_connect_fail
        client.on_message = self._on_message
        client.reconnect_delay_set(min_delay=1, max_delay=10)
        client.connect_async(self._address.host, self._address.port, _KEEPALIVE_S)
        start_client(client, self._set_cause)
        self._restarts.started()

    def _set_cause(self, cause: str) -> None:
        self._cause = cause

    def tend(self) -> None:
        """Connect with a new client where the thread of paho has ended; the broker keeps what is not acknowledged."""
        if not self._opened:
            return
        thread = self._client._thread
        if thread is not None and thread.is_alive():
            self._restarts.runs()
            return
        if not self._failed:
            self._failed = True
            with self._lock:
                self._connected = False
            end_client(self._client)
            self._restarts.failed(self._cause or "the thread of the connection ended")
        if not self._restarts.due:
            return
        try:
            self._client = make_client(self._address, self._network, self._client_id, self._where)
            self._start()
            self._failed = False
        except (SourceError, RuntimeError) as error:
            self._restarts.failed(str(error))

    def problem(self) -> str | None:
        """Return why nothing is received, or why the last message was refused."""
        if self._failed:
            return self._restarts.problem() or f"{self.name}: the receiver has stopped: {self._restarts.cause}"
        return super().problem()

    def _on_connect(self, client: Any, userdata: Any, flags: Any, reason: Any, properties: Any) -> None:
        if reason.is_failure:
            self._refused(f"the broker refuses: {reason}")
            return
        with self._lock:
            self._connection += 1
            self._connected = True
            self._problem = None
        # The broker may have lost the session, so all topics are subscribed again.
        for topic in self._arrivals.streams:
            client.subscribe(topic, qos=1)
            self._publish(topic)

    def _on_disconnect(self, client: Any, userdata: Any, flags: Any, reason: Any, properties: Any) -> None:
        with self._lock:
            was_connected, self._connected = self._connected, False
        if was_connected:
            self._refused(f"connection to the broker lost: {reason}")

    def _on_connect_fail(self, client: Any, userdata: Any) -> None:
        self._refused(f"no broker answers at {self._address.host}:{self._address.port}")

    def _on_message(self, client: Any, userdata: Any, message: Any) -> None:
        topic = message.topic
        if message.retain or topic not in self._arrivals.streams or len(message.payload) > self._network.max_frame:
            if not message.retain:
                self._refused(f"a message under {topic!a} of {len(message.payload)} bytes is not taken")
            client.ack(message.mid, message.qos)
            return
        token = _Token(self._connection, message.mid) if message.qos else None
        try:
            taken = self._arrivals.take(topic, message.payload, token, self._network.max_frame)
            self._problem = None
            if not taken:
                # The broker lost the one before; both stay uncommitted, and the sender repeats them.
                client.ack(message.mid, message.qos)
            self._acknowledge(self._arrivals.spent(topic))
        except WireError as error:
            self._refused(f"{topic}: {error}", JUMP if isinstance(error, JumpError) else LINK, topic)
            client.ack(message.mid, message.qos)
        except Exception as error:  # A fault of one message must not end the connection; its sender repeats it.
            self._fault(f"a message under {topic!a} cannot be taken", error)
            client.ack(message.mid, message.qos)

    def _confirm(self, ticket: Ticket) -> None:
        self._acknowledge(ticket.tokens)
        self._publish(ticket.stream)

    def _acknowledge(self, tokens: Sequence[Any]) -> None:
        """Acknowledge messages of this connection to the broker."""
        for token in tokens:
            with self._lock:
                current = isinstance(token, _Token) and token.connection == self._connection and self._connected
            if current and isinstance(token, _Token):
                self._client.ack(token.message, 1)

    def _publish(self, topic: str) -> None:
        # The number is published with each connection; QoS 0 queues nothing in between.
        if self._connected:
            self._client.publish(topic + COMMITTED, ACK.pack(self._arrivals.committed(topic)), qos=0, retain=True)

    def _stop(self) -> None:
        # Disconnecting also ends the reconnect loop; the broker keeps what is not acknowledged.
        end_client(self._client)


def make_client(address: Address, network: NetworkSpec, name: str, where: str, *, keep: bool = True) -> Any:
    """Return a paho client of an id with its credentials, not connected yet.

    ``where`` is the key or option named in a message; with ``keep`` the broker keeps the session.

    Raises:
        SourceError: paho-mqtt is missing, or a file cannot be read; no secret is in the message.
    """
    try:
        from paho.mqtt.client import Client, MQTTv311
        from paho.mqtt.enums import CallbackAPIVersion
    except ModuleNotFoundError:
        raise SourceError(f'{where}: mqtt:// needs paho-mqtt: pip install "spallwatch[mqtt]"') from None
    client = Client(CallbackAPIVersion.VERSION2, client_id=name, clean_session=not keep, protocol=MQTTv311)
    if network.username_file is not None:
        password = None if network.password_file is None else _secret(network.password_file, where)
        client.username_pw_set(_secret(network.username_file, where), password)
    if network.ca_file is not None:
        try:
            context = ssl.create_default_context(cafile=str(network.ca_file))
            if network.cert_file is not None and network.key_file is not None:
                context.load_cert_chain(str(network.cert_file), str(network.key_file))
        except (OSError, ssl.SSLError) as error:
            raise SourceError(f"{where}: ca_file, cert_file or key_file cannot be used: {error}") from None
        client.tls_set_context(context)
    return client


def _secret(path: Path, where: str) -> str:
    """Return the first line of a file."""
    try:
        with path.open(encoding="utf-8") as file:
            line = file.readline(_MAX_SECRET_BYTES).rstrip("\r\n")
    except (OSError, UnicodeDecodeError) as error:
        raise SourceError(f"{where}: {path} cannot be read: {type(error).__name__}") from None
    if not line:
        raise SourceError(f"{where}: the first line of {path} is empty")
    return line


def start_client(client: Any, ended: Callable[[str], None]) -> None:
    """Start the thread of a paho client; ``ended`` is called in it with the cause where an exception ends it."""

    def work() -> None:
        try:
            client.loop_forever(retry_first_connection=True)
        except Exception as error:  # paho would leave the client as if it were connected.
            _LOG.exception("the connection to a broker ended")
            ended(f"{type(error).__name__}: {error}")
        finally:
            client._thread = None

    client._thread_main = work
    client.loop_start()


def end_client(client: Any) -> None:
    """Disconnect a paho client, end its thread, and close the two sockets by which that was woken.

    paho closes them in a finalizer. The client is part of a cycle with its callbacks, so the garbage collector may come
    to the sockets first.
    """
    with contextlib.suppress(OSError, ValueError, RuntimeError):
        client.disconnect()
    with contextlib.suppress(OSError, ValueError, RuntimeError):
        client.loop_stop()
    client._reset_sockets()


class MqttLink:
    """The :class:`streams.link.sender.Link` to a receiver behind a broker.

    A block counts as committed only when its number is under ``TOPIC/committed``: a broker that is killed may lose
    frames that it has acknowledged.
    """

    def __init__(self, address: Address, network: NetworkSpec | None = None, timeout: float = 10.0) -> None:
        """Prepare; ``timeout`` of connecting in s. SourceError as :func:`make_client`."""
        self._address = address
        self._network = network or NetworkSpec()
        self._timeout = timeout
        self._changed = threading.Condition()
        self._latest: int | None = None
        self._fresh = False
        self._state = ""
        self._client = self._new_client()

    def _new_client(self) -> Any:
        # The broker keeps no session, so the id may be new each time.
        client = make_client(self._address, self._network, "", "--to", keep=False)
        client.on_connect = self._on_connect
        client.on_disconnect = self._on_disconnect
        client.on_message = self._on_message
        client.max_inflight_messages_set(8)
        return client

    def _on_connect(self, client: Any, userdata: Any, flags: Any, reason: Any, properties: Any) -> None:
        if not reason.is_failure:
            client.subscribe(self._address.topic + COMMITTED, qos=1)
        with self._changed:
            self._state = f"the broker refuses: {reason}" if reason.is_failure else "connected"
            self._changed.notify_all()

    def _on_disconnect(self, client: Any, userdata: Any, flags: Any, reason: Any, properties: Any) -> None:
        with self._changed:
            if client is self._client:
                self._state = f"connection to the broker lost: {reason}"
                self._changed.notify_all()

    def _on_message(self, client: Any, userdata: Any, message: Any) -> None:
        if len(message.payload) == ACK.size:
            with self._changed:
                self._latest, self._fresh = ACK.unpack(message.payload)[0], True
                self._changed.notify_all()

    def connect(self) -> int:
        """Connect to the broker and return the number that the receiver committed last."""
        self.close()
        self._client = self._new_client()
        self._state, self._latest, self._fresh = "", None, False
        try:
            self._client.connect(self._address.host, self._address.port, _KEEPALIVE_S)
        except (OSError, ValueError) as error:
            raise LinkError(f"{self._address.host}:{self._address.port}: {error}") from None
        self._client.loop_start()
        with self._changed:
            self._changed.wait_for(lambda: self._state or self._latest is not None, self._timeout)
            if self._state != "connected":
                raise LinkError(self._state or f"{self._address.host}:{self._address.port}: no answer")
            if not self._changed.wait_for(
                lambda: self._latest is not None or self._state != "connected", self._timeout
            ):
                raise LinkError(f"no receiver has said under {self._address.topic}{COMMITTED} what it has")
            if self._latest is None:
                raise LinkError(self._state)
            self._fresh = False
            return self._latest

    def send(self, frame: bytes) -> None:
        """Send one frame to the broker, which may not have received it on return."""
        if self._state != "connected":
            raise LinkError(self._state or "not connected")
        info = self._client.publish(self._address.topic, frame, qos=1)
        if info.rc != 0:
            raise LinkError(f"the broker cannot be reached (code {info.rc})")

    def committed(self, timeout: float) -> int | None:
        """Return the number committed last, if it is new."""
        with self._changed:
            self._changed.wait_for(lambda: self._fresh or self._state != "connected", timeout)
            if self._fresh:
                self._fresh = False
                return self._latest
            if self._state != "connected":
                raise LinkError(self._state)
            return None

    def close(self) -> None:
        """Disconnect."""
        self._client.on_disconnect = None
        end_client(self._client)
