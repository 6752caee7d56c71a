"""The index of an archive: an SQLite database with a row for each recording, also for tens of millions of them.

A recording that others continue is the first of a history; the further ones stand in the table ``links``. URLs have no
credentials. What is left to do is found by an index over the rows that wait, so that a resumed run begins at once.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

from models.words.errors import SpallwatchError
from monitor.fleet.result import DONE, STATUS_WORDS, Checkpoint, Counts, Later, RecordingOutcome, Waiting
from monitor.records.database import Closing

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
_MAX_TAKEN = 100_000
"""Names of several recordings of which the largest number is known; of others it is sought."""
_TABLES = ("known", "named", "known_links", "named_links")
_EACH = """
CREATE TEMP TABLE {table} AS SELECT recordings.id AS id, machines.name AS machine, url
FROM {schema}.recordings JOIN {schema}.machines ON machines.id = machine WHERE history = 'each'
"""
_CONTINUED = """
CREATE TEMP TABLE {table} AS WITH histories AS (
    SELECT recordings.id AS id, machines.name AS machine, recordings.name AS name, url,
        row_number() OVER (PARTITION BY machines.name ORDER BY recordings.id) AS nth
    FROM {schema}.recordings JOIN {schema}.machines ON machines.id = machine WHERE history = 'continued')
