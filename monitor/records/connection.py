"""A connection to the database of a store that threads share, beside that of its writer and in nobody's way."""

from __future__ import annotations

import sqlite3
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Self

from monitor.records.database import StoreError


class SharedConnection:
    """A connection with a lock of its own, for one statement at a time from any thread.

    All methods raise :class:`StoreError`, naming the file, where the database cannot be opened, read or written, and
    after :meth:`close`.
    """

    def __init__(
        self,
        path: Path,
        *,
        write: bool = False,
        synchronous: Literal["FULL", "NORMAL"] = "FULL",
        tables: tuple[str, ...] = (),
    ) -> None:
        """Open the database of a store.

        Args:
            path: the database file, which must exist.
            write: whether more than reading is done; each statement is then a transaction of its own.
            synchronous: FULL: what was written survives a power cut; NORMAL: the latest of it may be lost.
            tables: statements that make what the database lacks, which need ``write``.
        """
        self._path = path
        self._lock = threading.Lock()
        try:
            self._connection = sqlite3.connect(
                f"{path.absolute().as_uri()}?mode={'rw' if write else 'ro'}",
                uri=True,
                isolation_level=None,
                timeout=5.0,
                check_same_thread=False,
            )
        except sqlite3.Error as error:
            raise StoreError(f"{path}: {error}") from error
        try:
            with self.use() as connection:
                if write:
                    connection.execute(f"PRAGMA synchronous = {synchronous}")
                for statement in tables:
                    connection.execute(statement)
        except StoreError:
            self._connection.close()
            raise

    @contextmanager
    def use(self) -> Iterator[sqlite3.Connection]:
        """Lend the connection for several statements; no other thread has it meanwhile."""
        with self._lock:
            try:
                yield self._connection
            except sqlite3.Error as error:
                raise StoreError(f"{self._path}: {error}") from error

    def rows(self, query: str, *values: Any) -> list[Any]:
        """Return all rows of a statement."""
        with self.use() as connection:
            return connection.execute(query, values).fetchall()

    def close(self) -> None:
        """Close the connection; closing twice does nothing."""
        with self._lock:
            self._connection.close()

    def __enter__(self) -> Self:
        """Return the connection itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close it."""
        self.close()
