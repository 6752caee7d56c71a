"""Old blocks leave the store as full records; what trends, scores, counts and the ledger need of them stays."""

from __future__ import annotations

import dataclasses
import json
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from monitor.records import rollup
from monitor.records.compact import free_bytes_in, settle_layout, shorten, shrinks
from monitor.records.condense import condensed_up_to
from monitor.records.database import SharedConnection
from monitor.records.ledger import StoreLedger
from monitor.records.publish import delete_oldest, missing_files, publish
from monitor.records.published_folder import MovedDaysError, move_day, moved_days
from monitor.records.rollup import FEATURES, SeriesKey
from monitor.records.store import Published, Store
from monitor.records.trends import read_trends
from monitor.report.runs import ABSENCE, read_runs
from tests.monitor.records.condensed import (
    BEGIN,
    DAY,
    EVENT_EVERY,
    FIRST_FORECAST,
    PER_DAY,
    block,
    condense_all,
    fill,
    present,
    trends,
)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "state.db"


@pytest.fixture
def store(path: Path) -> Iterator[Store]:
    with Store.open(path, machine="m") as opened:
        opened.describe({"config_hash": "c1"})
        yield opened


def test_condensing_keeps_counts_identities_events_forecasts_states_and_trends(filled: Store) -> None:
    count = 4 * PER_DAY
    before = trends(filled, points=50)
    forecasts = list(filled.forecasts())
    condense_all(filled)
    left = present(filled)
    assert left == [number for number in range(1, count + 1) if number % EVENT_EVERY == 0 or number >= count - PER_DAY]
    assert filled.check() == []
    assert filled.counts() == {"ok": count}
    assert [event["n"] for event in filled.events()] == list(range(EVENT_EVERY, count + 1, EVENT_EVERY))
    assert list(filled.forecasts()) == forecasts
    assert filled.load_states() == {"a": {"n": count}}
    assert filled.last("s") == count
    after = trends(filled, points=50)
    assert before.resolution == after.resolution
    for name in FEATURES:
        assert np.array_equal(before.low[name], after.low[name], equal_nan=True)
        assert np.array_equal(before.high[name], after.high[name], equal_nan=True)
    assert (after.first, after.last) == (before.first, before.last)
    assert np.array_equal(before.records, after.records)


def test_a_condensed_block_is_a_duplicate_when_it_comes_again(filled: Store) -> None:
    condense_all(filled)
    assert 7 not in present(filled)
    assert filled.commit(block(7), {}) == "duplicate"
    assert filled.commit(block(7, content_hash="ff"), {}) == "changed"
    assert filled.counts() == {"ok": 4 * PER_DAY, "duplicate": 1, "changed": 1}
    with StoreLedger(filled) as ledger:
        assert ledger.content_of("s", 7) == f"{7:032x}"
        assert ledger.content_of("other", 7) is None
        assert ledger.known("s", f"{7:032x}") == 7
        assert ledger.known("s", "f" * 32) is None
        assert ledger.began("s") == BEGIN
        assert ledger.committed("s") == 4 * PER_DAY


def test_the_trend_of_a_short_condensed_range_has_its_buckets_and_not_the_few_records_that_are_left(
    filled: Store,
) -> None:
    condense_all(filled)
    found = trends(filled, since=BEGIN, until=BEGIN + 0.4 * DAY)
    assert found.resolution is not None
    assert found.records.sum() >= 0.4 * PER_DAY
    newest = trends(filled, since=BEGIN + 3.5 * DAY)
    assert newest.resolution is None


