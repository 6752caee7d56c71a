"""Open and check the database ``state.db``; its lock, and files that survive a power cut."""

from __future__ import annotations

import os
import shutil
import sqlite3
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from typing import Any, Literal, Protocol, Self

from models.platform.portable import FileLock, sync_file, sync_folder
from models.words.errors import WrongInputError
from monitor.records.tables import APPLICATION_ID, STORE_VERSION, add_unversioned, create_tables, migrate_tables
from streams.types.listing import NETWORK_FILE_SYSTEMS, file_system_type

_MAX_IDLE_LOG_BYTES = 64 << 20
"""Size to which the write-ahead log is cut after a checkpoint."""

_LOCK_WAIT_S, _LOCK_POLL_S = 2.0, 0.05

MAGIC = b"SQLite format 3\x00"

DATABASE_ERRORS = (sqlite3.Error, MemoryError)
"""What a statement raises; SQLite's own lack of memory comes as MemoryError."""

UNFIT = (
    *(TypeError, ValueError, LookupError, AttributeError, OverflowError),
    *(sqlite3.DataError, sqlite3.IntegrityError, sqlite3.InterfaceError, sqlite3.ProgrammingError),
)
"""Raised for values that do not fit the tables; a full, locked or damaged database raises something else."""


class StoreError(WrongInputError):
    """The store cannot be used; the message names the file and the cause."""


class UnstorableError(StoreError):
    """A record does not fit the tables; repeating the commit is useless, the store itself is intact."""


def error_text(error: BaseException) -> str:
    """Return the message of one of ``DATABASE_ERRORS``; that of a MemoryError is empty."""
    return str(error) or "out of memory"


class Closing:
    """Base of what a ``with`` statement closes at its end."""

    def close(self) -> None:
        """Close it; closing twice does nothing."""
        raise NotImplementedError

    def __enter__(self) -> Self:
        """Return the object itself."""
        return self

    def __exit__(self, *error: object) -> None:
        """Close it."""
        self.close()


class Presence:
    """Detects that an open database was removed or replaced: SQLite would go on in the removed file."""

    def __init__(self, path: Path) -> None:
        """Keep the path of the database; the first :meth:`check` sets the reference."""
        self._paths = (path, path.with_name(f"{path.name}-wal"))
        self._files: list[tuple[int, int] | None] = [None, None]

    def check(self) -> None:
        """Compare the files with those of the first call, within a transaction; StoreError where they differ."""
        files = [_identity(path) for path in self._paths]
        self._files = [first or now for first, now in zip(self._files, files, strict=True)]
        for path, first, now in zip(self._paths, self._files, files, strict=True):
            if first != now:
                raise StoreError(
                    f"{path}: was {'removed' if now is None else 'replaced'} while it was in use; put it back, "
                    "or stop and start again with what is there"
                )


def _identity(path: Path) -> tuple[int, int] | None:
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_dev, found.st_ino


def refuse_unsuitable(path: Path, *, create: bool, look_inside: bool = True) -> bool:
    """Raise StoreError where a file cannot be a store; return whether the store has to be made.

    ``look_inside`` checks the first bytes of the file. It must be False where this process may have it open: closing a
    file releases all POSIX locks of the process on it, also those of SQLite.
    """
    if path.is_dir():
        raise StoreError(f"{path}: is a folder; expected a file such as state.db")
    if not path.exists() and not create:
        raise StoreError(f"{path}: no such file")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        refuse_network_share(path, path.parent)
        head = b""
        if path.exists() and look_inside:
            with path.open("rb") as file:
                head = file.read(len(MAGIC))
        elif path.exists() and path.stat().st_size:
            head = MAGIC
    except OSError as error:
        raise StoreError(f"{path}: {error.strerror or error}") from error
    if head and head != MAGIC:
        raise StoreError(f"{path}: is not a database (it begins with {head[:8]!r})")
    if not head and not create:
        raise StoreError(f"{path}: is empty")
    return not head


