"""A process that reads a watched folder is killed at any moment: every file is in the ledger, once."""

from __future__ import annotations

import random
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from monitor.config.load import Config, validate
from monitor.records.ledger import StoreLedger
from monitor.records.store import Store
from monitor.service.ingest import Ingest
from tests.streams.folders import csv_bytes, noise
from tests.support.effort import effort_count
from tests.support.forks import Fork, Messages
from tests.support.waiting import Stall

pytestmark = pytest.mark.process

KILLS = effort_count(quick=3, full=200)
FILES_A_KILL = 12
_RATE = 2560


def ingest_for_ever(messages: Messages, folder: Path, database: Path) -> None:
    """Ingest the files of a folder, and send the number of each block that is committed."""
    with Store.open(database, machine="m") as store, Ingest.open(config(str(folder)), store) as ingest:
        messages.send("open")
        ingest.run(threading.Event(), lambda record: messages.send(record.sequence))


def config(folder: str) -> Config:
    return validate(
        {
            "machine": {"name": "m"},
            "bearing": [{"name": "b", "designation": "1205 ETN9"}],
            "operating": {"speed_hz": 40.0},
            "source": [
                {
                    "name": "s",
                    "url": f"folder:{folder}",
                    "rate_hz": _RATE,
                    "settle_s": 0.2,
                    "block_s": 0.1,
                    "format": "csv",
                }
            ],
            "channel": [
                {"name": "x", "source": "s", "column": 1, "unit": "g", "bearing": "b", "band_hz": [[300, 1200]]}
            ],
        },
        Path("machine.toml"),
    )


def drain(folder: Path, database: Path) -> None:
    """Run until nothing waits any more."""
    stop = threading.Event()
    with Store.open(database, machine="m") as store, Ingest.open(config(str(folder)), store) as ingest:
        stall = Stall(lambda: ingest.backlogs()["s"].accepted)
        quiet = 0
        while quiet < 3:
            stall.check()
            quiet = 0 if ingest.step(stop) or ingest.backlogs()["s"].pending else quiet + 1
        backlog = ingest.backlogs()["s"]
        assert backlog.offered == backlog.accepted + backlog.rejected + backlog.pending
        assert backlog.pending == 0
        assert ingest.problems() == {}


def write(folder: Path, number: int, generator: random.Random) -> int:
    """Write a file of two or three blocks in one of the ways in which loggers do; return the number of its blocks."""
    count = generator.choice([2, 3])
    data = csv_bytes(noise(256 * count, number))
    path = folder / f"f{number:05d}.csv"
    way = generator.randrange(3)
    if way == 0:
        path.write_bytes(data)
    elif way == 1:
        temporary = folder / f"{path.name}.tmp"
        temporary.write_bytes(data)
        temporary.rename(path)
    else:
        with path.open("wb") as file:
            file.write(data[: len(data) // 2])
            file.flush()
            time.sleep(0.01)
            file.write(data[len(data) // 2 :])
    return count


@pytest.mark.timeout(effort_count(quick=900, full=3600))
def test_every_file_is_in_the_ledger_once_however_often_the_reader_is_killed(tmp_path: Path) -> None:
    generator = random.Random(20251121)
    folder, database = tmp_path / "in", tmp_path / "state.db"
    folder.mkdir()
    number = blocks = committed = 0
    for kill in range(KILLS):
        child = Fork(ingest_for_ever, folder, database)
        messages: list[Any] = []
        if generator.random() < 0.8:
            messages.append(child.receive())
        for _ in range(FILES_A_KILL):
            number += 1
            blocks += write(folder, number, generator)
        time.sleep(generator.uniform(0.0, 1.2))
        # On a busy machine none may have come as far as a commit; the last one does.
        while kill == KILLS - 1 and messages[-1:] in ([], ["open"]):
            messages.append(child.receive())
        messages += child.kill()
        committed = max([committed, *(number for number in messages if number != "open")])
    drain(folder, database)
    with Store.open(database, machine="m") as store, StoreLedger(store) as ledger:
        assert store.check() == []
        records = list(store.records())
        assert [record.sequence for record in records] == list(range(1, len(records) + 1))
        assert committed > 0
        assert len(records) == blocks
        assert all(record.accepted for record in records)
        hashes = [record.content_hash for record in records]
        assert len(set(hashes)) == len(hashes)
        assert store.counts().keys().isdisjoint({"duplicate", "changed"})
        assert ledger.file_counts("s") == {"accepted": number}


def test_the_samples_behind_the_records_are_those_of_the_files(tmp_path: Path) -> None:
    folder = tmp_path / "in"
    folder.mkdir()
    samples = noise(256 * 4, 7)
    (folder / "a.csv").write_bytes(csv_bytes(samples))
    drain(folder, tmp_path / "state.db")
    with Store.open(tmp_path / "state.db", machine="m") as store:
        found = [record.channels["x"]["rms"] for record in store.records()]
    expected = [9.80665 * float(np.std(samples[k * 256 : (k + 1) * 256])) for k in range(4)]
    np.testing.assert_allclose(found, expected, rtol=1e-6)
