"""Rows of a store, made of the published files.

Files are read in a process of its own, so that the daemon does not load netCDF. It fills a scratch store, of which each
row is as it was committed: the digests in the files prove it. Files of older versions have none; their rows are taken
as they are.
"""

from __future__ import annotations

import json
import logging
import math
import os
import sqlite3
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from models.platform.process_signals import child_path
from monitor.health.schema import VARIABLES
from monitor.records.archive import insert_forecasts
from monitor.records.database import opened
from monitor.records.filing import SECONDS_PER_DAY, content_digest, ledger_digest
from monitor.records.ledger import StoreLedger
from monitor.records.packing import entries_of
from monitor.records.store import Store

_LOG = logging.getLogger(__name__)
# Without its parent it would go on, and write into the scratch store of the next attempt.
_START = """
import json, os, sys, threading
threading.Thread(target=lambda: (os.read(0, 1), os._exit(1)), daemon=True).start()
sys.path[:] = json.loads(sys.argv.pop())
from monitor.records.recover.published import main
main()
"""
_BEAT_S = 0.5
_TEXTS = ("source", "content_hash", "name", "status", "flags", "reason")
_TIME_STATUSES = ("given", "carried", "unknown")
LEDGER = "source, sequence, content_hash, name, status, flags, reason, time, elapsed, day, axis_time, time_status"
"""Columns of ``blocks`` that are an entry of the ledger, in the order in which its digest takes them."""


Beat = Callable[[], object]
"""Called repeatedly while something takes long."""


class Gathered(NamedTuple):
    """Result of reading published files: by path the rows that are as they were committed and the others.

    ``unreadable`` are the names of the files that cannot be read.
    """

    rows: Mapping[Path, tuple[int, int]]
    unreadable: tuple[str, ...] = ()

    @property
    def damaged(self) -> int:
        """Number of rows that are not as they were committed."""
        return sum(damaged for _, damaged in self.rows.values())


def gather(files: Sequence[Path], machine: str, scratch: Path, beat: Beat) -> Gathered:
    """Make the store ``scratch`` of the rows of published files; files that cannot be read are named."""
    remove_database(scratch)
    with Store.open(scratch, machine=machine) as store, StoreLedger(store):
        pass
    rows = _in_child(scratch, files, beat) if files else {}
    return Gathered(rows, tuple(file.name for file in files if file not in rows))


def _in_child(scratch: Path, files: Sequence[Path], beat: Beat) -> dict[Path, tuple[int, int]]:
    command = [sys.executable, "-P", "-c", _START, str(scratch), *map(str, files), json.dumps(child_path())]
    # The child ends when the other end of its standard input is closed, by this process or by its death.
    theirs, ours = os.pipe()
    try:
        with subprocess.Popen(
            command, stdin=theirs, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        ) as child:
            while True:
                with suppress(subprocess.TimeoutExpired):
                    answer, said = child.communicate(timeout=_BEAT_S)
                    break
                beat()
    finally:
        os.close(theirs)
        os.close(ours)
    if child.returncode != 0:
        _LOG.error("the published files cannot be read: %s", said.strip() or child.returncode)
        return {}
    return {Path(file): (taken, damaged) for file, (taken, damaged) in json.loads(answer).items()}


def remove_database(path: Path) -> None:
    """Remove a database with what belongs to it."""
    for suffix in ("", "-wal", "-shm", ".lock"):
        path.with_name(path.name + suffix).unlink(missing_ok=True)


def main() -> None:
    """Take the rows of files, all arguments but the first, into a scratch store; print the result as JSON."""
    scratch, *files = map(Path, sys.argv[1:])
    print(json.dumps({str(file): rows for file, rows in take_files(scratch, files).items()}))


