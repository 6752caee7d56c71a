"""How far each way of telling has come in the event log: kept in the store, so that nothing waits in memory alone.

A way that was killed after sending and before its place was written sends once more; nothing is left out. When an event
was found is written beside it, for the time of a block may be of any age.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

from monitor.records.connection import SharedConnection

_TABLES = (
    """CREATE TABLE IF NOT EXISTS told (
    way TEXT PRIMARY KEY, event INTEGER NOT NULL, notice INTEGER NOT NULL, left_out INTEGER NOT NULL, sent TEXT NOT NULL
) WITHOUT ROWID""",
    "CREATE TABLE IF NOT EXISTS event_marks (event INTEGER PRIMARY KEY, utc REAL NOT NULL)",
)
_NEWS = 86400.0
_SALVAGE = "SELECT min(id) - 1 FROM notices WHERE utc > ? AND json_extract(body, '$.kind') LIKE '%salvage%'"


@dataclass(frozen=True)
class Place:
    """Where a way of telling stands.

    Attributes:
        event: number of the last event that was told, or passed over.
        notice: the same of the notices.
        left_out: events that were given up and that no message has counted yet.
        sent: UTC seconds of the messages of the last hour.
    """

    event: int = 0
    notice: int = 0
    left_out: int = 0
    sent: tuple[float, ...] = ()


class Told:
    """The places of all ways, on a connection of their own; its methods may be called from any thread.

    All raise :class:`monitor.records.database.StoreError` where the database cannot be read or written. A write is one
    statement, which holds up a commit for no longer than itself and waits for no disk: after a power cut the latest
    messages may be sent once more.
    """

    def __init__(self, path: Path) -> None:
        """Open the store at ``path``, whose database gets the tables that it lacks."""
        self._shared = SharedConnection(path, write=True, synchronous="NORMAL", tables=_TABLES)
        # Moving the log of writes into the database is left to who commits.
        self._shared.rows("PRAGMA wal_autocheckpoint = 0")

    def begin(self, ways: Sequence[str], utc: float) -> None:
        """Let ways that are new begin at the present end, and forget those that there are no more.

        What a salvage has just said of the store is told all the same.

        Args:
            ways: names of all ways.
            utc: now, seconds since 1970.
        """
        event, notice = self._end()
        for way, *_ in self._shared.rows("SELECT way FROM told"):
            if way not in ways:
                self._shared.rows("DELETE FROM told WHERE way = ?", way)
        for way in ways:
            known = self.place(way)
            if known is None:
                salvage = self._shared.rows(_SALVAGE, utc - _NEWS)[0][0]
                self.move(way, Place(event, notice if salvage is None else salvage))
            elif known.event > event or known.notice > notice:
                # The store was made anew and has fewer of them.
                self.move(way, Place(min(known.event, event), min(known.notice, notice), known.left_out, known.sent))

    def place(self, way: str) -> Place | None:
        """Return where a way stands, or None where it is new."""
        found = self._shared.rows("SELECT event, notice, left_out, sent FROM told WHERE way = ?", way)
        if not found:
            return None
        event, notice, left_out, sent = found[0]
        return Place(event, notice, left_out, tuple(json.loads(sent)))

    def move(self, way: str, place: Place) -> None:
        """Write where a way stands now."""
        values = (way, place.event, place.notice, place.left_out, json.dumps([round(item, 1) for item in place.sent]))
        self._shared.rows("INSERT OR REPLACE INTO told VALUES (?, ?, ?, ?, ?)", *values)

    def mark(self, utc: float) -> None:
        """Note that all events up to the newest one are found by now; marks that nobody needs any more go."""
        event = self._end()[0]
        if event and not self._shared.rows("SELECT 1 FROM event_marks WHERE event >= ? LIMIT 1", event):
            self._shared.rows("INSERT OR IGNORE INTO event_marks VALUES (?, ?)", event, utc)
            self._shared.rows("DELETE FROM event_marks WHERE event < (SELECT min(event) FROM told)")

    def found(self, event: int) -> float | None:
        """Return when an event was found, UTC seconds since 1970, or None where nobody noted it."""
        rows = self._shared.rows("SELECT utc FROM event_marks WHERE event >= ? ORDER BY event LIMIT 1", event)
        return rows[0][0] if rows else None

    def _end(self) -> tuple[int, int]:
        ends = [self._shared.rows(f"SELECT coalesce(max(id), 0) FROM {table}")[0][0] for table in ("events", "notices")]
        return ends[0], ends[1]

    def close(self) -> None:
        """Close the connection; closing twice does nothing."""
        self._shared.close()

    def __enter__(self) -> Self:
        """Return the places themselves."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the connection."""
        self.close()
