"""Frames from an MQTT broker: QoS 1, kept session, acknowledged after the commit.

The payload is the frame of TCP. The number committed last is published, retained, under ``TOPIC/committed``; a sender
keeps its blocks until it reads their number there. docs/reference/wire.md has the protocol.
"""

from __future__ import annotations

import re
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from streams.link.arrivals import Ticket
from streams.link.mqtt_client import KEEPALIVE_S, connect_problem, end_client, loss, make_client, start_client
from streams.link.receiver import Receiver
from streams.link.refusals import JUMP, LINK
from streams.link.sender import LinkError
from streams.link.wire import ACK, JumpError, WireError
from streams.types.spec import Address, NetworkSpec, SourceError, SourceSpec

COMMITTED = "/committed"
"""Suffix of the topic with the number committed last."""


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
        self._client = self._new_client()
        self._connection = 0
        self._connected = self._failed = False
        self._cause: str | None = None
        self._problem = f"{self.name}: not connected to the broker yet"

    def _new_client(self) -> Any:
        limit = self._network.max_frame
        return make_client(self._address, self._network, self._client_id, self._where, max_payload_bytes=limit)

    def _start(self) -> None:
        """Connect in the background; an unreachable broker is tried again."""
        client = self._client
        client.manual_ack_set(True)
        client.on_connect = self._on_connect
        client.on_disconnect = self._on_disconnect
        client.on_connect_fail = self._on_connect_fail
        client.on_message = self._on_message
        client.on_subscribe = self._on_subscribe
        client.reconnect_delay_set(min_delay=1, max_delay=4)
        client.connect_async(self._address.host, self._address.port, KEEPALIVE_S)
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
            self._client = self._new_client()
            self._start()
            self._failed = False
        except (SourceError, RuntimeError) as error:
            self._restarts.failed(str(error))

    def problem(self) -> str | None:
        """Return why nothing is received, or why the last message was refused."""
        if self._failed:
            return self._restarts.problem() or f"{self.name}: the receiver has stopped: {self._restarts.cause}"
        if self._arrivals.full:
            return f"{self.name}: blocks come faster than they are committed"
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
            self._refused(loss(client, reason))

    def _on_connect_fail(self, client: Any, userdata: Any) -> None:
        self._refused(connect_problem(self._address))

    def _on_subscribe(self, client: Any, userdata: Any, mid: Any, reasons: Any, properties: Any) -> None:
        if any(reason.is_failure for reason in reasons):
            self._refused(f"the broker refuses the subscription of {' or '.join(self._arrivals.streams)}")

    def _on_message(self, client: Any, userdata: Any, message: Any) -> None:
        # Nothing is read until there is room: the broker keeps the rest, and what came without QoS its sender repeats.
        self._arrivals.wait_for_room()
        topic: str | None = None
        try:
            topic = str(message.topic)
            self._take(client, topic, message)
        except WireError as error:
            self._refused(f"{topic}: {error}", JUMP if isinstance(error, JumpError) else LINK, topic)
            client.ack(message.mid, message.qos)
        except UnicodeDecodeError:
            self._refused("a message under a topic that is not UTF-8 is not taken")
            client.ack(message.mid, message.qos)
        except Exception as error:  # A fault of one message must not end the connection; its sender repeats it.
            self._fault(f"a message under {topic!a} cannot be taken", error)
            client.ack(message.mid, message.qos)

    def _take(self, client: Any, topic: str, message: Any) -> None:
        limit = self._network.max_frame
        if message.retain:
            client.ack(message.mid, message.qos)
            return
        if topic not in self._arrivals.streams:
            raise WireError("a message under a topic that is not subscribed")
        if len(message.payload) > limit:
            raise WireError(f"a message of more than max_frame = {limit} bytes is not taken")
        token = _Token(self._connection, message.mid) if message.qos else None
        taken = self._arrivals.take(topic, message.payload, token, limit)
        self._problem = None
        if not taken:
            # The broker lost the one before; both stay uncommitted, and the sender repeats them.
            client.ack(message.mid, message.qos)
        self._acknowledge(self._arrivals.spent(topic))

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
        client = make_client(self._address, self._network, "", "--to", keep=False, max_payload_bytes=ACK.size)
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
                self._state = loss(client, reason)
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
            self._client.connect(self._address.host, self._address.port, KEEPALIVE_S)
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
