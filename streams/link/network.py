"""What live streams over a network are configured by: addresses, who may connect, limits, names of secret files."""

from __future__ import annotations

import ipaddress
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import unquote, urlsplit

from streams.link.wire import MAX_FRAME
from streams.spec import SourceError

MQTT_PORT = 1883
_MAX_TOPIC = 512


@dataclass(frozen=True)
class NetworkSpec:
    """Limits of a network source, and how it proves who it is.

    Attributes:
        peers: networks (such as ``192.168.1.0/24``) from which a TCP sender may connect; empty: this machine only.
        max_connections: most TCP connections at a time.
        read_timeout: seconds within which a frame that has begun must be whole, and a hello must come.
        max_frame: bytes of the largest frame to accept.
        max_waiting: bytes of frames that may wait for their commit; beyond it nothing more is read.
        ca_file: certificates (PEM) that the broker's must descend from; it switches TLS on.
        cert_file: this machine's certificate for the broker (PEM), with ``key_file``.
        key_file: its private key.
        username_file: file whose first line is the user name for the broker.
        password_file: likewise the password.
        client_id: name of this client at the broker, under which it keeps messages; None makes one of the source name.
    """

    peers: tuple[str, ...] = ()
    max_connections: int = 16
    read_timeout: float = 30.0
    max_frame: int = MAX_FRAME
    max_waiting: int = 4 * MAX_FRAME
    ca_file: Path | None = None
    cert_file: Path | None = None
    key_file: Path | None = None
    username_file: Path | None = None
    password_file: Path | None = None
    client_id: str | None = None

    def __post_init__(self) -> None:
        """Refuse what could not work."""
        for peer in self.peers:
            try:
                ipaddress.ip_network(peer)
            except ValueError as error:
                raise SourceError(f"peers: {error}; expected networks such as 192.168.1.0/24") from None
        if not (self.max_connections >= 1 and self.read_timeout > 0.0 and 1024 <= self.max_frame <= MAX_FRAME):
            raise SourceError(
                f"max_connections must be 1 or more, read_timeout_s positive, max_frame 1024 to {MAX_FRAME} bytes; got "
                f"{self.max_connections}, {self.read_timeout}, {self.max_frame}"
            )
        if (self.cert_file is None) != (self.key_file is None):
            raise SourceError("cert_file and key_file belong together")

    def admits(self, address: str) -> bool:
        """Tell whether a sender at this numerical address may connect."""
        found = ipaddress.ip_address(address.partition("%")[0])
        mapped = getattr(found, "ipv4_mapped", None)
        found = mapped or found
        return found.is_loopback or any(found in ipaddress.ip_network(peer) for peer in self.peers)


@dataclass(frozen=True)
class Address:
    """Where a stream goes: host, port and, for MQTT, the topic."""

    scheme: str
    host: str
    port: int
    topic: str = ""


def parse_address(url: str, where: str) -> Address:
    """Return the parts of ``tcp://HOST:PORT`` or ``mqtt://HOST[:PORT]/TOPIC``.

    Args:
        url: the address.
        where: what to name in a message, such as ``[[source]] press: url``.

    Raises:
        SourceError: it is neither; or it holds a user name or password, which belong into files; or a topic with
            wildcards, which would let anybody's messages in.
    """
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port
    except ValueError as error:
        raise SourceError(f"{where} {url!r}: {error}") from None
    if parts.username is not None or parts.password is not None:
        raise SourceError(f"{where}: user name and password belong into username_file and password_file")
    extra = parts.query or parts.fragment
    if parts.scheme == "tcp" and host and port is not None and not extra and parts.path in ("", "/"):
        return Address("tcp", host, port)
    topic = unquote(parts.path[1:])
    if parts.scheme == "mqtt" and host and topic and not extra:
        if re.search(r"[+#\0]", topic) or topic.startswith("$") or len(topic.encode()) > _MAX_TOPIC:
            raise SourceError(f"{where} {url!r}: the topic must be one topic, without + and #")
        return Address("mqtt", host, MQTT_PORT if port is None else port, topic)
    raise SourceError(f"{where} {url!r}: expected tcp://HOST:PORT or mqtt://HOST:PORT/TOPIC")


def same_listener(addresses: Sequence[Address]) -> Address:
    """Return host and port that all streams of one receiver share.

    Raises:
        ValueError: they differ; the caller sorts them beforehand.
    """
    first = addresses[0]
    if any((other.scheme, other.host, other.port) != (first.scheme, first.host, first.port) for other in addresses):
        raise ValueError(f"one receiver serves one address, got {sorted({f'{a.host}:{a.port}' for a in addresses})}")
    return first
