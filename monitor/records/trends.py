"""Trends of a life at once: least and largest value of each feature over stretches of time, made from the store.

``trends.db`` beside the store is a cache. It is brought up to date block after block, in the order of the ledger, by
one writer; where it is damaged, of another version or of another store, it is made anew. Readers need no writer.
"""

from __future__ import annotations

import sqlite3
import threading
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

from monitor.health.schema import STATUSES
from monitor.records import trend_tables as tables
from monitor.records.database import StoreError
from monitor.records.locks import let_go, take_lock
from monitor.records.trend_levels import FEATURES, LEVELS, Array, Buckets, Whole
from monitor.records.trend_reading import Layouts, Points, blocks_between, points_between, points_of, read_after

__all__ = ["FEATURES", "LEVELS", "TrendTable", "Trends"]

_FINE = 12
"""Most stretches that are read for each one that is given."""
_MOST_RECORDS = 20_000
"""Most records that are read for one answer."""
_SHORT = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 15.0, 20.0, 30.0)
_NICE = (1, 2, 3, 4, 5, 6, 10, 12, 15, 20, 30)


@dataclass(frozen=True, eq=False)
class TrendTable:
    """Trends of one channel over a range of time; n rows in the order of time.

    Attributes:
        dated: whether times are UTC seconds since 1970; else they count from the first block.
        resolution: length of the stretch that a row is of, s, or None where each row is a record.
        time: begin of the stretch, or time of the record, s, shape (n,). Stretches without a record are left out.
        low: least value of each feature (``FEATURES``), SI, NaN where there is none, shape (n,).
        high: likewise the largest; where rows are records, the same as ``low``.
        records: how many there are in each row, shape (n,).
        counts: how many are of which status, by status, shape (n,); only statuses that occur.
        blocks: number of the block in its source where rows are records, shape (n,), else None.
        first: time of the first record of the source whose clock was believed, or None.
        last: time of the last.
    """

    dated: bool
    resolution: float | None
    time: Array
    low: Mapping[str, Array]
    high: Mapping[str, Array]
    records: Whole
    counts: Mapping[str, Whole]
    blocks: Whole | None = None
    first: float | None = None
    last: float | None = None


