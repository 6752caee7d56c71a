"""A record in the tables of a store: its place on the time axis, how it is written and read, and its digests.

SQLite detects malformed pages, not changed values: the table ``digests`` has one row a block, written with it.
"""

from __future__ import annotations

import hashlib
import json
import re
import sqlite3
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

from monitor import __version__
from monitor.health.record import Record
from monitor.records.archive import insert_forecasts
from monitor.records.condense import identity_of
from monitor.records.failures import UNFIT, UnstorableError
from monitor.records.packing import pack, unpack
from streams.types.block import Rejected

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


Commit = Literal["committed", "duplicate", "changed"]


class StoreRun(NamedTuple):
    """The run that blocks belong to: its number in the table ``runs``, and its attributes."""

    number: int
    attributes: Mapping[str, Any]


def insert_run(connection: sqlite3.Connection, attributes: Mapping[str, Any]) -> StoreRun:
    """Insert a run, unless the latest one has the same attributes; the software version is added."""
    full = {"software_version": __version__, **attributes}
    text = json.dumps(full, sort_keys=True, allow_nan=False)
    last = connection.execute("SELECT id, attributes FROM runs ORDER BY id DESC LIMIT 1").fetchone()
    if last is not None and last[1] == text:
        return StoreRun(last[0], full)
    number = connection.execute("INSERT INTO runs (attributes) VALUES (?)", (text,)).lastrowid or 0
    for key in ("software_version", "config_hash"):
        if key in full:
            connection.execute("INSERT OR REPLACE INTO meta VALUES (?, ?)", (key, str(full[key])))
    return StoreRun(number, full)


class BlockWriter:
    """Inserts the blocks of a run, and knows the numbers of their layouts."""

    def __init__(self) -> None:
        """Begin before the first run."""
        self.run: StoreRun | None = None
        self._layouts: dict[str, int] = {}

    def insert(self, connection: sqlite3.Connection, record: Record) -> tuple[Commit, int]:
        """Insert one record, or count it as refused; return the outcome and the ledger number, 0 where refused.

        Raises:
            UnstorableError: the record does not fit the tables.
        """
        try:
            return self._insert(connection, record)
        except UNFIT as error:
            what = f"{record.source}, block {record.sequence}: its record cannot be stored"
            raise UnstorableError(f"{what}: {type(error).__name__}: {error}") from error

    def forget_layouts(self) -> None:
        """Forget the numbers of layouts: those that a rolled back transaction inserted are not there any more."""
        self._layouts.clear()

    def _insert(self, connection: sqlite3.Connection, record: Record) -> tuple[Commit, int]:
        found = connection.execute(
            "SELECT id, content_hash FROM blocks WHERE source = ? AND sequence = ?", (record.source, record.sequence)
        ).fetchone()
        known = identity_of(connection, record.source, record.sequence) if found is None else found[1]
        if known is not None:
            outcome: Commit = "duplicate" if known == record.content_hash else "changed"
            count_refusal(connection, record, outcome)
            return outcome, 0
        filing = file_record(connection, record)
        entry = (
            *(record.source, record.sequence, record.content_hash, record.name, record.status),
            *(" ".join(record.flags), record.reason, record.time, record.elapsed, *filing),
        )
        cursor = connection.execute(
            "INSERT INTO blocks (source, sequence, content_hash, name, status, flags, reason, time, elapsed,"
            " day, axis_time, time_status, run) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
            (*entry, self.run and self.run.number),
        )
        block = cursor.lastrowid or 0
        layout, row = pack(record.channels)
        connection.execute("INSERT INTO records VALUES (?, ?, ?)", (block, self._layout_id(connection, layout), row))
        forecasts = insert_forecasts(
            *(connection, block, record.forecasts, {} if self.run is None else self.run.attributes),
            data_until=filing.time,
            issued_utc=time.time(),
        )
        events = [json.dumps(item, allow_nan=False) for item in record.events]
        connection.executemany("INSERT INTO events (block, body) VALUES (?, ?)", [(block, event) for event in events])
        digests = (ledger_digest(entry), content_digest(layout, row, forecasts, events))
        connection.execute("INSERT INTO digests (block, ledger, content) VALUES (?, ?, ?)", (block, *digests))
        return "committed", block

    def _layout_id(self, connection: sqlite3.Connection, layout: str) -> int:
        """Return the number of a layout, inserted where it is new."""
        known = self._layouts.get(layout)
        if known is None:
            connection.execute("INSERT OR IGNORE INTO layouts (layout) VALUES (?)", (layout,))
            known = connection.execute("SELECT id FROM layouts WHERE layout = ?", (layout,)).fetchone()[0]
            self._layouts[layout] = known
        return known


def count_refusal(connection: sqlite3.Connection, item: Record | Rejected, outcome: str) -> None:
    """Count the offer of a block whose number is in the ledger."""
    values = (item.source, item.sequence, item.content_hash, item.name, outcome)
    connection.execute(
        "INSERT INTO refusals VALUES (?, ?, ?, ?, ?, 1) ON CONFLICT DO UPDATE SET times = times + 1", values
    )


def write_states(connection: sqlite3.Connection, latest: Mapping[str, tuple[int, Mapping[str, Any]]]) -> None:
    """Write states, each with the number of its block, and their digests; UnstorableError where one is not JSON."""
    by_block: dict[int, dict[str, str]] = {}
    for name, (block, state) in latest.items():
        by_block.setdefault(block, {})[name] = _state_text(name, state)
    for block, texts in by_block.items():
        rows = [(name, block, text) for name, text in texts.items()]
        connection.executemany("INSERT OR REPLACE INTO stage_states VALUES (?, ?, ?)", rows)
        connection.execute("UPDATE digests SET states = ? WHERE block = ?", (states_digest(texts), block))


def _state_text(name: str, state: Mapping[str, Any]) -> str:
    """Return a stage's state as JSON; raise UnstorableError where it has NaN or other values without JSON."""
    try:
        return json.dumps(state, allow_nan=False, separators=(",", ":"))
    except (TypeError, ValueError) as error:
        raise UnstorableError(f"state of stage {name!r} cannot be written as JSON: {error}") from error
