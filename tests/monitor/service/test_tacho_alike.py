"""A machine with a tacho: live, restarted at any block and replayed give the same records, bit for bit."""

from __future__ import annotations

import threading
import time
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from monitor.config.load import Config, validate
from monitor.health.record import Record
from monitor.records.store import Store
from monitor.service.ingest import Ingest
from monitor.service.replay import replay
from monitor.service.setup import open_configured
from streams.link.pulse_frame import block_frames
from streams.link.sender import TcpLink
from streams.link.tcp import TcpReceiver
from streams.types.block import Block
from streams.types.spec import parse_address
from tests.support.waiting import PATIENCE_S

RATE = 2048
COUNT = 1088
"""Samples of a file; a block has 256. Files begin at whole thirty-seconds of a second, which every clock can state."""
FILES = 6
MARKS = 4
T0 = 1_700_000_000
CONFIG = """
[machine]
name = "m"
state_dir = "state"
[[bearing]]
name = "test"
designation = "6205"
[operating]
pulses_per_revolution = 4
{operating}
[detect]
learn_blocks = 10
run_in_blocks = 0
persist_blocks = 2
[[source]]
name = "s"
url = "{url}"
rate_hz = 2048
{source}
[[channel]]
name = "de"
source = "s"
column = "de"
unit = "g"
bearing = "test"
band_hz = [[300, 700]]
"""
WAYS = {
    "pulses": ("", 'block_s = 0.125\npulses = "{stem}.pulses"'),
    "channel": ('tacho_channel = "tacho"', "block_s = 0.125"),
    "turns": ('tacho_channel = "tacho"', "block_s = 0.25\nblock_revolutions = 4"),
}
"""Keys of [operating] and of a source of files."""
LIVE = {"pulses": 25, "turns": 20}
"""Blocks that a folder gives: those after them wait for more."""


def machine(way: str, url: str) -> Config:
    operating, source = WAYS[way]
    source = "block_s = 0.125" if url.startswith("tcp") else f'format = "csv"\nsettle_s = 0.0\n{source}'
    text = CONFIG.format(operating=operating, source=source, url=url)
    return validate(tomllib.loads(text), Path("config.toml"))


