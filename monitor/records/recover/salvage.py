"""Open a store; where it is damaged, copy its readable rows into a new one and keep the damaged one aside.

Only the writer does this; readers refuse a damaged store. The new store is made beside the old one and replaces it
atomically. The damaged database is never written to.
"""

from __future__ import annotations

import logging
import os
import shutil
import sqlite3
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import closing, suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from itertools import groupby
from pathlib import Path
from typing import Any

from monitor.records.database import (
    APPLICATION_ID,
    STORE_VERSION,
    StoreError,
    release_lock,
    sync_file,
    sync_folder,
    take_lock,
)
from monitor.records.events import EventLog
from monitor.records.ledger import SALVAGED_UP_TO, StoreLedger
from monitor.records.recover.from_published import from_published
from monitor.records.recover.leaf_pages import leaf_rows
from monitor.records.recover.rows import carry_over
from monitor.records.recover.settle import first_change, settle
from monitor.records.restore import Places, finish_restore
from monitor.records.store import Store

_LOG = logging.getLogger(__name__)
CHECKED_BYTES = 64 << 20
"""A store up to this size is checked as a whole whenever it is opened; of a larger one, the newest blocks."""
_NEWEST = 2000
_BEAT_EVERY = 200_000
"""Instructions of SQLite's virtual machine, some hundredths of a second."""
_CORRUPT = (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_ERROR)
_MAGIC = b"SQLite format 3\x00"
_TABLES = {"meta", "runs", "blocks", "records", "layouts", "stage_states", "forecasts", "events"}


@dataclass(frozen=True)
class BlockRange:
    """Consecutive blocks of a source: numbers of the first and the last."""

    source: str
    first: int
    last: int

    def __str__(self) -> str:
        """Return the blocks in words."""
        return f"{self.source} {self.first}" + (f" to {self.last}" if self.last > self.first else "")


@dataclass(frozen=True)
class SalvageReport:
    """Result of a salvage.

    Attributes:
        aside: the damaged database; its write-ahead log has the same name and ``-wal``.
        reason: the damage that was found.
        saved: number of records that are as they were committed.
        unchecked: those of them without a digest: of an older version, or the digest is lost.
        restored: those of them from the published files, proven by their digests.
        emptied: blocks whose record is lost; the ledger entry is kept as ``unreadable``.
        missing: blocks without a ledger entry.
        unplaced: number of further lost blocks, of unknown sources.
        relearning: names of states that are lost or older than the last block; their stages start anew.
        rows: number of rows saved, by table.
    """

    aside: Path
    reason: str
    saved: int
    unchecked: int = 0
    restored: int = 0
    emptied: tuple[BlockRange, ...] = ()
    missing: tuple[BlockRange, ...] = ()
    unplaced: int = 0
    relearning: tuple[str, ...] = ()
    rows: Mapping[str, int] = field(default_factory=dict)

    @property
    def lost(self) -> int:
        """Number of records that are known to be lost."""
        return self.unplaced + sum(part.last - part.first + 1 for part in (*self.emptied, *self.missing))

    @property
    def channels(self) -> tuple[tuple[str, str], ...]:
        """Source and name of the channels that learn anew."""
        parts = (name.split(":", 2) for name in self.relearning)
        return tuple((part[1], part[2]) for part in parts if part[0] == "channel" and len(part) == 3)

    @property
    def text(self) -> str:
        """The report in sentences."""
        parts = [f"the store was damaged ({self.reason}) and is kept as {self.aside.name}"]
        parts.append(f"{self.saved} records were saved")
        if self.restored:
            parts.append(f"{self.restored} of them from the published files")
        if self.unchecked:
            parts.append(f"{self.unchecked} of them cannot be proven to be unchanged")
        lost = [str(part) for part in (*self.emptied, *self.missing)]
        lost += [f"{self.unplaced} whose source is not known"] if self.unplaced else []
        parts.append(f"{self.lost} are lost" + (f": {', '.join(lost)}" if lost else ""))
        if self.relearning:
            names = ", ".join(name for _, name in self.channels)
            parts.append(f"learning anew: {names or ', '.join(self.relearning)}")
        return "; ".join(parts)

    def notice(self) -> dict[str, Any]:
        """Return the notice for the event log."""
        return {
            "kind": "store_salvaged",
            "channel": None,
            "severity": "danger" if self.lost or self.relearning else "alert",
            "text": self.text,
            "saved": self.saved,
            "lost": self.lost,
            "missing": [[part.source, part.first, part.last] for part in self.missing],
            "emptied": [[part.source, part.first, part.last] for part in self.emptied],
            "relearning": list(self.relearning),
            "aside": self.aside.name,
        }


