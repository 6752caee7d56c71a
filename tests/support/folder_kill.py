"""Makers and checks that tests of folder kill share."""

from __future__ import annotations

import random
import threading
import time
from pathlib import Path

from monitor.config.load import Config, validate
from monitor.records.store import Store
from monitor.service.ingest import Ingest
from tests.streams.folders import csv_bytes, noise
from tests.support.waiting import Stall

_RATE = 2560


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
