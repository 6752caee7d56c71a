"""Hostile clients of the page, the TCP receiver and the OPC UA server: a hundred threads in a process of their own.

    python -m benchmarks.service.hostile_clients TARGET

``TARGET`` is a JSON object with the fields of :class:`Target`. They go on until standard input ends; then one JSON
object is printed: by kind, how many clients, connections, MB sent and answers.
"""

from __future__ import annotations

import asyncio
import json
import logging
import os
import random
import socket
import struct
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial

from asyncua.client.client import Client as OpcUaClient

from models.platform.portable import lower_priority
from streams.link.wire import FRAME_MAGIC, HEAD, HELLO, HELLO_MAGIC, PROVEN, hello

CLIENTS = 100
_PATIENCE_S = 5.0
_PART = bytes(range(256)) * 256


@dataclass(frozen=True)
class Target:
    """What is attacked.

    Attributes:
        page, tcp, opcua: ports of this machine.
        addresses: of the clients, which share them in turn.
        users: names of users of the page.
        stream: a stream of the receiver that has a key.
        recorded: hexadecimal; what a sender with the key sent in another connection.
        floods: whether some flood the listeners with connections.
        clients: their number.
    """

    page: int
    tcp: int
    opcua: int
    addresses: Sequence[str]
    users: Sequence[str]
    stream: str
    recorded: str
    floods: bool = True
    clients: int = CLIENTS


@dataclass
class Client:
    """One hostile client; its counts are of its kind."""

    target: Target
    address: str
    ending: threading.Event
    random: random.Random
    counts: Counter[str] = field(default_factory=Counter)

    @contextmanager
    def dial(self, port: int, *, reset: bool = False) -> Iterator[socket.socket]:
        """Lend a connection; ``reset`` ends it without a word."""
        with socket.socket() as made:
            made.settimeout(_PATIENCE_S)
            if reset:
                made.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            # Small, so that what is not read soon waits at the server.
            made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            made.bind((self.address, 0))
            made.connect(("127.0.0.1", port))
            self.counts["connections"] += 1
            yield made

    def any_port(self) -> int:
        """Return one of the three ports."""
        return self.random.choice((self.target.page, self.target.tcp, self.target.opcua))

    def send(self, connection: socket.socket, data: bytes) -> None:
        """Send all of it."""
        connection.sendall(data)
        self.counts["bytes"] += len(data)

    def read(self, connection: socket.socket) -> bytes:
        """Read what is answered first."""
        answer = connection.recv(4096)
        self.counts["answers"] += bool(answer)
        return answer

    def head(self, request: str, *lines: str) -> bytes:
        """Return the head of a request to the page."""
        return "\r\n".join((f"{request} HTTP/1.1", f"Host: localhost:{self.target.page}", *lines, "", "")).encode()

    def post(self, path: str, body: bytes, *lines: str) -> None:
        """Send a body of JSON to the page, and read the answer."""
        lines = ("Content-Type: application/json", f"Content-Length: {len(body)}", *lines)
        with self.dial(self.target.page) as connection:
            self.send(connection, self.head(f"POST {path}", *lines) + body)
            self.read(connection)

    def hold(self, connection: socket.socket, seconds: float = 60.0) -> None:
        """Keep a connection open, unread, until the server ends it."""
        until = time.monotonic() + seconds
        while not self.ending.wait(0.2) and time.monotonic() < until:
            # An error or an end is seen without reading.
            if connection.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR):
                return
            connection.settimeout(0.0)
            with suppress(BlockingIOError):
                if not connection.recv(1, socket.MSG_PEEK):
                    return
            connection.settimeout(_PATIENCE_S)


def _slow_head(client: Client) -> None:
    with client.dial(client.target.page) as connection:
        for byte in client.head("GET /healthz", "X: " + "a" * 100):
            client.send(connection, bytes((byte,)))
            if client.ending.wait(0.3):
                return


def _half_open(client: Client) -> None:
    with client.dial(client.any_port()) as first, client.dial(client.target.page), client.dial(client.target.tcp):
        client.hold(first)


def _endless_head(client: Client) -> None:
    with client.dial(client.target.page) as connection:
        client.send(connection, client.head("GET /")[:-2])
        while not client.ending.is_set():
            client.send(connection, b"X-Nothing: 1\r\n" * 40)
            client.ending.wait(0.05)


