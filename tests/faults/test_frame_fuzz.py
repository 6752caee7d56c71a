"""Wrong and damaged frames and hellos: the receiver and what commits go on, and no stream is silenced."""

from __future__ import annotations

import json
import random
import socket
import struct
import threading
from contextlib import suppress
from pathlib import Path
from typing import Any

from google_crc32c import value as crc32c

from monitor.records.store import Store
from monitor.service.ingest import Ingest
from streams.link.sender import Sender, TcpLink
from streams.link.tcp import TcpReceiver
from streams.link.wire import HEAD, HELLO, block_frame, encode_frame, hello
from streams.types.spec import parse_address
from tests.support.effort import effort_count
from tests.support.network_kill import Made, block, config
from tests.support.waiting import PATIENCE_S, wait_until

FRAMES = effort_count(quick=120, full=2000)
_ROUND = 40
"""Frames between two checks that the stream goes on."""
_NUMBERS: tuple[Any, ...] = (
    *(0, -1, 1, 1e-308, -1e-308, 12_000, 1e300, -1e300, 2**31, 2**53, 2**63 - 1, 2**63, 2**64, 10**400, 0.5),
    *(None, True, "30", "", [], {}, [[]], float("nan"), float("inf")),
)
_KEYS = ("speed_hz", "load_newton", "elapsed_s", "after", "scale", "channels", "units", "start", "\0", "rate", "pulses")
_TEXTS = (b"[" * 60_000, b'{"a":' * 12_000, b"\xff\xfe", b"", b"null", b"{}", b'"' + b"x" * 60_000 + b'"')


def header_of(generator: random.Random) -> bytes:
    """Return a header that is wrong, or right by chance."""
    if generator.random() < 0.2:
        return generator.choice(_TEXTS)
    header: dict[str, Any] = {"channels": ["x"], "units": ["g"]}
    for _ in range(generator.randint(0, 3)):
        value = generator.choice(_NUMBERS)
        header[generator.choice(_KEYS)] = [value] * generator.randint(1, 3) if generator.random() < 0.3 else value
    return json.dumps(header).encode()


def made_frame(generator: random.Random, following: int) -> bytes:
    """Return a frame with wrong fields and a right checksum, or a damaged one."""
    near = following + generator.randint(-3, 5)
    sequence = generator.choice((following, following, max(0, near), following + 200_000, 2**53, 2**63 - 1, 2**64 - 1))
    if generator.random() < 0.2:
        data = bytearray(encode_frame(block_frame(block(following))))
        for _ in range(generator.randint(1, 4)):
            data[generator.randrange(len(data))] ^= 1 << generator.randrange(8)
        return bytes(data[: generator.choice((len(data), generator.randrange(len(data))))])
    rate = generator.choice((2560.0, 2560.0, 1e-300, -1.0, 1e300, float("nan"), 1.0, 25_600.0))
    start = generator.choice((1_700_000_000 * 10**9, -(2**63), 2**63 - 1, 1 - 2**63, 0))
    kind, text = generator.randint(1, 4), header_of(generator)
    channels, count = generator.choice(((1, 256), (1, 256), (1, 1), (2, 256), (0, 256), (1, 0), (1024, 3)))
    payload = generator.randbytes(channels * count * (2, 4, 4, 8)[kind - 1])
    version = generator.choice((1, 1, 1, 2))
    head = HEAD.pack(*(b"SPW1", version, channels, sequence, rate, count, kind, start, len(text)))
    return head + text + payload + struct.pack("<I", crc32c(head + text + payload))


def made_hello(generator: random.Random) -> bytes:
    """Return a wrong hello."""
    name = generator.choice((b"s", b"lathe", b"", b"\xff", b"x" * 64))
    version, length = generator.choice((1, 2, 2, 3, 65535)), generator.choice((len(name), 0, 65535))
    return generator.choice((b"SPWH", b"SPWH", b"GET ")) + HELLO.pack(b"", version, length)[4:] + name


def attack(port: int, generator: random.Random, count: int, following: int) -> None:
    """Send wrong frames, on new connections where the receiver has closed one."""
    for _ in range(count):
        with socket.create_connection(("127.0.0.1", port), PATIENCE_S) as connection, suppress(OSError):
            if generator.random() < 0.1:
                connection.sendall(made_hello(generator))
            else:
                connection.sendall(hello("s"))
                connection.recv(8, socket.MSG_WAITALL)
                connection.sendall(b"".join(made_frame(generator, following) for _ in range(generator.randint(1, 3))))
            connection.shutdown(socket.SHUT_WR)
            while connection.recv(4096):
                pass


def test_wrong_frames_end_no_receiver_and_no_stream(tmp_path: Path) -> None:
    generator, stop, ready = random.Random(5), threading.Event(), threading.Event()
    found: list[Ingest] = []
    failures: list[BaseException] = []

    def work() -> None:
        try:
            machine = config("tcp://127.0.0.1:0")
            with Store.open(tmp_path / "state.db", machine="m") as store, Ingest.open(machine, store) as ingest:
                found.append(ingest)
                ready.set()
                ingest.run(stop)
        except BaseException as error:
            failures.append(error)
            ready.set()

    thread = threading.Thread(target=work)
    thread.start()
    try:
        assert ready.wait(PATIENCE_S)
        assert not failures
        receiver = found[0].sources[0]
        assert isinstance(receiver, TcpReceiver)
        address = parse_address(f"tcp://127.0.0.1:{receiver.port}", "test")
        last = 0
        for _ in range(FRAMES // _ROUND):
            attack(receiver.port, generator, _ROUND, last + 1)
            wait_until(lambda: receiver.backlog().pending == 0)
            link = TcpLink(address, "s", PATIENCE_S)
            committed = link.connect()
            link.close()
            assert last <= committed <= last + 6
            last = committed + 3
            assert Sender(Made(), link, limit=last, patience=0.0).run().acknowledged == last
        assert thread.is_alive()
        assert "store" not in found[0].problems()
        backlog = receiver.backlog()
        assert backlog.pending == 0
        assert backlog.offered == backlog.accepted + backlog.rejected
        assert backlog.refused > 0
    finally:
        stop.set()
        thread.join()
    assert failures == []
    with Store.open(tmp_path / "state.db", read_only=True) as store:
        assert store.check() == []
        assert {"ok", "incomplete", "unreadable", "wrong_rate"} <= set(store.counts())
