"""Clocks that jump, summer time that comes and goes, stamps that repeat: flagged, stored as stated; no timer moves."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.health.onset import Mark
from monitor.health.record import Record
from monitor.records.ledger import StoreLedger
from monitor.records.store import Store
from monitor.service.ingest import Ingest
from monitor.service.summary import channel_summary
from streams.types.times import MIN_TIME
from tests.streams.makers import ims_text
from tests.support.daemon import last, put, running
from tests.support.daemons import make_machine, status
from tests.support.effort import effort_count
from tests.support.ingest import Queue, block, ingest_of, settings_of, steps
from tests.support.waiting import wait_until

NOW = 1.7e9
LOCAL = """
[machine]
name = "m"
min_free_mb = 1
timezone = "Europe/Rome"
[publish]
interval_s = 0.3
[[bearing]]
name = "b"
designation = "ZA-2115"
[[source]]
name = "s0"
url = "folder:in0"
format = "ims"
settle_s = 0.2
block_s = "file"
[[channel]]
name = "x0"
source = "s0"
column = 1
unit = "g"
bearing = "b"
band_hz = [[1000, 9000]]
"""


def judged(folder: Path, times: Sequence[float], clock: Sequence[float]) -> list[Record]:
    """Take blocks with these stamps, the computer's clock showing those times as each comes."""
    shown = iter(clock)
    blocks = [replace(block(number), start=when) for number, when in enumerate(times, 1)]
    with Store.open(folder / "state.db", machine="m") as store, StoreLedger(store) as ledger:
        source = Queue(store, list(blocks))
        with Ingest(store, ledger, [source], {"s": settings_of()}, clock=lambda: next(shown)) as ingest:
            steps(ingest, len(blocks))
        return list(store.records())


def flagged(records: list[Record]) -> list[bool]:
    return ["clock" in record.flags for record in records]


def test_stamps_that_repeat_or_lie_ahead_are_flagged_and_follow_the_order(tmp_path: Path) -> None:
    times = [NOW, NOW + 1, NOW + 1, NOW + 2, NOW + 2 + 61, NOW + 3, 0.0, NOW + 4]
    records = judged(tmp_path, times, [NOW + 2] * len(times))
    assert flagged(records) == [False, False, True, False, True, False, True, False]
    # One that is a minute ahead keeps its time; what repeats or is of 1970 comes an interval after the block before.
    assert [record.time for record in records] == [NOW + k for k in (0, 1, 2, 2, 63, 3, 4, 4)]
    assert [record.channels["x"].get("time_stated") for record in records] == [
        *(None, None, NOW + 1, None, None, None, 0.0, None)
    ]


def test_a_jump_of_the_computers_clock_flags_what_seems_to_lie_ahead_and_is_over_with_it(tmp_path: Path) -> None:
    times = [NOW + k for k in range(8)]
    # Set to 1970 as by an empty battery, then an hour ahead, then right.
    clock = [NOW, NOW + 1, 0.0, 1.0, NOW + 3604, NOW + 3605, NOW + 6, NOW + 7]
    records = judged(tmp_path, times, clock)
    assert flagged(records) == [False, False, True, True, False, False, False, False]
    assert [record.time for record in records] == times


@settings(max_examples=effort_count(quick=12, full=1000))
@given(
    stamps=st.lists(st.floats(-1e10, 1e11, allow_nan=False), min_size=1, max_size=12),
    clock=st.lists(st.floats(-1e10, 1e11, allow_nan=False), min_size=12, max_size=12),
)
def test_no_stamp_and_no_clock_loses_a_block(
    tmp_path_factory: pytest.TempPathFactory, stamps: list[float], clock: list[float]
) -> None:
    records = judged(tmp_path_factory.mktemp("t"), stamps, clock)
    assert all(record.accepted for record in records)
    for record, stamp in zip(records, stamps, strict=True):
        values = record.channels["x"]
        if "clock" not in record.flags:
            assert record.time == stamp >= MIN_TIME
        elif record.time != stamp:
            # What is not believed is kept beside what is.
            assert values["time_stated"] == stamp
        assert record.time is None or values["time_source"] is not None


