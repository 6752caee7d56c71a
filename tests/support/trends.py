"""Makers and checks that tests of trends share."""

from __future__ import annotations

import sqlite3
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import strategies as st

from monitor.health.record import Record
from monitor.records.database import SharedConnection
from monitor.records.rollup import FEATURES, LEVELS_S, SeriesKey, rolled_up_to
from monitor.records.store import Store
from monitor.records.trends import TrendTable, read_trends
from tests.oracles.trends_oracle import Said, extremes, stretches

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
        # A bucket narrower than the finest level is made of the records of the range, longer ones are whole.
        inside = [item for item in said if length >= LEVELS_S[0] or since <= item.time <= until]
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


MOMENTS = st.floats(0, 200) | st.sampled_from((0.0, 59.99999999999999, 60.0, 600.0, 7200.0, DAY)) | st.floats(0, 4e6)


def query(
    folder: Path,
    source: str,
    channel: str,
    since: float | None = None,
    until: float | None = None,
    points: int = 1000,
    *,
    dated: bool = True,
) -> TrendTable:
    """Ask beside the writer, as the page does."""
    with SharedConnection(folder / "state.db") as store:
        return read_trends(store, SeriesKey(source, channel, dated), since, until, points)


def rolled_up(folder: Path) -> int:
    with closing(sqlite3.connect(folder / "state.db")) as connection:
        return rolled_up_to(connection)


def filled(folder: Path, made: list[Record]) -> Store:
    store = Store.open(folder / "state.db", machine="m")
    store.commit_many([(record, {}) for record in made])
    return store
