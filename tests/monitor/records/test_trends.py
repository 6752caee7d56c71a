"""Trends: extremes equal those over all records, none missing and none counted twice, whatever happened on the way."""

from __future__ import annotations

import math
import random
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.health.record import Record
from monitor.health.schema import VARIABLES
from monitor.records import rollup, trends
from monitor.records.packing import columns_of, numbers_of, pack, places_of, unpack
from monitor.records.store import Store
from tests.oracles.records_oracle import records
from tests.oracles.trends_oracle import said_of
from tests.support.effort import effort_count
from tests.support.trends import MOMENTS, assert_is, block, filled, query, rolled_up


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path


def batches_of(blocks: int) -> Any:
    return patch.multiple(rollup, BATCH_BLOCKS=blocks, _CHUNK_BLOCKS=blocks)


def unhurried() -> Any:
    """However busy the machine is, a commit rolls up all that it may."""
    return patch.object(rollup.roll_up, "__defaults__", (math.inf,))


@given(
    made=st.lists(records(bands=2, numbers=st.floats(-1e300, 1e300)), max_size=25, unique_by=lambda r: r.sequence),
    moments=st.lists(st.tuples(MOMENTS, st.booleans()), min_size=25, max_size=25),
    steps=st.lists(st.tuples(st.booleans(), st.integers(1, 6)), max_size=12),
    batch=st.integers(1, 9),
    max_records=st.sampled_from((0, 8, 20_000)),
)
@settings(max_examples=effort_count(quick=6, full=1000))
def test_extremes_are_those_over_all_records(
    tmp_path_factory: pytest.TempPathFactory,
    made: list[Record],
    moments: list[tuple[float, bool]],
    steps: list[tuple[bool, int]],
    batch: int,
    max_records: int,
) -> None:
    folder = tmp_path_factory.mktemp("trends")
    waiting = [
        Record(**{**vars(record), "time": when if dated else None, "elapsed": None if dated else when})
        for record, (when, dated) in zip(made, moments, strict=False)
    ]
    with unhurried(), batches_of(batch), patch.object(trends, "_MAX_RECORDS", max(max_records, batch)):
        store = Store.open(folder / "state.db", machine="m")
        for reopen, number in steps:
            store.commit_many([(record, {}) for record in waiting[:number]])
            del waiting[:number]
            if reopen:
                store.close()
                store = Store.open(folder / "state.db", machine="m")
        store.commit_many([(record, {}) for record in waiting])
        assert len(made) - rolled_up(folder) < batch
        for channel in ("x", "y"):
            for dated in (True, False):
                said = said_of(store, "s", channel, dated)
                if not said:
                    assert query(folder, "s", channel, dated=dated).time.size == 0
                    continue
                since, until = said[0].time, said[-1].time
                for first, last in ((since, until), (since, 0.5 * (since + until)), (since + 1.0, until - 1.0)):
                    for points in (2, 9, 1000):
                        table = query(folder, "s", channel, first, last, points, dated=dated)
                        assert table.complete
                        assert table.time.size <= points
                        if first <= last:
                            assert_is(table, said, first, last)
        store.close()


@given(record=records(bands=2), names=st.lists(st.sampled_from(sorted(VARIABLES)), unique=True, max_size=9))
@settings(max_examples=effort_count(quick=24, full=1000))
def test_a_part_of_a_row_is_what_the_whole_row_says(record: Record, names: list[str]) -> None:
    layout, row = pack(record.channels)
    whole, numbers = unpack(layout, row), numbers_of(row)[None, :]
    places = places_of(layout, tuple(names))
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


def test_few_records_come_one_by_one_and_many_in_buckets_that_keep_a_single_peak(folder: Path) -> None:
    made = [block(number, 1.7e9 + 5.0 * number) for number in range(1, 3001)]
    values = {"x": {"rms": 99.0, "quality_status": "clipped"}}
    made[1234] = block(1235, made[1234].time, channels=values, status="clipped", flags=("clipped",))
    with filled(folder, made) as store:
        table = query(folder, "s", "x", points=400)
        assert table.resolution == 60.0
        assert table.time.size <= 400
        assert table.records.sum() == 3000
        assert table.high["rms"].max() == 99.0
        assert table.counts["clipped"].sum() == 1
        assert table.blocks is None
        assert (table.first, table.last) == (made[0].time, made[-1].time)
        near = query(folder, "s", "x", (made[1234].time or 0.0) - 60.0, (made[1234].time or 0.0) + 60.0, 400)
        assert near.resolution is None
        assert near.time.size == 25
        assert near.blocks is not None
        assert near.low["rms"][near.blocks == 1235] == 99.0
        short = query(folder, "s", "x", made[0].time, made[500].time, 300)
        assert short.resolution == 10.0
        assert_is(short, said_of(store, "s", "x", True), made[0].time or 0.0, made[500].time or 0.0)


