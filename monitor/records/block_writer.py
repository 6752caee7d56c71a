"""Writes blocks into the tables of a store, within a transaction: ledger entry, record, forecasts, events, states."""

from __future__ import annotations

import json
import sqlite3
import time
from collections.abc import Mapping
from typing import Any, Literal, NamedTuple

from monitor import __version__
from monitor.health.record import Record
from monitor.records.archive import insert_forecasts
from monitor.records.condense import identity_of
from monitor.records.database import UNFIT, UnstorableError
from monitor.records.filing import content_digest, file_record, ledger_digest, states_digest
from monitor.records.packing import pack
from streams.types.block import Rejected

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
        known = _condensed_identity(connection, record) if found is None else found[1]
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


def _condensed_identity(connection: sqlite3.Connection, record: Record) -> str | None:
    def rows(query: str, *values: Any) -> list[Any]:
        return connection.execute(query, values).fetchall()

    return identity_of(rows, record.source, record.sequence)


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
