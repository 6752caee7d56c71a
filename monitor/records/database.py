"""The database ``state.db``: its tables and their versions, how it is opened, checked and migrated."""

from __future__ import annotations

import logging
import sqlite3
import threading
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any, Literal, Self
from weakref import WeakSet

from models.platform.portable import sync_folder
from monitor.records.archive import COLUMNS, complete_archive
from monitor.records.durable import make_folder
from monitor.records.failures import DATABASE_ERRORS, StoreError, discards, error_text
from streams.types.listing import NETWORK_FILE_SYSTEMS, file_system_type

_LOG = logging.getLogger(__name__)
APPLICATION_ID = 0x53504C57
"""The bytes "SPLW" in the header of the database: it is ours."""

STORE_VERSION = 4
"""Version of the tables, the ``schema_version`` of the table ``meta``.

2: inputs of forecasts; 3: rollup of trends; 4: condensed blocks (:mod:`monitor.records.condense`).
"""
CONDENSED_VERSION = 4

# A record is its row of blocks, the values in records (see packing), and its forecasts and events. blocks.id grows with
# every commit. day and axis_time: see filing.Filing; blocks_by_day gives the last block of each day to the publisher.
_SCHEMA = f"""
CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE runs (id INTEGER PRIMARY KEY, attributes TEXT NOT NULL);
CREATE TABLE blocks (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    source TEXT NOT NULL, sequence INTEGER NOT NULL, content_hash TEXT NOT NULL, name TEXT NOT NULL,
    status TEXT NOT NULL, flags TEXT NOT NULL, reason TEXT NOT NULL, time REAL, elapsed REAL,
    day INTEGER, axis_time REAL NOT NULL, time_status TEXT NOT NULL,
    run INTEGER NOT NULL REFERENCES runs (id),
    UNIQUE (source, sequence)
);
CREATE INDEX blocks_by_day ON blocks (day, id);
CREATE TABLE refusals (
    source TEXT NOT NULL, sequence INTEGER NOT NULL, content_hash TEXT NOT NULL, name TEXT NOT NULL,
    status TEXT NOT NULL, times INTEGER NOT NULL,
    UNIQUE (source, sequence, content_hash)
);
CREATE TABLE layouts (id INTEGER PRIMARY KEY, layout TEXT NOT NULL UNIQUE);
CREATE TABLE records (
    block INTEGER PRIMARY KEY REFERENCES blocks (id), layout INTEGER NOT NULL REFERENCES layouts (id),
    row BLOB NOT NULL
);
CREATE TABLE stage_states (name TEXT PRIMARY KEY, block INTEGER NOT NULL, state TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE forecasts (
    id INTEGER PRIMARY KEY, block INTEGER NOT NULL REFERENCES blocks (id), body TEXT NOT NULL,
    {", ".join(f"{name} {kind}" for name, kind in COLUMNS.items())}
);
CREATE INDEX forecasts_by_block ON forecasts (block);
CREATE TABLE events (id INTEGER PRIMARY KEY, block INTEGER NOT NULL REFERENCES blocks (id), body TEXT NOT NULL);
CREATE INDEX events_by_block ON events (block);
CREATE TABLE published (
    file TEXT PRIMARY KEY, day INTEGER, last_block INTEGER NOT NULL, size INTEGER NOT NULL
) WITHOUT ROWID;
"""

_UNVERSIONED = """
CREATE TABLE IF NOT EXISTS spectra (
    source TEXT NOT NULL, channel TEXT NOT NULL, sequence INTEGER NOT NULL, time REAL, kind INTEGER NOT NULL,
    header TEXT NOT NULL, amplitude BLOB NOT NULL, PRIMARY KEY (source, channel, sequence)
);
CREATE TABLE IF NOT EXISTS digests (block INTEGER PRIMARY KEY, ledger BLOB NOT NULL, content BLOB NOT NULL, states BLOB)
"""
"""Outside the versions of the schema: made where they are missing when a store is opened for writing."""

_ROLLUP = """
CREATE TABLE IF NOT EXISTS rollup (
    source TEXT NOT NULL, channel TEXT NOT NULL, dated INTEGER NOT NULL, level INTEGER NOT NULL,
    bucket INTEGER NOT NULL, records INTEGER NOT NULL, others TEXT, extremes BLOB NOT NULL,
    PRIMARY KEY (source, channel, dated, level, bucket)
) WITHOUT ROWID;
CREATE INDEX IF NOT EXISTS blocks_by_time ON blocks (source, day IS NULL, instr(flags, 'clock') > 0, axis_time);
"""
"""The extremes of trends (:mod:`monitor.records.rollup`), and where the blocks of a range of time are."""

