"""Senders with the key whose frames are whole and lie: pulses, clocks and channels that cannot be.

Each block has its place in the store, the next good one is committed soon after it, and memory stays.
"""

from __future__ import annotations

import threading
import time
import tracemalloc
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from google_crc32c import value as crc32c
from numpy.typing import NDArray

from monitor.config.load import validate
from monitor.records.store import Store
from monitor.service.ingest import Ingest
from streams.link.sender import TcpLink
from streams.link.tcp import TcpReceiver
from streams.link.wire import HEAD, PULSES, UNDATED, block_frame, encode_frame
from streams.types.block import Block
from streams.types.spec import MAX_FRAME, parse_address
from tests.support.waiting import PATIENCE_S, wait_until

RATE, SAMPLES = 2560.0, 2560
GOES_ON_S = 5.0
MOST = (MAX_FRAME - 128) // 8


def block(number: int, channels: int = 1, start: float | None = None, rate: float = RATE) -> Block:
    samples = np.random.default_rng(number).standard_normal((channels, SAMPLES)).astype(np.float32)
    names = ("x", "y", "z")[:channels]
    start = 1.7e9 + number if start is None else start
    return Block(samples, rate, names, ("g",) * channels, "s", number, str(number), start=start)


def pulse_frame(number: int, times: NDArray[Any], header: bytes = b'{"pulses_per_revolution":4}') -> bytes:
    """Return a frame of any times, with a right checksum."""
    head = HEAD.pack(b"SPW1", PULSES, 1, number, RATE, times.size, 4, UNDATED, len(header))
    body = head + header + np.ascontiguousarray(times, dtype="<f8").tobytes()
    return body + crc32c(body).to_bytes(4, "little")


def frames(number: int, times: NDArray[Any] | None = None, **more: Any) -> bytes:
    """Return the frames of a block."""
    made = block_frame(block(number, **more))
    if times is None:
        return encode_frame(made)
    return pulse_frame(number, times) + encode_frame(replace(made, pulses=times.size))


@contextmanager
def monitored(folder: Path, **operating: Any) -> Iterator[tuple[TcpLink, Store, Ingest]]:
    """Give a connection to a receiver, and the store into which its blocks are committed."""
    stop, ready = threading.Event(), threading.Event()
    found: list[tuple[Store, Ingest]] = []
    config = validate(
        {
            "machine": {"name": "m"},
            "bearing": [{"name": "b", "designation": "1205 ETN9"}],
            "operating": operating or {"speed_hz": 40.0},
            "source": [{"name": "s", "url": "tcp://127.0.0.1:0"}],
            "channel": [{"name": "x", "source": "s", "unit": "g", "bearing": "b", "band_hz": [[300, 1200]]}],
        },
        folder / "machine.toml",
    )

    def work() -> None:
        with Store.open(folder / "state.db", machine="m") as store, Ingest.open(config, store) as ingest:
            found.append((store, ingest))
            ready.set()
            ingest.run(stop)

    thread = threading.Thread(target=work)
    thread.start()
    assert ready.wait(PATIENCE_S)
    store, ingest = found[0]
    receiver = ingest.sources[0]
    assert isinstance(receiver, TcpReceiver)
    link = TcpLink(parse_address(f"tcp://127.0.0.1:{receiver.port}", "test"), "s", PATIENCE_S)
    try:
        link.connect()
        yield link, store, ingest
        assert thread.is_alive()
    finally:
        link.close()
        stop.set()
        thread.join()


def send(link: TcpLink, data: bytes, number: int) -> None:
    """Send the frames of a block, and wait for its commit."""
    link.send(data)
    wait_until(lambda: (link.committed(1.0) or 0) >= number)


def spread(count: int) -> NDArray[np.float64]:
    return np.linspace(0.0, (SAMPLES - 1) / RATE, count)


