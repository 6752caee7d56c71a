"""The place of a record on the time axis, and a record as the tables hold it."""

from __future__ import annotations

import json
import sqlite3
from typing import Literal, NamedTuple

from monitor.health.record import Record
from monitor.records.packing import unpack

SECONDS_PER_DAY = 86400
_LAST_TIME = 253402300800.0
"""10000-01-01 UTC: a clock that says later cannot be filed under a day."""


class Filing(NamedTuple):
    """The place of a record on the time axis.

    Attributes:
        day: UTC day as a number of days since 1970, or None for the undated axis.
        time: UTC seconds since 1970, or seconds from the first block on the undated axis.
        time_status: "given" by the block; "carried" over from the block before it in its source, where a rejected block
            has no time of its own; "unknown" where there is none, and ``time`` is 0.
    """

    day: int | None
    time: float
    time_status: Literal["given", "carried", "unknown"]


class Stored(NamedTuple):
    """A record as it is stored.

    Attributes:
        layout: which place of ``row`` holds what, see :mod:`monitor.records.packing`.
        flags: the flags, separated by blanks.
        forecasts, events: JSON arrays.
    """

    filing: Filing
    layout: str
    row: bytes
    source: str
    sequence: int
    name: str
    content_hash: str
    status: str
    flags: str
    reason: str
    time: float | None
    elapsed: float | None
    forecasts: str
    events: str

    def to_record(self) -> Record:
        """Return the record that was committed."""
        return Record(
            **{name: getattr(self, name) for name in ("source", "sequence", "name", "content_hash", "status")},
            flags=tuple(self.flags.split()),
            reason=self.reason,
            time=self.time,
            elapsed=self.elapsed,
            channels=unpack(self.layout, self.row),
            forecasts=tuple(json.loads(self.forecasts)),
            events=tuple(json.loads(self.events)),
        )


# What Stored is made of, after a ledger number and for a condition over the columns of ``blocks``.
# The inner selects keep the order in which a block's forecasts and events were given.
STORED_QUERY = """
SELECT id, layout, day, axis_time, time_status, row, source, sequence, name, content_hash, status, flags, reason,
    time, elapsed,
    (SELECT '[' || coalesce(group_concat(body), '') || ']' FROM (SELECT body FROM forecasts WHERE block = blocks.id
        ORDER BY forecasts.id)),
    (SELECT '[' || coalesce(group_concat(body), '') || ']' FROM (SELECT body FROM events WHERE block = blocks.id
        ORDER BY events.id))
FROM blocks JOIN records ON records.block = blocks.id WHERE blocks.id > ? AND ({condition}) ORDER BY blocks.id LIMIT ?
"""


def file_record(connection: sqlite3.Connection, record: Record) -> Filing:
    """Find the place of a record on the time axis, see :class:`Filing`."""
    if record.time is not None and 0.0 <= record.time < _LAST_TIME:
        return Filing(int(record.time // SECONDS_PER_DAY), record.time, "given")
    if record.elapsed is not None:
        return Filing(None, record.elapsed, "given")
    before = connection.execute(
        "SELECT day, axis_time, time_status FROM blocks WHERE source = ? AND sequence < ?"
        " ORDER BY sequence DESC LIMIT 1",
        (record.source, record.sequence),
    ).fetchone()
    if before is None or before[2] == "unknown":
        return Filing(None, 0.0, "unknown")
    return Filing(before[0], before[1], "carried")
