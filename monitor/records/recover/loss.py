"""Finds out whether a store is lost, damaged, or older than the published records."""

from __future__ import annotations

import errno
import os
import re
import sqlite3
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from models.platform.portable import read_at
from monitor.records.condense import has_condensed, identity_of
from monitor.records.database import APPLICATION_ID, MAGIC, STORE_VERSION, opened
from monitor.records.failures import Kind, StoreError, confirmed, kind_of
from monitor.records.filing import published_files
from monitor.records.published_folder import Snapshot, reached_days, read_snapshot
from monitor.records.recover.published import Beat, gather, remove_database
from monitor.records.recover.rows import has_header, read_damaged
from monitor.records.recover.settle import first_change

CHECKED_BYTES = 64 << 20
"""A store up to this size is checked as a whole whenever it is opened; of a larger one, the newest blocks."""
_NEWEST = 2000
_PAGE_BYTES = 4096
_UNREAD = re.compile(r"error code=(\d+)")
"""In a line of SQLite's check: a page that was not read, with an extended code."""
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
    _roll_back(path)
    files = () if records_dir is None else tuple(published_files(records_dir, machine))

    def all_days() -> tuple[Path, ...]:
        moved = [] if records_dir is None else reached_days(records_dir, machine, beat)
        return tuple(sorted([*moved, *files], key=lambda file: file.name))

    if not path.exists() or not path.stat().st_size:
        found = all_days()
        if not found and not _is_logged(path):
            return None
        return Loss("it is missing" if not path.exists() else "the file is empty", found)
    reason = confirmed(lambda: damage_of(path, machine, records_dir))
    if reason is not None:
        return Loss(f"it was damaged ({reason})", all_days())
    if records_dir is None or not has_header(path):
        return None
    return _find_older(path, machine, records_dir, files, beat)


def _roll_back(path: Path) -> None:
    """Undo what was not committed before a crash: of a store that was being made, the journal alone is whole."""
    journal = path.with_name(f"{path.name}-journal")
    if not journal.exists() or not path.exists():
        return
    try:
        with closing(opened(path, "rw")) as connection:
            connection.execute("SELECT count(*) FROM sqlite_master")
    except sqlite3.DatabaseError as error:
        if not _says_damage(error):
            raise


def damage_of(path: Path, machine: str, records_dir: Path | None = None) -> str | None:
    """Return the damage of a store, or None; another program's database, or none at all, is not damaged.

    A file that does not begin as a database does counts as ours where a log or published files are beside it. It must
    not be open in this process, see :func:`monitor.records.database.refuse_unsuitable`.

    Raises:
        OSError, StoreError: the file cannot be read now, which is no damage.
    """
    if not has_header(path, strict=True):
        if not path.exists() or not path.stat().st_size:
            return None
        _read(path)
        beside = _is_logged(path) or (records_dir is not None and published_files(records_dir, machine))
        return _HEADLESS if beside or _is_ours(path) else None
    try:
        with closing(opened(path, "ro")) as connection:
            return _found_wrong(connection, path, machine)
    except UnicodeDecodeError as error:
        return str(error)
    except sqlite3.DatabaseError as error:
        if not _says_damage(error):
            raise StoreError(f"{path}: {error}") from error
        # SQLite reports what the system cannot read as a malformed database, too.
        _read(path)
        return str(error)


def damage_in_use(path: Path) -> str | None:
    """Return the damage of a store that this process may have open, or None; StoreError where it cannot be read."""
    try:
        try:
            with closing(opened(path, "ro")) as connection:
                found = _found_wrong(connection, path, None)
        except (UnicodeDecodeError, sqlite3.DatabaseError) as error:
            if isinstance(error, sqlite3.DatabaseError) and not _says_damage(error):
                raise
            found = str(error)
        if found is not None:
            _read(path, in_use=True)
    except (sqlite3.DatabaseError, OSError) as error:
        raise StoreError(f"{path}: {error}") from error
    return found


def _says_damage(error: sqlite3.DatabaseError) -> bool:
    """Return whether an error tells of a malformed database, or of a table that is missing in one of ours."""
    code = getattr(error, "sqlite_errorcode", sqlite3.SQLITE_ERROR)
    return code & 0xFF == sqlite3.SQLITE_ERROR or kind_of(error) is Kind.DAMAGE


def _read(path: Path, *, in_use: bool = False) -> None:
    """Read a file page by page, as SQLite does, where it is large both ends; OSError where the system cannot.

    The descriptor of a store in use stays open: to close it would release the locks of SQLite, see
    :func:`monitor.records.database.refuse_unsuitable`.
    """
    handle = os.open(path, os.O_RDONLY)
    try:
        size = os.fstat(handle).st_size
        ends = {
            *range(0, min(size, CHECKED_BYTES), _PAGE_BYTES),
            *range(max(0, size - CHECKED_BYTES), size, _PAGE_BYTES),
        }
        for place in sorted(ends):
            read_at(handle, _PAGE_BYTES, place)
    finally:
        if not in_use:
            os.close(handle)


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


def _found_wrong(connection: sqlite3.Connection, path: Path, machine: str | None) -> str | None:
    """Return the damage of a store of a machine (None: any); a larger one is read at its newest blocks only."""
    tables = {row[0] for row in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
    if not tables & _TABLES:
        return None
    if not tables >= _TABLES:
        return f"the table {min(_TABLES - tables)} is missing"
    meta = dict(connection.execute("SELECT key, value FROM meta"))
    version = meta.get("schema_version", "")
    if machine not in (None, meta.get("machine", machine)) or (version.isdigit() and int(version) > STORE_VERSION):
        return None
    if not version.isdigit() or connection.execute("PRAGMA application_id").fetchone()[0] != APPLICATION_ID:
        return "it does not say what it is"
    if path.stat().st_size <= CHECKED_BYTES:
        problem = connection.execute("PRAGMA integrity_check(1)").fetchone()[0]
        if (unread := _UNREAD.search(problem)) and int(unread[1]) & 0xFF == sqlite3.SQLITE_IOERR:
            raise OSError(errno.EIO, f"a page of it cannot be read ({unread[0]})")
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