def open_or_salvage(
    path: Path,
    *,
    machine: str,
    records_dir: Path | None = None,
    clock: Callable[[], float] = time.time,
    beat: Callable[[], object] = lambda: None,
) -> tuple[Store, SalvageReport | None]:
    """Open a store for writing; salvage it first where it is damaged.

    The report is a notice in the event log of the new store. The damaged database is kept beside it as
    ``state.db.corrupt-<UTC>``; where records are lost, the published files are kept in a folder of that name and
    ``-records``.

    Args:
        path: the database file, made where there is none.
        machine: its name.
        records_dir: folder of the published files, or None to ignore them.
        clock: UTC seconds since 1970.
        beat: called repeatedly during a salvage, which may take minutes.

    Raises:
        StoreError: as :meth:`Store.open` does, and where there is no room for the new store; the old one is unchanged.
    """
    path = Path(path)
    try:
        finish_restore(Places(path, records_dir or path.parent))
        _finish(path, clock())
        reason = damage_of(path, machine)
        report = None if reason is None else _salvage(path, machine, reason, records_dir, clock(), beat)
    except (OSError, sqlite3.Error) as error:
        raise StoreError(f"{path}: is damaged, and what is left cannot be saved: {error}") from error
    return Store.open(path, machine=machine), report


def damage_of(path: Path, machine: str) -> str | None:
    """Return the damage of a store, or None; :meth:`Store.open` refuses the database of another program."""
    try:
        with path.open("rb") as file:
            head = file.read(len(_MAGIC))
    except OSError:
        return None
    log = path.with_name(f"{path.name}-wal")
    if not head:
        return "the file is empty" if log.exists() and log.stat().st_size else None
    if head != _MAGIC:
        return "it does not begin as a database does" if _looks_like_a_store(path) else None
    # A process killed while it made the tables leaves a journal, which only a writer can roll back.
    mode = "rw" if path.with_name(f"{path.name}-journal").exists() else "ro"
    uri = f"{path.absolute().as_uri()}?mode={mode}"
    with closing(sqlite3.connect(uri, uri=True, isolation_level=None)) as connection:
        try:
            return _found_wrong(connection, path, machine)
        except UnicodeDecodeError as error:
            return str(error)
        except sqlite3.DatabaseError as error:
            # A UnicodeDecodeError has no code; a missing table is SQLITE_ERROR.
            if getattr(error, "sqlite_errorcode", sqlite3.SQLITE_ERROR) & 0xFF in _CORRUPT:
                return str(error)
            raise StoreError(f"{path}: {error}") from error


def _looks_like_a_store(path: Path) -> bool:
    """Return whether a file without the header of a database has rows of ``blocks``, or is a truncated header."""
    if path.stat().st_size < len(_MAGIC):
        return _MAGIC.startswith(path.read_bytes())
    return any(len(row.values) == 14 and row.rowid is not None for row in leaf_rows(path))


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


def _salvage(
    path: Path, machine: str, reason: str, records_dir: Path | None, now: float, beat: Callable[[], object]
) -> SalvageReport:
    """Make a new store of the readable rows, replace the damaged one by it, and log the report."""
    _LOG.error("%s: is damaged (%s); saving what can be read", path, reason)
    lock = take_lock(path)
    if lock is None:
        raise StoreError(f"{path}: is damaged ({reason}), and another process is writing to it")
    try:
        fresh = path.with_name(f"{path.name}.salvaging")
        for suffix in ("", "-wal", "-shm"):
            fresh.with_name(fresh.name + suffix).unlink(missing_ok=True)
        aside = _free_name(path, now)
        report = _fill(path, fresh, aside, machine, reason, records_dir, beat)
        with EventLog(fresh) as events:
            events.notice(now, report.notice())
        _close_for_good(fresh)
        if report.lost and records_dir is not None:
            _keep_published(records_dir, aside)
        fresh.with_name(f"{fresh.name}.lock").unlink(missing_ok=True)
        fresh.replace(path.with_name(f"{path.name}.salvaged"))
        _swap(path, aside)
    finally:
        release_lock(lock)
    _LOG.error("%s", report.text)
    return report


