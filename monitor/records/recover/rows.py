"""Copies the rows of a damaged store that SQLite can read into a new one, table by table, around damaged pages."""

from __future__ import annotations

import shutil
import sqlite3
import struct
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any

from monitor.records.condense import condensed_up_to, has_condensed
from monitor.records.database import APPLICATION_ID, MAGIC, opened
from monitor.records.ledger import SALVAGED_UP_TO

_APART = ("meta", "published", "layouts", "rollup", "stage_states")
_ROLLUP_KEYS = {"rolled_up", "rollup_features"}
_OWN_KEYS = {"schema_version", "machine", SALVAGED_UP_TO, *_ROLLUP_KEYS}
_FARTHEST = 1 << 40
_DAMAGE = (sqlite3.DatabaseError, UnicodeDecodeError)
_PAGE = 4096

States = list[tuple[str, int, str]]
"""Name, number of the block and JSON of states of stages."""


def carry_over(damaged: Path, fresh: sqlite3.Connection) -> States:
    """Copy every readable row into a new store, and return the states; none where SQLite cannot open the file.

    Args:
        damaged: the database file, with its write-ahead log beside it; either may be missing.
        fresh: of the new store, in autocommit and without foreign keys; it has all tables.
    """
    found: States = []
    with suppress(*_DAMAGE), read_damaged(damaged) as old:
        for order in ("id", "layout"):
            # The layouts are in the table and in its index.
            with suppress(*_DAMAGE):
                for number, text in old.execute(f"SELECT id, layout FROM layouts ORDER BY {order}"):
                    add_layout(fresh, number, text)
        for table in _tables(old, fresh):
            _copy(old, fresh, table)
        _copy_meta(old, fresh)
        found += _from_both_ends(old, "SELECT name, block, state FROM stage_states", "name")
    return found


@contextmanager
def read_damaged(path: Path) -> Iterator[sqlite3.Connection]:
    """Open a damaged database for reading; one without a valid header as a copy that has one.

    Raises:
        sqlite3.DatabaseError: SQLite cannot read its schema.
    """
    copy: Path | None = None
    if not has_header(path):
        copy = _mended(path)
    try:
        with closing(opened(copy or path, "rw" if copy else "ro")) as old:
            old.execute("PRAGMA cell_size_check = ON")
            old.execute("SELECT count(*) FROM sqlite_master").fetchall()
            yield old
    finally:
        for suffix in ("", "-wal", "-shm") if copy else ():
            path.with_name(f"{path.name}.mended{suffix}").unlink(missing_ok=True)


def has_header(path: Path, *, strict: bool = False) -> bool:
    """Return whether a file begins as a database does, with a whole first page.

    One that is there and cannot be read has none or, where ``strict``, raises OSError.
    """
    try:
        with path.open("rb") as file:
            return len(page := file.read(_PAGE)) == _PAGE and page.startswith(MAGIC)
    except OSError as error:
        if strict and not isinstance(error, FileNotFoundError):
            raise
        return False