def test_only_what_is_published_and_in_the_rollup_is_condensed(store: Store, tmp_path: Path) -> None:
    count = fill(store)
    condense_all(store)
    assert len(present(store)) == count
    publish(store, tmp_path / "records")
    with store.transaction() as connection:
        connection.execute("DELETE FROM published WHERE file LIKE '%15.nc'")
    condense_all(store)
    assert len(present(store)) == count
    store.note_published(Published("m-20231115.nc", int(BEGIN // DAY), count, 1))
    with store.transaction() as connection:
        connection.execute("UPDATE meta SET value = '30' WHERE key = 'rolled_up'")
    condense_all(store)
    with store.transaction() as connection:
        assert condensed_up_to(connection) == 30


def test_blocks_without_a_usable_time_go_with_the_older_ones_behind_them(store: Store, tmp_path: Path) -> None:
    records = [block(number) for number in range(1, 3 * PER_DAY)]
    records[3] = dataclasses.replace(records[3], time=0.0, flags=("clock",), status="clock")
    records[-2] = dataclasses.replace(records[-2], time=0.0, flags=("clock",), status="clock")
    store.commit_many([(record, {}) for record in records])
    with store.transaction() as connection:
        rollup.roll_up(connection, 60.0)
    publish(store, tmp_path / "records")
    condense_all(store)
    assert 4 not in present(store)
    assert records[-2].sequence in present(store)


def test_without_any_time_nothing_is_condensed_by_age(store: Store, tmp_path: Path) -> None:
    records = [block(number, 0.0, flags=("clock",), status="clock") for number in range(1, 200)]
    store.commit_many([(record, {}) for record in records])
    publish(store, tmp_path / "records")
    condense_all(store)
    condense_all(store, by_number=True)
    assert len(present(store)) == 199


def test_blocks_of_unknown_time_are_condensed_by_number_where_space_is_short(
    store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("monitor.records.condense._MIN_UNDATED_BLOCKS", 50)
    records = [dataclasses.replace(block(number), time=None) for number in range(1, 200)]
    store.commit_many([(record, {}) for record in records])
    publish(store, tmp_path / "records")
    with store.transaction() as connection:
        rollup.roll_up(connection, 60.0)
    condense_all(store)
    assert len(present(store)) == 199
    condense_all(store, by_number=True)
    assert present(store) == list(range(150, 200))


def blocks_of(path: Path) -> Sequence[int]:
    with xr.open_dataset(path, decode_times=False) as dataset:
        return sorted(int(number) for number in dataset.sequence.values)


def test_a_late_block_joins_the_file_of_a_condensed_day_and_replaces_nothing(filled: Store, tmp_path: Path) -> None:
    folder = tmp_path / "records"
    first = folder / "m-20231115.nc"
    with xr.open_dataset(first, decode_cf=False) as dataset:
        before = dataset.load()
    condense_all(filled)
    filled.describe({"config_hash": "c2"})
    filled.commit(block(9999, BEGIN + 5.0), {})
    assert publish(filled, folder) == [first]
    assert blocks_of(first) == [*range(1, PER_DAY + 1), 9999]
    with xr.open_dataset(first, decode_cf=False) as dataset:
        after = dataset.load()
    assert after.attrs["config_hash"] == "c1; c2"
    assert after.attrs["time_coverage_start"] == before.attrs["time_coverage_start"]
    old = after.isel(time=after.sequence.values != 9999)
    for name in before.variables:
        assert np.array_equal(before[name].values, old[name].values, equal_nan=before[name].dtype.kind == "f"), name
    assert publish(filled, folder) == []


def test_a_lost_file_of_a_condensed_day_is_missed_and_not_replaced_by_less(filled: Store, tmp_path: Path) -> None:
    folder = tmp_path / "records"
    condense_all(filled)
    lost = folder / "m-20231115.nc"
    lost.unlink()
    assert publish(filled, folder) == []
    assert not lost.exists()
    assert missing_files(filled, folder) == [lost.name]
    # A late block has no older file to join: its file says how many records are elsewhere.
    filled.commit(block(9999, BEGIN + 5.0), {})
    assert publish(filled, folder) == [lost]
    with xr.open_dataset(lost, decode_times=False) as dataset:
        assert dataset.attrs["records_elsewhere"] == PER_DAY - 2
        assert sorted(dataset.sequence.values) == [EVENT_EVERY, 2 * EVENT_EVERY, 9999]


def test_a_moved_day_is_neither_missed_nor_made_again_and_a_report_names_it(filled: Store, tmp_path: Path) -> None:
    folder, away = tmp_path / "records", tmp_path / "away"
    condense_all(filled)
    days = sorted(folder.glob("m-*.nc"))
    content = days[0].read_bytes()
    moved = move_day(days[0], "m", away, filled.path, 5.0)
    assert (away / days[0].name).read_bytes() == content
    assert moved_days(folder, "m") == [moved]
    assert publish(filled, folder) == []
    assert missing_files(filled, folder) == []
    (run,) = read_runs(folder)
    assert run.attributes[ABSENCE] == ("1 published days (m-20231115) are not in this folder: 1 were moved to away")
    (run,) = read_runs(filled)
    older = 3 * PER_DAY - 1 - 3 * PER_DAY // EVENT_EVERY
    assert run.attributes[ABSENCE] == f"full records of {older} older blocks are in the published files only"


def test_a_late_block_of_a_moved_day_joins_its_moved_file(filled: Store, tmp_path: Path) -> None:
    folder, away = tmp_path / "records", tmp_path / "away"
    condense_all(filled)
    day = folder / "m-20231115.nc"
    move_day(day, "m", away, filled.path, 5.0)
    filled.commit(block(9999, BEGIN + 5.0), {})
    assert publish(filled, folder) == [day]
    assert blocks_of(day) == [*range(1, PER_DAY + 1), 9999]
    with xr.open_dataset(day, decode_times=False) as dataset:
        assert "records_elsewhere" not in dataset.attrs
    move_day(day, "m", away, filled.path, 6.0)
    assert blocks_of(away / day.name) == [*range(1, PER_DAY + 1), 9999]
    assert publish(filled, folder) == []


def test_a_day_whose_copy_differs_is_not_removed(filled: Store, tmp_path: Path) -> None:
    day = tmp_path / "records" / "m-20231115.nc"
    away = tmp_path / "away"
    away.mkdir()
    (away / day.name).write_bytes(b"another")
    with pytest.raises(MovedDaysError, match="differs from"):
        move_day(day, "m", away, filled.path, 0.0)
    assert day.exists()
    with pytest.raises(MovedDaysError, match="is the folder of the published files"):
        move_day(day, "m", day.parent, filled.path, 0.0)


def test_only_days_that_are_condensed_are_deleted(filled: Store, tmp_path: Path) -> None:
    folder = tmp_path / "records"
    assert delete_oldest(filled, folder, 1 << 40, 0.0) == []
    condense_all(filled)
    assert delete_oldest(filled, folder, 1, 0.0) == ["m-20231115.nc"]
    assert delete_oldest(filled, folder, 1 << 40, 0.0) == ["m-20231116.nc"]
    assert [entry.to for entry in moved_days(folder, "m")] == [None] * 2
    assert publish(filled, folder) == []


def test_the_rollup_of_condensed_blocks_survives_another_set_of_features(
    filled: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    condense_all(filled)
    path = filled.path
    before = trends(filled, points=50)
    filled.close()
    others = (FEATURES[2], "new", *FEATURES[:2])
    monkeypatch.setattr(rollup, "FEATURES", others)
    with closing(sqlite3.connect(path, isolation_level=None)) as connection:
        rollup.check_features(connection)
    monkeypatch.setattr(rollup, "FEATURES", FEATURES)
    with closing(sqlite3.connect(path, isolation_level=None)) as connection:
        rollup.check_features(connection)
    with SharedConnection(path) as reader:
        after = read_trends(reader, SeriesKey("s", "x", True), points=50)
    for name in FEATURES[:3]:
        assert np.array_equal(before.low[name], after.low[name], equal_nan=True)
    assert np.array_equal(before.records, after.records)


def test_a_store_is_shortened_step_by_step_while_it_is_read(filled: Store) -> None:
    with filled.connection() as connection:
        connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    size = filled.path.stat().st_size
    with SharedConnection(filled.path) as reader:
        condense_all(filled)
        with filled.connection() as connection:
            assert shrinks(connection)
            connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
            reserve = free_bytes_in(connection)
            assert shorten(filled, 10) == 0 or reserve > 4 << 20
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("monitor.records.compact.RESERVE_BYTES", 0)
            steps = 0
            with filled.connection() as connection:
                free = free_bytes_in(connection) // 4096
                assert shorten(filled, 2) == 2
                assert free_bytes_in(connection) // 4096 == free - 2
                while shorten(filled, 3):
                    steps += 1
                    assert reader.rows("SELECT count(*) FROM blocks")[0][0] == len(present(filled))
                assert free_bytes_in(connection) == 0
                connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        assert steps > 1
    assert filled.path.stat().st_size < size
    assert filled.check() == []


def test_a_store_of_an_older_version_is_rebuilt_where_there_is_room(path: Path) -> None:
    with closing(sqlite3.connect(path)) as connection:
        connection.execute("PRAGMA auto_vacuum = NONE")
        connection.execute("CREATE TABLE other (x)")
        connection.commit()
    # Another program's database is left alone.
    assert not settle_layout(path, lambda _: 1 << 40)
    path.unlink()
    with Store.open(path, machine="m") as store:
        fill(store, 2)
        records = list(store.records())
    with closing(sqlite3.connect(path, isolation_level=None)) as connection:
        connection.execute("PRAGMA auto_vacuum = NONE")
        connection.execute("VACUUM")
        assert not shrinks(connection)
    assert not settle_layout(path, lambda _: 1000)
    beats: list[int] = []
    assert settle_layout(path, lambda _: 1 << 40, lambda: beats.append(1))
    assert not settle_layout(path, lambda _: 1 << 40)
    with Store.open(path, machine="m") as store, store.connection() as connection:
        assert shrinks(connection)
        assert list(store.records()) == records


def test_a_store_of_the_version_before_is_migrated_and_can_be_read_without(path: Path) -> None:
    with Store.open(path, machine="m") as store:
        count = fill(store, 2)
    with closing(sqlite3.connect(path, isolation_level=None)) as connection:
        for table in ("condensed_sources", "condensed_days", "identities", "forecast_inputs", "condensed_forecasts"):
            connection.execute(f"DROP TABLE {table}")
        connection.execute("UPDATE meta SET value = '3' WHERE key = 'schema_version'")
    with Store.open(path, read_only=True) as store:
        assert store.counts() == {"ok": count}
        assert len(list(store.forecasts())) == count - FIRST_FORECAST + 1
        assert trends(store).records.sum() == count
        assert read_runs(store)[0].counts == {"ok": count}
    with Store.open(path, machine="m") as store:
        assert json.loads(json.dumps(store.meta()))["schema_version"] == "4"
        assert store.commit(block(1), {}) == "duplicate"