def refuse_network_share(path: Path, folder: Path) -> None:
    """Refuse a store at ``path`` where the existing ``folder``, its own or one above, is on a network file system.

    Raises:
        StoreError: naming the file system.
        OSError: the folder cannot be looked at.
    """
    kind = file_system_type(folder)
    if kind in NETWORK_FILE_SYSTEMS:
        raise StoreError(
            f"{path}: lies on a network file system ({kind}), where a committed block may be lost; "
            "set state_dir to a folder on a local disk"
        )


def connect(path: Path, *, new: bool, read_only: bool) -> sqlite3.Connection:
    """Open the database, make its tables if it is new, and check its version; a writer migrates an older one."""
    connection = _opened(path, "ro" if read_only else "rwc")
    try:
        connection.execute("PRAGMA foreign_keys = ON")
        if not read_only:
            if new:
                # Possible only before the first table is made: freed pages can then be given back step by step.
                connection.execute("PRAGMA auto_vacuum = INCREMENTAL")
            # FULL: with NORMAL, commits of a write-ahead log may be rolled back by a power cut.
            connection.execute("PRAGMA journal_mode = WAL")
            connection.execute("PRAGMA synchronous = FULL")
            connection.execute(f"PRAGMA journal_size_limit = {_MAX_IDLE_LOG_BYTES}")
        if new or not connection.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]:
            if read_only:
                raise StoreError(f"{path}: is empty")
            create_tables(connection)
            sync_folder(path.parent)
        found = _check_version(connection, path)
        if found < STORE_VERSION and not read_only:
            migrate_tables(connection, found)
            for suffix in ("", "-wal", "-shm", ".lock"):
                # The trends of older versions were a cache beside the store.
                path.with_name(f"trends.db{suffix}").unlink(missing_ok=True)
        if not read_only:
            add_unversioned(connection)
    except sqlite3.Error as error:
        connection.close()
        raise StoreError(f"{path}: {error}") from error
    except StoreError:
        connection.close()
        raise
    return connection


def _opened(path: Path, mode: str, *, any_thread: bool = False) -> sqlite3.Connection:
    """Open a database file, in autocommit and in a mode of SQLite's URIs."""
    uri = f"{path.absolute().as_uri()}?mode={mode}"
    try:
        return sqlite3.connect(uri, uri=True, isolation_level=None, timeout=5.0, check_same_thread=not any_thread)
    except sqlite3.Error as error:
        raise StoreError(f"{path}: {error}") from error


def _check_version(connection: sqlite3.Connection, path: Path) -> int:
    """Return the version of the tables; raise StoreError where they are of another program or a newer version."""
    if connection.execute("PRAGMA application_id").fetchone()[0] != APPLICATION_ID:
        raise StoreError(f"{path}: is a database of another program, not a store of records")
    row = connection.execute("SELECT value FROM meta WHERE key = 'schema_version'").fetchone()
    found = row[0] if row else None
    if found is None or not found.isdigit() or int(found) > STORE_VERSION:
        raise StoreError(
            f"{path}: was written with schema version {found}; this program knows versions up to {STORE_VERSION}"
        )
    return int(found)


class Readable(Protocol):
    """A store that can be read: that of the writer, a connection beside it, or the reader of the page."""

    def rows(self, query: str, *values: Any) -> list[Any]:
        """Return all rows of a query."""
        ...

    def connection(self) -> AbstractContextManager[sqlite3.Connection]:
        """Lend the connection; a failure becomes a StoreError."""
        ...


class Writable(Readable, Protocol):
    """A store that can be written."""

    def transaction(self) -> AbstractContextManager[sqlite3.Connection]:
        """Run statements as one transaction, rolled back where anything fails."""
        ...


