"""Open a store; where it is lost, damaged or older than the published records, make it again.

The new store holds the rows that SQLite can read and the published records. Only the writer does this; readers refuse
a damaged store. It is made beside the old one and replaces it atomically; the damaged database is never written to.
"""

from __future__ import annotations

import logging
import sqlite3
import time
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from monitor.records.backup import stamp_of
from monitor.records.condense import condensed_on
from monitor.records.database import StoreError, opened
from monitor.records.durable import exclusive, free_name, make_folder, put_in_place, same_file, sync_file
from monitor.records.events import Deliveries, EventLog
from monitor.records.ledger import SALVAGED_UP_TO, StoreLedger
from monitor.records.published_folder import MovedDaysError, absence_text, moved_days, read_snapshot
from monitor.records.recover.loss import Loss, find_loss
from monitor.records.recover.published import Beat, Gathered, gather, remove_database
from monitor.records.recover.rows import carry_over
from monitor.records.recover.settle import Account, settle
from monitor.records.restore import Places, finish_restore
from monitor.records.store import Store


@dataclass
class SalvageReport(Account):
    """Result of a recovery.

    Attributes:
        aside: the damaged database, or None where there was none; its write-ahead log has the same name and ``-wal``.
        reason: what was found.
        unreadable: published files that cannot be read.
        remarks: further sentences.
    """

    aside: Path | None = None
    reason: str = ""
    unreadable: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()

    @property
    def lost(self) -> int:
        """Number of records that are known to be lost."""
        return self.unplaced + sum(part.last - part.first + 1 for part in (*self.emptied, *self.missing))

    @property
    def text(self) -> str:
        """The report in sentences."""
        kept = "" if self.aside is None else f" and is kept as {self.aside.name}"
        parts = [f"the store was made again: {self.reason}{kept}", f"{self.saved} records were saved"]
        if self.restored:
            parts.append(f"{self.restored} of them from the published files; spectra come from the store alone")
        if self.unchecked:
            parts.append(f"{self.unchecked} of them cannot be proven to be unchanged")
        lost = [str(part) for part in (*self.emptied, *self.missing)]
        lost += [f"{self.unplaced} whose source is not known"] if self.unplaced else []
        parts.append(f"{self.lost} are known to be lost" + (f": {', '.join(lost)}" if lost else ""))
        if self.unreadable:
            parts.append(f"published files that cannot be read: {', '.join(self.unreadable)}")
        return "; ".join((*parts, *self.remarks))

    def notice(self) -> dict[str, Any]:
        """Return the notice for the event log."""
        return {
            "kind": "store_salvaged",
            "channel": None,
            "severity": "danger" if self.lost or self.unreadable else "alert",
            "text": self.text,
            "saved": self.saved,
            "restored": self.restored,
            "lost": self.lost,
            "missing": [[part.source, part.first, part.last] for part in self.missing],
            "emptied": [[part.source, part.first, part.last] for part in self.emptied],
            "unreadable": list(self.unreadable),
            "aside": None if self.aside is None else self.aside.name,
        }


_LOG = logging.getLogger(__name__)
_BEAT_EVERY = 200_000
"""Instructions of SQLite's virtual machine, some hundredths of a second."""


def open_or_salvage(
    path: Path,
    *,
    machine: str,
    records_dir: Path | None = None,
    clock: Callable[[], float] = time.time,
    beat: Beat = lambda: None,
) -> tuple[Store, SalvageReport | None]:
    """Open a store for writing; where it is lost, damaged or older than the published files, make it again first.

    The report is a notice in the event log of the new store. A damaged database is kept beside it as
    ``state.db.corrupt-<UTC>``.

    Args:
        path: the database file, made where there is none.
        machine: its name.
        records_dir: folder of the published files, or None to ignore them.
        clock: UTC seconds since 1970.
        beat: called repeatedly during a recovery, which may take minutes.

    Raises:
        StoreError: as :meth:`Store.open` does, where the store cannot be read now, and where there is no room for the
            new one; the old one is unchanged.
    """
    path = Path(path)
    try:
        finish_restore(Places(path, records_dir or path.parent))
        _finish(path, clock())
        try:
            loss = find_loss(path, machine, records_dir, beat)
        except (OSError, sqlite3.Error) as error:
            raise StoreError(f"{path}: cannot be checked: {error}") from error
        report = None if loss is None else _salvage(path, machine, loss, records_dir, clock(), beat)
    except (OSError, sqlite3.Error) as error:
        raise StoreError(f"{path}: is damaged, and what is left cannot be saved: {error}") from error
    return Store.open(path, machine=machine), report