TURNS = spread(161)
HOSTILE: dict[str, NDArray[Any]] = {
    "none": np.empty(0),
    "one": np.array([0.5]),
    "two at once": np.array([0.5, 0.5]),
    "all at once": np.full(20_000, 0.25),
    "doubled": np.repeat(TURNS, 2),
    "within a nanosecond": 0.5 + 1e-12 * np.arange(1000),
    "denormal": 5e-324 * np.arange(1000),
    "falling": TURNS[::-1],
    "not a number": np.where(np.arange(161) == 80, np.nan, TURNS),
    "infinite": np.append(TURNS, np.inf),
    "before the block": TURNS - 1e6,
    "huge": 1e300 * (1.0 + TURNS),
    "bursts": np.sort(np.concatenate([TURNS, *(TURNS + 1e-7 * k for k in range(1, 9))]))[:-9],
    "a burst of denormals": np.append(5e-324 * np.arange(300), TURNS[1:]),
    "bursts of picoseconds": np.sort(np.concatenate([TURNS[:-1] + 1e-12 * k for k in range(20)])),
    "many too many": np.sort(np.append(spread(MOST // 4), 0.1 * spread(MOST // 4) + 1e-7)),
    "many missing": spread(MOST)[np.arange(MOST) % 5 > 0],
    "many moved": spread(MOST // 2) + np.where(np.arange(MOST // 2) % 6 == 3, 0.4, 0.0) / (MOST // 2),
    "regular, then not": np.append(
        0.5 * spread(MOST // 2), np.sort(np.random.default_rng(1).uniform(0.5, 0.99, MOST // 3))
    ),
    "as many as samples": spread(SAMPLES),
    "as many as a frame holds": spread(MOST),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_block_with_any_pulses_has_its_place_and_the_next_one_its_speed(tmp_path: Path, name: str) -> None:
    with monitored(tmp_path, pulses_per_revolution=4) as (link, _, ingest):
        for number in (1, 2):
            send(link, frames(number, TURNS), number)
        begin = time.monotonic()
        send(link, frames(3, HOSTILE[name]), 3)
        send(link, frames(4, TURNS), 4)
        assert time.monotonic() - begin < GOES_ON_S
        assert "store" not in ingest.problems()
    with Store.open(tmp_path / "state.db", read_only=True) as store:
        assert store.check() == []
        records = {number: store.record("s", number) for number in (1, 2, 3, 4)}
    for number in (1, 2, 4):
        found = records[number]
        assert found is not None
        assert found.channels["x"]["speed"] == pytest.approx(40.0, rel=1e-3)


def test_channels_that_change_amid_a_stream_are_taken_or_refused_each_for_itself(tmp_path: Path) -> None:
    other = replace(block(5), channels=("y",))
    hostile = {
        2: frames(2, channels=3),
        3: frames(3, rate=1.0),
        4: frames(4, rate=1e8),
        5: encode_frame(block_frame(other)),
        6: encode_frame(replace(block_frame(block(6)), scale=(1e300,))),
        7: encode_frame(block_frame(replace(block(7), samples=np.zeros((1, 1), dtype=np.float32)))),
        8: encode_frame(block_frame(replace(block(8), samples=np.full((1, 300), np.nan, dtype=np.float32)))),
    }
    with monitored(tmp_path) as (link, _, ingest):
        send(link, frames(1), 1)
        for number, data in hostile.items():
            send(link, data, number)
            assert "store" not in ingest.problems()
        send(link, frames(9), 9)
    with Store.open(tmp_path / "state.db", read_only=True) as store:
        assert store.check() == []
        records = [store.record("s", number) for number in range(1, 10)]
    assert all(record is not None for record in records)
    found = [record.status for record in records if record is not None]
    assert (found[0], found[1], found[8]) == ("ok", "ok", "ok")
    assert all(status != "ok" for status in found[3:8])


def test_clocks_that_jump_give_each_block_its_place_and_stop_nothing(tmp_path: Path) -> None:
    starts = (1.7e9, 4.1e9, 0.0, -2.2e9, 1.7e9, 1.7e9, 1.7e9 - 3600.0, 1.7e9 + 1e-9, 4.1e9, 1.7e9 + 10.0)
    with monitored(tmp_path) as (link, _, ingest):
        for number, start in enumerate(starts, start=1):
            send(link, frames(number, start=start), number)
            assert "store" not in ingest.problems()
        undated = len(starts) + 1
        send(link, encode_frame(replace(block_frame(block(undated)), start=None)), undated)
        send(link, frames(undated + 1), undated + 1)
    with Store.open(tmp_path / "state.db", read_only=True) as store:
        assert store.check() == []
        records = [store.record("s", number) for number in range(1, undated + 2)]
    assert all(record is not None for record in records)


def test_pulses_whose_samples_never_come_take_no_memory(tmp_path: Path) -> None:
    times = spread(1 << 18)
    with monitored(tmp_path, pulses_per_revolution=4) as (link, _, ingest):
        tracemalloc.start()
        try:
            for number in range(1, 61):
                link.send(pulse_frame(number, times))
            send(link, frames(61, TURNS), 61)
            assert tracemalloc.get_traced_memory()[1] < 4 * MAX_FRAME
        finally:
            tracemalloc.stop()
        assert "store" not in ingest.problems()