class SharedConnection(Closing):
    """A connection beside that of the store's writer, for one statement at a time from any thread.

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
        """Open the database of a store, which must exist.

        Args:
            path: the database file.
            write: whether statements write; each is then a transaction of its own.
            synchronous: FULL: what was written survives a power cut; NORMAL: the latest of it may be lost.
            tables: statements that make missing tables, of a connection that writes.
        """
        self._path = path
        self._lock = threading.Lock()
        self._connection = _opened(path, "rw" if write else "ro", any_thread=True)
        try:
            with self.connection() as connection:
                if write:
                    connection.execute(f"PRAGMA synchronous = {synchronous}")
                for statement in tables:
                    connection.execute(statement)
        except StoreError:
            self._connection.close()
            raise

    @contextmanager
    def connection(self) -> Iterator[sqlite3.Connection]:
        """Lock the connection for several statements of one thread."""
        with self._lock:
            try:
                yield self._connection
            except DATABASE_ERRORS as error:
                raise StoreError(f"{self._path}: {error_text(error)}") from error

    def rows(self, query: str, *values: Any) -> list[Any]:
        """Return all rows of a statement."""
        with self.connection() as connection:
            return connection.execute(query, values).fetchall()

    def close(self) -> None:
        """Close the connection; closing twice does nothing."""
        with self._lock:
            self._connection.close()


def take_lock(path: Path) -> FileLock | None:
    """Take the lock beside a file; return it, or None where another process holds it.

    The kernel releases it when the process ends. A child that was being started when the process was killed holds it
    until it has become another program, which is waited for. OSError where the lock file cannot be made.
    """
    lock = FileLock(path.with_name(f"{path.name}.lock"))
    until = time.monotonic() + _LOCK_WAIT_S
    while True:
        with suppress(OSError):
            if lock.take():
                return lock
        if time.monotonic() >= until:
            lock.close()
            return None
        time.sleep(_LOCK_POLL_S)


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Hold a lock file, which is made where it is not there; another process that holds it is waited for."""
    lock = FileLock(path)
    try:
        lock.wait()
        yield
    finally:
        lock.close()


def release_lock(lock: FileLock | None) -> None:
    """Release a lock; None is ignored."""
    if lock is not None:
        lock.close()


def free_bytes(folder: Path) -> int:
    """Return the bytes that are free for users other than root; OSError where the folder cannot be reached."""
    return shutil.disk_usage(folder).free


@contextmanager
def replacing(target: Path, label: str = "") -> Iterator[Path]:
    """Lend a path for the new content of a file: readers see the old one or the new one, never a part.

    The replacement is durable; after an exception the old file stays. Two that write at once need labels.
    """
    temporary = target.with_name(f".{target.name}{label}.tmp")
    try:
        yield temporary
        sync_file(temporary)
        temporary.replace(target)
    except BaseException:
        with suppress(OSError):
            temporary.unlink()
        raise
    sync_folder(target.parent)


def link_durably(source: Path, target: Path) -> None:
    """Give a file a second name, or copy it where the file system has no links; a missing file is ignored.

    The name is that of a whole file at any moment. FileExistsError where it is taken.
    """
    try:
        os.link(source, target)
    except FileExistsError:
        raise
    except FileNotFoundError:
        return
    except OSError:
        if target.exists():
            raise FileExistsError(target) from None
        with suppress(FileNotFoundError), replacing(target) as temporary:
            shutil.copy2(source, temporary)
        return
    sync_folder(target.parent)


def put_in_place(fresh: Path, store: Path, kept: Iterable[tuple[Path, Path]]) -> None:
    """Replace a database by a whole one; may be repeated after any interruption.

    Args:
        fresh: the new database, without a log.
        store: the place of the old one.
        kept: files of the old one that stay, each with its second name; what is missing, or kept already, is left.
    """
    for source, target in kept:
        if source.exists() and not target.exists():
            link_durably(source, target)
    sync_folder(store.parent)
    # SQLite would apply a remaining log to the new database.
    for suffix in ("-wal", "-shm"):
        store.with_name(store.name + suffix).unlink(missing_ok=True)
    sync_folder(store.parent)
    fresh.replace(store)
    sync_folder(store.parent)


def same_file(path: Path, other: Path) -> bool:
    """Return whether two names are of one file; False where one does not exist."""
    try:
        return path.samefile(other)
    except OSError:
        return False