def _fill(
    path: Path,
    fresh: Path,
    aside: Path,
    machine: str,
    reason: str,
    records_dir: Path | None,
    beat: Callable[[], object],
) -> SalvageReport:
    """Make the new store and fill it."""

    def still_there() -> bool:
        beat()
        # True would interrupt the statement.
        return False

    with Store.open(fresh, machine=machine) as store, StoreLedger(store), EventLog(fresh):
        pass
    with closing(sqlite3.connect(fresh, isolation_level=None)) as connection:
        # After a power cut the salvage is repeated: the damaged store is still in its place.
        connection.execute("PRAGMA synchronous = OFF")
        connection.set_progress_handler(still_there, _BEAT_EVERY)
        found = carry_over(path, connection)
        restore = None if records_dir is None else from_published(records_dir, machine)
        account = settle(connection, found, restore)
        # The progress of files may be lost: blocks up to here may be offered again.
        connection.execute(f"INSERT INTO meta SELECT '{SALVAGED_UP_TO}', coalesce(max(id), 0) FROM blocks")
    return SalvageReport(
        aside=aside,
        reason=reason,
        saved=account.saved,
        unchecked=account.unchecked,
        restored=account.restored,
        emptied=_ranges(account.emptied),
        missing=tuple(BlockRange(*part) for part in account.missing),
        unplaced=account.unplaced,
        relearning=tuple(account.relearning),
        rows=found.rows,
    )


def _ranges(blocks: Iterable[tuple[str, int]]) -> tuple[BlockRange, ...]:
    """Join consecutive numbers."""
    parts: list[BlockRange] = []
    for source, numbers in groupby(sorted(blocks), key=lambda item: item[0]):
        for _, run in groupby(enumerate(number for _, number in numbers), key=lambda item: item[1] - item[0]):
            members = [number for _, number in run]
            parts.append(BlockRange(source, members[0], members[-1]))
    return tuple(parts)


def _close_for_good(fresh: Path) -> None:
    """Move the write-ahead log into the database, and make it durable."""
    with closing(sqlite3.connect(fresh, isolation_level=None)) as connection:
        connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    sync_file(fresh)


def _free_name(path: Path, now: float) -> Path:
    """Return the name under which the damaged database is kept."""
    stamp = datetime.fromtimestamp(now, UTC).strftime("%Y%m%dT%H%M%SZ")
    name = f"{path.name}.corrupt-{stamp}"
    number = 1
    while path.with_name(name).exists():
        number += 1
        name = f"{path.name}.corrupt-{stamp}-{number}"
    return path.with_name(name)


def _keep_published(records_dir: Path, aside: Path) -> None:
    """Keep a link of each published file: they may hold records that the new store does not."""
    files = sorted(records_dir.glob("*.nc")) if records_dir.is_dir() else []
    if files:
        folder = aside.with_name(f"{aside.name}-records")
        folder.mkdir(exist_ok=True)
        for file in files:
            _link(file, folder / file.name)


def _finish(path: Path, now: float) -> None:
    """Complete the replacement of a store by a salvage that was killed."""
    if not path.with_name(f"{path.name}.salvaged").exists():
        return
    lock = take_lock(path)
    if lock is None:
        raise StoreError(f"{path}: another process is writing to it")
    try:
        _swap(path, _free_name(path, now))
    finally:
        release_lock(lock)


def _swap(path: Path, aside: Path) -> None:
    """Rename the damaged database and put the new one in its place; may be repeated after any interruption."""
    same = [other for other in path.parent.glob(f"{path.name}.corrupt-*") if _same(path, other)]
    aside = same[0] if same else aside
    for suffix in ("", "-wal"):
        source, target = path.with_name(path.name + suffix), aside.with_name(aside.name + suffix)
        if source.exists() and not target.exists():
            _link(source, target)
    sync_folder(path.parent)
    # SQLite would apply a remaining log to the new database.
    for suffix in ("-wal", "-shm"):
        path.with_name(path.name + suffix).unlink(missing_ok=True)
    sync_folder(path.parent)
    path.with_name(f"{path.name}.salvaged").replace(path)
    sync_folder(path.parent)


def _same(path: Path, other: Path) -> bool:
    try:
        return path.samefile(other)
    except OSError:
        return False


def _link(source: Path, target: Path) -> None:
    """Give a file a second name, or copy it where the file system cannot do that."""
    try:
        os.link(source, target)
    except OSError:
        with suppress(FileNotFoundError):
            shutil.copy2(source, target)
