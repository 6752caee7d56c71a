"""The ledger of live sources, in the database of the store.

Blocks are rows of the store. The progress of files in watched folders has its own table, written in the transaction of
the block that it belongs to.

The process may die while it handles a file. What is handled is therefore written to a file beside the store, into one
slot for each source and one for the thread that analyses and commits, without waiting for the disk: the note has to
survive the process, not a power cut. A process that ends properly removes it. One that finds notes at its start counts
a death for each file in them.

A process that is killed at any moment is likely to be analysing something. So a death within an analysis that takes
milliseconds counts as half of one; reading is noted only where it takes long.
"""

from __future__ import annotations

import json
import os
import re
import sqlite3
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import astuple, fields, replace
from pathlib import Path
from typing import Any

from models.platform.portable import BINARY, read_at, write_at
from models.words.errors import SpallwatchError
from monitor.health.record import storable
from monitor.records.condense import identity_of, numbers_with
from monitor.records.database import Closing, SharedConnection
from monitor.records.events import write_notice
from monitor.records.filing import LAST_QUERY, MAX_BLOCK, count_refusal
from monitor.records.queries import first_start
from monitor.records.store import Store
from streams.types.block import Rejected
from streams.types.limits import LARGE_BYTES
from streams.types.source import MAX_DEATHS, PENDING, POISONED, RELEASED, FileProgress, StreamCount

_DEATHS = """CREATE TABLE IF NOT EXISTS deaths (
    source TEXT NOT NULL, path TEXT NOT NULL, times REAL NOT NULL, PRIMARY KEY (source, path)
) WITHOUT ROWID"""
_SLOT_BYTES = 4096
_MAX_SLOTS = 256
_EMPTY = b"\n"
QUICK, SLOW = 0.5, 1.0
"""Deaths as which one counts, by the usual duration of what was done."""
Handled = tuple[str, tuple[str, ...], float]
"""A source, the paths of files in its folder, and as how many deaths one counts."""


class HandlingNotes(Closing):
    """The notes of one process; its methods may be called from any thread.

    A slot is a line of JSON, ``[source, [path, ...], deaths, analysed]``, or an empty one. A note that cannot be
    written, or that is too long, is left out.
    """

    def __init__(self, path: Path) -> None:
        """Read the notes that the process before left in the file at ``path``."""
        self._lock = threading.Lock()
        self._slots: dict[tuple[str, bool], int] = {}
        self._handle: int | None = None
        self.left: list[Handled] = []
        with suppress(OSError):
            self._handle = os.open(path, os.O_RDWR | os.O_CREAT | BINARY, 0o600)
            self.left = _blamed(read_at(self._handle, _SLOT_BYTES * _MAX_SLOTS, 0))

    def write(self, source: str, paths: Sequence[str], deaths: float = SLOW, *, analysed: bool = False) -> None:
        """Note the files of a source that are read, or analysed, from now on; none: the handling is over."""
        note = json.dumps([source, list(paths), deaths, analysed]).encode() + b"\n" if paths else _EMPTY
        with self._lock, suppress(OSError):
            slot = self._slots.setdefault((source, analysed), len(self._slots))
            if self._handle is not None and slot < _MAX_SLOTS:
                write_at(self._handle, note if len(note) <= _SLOT_BYTES else _EMPTY, slot * _SLOT_BYTES)

    def clear(self) -> None:
        """Remove all notes."""
        with self._lock, suppress(OSError):
            if self._handle is not None:
                os.ftruncate(self._handle, 0)

    def close(self) -> None:
        """Remove all notes: the process ends properly."""
        self.clear()
        with self._lock:
            handle, self._handle = self._handle, None
            if handle is not None:
                os.close(handle)


def _blamed(data: bytes) -> list[Handled]:
    """Return the files in the notes of a process that died: those analysed, else those read in the background.

    An analysis takes milliseconds, reading in the background up to many seconds, so it goes on meanwhile.
    """
    found: dict[bool, list[Handled]] = {True: [], False: []}
    for place in range(0, len(data), _SLOT_BYTES):
        with suppress(ValueError, TypeError):
            source, paths, deaths, analysed = json.loads(data[place : place + _SLOT_BYTES].partition(b"\n")[0])
            found[bool(analysed)].append((str(source), tuple(map(str, paths)), float(deaths)))
    return found[True] or found[False]


def count_deaths(connection: sqlite3.Connection, handled: Sequence[Handled]) -> None:
    """Count a death, or half of one, for each file, within an open transaction."""
    connection.executemany(
        "INSERT INTO deaths VALUES (?, ?, ?) ON CONFLICT DO UPDATE SET times = times + excluded.times",
        [(source, path, deaths) for source, paths, deaths in handled for path in paths],
    )