_CONDENSED = """
CREATE TABLE IF NOT EXISTS condensed_sources (
    id INTEGER PRIMARY KEY, source TEXT NOT NULL UNIQUE, began REAL, counts TEXT NOT NULL,
    first_dated REAL, last_dated REAL, first_undated REAL, last_undated REAL
);
CREATE TABLE IF NOT EXISTS condensed_days (day INTEGER UNIQUE, blocks INTEGER NOT NULL);
CREATE TABLE IF NOT EXISTS identities (
    source INTEGER NOT NULL, sequence INTEGER NOT NULL, content BLOB NOT NULL, PRIMARY KEY (source, sequence)
) WITHOUT ROWID;
CREATE INDEX IF NOT EXISTS identities_by_content ON identities (substr(content, 1, 6));
CREATE TABLE IF NOT EXISTS forecast_inputs (
    id INTEGER PRIMARY KEY, channel TEXT, method TEXT, threshold_mm2 REAL, interval_level REAL,
    library_hash TEXT, map_hash TEXT, config_hash TEXT
);
CREATE TABLE IF NOT EXISTS condensed_forecasts (
    id INTEGER PRIMARY KEY, source INTEGER NOT NULL, sequence INTEGER NOT NULL, dated INTEGER NOT NULL,
    inputs INTEGER NOT NULL, status TEXT, issued_utc REAL, data_until REAL, tt_s REAL, quantiles TEXT
);
"""
"""What stays of blocks whose full records have left the store."""


def create_tables(connection: sqlite3.Connection) -> None:
    """Make all tables in one transaction: a half-made store is an empty database."""
    connection.execute("BEGIN IMMEDIATE")
    for statement in (_SCHEMA + _ROLLUP + _CONDENSED).split(";"):
        if statement.strip():
            connection.execute(statement)
    connection.execute("INSERT INTO meta VALUES ('schema_version', ?)", (str(STORE_VERSION),))
    connection.execute(f"PRAGMA application_id = {APPLICATION_ID}")
    connection.execute("COMMIT")


def migrate_tables(connection: sqlite3.Connection, found: int) -> None:
    """Bring the tables of an older version to the present version, all or nothing."""
    connection.execute("BEGIN IMMEDIATE")
    try:
        if found < 2:
            complete_archive(connection)
        for statement in filter(str.strip, (_ROLLUP + _CONDENSED).split(";")):
            connection.execute(statement)
        connection.execute("UPDATE meta SET value = ? WHERE key = 'schema_version'", (str(STORE_VERSION),))
        connection.execute("COMMIT")
    finally:
        if connection.in_transaction:
            connection.execute("ROLLBACK")


def add_unversioned(connection: sqlite3.Connection) -> None:
    """Make the tables outside the versions, and their later columns, where they are missing."""
    for statement in _UNVERSIONED.split(";"):
        connection.execute(statement)
    columns = {name for _, name, *_ in connection.execute("PRAGMA table_info(spectra)")}
    if "view" not in columns:
        connection.execute("ALTER TABLE spectra ADD COLUMN view BLOB")


_MAX_IDLE_LOG_BYTES = 64 << 20
"""Size to which the write-ahead log is cut after a checkpoint."""

MAGIC = b"SQLite format 3\x00"


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

    def renew_log(self) -> None:
        """Take another log as the reference, which a connection may have made that was opened anew."""
        self._files[1] = None

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
        make_folder(path.parent, 0o750)
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
    try:
        if new:
            # SQLite gives its log and index the permissions of the store, whatever the umask of the process.
            path.touch(0o640)
        connection = opened(path, "ro" if read_only else "rwc", any_thread=True)
    except (OSError, sqlite3.Error) as error:
        raise StoreError(f"{path}: {error}") from error
    try:
        empty = new or not connection.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]
        if not empty:
            # Before anything is set in a file that another version wrote.
            _check_version(connection, path)
        _set_up(connection, new=new, read_only=read_only)
        if empty:
            if read_only:
                raise StoreError(f"{path}: is empty")
            create_tables(connection)
            sync_folder(path.parent)
        found = _check_version(connection, path)
        if found < STORE_VERSION and not read_only:
            # First: what is left behind by a process that is killed would stay. It is a cache, of trends.
            for suffix in ("", "-wal", "-shm", ".lock"):
                path.with_name(f"trends.db{suffix}").unlink(missing_ok=True)
            migrate_tables(connection, found)
            _LOG.warning("%s: its tables of version %d are now those of version %d", path, found, STORE_VERSION)
        if not read_only:
            add_unversioned(connection)
    except sqlite3.Error as error:
        connection.close()
        raise StoreError(f"{path}: {error}") from error
    except StoreError:
        connection.close()
        raise
    return connection


def _set_up(connection: sqlite3.Connection, *, new: bool, read_only: bool) -> None:
    connection.execute("PRAGMA foreign_keys = ON")
    if read_only:
        return
    if new:
        # Possible only before the first table is made: freed pages can then be given back step by step.
        connection.execute("PRAGMA auto_vacuum = INCREMENTAL")
    # FULL: with NORMAL, commits of a write-ahead log may be rolled back by a power cut.
    connection.execute("PRAGMA journal_mode = WAL")
    connection.execute("PRAGMA synchronous = FULL")
    connection.execute(f"PRAGMA journal_size_limit = {_MAX_IDLE_LOG_BYTES}")


