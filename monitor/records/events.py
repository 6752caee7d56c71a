"""The event log: events of blocks, notices without a block, acknowledgements, and progress of notification channels.

Events of a block are part of its record. Notices (a silence, a failed notification) are no part of any, so that records
do not depend on how they were made. Rows are never changed or deleted: an acknowledgement is a row of its own.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from monitor.records.database import Readable, SharedConnection

_TABLES = (
    "CREATE TABLE IF NOT EXISTS notices (id INTEGER PRIMARY KEY, utc REAL NOT NULL, body TEXT NOT NULL)",
    """CREATE TABLE IF NOT EXISTS acknowledgements (
    id INTEGER PRIMARY KEY, event TEXT NOT NULL, utc REAL NOT NULL, who TEXT NOT NULL, note TEXT NOT NULL
)""",
    "CREATE INDEX IF NOT EXISTS acknowledgements_by_event ON acknowledgements (event)",
)
_EVENTS = """
SELECT events.id, CAST(events.id AS TEXT) AS name, source, sequence, time, body
FROM events JOIN blocks ON blocks.id = block
"""
_ACKNOWLEDGED = """
SELECT acknowledgements.id, acknowledgements.utc, CAST(events.id AS TEXT), source, sequence, time, body
FROM acknowledgements JOIN events ON events.id = CAST(event AS INTEGER) JOIN blocks ON blocks.id = block
WHERE acknowledgements.id > ? AND event NOT LIKE 'n%' AND json_extract(body, '$.kind') = 'alarm_raised'
ORDER BY acknowledgements.id
"""
_NOTICES = "SELECT id, 'n' || id, NULL, NULL, utc, body FROM notices"
_MAX_NOTE_CHARACTERS, _MAX_NAME_CHARACTERS = 2000, 100
WITHOUT_ACKNOWLEDGEMENT = (
    *("alarm_cleared", "alarm_released", "alarm_withdrawn", "condition", "data_again", "stream_reset"),
    *("baseline_relearned", "final_stage_closed"),
)
"""Kinds of events that need no acknowledgement."""
# The names of the tables are those of the first version.
_DELIVERY_TABLES = (
    """CREATE TABLE IF NOT EXISTS told (
    way TEXT PRIMARY KEY, event INTEGER NOT NULL, notice INTEGER NOT NULL, left_out INTEGER NOT NULL, sent TEXT NOT NULL
) WITHOUT ROWID""",
    "CREATE TABLE IF NOT EXISTS event_marks (event INTEGER PRIMARY KEY, utc REAL NOT NULL)",
    # Checkpoints are left to the connection that commits blocks.
    "PRAGMA wal_autocheckpoint = 0",
)
_SALVAGE_NEWS_S = 86400.0
_SALVAGE = "SELECT min(id) - 1 FROM notices WHERE utc > ? AND json_extract(body, '$.kind') LIKE '%salvage%'"


@dataclass(frozen=True)
class Acknowledgement:
    """Person, time (UTC seconds since 1970) and note of an acknowledgement."""

    who: str
    utc: float
    note: str


@dataclass(frozen=True)
class LoggedEvent:
    """An event of a block, or a notice, which has no source and block.

    Attributes:
        id: a number, or "n" and a number for a notice.
        utc: seconds since 1970 of the block (None if undated) or of the notice.
        body: ``kind``, ``channel`` and further keys of the kind.
        acknowledgements: in the order of time.
    """

    id: str
    source: str | None
    block: int | None
    utc: float | None
    body: Mapping[str, Any]
    acknowledgements: tuple[Acknowledgement, ...] = field(default=())

    @property
    def open(self) -> bool:
        """Whether it still needs an acknowledgement; the end of an alarm needs none."""
        return not self.acknowledgements and self.body.get("kind") not in WITHOUT_ACKNOWLEDGEMENT


def tables_of(connection: sqlite3.Connection) -> set[str]:
    """Return the names of the tables of a store; one that no daemon has opened lacks those of the log."""
    return {name for (name,) in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}


def count_unacknowledged(store: Readable) -> int:
    """Return how many events and notices of a store need an acknowledgement."""
    with store.connection() as connection:
        return _count_unacknowledged(connection)


def _count_unacknowledged(connection: sqlite3.Connection) -> int:
    tables = tables_of(connection)
    skipped = ", ".join(f"'{kind}'" for kind in WITHOUT_ACKNOWLEDGEMENT)
    total = 0
    for table, name in (("events", "CAST(events.id AS TEXT)"), ("notices", "'n' || notices.id")):
        query = f"SELECT count(*) FROM {table} WHERE json_extract(body, '$.kind') NOT IN ({skipped})"
        if "acknowledgements" in tables:
            query += f" AND NOT EXISTS (SELECT 1 FROM acknowledgements WHERE event = {name})"
        if table in tables:
            total += connection.execute(query).fetchone()[0]
    return total


def write_notice(connection: sqlite3.Connection, utc: float, body: Mapping[str, Any]) -> str:
    """Add a notice to a store in which an :class:`EventLog` was opened; return its name in the log."""
    values = (utc, json.dumps(body, allow_nan=False))
    return f"n{connection.execute('INSERT INTO notices (utc, body) VALUES (?, ?)', values).lastrowid}"


class EventLog(SharedConnection):
    """The log of a store, on a connection of its own."""

    def __init__(self, path: Path) -> None:
        """Open the log of the store at ``path``, and make the tables that it lacks."""
        super().__init__(path, write=True, tables=_TABLES)

    def events(self, after: int = 0, limit: int = 500) -> list[tuple[int, LoggedEvent]]:
        """Return the oldest events of blocks after a number, with their numbers."""
        rows = self.rows(f"{_EVENTS} WHERE events.id > ? ORDER BY events.id LIMIT ?", after, limit)
        return [(row[0], self._logged(row[1:])) for row in rows]

    def notices(self, after: int = 0, limit: int = 500) -> list[tuple[int, LoggedEvent]]:
        """Return the oldest notices after a number, with their numbers."""
        rows = self.rows(f"{_NOTICES} WHERE id > ? ORDER BY id LIMIT ?", after, limit)
        return [(row[0], self._logged(row[1:])) for row in rows]

    def event(self, name: str) -> LoggedEvent | None:
        """Return one event by its name in the log, or None."""
        notice = name.startswith("n")
        query, number = (f"{_NOTICES} WHERE id", name[1:]) if notice else (f"{_EVENTS} WHERE events.id", name)
        if not (number.isascii() and number.isdigit() and len(number) < 19):
            return None
        found = self.rows(f"{query} = ?", int(number))
        return self._logged(found[0][1:]) if found else None

    def notice(self, utc: float, body: Mapping[str, Any]) -> str:
        """Add a notice, and return its name in the log."""
        with self.connection() as connection:
            return write_notice(connection, utc, body)

    def acknowledge(self, name: str, who: str, note: str, utc: float) -> LoggedEvent:
        """Add an acknowledgement and return its event; ValueError for no event, no name, or too long a text."""
        who = self.check_words(who, note)
        found = self.event(name)
        if found is None:
            raise ValueError(f"there is no event {name!r}")
        query = "INSERT INTO acknowledgements (event, utc, who, note) VALUES (?, ?, ?, ?)"
        self.rows(query, found.id, utc, who, note)
        return self.event(name) or found

    @staticmethod
    def check_words(who: str, note: str) -> str:
        """Return a name without blanks around it; raise ValueError where it is none, or a text is too long."""
        who = who.strip()
        if not 0 < len(who) <= _MAX_NAME_CHARACTERS or len(note) > _MAX_NOTE_CHARACTERS:
            raise ValueError(
                f"who must have 1 to {_MAX_NAME_CHARACTERS} characters, a note at most {_MAX_NOTE_CHARACTERS}"
            )
        return who

    def unacknowledged(self) -> int:
        """Return how many events and notices still need an acknowledgement."""
        return count_unacknowledged(self)

    def acknowledged_alarms(self, after: int = 0) -> Iterator[tuple[int, float, LoggedEvent]]:
        """Yield number, time (UTC seconds since 1970) and alarm of each acknowledgement after a number, in order."""
        for number, utc, *event in self.rows(_ACKNOWLEDGED, after):
            yield number, utc, self._logged(event)

    def _logged(self, row: Any) -> LoggedEvent:
        name, source, block, utc, body = row
        query = "SELECT who, utc, note FROM acknowledgements WHERE event = ? ORDER BY id"
        given = tuple(Acknowledgement(*item) for item in self.rows(query, name))
        return LoggedEvent(name, source, block, utc, json.loads(body), given)


@dataclass(frozen=True)
class Delivered:
    """Progress of a notification channel.

    Attributes:
        event: number of the last event that was delivered or passed over.
        notice: the same of the notices.
        left_out: number of events that were given up and not yet counted in a message.
        sent: UTC seconds of the messages of the last hour.
    """

    event: int = 0
    notice: int = 0
    left_out: int = 0
    sent: tuple[float, ...] = ()


class Deliveries(SharedConnection):
    """The progress of all notification channels in the log.

    A channel that was killed between sending a message and writing its progress sends that message again; none is lost.
    A write does not wait for the disk: after a power cut the latest messages may be delivered again.
    """

    def __init__(self, path: Path) -> None:
        """Open the store at ``path``, and make the tables that it lacks."""
        super().__init__(path, write=True, synchronous="NORMAL", tables=_DELIVERY_TABLES)

    def begin(self, channels: Sequence[str], utc: float) -> None:
        """Set the progress of new channels to the end of the log, and delete that of removed channels.

        New channels also deliver a notice of a salvage that is less than a day old at ``utc``, seconds since 1970.
        """
        event, notice = self._end()
        for channel, *_ in self.rows("SELECT way FROM told"):
            if channel not in channels:
                self.rows("DELETE FROM told WHERE way = ?", channel)
        for channel in channels:
            known = self.progress(channel)
            if known is None:
                salvage = self.rows(_SALVAGE, utc - _SALVAGE_NEWS_S)[0][0]
                self.save(channel, Delivered(event, notice if salvage is None else salvage))
            elif known.event > event or known.notice > notice:
                # The store was made anew and has fewer of them.
                begin = Delivered(min(known.event, event), min(known.notice, notice), known.left_out, known.sent)
                self.save(channel, begin)

    def progress(self, channel: str) -> Delivered | None:
        """Return the progress of a channel, or None where it is new."""
        found = self.rows("SELECT event, notice, left_out, sent FROM told WHERE way = ?", channel)
        if not found:
            return None
        event, notice, left_out, sent = found[0]
        return Delivered(event, notice, left_out, tuple(json.loads(sent)))

    def save(self, channel: str, progress: Delivered) -> None:
        """Write the progress of a channel."""
        sent = json.dumps([round(item, 1) for item in progress.sent])
        values = (channel, progress.event, progress.notice, progress.left_out, sent)
        self.rows("INSERT OR REPLACE INTO told VALUES (?, ?, ?, ?, ?)", *values)

    def mark_found(self, utc: float) -> None:
        """Note that all events up to the newest are found by now; delete marks that no channel needs any more."""
        event = self._end()[0]
        if event and not self.rows("SELECT 1 FROM event_marks WHERE event >= ? LIMIT 1", event):
            self.rows("INSERT OR IGNORE INTO event_marks VALUES (?, ?)", event, utc)
            self.rows("DELETE FROM event_marks WHERE event < (SELECT min(event) FROM told)")

    def found(self, event: int) -> float | None:
        """Return when an event was found, UTC seconds since 1970, or None where that was not noted."""
        rows = self.rows("SELECT utc FROM event_marks WHERE event >= ? ORDER BY event LIMIT 1", event)
        return rows[0][0] if rows else None

    def _end(self) -> tuple[int, int]:
        ends = [self.rows(f"SELECT coalesce(max(id), 0) FROM {table}")[0][0] for table in ("events", "notices")]
        return ends[0], ends[1]
