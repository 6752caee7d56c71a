"""Trends of a channel: each record of a short range of time, or the extremes of each bucket of a long one."""

from __future__ import annotations

import sqlite3
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from monitor.health.schema import STATUSES
from monitor.records.condense import condensed_span
from monitor.records.database import Readable
from monitor.records.rollup import (
    ENTRY_QUERY,
    FEATURES,
    LEVELS_S,
    MAX_TIME_S,
    BlockEntry,
    Buckets,
    Floats,
    Ints,
    Points,
    SeriesKey,
    dropped_before,
    joined,
    read_buckets,
    read_points,
    rolled_up_to,
)

_MAX_FINE_BUCKETS = 12
"""Buckets that are read for each one that is returned."""
_MAX_RECORDS = 20_000
"""Records that are read for one answer."""
_SHORT_WIDTHS_S = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 15.0, 20.0, 30.0)
"""Widths of the buckets that are made of records, which are read for them."""
_FACTORS = (1, 2, 3, 4, 5, 6, 10, 12, 15, 20, 30)
# The expressions of the index blocks_by_time (monitor.records.database); with others, the index is not used.
_ON_AXIS = "source = ? AND (day IS NULL) = ? AND (instr(flags, 'clock') > 0)"


@dataclass(frozen=True, eq=False)
class TrendTable:
    """Trends of one channel over a range of time; n rows in the order of time.

    Attributes:
        dated: whether times are UTC seconds since 1970; else they count from the first block.
        resolution: width of the buckets, s, or None where each row is a record.
        time: start of the bucket, or time of the record, s, shape (n,). Empty buckets are left out.
        low: least value of each feature, SI, NaN where there is none, shape (n,).
        high: likewise the greatest; the same object as ``low`` where rows are records.
        records: number of records of each row, shape (n,).
        counts: number of records by status, shape (n,) each; only statuses that occur.
        blocks: number of the block in its source where rows are records, shape (n,), else None.
        first, last: times of the first and the last block of the source without the flag ``clock``, or None.
        complete: whether buckets hold all blocks; where they do not, a store of an older version is still catching up,
            and a part of the records stands for the rest.
    """

    dated: bool
    resolution: float | None
    time: Floats
    low: Mapping[str, Floats]
    high: Mapping[str, Floats]
    records: Ints
    counts: Mapping[str, Ints]
    blocks: Ints | None = None
    first: float | None = None
    last: float | None = None
    complete: bool = True

    @classmethod
    def of_points(
        cls, points: Points, *, dated: bool, first: float | None = None, last: float | None = None
    ) -> TrendTable:
        """Return a table in which each record is a row."""
        values = _by_feature(points.values)
        counts = _by_status((points.status[:, None] == np.arange(len(STATUSES))).astype(np.int64))
        ones = np.ones(points.time.size, dtype=np.int64)
        return cls(dated, None, points.time, values, values, ones, counts, points.sequence, first, last)


