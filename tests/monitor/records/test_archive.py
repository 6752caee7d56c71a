from __future__ import annotations

import sqlite3
import time
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from monitor.health.record import Record
from monitor.records.archive import COLUMNS, forecast_values
from monitor.records.database import STORE_VERSION, StoreError
from monitor.records.store import Store

RUN = {"config_hash": "c1", "map_hash": "x: m1; y: m2", "interval_level": 0.8}
BODY = {"channel": "x", "method": "library", "threshold_mm2": 0.05, "status": "ok", "tt_s": 50.0}
INTERVAL = {"tt_lower_s": 20.0, "tt_upper_s": 90.0}


def block(sequence: int, *forecasts: dict[str, Any], at: float | None = None) -> Record:
    return Record("s", sequence, f"b{sequence}", f"h{sequence}", time=at, elapsed=10.0 * sequence, forecasts=forecasts)


def values(body: dict[str, Any], run: dict[str, Any] | None = None) -> dict[str, Any]:
    return dict(zip(COLUMNS, forecast_values(body, RUN if run is None else run, 7.0, None), strict=True))


def test_a_forecast_is_archived_with_all_that_it_leaned_on(tmp_path: Path) -> None:
    began = time.time()
    first, other = {**BODY, **INTERVAL, "library_hash": "l1"}, {**BODY, "channel": "y", "method": "thesis"}
    records = [block(1, first, other, at=86400.0), block(2, {**BODY, "tt_s": None, "status": "concave"})]
    with Store.open(tmp_path / "state.db", machine="m") as store:
        store.describe(RUN)
        store.commit_many([(record, {}) for record in records])
        store.describe({"config_hash": "c2"})
        store.commit(block(3, BODY), {})
        found = list(store.forecasts())
        assert list(store.records()) == [*records, block(3, BODY)]
    assert [(f.block, f.channel, f.method, f.status) for f in found] == [
        (1, "x", "library", "ok"),
        (1, "y", "thesis", "ok"),
        (2, "x", "library", "concave"),
        (3, "x", "library", "ok"),
    ]
    assert found[0].quantiles == {0.1: 20.0, 0.5: 50.0, 0.9: 90.0}
    assert (found[0].interval_level, found[0].tt_s, found[0].threshold_mm2) == (0.8, 50.0, 0.05)
    assert (found[1].interval_level, found[1].quantiles) == (None, {0.5: 50.0})
    assert (found[2].tt_s, found[2].quantiles) == (None, {})
    assert [(f.library_hash, f.map_hash, f.config_hash) for f in found] == [
        ("l1", "m1", "c1"),
        (None, "m2", "c1"),
        (None, "m1", "c1"),
        (None, None, "c2"),
    ]
    assert [(f.dated, f.data_until) for f in found] == [(True, 86400.0), (True, 86400.0), (False, 20.0), (False, 30.0)]
    assert all(f.issued_utc is not None and began <= f.issued_utc <= time.time() for f in found)


def test_quantiles_that_are_listed_take_precedence() -> None:
    found = values({**BODY, **INTERVAL, "quantiles_s": {"0.25": 30.0, "0.05": 15.0, "0.5": 50.0}})
    assert found["quantiles"] == '{"0.05": 15.0, "0.25": 30.0, "0.5": 50.0}'
    assert (found["interval_level"], found["data_until"], found["issued_utc"]) == (0.8, 7.0, None)


@pytest.mark.parametrize(
    ("said", "run", "expected"),
    [(0.9, 0.8, 0.9), (None, "0.8", 0.8), (None, "x: 0.7; y: 0.9", 0.7), (None, "", None), (None, None, None)],
)
def test_the_level_of_the_interval(said: float | None, run: Any, expected: float | None) -> None:
    found = values({**BODY, **INTERVAL, "interval": said}, {"interval_level": run})
    assert found["interval_level"] == expected
    assert len(found["quantiles"].split(",")) == (3 if expected else 1)


def test_a_duplicate_block_archives_nothing_twice(tmp_path: Path) -> None:
    with Store.open(tmp_path / "state.db", machine="m") as store:
        store.commit(block(1, BODY), {})
        assert store.commit(block(1, BODY), {}) == "duplicate"
        assert len(list(store.forecasts())) == 1


def old_store(path: Path, count: int) -> list[Record]:
    """A store as version 1 left it: forecasts with nothing beside their bodies."""
    records = [block(number, {**BODY, **INTERVAL, "tt_s": float(number)}) for number in range(1, count + 1)]
    with Store.open(path, machine="m") as store:
        store.describe(RUN)
        store.commit_many([(record, {}) for record in records])
    with closing(sqlite3.connect(path)) as connection, connection:
        for name in COLUMNS:
            connection.execute(f"ALTER TABLE forecasts DROP COLUMN {name}")
        connection.execute("UPDATE meta SET value = '1' WHERE key = 'schema_version'")
    return records


def test_a_store_of_the_first_version_is_completed_by_its_writer(tmp_path: Path) -> None:
    path = tmp_path / "state.db"
    records = old_store(path, 1203)
    with Store.open(path, read_only=True) as store:
        assert list(store.records()) == records
        with pytest.raises(StoreError, match=r"state\.db: its forecasts do not say"):
            next(store.forecasts())
    with Store.open(path, machine="m") as store:
        assert store.meta()["schema_version"] == str(STORE_VERSION)
        store.commit(block(1204, BODY), {})
        found = list(store.forecasts())
        assert list(store.records())[:-1] == records
    assert [f.block for f in found] == list(range(1, 1205))
    assert {(f.issued_utc, f.map_hash, f.config_hash) for f in found[:-1]} == {(None, "m1", "c1")}
    assert found[700].quantiles == {0.1: 20.0, 0.5: 701.0, 0.9: 90.0}
    assert found[700].data_until == 7010.0


def test_a_completion_that_fails_leaves_the_store_as_it_was(tmp_path: Path) -> None:
    path = tmp_path / "state.db"
    records = old_store(path, 3)
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.execute("CREATE TRIGGER full BEFORE UPDATE ON forecasts BEGIN SELECT RAISE(FAIL, 'no room'); END")
    with pytest.raises(StoreError, match="no room"):
        Store.open(path, machine="m")
    with Store.open(path, read_only=True) as store:
        assert store.meta()["schema_version"] == "1"
        assert list(store.records()) == records
