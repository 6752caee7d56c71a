"""A broker of MQTT 3.1.1 made for attacks: what it sends after the subscription is bytes of the test."""

from __future__ import annotations

import socket
import struct
import threading
from collections.abc import Callable
from contextlib import suppress
from types import TracebackType
from typing import Self

from tests.support.waiting import PATIENCE_S

CONNECT, PUBLISH, PUBACK, SUBSCRIBE, PINGREQ = 0x10, 0x30, 0x40, 0x80, 0xC0
ACCEPTED = b"\x20\x02\x00\x00"


def head(first: int, length: int) -> bytes:
    """Return the head of a control packet of so many bytes."""
    digits = bytearray()
    while True:
        length, digit = length >> 7, length & 127
        digits.append(digit | (128 if length else 0))
        if not length:
            return bytes((first, *digits))


def packet(first: int, body: bytes) -> bytes:
    """Return a control packet."""
    return head(first, len(body)) + body


def publish(topic: str | bytes, payload: bytes, mid: int = 1, qos: int = 1, flags: int = 0) -> bytes:
    """Return a PUBLISH packet."""
    name = topic.encode() if isinstance(topic, str) else topic
    number = struct.pack("!H", mid) if qos else b""
    return packet(PUBLISH | qos << 1 | flags, struct.pack("!H", len(name)) + name + number + payload)


class HostileBroker:
    """Serves one connection after another; the n-th is attacked with the n-th of ``attacks``.

    An attack gets a connection that has said nothing yet. It may raise EOFError, which closes it; else packets are read
    and answered until the client leaves.

    Attributes:
        got: packets that came, as first byte and body.
        connections: that were made.
    """

    def __init__(self, *attacks: Callable[[Session], None], then: Callable[[Session], None] | None = None) -> None:
        """Listen on a free port; ``then`` gets later connections, once they have subscribed."""
        self._attacks, self._then = list(attacks), then
        self._server = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._server.getsockname()[1]
        self.got: list[tuple[int, bytes]] = []
        self.connections = 0
        self._thread = threading.Thread(target=self._serve)

    def __enter__(self) -> Self:
        """Serve."""
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End."""
        self._server.shutdown(socket.SHUT_RDWR)
        self._thread.join()
        self._server.close()

    def _serve(self) -> None:
        while True:
            try:
                connection, _ = self._server.accept()
            except OSError:
                return
            connection.settimeout(PATIENCE_S)
            attack = self._attacks[self.connections] if self.connections < len(self._attacks) else None
            self.connections += 1
            with connection, suppress(OSError, EOFError):
                session = Session(connection, self.got)
                if attack is not None:
                    attack(session)
                elif self._then is not None:
                    session.subscribed()
                    self._then(session)
                while True:
                    session.read()


class Session:
    """One connection of a client.

    Attributes:
        refuses: subscriptions.
    """

    refuses = False

    def __init__(self, connection: socket.socket, got: list[tuple[int, bytes]]) -> None:
        """Begin before CONNECT."""
        self.socket, self._got = connection, got

    def _bytes(self, count: int) -> bytes:
        found = b""
        while len(found) < count:
            part = self.socket.recv(count - len(found))
            if not part:
                raise EOFError
            found += part
        return found

    def read(self) -> int:
        """Read a packet, answer a ping, a message and a subscription; return its kind."""
        first, length, shift = self._bytes(1)[0], 0, 0
        while True:
            digit = self._bytes(1)[0]
            length, shift = length | (digit & 127) << shift, shift + 7
            if digit < 128:
                break
        body = self._bytes(length)
        self._got.append((first, body))
        kind = first & 0xF0
        if kind == SUBSCRIBE:
            self.socket.sendall(packet(0x90, body[:2] + (b"\x80" if self.refuses else b"\x01")))
        elif kind == PUBLISH and first & 0x06:
            topic = int.from_bytes(body[:2], "big")
            self.socket.sendall(packet(PUBACK, body[2 + topic : 4 + topic]))
        elif kind == PINGREQ:
            self.socket.sendall(b"\xd0\x00")
        return kind

    def connected(self, answer: bytes = ACCEPTED) -> None:
        """Read CONNECT, and answer it."""
        assert self.read() == CONNECT
        self.socket.sendall(answer)

    def subscribed(self) -> None:
        """Accept the connection, and go on until it is subscribed."""
        self.connected()
        while self.read() != SUBSCRIBE:
            pass

    def send(self, data: bytes) -> None:
        """Send bytes."""
        self.socket.sendall(data)