def take_files(scratch: Path, files: Sequence[Path]) -> dict[Path, tuple[int, int]]:
    """Insert the rows of files; return by path of those that can be read the rows taken and the damaged ones."""
    found: dict[Path, tuple[int, int]] = {}
    with closing(opened(scratch)) as connection:
        connection.execute("PRAGMA synchronous = OFF")
        for file in files:
            connection.execute("BEGIN")
            try:
                found[file] = _File(file, connection).take()
            except (OSError, RuntimeError, ValueError, TypeError, LookupError) as error:
                sys.stderr.write(f"{file}: {error}\n")
                connection.execute("ROLLBACK")
            else:
                connection.execute("COMMIT")
    return found


class _File:
    """One published file, and the scratch store that takes its rows."""

    def __init__(self, path: Path, connection: sqlite3.Connection) -> None:
        import xarray as xr

        from monitor.records.dataset import from_dataset

        self._connection = connection
        self._ledger: dict[str, NDArray[Any]] = {}
        with xr.open_dataset(path, engine="netcdf4", decode_cf=False) as dataset:
            self._dated = dataset.attrs["dated"] == "yes"
            self._columns = {str(name): column.values for name, column in dataset.variables.items()}
            self._count = len(self._columns["time"])
            with suppress(OSError, ValueError), xr.open_dataset(path, group="ledger", decode_cf=False) as group:
                self._ledger = {str(name): column.values for name, column in group.variables.items()}
            self._layouts = self._texts("layout", "")
            # Rows of older versions have no layout.
            self._older = from_dataset(dataset) if "" in self._layouts else []
        self._channels = [str(channel) for channel in self._columns["channel"]]

    def take(self) -> tuple[int, int]:
        """Insert all rows; return the numbers of those that are as they were committed and of the others."""
        runs = self._texts("run", "{}")
        packed: dict[int, tuple[str, bytes]] = {}
        for layout in dict.fromkeys(self._layouts):
            places = np.array([place for place, text in enumerate(self._layouts) if text == layout])
            if layout:
                rows = zip(places.tolist(), self._packed(layout, places), strict=True)
                packed |= {place: (layout, row) for place, row in rows}
            else:
                packed |= {place: self._older[place][1:3] for place in places.tolist()}
        taken = sum(self._insert(place, *packed[place], runs[place]) for place in range(self._count))
        self._insert_files()
        return taken, self._count - taken

    def _texts(self, name: str, default: str) -> list[str]:
        """Return the text of each row, which is given by its place in a list."""
        if name not in self._ledger:
            return [default] * self._count
        texts = [str(text) for text in self._ledger[f"{name}s"]]
        return [texts[place] for place in self._ledger[name].tolist()]

    def _number_of(self, table: str, column: str, text: str) -> int:
        """Return the number of a text in a table of the scratch store."""
        known = self._connection.execute(f"SELECT id FROM {table} WHERE {column} = ?", (text,)).fetchone()
        if known is not None:
            return known[0]
        return self._connection.execute(f"INSERT INTO {table} ({column}) VALUES (?)", (text,)).lastrowid or 0

    def _insert(self, place: int, layout: str, row: bytes, run: str) -> bool:
        """Insert one row; return whether it is as it was committed."""
        events = [json.dumps(event) for event in json.loads(str(self._columns["events"][place]))]
        forecasts = json.loads(str(self._ledger["forecasts"][place])) if "forecasts" in self._ledger else []
        content = content_digest(layout, row, map(json.dumps, forecasts), events)
        entry = self._entry(place)
        if entry is None or self._digest("content_digest", place) not in (None, content):
            return False
        number, first_event = (int(self._ledger[key][place]) if self._ledger else 0 for key in ("block", "first_event"))
        connection = self._connection
        same = connection.execute("SELECT 1 FROM blocks WHERE source = ? AND sequence = ?", entry[:2]).fetchone()
        if same is not None:
            return True
        taken = not number or connection.execute("SELECT 1 FROM blocks WHERE id = ?", (number,)).fetchone()
        marks = ", ".join("?" for _ in entry)
        statement = f"INSERT INTO blocks (id, {LEDGER}, run) VALUES (?, {marks}, ?)"
        run_id, layout_id = self._number_of("runs", "attributes", run), self._number_of("layouts", "layout", layout)
        block = connection.execute(statement, (None if taken else number, *entry, run_id)).lastrowid or 0
        connection.execute("INSERT INTO records VALUES (?, ?, ?)", (block, layout_id, row))
        issued = float(self._ledger["issued_utc"][place]) if forecasts else math.nan
        insert_forecasts(
            *(connection, block, forecasts, json.loads(run)),
            data_until=entry[10],
            issued_utc=None if math.isnan(issued) else issued,
        )
        for offset, text in enumerate(events):
            found = first_event + offset if first_event and not taken else None
            connection.execute("INSERT OR IGNORE INTO events VALUES (?, ?, ?)", (found, block, text))
        if self._digest("content_digest", place):
            digests = (block, ledger_digest(entry), content)
            connection.execute("INSERT INTO digests (block, ledger, content) VALUES (?, ?, ?)", digests)
        return True

    def _digest(self, name: str, place: int) -> bytes | None:
        value = int(self._ledger[name][place]) if name in self._ledger else 0
        return value.to_bytes(8, "little", signed=True) if value else None

    def _entry(self, place: int) -> list[Any] | None:
        """Return the ledger entry of a row, None where it is not as committed; a rejected block may have no time."""
        texts = {name: str(self._columns[name][place]) for name in _TEXTS}
        axis, elapsed = float(self._columns["time"][place]), float(self._columns["elapsed"][place])
        status = _TIME_STATUSES[int(self._columns["time_status"][place])]
        filing = [int(axis // SECONDS_PER_DAY) if self._dated else None, axis, status]
        wanted = self._digest("ledger_digest", place)
        for time in (axis, None) if self._dated and status == "given" else (None, axis):
            entry = [texts["source"], int(self._columns["sequence"][place]), *(texts[name] for name in _TEXTS[1:])]
            entry += [time, None if math.isnan(elapsed) else elapsed, *filing]
            if wanted is None or ledger_digest(entry) == wanted:
                return entry
        return None

    def _packed(self, layout: str, places: NDArray[np.intp]) -> Iterator[bytes]:
        """Yield the packed values of rows of one layout."""
        parts: list[NDArray[np.float64]] = [np.empty((places.size, 0))]
        for entry in entries_of(layout):
            if entry.shape is None:
                continue
            value = self._values(entry.variable, entry.channel)[places]
            while value.ndim - 1 < len(entry.shape):
                value = value[:, np.newaxis]
            while value.ndim - 1 > len(entry.shape):
                value = value[:, 0]
            cut = value[(slice(None), *(slice(size) for size in entry.shape))]
            parts.append(cut.reshape(places.size, -1))
        rows = np.concatenate(parts, axis=1)
        rows[np.isnan(rows)] = np.nan
        return (row.astype("<f8").tobytes() for row in rows)

    def _values(self, name: str, channel: str) -> NDArray[np.float64]:
        """Return the values of a variable over (time, ...), NaN where there is none."""
        value = np.asarray(self._columns[name][:, self._channels.index(channel)], dtype=np.float64)
        if VARIABLES[name].kind == "float":
            return value
        return np.where(value == (0.0 if VARIABLES[name].kind == "mask" else -1.0), np.nan, value)

    def _insert_files(self) -> None:
        """Insert what was known of the files of watched folders; a later row of a file is the newer one."""
        columns = {row[1] for row in self._connection.execute("PRAGMA table_info(files)")}
        for text in self._ledger.get("files", ()):
            insert_row(self._connection, "files", json.loads(str(text)), columns)


def insert_row(
    connection: sqlite3.Connection, table: str, values: Mapping[str, Any], columns: set[str], how: str = "OR REPLACE"
) -> None:
    """Insert a row given by column; columns that the table lacks are left out."""
    known = [name for name in values if name in columns]
    marks = ", ".join("?" for _ in known)
    statement = f"INSERT {how} INTO {table} ({', '.join(known)}) VALUES ({marks})"
    connection.execute(statement, [values[name] for name in known])
