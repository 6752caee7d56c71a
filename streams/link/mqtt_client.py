"""Clients of paho: credentials, TLS, threads, and bounds against brokers that break the protocol.

paho itself keeps a packet of up to 256 MB, and messages of QoS 2 and unsent answers without end; an exception on a
malformed packet ends its thread.
"""

from __future__ import annotations

import contextlib
import functools
import logging
import ssl
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from streams.types.spec import MAX_FRAME, Address, NetworkSpec, SourceError

_LOG = logging.getLogger(__name__)
KEEPALIVE_S = 30
MAX_TOPIC_BYTES = 1 << 16
"""Of a packet, beside its payload: topic, lengths, number."""
_MAX_SECRET_BYTES = 4096
_MAX_UNSENT_PACKETS = 100_000
_CHUNK_BYTES = 1 << 18
_PUBLISH_QOS_2 = 0x34
"""Kind of a packet and upper bit of its QoS: 2, or 3, which there is not."""


class _Head(bytearray):
    """The first bytes of a packet; what is added beyond them is discarded."""

    max_bytes = 0

    def __iadd__(self, data: Any) -> _Head:  # type: ignore[override]
        room = self.max_bytes - len(self)
        if room > 0:
            self.extend(data[:room])
        return self


@functools.cache
def _bounded() -> Any:
    """Return the class of the clients; paho is there."""
    from paho.mqtt.client import Client
    from paho.mqtt.enums import MQTTErrorCode

    class BoundedClient(Client):
        """A client that keeps ``max_packet_bytes`` of a packet, and ends a connection that breaks the protocol.

        ``broken``: why it ended the last one.
        """

        max_packet_bytes = MAX_TOPIC_BYTES
        broken: str | None = None

        def _sock_recv(self, bufsize: int) -> bytes:
            packet: Any = self._in_packet
            if packet["have_remaining"] and not isinstance(packet["packet"], _Head):
                packet["packet"] = _Head()
                packet["packet"].max_bytes = self.max_packet_bytes
            return super()._sock_recv(min(bufsize, _CHUNK_BYTES))

        def _packet_handle(self) -> MQTTErrorCode:
            command = self._in_packet["command"]
            if command & 0xF4 == _PUBLISH_QOS_2:
                self.broken = "it sends with QoS 2, unasked"
            elif len(self._out_packet) > _MAX_UNSENT_PACKETS:
                self.broken = "it reads no answers"
            else:
                try:
                    found = super()._packet_handle()
                except Exception as error:
                    _LOG.debug("a packet of a broker cannot be taken", exc_info=True)
                    self.broken = f"a packet 0x{command:02x} cannot be taken: {type(error).__name__}: {error}"
                else:
                    if found == MQTTErrorCode.MQTT_ERR_PROTOCOL:
                        self.broken = f"a packet 0x{command:02x} breaks the protocol"
                    return found
            return MQTTErrorCode.MQTT_ERR_PROTOCOL

    return BoundedClient


def new_client(max_payload_bytes: int, **options: Any) -> Any:
    """Return a client that keeps so much of a payload and a little more; ModuleNotFoundError without paho-mqtt."""
    from paho.mqtt.enums import CallbackAPIVersion

    client = _bounded()(CallbackAPIVersion.VERSION2, **options)
    client.max_packet_bytes = max_payload_bytes + 2 * MAX_TOPIC_BYTES
    return client


def make_client(
    address: Address,
    network: NetworkSpec,
    name: str,
    where: str,
    *,
    keep: bool = True,
    max_payload_bytes: int = MAX_FRAME,
) -> Any:
    """Return a client of an id with its credentials, not connected yet.

    ``where`` is the key or option named in a message; with ``keep`` the broker keeps the session. A longer payload is
    cut, but still longer than ``max_payload_bytes``.

    Raises:
        SourceError: paho-mqtt is missing, or a file cannot be read; no secret is in the message.
    """
    try:
        from paho.mqtt.client import MQTTv311
    except ModuleNotFoundError:
        raise SourceError(f'{where}: mqtt:// needs paho-mqtt: pip install "spallwatch[mqtt]"') from None
    client = new_client(max_payload_bytes, client_id=name, clean_session=not keep, protocol=MQTTv311)
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


def connect_problem(address: Address) -> str:
    """Return, in the callback ``on_connect_fail``, why there is no connection."""
    # paho calls it where it handles the exception, which it does not hand over.
    error = sys.exc_info()[1]
    if isinstance(error, ssl.SSLError):
        return f"no encrypted connection to the broker at {address.host}:{address.port}: {error}"
    return f"no broker answers at {address.host}:{address.port}"


def loss(client: Any, reason: Any) -> str:
    """Return, in the callback ``on_disconnect``, that and why the connection is lost."""
    cause, client.broken = client.broken or reason, None
    return f"connection to the broker lost: {cause}"


def start_client(client: Any, ended: Callable[[str], None]) -> None:
    """Start the thread of a client; ``ended`` is called in it with the cause where an exception ends it."""

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
    """Disconnect a client, end its thread, and close the two sockets by which that was woken.

    paho closes them in a finalizer. The client is part of a cycle with its callbacks, so the garbage collector may come
    to the sockets first.
    """
    with contextlib.suppress(OSError, ValueError, RuntimeError):
        client.disconnect()
    with contextlib.suppress(OSError, ValueError, RuntimeError):
        client.loop_stop()
    client._reset_sockets()
