"""The tables of ``trends.db``: made, filled, read."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from models.errors import SpallwatchError
from monitor.records.trend_levels import LEVELS, Buckets
from monitor.records.trend_reading import Ledgered, Points

_VERSION = 1
_OUT_OF_ORDER = {"clock", "late", "out_of_order"}
# Series: a channel on one time axis, or, with the channel "", the blocks of a source that have no channel at all.
# Spans: numbers of the blocks of a source that came in the order of time, by stretch of the finest level; strays: the
# others. Both are kept with the series of the source, and lead from a range of time to its records in the store.
_SCHEMA = """
CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE series (
    id INTEGER PRIMARY KEY, source TEXT NOT NULL, channel TEXT NOT NULL, dated INTEGER NOT NULL,
    first REAL, last REAL, head INTEGER NOT NULL DEFAULT -1, head_sequence INTEGER NOT NULL DEFAULT 0,
    UNIQUE (source, channel, dated)
);
CREATE TABLE buckets (
    series INTEGER NOT NULL, level INTEGER NOT NULL, bucket INTEGER NOT NULL, records INTEGER NOT NULL, others TEXT,
    columns INTEGER NOT NULL, extremes BLOB NOT NULL, PRIMARY KEY (series, level, bucket)
) WITHOUT ROWID;
CREATE TABLE spans (
    series INTEGER NOT NULL, bucket INTEGER NOT NULL, first INTEGER NOT NULL, last INTEGER NOT NULL,
    PRIMARY KEY (series, bucket)
) WITHOUT ROWID;
CREATE TABLE strays (
    series INTEGER NOT NULL, time REAL NOT NULL, block INTEGER NOT NULL, PRIMARY KEY (series, time, block)
) WITHOUT ROWID;
"""
_COLUMNS = "bucket, records, others, columns, extremes"

Key = tuple[str, str, bool]


class DamagedError(SpallwatchError):
    """The trends are damaged, or of another version or store: they have to be made anew."""


class Series(NamedTuple):
    """A channel on one time axis.

    Attributes:
        id: number of its series.
        of_source: number of the series of its source, or None.
        dated: whether the axis is UTC.
        first, last: times of the first and the last record whose clock was believed, s.
        begin, end: range of time that holds all records.
    """

    id: int
    of_source: int
    dated: bool
    first: float
    last: float
    begin: float
    end: float


def is_damage(error: sqlite3.DatabaseError) -> bool:
    """Tell a damaged database, or one that lacks a table, from one that is locked or has no room."""
    return type(error) is sqlite3.DatabaseError or "no such" in str(error)


def open_for_writing(path: Path) -> sqlite3.Connection:
    """Open the trends, or make them.

    Raises:
        DamagedError: they are of another version.
    """
    connection = sqlite3.connect(path, isolation_level=None, timeout=5.0, check_same_thread=False)
    try:
        connection.execute("PRAGMA journal_mode = WAL")
        # A cache: after a power cut it may be older, but not damaged.
        connection.execute("PRAGMA synchronous = NORMAL")
        if not connection.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]:
            connection.execute("BEGIN IMMEDIATE")
            for statement in _SCHEMA.split(";"):
                if statement.strip():
                    connection.execute(statement)
            connection.execute("INSERT INTO meta VALUES ('version', ?)", (str(_VERSION),))
            connection.execute("COMMIT")
        if _meta(connection, "version") != str(_VERSION):
            raise DamagedError(f"version {_meta(connection, 'version')}, expected {_VERSION}")
    except BaseException:
        connection.close()
        raise
    return connection


def open_for_reading(path: Path) -> sqlite3.Connection | None:
    """Open the trends for reading; None where there are none of this version yet."""
    if not path.exists():
        return None
    connection = sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True, isolation_level=None, timeout=5.0)
    try:
        if connection.execute("SELECT count(*) FROM sqlite_master WHERE name = 'meta'").fetchone()[0] and _meta(
            connection, "version"
        ) == str(_VERSION):
            return connection
    except BaseException:
        connection.close()
        raise
    connection.close()
    return None


def remove(path: Path) -> None:
    """Remove the trends; whoever reads them goes on reading what was."""
    for suffix in ("", "-wal", "-shm"):
        path.with_name(path.name + suffix).unlink(missing_ok=True)


def _meta(connection: sqlite3.Connection, key: str) -> str | None:
    row = connection.execute("SELECT value FROM meta WHERE key = ?", (key,)).fetchone()
    return None if row is None else row[0]


def identity_of(store: sqlite3.Connection, path: Path) -> str:
    """Return what tells a store from one that takes its place later: its file, and its first block."""
    first = store.execute("SELECT id, source, sequence, content_hash FROM blocks ORDER BY id LIMIT 1").fetchone()
    return json.dumps([path.stat().st_ino, first])


class Known(NamedTuple):
    """What is in the trends: of which store, and number, source and sequence of its last block ([0] before any)."""

    identity: str | None
    last: list[Any]


def known_of(connection: sqlite3.Connection) -> Known:
    """Return what is in the trends."""
    return Known(_meta(connection, "identity"), json.loads(_meta(connection, "last") or "[0]"))


def holds(store: sqlite3.Connection, last: list[Any]) -> bool:
    """Tell whether a store has the last block of the trends."""
    found = store.execute("SELECT id, source, sequence FROM blocks WHERE id = ?", (last[0],)).fetchone()
    return list(found or ()) == last


def inode_of(path: Path) -> int | None:
    """Return the number of a file, or None where there is none."""
    try:
        return path.stat().st_ino
    except FileNotFoundError:
        return None


def write(
    connection: sqlite3.Connection, entries: list[Ledgered], parts: Mapping[Key, list[Points]], identity: str
) -> None:
    """Add blocks to the trends in one transaction.

    Args:
        connection: to the trends.
        entries: of the ledger, in its order.
        parts: what they say by source, channel and axis.
        identity: of the store that they are of.
    """
    connection.execute("BEGIN IMMEDIATE")
    try:
        numbers = {key: _series(connection, key) for key in _keys(entries, parts)}
        _write_places(connection, entries, numbers)
        _write_buckets(connection, {numbers[key]: points for key, points in parts.items()})
        newest = entries[-1]
        last = json.dumps([newest.id, newest.source, newest.sequence])
        connection.executemany("INSERT OR REPLACE INTO meta VALUES (?, ?)", (("last", last), ("identity", identity)))
        connection.execute("COMMIT")
    finally:
        if connection.in_transaction:
            connection.execute("ROLLBACK")


def _keys(entries: Iterable[Ledgered], parts: Iterable[Key]) -> list[Key]:
    return list(dict.fromkeys([*((entry.source, "", bool(entry.dated)) for entry in entries), *parts]))


def _series(connection: sqlite3.Connection, key: Key) -> int:
    connection.execute("INSERT OR IGNORE INTO series (source, channel, dated) VALUES (?, ?, ?)", key)
    query = "SELECT id FROM series WHERE source = ? AND channel = ? AND dated = ?"
    return connection.execute(query, key).fetchone()[0]


def _write_places(connection: sqlite3.Connection, entries: list[Ledgered], numbers: Mapping[Key, int]) -> None:
    """Note where in the store the blocks are to be found by their time."""
    heads: dict[int, tuple[int, int]] = {}
    spans: dict[tuple[int, int], list[int]] = {}
    strays: list[tuple[int, float, int]] = []
    times: dict[int, tuple[float, float]] = {}
    for entry in entries:
        series = numbers[entry.source, "", bool(entry.dated)]
        if series not in heads:
            query = "SELECT head, head_sequence FROM series WHERE id = ?"
            heads[series] = connection.execute(query, (series,)).fetchone()
        flags = set(entry.flags.split())
        if "clock" not in flags:
            low, high = times.get(series, (entry.time, entry.time))
            times[series] = (min(low, entry.time), max(high, entry.time))
        bucket = int(entry.time // LEVELS[0])
        head, head_sequence = heads[series]
        if flags & _OUT_OF_ORDER or bucket < head or entry.sequence <= head_sequence:
            strays.append((series, entry.time, entry.id))
            continue
        heads[series] = (bucket, entry.sequence)
        spans.setdefault((series, bucket), [entry.sequence, entry.sequence])[1] = entry.sequence
    connection.executemany("INSERT INTO strays VALUES (?, ?, ?)", strays)
    connection.executemany(
        "INSERT INTO spans VALUES (?, ?, ?, ?) ON CONFLICT DO UPDATE SET last = excluded.last",
        [(*key, *span) for key, span in spans.items()],
    )
    connection.executemany(
        "UPDATE series SET head = ?, head_sequence = ? WHERE id = ?", [(*head, key) for key, head in heads.items()]
    )
    connection.executemany(
        "UPDATE series SET first = min(coalesce(first, ?1), ?1), last = max(coalesce(last, ?2), ?2) WHERE id = ?3",
        [(*span, key) for key, span in times.items()],
    )


def _write_buckets(connection: sqlite3.Connection, said: Mapping[int, list[Points]]) -> None:
    """Join what blocks say, by series, with what is there, level by level."""
    parts = [(series, part) for series, points in said.items() for part in points]
    series = np.repeat(np.array([number for number, _ in parts], dtype=np.int64), [part.time.size for _, part in parts])
    time, values, status = (
        np.concatenate([getattr(part, name) for _, part in parts]) for name in ("time", "values", "status")
    )
    buckets = Buckets.of_records(series, time, values, status, LEVELS[0])
    query = f"SELECT series, {_COLUMNS} FROM buckets WHERE series = ? AND level = {{}} AND bucket = ?"
    for level, above in zip(LEVELS, (*LEVELS[1:], None), strict=True):
        keys = zip(buckets.series.tolist(), buckets.index.tolist(), strict=True)
        there = [row for key in keys for row in connection.execute(query.format(level), key)]
        joined = buckets.with_others(_buckets(there))
        connection.executemany(
            f"INSERT OR REPLACE INTO buckets (level, series, {_COLUMNS}) VALUES ({level}, ?, ?, ?, ?, ?, ?)",
            joined.to_rows(),
        )
        if above is not None:
            buckets = buckets.coarser(above // level)


def _buckets(rows: list[Any]) -> Buckets:
    try:
        return Buckets.from_rows(rows)
    except (TypeError, ValueError, IndexError) as error:
        raise DamagedError(str(error)) from error


def find_series(connection: sqlite3.Connection, source: str, channel: str, dated: bool | None) -> Series | None:
    """Return a channel on the axis asked for; without a wish, on the UTC axis if it has records there."""
    query = (
        "SELECT mine.id, theirs.id, mine.dated, theirs.first, theirs.last FROM series AS mine"
        " JOIN series AS theirs ON theirs.source = mine.source AND theirs.dated = mine.dated AND theirs.channel = ''"
        " WHERE mine.source = ? AND mine.channel = ? AND mine.dated >= ? AND mine.dated <= ? ORDER BY mine.dated DESC"
    )
    least, most = (0, 1) if dated is None else (int(dated), int(dated))
    found = connection.execute(query, (source, channel, least, most)).fetchone()
    if found is None:
        return None
    extremes = [
        row[0]
        for number in found[:2]
        for which in ("min", "max")
        for row in connection.execute(
            f"SELECT {which}(bucket) FROM buckets WHERE series = ? AND level = ?", (number, LEVELS[0])
        )
        if row[0] is not None
    ]
    begin, end = float(min(extremes) * LEVELS[0]), float((max(extremes) + 1) * LEVELS[0])
    first, last = (found[3], found[4]) if found[3] is not None else (begin, end)
    return Series(found[0], found[1], bool(found[2]), first, last, begin, end)


def count(connection: sqlite3.Connection, series: Series, level: int, since: float, until: float) -> int:
    """Return how many records the stretches of a level hold that a range of time touches."""
    query = "SELECT coalesce(sum(records), 0) FROM buckets WHERE series = ? AND level = ? AND bucket BETWEEN ? AND ?"
    return sum(
        connection.execute(query, (number, level, int(since // level), int(until // level))).fetchone()[0]
        for number in (series.id, series.of_source)
    )


def read(
    connection: sqlite3.Connection, series: Series, level: int, factor: int, since: float, until: float
) -> Buckets:
    """Return the stretches of a level that make up those, ``factor`` times as long, that a range of time touches."""
    first = int(since // (level * factor)) * factor
    last = (int(until // (level * factor)) + 1) * factor - 1
    # All as of one series: the blocks of the source that have no channel count for each of its channels.
    query = f"SELECT 0, {_COLUMNS} FROM buckets WHERE series = ? AND level = ? AND bucket BETWEEN ? AND ?"
    own, common = (
        _buckets(connection.execute(query, (number, level, first, last)).fetchall())
        for number in (series.id, series.of_source)
    )
    return own.with_others(common)


def places_in_store(
    connection: sqlite3.Connection, series: Series, since: float, until: float
) -> tuple[tuple[int, int] | None, list[int]]:
    """Return first and last number of the blocks in order, and the ledger numbers of the others, of a range of time."""
    first, last = connection.execute(
        "SELECT min(first), max(last) FROM spans WHERE series = ? AND bucket BETWEEN ? AND ?",
        (series.of_source, int(since // LEVELS[0]), int(until // LEVELS[0])),
    ).fetchone()
    strays = connection.execute(
        "SELECT block FROM strays WHERE series = ? AND time BETWEEN ? AND ?", (series.of_source, since, until)
    )
    return None if first is None else (first, last), [row[0] for row in strays]