_TABLES = (
    """CREATE TABLE IF NOT EXISTS files (
    source TEXT NOT NULL, path TEXT NOT NULL, size INTEGER NOT NULL, mtime_ns INTEGER NOT NULL, inode INTEGER NOT NULL,
    head_hash TEXT NOT NULL, content_hash TEXT NOT NULL, read_bytes INTEGER NOT NULL, samples INTEGER NOT NULL,
    verdict TEXT NOT NULL, block INTEGER, PRIMARY KEY (source, path)
) WITHOUT ROWID""",
    "CREATE INDEX IF NOT EXISTS files_by_content ON files (source, head_hash, content_hash)",
    "CREATE INDEX IF NOT EXISTS files_by_verdict ON files (source, verdict)",
    "CREATE INDEX IF NOT EXISTS files_by_block ON files (block)",
    "CREATE INDEX IF NOT EXISTS blocks_by_content ON blocks (source, content_hash)",
    """CREATE TABLE IF NOT EXISTS stream_resets (
    source TEXT NOT NULL, resets INTEGER NOT NULL, first INTEGER NOT NULL, number INTEGER NOT NULL,
    UNIQUE (source, resets)
)""",
    _DEATHS,
)
_NOTES_NAME = "handling"
_SUSPECTS = "SELECT source, path, times FROM deaths"
_POISONED = f"SELECT source, path FROM files WHERE verdict = '{POISONED}' ORDER BY source, path"
_COLUMNS = ", ".join(field.name for field in fields(FileProgress))
_MAX_ALIKE = 8
DATING = "dating:"
"""Begins the keys in the table ``meta`` of what dates the blocks of each source."""
_FRAME_NAME = re.compile(r"\[(\d+):(\d+)\]$")
"""End of the name of a block of a stream that was reset, see :meth:`streams.types.source.StreamCount.name_of`."""
SALVAGED_UP_TO = "salvaged_up_to"
"""Key in the table ``meta`` of the id of the last block that a salvage left in the store."""