def _body_claims(client: Client) -> None:
    claim = client.random.choice(("Transfer-Encoding: chunked", f"Content-Length: {1 << 40}"))
    head = client.head("POST /login", "Content-Type: application/json", claim)
    with client.dial(client.target.page) as connection:
        client.send(connection, head + (b"7fffffff\r\n" if "chunked" in claim else b""))
        while not client.ending.is_set():
            client.send(connection, _PART)


def _wrong_tokens(client: Client) -> None:
    token = f"{client.random.getrandbits(256):064x}"
    if client.random.random() < 0.5:
        client.post("/login", json.dumps({"token": token}).encode())
        return
    with client.dial(client.target.page) as connection:
        client.send(connection, client.head("GET /api/machines", f"Authorization: Bearer {token}"))
        client.read(connection)


def _wrong_passwords(client: Client) -> None:
    # Half of them for the first name, which signs in most.
    name = client.random.choice((client.target.users[0], client.random.choice(client.target.users)))
    password = f"{client.random.getrandbits(64):016x}"
    client.post("/login", json.dumps({"name": name, "password": password}).encode())


def _random_bytes(client: Client) -> None:
    with client.dial(client.any_port()) as connection:
        client.send(connection, client.random.randbytes(client.random.choice((1, 8, 100, 5000))))
        client.read(connection)


def _tls_hello(client: Client) -> None:
    words = b"\x01\x00\x00\xf0\x03\x03" + client.random.randbytes(234)
    with client.dial(client.any_port()) as connection:
        client.send(connection, b"\x16\x03\x01" + struct.pack(">H", len(words)) + words)
        client.read(connection)


def _flood(client: Client, port: Callable[[Target], int]) -> None:
    with client.dial(port(client.target), reset=True):
        pass


def _unread_stream(client: Client) -> None:
    socket_lines = ("Upgrade: websocket", "Connection: Upgrade", "Sec-WebSocket-Version: 13", "Sec-WebSocket-Key: AA==")
    lines = client.random.choice(((), socket_lines))
    with client.dial(client.target.page) as connection:
        client.send(connection, client.head("GET /api/stream?machine=m&channel=x0", *lines))
        client.hold(connection)


def _unread_answers(client: Client) -> None:
    with client.dial(client.target.page) as connection:
        for path in ("/static/main.js", "/api/machines", "/api/channels/m/x0/records?points=5000", "/api/events") * 8:
            client.send(connection, client.head(f"GET {path}"))
        client.hold(connection)


def _views(client: Client) -> None:
    path = client.random.choice(("records?points=5000", "spectrum", "waterfall", "map"))
    with client.dial(client.target.page) as connection:
        client.send(connection, client.head(f"GET /api/channels/m/x0/{path}", "Connection: close"))
        while client.read(connection):
            pass


def _traversal(client: Client) -> None:
    up = client.random.choice(("../", "..%2f", "%2e%2e/", "..\\", "....//", "%00/", "/"))
    place = client.random.choice(("/static/", "/records/", "/", "/api/channels/m/"))
    with client.dial(client.target.page) as connection:
        client.send(connection, client.head(f"GET {place}{up * 6}etc/passwd"))
        if b"root:" in client.read(connection) + connection.recv(4096):
            client.counts["files read"] += 1


def _huge_json(client: Client) -> None:
    body = client.random.choice((b"[" * 8000, b'{"name":' * 1000, b'{"token":"' + _PART.hex().encode() + b'"}'))
    client.post(client.random.choice(("/login", "/api/acknowledge", "/api/events/m:n1/acknowledge")), body)


def _opcua_claims(client: Client) -> None:
    words = struct.pack("<IIIIIi", 0, 65_536, 65_536, 0, 0, 4) + b"opc:"
    size = client.random.choice((0x7FFFFFFF, 65_535, 0, 9))
    with client.dial(client.target.opcua) as connection:
        client.send(connection, b"HELF" + struct.pack("<I", 8 + len(words)) + words)
        client.read(connection)
        client.send(connection, client.random.choice((b"MSGC", b"OPNF", b"MSGF")) + struct.pack("<I", size))
        while not client.ending.is_set():
            client.send(connection, _PART)