def _mended(path: Path) -> Path:
    """Copy a database and its log, with the header of a database in place of what is there."""
    copy = path.with_name(f"{path.name}.mended")
    for suffix in ("", "-wal"):
        source, target = path.with_name(path.name + suffix), copy.with_name(copy.name + suffix)
        target.write_bytes(b"")
        with suppress(FileNotFoundError):
            shutil.copyfile(source, target)
    size = max(copy.stat().st_size, _PAGE)
    # Section 1.3 of the file format: page size, write-ahead log, change counter, pages, schema format 4, UTF-8.
    head = struct.pack(">H6B11I", _PAGE, 2, 2, 0, 64, 32, 32, 1, size // _PAGE, 0, 0, 1, 4, 0, 0, 1, 0, 0)
    with copy.open("r+b") as file:
        file.write(MAGIC + head + struct.pack(">I20xII", APPLICATION_ID, 1, 3040000))
        file.truncate(size)
    return copy


def add_layout(fresh: sqlite3.Connection, number: int | None, text: str) -> int:
    """Insert a layout, under its number where that is free; return its number."""
    known = fresh.execute("SELECT id FROM layouts WHERE layout = ?", (text,)).fetchone()
    if known is not None:
        return known[0]
    if number is not None and fresh.execute("SELECT 1 FROM layouts WHERE id = ?", (number,)).fetchone():
        number = None
    return fresh.execute("INSERT INTO layouts VALUES (?, ?)", (number, text)).lastrowid or 0


def _tables(old: sqlite3.Connection, fresh: sqlite3.Connection) -> list[str]:
    """Return the tables to copy; those missing in the new store are made."""
    names: list[str] = []
    known = {row[0] for row in fresh.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
    with suppress(*_DAMAGE):
        for name, statement in old.execute("SELECT name, sql FROM sqlite_master WHERE type = 'table'").fetchall():
            if name in _APART or name.startswith("sqlite_"):
                continue
            with suppress(sqlite3.ProgrammingError, sqlite3.OperationalError):
                if name not in known:
                    fresh.execute(statement)
                names.append(name)
    return names


def _copy_meta(old: sqlite3.Connection, fresh: sqlite3.Connection) -> None:
    """Copy what ``meta`` says of sources; the rollup only where blocks are in nothing else any more."""
    found = dict(_from_both_ends(old, "SELECT key, value FROM meta", "key"))
    for key, value in found.items():
        if key not in _OWN_KEYS:
            fresh.execute("INSERT OR REPLACE INTO meta VALUES (?, ?)", (key, value))
    if has_condensed(fresh) and condensed_up_to(fresh):
        _copy(old, fresh, "rollup")
        for key in _ROLLUP_KEYS & found.keys():
            fresh.execute("INSERT OR REPLACE INTO meta VALUES (?, ?)", (key, found[key]))


def _copy(old: sqlite3.Connection, fresh: sqlite3.Connection, table: str) -> None:
    """Copy the rows of a table that SQLite can read."""
    try:
        had = {row[1] for row in old.execute(f"PRAGMA table_info({table})")}
        keyed = _without_rowid(old, table)
    except _DAMAGE:
        return
    columns = [row[1] for row in fresh.execute(f"PRAGMA table_info({table})") if row[1] in had]
    rowids = fresh.execute(f"SELECT 1 FROM pragma_table_info('{table}') WHERE type = 'INTEGER' AND pk").fetchone()
    if columns and not keyed and rowids is None:
        columns = ["rowid", *columns]
    marks = ", ".join("?" for _ in columns)
    statement = f"INSERT OR IGNORE INTO {table} ({', '.join(columns)}) VALUES ({marks})"
    fresh.execute("BEGIN")
    query = f"SELECT {', '.join(columns)} FROM {table}"
    rows = _from_both_ends(old, query, ", ".join(keyed)) if keyed else _readable(old, table, columns)
    for values in rows if columns else ():
        with suppress(sqlite3.IntegrityError, sqlite3.DataError):
            fresh.execute(statement, values)
    fresh.execute("COMMIT")


def _without_rowid(old: sqlite3.Connection, table: str) -> list[str]:
    """Return the key of a table without rowid, [] for another one."""
    (statement,) = old.execute("SELECT sql FROM sqlite_master WHERE name = ?", (table,)).fetchone()
    if "WITHOUT ROWID" not in statement:
        return []
    rows = old.execute(f"PRAGMA table_info({table})").fetchall()
    return [row[1] for row in sorted(rows, key=lambda row: row[5]) if row[5]]


def _readable(old: sqlite3.Connection, table: str, columns: list[str]) -> Iterator[tuple[Any, ...]]:
    """Yield the rows that can be read, by rowid, around places that cannot."""
    query = f"SELECT rowid, {', '.join(columns)} FROM {table} WHERE rowid >= ? ORDER BY rowid"
    start: int | None = 1
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


def _from_both_ends(old: sqlite3.Connection, query: str, key: str) -> Iterator[tuple[Any, ...]]:
    """Yield the rows of a table without rowid, up and down to the unreadable place; some twice."""
    for order in (key, ", ".join(f"{name} DESC" for name in key.split(", "))):
        with suppress(*_DAMAGE):
            yield from old.execute(f"{query} ORDER BY {order}")
            return
