"""Rollup: least and greatest value of each trend feature over buckets of time, kept in the store itself.

The table ``rollup`` has one row a series, level and bucket. It is written in the transaction of a commit, for many
blocks at once: ``meta.rolled_up`` is the ledger number up to which blocks are in it. The newest blocks, and those of a
store that is still catching up, are read from their records instead (:mod:`monitor.records.trends`).
"""

from __future__ import annotations

import json
import sqlite3
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from monitor.health.schema import STATUSES
from monitor.records.points import ENTRY_QUERY, FEATURES, BlockEntry, Floats, Ints, Points, SeriesKey, points_by_series

LEVELS_S = (60, 600, 7200, 86400)
"""Widths of the buckets, s; each is a whole multiple of the one before."""
BATCH_BLOCKS = 64
"""Blocks that are committed before they are added to the table together."""
OPEN_BUDGET_S = 2.0
"""Time for catching up when a store is opened for writing."""

_COMMIT_BUDGET_S = 0.05
_CHUNK_BLOCKS = 256
MAX_TIME_S = 1e12
"""Later times, of a broken clock, count as this: their buckets would not be integers."""
_ROLLED_UP, _FEATURES = "rolled_up", "rollup_features"
_VALUES = "records, others, extremes"


@dataclass(frozen=True, eq=False)
class Buckets:
    """Extremes of n buckets of one width, of one or several series.

    Attributes:
        series: number of the series, shape (n,).
        index: start of the bucket over its width, shape (n,).
        low: least value of each feature, NaN where there is none, shape (n, feature).
        high: likewise the greatest.
        counts: records by status, in the order of ``STATUSES``, shape (n, status).
    """

    series: Ints
    index: Ints
    low: Floats
    high: Floats
    counts: Ints

    @classmethod
    def of_points(cls, points: Points, width: float, series: int = 0) -> Buckets:
        """Return the buckets of a width in which points lie; not joined yet."""
        counts = np.zeros((points.time.size, len(STATUSES)), dtype=np.int64)
        counts[np.arange(points.time.size), points.status] = 1
        index = np.floor_divide(np.clip(points.time, -MAX_TIME_S, MAX_TIME_S), width).astype(np.int64)
        return cls(np.full(index.size, series), index, points.values, points.values, counts)

    @classmethod
    def of_rows(cls, rows: Sequence[Any]) -> Buckets:
        """Return buckets from rows of series, index, records, other statuses than ok (JSON or None), extremes."""
        series, index, records = (np.array([row[place] for row in rows], dtype=np.int64) for place in range(3))
        extremes = np.frombuffer(b"".join(row[4] for row in rows), dtype="<f8").reshape(len(rows), 2, len(FEATURES))
        counts = np.zeros((len(rows), len(STATUSES)), dtype=np.int64)
        for place, row in enumerate(rows):
            if row[3] is not None:
                for status, number in json.loads(row[3]).items():
                    counts[place, STATUSES.index(status)] = number
        counts[:, 0] = records - counts[:, 1:].sum(axis=1)
        return cls(series, index, extremes[:, 0], extremes[:, 1], counts)

    def to_rows(self) -> Iterable[tuple[Any, ...]]:
        """Yield the rows that :meth:`of_rows` takes."""
        packed = np.stack([self.low, self.high], axis=1).astype("<f8")
        others: list[str | None] = [None] * self.index.size
        for place in np.flatnonzero(self.counts[:, 1:].any(axis=1)):
            counts = enumerate(self.counts[place].tolist())
            others[place] = json.dumps({STATUSES[status]: number for status, number in counts if status and number})
        records = self.counts.sum(axis=1).tolist()
        blobs = (extremes.tobytes() for extremes in packed)
        return zip(self.series.tolist(), self.index.tolist(), records, others, blobs, strict=True)

    def where(self, wanted: NDArray[np.bool_]) -> Buckets:
        """Return those of the buckets for which ``wanted``, shape (n,), is true."""
        return Buckets(*(getattr(self, field.name)[wanted] for field in fields(self)))