def turns(time: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the revolutions of a shaft that hunts by ±10 % around a speed that rises."""
    return 24.0 * time + time**2 + 0.8 * np.sin(2.0 * np.pi * 0.5 * time)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recorded")
    total = FILES * COUNT
    clock = np.arange(total) / RATE
    angle = turns(clock)
    noise = np.random.default_rng(5).normal(size=total)
    acc = noise + np.sin(2 * np.pi * 500.0 * clock) * (1.0 + np.cos(2 * np.pi * 3.58 * angle))
    tacho = (angle * MARKS) % 1.0 < 0.4
    fine = np.linspace(0.0, total / RATE, 40 * total)
    marks = np.interp(np.arange(1, int(turns(fine)[-1] * MARKS)) / MARKS, turns(fine), fine)
    # One mark is missing, and one came twice.
    marks = np.sort(np.append(np.delete(marks, 100), marks[200] + 1e-4))
    for number in range(FILES):
        begin = number * COUNT
        rows = zip(acc[begin : begin + COUNT], tacho[begin : begin + COUNT], strict=True)
        stamp = time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(T0 + begin // RATE))
        text = f"Start: {stamp}.{round((begin % RATE) / RATE * 1e9):09d}Z\nde,tacho\n"
        (folder / f"f{number:02d}.csv").write_text(text + "".join(f"{a:.4f},{on:d}\n" for a, on in rows))
        own = marks[(marks >= begin / RATE) & (marks < (begin + COUNT) / RATE)] - begin / RATE
        (folder / f"f{number:02d}.pulses").write_text("pulses\n" + "".join(f"{mark:.8f}\n" for mark in own))
    return folder


def records(store: Path) -> list[Record]:
    with Store.open(store, read_only=True) as found:
        return list(found.records())


def ingested(config: Config, path: Path, count: int) -> None:
    """Take so many blocks live; those that are delivered but not committed are lost, as by a kill."""
    stop, deadline = threading.Event(), time.monotonic() + PATIENCE_S
    with Store.open(path, machine="m") as store, Ingest.open(config, store) as ingest:
        while count and time.monotonic() < deadline:
            count -= ingest.step(stop) is not None
    assert count == 0


@pytest.fixture(scope="module")
def replayed(recorded: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[Record]]:
    found = {}
    for way in WAYS:
        made = replay(machine(way, f"folder:{recorded}"), None, tmp_path_factory.mktemp("replayed"))
        found[way] = records(made.store_path)
    return found


@pytest.mark.parametrize("way", WAYS)
def test_the_tacho_is_in_the_records(way: str, replayed: dict[str, list[Record]]) -> None:
    whole = [record for record in replayed[way] if record.accepted]
    for record in whole:
        values = record.channels["de"]
        assert (values["rotation_status"], values["domain"], values["speed_source"]) == ("ok", "order", "tacho")
    revolutions = [record.channels["de"]["revolutions"] for record in whole]
    assert bool(np.ptp(revolutions[1:-1]) < 0.3) == (way == "turns")
    repairs = sum(record.channels["de"]["pulses_missing"] + record.channels["de"]["pulses_extra"] for record in whole)
    assert repairs == (2 if way == "pulses" else 0)


@pytest.mark.parametrize("way", LIVE)
def test_a_folder_that_was_restarted_gives_the_records_of_a_replay(
    way: str, recorded: Path, replayed: dict[str, list[Record]], tmp_path: Path
) -> None:
    config = machine(way, f"folder:{recorded}")
    for count in (3, LIVE[way] - 3):
        ingested(config, tmp_path / "state.db", count)
    assert records(tmp_path / "state.db") == replayed[way][: LIVE[way]]


def received(way: str, blocks: list[Block], path: Path, *, breaks: bool) -> list[Record]:
    """Send blocks over TCP; where it ``breaks``, the receiver begins anew between pulses and samples of a block."""
    config = machine(way, "tcp://127.0.0.1:0")
    for count in (7, len(blocks) - 7) if breaks else (len(blocks),):
        stop, deadline = threading.Event(), time.monotonic() + PATIENCE_S
        with Store.open(path, machine="m") as store, Ingest.open(config, store) as ingest:
            receiver = ingest.sources[0]
            assert isinstance(receiver, TcpReceiver)
            place = parse_address(f"tcp://127.0.0.1:{receiver.port}", "test")
            link = TcpLink(place, "s", PATIENCE_S)
            done = link.connect()
            frames = [frame for block in blocks[done:] for frame in block_frames(block, after=block.sequence - 1)]
            each = len(block_frames(blocks[0]))
            for frame in frames if count + done == len(blocks) else frames[: each * count + 1]:
                link.send(frame)
            while count and time.monotonic() < deadline:
                count -= ingest.step(stop) is not None
            link.close()
        assert count == 0
    return records(path)


@pytest.mark.parametrize("way", ["pulses", "channel"])
def test_a_stream_that_was_broken_gives_the_records_of_a_whole_one_and_of_a_replay(
    way: str, recorded: Path, replayed: dict[str, list[Record]], tmp_path: Path
) -> None:
    config = machine(way, f"folder:{recorded}")
    blocks = [item for item in open_configured(config, config.source[0]) if isinstance(item, Block)]
    whole = received(way, blocks, tmp_path / "whole.db", breaks=False)
    assert received(way, blocks, tmp_path / "broken.db", breaks=True) == whole
    # What is streamed has the name of its stream.
    expected = [replace(record, name=f"s[{record.sequence}]") for record in replayed[way] if record.accepted]
    assert whole == expected
