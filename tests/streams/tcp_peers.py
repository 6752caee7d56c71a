"""A receiver on a free port, those who talk to it, and a recording to send."""

from __future__ import annotations

import socket
import struct
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from streams.link.sender import TcpLink
from streams.link.tcp import TcpReceiver
from streams.link.wire import block_frame, encode_frame, hello
from streams.types.block import Block, Rejected
from streams.types.spec import NetworkSpec, SourceSpec, parse_address
from tests.support.memory_ledger import MemoryLedger
from tests.support.waiting import PATIENCE_S

URL = "tcp://127.0.0.1:0"


def block(sequence: int, samples: int = 64) -> Block:
    rows = np.random.default_rng(sequence).standard_normal((2, samples)).astype(np.float32)
    return Block(rows, 100.0, ("x", "y"), ("g", "g"), "made", sequence, str(sequence), start=1.7e9 + sequence)


class Recorded:
    """A recording of blocks, some of which could not be made."""

    name = "made"

    def __init__(self, numbers: range, bad: tuple[int, ...] = (), samples: int = 64) -> None:
        self.numbers, self.bad, self.samples = numbers, bad, samples

    def __len__(self) -> int:
        return len(self.numbers)

    def __iter__(self) -> Iterator[Block | Rejected]:
        for n in self.numbers:
            yield Rejected("made", n, str(n), "nan", "bad") if n in self.bad else block(n, self.samples)


@contextmanager
def receiving(
    ledger: MemoryLedger, network: NetworkSpec | None = None, specs: list[SourceSpec] | None = None
) -> Iterator[TcpReceiver]:
    with TcpReceiver(specs or [SourceSpec("press", URL)], network) as receiver:
        receiver.open(ledger)
        yield receiver


def commit(receiver: TcpReceiver, ledger: MemoryLedger, timeout: float = PATIENCE_S) -> Block | Rejected:
    delivery = receiver.next(timeout)
    assert delivery is not None
    ledger.commit(delivery.item)
    receiver.acknowledge(delivery)
    return delivery.item


def link(receiver: TcpReceiver, stream: str = "press") -> TcpLink:
    return TcpLink(parse_address(f"tcp://127.0.0.1:{receiver.port}", "test"), stream, PATIENCE_S)


def raw(receiver: TcpReceiver, stream: str = "press") -> socket.socket:
    connection = socket.create_connection(("127.0.0.1", receiver.port), PATIENCE_S)
    connection.sendall(hello(stream))
    return connection


def answer(connection: socket.socket) -> int:
    data = b""
    while len(data) < 8:
        more = connection.recv(8 - len(data))
        assert more, "the receiver closed the connection"
        data += more
    return struct.unpack("<Q", data)[0]


def frame(sequence: int) -> bytes:
    return encode_frame(block_frame(block(sequence)))


def gone(connection: socket.socket) -> bool:
    try:
        while connection.recv(4096):
            pass
    except ConnectionError:
        pass
    return True
