"""The event log: what came with blocks, what came without one, and who acknowledged it with which words.

Events that a block led to are rows of ``events``, part of its record. What no block led to (a silence, a failed
notification) is a row of ``notices``, so that records stay the same however they were made. Nothing is ever changed or
taken out: an acknowledgement is a row of its own.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from monitor.records.database import SharedConnection

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
_LONGEST_NOTE, _LONGEST_NAME = 2000, 100
NEEDS_NOBODY = ("alarm_cleared", "alarm_released", "condition", "data_again")
"""Kinds of events that nobody has to acknowledge."""


@dataclass(frozen=True)
class Acknowledgement:
    """Who acknowledged an event, when (UTC seconds since 1970), and with which words."""

    who: str
    utc: float
    note: str


@dataclass(frozen=True)
class LoggedEvent:
    """One event.

    Attributes:
        id: its name in the log: a number, or "n" and a number where no block led to it.
        source: of the block, or None.
        block: number of the block, or None.
        utc: seconds since 1970 of the block (None if undated) or of the notice.
        body: ``kind``, ``channel`` and what else its maker said.
        acknowledgements: in the order in which they were given.
    """

    id: str
    source: str | None
    block: int | None
    utc: float | None
    body: Mapping[str, Any]
    acknowledgements: tuple[Acknowledgement, ...] = field(default=())

    @property
    def open(self) -> bool:
        """Whether somebody should still acknowledge it; the end of an alarm needs nobody."""
        return not self.acknowledgements and self.body.get("kind") not in NEEDS_NOBODY


class EventLog:
    """The log of a store, on a connection of its own; its methods may be called from any thread.

    All raise :class:`StoreError` where the database cannot be read or written.
    """

    def __init__(self, path: Path) -> None:
        """Open the log of the store at ``path``, whose database gets the tables that it lacks."""
        self._shared = SharedConnection(path, write=True, tables=_TABLES)

    def events(self, *, limit: int = 200, before: int | None = None) -> list[LoggedEvent]:
        """Return the newest events that blocks led to, newest first.

        Args:
            limit: at most so many.
            before: only those before this number, for the page after.
        """
        condition, values = ("", ()) if before is None else ("WHERE events.id < ?", (before,))
        query = f"{_EVENTS} {condition} ORDER BY events.id DESC LIMIT ?"
        return [self._logged(row[1:]) for row in self._shared.rows(query, *values, limit)]

    def after(self, number: int, *, limit: int = 500) -> list[tuple[int, LoggedEvent]]:
        """Return the oldest events after a number, with their numbers; for whoever follows the log."""
        rows = self._shared.rows(f"{_EVENTS} WHERE events.id > ? ORDER BY events.id LIMIT ?", number, limit)
        return [(row[0], self._logged(row[1:])) for row in rows]

    def notices(self, *, limit: int = 200) -> list[LoggedEvent]:
        """Return the newest events that no block led to, newest first."""
        return [self._logged(row[1:]) for row in self._shared.rows(f"{_NOTICES} ORDER BY id DESC LIMIT ?", limit)]

    def notices_after(self, number: int, *, limit: int = 500) -> list[tuple[int, LoggedEvent]]:
        """Return the oldest notices after a number, with their numbers; for whoever follows the log."""
        rows = self._shared.rows(f"{_NOTICES} WHERE id > ? ORDER BY id LIMIT ?", number, limit)
        return [(row[0], self._logged(row[1:])) for row in rows]

    def event(self, name: str) -> LoggedEvent | None:
        """Return one event by its name in the log, or None."""
        notice = name.startswith("n")
        query, number = (f"{_NOTICES} WHERE id", name[1:]) if notice else (f"{_EVENTS} WHERE events.id", name)
        if not (number.isascii() and number.isdigit() and len(number) < 19):
            return None
        found = self._shared.rows(f"{query} = ?", int(number))
        return self._logged(found[0][1:]) if found else None

    def notice(self, utc: float, body: Mapping[str, Any]) -> str:
        """Log what no block led to, and return its name in the log."""
        text = json.dumps(body, allow_nan=False)
        with self._shared.use() as connection:
            return f"n{connection.execute('INSERT INTO notices (utc, body) VALUES (?, ?)', (utc, text)).lastrowid}"

    def acknowledge(self, name: str, who: str, note: str, utc: float) -> LoggedEvent:
        """Add an acknowledgement to an event and return the event with it.

        Args:
            name: of the event in the log.
            who: person.
            note: their words, which may be empty.
            utc: now, seconds since 1970.

        Raises:
            ValueError: there is no such event, nobody is named, or a text is too long.
        """
        who = who.strip()
        if not 0 < len(who) <= _LONGEST_NAME or len(note) > _LONGEST_NOTE:
            raise ValueError(f"who must have 1 to {_LONGEST_NAME} characters, a note at most {_LONGEST_NOTE}")
        found = self.event(name)
        if found is None:
            raise ValueError(f"there is no event {name!r}")
        query = "INSERT INTO acknowledgements (event, utc, who, note) VALUES (?, ?, ?, ?)"
        self._shared.rows(query, found.id, utc, who, note)
        return self.event(name) or found

    def unacknowledged(self) -> int:
        """Return how many events and notices wait for somebody."""
        skipped = ", ".join(f"'{kind}'" for kind in NEEDS_NOBODY)
        missing = "NOT EXISTS (SELECT 1 FROM acknowledgements WHERE event = {name})"
        wanted = f"json_extract(body, '$.kind') NOT IN ({skipped}) AND {missing}"
        events = wanted.format(name="CAST(events.id AS TEXT)")
        notices = wanted.format(name="'n' || notices.id")
        query = f"SELECT (SELECT count(*) FROM events WHERE {events}) + (SELECT count(*) FROM notices WHERE {notices})"
        return self._shared.rows(query)[0][0]

    def acknowledged_alarms(self, after: int = 0) -> Iterator[tuple[int, float, LoggedEvent]]:
        """Yield the acknowledgements of raised alarms in the order in which they were given.

        Args:
            after: leave out those up to this number.

        Yields:
            The number of the acknowledgement, when it was given (UTC seconds since 1970), and the alarm.
        """
        for number, utc, *event in self._shared.rows(_ACKNOWLEDGED, after):
            yield number, utc, self._logged(event)

    def _logged(self, row: Any) -> LoggedEvent:
        name, source, block, utc, body = row
        query = "SELECT who, utc, note FROM acknowledgements WHERE event = ? ORDER BY id"
        given = tuple(Acknowledgement(*item) for item in self._shared.rows(query, name))
        return LoggedEvent(name, source, block, utc, json.loads(body), given)

    def close(self) -> None:
        """Close the log; closing twice does nothing."""
        self._shared.close()

    def __enter__(self) -> Self:
        """Return the log itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the log."""
        self.close()