@dataclass(frozen=True)
class _Span:
    """Range of time of an answer, first and last time of the source, and last time without full records, s."""

    since: float
    until: float
    first: float
    last: float
    condensed: float = -np.inf

    def buckets(self, width: float) -> int:
        """Return how many buckets of a width the range touches."""
        return int(self.until // width) - int(self.since // width) + 1


def read_trends(
    store: Readable,
    key: SeriesKey,
    since: float | None = None,
    until: float | None = None,
    points: int = 1000,
) -> TrendTable:
    """Return the trends of a channel over a range of time.

    Where there are few records, each is a row. Otherwise rows are buckets; those of a minute and more are whole buckets
    even where they reach beyond the range.

    Args:
        store: outside a transaction.
        key: the channel.
        since, until: ends of the range, s, inclusive, or None for the first or last record.
        points: greatest number of rows; at least 2.
    """
    # One snapshot: a commit may move blocks from the tail to the rollup meanwhile.
    with store.connection() as connection:
        connection.execute("BEGIN")
        try:
            return _read(connection, key, since, until, max(points, 2))
        finally:
            connection.execute("ROLLBACK")


def _read(
    connection: sqlite3.Connection, key: SeriesKey, since: float | None, until: float | None, points: int
) -> TrendTable:
    span = _span(connection, key, since, until)
    if span is None or span.since > span.until:
        first, last = (None, None) if span is None else (span.first, span.last)
        return TrendTable.of_points(read_points(connection, (), key.channel), dated=key.dated, first=first, last=last)
    if span.since <= span.condensed:
        # What is left of the records there is not all of them.
        return _buckets(connection, key, span, points)
    width = next((width for width in _SHORT_WIDTHS_S if span.buckets(width) <= points), None)
    limit = points if width is None else max(points, _MAX_RECORDS)
    if _has_at_most(connection, key, span, limit):
        records = _records(connection, key, span)
        if width is None or records.time.size <= points:
            return TrendTable.of_points(records, dated=key.dated, first=span.first, last=span.last)
        return _table(key.dated, width, joined([Buckets.of_points(records, width)]), span)
    return _buckets(connection, key, span, points)


def _span(connection: sqlite3.Connection, key: SeriesKey, since: float | None, until: float | None) -> _Span | None:
    """Cut a range of time to that of the source's blocks; None where it has no block on this axis."""
    ends: list[float] = []
    for pick in (min, max):
        query = f"SELECT {pick.__name__}(axis_time) FROM blocks WHERE {_ON_AXIS} = ?"
        found = [connection.execute(query, (key.source, not key.dated, clock)).fetchone()[0] for clock in (0, 1)]
        present = [time for time in found if time is not None]
        if not present:
            return None
        # Blocks with the flag "clock" do not move the ends, but can be asked for.
        ends += [present[0], max(-MAX_TIME_S, min(pick(present), MAX_TIME_S))]
    first, begin, last, end = ends
    condensed = condensed_span(connection, key.source, dated=key.dated)
    if condensed is not None:
        first, last = min(first, condensed[0]), max(last, condensed[1])
        begin, end = min(begin, first), max(end, last)
    since, until = max(begin, first if since is None else since), min(end, last if until is None else until)
    return _Span(since, until, first, last, -np.inf if condensed is None else condensed[1])


def _has_at_most(connection: sqlite3.Connection, key: SeriesKey, span: _Span, limit: int) -> bool:
    """Return whether the source has no more than so many blocks in a range."""
    inside = f"SELECT 1 FROM blocks WHERE {_ON_AXIS} IN (0, 1) AND axis_time BETWEEN ? AND ? LIMIT ?"
    values = (key.source, not key.dated, span.since, span.until, limit + 1)
    return connection.execute(f"SELECT count(*) FROM ({inside})", values).fetchone()[0] <= limit


def _records(connection: sqlite3.Connection, key: SeriesKey, span: _Span) -> Points:
    """Return the records of a range in the order of time."""
    query = f"{ENTRY_QUERY} WHERE {_ON_AXIS} IN (0, 1) AND axis_time BETWEEN ? AND ? ORDER BY axis_time, id"
    rows = connection.execute(query, (key.source, not key.dated, span.since, span.until))
    return read_points(connection, [BlockEntry(*row) for row in rows], key.channel)


def _newer(connection: sqlite3.Connection, key: SeriesKey, block: int) -> tuple[Points, bool]:
    """Return the records after a ledger number, and whether they are all: of too many, each n-th is read.

    A store of an older version that no daemon has opened has no rollup, and shows its long ranges in this way.
    """
    (newest,) = connection.execute("SELECT coalesce(max(id), 0) FROM blocks").fetchone()
    step = max(1, -(-(newest - block) // _MAX_RECORDS))
    query = f"{ENTRY_QUERY} WHERE id > ? AND +source = ? AND (day IS NULL) = ? AND sequence % ? = 0 ORDER BY id"
    rows = connection.execute(query, (block, key.source, not key.dated, step))
    return read_points(connection, [BlockEntry(*row) for row in rows], key.channel), step == 1


def _buckets(connection: sqlite3.Connection, key: SeriesKey, span: _Span, points: int) -> TrendTable:
    """Return no more than ``points`` whole buckets, from those of a level that are a few times as narrow."""
    whole = [level for level in LEVELS_S if dropped_before(connection, level, dated=key.dated) <= span.since]
    level = next((level for level in whole if span.buckets(level) <= _MAX_FINE_BUCKETS * points), LEVELS_S[-1])
    factor = _factor(level, span, points)
    first = int(span.since // (level * factor)) * factor
    last = (int(span.until // (level * factor)) + 1) * factor - 1
    rolled_up = rolled_up_to(connection)
    points_after, complete = _newer(connection, key, rolled_up)
    newer = Buckets.of_points(points_after, level)
    parts = [newer.where((newer.index >= first) & (newer.index <= last))]
    if rolled_up:
        parts.append(read_buckets(connection, key, level, first, last))
    return _table(key.dated, float(level * factor), joined(parts, factor), span, complete=complete)


def _factor(level: int, span: _Span, points: int) -> int:
    """Return how many buckets of a level make one row, so that there are no more rows than wanted."""
    factor = 1
    while span.buckets(level * factor) > points:
        least = max(factor + 1, -(-span.buckets(level) // (points + 1)))
        factor = next((item for item in _FACTORS if item >= least), least)
    return factor


def _table(dated: bool, width: float, buckets: Buckets, span: _Span, *, complete: bool = True) -> TrendTable:
    return TrendTable(
        dated=dated,
        resolution=width,
        time=buckets.index.astype(np.float64) * width,
        low=_by_feature(buckets.low),
        high=_by_feature(buckets.high),
        records=buckets.counts.sum(axis=1),
        counts=_by_status(buckets.counts),
        first=span.first,
        last=span.last,
        complete=complete,
    )


def _by_feature(values: Floats) -> dict[str, Floats]:
    return {name: values[:, place] for place, name in enumerate(FEATURES)}


def _by_status(counts: Ints) -> dict[str, Ints]:
    return {STATUSES[place]: counts[:, place] for place in np.flatnonzero(counts.any(axis=0))}
