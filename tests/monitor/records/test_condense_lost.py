"""A store with condensed blocks is lost or damaged: the published files and what is left give each block once."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from monitor.records.publish import publish
from monitor.records.published_folder import move_day
from monitor.records.recover.salvage import open_or_salvage
from monitor.records.store import Store
from tests.monitor.records.condensed import BEGIN, FIRST_FORECAST, PER_DAY, block, condense_all, trends


def everything(store: Store) -> list[int]:
    numbers = store.rows("SELECT sequence FROM blocks UNION ALL SELECT sequence FROM identities")
    return sorted(number for (number,) in numbers)


def recovered(filled: Store, tmp_path: Path) -> tuple[Store, str]:
    store, report = open_or_salvage(filled.path, machine="m", records_dir=tmp_path / "records")
    assert report is not None
    return store, report.text


@pytest.mark.process
def test_a_lost_store_with_condensed_blocks_comes_back_from_the_files_with_each_block_once(
    filled: Store, tmp_path: Path
) -> None:
    condense_all(filled)
    filled.commit(block(9999, BEGIN + 5.0), {})
    publish(filled, tmp_path / "records")
    filled.close()
    filled.path.unlink()
    store, _ = recovered(filled, tmp_path)
    with store:
        assert everything(store) == [*range(1, 4 * PER_DAY + 1), 9999]
        assert len(list(store.forecasts())) == 4 * PER_DAY - FIRST_FORECAST + 1
        assert publish(store, tmp_path / "records") == []
        assert list((tmp_path / "records").glob("*.lost-*")) == []
        condense_all(store)
        assert everything(store) == [*range(1, 4 * PER_DAY + 1), 9999]


@pytest.mark.process
def test_a_lost_store_comes_back_with_the_moved_days_that_are_reached_and_names_the_others(
    filled: Store, tmp_path: Path
) -> None:
    condense_all(filled)
    filled.close()
    for day in (15, 16, 17):
        move_day(tmp_path / "records" / f"m-202311{day}.nc", "m", tmp_path / "away", filled.path, 0.0)
    filled.path.unlink()
    (tmp_path / "away" / "m-20231115.nc").unlink()
    with (tmp_path / "away" / "m-20231116.nc").open("ab") as file:
        file.write(b"changed since")
    store, text = recovered(filled, tmp_path)
    with store:
        assert everything(store) == list(range(2 * PER_DAY + 1, 4 * PER_DAY + 1))
        # The moved day that was read is not published again.
        assert publish(store, tmp_path / "records") == []
    said = "2 published days (m-20231115 to m-20231116) are not in this folder: 2 were moved to away"
    assert f"{said}; they were not read" in text


@pytest.mark.process
def test_a_store_of_which_all_days_were_moved_comes_back_whole(filled: Store, tmp_path: Path) -> None:
    condense_all(filled)
    filled.close()
    for path in sorted((tmp_path / "records").glob("m-2*.nc")):
        move_day(path, "m", tmp_path / "away", filled.path, 0.0)
    filled.path.unlink()
    store, text = recovered(filled, tmp_path)
    with store:
        assert everything(store) == list(range(1, 4 * PER_DAY + 1))
        assert publish(store, tmp_path / "records") == []
    assert "not in this folder" not in text


@pytest.mark.process
def test_a_damaged_store_takes_the_blocks_that_it_lacks_from_moved_days(filled: Store, tmp_path: Path) -> None:
    filled.close()
    move_day(tmp_path / "records" / "m-20231115.nc", "m", tmp_path / "away", filled.path, 0.0)
    size = filled.path.stat().st_size
    with filled.path.open("r+b") as file:
        file.truncate(size // 2)
    store, text = recovered(filled, tmp_path)
    with store:
        assert everything(store) == list(range(1, 4 * PER_DAY + 1)), text
        assert len(list(store.records())) == 4 * PER_DAY


@pytest.mark.process
def test_a_damaged_store_keeps_its_condensed_blocks_and_their_trends(filled: Store, tmp_path: Path) -> None:
    condense_all(filled)
    before = trends(filled, points=50)
    with filled.transaction() as connection:
        connection.execute("INSERT INTO spectra VALUES ('s', 'x', 7, 1.0, 1, '{}', x'', NULL)")
    (root,) = filled.rows("SELECT rootpage FROM sqlite_master WHERE name = 'digests'")[0]
    filled.close()
    with filled.path.open("r+b") as file:
        file.seek(4096 * (root - 1))
        file.write(b"\xff" * 4096)
    store, text = recovered(filled, tmp_path)
    with store:
        assert everything(store) == list(range(1, 4 * PER_DAY + 1)), text
        assert store.counts() == {"ok": 4 * PER_DAY}
        assert store.commit(block(7), {}) == "duplicate"
        assert store.rows("SELECT sequence FROM spectra") == [(7,)]
        after = trends(store, points=50)
    assert np.array_equal(before.records, after.records)
    assert np.array_equal(before.low["rms"], after.low["rms"])