@pytest.mark.parametrize("batch", [1, 64])
def test_rejected_blocks_are_counted_for_every_channel_of_their_source_only(folder: Path, batch: int) -> None:
    made = [
        block(1, 60.0, channels={"x": {"rms": 1.0}, "y": {"rms": 2.0}}),
        block(2, None, status="unreadable", channels={}),
        block(3, 65.0, channels={"x": {"quality_status": "nan"}, "y": {"rms": 3.0, "quality_status": "ok"}}),
        block(1, 61.0, source="t", channels={"z": {"rms": 5.0}}),
    ]
    with batches_of(batch), filled(folder, made):
        for points in (2, 100):
            x, y, z = (query(folder, *key, points=points) for key in (("s", "x"), ("s", "y"), ("t", "z")))
            assert {status: int(counts.sum()) for status, counts in x.counts.items()} == {
                "ok": 1,
                "unreadable": 1,
                "nan": 1,
            }
            assert {status: int(counts.sum()) for status, counts in y.counts.items()} == {"ok": 2, "unreadable": 1}
            assert {status: int(counts.sum()) for status, counts in z.counts.items()} == {"ok": 1}
            assert np.nanmin(y.low["rms"]) == 2.0
            assert np.nanmax(y.high["rms"]) == 3.0


def test_late_blocks_fall_into_their_old_buckets(folder: Path) -> None:
    made = [block(number, 10.0 * number) for number in range(100, 1100)]
    late = [block(number, 10.0 * number, flags=("late",), status="late") for number in range(1, 100)]
    with filled(folder, made) as store:
        for record in random.Random(3).sample(late, len(late)):
            store.commit(record, {})
        assert rolled_up(folder) >= 1036
        said = said_of(store, "s", "x", True)
        for points in (20, 150, 2000):
            assert_is(query(folder, "s", "x", 0.0, 11_000.0, points), said, 0.0, 11_000.0)
        assert_is(query(folder, "s", "x", 450.0, 1450.0, 1000), said, 450.0, 1450.0)


def test_a_clock_far_ahead_does_not_extend_the_span_and_loses_nothing(folder: Path) -> None:
    made = [block(number, 1.7e9 + 5.0 * number) for number in range(1, 20)]
    made[9] = block(10, 4.0e9, flags=("clock",), status="clock")
    with filled(folder, made) as store:
        table = query(folder, "s", "x")
        assert (table.first, table.last) == (made[0].time, made[-1].time)
        assert table.records.sum() == 18
        assert_is(query(folder, "s", "x", 1.7e9, 5e9, 100), said_of(store, "s", "x", True), 1.7e9, 5e9)


def test_times_of_any_size_can_be_committed_and_asked_for(folder: Path) -> None:
    made = [block(number, None, elapsed=10.0 ** (12 * number)) for number in range(1, 20)]
    with unhurried(), batches_of(1), filled(folder, made):
        assert rolled_up(folder) == 19
        assert query(folder, "s", "x", points=2, dated=False).high["rms"].size <= 2


def test_an_empty_answer_where_there_is_nothing(folder: Path) -> None:
    with Store.open(folder / "state.db", machine="m") as store:
        assert query(folder, "s", "x").time.size == 0
        store.commit(block(1, 5.0), {})
        assert query(folder, "s", "x").time.tolist() == [5.0]
        assert query(folder, "s", "other").time.size == 0
        assert query(folder, "s", "x", 9.0, 8.0).time.size == 0
        assert query(folder, "s", "x", dated=False).time.size == 0


def test_many_channels_are_kept_apart(folder: Path) -> None:
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
    with filled(folder, made) as store:
        for name in ("c0", "c17", "c63"):
            said = said_of(store, "s", name, True)
            for points in (9, 60, 500):
                assert_is(query(folder, "s", name, 6.0, 714.0, points), said, 6.0, 714.0)
