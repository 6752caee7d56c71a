"""The index of an archive: an SQLite database with a row for each recording, also for tens of millions of them.

A recording that others continue is the first of a history; the further ones stand in the table ``links``. URLs have no
credentials. What is left to do is found by an index over the rows that wait, so that a resumed run begins at once.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import astuple
from pathlib import Path
from typing import Any, NamedTuple

from models.work.codec import decode, encode
from monitor.fleet.history import Position
from monitor.fleet.index_file import ArchiveIndexError, open_database
from monitor.fleet.result import RecordingResult
from monitor.records.database import Closing

WAITING, DONE, FAILED, SET_ASIDE = range(4)
_MAX_TAKEN = 100_000
"""Names of several recordings of which the largest number is known; of others it is sought."""
STATUS_WORDS = ("waiting", "done", "failed", "set_aside")


class Waiting(NamedTuple):
    """A recording that is not replayed yet.

    Attributes:
        id: its number.
        setup: digest of the configuration of its machine.
        history: "each" or "continued".
        attempt: how often it failed in runs before.
    """

    id: int
    machine: str
    setup: str
    history: str
    name: str
    url: str
    attempt: int


class Checkpoint(NamedTuple):
    """Where a history stands: where its next part begins, from which state, and the result of the parts before.

    It is kept in plain types, since a history may go on years later.
    """

    position: Position
    state: str | None
    result: RecordingResult

    def packed(self) -> bytes:
        """Return it as bytes."""
        return encode((list(astuple(self.position)), self.state, self.result.to_json()))

    @classmethod
    def unpacked(cls, data: bytes) -> Checkpoint | None:
        """Return it from its bytes, None where they are of another version: the history is then replayed anew."""
        try:
            position, state, result = decode(data)
            return cls(Position(*position), state, RecordingResult.from_json(result))
        except (ValueError, TypeError, KeyError):
            return None


class Outcome(NamedTuple):
    """What the index keeps of a recording that is replayed, failed or set aside.

    ``end`` is the checkpoint at the end of a history that was replayed, from which it can go on later.
    """

    id: int
    status: int
    rows: int = 0
    first: float | None = None
    last: float | None = None
    seconds: float = 0.0
    chunk: str | None = None
    reason: str | None = None
    log: str | None = None
    end: Checkpoint | None = None


class Counts(NamedTuple):
    """Recordings by status; rows of records and seconds of work of all that were replayed, failed ones included."""

    waiting: int = 0
    done: int = 0
    failed: int = 0
    set_aside: int = 0
    rows: int = 0
    seconds: float = 0.0

    @property
    def recordings(self) -> int:
        """All of them."""
        return self.waiting + self.done + self.failed + self.set_aside


class Later(NamedTuple):
    """Recordings that came after an archive was planned: how many they are, and the first, "" where there is none."""

    recordings: int = 0
    first: str = ""


class Index(Closing):
    """The index, open in one process; :class:`ArchiveIndexError` where the file cannot be read or written."""

    def __init__(self, path: Path, *, read_only: bool = False) -> None:
        """Open the index at ``path``, or make it where there is none and it is not ``read_only``.

        Raises:
            ForeignIndexError: something else is there; it is left as it is.
        """
        self.path = path
        self._taken: dict[tuple[int, str], int] = {}
        self._connection = open_database(path, read_only=read_only)

    def close(self) -> None:
        """Close it, all outcomes in one file; closing twice does nothing."""
        # Another file beside it would be needed to read it in a folder that may not be written to.
        with suppress(sqlite3.Error):
            self._connection.execute("PRAGMA journal_mode = DELETE")
        self._connection.close()

    def settle(self) -> None:
        """Bring the outcomes of the write-ahead log into the file itself, so that it can be copied."""
        self.run("PRAGMA wal_checkpoint(TRUNCATE)")

    def meta(self) -> dict[str, str]:
        """Return what is kept of the archive as a whole."""
        return dict(self.run("SELECT key, value FROM meta").fetchall())

    @property
    def planned(self) -> bool:
        """Whether it holds the recordings of a manifest."""
        return "manifest" in self.meta()

    def set_meta(self, **values: str) -> None:
        """Keep values of the archive as a whole."""
        for pair in values.items():
            self.run("INSERT OR REPLACE INTO meta VALUES (?, ?)", *pair)

    def begin(self) -> None:
        """Begin a transaction."""
        self.run("BEGIN IMMEDIATE")

    def commit(self) -> None:
        """End the transaction."""
        self.run("COMMIT")

    def rollback(self) -> None:
        """Undo the transaction, where there is one."""
        self._taken.clear()
        if self._connection.in_transaction:
            self.run("ROLLBACK")

    def add_machine(self, name: str, setup: str, history: str) -> int:
        """Add a machine and return its number."""
        return self._inserted("INSERT INTO machines (name, setup, history) VALUES (?, ?, ?)", name, setup, history)

    def add_recording(self, machine: int, name: str, url: str) -> int:
        """Add the first recording of a history under ``name``, or NAME-2, ..., and return its number."""
        statement = "INSERT OR IGNORE INTO recordings (machine, name, url) VALUES (?, ?, ?)"
        number = self._taken.get((machine, name), 0) + 1
        while True:
            cursor = self.run(statement, machine, name if number == 1 else f"{name}-{number}", url)
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
        return self.run(
            "SELECT machines.name, url FROM (SELECT machine, url FROM recordings UNION ALL SELECT machine, links.url"
            " FROM links JOIN recordings ON recordings.id = recording) JOIN machines ON machines.id = machine"
            " GROUP BY machine, url HAVING count(*) > 1 LIMIT 1"
        ).fetchone()

    def add_link(self, recording: int, place: int, url: str) -> None:
        """Add the recording at a place (from 1) of a history."""
        self.run("INSERT INTO links VALUES (?, ?, ?)", recording, place, url)

    def waiting(self) -> Iterator[Waiting]:
        """Yield the recordings that are not replayed yet; they may be noted meanwhile."""
        query = (
            "SELECT recordings.id, machines.name, setup, history, recordings.name, url, attempt FROM recordings"
            " JOIN machines ON machines.id = machine WHERE status = 0 AND recordings.id > ?"
            " ORDER BY recordings.id LIMIT 512"
        )
        last = 0
        while rows := self.run(query, last).fetchall():
            yield from (Waiting(*row) for row in rows)
            last = rows[-1][0]

    def links(self, recording: int, after: int, most: int) -> list[str]:
        """Return at most so many recordings of a history behind a place."""
        query = "SELECT url FROM links WHERE recording = ? AND place > ? ORDER BY place LIMIT ?"
        return [row[0] for row in self.run(query, recording, after, most)]

    def last_link(self, recording: int) -> int:
        """Return the place of the last recording of a history, 0 where there is one alone."""
        return self.run("SELECT coalesce(max(place), 0) FROM links WHERE recording = ?", recording).fetchone()[0]

    def not_in_it(self, recordings: Iterable[tuple[str, str]]) -> Later:
        """Return which of some recordings, by machine and URL, it does not hold."""
        self.run("CREATE TEMP TABLE named (machine TEXT, url TEXT)")
        try:
            self.begin()
            for pair in recordings:
                self.run("INSERT INTO named VALUES (?, ?)", *pair)
            self.commit()
            row = self.run(
                "SELECT count(*), coalesce(min(url), '') FROM (SELECT machine, url FROM named"
                " EXCEPT SELECT machines.name, url FROM recordings JOIN machines ON machines.id = machine"
                " EXCEPT SELECT machines.name, links.url FROM links JOIN recordings ON recordings.id = recording"
                " JOIN machines ON machines.id = machine)"
            ).fetchone()
        finally:
            self.rollback()
            self.run("DROP TABLE named")
        return Later(*row)

    def note(self, outcomes: Iterable[Outcome]) -> None:
        """Note outcomes in one transaction."""
        self.begin()
        try:
            for outcome in outcomes:
                self.run(
                    "UPDATE recordings SET status = ?, rows = ?, first = ?, last = ?, seconds = ?, chunk = ?,"
                    " reason = ?, log = ? WHERE id = ?",
                    *(*outcome[1:-1], outcome.id),
                )
                if outcome.end is not None:
                    self.keep_checkpoint(outcome.id, outcome.end)
                elif outcome.status == DONE:
                    self.run("DELETE FROM checkpoints WHERE recording = ?", outcome.id)
            self.commit()
        except BaseException:
            self.rollback()
            raise

    def keep_folders(self, recording: int, folders: Iterable[tuple[str, int]]) -> None:
        """Keep how many files were in folders that were read for a recording."""
        for url, files in folders:
            self.run("INSERT OR REPLACE INTO folders VALUES (?, ?, ?)", recording, url, files)

    def folders_read(self) -> Iterator[tuple[str, int]]:
        """Yield the folders that were read, with the number of files in them then."""
        yield from self.run("SELECT url, files FROM folders ORDER BY recording, url")

    def keep_checkpoint(self, recording: int, value: Checkpoint) -> None:
        """Keep where a history stands."""
        self.run("INSERT OR REPLACE INTO checkpoints VALUES (?, ?)", recording, value.packed())

    def checkpoint(self, recording: int) -> Checkpoint | None:
        """Return where a history stands or ends, also one that failed later; None where no part has left its state."""
        row = self.run("SELECT body FROM checkpoints WHERE recording = ?", recording).fetchone()
        return None if row is None else Checkpoint.unpacked(row[0])

    def checkpoints(self) -> Iterator[tuple[int, Checkpoint]]:
        """Yield the number of each history that has a checkpoint, with it."""
        for (number,) in self.run("SELECT recording FROM checkpoints ORDER BY recording").fetchall():
            if (found := self.checkpoint(number)) is not None:
                yield number, found

    def begin_anew(self, row: Waiting) -> Waiting:
        """Let a history begin at its first recording, as another attempt, and return its row."""
        self.run("DELETE FROM checkpoints WHERE recording = ?", row.id)
        # Chunks of the attempts before name states that may be gone.
        self.run("UPDATE recordings SET attempt = attempt + 1 WHERE id = ?", row.id)
        return row._replace(attempt=row.attempt + 1)

    def wait_again(self) -> int:
        """Let recordings that failed or were set aside wait again; return how many they are."""
        return self.run("UPDATE recordings SET status = 0, attempt = attempt + 1 WHERE status > 1").rowcount

    def counts(self) -> Counts:
        """Count the recordings; the sums take a pass over all of them."""
        rows = self.run("SELECT status, count(*), sum(rows), sum(seconds) FROM recordings GROUP BY status").fetchall()
        numbers = {status: number for status, number, _, _ in rows}
        return Counts(
            *(numbers.get(status, 0) for status in range(len(STATUS_WORDS))),
            rows=sum(row[2] or 0 for row in rows),
            seconds=sum(row[3] or 0.0 for row in rows),
        )

    def left(self) -> int:
        """Return how many recordings wait, by the index over them alone."""
        return self.run("SELECT count(*) FROM recordings WHERE status = 0").fetchone()[0]

    def wrong(self, most: int = -1) -> Iterator[tuple[str, Outcome]]:
        """Yield those that failed or were set aside, as "MACHINE/RECORDING" with their outcome, at most so many."""
        query = (
            "SELECT machines.name || '/' || recordings.name, recordings.id, status, coalesce(rows, 0), first, last,"
            " coalesce(seconds, 0), chunk, reason, log FROM recordings JOIN machines ON machines.id = machine"
            " WHERE status > 1 ORDER BY recordings.id LIMIT ?"
        )
        for name, *values in self.run(query, most):
            yield name, Outcome(*values)

    def folders(self) -> Iterator[tuple[str, str]]:
        """Yield machine and name of all recordings that do not wait, in the order of the manifest."""
        query = (
            "SELECT recordings.id, machines.name, recordings.name FROM recordings"
            " JOIN machines ON machines.id = machine WHERE status > 0 AND recordings.id > ?"
            " ORDER BY recordings.id LIMIT 512"
        )
        last = 0
        while rows := self.run(query, last).fetchall():
            yield from ((machine, name) for _, machine, name in rows)
            last = rows[-1][0]

    def _inserted(self, statement: str, *values: Any) -> int:
        return self.run(statement, *values).lastrowid or 0

    def run(self, statement: str, *values: Any) -> sqlite3.Cursor:
        """Run one statement of SQL; :class:`ArchiveIndexError` where it fails."""
        try:
            return self._connection.execute(statement, values)
        except sqlite3.Error as error:
            raise ArchiveIndexError(f"{self.path}: {error}") from error
