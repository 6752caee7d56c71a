"""Read a store beside its writer: connections that are lent, queries with a time limit, latest values, counts."""

from __future__ import annotations

import sqlite3
import threading
import time
from collections import Counter, deque
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from monitor.records.database import APPLICATION_ID, STORE_VERSION, Readable, open_beside, refuse_unsuitable
from monitor.records.failures import DATABASE_ERRORS, StoreError, error_text
from monitor.records.queries import LedgerBlock, blocks_after, newest_id, newest_values

_MAX_IDLE = 4
_MAX_LOAN_S = 10.0
_INSTRUCTIONS = 10_000
NAMES = (
    *("rms", "velocity_rms", "h_or", "v_eq", "v_eq_lower", "v_eq_upper", "v_eq_relative"),
    *("tt", "tt_lower", "tt_upper", "p_threshold", "speed"),
)
_STEP_BLOCKS = 20_000
_MAX_LISTED = 1000


class StoreReader(Readable):
    """The store of a machine, read from any thread; it may be missing, damaged or replaced at any time."""

    def __init__(self, path: Path, max_loan_s: float = _MAX_LOAN_S) -> None:
        """Keep the path of ``state.db``; queries end after ``max_loan_s`` of a loan."""
        self.path, self._max_loan_s = path, max_loan_s
        self._lock = threading.Lock()
        self._idle: list[sqlite3.Connection] = []
        self._file: tuple[int, int] | None = None

    @contextmanager
    def connection(self) -> Iterator[sqlite3.Connection]:
        """Lend a connection to one thread; StoreError where the store cannot be read, or not in time."""
        connection, file = self._take()
        until = time.monotonic() + self._max_loan_s
        connection.set_progress_handler(lambda: time.monotonic() > until, _INSTRUCTIONS)
        try:
            yield connection
        except DATABASE_ERRORS as error:
            connection.close()
            late = time.monotonic() > until
            raise StoreError(f"{self.path}: {'reading takes too long' if late else error_text(error)}") from error
        except BaseException:
            connection.close()
            raise
        connection.set_progress_handler(None, 0)
        with self._lock:
            if file == self._file and len(self._idle) < _MAX_IDLE:
                self._idle.append(connection)
                return
        connection.close()

    def close(self) -> None:
        """Close the connections that are not lent."""
        with self._lock:
            idle, self._idle, self._file = self._idle, [], None
        for connection in idle:
            connection.close()

    def identity(self) -> tuple[int, int] | None:
        """Return device and inode of the file, or None where there is none."""
        try:
            found = self.path.stat()
        except OSError:
            return None
        return found.st_dev, found.st_ino

    def _take(self) -> tuple[sqlite3.Connection, tuple[int, int] | None]:
        file = self.identity()
        with self._lock:
            # An open connection would go on reading a store that was replaced.
            old = self._idle if file != self._file else []
            if old:
                self._idle = []
            self._file = file
            found = self._idle.pop() if self._idle else None
        for connection in old:
            connection.close()
        return (found if found is not None else _open(self.path)), file


def _open(path: Path) -> sqlite3.Connection:
    """Open a store for reading; the connection may go from thread to thread, one at a time."""
    refuse_unsuitable(path, create=False, look_inside=False)
    connection = open_beside(path, "ro", timeout=2.0)
    try:
        kind = connection.execute("PRAGMA application_id").fetchone()[0]
        version = connection.execute("SELECT value FROM meta WHERE key = 'schema_version'").fetchone()
    except sqlite3.Error as error:
        connection.close()
        raise StoreError(f"{path}: {error}") from error
    if kind != APPLICATION_ID or version is None or not version[0].isdigit() or int(version[0]) > STORE_VERSION:
        connection.close()
        raise StoreError(f"{path}: is not a store that this version of the program can read")
    return connection


class LatestValues:
    """Values in the latest record of each source that has any, SI; may be used from any thread."""

    def __init__(self, store: StoreReader) -> None:
        """Keep the store."""
        self._store = store
        self._lock = threading.Lock()
        self._newest: tuple[object, int] | None = None
        self._values: dict[str, dict[str, dict[str, float]]] = {}

    def of(self, sources: Mapping[str, list[str]]) -> Mapping[str, Mapping[str, Mapping[str, float]]]:
        """Return the values by source, channel and name, of channels by source; StoreError where it cannot be read."""
        with self._lock:
            place = self._store.identity(), newest_id(self._store)
            if place != self._newest:
                self._values = {name: newest_values(self._store, name, NAMES, sources[name]) for name in sources}
                self._newest = self._store.identity(), place[1]
            return self._values


class LedgerTally:
    """Counts by source and status, and the latest blocks that were not ``ok``; may be used from any thread."""

    def __init__(self, store: StoreReader) -> None:
        """Keep the store; nothing is counted yet."""
        self._store = store
        self._lock = threading.Lock()
        self._file: tuple[int, int] | None = None
        self._begin()

    def _begin(self) -> None:
        self._last = 0
        self._counts: Counter[tuple[str, str]] = Counter()
        self._others: deque[LedgerBlock] = deque(maxlen=_MAX_LISTED)
        self.complete = False

    def update(self) -> bool:
        """Count some blocks; return whether there are more. StoreError where the store cannot be read."""
        with self._lock:
            file = self._store.identity()
            if file != self._file:
                self._file = file
                self._begin()
            rows = blocks_after(self._store, self._last, _STEP_BLOCKS)
            for block in rows:
                self._counts[block.source, block.status] += 1
                self._last = block.id
                if block.status != "ok":
                    self._others.append(block)
            self.complete = len(rows) < _STEP_BLOCKS
            return not self.complete

    def counts(self, source: str | None = None) -> dict[str, int]:
        """Return the number of blocks by status, of one source or of all."""
        found: Counter[str] = Counter()
        with self._lock:
            for (name, status), number in self._counts.items():
                if source in (None, name):
                    found[status] += number
        return dict(sorted(found.items()))

    def by_source(self) -> Mapping[tuple[str, str], int]:
        """Return the number of blocks by source and status."""
        with self._lock:
            return dict(self._counts)

    def others(self, limit: int, source: str | None = None) -> list[LedgerBlock]:
        """Return the latest blocks that were not ``ok``, the newest first."""
        with self._lock:
            found = [block for block in reversed(self._others) if source in (None, block.source)]
        return found[:limit]
