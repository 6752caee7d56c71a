"""Files whose rows a damaged store has lost are read again, each once."""

from __future__ import annotations

import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from monitor.records.ledger import StoreLedger
from monitor.records.recover.salvage import open_or_salvage
from monitor.records.store import Store
from tests.streams.folders import csv_bytes, noise
from tests.support.folder_kill import drain
from tests.support.store_damage import zero

pytestmark = pytest.mark.process


@pytest.mark.parametrize("where", [b"f00003.csv", b"accepted"])
def test_files_that_the_store_no_longer_knows_are_read_again_and_counted_once(tmp_path: Path, where: bytes) -> None:
    folder, path = tmp_path / "in", tmp_path / "state.db"
    folder.mkdir()
    for number in range(1, 7):
        (folder / f"f{number:05d}.csv").write_bytes(csv_bytes(noise(512, number)))
    drain(folder, path)
    with Store.open(path, read_only=True) as store:
        before = list(store.records())
    data = bytearray(path.read_bytes())
    while (place := data.find(where)) > 0:
        zero(data, place, 0)
    path.write_bytes(data)
    store, report = open_or_salvage(path, machine="m")
    store.close()
    assert report is not None
    (folder / "f00007.csv").write_bytes(csv_bytes(noise(512, 7)))
    drain(folder, path)
    with Store.open(path, machine="m") as store, StoreLedger(store) as ledger:
        assert store.check() == []
        found = list(store.records())
        # Those that are gone without a trace come again from their files, as late as they come.
        assert sum(ledger.file_counts("s").values()) == 7
    assert len(before) == 12
    kept = [item.content_hash for item in found]
    assert len(set(kept)) == len(kept) == 14
    assert {item.content_hash for item in before} <= set(kept)


@pytest.mark.parametrize("torn", [b"", bytes(512)], ids=["whole", "torn"])
def test_a_store_that_was_being_made_is_rolled_back_and_not_damaged(tmp_path: Path, torn: bytes) -> None:
    """Its journal is durable before its first page is written."""
    making, path = tmp_path / "making.db", tmp_path / "state.db"
    with closing(sqlite3.connect(making, isolation_level=None)) as connection:
        connection.execute("PRAGMA cache_size = 1")
        connection.execute("BEGIN IMMEDIATE")
        for number in range(200):
            connection.execute(f"CREATE TABLE t{number} (a, b)")
        for suffix in ("", "-journal"):
            shutil.copyfile(f"{making}{suffix}", f"{path}{suffix}")
    path.write_bytes(torn + path.read_bytes()[len(torn) :])
    assert path.stat().st_size > 4096
    store, report = open_or_salvage(path, machine="m")
    with store:
        assert report is None
        assert list(store.records()) == []
    assert not list(tmp_path.glob("*.corrupt-*"))