SELECT id, machine, name, nth, 0 AS place, url FROM histories UNION ALL
SELECT id, machine, name, nth, place, links.url FROM histories JOIN {schema}.links ON recording = id
"""
_FURTHER = """
SELECT new.id, machine, new.url, 1 FROM named AS new LEFT JOIN known AS old USING (machine, url)
WHERE old.id IS NULL UNION ALL
SELECT new.id, machine, new.url, 0 FROM named_links AS new LEFT JOIN known_links AS old USING (machine, nth, place)
WHERE new.place = 0 AND old.id IS NULL ORDER BY 1
"""
_LONGER = """
SELECT old.id, new.place, new.url FROM named_links AS new JOIN known_links AS old USING (machine, nth)
LEFT JOIN known_links AS same ON same.machine = new.machine AND same.nth = new.nth AND same.place = new.place
WHERE old.place = 0 AND same.id IS NULL ORDER BY old.id, new.place
"""


class ArchiveIndexError(SpallwatchError):
    """The index cannot be read or written; the message names the file and the cause."""


class ForeignIndexError(ArchiveIndexError):
    """A file in the place of the index is something else, or of a later version; the message names it."""


class MachineChange(NamedTuple):
    """A machine of an archive beside that of another plan: kind of history before and now, None without it."""

    machine: str
    before: str
    now: str | None
    same_setup: int | None


class HistoryChange(NamedTuple):
    """A place (from 0) of a history at which an archive and another plan name different recordings."""

    machine: str
    history: str
    place: int
    before: str
    now: str | None


class Index(Closing):
    """The index, open in one process; :class:`ArchiveIndexError` where the file cannot be read or written."""

    def __init__(self, path: Path, *, read_only: bool = False) -> None:
        """Open the index at ``path``, or make it where there is none and it is not ``read_only``.

        Raises:
            ForeignIndexError: something else is there; it is left as it is.
        """
        self.path = path
        self._taken: dict[tuple[int, str], int] = {}
        self._connection = _open_database(path, read_only=read_only)

    def close(self) -> None:
        """Close it, all outcomes in one file; closing twice does nothing."""
        # Another file beside it would be needed to read it in a folder that may not be written to.
        with suppress(sqlite3.Error):
            self._connection.execute("PRAGMA journal_mode = DELETE")
        self._connection.close()

    def settle(self) -> None:
        """Bring the outcomes of the write-ahead log into the file itself, so that it can be copied."""
        self._run("PRAGMA wal_checkpoint(TRUNCATE)")

    def meta(self) -> dict[str, str]:
        """Return what is kept of the archive as a whole."""
        return dict(self._run("SELECT key, value FROM meta").fetchall())

    @property
    def planned(self) -> bool:
        """Whether it holds the recordings of a manifest."""
        return "manifest" in self.meta()

    def set_meta(self, **values: str) -> None:
        """Keep values of the archive as a whole."""
        for pair in values.items():
            self._run("INSERT OR REPLACE INTO meta VALUES (?, ?)", *pair)

    @contextmanager
    def all_or_nothing(self) -> Iterator[None]:
        """Write all of a block, or nothing where it raises."""
        self._run("BEGIN IMMEDIATE")
        try:
            yield
            self._run("COMMIT")
        except BaseException:
            self._taken.clear()
            if self._connection.in_transaction:
                self._run("ROLLBACK")
            raise

    def add_machine(self, name: str, setup: str, history: str) -> int:
        """Add a machine and return its number."""
        return self._inserted("INSERT INTO machines (name, setup, history) VALUES (?, ?, ?)", name, setup, history)

    def add_recording(self, machine: int, name: str, url: str) -> int:
        """Add the first recording of a history under ``name``, or NAME-2, ..., and return its number."""
        statement = "INSERT OR IGNORE INTO recordings (machine, name, url) VALUES (?, ?, ?)"
        number = self._taken.get((machine, name), 0) + 1
        while True:
            cursor = self._run(statement, machine, name if number == 1 else f"{name}-{number}", url)
            if cursor.rowcount:
                break
            number += 1
        if number > 1:
            # Thousands of recordings may share a name, as /srv/press-7/*/raw do.
            if len(self._taken) >= _MAX_TAKEN:
                self._taken.clear()
            self._taken[machine, name] = number
        return cursor.lastrowid or 0

    def given_twice(self) -> tuple[str, str] | None:
        """Return machine and URL of a recording that a machine has more than once; it sorts all of them."""
        return self._run(
            "SELECT machines.name, url FROM (SELECT machine, url FROM recordings UNION ALL SELECT machine, links.url"
            " FROM links JOIN recordings ON recordings.id = recording) JOIN machines ON machines.id = machine"
            " GROUP BY machine, url HAVING count(*) > 1 LIMIT 1"
        ).fetchone()

    def add_link(self, recording: int, place: int, url: str) -> None:
        """Add the recording at a place (from 1) of a history."""
        self._run("INSERT INTO links VALUES (?, ?, ?)", recording, place, url)

    def waiting(self) -> Iterator[Waiting]:
        """Yield the recordings that are not replayed yet; they may be noted meanwhile."""
        rows = self._pages("machines.name, setup, history, recordings.name, url, attempt", "status = 0")
        return (Waiting(*row) for row in rows)

    def links(self, recording: int, after: int, most: int) -> list[str]:
        """Return at most so many recordings of a history behind a place."""
        query = "SELECT url FROM links WHERE recording = ? AND place > ? ORDER BY place LIMIT ?"
        return [row[0] for row in self._run(query, recording, after, most)]

    def last_link(self, recording: int) -> int:
        """Return the place of the last recording of a history, 0 where there is one alone."""
        return self._run("SELECT coalesce(max(place), 0) FROM links WHERE recording = ?", recording).fetchone()[0]

    def not_in_it(self, recordings: Iterable[tuple[str, str]]) -> Later:
        """Return which of some recordings, by machine and URL, it does not hold."""
        self._run("CREATE TEMP TABLE named (machine TEXT, url TEXT)")
        try:
            with self.all_or_nothing():
                for pair in recordings:
                    self._run("INSERT INTO named VALUES (?, ?)", *pair)
            row = self._run(
                "SELECT count(*), coalesce(min(url), '') FROM (SELECT machine, url FROM named"
                " EXCEPT SELECT machines.name, url FROM recordings JOIN machines ON machines.id = machine"
                " EXCEPT SELECT machines.name, links.url FROM links JOIN recordings ON recordings.id = recording"
                " JOIN machines ON machines.id = machine)"
            ).fetchone()
        finally:
            self._run("DROP TABLE named")
        return Later(*row)

    def note(self, outcomes: Iterable[RecordingOutcome]) -> None:
        """Note outcomes in one transaction."""
        with self.all_or_nothing():
            for outcome in outcomes:
                self._run(
                    "UPDATE recordings SET status = ?, rows = ?, first = ?, last = ?, seconds = ?, chunk = ?,"
                    " reason = ?, log = ? WHERE id = ?",
                    *(*outcome[1:-1], outcome.id),
                )
                if outcome.end is not None:
                    self.keep_checkpoint(outcome.id, outcome.end)
                elif outcome.status == DONE:
                    self._run("DELETE FROM checkpoints WHERE recording = ?", outcome.id)

    def keep_folders(self, recording: int, folders: Iterable[tuple[str, int]]) -> None:
        """Keep how many files were in folders that were read for a recording."""
        for url, files in folders:
            self._run("INSERT OR REPLACE INTO folders VALUES (?, ?, ?)", recording, url, files)

    def folders_read(self) -> Iterator[tuple[str, int]]:
        """Yield the folders that were read, with the number of files in them then."""
        yield from self._run("SELECT url, files FROM folders ORDER BY recording, url")

    def keep_checkpoint(self, recording: int, value: Checkpoint) -> None:
        """Keep where a history stands."""
        self._run("INSERT OR REPLACE INTO checkpoints VALUES (?, ?)", recording, value.packed())

    def checkpoint(self, recording: int) -> Checkpoint | None:
        """Return where a history stands or ends, also one that failed later; None where no part has left its state."""
        row = self._run("SELECT body FROM checkpoints WHERE recording = ?", recording).fetchone()
        return None if row is None else Checkpoint.unpacked(row[0])

    def checkpoints(self) -> Iterator[tuple[int, Checkpoint]]:
        """Yield the number of each history that has a checkpoint, with it."""
        for (number,) in self._run("SELECT recording FROM checkpoints ORDER BY recording").fetchall():
            if (found := self.checkpoint(number)) is not None:
                yield number, found

    def begin_anew(self, row: Waiting) -> Waiting:
        """Let a history begin at its first recording, as another attempt, and return its row."""
        self._run("DELETE FROM checkpoints WHERE recording = ?", row.id)
        # Chunks of the attempts before name states that may be gone.
        self._run("UPDATE recordings SET attempt = attempt + 1 WHERE id = ?", row.id)
        return row._replace(attempt=row.attempt + 1)

    def wait_again(self) -> int:
        """Let recordings that failed or were set aside wait again; return how many they are."""
        return self._run("UPDATE recordings SET status = 0, attempt = attempt + 1 WHERE status > 1").rowcount

    def counts(self) -> Counts:
        """Count the recordings; the sums take a pass over all of them."""
        rows = self._run("SELECT status, count(*), sum(rows), sum(seconds) FROM recordings GROUP BY status").fetchall()
        numbers = {status: number for status, number, _, _ in rows}
        return Counts(
            *(numbers.get(status, 0) for status in range(len(STATUS_WORDS))),
            rows=sum(row[2] or 0 for row in rows),
            seconds=sum(row[3] or 0.0 for row in rows),
        )

    def left(self) -> int:
        """Return how many recordings wait, by the index over them alone."""
        return self._run("SELECT count(*) FROM recordings WHERE status = 0").fetchone()[0]

    def wrong(self, most: int = -1) -> Iterator[tuple[str, RecordingOutcome]]:
        """Yield those that failed or were set aside, as "MACHINE/RECORDING" with their outcome, at most so many."""
        query = (
            "SELECT machines.name || '/' || recordings.name, recordings.id, status, coalesce(rows, 0), first, last,"
            " coalesce(seconds, 0), chunk, reason, log FROM recordings JOIN machines ON machines.id = machine"
            " WHERE status > 1 ORDER BY recordings.id LIMIT ?"
        )
        for name, *values in self._run(query, most):
            yield name, RecordingOutcome(*values)

    def folders(self) -> Iterator[tuple[str, str]]:
        """Yield machine and name of all recordings that do not wait, in the order of the manifest."""
        return ((machine, name) for _, machine, name in self._pages("machines.name, recordings.name", "status > 0"))

    def _pages(self, columns: str, condition: str) -> Iterator[tuple[Any, ...]]:
        """Yield number and columns of recordings in order; rows may change meanwhile."""
        query = (
            f"SELECT recordings.id, {columns} FROM recordings JOIN machines ON machines.id = machine"
            f" WHERE {condition} AND recordings.id > ? ORDER BY recordings.id LIMIT 512"
        )
        last = 0
        while rows := self._run(query, last).fetchall():
            yield from rows
            last = rows[-1][0]

    def _inserted(self, statement: str, *values: Any) -> int:
        return self._run(statement, *values).lastrowid or 0

    def machines(self) -> dict[str, int]:
        """Return the numbers of the machines by name, in the order of their numbers."""
        return dict(self._run("SELECT name, id FROM main.machines ORDER BY id").fetchall())

    @contextmanager
    def compared(self, planned: Path) -> Iterator[None]:
        """Attach another index as ``planned``, and list the recordings of both in temporary tables."""
        self._run("ATTACH ? AS planned", str(planned))
        try:
            for schema, each, links in (("main", "known", "known_links"), ("planned", "named", "named_links")):
                self._run(_EACH.format(schema=schema, table=each))
                self._run(f"CREATE INDEX temp.{each}_url ON {each} (machine, url)")
                self._run(_CONTINUED.format(schema=schema, table=links))
                self._run(f"CREATE INDEX temp.{links}_place ON {links} (machine, nth, place)")
            yield
        finally:
            for table in _TABLES:
                self._run(f"DROP TABLE IF EXISTS temp.{table}")
            self._run("DETACH planned")

    def machine_changes(self) -> list[MachineChange]:
        """Return all its machines beside those of the compared index."""
        query = (
            "SELECT old.name, old.history, new.history, old.setup = new.setup FROM main.machines AS old"
            " LEFT JOIN planned.machines AS new USING (name) ORDER BY old.id"
        )
        return [MachineChange(*row) for row in self._run(query)]

    def dropped(self) -> tuple[str, str] | None:
        """Return machine and URL of a recording that the compared index does not name, but for continued histories."""
        query = "SELECT machine, url FROM known EXCEPT SELECT machine, url FROM named ORDER BY 1, 2 LIMIT 1"
        return self._run(query).fetchone()

    def history_change(self) -> HistoryChange | None:
        """Return where a continued history of the compared index does not go on at its end, or None."""
        expected = (
            "SELECT machine, old.name, place, old.url, new.url FROM known_links AS old"
            " LEFT JOIN named_links AS new USING (machine, nth, place) WHERE new.url IS NOT old.url"
            " ORDER BY old.id, place LIMIT 1"
        )
        more = (
            "SELECT machine, new.name, place, 'nothing', new.url FROM named_links AS new"
            " LEFT JOIN known_links AS old USING (machine, nth, place) WHERE old.url IS NULL"
            " AND nth < (SELECT max(nth) FROM known_links WHERE machine = new.machine) ORDER BY new.id, place LIMIT 1"
        )
        rows = (row for query in (expected, more) for row in self._run(query).fetchall())
        return next((HistoryChange(*row) for row in rows), None)

    def add_compared(self, name_of: Callable[[str, bool], str]) -> Iterator[str]:
        """Add what the compared index has besides, and let longer histories wait; yield each recording.

        ``name_of`` names a recording by its URL and whether it is one alone.
        """
        self._run(
            "INSERT INTO main.machines (name, setup, history) SELECT name, setup, history FROM planned.machines"
            " WHERE name NOT IN (SELECT name FROM main.machines) ORDER BY id"
        )
        for recording, place, url in self._run(_LONGER):
            self.add_link(recording, place, url)
            # Replayed from its beginning it is another attempt: chunks of the first one name states that are gone.
            self._run(
                "UPDATE main.recordings SET status = 0,"
                " attempt = attempt + (id NOT IN (SELECT recording FROM checkpoints)) WHERE id = ? AND status = ?",
                *(recording, DONE),
            )
            yield url
        machines = self.machines()
        for number, machine, url, each in self._run(_FURTHER):
            added = self.add_recording(machines[machine], name_of(url, bool(each)), url)
            yield url
            for place, link in self._run(
                "SELECT place, url FROM planned.links WHERE recording = ? ORDER BY place", number
            ):
                self.add_link(added, place, link)
                yield link

    def _run(self, statement: str, *values: Any) -> sqlite3.Cursor:
        """Run one statement of SQL; :class:`ArchiveIndexError` where it fails."""
        try:
            return self._connection.execute(statement, values)
        except sqlite3.Error as error:
            raise ArchiveIndexError(f"{self.path}: {error}") from error


def _open_database(path: Path, *, read_only: bool) -> sqlite3.Connection:
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
