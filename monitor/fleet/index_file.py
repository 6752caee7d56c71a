"""The file of the index of an archive: its tables, and whether a file in its place is one."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

from models.words.errors import SpallwatchError

APPLICATION_ID = 0x53504C41
"""The bytes "SPLA" in the header of the database: it is ours."""
VERSION = 1
INDEX_NAME = "index.db"

_SCHEMA = f"""
PRAGMA application_id = {APPLICATION_ID};
PRAGMA user_version = {VERSION};
CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE machines (id INTEGER PRIMARY KEY, name TEXT NOT NULL UNIQUE, setup TEXT NOT NULL, history TEXT NOT NULL);
CREATE TABLE recordings (
    id INTEGER PRIMARY KEY, machine INTEGER NOT NULL REFERENCES machines (id), name TEXT NOT NULL, url TEXT NOT NULL,
    status INTEGER NOT NULL DEFAULT 0, attempt INTEGER NOT NULL DEFAULT 0,
    rows INTEGER, first REAL, last REAL, seconds REAL, chunk TEXT, reason TEXT, log TEXT, UNIQUE (machine, name)
);
CREATE INDEX recordings_waiting ON recordings (id) WHERE status = 0;
CREATE INDEX recordings_wrong ON recordings (status) WHERE status > 1;
CREATE TABLE links (
    recording INTEGER NOT NULL, place INTEGER NOT NULL, url TEXT NOT NULL, PRIMARY KEY (recording, place)
) WITHOUT ROWID;
CREATE TABLE checkpoints (recording INTEGER PRIMARY KEY, body BLOB NOT NULL)
"""
_FOLDERS = """
CREATE TABLE IF NOT EXISTS folders (
    recording INTEGER NOT NULL, url TEXT NOT NULL, files INTEGER NOT NULL, PRIMARY KEY (recording, url)
) WITHOUT ROWID
"""
"""Also made in an index of an earlier version, which has none."""


class ArchiveIndexError(SpallwatchError):
    """The index cannot be read or written; the message names the file and the cause."""


class ForeignIndexError(ArchiveIndexError):
    """A file in the place of the index is something else, or of a later version; the message names it."""


def open_database(path: Path, *, read_only: bool) -> sqlite3.Connection:
    """Open the database of an index, or make it where there is none and it is not ``read_only``.

    Raises:
        ForeignIndexError: something else is there; it is left as it is.
        ArchiveIndexError: it cannot be read or written.
    """
    new = not path.exists()
    if new and read_only:
        raise ArchiveIndexError(f"{path}: there is no index of an archive")
    try:
        new = new or _is_empty(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        uri = f"{path.absolute().as_uri()}?mode={'ro' if read_only else 'rwc'}"
        connection = sqlite3.connect(uri, uri=True, isolation_level=None)
        if not read_only:
            connection.execute("PRAGMA journal_mode = WAL")
            # A power cut may take the latest outcomes; they are found again in the store of the chunks.
            connection.execute("PRAGMA synchronous = NORMAL")
            if new:
                connection.executescript(f"BEGIN;{_SCHEMA};COMMIT")
            connection.execute(_FOLDERS)
    except (sqlite3.Error, OSError) as error:
        raise ArchiveIndexError(f"{path}: {error}") from error
    return connection


def _is_empty(path: Path) -> bool:
    """Return whether a file has no tables yet, as where a process was killed while it made the index.

    Raises:
        ForeignIndexError: it is no index of an archive that this version reads.
    """
    # Without a log beside it, reading makes no file and takes no lock.
    options = "mode=ro" if path.with_name(f"{path.name}-wal").exists() else "mode=ro&immutable=1"
    try:
        with closing(sqlite3.connect(f"{path.absolute().as_uri()}?{options}", uri=True)) as connection:
            found = [connection.execute(f"PRAGMA {key}").fetchone()[0] for key in ("application_id", "user_version")]
            tables: int = connection.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]
    except sqlite3.DatabaseError as error:
        if getattr(error, "sqlite_errorcode", None) != sqlite3.SQLITE_NOTADB:
            raise
        found, tables = [0, 0], 1
    if found != [APPLICATION_ID, VERSION] and (found != [0, 0] or tables):
        raise ForeignIndexError(f"{path}: is no index of an archive that this version reads")
    return not tables
