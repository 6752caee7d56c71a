"""``archive-days`` is killed at any moment: each day is whole in one folder at least, and the register says which."""

from __future__ import annotations

import random
import shutil
import time
from dataclasses import replace
from datetime import date
from pathlib import Path

import pytest
import xarray as xr

from monitor.records.publish import publish
from monitor.records.published_folder import days_before, move_day, moved_days
from monitor.records.store import Store
from tests.support.effort import effort_count
from tests.support.forks import Fork
from tests.support.store_kill import block
from tests.support.victims import move_days

pytestmark = pytest.mark.process

KILLS = effort_count(quick=8, full=200)
DAYS, BLOCKS_A_DAY = 10, 4
DAY_S = 86400.0
BEFORE = date(2023, 11, 23)
"""Nine of the ten days are before it."""


@pytest.mark.timeout(effort_count(quick=900, full=3600))
def test_each_day_is_there_through_kills_while_days_are_moved(tmp_path: Path) -> None:
    generator = random.Random(20261124)
    database, records_dir, away = tmp_path / "state.db", tmp_path / "records", tmp_path / "away"
    with Store.open(database, machine="m") as store:
        for number in range(1, DAYS * BLOCKS_A_DAY + 1):
            store.commit(replace(block(number), time=1.7e9 + (number - 1) // BLOCKS_A_DAY * DAY_S + number), {})
        assert len(publish(store, records_dir)) == DAYS
        content = {path.name: path.read_bytes() for path in records_dir.glob("*.nc")}
        old = {path.name for path in days_before(records_dir, "m", BEFORE)}
        assert len(old) == DAYS - 1
        longest, amid = 0.0, 0
        for kill in range(KILLS):
            begun = Fork(move_days, records_dir, away, database, BEFORE)
            assert begun.receive() == "begins"
            time.sleep(generator.uniform(0.0, longest))
            begun.kill()
            left = {path.name for path in records_dir.glob("*.nc")}
            amid += 0 < len(old & left) < len(old)
            assert_whole(content, records_dir, away)
            since = time.perf_counter()
            for path in days_before(records_dir, "m", BEFORE):
                move_day(path, "m", away, database, time.time())
            # Half of the days are left on the average: the next kill meets any of them.
            longest = max(longest, min(2.0, time.perf_counter() - since))
            assert {path.name for path in away.iterdir() if path.suffix == ".nc"} == old
            assert_whole(content, records_dir, away)
            # What was moved is not published again.
            assert publish(store, records_dir) == []
            if kill < KILLS - 1:
                shutil.rmtree(away)
                for name in old:
                    (records_dir / name).write_bytes(content[name])
                (records_dir / "m-moved.json").unlink()
    assert amid > 0
    assert blocks_in(records_dir, away) == list(range(1, DAYS * BLOCKS_A_DAY + 1))


def assert_whole(content: dict[str, bytes], records_dir: Path, away: Path) -> None:
    """Assert that each day is where it was, or in the register and at the place that this names."""
    moved = {entry.file: entry for entry in moved_days(records_dir, "m")}
    for name, data in content.items():
        if (records_dir / name).exists():
            assert (records_dir / name).read_bytes() == data
        else:
            assert moved[name].to == str(away.resolve())
            assert (away / name).read_bytes() == data


def blocks_in(*folders: Path) -> list[int]:
    """Return the numbers of the blocks in all published files of the folders, in order."""
    found: list[int] = []
    for folder in folders:
        for path in folder.glob("*.nc"):
            with xr.open_dataset(path) as dataset:
                found += dataset.sequence.values.tolist()
    return sorted(found)