def _salvage(path: Path, machine: str, loss: Loss, records_dir: Path | None, now: float, beat: Beat) -> SalvageReport:
    """Make a new store, replace the lost one by it, and log the report."""
    _LOG.error("%s: %s; making it again of what is left", path, loss.reason)
    make_folder(path.parent)
    with exclusive(path, StoreError(f"{path}: {loss.reason}, and another process is writing to it")):
        fresh = path.with_name(f"{path.name}.salvaging")
        remove_database(fresh)
        aside = _free_name(path, now)
        report = _fill(path, fresh, machine, loss, records_dir, beat)
        if path.exists() or path.with_name(f"{path.name}-wal").exists():
            report.aside = aside
        with EventLog(fresh) as events:
            events.notice(now, report.notice())
        _close_for_good(fresh)
        fresh.with_name(f"{fresh.name}.lock").unlink(missing_ok=True)
        fresh.replace(path.with_name(f"{path.name}.salvaged"))
        _swap(path, aside)
    _LOG.error("%s", report.text)
    return report


def _fill(path: Path, fresh: Path, machine: str, loss: Loss, records_dir: Path | None, beat: Beat) -> SalvageReport:
    """Make the new store and fill it."""

    def still_there() -> bool:
        beat()
        # True would interrupt the statement.
        return False

    with Store.open(fresh, machine=machine) as store, StoreLedger(store), EventLog(fresh), Deliveries(fresh):
        pass
    scratch = path.with_name(f"{path.name}.published")
    try:
        gathered = gather(loss.files, machine, scratch, beat)
        with closing(opened(fresh)) as connection:
            # After a power cut the recovery is repeated: the damaged store is still in its place.
            connection.execute("PRAGMA synchronous = OFF")
            connection.set_progress_handler(still_there, _BEAT_EVERY)
            connection.execute("ATTACH ? AS published", (str(scratch),))
            states = carry_over(path, connection)
            nothing_read = not connection.execute("SELECT 1 FROM blocks LIMIT 1").fetchone()
            account = settle(connection, states, None if records_dir is None else read_snapshot(records_dir, machine))
            for file, (rows, _) in gathered.rows.items():
                _note_published(connection, machine, file, rows)
            # The progress of files may be lost: blocks up to here may be offered again.
            connection.execute(f"INSERT INTO meta SELECT '{SALVAGED_UP_TO}', coalesce(max(id), 0) FROM blocks")
    finally:
        remove_database(scratch)
    return SalvageReport(
        **vars(account),
        reason=loss.reason,
        unreadable=gathered.unreadable,
        remarks=tuple(_remarks(gathered, machine, records_dir, nothing_read=nothing_read and path.exists())),
    )


def _note_published(connection: sqlite3.Connection, machine: str, file: Path, rows: int) -> None:
    """Note a file that has all blocks of its day: it is not written again before the day changes."""
    label = file.stem.removeprefix(f"{machine}-")
    day = None
    if label != "undated":
        day = (datetime.strptime(label, "%Y%m%d").replace(tzinfo=UTC) - datetime.fromtimestamp(0, UTC)).days
    blocks, last = connection.execute("SELECT count(*), max(id) FROM blocks WHERE day IS ?", (day,)).fetchone()
    if last is not None and blocks + condensed_on(connection, day) == rows:
        values = (file.name, day, last, file.stat().st_size)
        connection.execute("INSERT OR REPLACE INTO published VALUES (?, ?, ?, ?)", values)


def _remarks(gathered: Gathered, machine: str, records_dir: Path | None, *, nothing_read: bool) -> Iterator[str]:
    if nothing_read:
        yield "no record in the old store can be read, so that what is lost with it is not known"
    if gathered.damaged:
        yield f"{gathered.damaged} published rows are not as they were committed"
    with suppress(MovedDaysError):
        read = {file.name for file in gathered.rows}
        moved = [] if records_dir is None else moved_days(records_dir, machine)
        absent = absence_text([entry for entry in moved if entry.file not in read])
        if absent:
            yield f"{absent}; they were not read"


def _close_for_good(fresh: Path) -> None:
    """Move the write-ahead log into the database, and make it durable."""
    with closing(opened(fresh)) as connection:
        connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    sync_file(fresh)


def _free_name(path: Path, now: float) -> Path:
    """Return the name under which the damaged database is kept."""
    name = f"{path.name}.corrupt-{stamp_of(now)}"
    return path.with_name(free_name(name, lambda found: path.with_name(found).exists()))


def _finish(path: Path, now: float) -> None:
    """Complete the replacement of a store by a salvage that was killed."""
    if not path.with_name(f"{path.name}.salvaged").exists():
        return
    with exclusive(path, StoreError(f"{path}: another process is writing to it")):
        _swap(path, _free_name(path, now))


def _swap(path: Path, aside: Path) -> None:
    """Rename the damaged database and put the new one in its place; may be repeated after any interruption."""
    same = [other for other in path.parent.glob(f"{path.name}.corrupt-*") if same_file(path, other)]
    aside = same[0] if same else aside
    kept = [(path.with_name(path.name + suffix), aside.with_name(aside.name + suffix)) for suffix in ("", "-wal")]
    put_in_place(path.with_name(f"{path.name}.salvaged"), path, kept)
