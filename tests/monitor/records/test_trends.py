"""Trends: extremes equal those over all records, none missing and none counted twice, whatever happened on the way."""

from __future__ import annotations

import os
import random
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.health.record import Record
from monitor.health.schema import FLAGS, VARIABLES
from monitor.records.packing import columns_of, numbers_of, pack, places_of, unpack
from monitor.records.store import Store, StoreError
from monitor.records.trend_levels import Buckets
from monitor.records.trends import FEATURES, Trends, TrendTable
from tests.effort import effort_count
from tests.oracles.records_oracle import records
from tests.oracles.trends_oracle import Said, extremes, said_of, stretches

ROOT = Path(__file__).parents[3]
DAY = 86400.0


def block(sequence: int, time: float | None, source: str = "s", **more: Any) -> Record:
    values = {"rms": 1.0 + sequence % 7, "speed": 40.0, "quality_status": more.pop("quality", "ok")}
    base = {"channels": {"x": values}, "name": f"b{sequence}", "content_hash": f"{sequence}"}
    return Record(**(base | {"source": source, "sequence": sequence, "time": time} | more))


def assert_is(table: TrendTable, said: Sequence[Said], since: float, until: float) -> None:
    """Compare a table with the records of a range of time."""
    if table.resolution is None:
        expected = [(item.time, [item]) for item in said if since <= item.time <= until]
        assert table.blocks is not None
        assert table.blocks.tolist() == [group[0].block for _, group in expected]
    else:
        length = table.resolution
        # A stretch shorter than the finest level is made of the records of the range, longer ones are whole.
        inside = [item for item in said if length >= 60 or since <= item.time <= until]
        first, last = since // length, until // length
        expected = [(begin, group) for begin, group in stretches(inside, length) if first <= begin // length <= last]
    assert table.time.tolist() == [begin for begin, _ in expected]
    assert table.records.tolist() == [len(group) for _, group in expected]
    for feature in FEATURES:
        pairs = np.array([extremes(group, feature) for _, group in expected]).reshape(-1, 2)
        np.testing.assert_array_equal(table.low[feature], pairs[:, 0])
        np.testing.assert_array_equal(table.high[feature], pairs[:, 1])
    for status, counts in table.counts.items():
        assert counts.tolist() == [sum(item.status == status for item in group) for _, group in expected]
    assert sum(int(counts.sum()) for counts in table.counts.values()) == sum(len(group) for _, group in expected)


def on_axis(store: Store, channel: str, dated: bool) -> bool:
    return any(channel in row.to_record().channels and (row.filing.day is not None) == dated for row in store.stored())


STEPS = st.lists(
    st.tuples(st.sampled_from(("update", "update", "restart", "commit")), st.integers(1, 6)), min_size=1, max_size=12
)
MOMENTS = st.floats(0, 200) | st.sampled_from((0.0, 59.99999999999999, 60.0, 600.0, 7200.0, DAY)) | st.floats(0, 4e6)


@given(
    made=st.lists(records(bands=2, numbers=st.floats(-1e300, 1e300)), max_size=25, unique_by=lambda r: r.sequence),
    moments=st.lists(st.tuples(MOMENTS, st.booleans()), min_size=25, max_size=25),
    steps=STEPS,
)
@settings(max_examples=effort_count(quick=40, full=1000), deadline=None)
def test_extremes_are_those_over_all_records(
    tmp_path_factory: pytest.TempPathFactory,
    made: list[Record],
    moments: list[tuple[float, bool]],
    steps: list[tuple[str, int]],
) -> None:
    folder = tmp_path_factory.mktemp("trends")
    waiting = [
        Record(**{**vars(record), "time": when if dated else None, "elapsed": None if dated else when})
        for record, (when, dated) in zip(made, moments, strict=False)
    ]
    trends = Trends(folder / "trends.db", folder / "state.db")
    with Store.open(folder / "state.db", machine="m") as store:
        for step, number in steps:
            if step == "commit":
                store.commit_many([(record, {}) for record in waiting[:number]])
                del waiting[:number]
            elif step == "update":
                trends.update(number)
            else:
                trends.close()
                trends = Trends(folder / "trends.db", folder / "state.db")
        store.commit_many([(record, {}) for record in waiting])
        while trends.update(5):
            pass
        assert trends.behind() == 0
        for channel in ("x", "y"):
            for dated in (True, False):
                said = said_of(store, "s", channel, dated)
                if not on_axis(store, channel, dated):
                    assert trends.query("s", channel, dated=dated).time.size == 0
                    continue
                since, until = said[0].time, said[-1].time
                for first, last in ((since, until), (since, 0.5 * (since + until)), (since + 1.0, until - 1.0)):
                    for points in (2, 9, 1000):
                        table = trends.query("s", channel, first, last, points, dated=dated)
                        assert table.time.size <= points
                        if first <= last:
                            assert_is(table, said, first, last)
    trends.close()


@given(
    time=st.lists(MOMENTS, min_size=1, max_size=30),
    data=st.data(),
    cut=st.integers(0, 30),
    factor=st.integers(1, 12),
)
@settings(max_examples=effort_count(quick=60, full=2000), deadline=None)
def test_stretches_can_be_cut_joined_and_written_at_will(
    time: list[float], data: st.DataObject, cut: int, factor: int
) -> None:
    size = len(time)
    cells = st.floats(allow_infinity=False)
    drawn = data.draw(st.lists(st.lists(cells, min_size=3, max_size=3), min_size=size, max_size=size))
    values = np.full((size, len(FEATURES)), np.nan)
    values[:, [0, 5, 20]] = drawn
    series = np.array(data.draw(st.lists(st.integers(1, 3), min_size=size, max_size=size)), dtype=np.int64)
    status = np.array(data.draw(st.lists(st.integers(0, 20), min_size=size, max_size=size)), dtype=np.int64)
    when = np.array(time)
    whole = Buckets.of_records(series, when, values, status, 60.0)
    parts = Buckets.of_records(series[:cut], when[:cut], values[:cut], status[:cut], 60.0).with_others(
        Buckets.of_records(series[cut:], when[cut:], values[cut:], status[cut:], 60.0)
    )
    for one, other in (
        (whole, parts),
        (whole, Buckets.from_rows(list(whole.to_rows()))),
        (whole.coarser(factor), Buckets.of_records(series, when, values, status, 60.0 * factor)),
    ):
        for name in ("series", "index", "low", "high", "counts"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


@given(record=records(bands=2), names=st.lists(st.sampled_from(sorted(VARIABLES)), unique=True, max_size=9))
@settings(max_examples=effort_count(quick=60, full=1000), deadline=None)
def test_a_part_of_a_row_is_what_the_whole_row_says(record: Record, names: list[str]) -> None:
    layout, row = pack(record.channels)
    whole, numbers = unpack(layout, row), numbers_of(row)[None, :]
    places = places_of(layout, names)
    assert list(places) == list(whole)
    for channel, where in places.items():
        found = columns_of(numbers, where)[0]
        for name, number in zip(names, found, strict=True):
            value = whole[channel].get(name)
            while isinstance(value, tuple):
                value = value[0]
            if value is None:
                assert np.isnan(number)
            elif isinstance(value, str) and VARIABLES[name].kind == "flag":
                assert VARIABLES[name].values[int(number)] == value
            elif not isinstance(value, str):
                assert number == value


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path


def filled(folder: Path, made: list[Record]) -> Store:
    store = Store.open(folder / "state.db", machine="m")
    store.commit_many([(record, {}) for record in made])
    return store


def caught_up(folder: Path) -> Trends:
    trends = Trends(folder / "trends.db", folder / "state.db")
    while trends.update():
        pass
    return trends


def test_few_records_come_one_by_one_and_many_in_stretches_that_keep_a_single_peak(folder: Path) -> None:
    made = [block(number, 1.7e9 + 5.0 * number) for number in range(1, 3001)]
    values = {"x": {"rms": 99.0, "quality_status": "clipped"}}
    made[1234] = block(1235, made[1234].time, channels=values, status="clipped", flags=("clipped",))
    with filled(folder, made) as store, caught_up(folder) as trends:
        table = trends.query("s", "x", points=400)
        assert table.resolution == 60.0
        assert table.time.size <= 400
        assert table.records.sum() == 3000
        assert table.high["rms"].max() == 99.0
        assert table.counts["clipped"].sum() == 1
        assert table.blocks is None
        assert (table.first, table.last) == (made[0].time, made[-1].time)
        near = trends.query("s", "x", (made[1234].time or 0.0) - 60.0, (made[1234].time or 0.0) + 60.0, 400)
        assert near.resolution is None
        assert near.time.size == 25
        assert near.blocks is not None
        assert near.low["rms"][near.blocks == 1235] == 99.0
        short = trends.query("s", "x", made[0].time, made[500].time, 300)
        assert short.resolution == 10.0
        assert_is(short, said_of(store, "s", "x", True), made[0].time or 0.0, made[500].time or 0.0)


def test_rejected_blocks_are_counted_for_every_channel_of_their_source_only(folder: Path) -> None:
    made = [
        block(1, 60.0, channels={"x": {"rms": 1.0}, "y": {"rms": 2.0}}),
        block(2, None, status="unreadable", channels={}),
        block(3, 65.0, channels={"x": {"quality_status": "nan"}, "y": {"rms": 3.0, "quality_status": "ok"}}),
        block(1, 61.0, source="t", channels={"z": {"rms": 5.0}}),
    ]
    with filled(folder, made), caught_up(folder) as trends:
        for points in (2, 100):
            x, y, z = (trends.query(*key, points=points) for key in (("s", "x"), ("s", "y"), ("t", "z")))
            assert {status: int(counts.sum()) for status, counts in x.counts.items()} == {
                "ok": 1,
                "unreadable": 1,
                "nan": 1,
            }
            assert {status: int(counts.sum()) for status, counts in y.counts.items()} == {"ok": 2, "unreadable": 1}
            assert {status: int(counts.sum()) for status, counts in z.counts.items()} == {"ok": 1}
            assert np.nanmin(y.low["rms"]) == 2.0
            assert np.nanmax(y.high["rms"]) == 3.0


def test_late_blocks_fall_into_their_old_stretches(folder: Path) -> None:
    made = [block(number, 10.0 * number) for number in range(100, 1100)]
    late = [block(number, 10.0 * number, flags=("late",), status="late") for number in range(1, 100)]
    with filled(folder, made) as store, caught_up(folder) as trends:
        store.commit_many([(record, {}) for record in random.Random(3).sample(late, len(late))])
        assert trends.behind() == 99
        while trends.update(10):
            pass
        said = said_of(store, "s", "x", True)
        for points in (20, 150, 2000):
            assert_is(trends.query("s", "x", 0.0, 11_000.0, points), said, 0.0, 11_000.0)
        assert_is(trends.query("s", "x", 450.0, 1450.0, 1000), said, 450.0, 1450.0)


def test_a_clock_far_ahead_does_not_stretch_the_span_and_loses_nothing(folder: Path) -> None:
    made = [block(number, 1.7e9 + 5.0 * number) for number in range(1, 20)]
    made[9] = block(10, 4.0e9, flags=("clock",), status="clock")
    with filled(folder, made) as store, caught_up(folder) as trends:
        table = trends.query("s", "x")
        assert (table.first, table.last) == (made[0].time, made[-1].time)
        assert table.records.sum() == 18
        assert_is(trends.query("s", "x", 1.7e9, 5e9, 100), said_of(store, "s", "x", True), 1.7e9, 5e9)


def test_nothing_is_there_before_anything_was_done(folder: Path) -> None:
    trends = Trends(folder / "trends.db", folder / "state.db")
    assert trends.query("s", "x").time.size == 0
    with pytest.raises(StoreError, match=r"state\.db"):
        trends.update()
    with filled(folder, [block(1, 5.0)]):
        assert trends.behind() == 1
        assert trends.update() is False
        assert trends.query("s", "x").time.tolist() == [5.0]
        assert trends.query("s", "nobody").time.size == 0
        assert trends.query("s", "x", 9.0, 8.0).time.size == 0
    trends.close()
    trends.close()


def test_one_writer_at_a_time_and_readers_beside_it(folder: Path) -> None:
    with filled(folder, [block(1, 5.0)]) as store, caught_up(folder) as first:
        second = Trends(folder / "trends.db", folder / "state.db")
        store.commit(block(2, 6.0), {})
        assert second.update() is False
        assert second.behind() == 1
        assert first.update() is False
        assert second.behind() == 0
        assert second.query("s", "x").time.tolist() == [5.0, 6.0]
        first.close()
        store.commit(block(3, 7.0), {})
        assert second.update() is False
        assert second.behind() == 0
        second.close()


@pytest.mark.parametrize("harm", ["garbage", "zeros", "table", "version", "blob", "removed"])
def test_what_is_damaged_or_of_another_version_is_made_anew(folder: Path, harm: str) -> None:
    made = [block(number, 5.0 * number) for number in range(1, 500)]
    with filled(folder, made) as store:
        caught_up(folder).close()
        path = folder / "trends.db"
        if harm == "garbage":
            path.write_bytes(b"no database" * 1000)
        elif harm == "zeros":
            path.write_bytes(path.read_bytes()[:4096] + bytes(path.stat().st_size - 4096))
        elif harm == "removed":
            path.unlink()
        else:
            statement = {
                "table": "DROP TABLE buckets",
                "version": "UPDATE meta SET value = '0' WHERE key = 'version'",
                "blob": "UPDATE buckets SET extremes = x'00'",
            }[harm]
            with sqlite3.connect(path) as connection:
                connection.execute(statement)
            connection.close()
        trends = Trends(path, folder / "state.db")
        if harm in ("version", "removed"):
            assert trends.query("s", "x", 1.0, 2400.0, 45).time.size == 0
        else:
            with pytest.raises(StoreError, match=r"trends\.db"):
                trends.query("s", "x", 1.0, 2400.0, 45)
        store.commit(block(500, 2500.0), {})
        while trends.update():
            pass
        said = said_of(store, "s", "x", True)
        assert_is(trends.query("s", "x", 1.0, 2400.0, 45), said, 1.0, 2400.0)
        trends.close()


def test_trends_of_another_store_are_made_anew(folder: Path) -> None:
    with filled(folder, [block(number, 5.0 * number) for number in range(1, 50)]):
        trends = caught_up(folder)
        assert trends.query("s", "x").time.size == 49
    for path in folder.glob("state.db*"):
        path.rename(folder / f"old-{path.name}")
    values = {"y": {"speed": 1.0}, "x": {"quality_status": "ok", "h_or": (1.0, 2.0), "rms": 3.0}}
    with filled(folder, [block(number, 7.0 * number, channels=values) for number in range(1, 60)]) as store:
        while trends.update():
            pass
        said = said_of(store, "s", "x", True)
        assert_is(trends.query("s", "x", 0.0, 420.0, 100), said, 0.0, 420.0)
        trends.close()


_UPDATING = """
import sys
from pathlib import Path
from monitor.records.trends import Trends
folder = Path(sys.argv[1])
trends = Trends(folder / "trends.db", folder / "state.db")
while trends.update(7):
    print(trends.behind(), flush=True)
"""


def test_kills_lose_nothing_and_count_nothing_twice(folder: Path) -> None:
    draw, count = random.Random(5), effort_count(quick=1500, full=20_000)
    made = [
        block(number, 30.0 * number if draw.random() < 0.9 else 15.0 * number, flags=draw.choice([(), (), FLAGS[4:5]]))
        for number in range(1, count + 1)
    ]
    with filled(folder, made) as store:
        for _ in range(effort_count(quick=5, full=60)):
            child = subprocess.Popen(
                [sys.executable, "-c", _UPDATING, str(folder)], cwd=ROOT, stdout=subprocess.PIPE, text=True
            )
            assert child.stdout is not None
            for _ in range(draw.randrange(1, 5)):
                child.stdout.readline()
            time.sleep(draw.random() * 0.01)
            os.kill(child.pid, signal.SIGKILL)
            child.wait()
            child.stdout.close()
        with Trends(folder / "trends.db", folder / "state.db") as trends:
            assert 0 < trends.behind() < count
            while trends.update():
                pass
            said = said_of(store, "s", "x", True)
            until = 30.0 * count
            for points in (30, 1000, 5000):
                assert_is(trends.query("s", "x", 0.0, until, points), said, 0.0, until)


def test_many_channels_are_told_apart(folder: Path) -> None:
    names = [f"c{number}" for number in range(64)]
    made = [
        block(
            sequence,
            6.0 * sequence,
            channels={
                name: {"rms": float(place * 1000 + sequence), "h_or": None if place % 2 else ((1.0 * place),)}
                for place, name in enumerate(names)
            },
        )
        for sequence in range(1, 120)
    ]
    with filled(folder, made) as store, caught_up(folder) as trends:
        for name in ("c0", "c17", "c63"):
            said = said_of(store, "s", name, True)
            for points in (9, 60, 500):
                assert_is(trends.query("s", name, 6.0, 714.0, points), said, 6.0, 714.0)