class StoreLedger(Closing):
    """A :class:`streams.types.source.Ledger` on an open store; reading is allowed from any thread.

    All methods raise :class:`StoreError` where the database cannot be read or written.
    """

    def __init__(self, store: Store) -> None:
        """Take an open store, and make the tables that it lacks; close the ledger before the store."""
        self._store = store
        self._notes: HandlingNotes | None = None
        self._deaths: dict[tuple[str, str], float] = {}
        if store.writable:
            self._notes = HandlingNotes(store.path.with_name(_NOTES_NAME))
            with store.transaction() as connection:
                for statement in _TABLES:
                    if "files_by_block" in statement:
                        _add_block(connection)
                    connection.execute(statement)
                count_deaths(connection, self._notes.left)
                self._deaths = {(source, path): times for source, path, times in connection.execute(_SUSPECTS)}
            self._notes.clear()
        # The connection of the store belongs to the thread that commits.
        self._reader = SharedConnection(store.path)

    def close(self) -> None:
        """Close the ledger's own connection, and remove the notes of what is handled."""
        if self._notes is not None:
            self._notes.close()
        self._reader.close()

    def committed(self, source: str) -> int:
        """Return the highest committed sequence number of a source up to ``MAX_BLOCK``, 0 where there is none."""
        return self._first(LAST_QUERY, source, MAX_BLOCK)

    def stream(self, source: str) -> StreamCount:
        """Return how a stream counts since its latest reset, and where it stands."""
        count = self._count(source)
        return replace(count, last=max(self.committed(source), count.number - 1))

    def _count(self, source: str) -> StreamCount:
        known = StreamCount()
        if self._first("SELECT 1 FROM sqlite_master WHERE name = 'stream_resets'"):
            query = "SELECT resets, first, number FROM stream_resets WHERE source = ? ORDER BY resets DESC LIMIT 1"
            known = next((StreamCount(*row) for row in self._reader.rows(query, source)), known)
        # A store made again from published files has lost the table, but not the names.
        query = "SELECT sequence, name FROM blocks WHERE source = ? ORDER BY id DESC LIMIT 1"
        for number, name in self._reader.rows(query, source):
            match = _FRAME_NAME.search(name)
            if match is not None and int(match[1]) > known.resets:
                offset = number - int(match[2])
                return StreamCount(int(match[1]), max(1, 1 - offset), max(1, 1 + offset))
        return known

    def reset_stream(
        self, source: str, first: int, utc: float, notice_of: Callable[[StreamCount], Mapping[str, Any]]
    ) -> StreamCount:
        """Let the next frame of a stream have the number ``first``, while the numbers of its blocks go on.

        In the same transaction a notice at ``utc`` (seconds since 1970) is added to the event log, which must exist;
        ``notice_of`` is given how the stream counts from now on.
        """
        before = self.stream(source)
        count = StreamCount(before.resets + 1, first, before.last + 1, before.last)
        with self._store.transaction() as connection:
            values = (source, count.resets, count.first, count.number)
            connection.execute("INSERT INTO stream_resets VALUES (?, ?, ?, ?)", values)
            write_notice(connection, utc, notice_of(count))
        return count

    def began(self, source: str) -> float | None:
        """Return the start of the first dated block of a source, seconds since 1970 UTC, or None."""
        return first_start(self._reader, source)

    def content_of(self, source: str, sequence: int) -> str | None:
        """Return the content hash of the block committed under a number, or None."""
        found = self._first("SELECT content_hash FROM blocks WHERE source = ? AND sequence = ?", source, sequence)
        if found is not None:
            return found
        with self._reader.connection() as connection:
            return identity_of(connection, source, sequence)

    def known(self, source: str, content_hash: str) -> int | None:
        """Return the number of a committed block with this content, or None."""
        with self._reader.connection() as connection:
            condensed = numbers_with(connection, source, content_hash)
        query = "SELECT min(sequence) FROM blocks WHERE source = ? AND content_hash = ?"
        return self._first(query, source, content_hash) if condensed is None else condensed

    def number_of(self, source: str, name: str, content_hash: str) -> int | None:
        """Return the number of a salvaged block, of the latest ones, with this name and content, or None.

        Only a salvage may lose the progress of files, so that their blocks are offered again. Blocks committed later
        are not compared: a new file may have the content of an older one. Of condensed blocks the name is not known.
        """
        found = self._first(
            "SELECT sequence FROM (SELECT sequence, name FROM blocks WHERE source = ? AND content_hash = ?"
            " AND id <= (SELECT CAST(value AS INTEGER) FROM meta WHERE key = ?)"
            f" ORDER BY id DESC LIMIT {_MAX_ALIKE * _MAX_ALIKE}) WHERE name = ?",
            *(source, content_hash, SALVAGED_UP_TO, storable(name)),
        )
        if found is not None or not self._first("SELECT 1 FROM meta WHERE key = ?", SALVAGED_UP_TO):
            return found
        with self._reader.connection() as connection:
            return numbers_with(connection, source, content_hash)

    def file(self, source: str, path: str) -> FileProgress | None:
        """Return the progress of a file, or None."""
        found = self._reader.rows(f"SELECT {_COLUMNS} FROM files WHERE source = ? AND path = ?", source, path)
        return FileProgress(*found[0]) if found else None

    def files_like(self, source: str, head_hash: str, content_hash: str) -> list[FileProgress]:
        """Return files with this content, then some with the same head."""
        query = f"SELECT {_COLUMNS} FROM files WHERE source = ? AND head_hash = ? AND content_hash"
        same = self._reader.rows(f"{query} = ? LIMIT {_MAX_ALIKE}", source, head_hash, content_hash)
        alike = self._reader.rows(f"{query} <> ? LIMIT {_MAX_ALIKE}", source, head_hash, content_hash)
        return [FileProgress(*row) for row in (*same, *alike)]

    def pending_files(self, source: str) -> list[FileProgress]:
        """Return the files with pending samples."""
        query = f"SELECT {_COLUMNS} FROM files WHERE source = ? AND verdict = 'pending'"
        return [FileProgress(*row) for row in self._reader.rows(query, source)]

    def file_counts(self, source: str) -> dict[str, int]:
        """Return the number of files by verdict."""
        return dict(self._reader.rows("SELECT verdict, count(*) FROM files WHERE source = ? GROUP BY verdict", source))

    def _first(self, query: str, *values: Any) -> Any:
        """Return the first value of the first row, or None."""
        found = self._reader.rows(query, *values)
        return found[0][0] if found else None

    def remember(self, source: str, progress: Iterable[FileProgress]) -> None:
        """Store the progress of files in a transaction of its own."""
        with self._store.transaction() as connection:
            write_progress(connection, source, progress)

    def dating(self, source: str) -> dict[str, Any] | None:
        """Return what dates the blocks of a source, or None."""
        return read_dating(self._store, source)

    def keep_dating(self, source: str, dating: Mapping[str, Any]) -> None:
        """Store what dates the blocks of a source, in a transaction of its own."""
        keep_dating(self._store, source, dating)

    def move(self, source: str, path: str, progress: FileProgress) -> None:
        """Replace the progress of the file ``path`` by that under its new name."""
        with self._store.transaction() as connection:
            connection.execute("DELETE FROM files WHERE source = ? AND path = ?", (source, path))
            write_progress(connection, source, [progress])

    def handle(self, source: str, paths: Sequence[str]) -> None:
        """Note which files of a source are read from now on; see the head of this module."""
        if self._notes is not None:
            self._notes.write(source, paths)

    def analyse(self, source: str, paths: Sequence[str], size: int = 0) -> None:
        """Note the files of the block, of ``size`` bytes, that is analysed from now on; none at its end."""
        if self._notes is not None:
            self._notes.write(source, paths, SLOW if size >= LARGE_BYTES else QUICK, analysed=True)

    def deaths(self, source: str, path: str) -> float:
        """Return how often in a row the process died while it handled a file."""
        return self._deaths.get((source, path), 0)

    def survive(self, source: str, progress: Iterable[FileProgress]) -> None:
        """Forget the deaths of files that have a verdict by now."""
        for item in progress:
            if item.verdict != PENDING and self._deaths.pop((source, item.path), 0.0):
                with self._store.transaction() as connection:
                    connection.execute("DELETE FROM deaths WHERE source = ? AND path = ?", (source, item.path))

    def released(self, source: str) -> list[str]:
        """Return the poisoned files that are to be handled again, and forget their deaths."""
        query = "SELECT path FROM files WHERE source = ? AND verdict = ?"
        found = [path for (path,) in self._reader.rows(query, source, RELEASED)]
        for path in found:
            self._deaths.pop((source, path), None)
        return found

    def poisoned(self) -> list[tuple[str, str]]:
        """Return source and path of all poisoned files."""
        return self._reader.rows(_POISONED)

    def refuse(self, item: Rejected, progress: Iterable[FileProgress]) -> None:
        """Count the offer of a block that is ``duplicate`` or ``changed``, and store the progress of its files."""
        with self._store.transaction() as connection:
            count_refusal(connection, item, item.status)
            write_progress(connection, item.source, progress)


