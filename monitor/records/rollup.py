"""Rollup: least and greatest value of each trend feature over buckets of time, kept in the store itself.

The table ``rollup`` has one row a series, level and bucket. It is written in the transaction of a commit, for many
blocks at once: ``meta.rolled_up`` is the ledger number up to which blocks are in it. The newest blocks, and those of a
store that is still catching up, are read from their records instead (:mod:`monitor.records.trends`).
"""

from __future__ import annotations

import json
import sqlite3
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from monitor.health.schema import STATUSES
from monitor.records.packing import columns_of, numbers_of, places_of
from monitor.words.features import TRENDS

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

ENTRY_QUERY = """
SELECT id, source, sequence, status, day IS NOT NULL, axis_time, layout FROM blocks JOIN records ON block = id
"""
"""Selects the columns of :class:`BlockEntry`."""

FEATURES = tuple(feature.name for feature in TRENDS)
"""Names of the features whose extremes are kept, in their order in rows and buckets."""
_WANTED = (*FEATURES, "quality_status")
_STATUS_PLACES = {status: place for place, status in enumerate(STATUSES)}

LEVELS_S = (60, 600, 7200, 86400)
"""Widths of the buckets, s; each is a whole multiple of the one before."""
BATCH_BLOCKS = 64
"""Blocks that are committed before they are added to the table together."""
OPEN_BUDGET_S = 2.0
"""Time for catching up when a store is opened for writing."""

_COMMIT_BUDGET_S = 0.05
_CHUNK_BLOCKS = 256
_MAX_DROPPED = 240
"""Buckets of a series that one step deletes, where two hours have no more."""
MAX_TIME_S = 1e12
"""Later times, of a broken clock, count as this: their buckets would not be integers."""
_ROLLED_UP, _FEATURES = "rolled_up", "rollup_features"
_DROPPED = "rollup_dropped_{}_{}"
_VALUES = "records, others, extremes"


class BlockEntry(NamedTuple):
    """A row of ``ENTRY_QUERY``; ``time`` is in seconds on the dated or the undated axis."""

    id: int
    source: str
    sequence: int
    status: str
    dated: int
    time: float
    layout: int


class SeriesKey(NamedTuple):
    """A channel of a source on one axis; blocks without any channel have the channel ""."""

    source: str
    channel: str
    dated: bool


@dataclass(frozen=True, eq=False)
class Points:
    """The trend features of one channel in n blocks.

    Attributes:
        time: s, shape (n,).
        values: the ``FEATURES``, SI, NaN where absent, shape (n, feature).
        status: place of the channel's status in ``STATUSES``, shape (n,).
        sequence: number of the block in its source, shape (n,).
    """

    time: Floats
    values: Floats
    status: Ints
    sequence: Ints


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
    """Adapt a table with the extremes of other features, within a transaction.

    It is emptied and built anew from the records. Where blocks are condensed, their buckets cannot be: the table keeps
    the features that are still there, and new ones begin with the next blocks.
    """
    row = connection.execute("SELECT value FROM meta WHERE key = ?", (_FEATURES,)).fetchone()
    if row is not None and row[0] == " ".join(FEATURES):
        return
    if row is not None and connection.execute("SELECT 1 FROM identities LIMIT 1").fetchone():
        _convert(connection, row[0].split())
    else:
        connection.execute("DELETE FROM rollup")
        connection.execute("INSERT OR REPLACE INTO meta VALUES (?, '0')", (_ROLLED_UP,))
    connection.execute("INSERT OR REPLACE INTO meta VALUES (?, ?)", (_FEATURES, " ".join(FEATURES)))


def _convert(connection: sqlite3.Connection, features: Sequence[str]) -> None:
    """Bring the extremes of all buckets from other features to the present ones."""
    places = np.array([features.index(name) if name in features else -1 for name in FEATURES], dtype=np.intp)

    def convert(extremes: bytes) -> bytes:
        both = np.frombuffer(extremes, dtype="<f8").reshape(2, len(features))
        return columns_of(both, places).astype("<f8").tobytes()

    connection.create_function("converted", 1, convert, deterministic=True)
    connection.execute("UPDATE rollup SET extremes = converted(extremes)")


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


