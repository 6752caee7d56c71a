"""The way of a block from a folder to its netCDF file: which files of the program it enters, and in which order."""

from __future__ import annotations

import sys
import threading
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import numpy as np

from monitor.config.load import load_config
from monitor.records.publish import publish
from monitor.records.store import Store
from monitor.service.ingest import Ingest
from tests.support.daemons import make_machine
from tests.support.waiting import wait_until

ROOT = Path(__file__).parents[2]
FLOORS = ("models/", "streams/", "monitor/")
MAX_FILES = 87
"""Files that the second block of a folder enters, the child that reads it apart; docs/ARCHITECTURE.md says how many."""
MILESTONES = (
    "streams/folder/source.py",
    "streams/files/load.py",
    # The rests of earlier files are looked after while a file is waited for: the cut itself is the milestone.
    "streams/reblock.py block",
    "monitor/health/step.py",
    "monitor/records/filing.py",
    "monitor/records/publish.py",
)


def put(folder: Path, number: int) -> None:
    """Write a block as a table, as a logger does."""
    values = np.random.default_rng(number).standard_normal(256)
    rows = "".join(f"{value:.6f}\n" for value in values)
    (folder / f"b{number:03d}.csv").write_text(rows)


class Way:
    """The files and the functions of the program in the order in which a block enters them first."""

    def __init__(self) -> None:
        self.files: list[str] = []
        self.entered: list[str] = []
        self._seen: set[CodeType] = set()

    def trace(self, frame: FrameType, event: str, argument: Any) -> None:
        code = frame.f_code
        if event != "call" or code in self._seen:
            return
        self._seen.add(code)
        path = Path(code.co_filename)
        if path.is_relative_to(ROOT) and (place := path.relative_to(ROOT).as_posix()).startswith(FLOORS):
            if place not in self.files:
                self.files.append(place)
                self.entered.append(place)
            self.entered.append(f"{place} {code.co_name}")

    def __enter__(self) -> Way:
        threading.setprofile(self.trace)
        sys.setprofile(self.trace)
        return self

    def __exit__(self, *error: object) -> None:
        sys.setprofile(None)
        threading.setprofile(None)


def test_the_files_that_a_block_enters(tmp_path: Path) -> None:
    config = load_config(make_machine(tmp_path))
    folder = Path((config.source[0].url or "").removeprefix("folder:"))
    records = config.machine.records_dir
    config.machine.state_dir.mkdir(parents=True, exist_ok=True)
    with (
        Store.open(config.machine.state_dir / "state.db", machine=config.machine.name) as store,
        Ingest.open(config, store) as ingest,
    ):
        stop = threading.Event()
        put(folder, 1)
        wait_until(lambda: ingest.step(stop) is not None)
        publish(store, records)
        put(folder, 2)
        with Way() as way:
            wait_until(lambda: ingest.step(stop) is not None)
            publish(store, records)
        assert [record.status for record in store.records()] == ["ok", "ok"]
    assert [place for place in way.entered if place in MILESTONES] == list(MILESTONES)
    assert len(way.files) <= MAX_FILES, "\n".join(way.files)
