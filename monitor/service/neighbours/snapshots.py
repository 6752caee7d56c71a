"""Read what control systems are given: the status file, and the latest record of each source in the store."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

from monitor.records.database import SharedConnection, StoreError
from monitor.records.packing import unpack
from monitor.service.neighbours.points import Snapshot
from monitor.service.record_message import StoredRecord
from monitor.service.status_file import read_status

FIELDS = "source, sequence, status, flags, reason, time, elapsed, layouts.layout, row"
"""Columns that :func:`stored_record` takes."""
JOINED = "blocks JOIN records ON records.block = blocks.id JOIN layouts ON layouts.id = records.layout"
_LATEST = f"SELECT {FIELDS} FROM {JOINED} WHERE source = ? ORDER BY sequence DESC LIMIT 1"


def stored_record(machine: str, row: tuple[Any, ...]) -> StoredRecord:
    """Return the record of a row of :data:`FIELDS`."""
    source, sequence, *rest, layout, values = row
    return StoredRecord(machine, source, sequence, *rest, channels=unpack(layout, values))


class Snapshots:
    """The latest of one machine; from one thread."""

    def __init__(self, machine: str, sources: Iterable[str], state_dir: Path) -> None:
        """Keep names and folder; nothing is read yet."""
        self._machine, self._sources = machine, tuple(dict.fromkeys(sources))
        self._state_dir = state_dir
        self._newest: tuple[Any, ...] | None = None
        self._found = Snapshot()

    def read(self) -> Snapshot:
        """Return the present status and records; where the store cannot be read, the last known records."""
        try:
            # A store that was replaced meanwhile is found, too.
            with SharedConnection(self._state_dir / "state.db") as store, store.use() as connection:
                self._read_store(connection)
        except StoreError:
            self._newest = None
        return replace(self._found, status=read_status(self._state_dir))

    def _read_store(self, connection: sqlite3.Connection) -> None:
        tables = {name for (name,) in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
        events = sum(
            connection.execute(f"SELECT coalesce(max(id), 0) FROM {table}").fetchone()[0]
            for table in ("events", "notices")
            if table in tables
        )
        newest = connection.execute("SELECT max(id) FROM blocks").fetchone()
        if newest == self._newest:
            self._found = replace(self._found, events=events)
            return
        records = {}
        for source in self._sources:
            row = connection.execute(_LATEST, (source,)).fetchone()
            if row is not None:
                records[source] = stored_record(self._machine, row)
        self._newest, self._found = newest, Snapshot(records=records, events=events)
