"""A process that reads a watched folder is killed at any moment: every file is in the ledger, once."""

from __future__ import annotations

import random
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from monitor.records.ledger import StoreLedger
from monitor.records.store import Store
from monitor.service.ingest import Ingest
from tests.streams.folders import csv_bytes, noise
from tests.support.effort import effort_count
from tests.support.folder_kill import config, drain, write
from tests.support.forks import Fork, Messages

pytestmark = pytest.mark.process

KILLS = effort_count(quick=3, full=200)
FILES_A_KILL = 12


def ingest_for_ever(messages: Messages, folder: Path, database: Path) -> None:
    """Ingest the files of a folder, and send the number of each block that is committed."""
    with Store.open(database, machine="m") as store, Ingest.open(config(str(folder)), store) as ingest:
        messages.send("open")
        ingest.run(threading.Event(), lambda record: messages.send(record.sequence))


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
