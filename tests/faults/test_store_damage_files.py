"""Files whose rows a damaged store has lost are read again, each once."""

from __future__ import annotations

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