class Trends:
    """The trends of one store; its methods may be called from any thread, and raise :class:`StoreError`."""

    def __init__(self, path: Path, store: Path) -> None:
        """Name the files; nothing is opened yet.

        Args:
            path: ``trends.db``, which is made where it is missing.
            store: the store, which is read only.
        """
        self._path, self._store = Path(path), Path(store)
        self._layouts = Layouts()
        self._writing = threading.Lock()
        self._lock: int | None = None
        self._writer: sqlite3.Connection | None = None
        self._inode: int | None = None
        self._suspect = False
        self._known_store: int | None = None

    def update(self, most_blocks: int = 2000) -> bool:
        """Take the next blocks of the store; return whether there are more.

        Where another process keeps the trends up to date, nothing is done.

        Args:
            most_blocks: at most so many.

        Raises:
            StoreError: the store cannot be read, or the trends not be written.
        """
        with self._writing, self._errors(self._path):
            if self._lock is None:
                self._lock = take_lock(self._path)
            if self._lock is None:
                return False
            try:
                return self._update(most_blocks)
            except tables.DamagedError:
                self._begin_anew()
            except sqlite3.DatabaseError as error:
                if not tables.is_damage(error):
                    raise
                self._begin_anew()
            return True

    def _update(self, most_blocks: int) -> bool:
        if self._suspect:
            raise tables.DamagedError("a reader found it damaged")
        if self._writer is not None and tables.inode_of(self._path) != self._inode:
            # Somebody removed the file.
            self._writer.close()
            self._writer = None
        if self._writer is None:
            self._writer = tables.open_for_writing(self._path)
            self._inode = tables.inode_of(self._path)
        known = tables.known_of(self._writer)
        with self._errors(self._store), closing(self._open_store()) as store:
            identity = tables.identity_of(store, self._store)
            same = not known.last[0] or (known.identity == identity and tables.holds(store, known.last))
            entries, rows, more = read_after(store, known.last[0], most_blocks if same else 0)
            parts: dict[tuple[str, str, bool], list[Points]] = {}
            for key, points in points_of(store, self._layouts, entries, rows):
                parts.setdefault(key, []).append(points)
        if not same:
            raise tables.DamagedError("of another store")
        if entries:
            tables.write(self._writer, entries, parts, identity)
        return more

    def _begin_anew(self) -> None:
        if self._writer is not None:
            self._writer.close()
            self._writer = None
        self._suspect = False
        tables.remove(self._path)

    def behind(self) -> int:
        """Return how many blocks of the store are not in the trends yet, about: its numbers have gaps."""
        with self._errors(self._store), closing(self._open_store()) as store:
            newest = store.execute("SELECT coalesce(max(id), 0) FROM blocks").fetchone()[0]
        with self._reader() as reader:
            return newest - (0 if reader is None else tables.known_of(reader).last[0])

    def query(
        self,
        source: str,
        channel: str,
        since: float | None = None,
        until: float | None = None,
        points: int = 1000,
        *,
        dated: bool | None = None,
    ) -> TrendTable:
        """Return the trends of a channel over a range of time.

        Where there are few records, each is a row. Otherwise rows are stretches, and the first and the last of them may
        reach beyond the range: their extremes are those of the whole stretch.

        Args:
            source: name of the source.
            channel: name of the channel.
            since: begin of the range, s, or None for the first record.
            until: end of the range, s, which belongs to it, or None for the last record.
            points: at most so many rows; at least 2.
            dated: whether the times are UTC, or None: if there are any such.

        Raises:
            StoreError: store or trends cannot be read.
        """
        points = max(points, 2)
        with self._reader() as reader:
            found = None if reader is None else tables.find_series(reader, source, channel, dated)
            if reader is None or found is None:
                return _table(bool(dated), None, _no_points())
            first, last = found.first, found.last
            since = max(found.begin, first if since is None else since)
            until = min(found.end, last if until is None else until)
            if not since <= until:
                return _table(found.dated, None, _no_points(), first=first, last=last)
            level = next((level for level in LEVELS if _number(level, since, until) <= _FINE * points), LEVELS[-1])
            total = tables.count(reader, found, level, since, until)
            length = next((item for item in _SHORT if _number(item, since, until) <= points), None)
            if total <= points or (length is not None and total <= _MOST_RECORDS):
                records, blocks = self._records(reader, found, source, channel, since, until)
                if records.time.size <= points:
                    return _table(found.dated, None, records, blocks, first=first, last=last)
                if length is not None:
                    buckets = Buckets.of_records(
                        np.zeros_like(records.status), records.time, records.values, records.status, length
                    )
                    return _bucket_table(found.dated, length, buckets, first, last)
            factor = _factor(level, since, until, points)
            buckets = tables.read(reader, found, level, factor, since, until)
            return _bucket_table(found.dated, float(level * factor), buckets.coarser(factor), first, last)

    def _records(
        self, reader: sqlite3.Connection, found: tables.Series, source: str, channel: str, since: float, until: float
    ) -> tuple[Points, Whole]:
        sequences, others = tables.places_in_store(reader, found, since, until)
        with self._errors(self._store), closing(self._open_store()) as store:
            entries = blocks_between(store, source, found.dated, since, until, sequences, others)
            return points_between(store, self._layouts, entries, channel)

    def _open_store(self) -> sqlite3.Connection:
        inode = tables.inode_of(self._store)
        if inode != self._known_store:
            # Another store has taken its place, and numbers its layouts anew.
            self._layouts.forget()
            self._known_store = inode
        return sqlite3.connect(f"{self._store.absolute().as_uri()}?mode=ro", uri=True, timeout=5.0)

    @contextmanager
    def _reader(self) -> Iterator[sqlite3.Connection | None]:
        """Open the trends for one answer, in one moment of them; None where there are none yet."""
        with self._errors(self._path):
            try:
                reader = tables.open_for_reading(self._path)
                if reader is None:
                    yield None
                    return
                with closing(reader):
                    reader.execute("BEGIN")
                    yield reader
            except tables.DamagedError:
                self._suspect = True
                raise
            except sqlite3.DatabaseError as error:
                self._suspect = self._suspect or tables.is_damage(error)
                raise

    @contextmanager
    def _errors(self, path: Path) -> Iterator[None]:
        try:
            yield
        except (tables.DamagedError, sqlite3.Error, OSError, ValueError, LookupError) as error:
            raise StoreError(f"{path}: {error}") from error

    def close(self) -> None:
        """Close what :meth:`update` opened, and let another writer in; closing twice does nothing."""
        with self._writing:
            if self._writer is not None:
                self._writer.close()
            let_go(self._lock)
            self._writer = self._lock = None

    def __enter__(self) -> Self:
        """Return the trends themselves."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the trends."""
        self.close()


def _number(length: float, since: float, until: float) -> int:
    """Return how many stretches a range of time touches."""
    return int(until // length) - int(since // length) + 1


def _factor(level: int, since: float, until: float, points: int) -> int:
    """Return how many stretches of a level make one row, so that there are no more rows than wanted."""
    factor = 1
    while _number(level * factor, since, until) > points:
        least = max(factor + 1, -(-_number(level, since, until) // (points + 1)))
        factor = next((nice for nice in _NICE if nice >= least), least)
    return factor


def _no_points() -> Points:
    return Points(np.empty(0), np.empty((0, len(FEATURES))), np.empty(0, dtype=np.int64))


def _by_feature(values: Array) -> dict[str, Array]:
    return {name: values[:, place] for place, name in enumerate(FEATURES)}


def _counts(counts: Whole) -> dict[str, Whole]:
    return {STATUSES[place]: counts[:, place] for place in np.flatnonzero(counts.any(axis=0))}


def _table(
    dated: bool,
    resolution: float | None,
    records: Points,
    blocks: Whole | None = None,
    *,
    first: float | None = None,
    last: float | None = None,
) -> TrendTable:
    values = _by_feature(records.values)
    counts = (records.status[:, None] == np.arange(len(STATUSES))).astype(np.int64)
    ones = np.ones(records.time.size, dtype=np.int64)
    if blocks is None:
        blocks = np.empty(0, dtype=np.int64)
    return TrendTable(dated, resolution, records.time, values, values, ones, _counts(counts), blocks, first, last)


def _bucket_table(dated: bool, length: float, buckets: Buckets, first: float, last: float) -> TrendTable:
    return TrendTable(
        dated=dated,
        resolution=length,
        time=buckets.index.astype(np.float64) * length,
        low=_by_feature(buckets.low),
        high=_by_feature(buckets.high),
        records=buckets.counts.sum(axis=1),
        counts=_counts(buckets.counts),
        first=first,
        last=last,
    )
