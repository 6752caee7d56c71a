"""The rollup in the store: buckets join at will, older stores catch up, kills lose nothing and count nothing twice."""

from __future__ import annotations

import os
import random
import signal
import sqlite3
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.records import rollup, trends
from monitor.records.recover.salvage import open_or_salvage
from monitor.records.rollup import FEATURES, Buckets, Points, joined
from monitor.records.store import Store
from tests.oracles.trends_oracle import said_of
from tests.support.effort import effort_count
from tests.support.trends import MOMENTS, assert_is, block, filled, query, rolled_up

ROOT = Path(__file__).parents[3]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path


@given(
    time=st.lists(MOMENTS, min_size=1, max_size=30),
    data=st.data(),
    cut=st.integers(0, 30),
    factor=st.integers(1, 12),
)
@settings(max_examples=effort_count(quick=24, full=2000))
def test_buckets_can_be_cut_joined_and_written_at_will(
    time: list[float], data: st.DataObject, cut: int, factor: int
) -> None:
    size = len(time)
    cells = st.floats(allow_infinity=False)
    drawn = data.draw(st.lists(st.lists(cells, min_size=3, max_size=3), min_size=size, max_size=size))
    values = np.full((size, len(FEATURES)), np.nan)
    values[:, [0, 5, 20]] = drawn
    status = np.array(data.draw(st.lists(st.integers(0, 20), min_size=size, max_size=size)), dtype=np.int64)
    points = Points(np.array(time), values, status, np.arange(size))
    series = np.array(data.draw(st.lists(st.integers(1, 3), min_size=size, max_size=size)), dtype=np.int64)

    def buckets(width: float) -> Buckets:
        found = Buckets.of_points(points, width)
        return Buckets(series, found.index, found.low, found.high, found.counts)

    whole = joined([buckets(60.0)])
    before = np.arange(size) < cut
    for one, other in (
        (whole, joined([buckets(60.0).where(before), joined([buckets(60.0).where(~before)])])),
        (whole, Buckets.of_rows(list(whole.to_rows()))),
        (joined([whole], factor), joined([buckets(60.0 * factor)])),
    ):
        for name in ("series", "index", "low", "high", "counts"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def as_version_2(folder: Path) -> None:
    """Take from a store what its older version did not have, and put the cache beside it that it had."""
    with closing(sqlite3.connect(folder / "state.db", isolation_level=None)) as connection:
        connection.execute("DROP TABLE rollup")
        connection.execute("DROP INDEX blocks_by_time")
        connection.execute("DELETE FROM meta WHERE key LIKE 'roll%'")
        connection.execute("UPDATE meta SET value = '2' WHERE key = 'schema_version'")
    (folder / "trends.db").write_bytes(b"a cache")


def test_a_store_of_the_version_before_is_read_and_migrated(folder: Path) -> None:
    made = [block(number, 5.0 * number) for number in range(1, 1001)]
    with filled(folder, made) as store:
        said = said_of(store, "s", "x", True)
    as_version_2(folder)
    for points in (45, 100):
        assert_is(query(folder, "s", "x", 1.0, 5000.0, points), said, 1.0, 5000.0)
    whole = query(folder, "s", "x", 1.0, 5000.0, 45)
    with patch.object(trends, "_MAX_RECORDS", 300):
        # Too many to be read at once, and no daemon ever rolls them up: each fourth stands for the others.
        table = query(folder, "s", "x", 1.0, 5000.0, 45)
    assert (whole.complete, table.complete) == (True, False)
    assert table.time.tolist() == whole.time.tolist()
    assert table.records.sum() == 250
    assert np.all(table.high["rms"] <= whole.high["rms"])
    with Store.open(folder / "state.db", machine="m") as store:
        assert store.meta()["schema_version"] == "4"
        assert rolled_up(folder) > 936
        for points in (45, 100):
            assert_is(query(folder, "s", "x", 1.0, 5000.0, points), said, 1.0, 5000.0)
    assert not (folder / "trends.db").exists()


def test_a_large_store_catches_up_with_each_commit(folder: Path) -> None:
    filled(folder, [block(number, 5.0 * number) for number in range(1, 2001)]).close()
    as_version_2(folder)
    with (
        patch.object(rollup.roll_up, "__defaults__", (0.0,)),
        patch("monitor.records.store.OPEN_BUDGET_S", 0.0),
        Store.open(folder / "state.db", machine="m") as store,
    ):
        assert rolled_up(folder) == 256
        seen = [rolled_up(folder)]
        for number in range(2001, 2009):
            store.commit(block(number, 5.0 * number), {})
            seen.append(rolled_up(folder))
            said = said_of(store, "s", "x", True)
            assert_is(query(folder, "s", "x", 1.0, 5.0 * number, 100), said, 1.0, 5.0 * number)
        assert seen == sorted(seen)
        assert seen[-1] > 1940


def test_the_rollup_of_other_features_is_built_anew(folder: Path) -> None:
    made = [block(number, 5.0 * number) for number in range(1, 500)]
    filled(folder, made).close()
    with closing(sqlite3.connect(folder / "state.db", isolation_level=None)) as connection:
        connection.execute("UPDATE meta SET value = 'rms peak' WHERE key = 'rollup_features'")
        connection.execute("UPDATE rollup SET extremes = x'0000000000000000'")
    with Store.open(folder / "state.db", machine="m") as store:
        said = said_of(store, "s", "x", True)
        assert_is(query(folder, "s", "x", 1.0, 2400.0, 45), said, 1.0, 2400.0)


def test_a_salvaged_store_has_the_rollup_of_the_records_that_are_left(folder: Path) -> None:
    filled(folder, [block(number, 5.0 * number) for number in range(1, 301)]).close()
    with closing(sqlite3.connect(folder / "state.db", isolation_level=None)) as connection:
        connection.execute("UPDATE records SET row = x'0000000000000000' WHERE block = 150")
        connection.execute("UPDATE rollup SET extremes = x'00'")
    store, report = open_or_salvage(folder / "state.db", machine="m")
    assert report is not None
    assert report.lost == 1
    with store:
        assert rolled_up(folder) > 236
        assert_is(query(folder, "s", "x", 0.0, 1500.0, 20), said_of(store, "s", "x", True), 0.0, 1500.0)


_COMMITTING = """
import sys
from pathlib import Path
from monitor.records import rollup
from monitor.health.record import Record
from monitor.records.store import Store
rollup.BATCH_BLOCKS = 5
times = list(map(float, sys.stdin.readline().split()))
with Store.open(Path(sys.argv[1]) / "state.db", machine="m") as store:
    for number in range(store.last("s") + 1, len(times) + 1):
        values = {"rms": 1.0 + number % 7}
        store.commit(Record("s", number, "b", str(number), time=times[number - 1], channels={"x": values}), {})
        print(number, flush=True)
"""


@pytest.mark.process
def test_kills_lose_nothing_and_count_nothing_twice(folder: Path) -> None:
    draw, count = random.Random(5), effort_count(quick=300, full=20_000)
    moments = [30.0 * number if draw.random() < 0.9 else 15.0 * number for number in range(1, count + 1)]
    for _ in range(effort_count(quick=3, full=60)):
        child = subprocess.Popen(
            [sys.executable, "-c", _COMMITTING, str(folder)],
            cwd=ROOT,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert child.stdin is not None
        assert child.stdout is not None
        child.stdin.write(" ".join(map(str, moments)) + "\n")
        child.stdin.flush()
        for _ in range(draw.randrange(1, 25)):
            child.stdout.readline()
        time.sleep(draw.random() * 0.01)
        os.kill(child.pid, signal.SIGKILL)
        child.wait()
        child.stdin.close()
        child.stdout.close()
    with Store.open(folder / "state.db", machine="m") as store:
        assert 0 < rolled_up(folder) <= store.last("s")
        said = said_of(store, "s", "x", True)
        until = 30.0 * count
        for points in (2, 30, 1000):
            assert_is(query(folder, "s", "x", 0.0, until, points), said, 0.0, until)
