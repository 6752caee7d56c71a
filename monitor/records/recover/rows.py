"""Copies the readable rows of a damaged store into a new one, table by table."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from monitor.records.filing import ledger_digest
from monitor.records.recover.leaf_pages import Row, leaf_rows

LEDGER = "source, sequence, content_hash, name, status, flags, reason, time, elapsed, day, axis_time, time_status"
"""Columns of ``blocks`` that are an entry of the ledger, in the order in which its digest takes them."""

_BY_ROWID = (
    *("digests", "runs", "blocks", "records", "forecasts", "events"),
    *("refusals", "notices", "acknowledgements", "spectra"),
)
_LEFT_OUT = ("meta", "published", "layouts", "rollup")
_FARTHEST = 1 << 40
_FIRST_UTC = 10**9
_SECONDS = tuple(LEDGER.split(", ").index(name) for name in ("time", "elapsed", "axis_time"))
_DAMAGE = (sqlite3.DatabaseError, UnicodeDecodeError)


@dataclass
class Found:
    """Rows that need a decision before they are written.

    Attributes:
        layouts: all texts found, by number; the digests of records decide which is right.
        states: block numbers and JSON by name, that of the latest block first.
        rows: number of copied rows by table.
    """

    layouts: dict[int, list[str]] = field(default_factory=dict)
    states: dict[str, list[tuple[int, str]]] = field(default_factory=dict)
    rows: dict[str, int] = field(default_factory=dict)

    def add_layout(self, number: int, text: str) -> None:
        """Add a candidate of a layout."""
        texts = self.layouts.setdefault(number, [])
        if text not in texts:
            texts.append(text)

    def add_state(self, name: str, block: int, text: str) -> None:
        """Add a candidate of a state."""
        found = self.states.setdefault(name, [])
        if (block, text) not in found:
            found.append((block, text))
            found.sort(reverse=True)


def carry_over(damaged: Path, fresh: sqlite3.Connection) -> Found:
    """Copy every readable row into a new store, but for blocks whose ledger entry is not as committed.

    First through SQLite, around unreadable places, then from the leaf pages those that it did not find.

    Args:
        damaged: the database file, with its write-ahead log beside it.
        fresh: of the new store, in autocommit and without foreign keys; it has all tables.
    """
    found = Found()
    old = _open(damaged)
    if old is not None:
        with closing(old):
            # Digests come first: they decide which rows of blocks are copied.
            for table in (*_BY_ROWID, *_others(old, fresh)):
                _copy(old, fresh, table)
            _collect(old, found)
    raw = _Raw(fresh, found)
    for wanted in ("digests", None):
        fresh.execute("BEGIN")
        for row in leaf_rows(damaged):
            raw.take(row, wanted)
        fresh.execute("COMMIT")
    for table in _BY_ROWID:
        found.rows[table] = fresh.execute(f"SELECT count(*) FROM {table}").fetchone()[0]
    return found


def _open(path: Path) -> sqlite3.Connection | None:
    old = sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True, isolation_level=None, timeout=5.0)
    try:
        old.execute("PRAGMA cell_size_check = ON")
        old.execute("SELECT count(*) FROM sqlite_master").fetchall()
    except _DAMAGE:
        old.close()
        return None
    return old


def _others(old: sqlite3.Connection, fresh: sqlite3.Connection) -> list[str]:
    """Return the other tables of the damaged store; those missing in the new one are made."""
    names: list[str] = []
    known = {row[0] for row in fresh.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
    try:
        tables = old.execute("SELECT name, sql FROM sqlite_master WHERE type = 'table'").fetchall()
    except _DAMAGE:
        return names
    for name, statement in tables:
        if name in _BY_ROWID or name in _LEFT_OUT or name.startswith("sqlite_") or name == "stage_states":
            continue
        if name not in known:
            try:
                fresh.execute(statement)
            except (sqlite3.ProgrammingError, sqlite3.OperationalError):
                continue
        names.append(name)
    return names


def _copy(old: sqlite3.Connection, fresh: sqlite3.Connection, table: str) -> None:
    """Copy the rows of a table that SQLite can read."""
    try:
        columns = _columns(old, fresh, table)
    except _DAMAGE:
        return
    if not columns:
        return
    wanted = _as_committed(fresh, columns) if table == "blocks" else None
    marks = ", ".join("?" for _ in columns)
    statement = f"INSERT OR IGNORE INTO {table} ({', '.join(columns)}) VALUES ({marks})"
    fresh.execute("BEGIN")
    for values in _readable(old, table, columns):
        if wanted is None or wanted(values):
            with suppress(sqlite3.IntegrityError, sqlite3.DataError):
                fresh.execute(statement, values)
    fresh.execute("COMMIT")


def _columns(old: sqlite3.Connection, fresh: sqlite3.Connection, table: str) -> list[str]:
    """Return the common columns, and the rowid of tables that are ordered by it."""
    had = {row[1] for row in old.execute(f"PRAGMA table_info({table})")}
    columns = [row[1] for row in fresh.execute(f"PRAGMA table_info({table})") if row[1] in had]
    return ["rowid", *columns] if columns and table in ("spectra", "refusals") else columns


def _as_committed(fresh: sqlite3.Connection, columns: list[str]) -> Callable[[tuple[Any, ...]], bool]:
    places = [columns.index(name) for name in ("id", *LEDGER.split(", "))]

    def wanted(values: tuple[Any, ...]) -> bool:
        number, *entry = (values[place] for place in places)
        return _is_as_committed(fresh, number, entry)

    return wanted


def _is_as_committed(fresh: sqlite3.Connection, number: int, entry: list[Any]) -> bool:
    """Return whether a ledger entry has its committed digest, or none, as older ones."""
    found = fresh.execute("SELECT ledger FROM digests WHERE block = ?", (number,)).fetchone()
    return found is None or found[0] == ledger_digest(entry)


def _readable(old: sqlite3.Connection, table: str, columns: list[str]) -> Iterator[tuple[Any, ...]]:
    """Yield the rows that can be read."""
    text = ", ".join(columns)
    try:
        old.execute(f"SELECT rowid FROM {table} LIMIT 1").fetchall()
    except sqlite3.OperationalError as error:
        if "no such column" in str(error):
            yield from _from_both_ends(old, f"SELECT {text} FROM {table}", ", ".join(_key(old, table)))
            return
    except _DAMAGE:
        pass
    query = f"SELECT rowid, {text} FROM {table} WHERE rowid >= ? ORDER BY rowid"
    start = 1
    while start is not None:
        try:
            for row in old.execute(query, (start,)):
                start = row[0] + 1
                yield row[1:]
            return
        except _DAMAGE:
            start = _behind(old, f"{query} LIMIT 1", start)


def _behind(old: sqlite3.Connection, query: str, start: int) -> int | None:
    """Return the lowest rowid after an unreadable place from which rows can be read, or None."""

    def reads(place: int) -> bool:
        try:
            return old.execute(query, (place,)).fetchone() is not None
        except _DAMAGE:
            return False

    step = 1
    while not reads(start + step):
        step *= 2
        if step > _FARTHEST:
            return None
    bad, good = start + step // 2, start + step
    while good - bad > 1:
        middle = (bad + good) // 2
        bad, good = (bad, middle) if reads(middle) else (middle, good)
    return good


def _key(old: sqlite3.Connection, table: str) -> list[str]:
    rows = old.execute(f"PRAGMA table_info({table})").fetchall()
    return [row[1] for row in sorted(rows, key=lambda row: row[5]) if row[5]]


def _from_both_ends(old: sqlite3.Connection, query: str, key: str) -> Iterator[tuple[Any, ...]]:
    """Yield the rows of a table without rowid, up and down to the unreadable place; some twice."""
    for order in (key, ", ".join(f"{name} DESC" for name in key.split(", "))):
        with suppress(*_DAMAGE):
            yield from old.execute(f"{query} ORDER BY {order}")
            return


def _collect(old: sqlite3.Connection, found: Found) -> None:
    """Add the layouts and states that SQLite can read."""
    for order in ("id", "layout"):
        # The layouts are in the table and in its index.
        with suppress(*_DAMAGE):
            for number, text in old.execute(f"SELECT id, layout FROM layouts ORDER BY {order}"):
                found.add_layout(number, text)
    for name, block, text in _from_both_ends(old, "SELECT name, block, state FROM stage_states", "name"):
        found.add_state(name, block, text)


class _Raw:
    """Rows of leaf pages, inserted into the table whose column types they have.

    Only tables whose rows never change are read, so that old versions of pages do no harm, and states, of which the
    block number decides which is the latest.
    """

    def __init__(self, fresh: sqlite3.Connection, found: Found) -> None:
        self._fresh, self._found = fresh, found
        self._forecasts = len(list(fresh.execute("PRAGMA table_info(forecasts)")))

    def take(self, row: Row, wanted: str | None) -> None:
        """Insert a row, if it is of the table ``wanted``, or where that is None, of any table but the digests."""
        if row.rowid is None:
            if wanted is None:
                self._take_keyed(row.values)
            return
        table = self._table_of(row.values)
        if table is None or (table == "digests") != (wanted == "digests"):
            return
        if table == "layouts":
            self._found.add_layout(row.rowid, str(row.values[1]))
            return
        # The column of the rowid is stored as NULL.
        values = (row.rowid, *row.values[1:])
        if table == "blocks" and not _is_as_committed(self._fresh, row.rowid, _entry(values)):
            return
        marks = ", ".join("?" for _ in values)
        # The digest of the states is added by an update.
        newer = " ON CONFLICT (block) DO UPDATE SET states = excluded.states WHERE states IS NULL"
        statement = f"INSERT OR IGNORE INTO {table} VALUES ({marks}){newer if table == 'digests' else ''}"
        with suppress(sqlite3.IntegrityError, sqlite3.DataError, OverflowError):
            self._fresh.execute(statement, values)

    def _take_keyed(self, values: tuple[Any, ...]) -> None:
        kinds = _kinds(values)
        if kinds == "tit" and values[2].startswith("{"):
            self._found.add_state(*values)
        elif kinds == "ti" and values[0].startswith("["):
            self._found.add_layout(values[1], values[0])

    def _table_of(self, values: tuple[Any, ...]) -> str | None:
        kinds = _kinds(values)
        if kinds.startswith("0tittttt") and len(values) == 14:
            return "blocks"
        if kinds in ("0bb0", "0bbb"):
            return "digests"
        if len(values) == self._forecasts and kinds.startswith("0it"):
            return "forecasts"
        if kinds == "0t":
            return "layouts" if values[1].startswith("[") else "runs" if _is_json(values[1]) else None
        if kinds in ("0rt", "0it"):
            # Whole seconds are stored as integers, as block numbers are, which are smaller.
            if not _is_json(values[2]):
                return None
            return "notices" if values[1] > _FIRST_UTC else "events"
        return {"0ib": "records", "0trtt": "acknowledgements", "0titt": "acknowledgements"}.get(kinds)


def _entry(values: tuple[Any, ...]) -> list[Any]:
    """Return the ledger entry of a row of ``blocks``; whole seconds are stored as integers."""
    entry = list(values[1:13])
    for place in _SECONDS:
        if isinstance(entry[place], int):
            entry[place] = float(entry[place])
    return entry


def _kinds(values: tuple[Any, ...]) -> str:
    letters = {type(None): "0", int: "i", float: "r", str: "t", bytes: "b"}
    return "".join(letters[type(value)] for value in values)


def _is_json(text: str) -> bool:
    try:
        return isinstance(json.loads(text), dict)
    except ValueError:
        return False
