"""The one policy of errors of the store: what an error of SQLite or of the system says of it, and what follows.

*Transient* errors end by themselves or by hand, the store being intact: they are repeated. *Lasting* ones do not end
while the process lives, and *damage* is only believed after two checks of their own, since SQLite reports one read that
the system refuses as a malformed database, too.
"""

from __future__ import annotations

import errno
import logging
import sqlite3
import time
from collections.abc import Callable
from datetime import UTC, datetime
from enum import StrEnum
from typing import Any

from models.words.errors import WrongInputError

_LOG = logging.getLogger(__name__)
_AGAIN_S = 1.0
"""Seconds between two checks for damage."""

DATABASE_ERRORS = (sqlite3.Error, MemoryError)
"""What a statement raises; SQLite's own lack of memory comes as MemoryError."""

UNFIT = (
    *(TypeError, ValueError, LookupError, AttributeError, OverflowError),
    *(sqlite3.DataError, sqlite3.IntegrityError, sqlite3.InterfaceError, sqlite3.ProgrammingError),
)
"""Raised for values that do not fit the tables; a full, locked or damaged database raises something else."""


class Kind(StrEnum):
    """What can be expected of a repetition: see the head of this module."""

    TRANSIENT = "transient"
    LASTING = "lasting"
    DAMAGE = "damage"


_OF_SQLITE = {
    **dict.fromkeys(
        (
            *(sqlite3.SQLITE_ABORT, sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED, sqlite3.SQLITE_NOMEM),
            *(sqlite3.SQLITE_INTERRUPT, sqlite3.SQLITE_IOERR, sqlite3.SQLITE_FULL, sqlite3.SQLITE_CANTOPEN),
            *(sqlite3.SQLITE_PROTOCOL, sqlite3.SQLITE_SCHEMA),
            # Of a read-only connection that meets a log which has to be recovered.
            *(sqlite3.SQLITE_READONLY_RECOVERY, sqlite3.SQLITE_READONLY_CANTLOCK, sqlite3.SQLITE_READONLY_CANTINIT),
        ),
        Kind.TRANSIENT,
    ),
    **dict.fromkeys((sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB), Kind.DAMAGE),
}
"""By extended code, then by primary code; all others last."""
_OF_SYSTEM = frozenset(
    (
        *(errno.EAGAIN, errno.EBUSY, errno.EDEADLK, errno.EDQUOT, errno.EINTR, errno.EIO, errno.EMFILE, errno.ENFILE),
        *(errno.ENOBUFS, errno.ENOLCK, errno.ENOMEM, errno.ENOSPC, errno.ESTALE, errno.ETIMEDOUT),
    )
)
_DISCARDING = frozenset(
    (
        *(sqlite3.SQLITE_IOERR, sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB),
        *(sqlite3.SQLITE_BUSY, sqlite3.SQLITE_PROTOCOL),
    )
)


class StoreError(WrongInputError):
    """The store cannot be used; the message names the file and the cause."""

    @property
    def kind(self) -> Kind:
        """What its cause is; an error without one is lasting."""
        return kind_of(self)


class UnstorableError(StoreError):
    """A record does not fit the tables; repeating the commit is useless, the store itself is intact."""


class StoreDamagedError(StoreError):
    """Two checks found damage in a store that is in use; the next start makes it again of what is left."""

    exit_code = 1


def kind_of(error: BaseException | None) -> Kind:
    """Return what an error, or the first of its causes that is one of the system or of SQLite, says of the store."""
    while error is not None:
        if isinstance(error, sqlite3.Error):
            code = _code_of(error)
            return _OF_SQLITE.get(code, _OF_SQLITE.get(code & 0xFF, Kind.LASTING))
        if isinstance(error, MemoryError):
            return Kind.TRANSIENT
        if isinstance(error, OSError):
            return Kind.TRANSIENT if error.errno in _OF_SYSTEM else Kind.LASTING
        error = error.__cause__
    return Kind.LASTING


def discards(error: BaseException) -> bool:
    """Return whether the connection that met an error is not used again.

    Its cache may hold what was not read. A lock whose release the system refused once is held for ever, by this or
    another connection of the process, and all wait for it.
    """
    return isinstance(error, sqlite3.Error) and _code_of(error) & 0xFF in _DISCARDING


def _code_of(error: sqlite3.Error) -> int:
    # Errors of the module itself, as that of a closed connection, have none.
    return getattr(error, "sqlite_errorcode", sqlite3.SQLITE_ERROR)


def error_text(error: BaseException) -> str:
    """Return the message of one of ``DATABASE_ERRORS``; that of a MemoryError is empty."""
    return str(error) or "out of memory"


def confirmed(check: Callable[[], str | None]) -> str | None:
    """Return the damage that a check finds twice, with time between; None where either finds none.

    ``check`` opens a connection of its own. StoreError where it cannot tell.
    """
    if check() is None:
        return None
    time.sleep(_AGAIN_S)
    return check()


class Failures:
    """Failures of one use of the store, for the status: those in a row at present, and all since the start."""

    def __init__(
        self,
        told: str,
        over: str,
        damage: Callable[[], str | None] = lambda: None,
        clock: Callable[[], float] = time.time,
    ) -> None:
        """Begin with none; ``told`` and ``over`` are what the log says at the first one and after the last.

        ``damage`` looks for damage as :func:`confirmed` needs it; ``clock`` gives UTC seconds since 1970.
        """
        self._told, self._over, self._damage, self._clock = told, over, damage, clock
        self._count, self._since = 0, ""
        self.problem: str | None = None
        """Cause, number and beginning of the present failures, or None."""
        self.history: dict[str, Any] | None = None
        """``count``, ``first_utc``, ``last_utc`` and ``last_cause`` of all failures, or None."""

    def note(self, error: BaseException) -> None:
        """Count a failure.

        Raises:
            StoreDamagedError: the store is damaged, and the error says so.
        """
        utc = datetime.fromtimestamp(self._clock(), UTC).isoformat(timespec="seconds").replace("+00:00", "Z")
        if self._count == 0:
            _LOG.error("%s: %s", self._told, error)
            self._since = utc
        self._count += 1
        before = self.history or {"count": 0, "first_utc": utc}
        self.history = {**before, "count": before["count"] + 1, "last_utc": utc, "last_cause": str(error)}
        times = "once" if self._count == 1 else f"{self._count} times"
        self.problem = f"{error} ({times} since {self._since})"
        if kind_of(error) is not Kind.DAMAGE:
            return
        try:
            found = confirmed(self._damage)
        except StoreError as unknown:
            _LOG.warning("whether the store is damaged cannot be told: %s", unknown)
            return
        if found is not None:
            raise StoreDamagedError(f"{error}; {found}; the next start makes it again of what is left") from error

    def end(self) -> None:
        """Note a success."""
        if self._count:
            _LOG.warning("%s, after %d failures", self._over, self._count)
        self._count, self.problem = 0, None