def reconnect(path: Path, *, read_only: bool) -> sqlite3.Connection:
    """Open a store that is in use once more, and make nothing; sqlite3.Error or StoreError where that fails."""
    connection = opened(path, "ro" if read_only else "rw", any_thread=True)
    try:
        _set_up(connection, new=False, read_only=read_only)
        _check_version(connection, path)
    except BaseException:
        connection.close()
        raise
    return connection


def opened(path: Path, mode: str = "rwc", *, timeout: float = 5.0, any_thread: bool = False) -> sqlite3.Connection:
    """Open a database file, in autocommit and in a mode of SQLite's URIs; sqlite3.Error where that fails."""
    uri = f"{path.absolute().as_uri()}?mode={mode}"
    return sqlite3.connect(uri, uri=True, isolation_level=None, timeout=timeout, check_same_thread=not any_thread)


def open_beside(path: Path, mode: str, timeout: float = 5.0) -> sqlite3.Connection:
    """Open a database beside its writer, for one thread at a time; StoreError where that fails."""
    try:
        return opened(path, mode, timeout=timeout, any_thread=True)
    except sqlite3.Error as error:
        raise StoreError(f"{path}: {error}") from error


def is_known(connection: sqlite3.Connection, path: Path) -> bool:
    """Return whether a database is a store of this version or an earlier one."""
    try:
        _check_version(connection, path)
    except StoreError:
        return False
    return True


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


class Readable(Closing):
    """A store that can be read: that of the writer, a connection beside it, or the reader of the page."""

    def connection(self) -> AbstractContextManager[sqlite3.Connection]:
        """Lend the connection; a failure becomes a StoreError."""
        raise NotImplementedError

    def rows(self, query: str, *values: Any) -> list[Any]:
        """Return all rows of a statement."""
        with self.connection() as connection:
            return connection.execute(query, values).fetchall()


_LET_GO_S = 0.2
_CONNECTIONS: WeakSet[Renewed] = WeakSet()
_CONNECTIONS_LOCK = threading.Lock()


class Renewed(Readable):
    """A connection that is not used again after some errors: the next use opens another one.

    Then all connections of this process to the database that no thread uses are closed up to their next use. SQLite
    keeps the locks on its log for the process as a whole: one that the system refused to release is held until the
    last of them is closed.
    """

    def __init__(self, path: Path, connection: sqlite3.Connection) -> None:
        """Own an open connection, which any thread may use."""
        self.path, self._connection = path, connection
        self._use = threading.RLock()
        self._loans = 0
        self._failed = self._absent = self._closed = False
        with _CONNECTIONS_LOCK:
            _CONNECTIONS.add(self)

    def _reopened(self) -> sqlite3.Connection:
        """Open another connection; sqlite3.Error or StoreError where that fails."""
        raise NotImplementedError

    @contextmanager
    def connection(self) -> Iterator[sqlite3.Connection]:
        """Lend the connection to one thread at a time, for several statements outside a transaction."""
        with self._use:
            try:
                if (self._failed or self._absent) and not self._loans:
                    self._renew()
                self._loans += 1
                try:
                    yield self._connection
                finally:
                    self._loans -= 1
            except DATABASE_ERRORS as error:
                self._failed = not self._closed and (self._failed or discards(error))
                raise StoreError(f"{self.path}: {error_text(error)}") from error

    def _renew(self) -> None:
        if self._failed:
            with _CONNECTIONS_LOCK:
                found = list(_CONNECTIONS)
            for other in found:
                other.let_go(self.path)
            self._failed, self._absent = False, True
        self._connection.close()
        try:
            self._connection = self._reopened()
        except DATABASE_ERRORS as error:
            self._failed = discards(error)
            raise
        self._absent = False

    def let_go(self, path: Path) -> None:
        """Close a connection to ``path`` until its next use, unless a thread is using it."""
        if self.path.absolute() != path.absolute() or not self._use.acquire(timeout=_LET_GO_S):
            return
        try:
            if not self._loans and not self._closed:
                self._connection.close()
                self._absent = True
        finally:
            self._use.release()

    def close(self) -> None:
        """Close the connection; closing twice does nothing."""
        with self._use:
            self._failed, self._absent, self._closed = False, False, True
            self._connection.close()


class SharedConnection(Renewed):
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
        self._mode = "rw" if write else "ro"
        self._preparing = (f"PRAGMA synchronous = {synchronous}", *tables) if write else ()
        try:
            connection = self._opened(path)
        except DATABASE_ERRORS as error:
            raise StoreError(f"{path}: {error_text(error)}") from error
        super().__init__(path, connection)

    def _reopened(self) -> sqlite3.Connection:
        return self._opened(self.path)

    def _opened(self, path: Path) -> sqlite3.Connection:
        connection = opened(path, self._mode, any_thread=True)
        try:
            for statement in self._preparing:
                connection.execute(statement)
        except BaseException:
            connection.close()
            raise
        return connection
