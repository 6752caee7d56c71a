"""Giving the free pages of the store back to the file system, in steps or, where it is of an older version, at once."""

from __future__ import annotations

import logging
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

from monitor.records.database import Readable, StoreError, is_known, opened
from monitor.records.durable import take_lock

if TYPE_CHECKING:
    from monitor.records.store import Store

_LOG = logging.getLogger(__name__)
RESERVE_BYTES = 4 << 20
"""Free space that the file keeps for the next blocks."""
_INCREMENTAL = 2
_LONG_LOG_BYTES = 1 << 20
_MIN_FREE_SHARE = 0.25
_SMALL_BYTES = 32 << 20
_ROOM = 2.5
"""Free space on the disk that rebuilding needs, in sizes of the rebuilt store: a copy and the write-ahead log."""
_BEAT_EVERY = 200_000


def free_bytes_in(connection: sqlite3.Connection) -> int:
    """Return the bytes of the database that are free for new rows."""
    return _pragma(connection, "freelist_count") * _pragma(connection, "page_size")


def used_bytes(connection: sqlite3.Connection) -> int:
    """Return the bytes of the database that hold rows."""
    return _pragma(connection, "page_count") * _pragma(connection, "page_size") - free_bytes_in(connection)


def shrinks(connection: sqlite3.Connection) -> bool:
    """Return whether the database can be shortened step by step."""
    return _pragma(connection, "auto_vacuum") == _INCREMENTAL


def reusable_bytes(store: Readable) -> int:
    """Return the bytes inside a store that new blocks can take; 0 where it can be shortened, or not be read."""
    try:
        with store.connection() as connection:
            return 0 if shrinks(connection) else free_bytes_in(connection)
    except StoreError:
        return 0


def stored_bytes(store: Store) -> int:
    """Return the bytes that a store takes on the disk, or where it cannot be shortened, those that hold rows."""
    with store.connection() as connection:
        return file_bytes(store.path) if shrinks(connection) else used_bytes(connection)


def shorten(store: Readable, pages: int) -> int:
    """Give at most so many pages back, as a transaction of its own; return how many it were."""
    with store.connection() as connection:
        spare = (free_bytes_in(connection) - RESERVE_BYTES) // _pragma(connection, "page_size")
        if spare <= 0 or not shrinks(connection):
            return 0
        before = _pragma(connection, "page_count")
        # Each step of the statement frees a page, and only a script is stepped to its end.
        connection.executescript(f"PRAGMA incremental_vacuum({min(pages, spare)})")
        return before - _pragma(connection, "page_count")


def settle_log(store: Store) -> None:
    """Empty a long write-ahead log, unless a reader needs it: only then has the database its shortened size."""
    if _size(store.path.with_name(f"{store.path.name}-wal")) < _LONG_LOG_BYTES:
        return
    with store.connection() as connection:
        waits = _pragma(connection, "busy_timeout")
        connection.execute("PRAGMA busy_timeout = 0")
        try:
            connection.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()
        finally:
            connection.execute(f"PRAGMA busy_timeout = {waits}")


def rebuild(path: Path) -> None:
    """Rebuild a closed store as one file without free pages; StoreError where that fails."""
    try:
        with closing(opened(path)) as connection:
            connection.execute("VACUUM")
            connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    except sqlite3.Error as error:
        raise StoreError(f"{path}: {error}") from error


def settle_layout(path: Path, free: Callable[[Path], int], beat: Callable[[], object] = lambda: None) -> bool:
    """Rebuild a store of an older version, which cannot be shortened in steps, before its daemon opens it.

    Only where it is worth it (the store is small, or a quarter of it is free) and the disk has room. It is one
    transaction: a kill leaves the store as it was. Readers go on. Return whether it was rebuilt; a store that cannot be
    read or is of another program or a newer version is left to those that open it.

    Args:
        path: the database file; nothing happens where there is none.
        free: returns the free bytes of a folder.
        beat: called repeatedly meanwhile.
    """
    if not path.exists() or not path.stat().st_size:
        return False
    lock = take_lock(path)
    if lock is None:
        return False

    def going_on() -> bool:
        beat()
        # True would interrupt the statement.
        return False

    try:
        with closing(opened(path, "rw")) as connection:
            connection.set_progress_handler(going_on, _BEAT_EVERY)
            connection.execute("PRAGMA synchronous = FULL")
            used, unused = used_bytes(connection), free_bytes_in(connection)
            worth = used <= _SMALL_BYTES or unused >= _MIN_FREE_SHARE * (used + unused)
            if not is_known(connection, path) or shrinks(connection) or not worth or free(path.parent) < _ROOM * used:
                return False
            connection.execute("PRAGMA auto_vacuum = INCREMENTAL")
            connection.execute("VACUUM")
            connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    except (OSError, sqlite3.Error) as error:
        _LOG.warning("%s: is not rebuilt: %s", path, error)
        return False
    finally:
        lock.close()
    return True


def file_bytes(path: Path) -> int:
    """Return the size of a database with its write-ahead log; 0 for missing files."""
    return sum(_size(path.with_name(f"{path.name}{suffix}")) for suffix in ("", "-wal"))


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return 0


def _pragma(connection: sqlite3.Connection, name: str) -> int:
    return connection.execute(f"PRAGMA {name}").fetchone()[0]
