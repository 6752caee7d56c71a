"""Finds out whether a store is lost, damaged, or older than the published records."""

from __future__ import annotations

import sqlite3
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from monitor.records.condense import has_condensed, identity_of
from monitor.records.database import APPLICATION_ID, MAGIC, STORE_VERSION, StoreError, opened
from monitor.records.filing import published_files
from monitor.records.published_folder import Snapshot, reached_days, read_snapshot
from monitor.records.recover.published import Beat, gather, remove_database
from monitor.records.recover.rows import has_header, read_damaged
from monitor.records.recover.settle import first_change

CHECKED_BYTES = 64 << 20
"""A store up to this size is checked as a whole whenever it is opened; of a larger one, the newest blocks."""
_NEWEST = 2000
_CORRUPT = (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_ERROR)
_LOG_MAGIC = (b"\x37\x7f\x06\x82", b"\x37\x7f\x06\x83")
_HEADLESS = "it does not begin as a database does"
_TABLES = {"meta", "runs", "blocks", "records", "layouts", "stage_states", "forecasts", "events"}


@dataclass(frozen=True)
class Loss:
    """Why a store has to be made again, and the published files that hold what it lacks, moved days among them.

    Of two files of a day, the one in the folder of the published files comes last.
    """

    reason: str
    files: tuple[Path, ...]


def find_loss(path: Path, machine: str, records_dir: Path | None, beat: Beat) -> Loss | None:
    """Return what a store lost, or None; :meth:`Store.open` refuses the database of another program."""
    if path.is_dir():
        return None
    files = () if records_dir is None else tuple(published_files(records_dir, machine))

    def all_days() -> tuple[Path, ...]:
        moved = [] if records_dir is None else reached_days(records_dir, machine, beat)
        return tuple(sorted([*moved, *files], key=lambda file: file.name))

    if not path.exists() or not path.stat().st_size:
        found = all_days()
        if not found and not _is_logged(path):
            return None
        return Loss("it is missing" if not path.exists() else "the file is empty", found)
    reason = damage_of(path, machine, records_dir)
    if reason is not None:
        return Loss(f"it was damaged ({reason})", all_days())
    if records_dir is None or not has_header(path):
        return None
    return _find_older(path, machine, records_dir, files, beat)


def damage_of(path: Path, machine: str, records_dir: Path | None = None) -> str | None:
    """Return the damage of a store, or None; another program's database, or none at all, is not damaged.

    A file that does not begin as a database does counts as ours where a log or published files are beside it.
    """
    if not has_header(path):
        if not path.exists() or not path.stat().st_size:
            return None
        beside = _is_logged(path) or (records_dir is not None and published_files(records_dir, machine))
        return _HEADLESS if beside or _is_ours(path) else None
    try:
        # A process killed while it made the tables leaves a journal, which only a writer can roll back.
        mode = "rw" if path.with_name(f"{path.name}-journal").exists() else "ro"
        with closing(opened(path, mode)) as connection:
            return _found_wrong(connection, path, machine)
    except UnicodeDecodeError as error:
        return str(error)
    except sqlite3.DatabaseError as error:
        # A UnicodeDecodeError has no code; a missing table is SQLITE_ERROR.
        if getattr(error, "sqlite_errorcode", sqlite3.SQLITE_ERROR) & 0xFF not in _CORRUPT:
            raise StoreError(f"{path}: {error}") from error
        return str(error)


def _is_logged(path: Path) -> bool:
    """Return whether the write-ahead log of a database is beside it."""
    try:
        with path.with_name(f"{path.name}-wal").open("rb") as file:
            return file.read(4) in _LOG_MAGIC
    except OSError:
        return False


def _is_ours(path: Path) -> bool:
    """Return whether a file begins as a database, cut off, or with a lost page, or holds our tables behind its header.

    A page of zeros is what a power cut leaves; no other program's file begins with one.
    """
    with path.open("rb") as file:
        head = file.read(len(MAGIC))
    if MAGIC.startswith(head) or not any(head):
        return True
    try:
        with read_damaged(path) as connection:
            return bool(connection.execute("SELECT 1 FROM sqlite_master WHERE name = 'stage_states'").fetchone())
    except sqlite3.DatabaseError:
        return False


def _found_wrong(connection: sqlite3.Connection, path: Path, machine: str) -> str | None:
    tables = {row[0] for row in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
    if not tables & _TABLES:
        return None
    if not tables >= _TABLES:
        return f"the table {min(_TABLES - tables)} is missing"
    meta = dict(connection.execute("SELECT key, value FROM meta"))
    version = meta.get("schema_version", "")
    if meta.get("machine", machine) != machine or (version.isdigit() and int(version) > STORE_VERSION):
        return None
    if not version.isdigit() or connection.execute("PRAGMA application_id").fetchone()[0] != APPLICATION_ID:
        return "it does not say what it is"
    if path.stat().st_size <= CHECKED_BYTES:
        problem = connection.execute("PRAGMA integrity_check(1)").fetchone()[0]
        if problem != "ok":
            return " ".join(problem.split())
        query = "SELECT count(*) FROM blocks WHERE id NOT IN (SELECT block FROM records)"
        orphans = connection.execute(query).fetchone()[0]
        if orphans:
            return f"{orphans} blocks of the ledger have no record"
    return first_change(connection, _NEWEST) if "digests" in tables else None


def _find_older(path: Path, machine: str, records_dir: Path, files: Sequence[Path], beat: Beat) -> Loss | None:
    """Return the published files with blocks that an intact store lacks, or None.

    Only files that are not as this store, or the snapshot of its own blocks, noted them are read.
    """
    snapshot = read_snapshot(records_dir, machine)
    with closing(opened(path, "ro")) as connection:
        tables = {name for (name,) in connection.execute("SELECT name FROM sqlite_master")}
        if not tables:
            return Loss("it is empty", tuple(files)) if files else None
        if "blocks" not in tables:
            return None
        (last,) = connection.execute("SELECT coalesce(max(id), 0) FROM blocks").fetchone()
        noted = set(connection.execute("SELECT file, size FROM published WHERE last_block <= ?", (last,)))
        if snapshot is not None and snapshot.last_block <= last and _knows(connection, snapshot):
            noted |= set(snapshot.files.items())
        changed = [file for file in files if (file.name, file.stat().st_size) not in noted]
        if not changed:
            return None
        scratch = path.with_name(f"{path.name}.published")
        try:
            gather(changed, machine, scratch, beat)
            with closing(opened(scratch)) as found:
                published = found.execute("SELECT source, sequence FROM blocks").fetchall()
        finally:
            remove_database(scratch)
        ahead = sum(not _has(connection, *block) for block in published)
    return Loss(f"{ahead} published records are not in it", tuple(changed)) if ahead else None


def _has(connection: sqlite3.Connection, source: str, sequence: int) -> bool:
    """Return whether a store has a block, in full or condensed."""
    if connection.execute("SELECT 1 FROM blocks WHERE source = ? AND sequence = ?", (source, sequence)).fetchone():
        return True
    return has_condensed(connection) and identity_of(connection, source, sequence) is not None


def _knows(connection: sqlite3.Connection, snapshot: Snapshot) -> bool:
    """Return whether all blocks of the states of a snapshot are in the store."""
    query = "SELECT 1 FROM blocks WHERE source = ? AND sequence = ? AND content_hash = ?"
    return all(connection.execute(query, stated[:3]).fetchone() for stated in snapshot.states.values())