def read_dating(store: Store, source: str) -> dict[str, Any] | None:
    """Return what dates the blocks of a source (:class:`streams.dates.dating.Dating`), or None."""
    found = store.rows("SELECT value FROM meta WHERE key = ?", f"{DATING}{source}")
    return json.loads(found[0][0]) if found else None


def keep_dating(store: Store, source: str, dating: Mapping[str, Any]) -> None:
    """Store what dates the blocks of a source."""
    text = json.dumps(dict(dating), allow_nan=False)
    with store.transaction() as connection:
        connection.execute("INSERT OR REPLACE INTO meta VALUES (?, ?)", (f"{DATING}{source}", text))


def _add_block(connection: sqlite3.Connection) -> None:
    """Add the column ``block`` to a table of files of an older version, where it stays empty."""
    if "block" not in {row[1] for row in connection.execute("PRAGMA table_info(files)")}:
        connection.execute("ALTER TABLE files ADD COLUMN block INTEGER")


class ReleaseError(SpallwatchError):
    """There is no poisoned file of that name; the message names the known ones."""


def release(path: Path, name: str) -> list[tuple[str, str]]:
    """Let poisoned files be handled again, also by a daemon that runs; return their sources and paths.

    Args:
        path: the database of the store.
        name: path of a file below the watched folder, or its last part.

    Raises:
        ReleaseError: no poisoned file has that name.
        StoreError: the database cannot be opened, read or written.
    """
    with SharedConnection(path, write=True, tables=_TABLES) as shared, shared.connection() as connection:
        connection.execute("BEGIN IMMEDIATE")
        # A file that stands for the kind of all others cannot be rejected before that is known.
        unsaid = f"SELECT source, path FROM deaths WHERE times >= {MAX_DEATHS}"
        known = sorted({*connection.execute(_POISONED), *connection.execute(unsaid)})
        found = [item for item in known if name in (item[1], item[1].rpartition("/")[2])]
        connection.executemany("DELETE FROM deaths WHERE source = ? AND path = ?", found)
        connection.executemany(
            f"UPDATE files SET verdict = '{RELEASED}' WHERE source = ? AND path = ? AND verdict = '{POISONED}'", found
        )
        connection.execute("COMMIT")
    if not found:
        listed = ", ".join(f"{item[1]} ({item[0]})" for item in known) or "none"
        raise ReleaseError(f"no poisoned file is called {name!r}; poisoned are: {listed}")
    return found


def write_progress(connection: sqlite3.Connection, source: str, progress: Iterable[FileProgress]) -> None:
    """Write the progress of files within an open transaction, with the number of the latest block of the ledger."""
    values = "VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, (SELECT max(id) FROM blocks))"
    statement = f"INSERT OR REPLACE INTO files (source, {_COLUMNS}, block) {values}"
    connection.executemany(statement, [(source, *astuple(item)) for item in progress])
