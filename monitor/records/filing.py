"""The place of a record on the time axis, a record as the tables hold it, and its digests.

SQLite detects malformed pages, not changed values: the table ``digests`` has one row a block, written with it.
"""

from __future__ import annotations

import hashlib
import json
import re
import sqlite3
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

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


def published_name(machine: str) -> re.Pattern[str]:
    """Return the pattern of the names of a machine's files of records; its group is the day, or "undated"."""
    return re.compile(rf"{re.escape(machine)}-(\d{{8}}|undated)\.nc")


def published_files(records_dir: Path, machine: str) -> list[Path]:
    """Return the files of records of a machine, by day; none where the folder cannot be read."""
    pattern = published_name(machine)
    try:
        return sorted(path for path in records_dir.iterdir() if pattern.fullmatch(path.name))
    except OSError:
        return []


class Stored(NamedTuple):
    """A record as it is stored: values packed, flags separated by blanks, forecasts and events as JSON arrays."""

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


MAX_BLOCK = 2**53
"""A number above this was not reached by counting: earlier versions took any number from a stream."""
LAST_QUERY = "SELECT coalesce(max(sequence), 0) FROM blocks WHERE source = ? AND sequence <= ?"

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
"""Selects number, layout and values of :class:`Stored` after a ledger number, for a condition on ``blocks``."""


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


def ledger_digest(values: Sequence[Any]) -> bytes:
    """Return the digest of a ledger entry: the columns of ``blocks`` from ``source`` to ``time_status``."""
    # The database keeps -0.0 as 0.0.
    return _digest(repr(value + 0.0 if isinstance(value, float) else value).encode() for value in values)


def content_digest(layout: str, row: bytes, forecasts: Iterable[str], events: Iterable[str]) -> bytes:
    """Return the digest of a packed record with the JSON of its forecasts and events."""
    return _digest(
        [layout.encode(), row, b"forecasts", *map(str.encode, forecasts), b"events", *map(str.encode, events)]
    )


def states_digest(states: Mapping[str, str]) -> bytes:
    """Return the digest of the states after a block: JSON by the name of the stage, in any order."""
    return _digest(text.encode() for name in sorted(states) for text in (name, states[name]))


def _digest(parts: Iterable[bytes]) -> bytes:
    result = hashlib.blake2b(digest_size=8)
    for part in parts:
        result.update(len(part).to_bytes(8, "little"))
        result.update(part)
    return result.digest()
