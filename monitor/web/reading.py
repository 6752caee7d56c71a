"""Reading a store beside its writer: connections that are lent, and queries that end in time."""

from __future__ import annotations

import sqlite3
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from monitor.records.database import APPLICATION_ID, STORE_VERSION, StoreError, refuse_unsuitable

_MOST_IDLE = 4
_LONGEST = 10.0
_INSTRUCTIONS = 10_000


class StoreReader:
    """The store of a machine, read from any thread; it may be missing, damaged or replaced at any time."""

    def __init__(self, path: Path, longest: float = _LONGEST) -> None:
        """Take the path of the database; nothing is opened yet.

        Args:
            path: ``state.db``.
            longest: seconds after which a loan's queries are given up.
        """
        self.path, self._longest = path, longest
        self._lock = threading.Lock()
        self._idle: list[sqlite3.Connection] = []
        self._file: tuple[int, int] | None = None

    @contextmanager
    def connection(self) -> Iterator[sqlite3.Connection]:
        """Lend a connection for reading, to one thread.

        Raises:
            StoreError: there is no store, it cannot be read, or it took too long.
        """
        connection, file = self._take()
        until = time.monotonic() + self._longest
        connection.set_progress_handler(lambda: time.monotonic() > until, _INSTRUCTIONS)
        try:
            yield connection
        except sqlite3.Error as error:
            connection.close()
            late = time.monotonic() > until
            raise StoreError(f"{self.path}: {'reading takes too long' if late else error}") from error
        except BaseException:
            connection.close()
            raise
        connection.set_progress_handler(None, 0)
        with self._lock:
            if file == self._file and len(self._idle) < _MOST_IDLE:
                self._idle.append(connection)
                return
        connection.close()

    def rows(self, query: str, *values: Any) -> list[Any]:
        """Return all rows of a query.

        Raises:
            StoreError: as :meth:`connection`.
        """
        with self.connection() as connection:
            return connection.execute(query, values).fetchall()

    def close(self) -> None:
        """Close the connections that nobody has."""
        with self._lock:
            idle, self._idle, self._file = self._idle, [], None
        for connection in idle:
            connection.close()

    def identity(self) -> tuple[int, int] | None:
        """Return what tells the file from another of the same name, or None where there is none."""
        try:
            found = self.path.stat()
        except OSError:
            return None
        return found.st_dev, found.st_ino

    def _take(self) -> tuple[sqlite3.Connection, tuple[int, int] | None]:
        file = self.identity()
        with self._lock:
            # A store that was put aside would be read for ever by who has it open.
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
    try:
        connection = sqlite3.connect(
            f"{path.absolute().as_uri()}?mode=ro", uri=True, isolation_level=None, timeout=2.0, check_same_thread=False
        )
    except sqlite3.Error as error:
        raise StoreError(f"{path}: {error}") from error
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