def _opcua_reads(client: Client) -> None:
    async def read() -> None:
        opened = OpcUaClient(f"opc.tcp://127.0.0.1:{client.target.opcua}/m", timeout=_PATIENCE_S)
        opened.session_timeout = 60_000
        client.counts["connections"] += 1
        async with opened:
            node = opened.get_node("ns=2;s=m:state")
            while not client.ending.is_set():
                found = await asyncio.gather(*(node.read_value() for _ in range(50)))
                client.counts["answers"] += len(found)

    # Of any kind: the connection may end in the midst of anything.
    with suppress(Exception):
        asyncio.run(read())


def _lying_frames(client: Client) -> None:
    name = client.target.stream.encode()
    head = HEAD.pack(FRAME_MAGIC, 1, 1, 1, 25600.0, 2**32 - 1, 3, 0, 65_535)
    words = client.random.choice(
        (
            HELLO.pack(HELLO_MAGIC, PROVEN, 65_535) + _PART,
            HELLO.pack(HELLO_MAGIC, 1, len(name)) + name + head + _PART,
            HELLO.pack(HELLO_MAGIC, PROVEN, len(name)) + name + bytes(32) + head + _PART,
            head + _PART,
            HELLO.pack(HELLO_MAGIC, PROVEN, 64) + b"\xff" * 64,
            hello("another"),
        )
    )
    with client.dial(client.target.tcp) as connection:
        client.send(connection, words)
        while client.read(connection):
            pass


def _replayed_sender(client: Client) -> None:
    with client.dial(client.target.tcp) as connection:
        client.send(connection, bytes.fromhex(client.target.recorded))
        while client.read(connection):
            pass


FLOOD = "connections to "
KINDS: dict[str, Callable[[Client], None]] = {
    "slow head": _slow_head,
    "half-open": _half_open,
    "endless head": _endless_head,
    "claims of huge bodies": _body_claims,
    "wrong tokens": _wrong_tokens,
    "wrong passwords": _wrong_passwords,
    "random bytes": _random_bytes,
    "TLS to plain ports": _tls_hello,
    "connections to the page": partial(_flood, port=lambda target: target.page),
    "connections to the receiver": partial(_flood, port=lambda target: target.tcp),
    "connections to OPC UA": partial(_flood, port=lambda target: target.opcua),
    "streams never read": _unread_stream,
    "answers never read": _unread_answers,
    "views": _views,
    "paths to other files": _traversal,
    "huge JSON": _huge_json,
    "OPC UA claims": _opcua_claims,
    "OPC UA reads": _opcua_reads,
    "lying frames": _lying_frames,
    "replayed sender": _replayed_sender,
}
"""What a client of each kind does once; it does so until the end."""


def attack(target: Target, ending: threading.Event) -> dict[str, Counter[str]]:
    """Let the clients, as many of each kind as of another, do their worst until ``ending``; return counts by kind."""
    found: dict[str, Counter[str]] = {name: Counter() for name in KINDS}

    def run(name: str, client: Client) -> None:
        while not ending.is_set():
            try:
                KINDS[name](client)
            except OSError:
                # Ended or refused: it begins again, more slowly where it cannot even connect.
                client.counts["errors"] += 1
                ending.wait(0.01)

    names = [name for name in KINDS if target.floods or not name.startswith(FLOOD)]
    clients: list[tuple[str, Client, threading.Thread]] = []
    for number in range(target.clients):
        name = names[number % len(names)]
        address = target.addresses[number % len(target.addresses)]
        client = Client(target, address, ending, random.Random(number))
        clients.append((name, client, threading.Thread(target=run, args=(name, client), daemon=True)))
    for _, _, thread in clients:
        thread.start()
    ending.wait()
    for name, client, thread in clients:
        thread.join(2.0 * _PATIENCE_S)
        found[name] += client.counts + Counter(clients=1)
    return found


def main() -> None:
    """Attack until standard input ends; print the counts."""
    # On machines of their own they would take no time from the daemon; so they take it from its page at most.
    lower_priority()
    logging.getLogger("asyncua").setLevel(logging.CRITICAL)
    ending = threading.Event()

    def wait() -> None:
        while os.read(0, 4096):
            pass
        ending.set()

    threading.Thread(target=wait, daemon=True).start()
    print(json.dumps(attack(Target(**json.loads(sys.argv[1])), ending)))


if __name__ == "__main__":
    main()