def drop_buckets(connection: sqlite3.Connection, level: int, until: float, *, dated: bool) -> int:
    """Delete the oldest buckets of a level that begin before ``until`` (s), within a transaction; return how many.

    Some hundreds of each series at most; the wider buckets over them stay, and :func:`dropped_before` says from when
    on there are such again.
    """
    where = "source = ? AND channel = ? AND dated = ? AND level = ?"
    series = [(*key, dated, level) for key in _series(connection)]
    first = [connection.execute(f"SELECT min(bucket) FROM rollup WHERE {where}", key).fetchone()[0] for key in series]
    oldest = min((bucket * level for bucket in first if bucket is not None), default=None)
    whole = LEVELS_S[2]
    if oldest is None or oldest >= (last := int(until // whole) * whole):
        return 0
    query = f"SELECT bucket FROM rollup WHERE {where} ORDER BY bucket LIMIT 1 OFFSET {_MAX_DROPPED}"
    beyond = [row[0] * level for key in series if (row := connection.execute(query, key).fetchone()) is not None]
    end = min(last, max((oldest // whole + 1) * whole, min(beyond, default=last) // whole * whole))
    count = 0
    for key in series:
        count += connection.execute(f"DELETE FROM rollup WHERE {where} AND bucket < ?", (*key, end // level)).rowcount
    end = max(end, dropped_before(connection, level, dated=dated))
    connection.execute("INSERT OR REPLACE INTO meta VALUES (?, ?)", (_DROPPED.format(level, int(dated)), repr(end)))
    return count


def dropped_before(connection: sqlite3.Connection, level: int, *, dated: bool) -> float:
    """Return the time before which a level has not all of its buckets, s; minus infinity where it has."""
    row = connection.execute("SELECT value FROM meta WHERE key = ?", (_DROPPED.format(level, int(dated)),)).fetchone()
    return float(row[0]) if row else -np.inf


def _series(connection: sqlite3.Connection) -> Iterator[tuple[str, str]]:
    """Yield source and channel of all rows, without reading them all."""
    query = "SELECT source, channel FROM rollup WHERE (source, channel) > (?, ?) ORDER BY source, channel LIMIT 1"
    found = connection.execute(f"{query.replace('> (?, ?)', '>= (?, ?)')}", ("", "")).fetchone()
    while found is not None:
        yield found
        found = connection.execute(query, found).fetchone()


def read_buckets(connection: sqlite3.Connection, key: SeriesKey, level: int, first: int, last: int) -> Buckets:
    """Return the buckets of a level from index ``first`` to ``last``; those of a channel and of blocks without any."""
    query = (
        f"SELECT 0, bucket, {_VALUES} FROM rollup"
        " WHERE source = ? AND channel IN (?, '') AND dated = ? AND level = ? AND bucket BETWEEN ? AND ?"
    )
    return Buckets.of_rows(connection.execute(query, (*key, level, first, last)).fetchall())


def read_points(connection: sqlite3.Connection, entries: Sequence[BlockEntry], channel: str) -> Points:
    """Return the points of one channel in the order of the entries, reading only its part of each row.

    Blocks with other channels only are left out; blocks without any channel count for every channel.
    """
    values = np.full((len(entries), len(_WANTED)), np.nan)
    known = np.zeros(len(entries), dtype=bool)
    by_layout: dict[int, list[int]] = {}
    for place, entry in enumerate(entries):
        by_layout.setdefault(entry.layout, []).append(place)
    for layout, members in by_layout.items():
        channels = _places(connection, layout)
        if channel in channels:
            values[members] = _row_parts(connection, [entries[place].id for place in members], channels[channel])
        known[members] = not channels or channel in channels
    return _points([entry for entry, wanted in zip(entries, known, strict=True) if wanted], values[known])


def points_by_series(
    connection: sqlite3.Connection, entries: Sequence[BlockEntry], rows: Sequence[bytes]
) -> Iterator[tuple[SeriesKey, Points]]:
    """Yield the points of all channels; ``rows`` are the packed rows of the entries."""
    alike: dict[tuple[str, int, int], list[int]] = {}
    for place, entry in enumerate(entries):
        alike.setdefault((entry.source, entry.dated, entry.layout), []).append(place)
    for (source, dated, layout), members in alike.items():
        group = [entries[place] for place in members]
        numbers = numbers_of(b"".join(rows[place] for place in members)).reshape(len(members), -1)
        channels = _places(connection, layout) or {"": np.full(len(_WANTED), -1, dtype=np.intp)}
        for channel, places in channels.items():
            yield SeriesKey(source, channel, bool(dated)), _points(group, columns_of(numbers, places))


def _places(connection: sqlite3.Connection, layout: int) -> dict[str, NDArray[np.intp]]:
    (text,) = connection.execute("SELECT layout FROM layouts WHERE id = ?", (layout,)).fetchone()
    return places_of(text, _WANTED)


def _points(entries: Sequence[BlockEntry], values: Floats) -> Points:
    """Separate the channel's status, which overrides that of the block, from the features."""
    statuses = np.array([_STATUS_PLACES[entry.status] for entry in entries], dtype=np.int64)
    own = values[:, -1]
    return Points(
        time=np.array([entry.time for entry in entries], dtype=np.float64),
        values=values[:, :-1],
        status=np.where(np.isnan(own), statuses, np.nan_to_num(own)).astype(np.int64),
        sequence=np.array([entry.sequence for entry in entries], dtype=np.int64),
    )


def _row_parts(connection: sqlite3.Connection, blocks: Sequence[int], places: NDArray[np.intp]) -> Floats:
    """Return the numbers at places of the rows of blocks of one layout, shape (block, place)."""
    present = places[places >= 0]
    if not present.size:
        return np.full((len(blocks), places.size), np.nan)
    first, last = int(present.min()), int(present.max())
    query = "SELECT block, substr(row, ?, ?) FROM records WHERE block IN (SELECT value FROM json_each(?))"
    parts = dict(connection.execute(query, (8 * first + 1, 8 * (last - first + 1), json.dumps(blocks))))
    numbers = numbers_of(b"".join(parts[block] for block in blocks)).reshape(len(blocks), -1)
    return columns_of(numbers, np.where(places >= 0, places - first, -1))