def joined(parts: Sequence[Buckets], factor: int = 1) -> Buckets:
    """Return the union of parts in buckets ``factor`` times as wide, in ascending order of series and index."""
    series, index, low, high, counts = (
        np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(Buckets)
    )
    index = index // factor
    if not index.size:
        return Buckets(series, index, low, high, counts)
    order = np.lexsort((index, series))
    series, index = series[order], index[order]
    starts = np.flatnonzero(np.append(True, (index[1:] != index[:-1]) | (series[1:] != series[:-1])))
    return Buckets(
        series[starts],
        index[starts],
        np.fmin.reduceat(low[order], starts, axis=0),
        np.fmax.reduceat(high[order], starts, axis=0),
        np.add.reduceat(counts[order], starts, axis=0),
    )


def rolled_up_to(connection: sqlite3.Connection) -> int:
    """Return the ledger number up to which blocks are in the table; 0 in a store of an older version."""
    row = connection.execute("SELECT value FROM meta WHERE key = ?", (_ROLLED_UP,)).fetchone()
    return int(row[0]) if row else 0


def check_features(connection: sqlite3.Connection) -> None:
    """Empty the table where it has the extremes of other features, within a transaction: it is then built anew."""
    row = connection.execute("SELECT value FROM meta WHERE key = ?", (_FEATURES,)).fetchone()
    if row is None or row[0] != " ".join(FEATURES):
        connection.execute("DELETE FROM rollup")
        values = ((_FEATURES, " ".join(FEATURES)), (_ROLLED_UP, "0"))
        connection.executemany("INSERT OR REPLACE INTO meta VALUES (?, ?)", values)


def roll_up(connection: sqlite3.Connection, budget_s: float = _COMMIT_BUDGET_S) -> None:
    """Add new blocks to the table within a transaction of the writer, while they are a batch and for ``budget_s``."""
    (newest,) = connection.execute("SELECT coalesce(max(id), 0) FROM blocks").fetchone()
    last = rolled_up_to(connection)
    end = time.monotonic() + budget_s
    while newest - last >= BATCH_BLOCKS:
        query = f"{ENTRY_QUERY} WHERE id > ? ORDER BY id LIMIT ?"
        entries = [BlockEntry(*row) for row in connection.execute(query, (last, _CHUNK_BLOCKS))]
        if not entries:
            return
        query = "SELECT row FROM records WHERE block IN (SELECT value FROM json_each(?)) ORDER BY block"
        rows = [row for (row,) in connection.execute(query, (json.dumps([entry.id for entry in entries]),))]
        _add(connection, list(points_by_series(connection, entries, rows)))
        last = entries[-1].id
        connection.execute("INSERT OR REPLACE INTO meta VALUES (?, ?)", (_ROLLED_UP, str(last)))
        if time.monotonic() >= end:
            return


def _add(connection: sqlite3.Connection, parts: list[tuple[SeriesKey, Points]]) -> None:
    """Join points with the buckets of the table, level by level."""
    numbers = {key: number for number, key in enumerate(dict.fromkeys(key for key, _ in parts))}
    keys = list(numbers)
    buckets = joined([Buckets.of_points(points, LEVELS_S[0], numbers[key]) for key, points in parts])
    for level, above in zip(LEVELS_S, (*LEVELS_S[1:], None), strict=True):
        where = "source = ? AND channel = ? AND dated = ? AND level = ? AND bucket = ?"
        places = [
            (series, (*keys[series], level, index))
            for series, index in zip(buckets.series.tolist(), buckets.index.tolist(), strict=True)
        ]
        present = [
            (series, place[-1], *row)
            for series, place in places
            for row in connection.execute(f"SELECT {_VALUES} FROM rollup WHERE {where}", place)
        ]
        merged = joined([buckets, Buckets.of_rows(present)])
        connection.executemany(
            "INSERT OR REPLACE INTO rollup VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
            ((*place, *row[2:]) for (_, place), row in zip(places, merged.to_rows(), strict=True)),
        )
        if above is not None:
            buckets = joined([buckets], above // level)


def read_buckets(connection: sqlite3.Connection, key: SeriesKey, level: int, first: int, last: int) -> Buckets:
    """Return the buckets of a level from index ``first`` to ``last``; those of a channel and of blocks without any."""
    query = (
        f"SELECT 0, bucket, {_VALUES} FROM rollup"
        " WHERE source = ? AND channel IN (?, '') AND dated = ? AND level = ? AND bucket BETWEEN ? AND ?"
    )
    return Buckets.of_rows(connection.execute(query, (*key, level, first, last)).fetchall())
