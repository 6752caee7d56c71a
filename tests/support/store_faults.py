"""Connections of SQLite whose statements fail, counted over all connections of a process."""

from __future__ import annotations

import sqlite3
import threading
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, cast

import pytest

from monitor.records import database

ERRORS: dict[str, Callable[[], Exception]] = {
    "busy": lambda: coded(sqlite3.OperationalError("database is locked"), sqlite3.SQLITE_BUSY),
    "lock": lambda: coded(sqlite3.OperationalError("locking protocol"), sqlite3.SQLITE_PROTOCOL),
    "read": lambda: coded(sqlite3.OperationalError("disk I/O error"), sqlite3.SQLITE_IOERR_READ),
    "malformed": lambda: coded(sqlite3.DatabaseError("database disk image is malformed"), sqlite3.SQLITE_CORRUPT),
    "full": lambda: coded(sqlite3.OperationalError("database or disk is full"), sqlite3.SQLITE_FULL),
    "open": lambda: coded(sqlite3.OperationalError("unable to open database file"), sqlite3.SQLITE_CANTOPEN),
    "memory": MemoryError,
}
"""What a statement raises, by name."""


def coded(error: sqlite3.Error, code: int) -> sqlite3.Error:
    """Give an error the code that SQLite's own have."""
    error.sqlite_errorcode = code
    return error


class Faulty(sqlite3.Connection):
    """A connection whose statements meet faults."""

    def __init__(self, faults: Faults, *given: Any, **named: Any) -> None:
        super().__init__(*given, **named)
        self._faults = faults

    def execute(self, *given: Any) -> sqlite3.Cursor:
        self._faults.meet()
        return super().execute(*given)

    def executemany(self, *given: Any) -> sqlite3.Cursor:
        self._faults.meet()
        return super().executemany(*given)


class Faults:
    """Lets the statements from ``first`` on fail, ``count`` of them; numbers begin with 1."""

    def __init__(self, first: int, count: int, error: str) -> None:
        self.first, self.end, self.make = first, first + count, ERRORS[error]
        self.statements = self.fired = 0
        self._lock = threading.Lock()

    def meet(self) -> None:
        """Count a statement, and raise where it is one of those."""
        with self._lock:
            self.statements += 1
            if not self.first <= self.statements < self.end:
                return
            self.fired += 1
        raise self.make()

    def install(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Let all connections meet the faults that are opened from now on."""

        def opened(path: Path, mode: str = "rwc", *, timeout: float = 5.0, any_thread: bool = False) -> Any:
            uri = f"{path.absolute().as_uri()}?mode={mode}"
            options = {"uri": True, "isolation_level": None, "timeout": timeout, "check_same_thread": not any_thread}
            return sqlite3.connect(uri, factory=cast("Any", partial(Faulty, self)), **options)

        for module in ("database", "recover.loss", "compact"):
            monkeypatch.setattr(f"monitor.records.{module}.opened", opened)
        monkeypatch.setattr("monitor.records.failures._AGAIN_S", 0.01)
        monkeypatch.setattr("monitor.pipeline._FIRST_RETRY_S", 0.001)
        assert database.opened is opened
