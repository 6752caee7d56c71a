"""Progress of each notification channel in the event log, kept in the store.

A channel that was killed between sending a message and writing its progress sends that message again; none is lost. The
time at which an event was found is kept too, because the time of its block may be of any age.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from monitor.records.database import SharedConnection

# The names of the tables are those of the first version.
_TABLES = (
    """CREATE TABLE IF NOT EXISTS told (
    way TEXT PRIMARY KEY, event INTEGER NOT NULL, notice INTEGER NOT NULL, left_out INTEGER NOT NULL, sent TEXT NOT NULL
) WITHOUT ROWID""",
    "CREATE TABLE IF NOT EXISTS event_marks (event INTEGER PRIMARY KEY, utc REAL NOT NULL)",
)
_SALVAGE_NEWS_S = 86400.0
_SALVAGE = "SELECT min(id) - 1 FROM notices WHERE utc > ? AND json_extract(body, '$.kind') LIKE '%salvage%'"


@dataclass(frozen=True)
class Delivered:
    """Progress of a notification channel.

    Attributes:
        event: number of the last event that was delivered or passed over.
        notice: the same of the notices.
        left_out: events that were given up and not yet counted in a message.
        sent: UTC seconds of the messages of the last hour.
    """

    event: int = 0
    notice: int = 0
    left_out: int = 0
    sent: tuple[float, ...] = ()


class Deliveries(SharedConnection):
    """The progress of all notification channels; its methods may be called from any thread.

    All raise :class:`monitor.records.database.StoreError` where the database cannot be read or written. A write is one
    statement that does not wait for the disk: after a power cut the latest messages may be delivered again.
    """

    def __init__(self, path: Path) -> None:
        """Open the store at ``path``, and make the tables that it lacks."""
        super().__init__(path, write=True, synchronous="NORMAL", tables=_TABLES)
        # Checkpoints are left to the connection that commits blocks.
        self.rows("PRAGMA wal_autocheckpoint = 0")

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