def local_files(folder: Path, names: Sequence[str]) -> list[Record]:
    """Have a daemon take files with local times in their names, one after the other; return the records."""
    (folder / "in0").mkdir()
    path = folder / "m.toml"
    path.write_text(LOCAL)
    lines = ims_text(4).splitlines(keepends=True)
    with (
        pytest.MonkeyPatch.context() as patch,
        running(path, clock=lambda: datetime(2026, 12, 1, tzinfo=UTC).timestamp()),
    ):
        # The published file is read afterwards, however long a busy machine takes for it.
        patch.setattr("monitor.service.companions._LAST_PUBLICATION_S", 600.0)
        for number, name in enumerate(names, 1):
            temporary = folder / "in0" / f".{name}"
            temporary.write_bytes(b"".join(lines[number:] + lines[:number]))
            temporary.rename(folder / "in0" / name)
            wait_until(lambda count=number: last(path) == count)
    with Store.open(folder / "state" / "state.db", read_only=True) as store:
        return list(store.records())


def minutes(start: datetime, *after: int) -> list[float]:
    return [(start + timedelta(minutes=minute)).timestamp() for minute in after]


@pytest.mark.process
def test_in_spring_local_times_go_on_without_a_gap(tmp_path: Path) -> None:
    # At 2 o'clock it is 3 o'clock, which is 1 o'clock UTC.
    names = ["01.30", "01.40", "01.50", "03.00", "03.10"]
    records = local_files(tmp_path, [f"2026.03.29.{name}.00" for name in names])
    assert [record.time for record in records] == minutes(datetime(2026, 3, 29, 0, 30, tzinfo=UTC), 0, 10, 20, 30, 40)
    assert [record.flags for record in records] == [()] * 5
    with xr.open_dataset(tmp_path / "records" / "m-20260329.nc") as day:
        assert day.sizes["time"] == 5


@pytest.mark.process
def test_in_autumn_the_hour_that_comes_twice_follows_the_order_of_the_files(tmp_path: Path) -> None:
    # At 3 o'clock it is 2 o'clock again: what is named 02.15 after 02.50 is an hour later than it seems.
    names = ["02.30", "02.40", "02.50", "02.15", "02.25", "02.55", "03.05"]
    records = local_files(tmp_path, [f"2026.10.25.{name}.00" for name in names])
    start = datetime(2026, 10, 25, 0, 30, tzinfo=UTC)
    assert [record.time for record in records] == minutes(start, 0, 10, 20, 45, 55, 85, 95)
    assert [record.accepted for record in records] == [True] * 7
    # Which hour the first one is of, nothing tells; nor how far the second is from it.
    assert [bool({"clock", "late"} & set(record.flags)) for record in records] == [True, True, *[False] * 5]
    with xr.open_dataset(tmp_path / "records" / "m-20261025.nc") as day:
        assert day.sizes["time"] == 7
        assert (day.time.values[1:] > day.time.values[:-1]).all()


@pytest.mark.process
def test_setting_the_clock_moves_no_timer_of_a_daemon(tmp_path: Path) -> None:
    config, shown = make_machine(tmp_path), [NOW]
    with running(config, clock=lambda: shown[0]):
        put(config, 1)
        wait_until(lambda: last(config) == 2)
        for number, moved in enumerate((NOW - 1e8, NOW + 1e8, 0.0), 2):
            shown[0] = moved
            put(config, number)
            wait_until(lambda blocks=2 * number: last(config) == blocks)
            written = datetime.fromtimestamp(moved, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
            wait_until(lambda text=written: status(config)["updated_utc"] == text)
            assert status(config)["problems"] == {}
            assert status(config)["channels"]["x0"]["state"] == "check_function"
        assert 0.0 < status(config)["up_s"] < 120.0
        published = tmp_path / "records" / "m-undated.nc"
        wait_until(lambda: published.exists())
        time.sleep(0.1)
    with xr.open_dataset(published) as day:
        assert day.sizes["time"] == 8


def test_a_final_stage_at_a_time_that_no_calendar_has_is_shown_without_it(tmp_path: Path) -> None:
    with Store.open(tmp_path / "state.db", machine="m") as store:
        with ingest_of(store, Queue(store, [replace(block(1), start=1e15)])) as ingest:
            steps(ingest, 1)
            state = ingest.state("s")
        mark, channel = Mark(1, 1e15), state.channels["x"]
        final = replace(channel, detect=replace(channel.detect, t_fs=mark, t_fs_known=mark))
        found = channel_summary(replace(state, channels={"x": final}), ingest.settings["s"].channels["x"])
    assert (found["t_fs_block"], found["t_fs_utc"]) == (1, None)
