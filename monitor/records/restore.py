"""Put a backup in the place of the state of a machine: killed at any moment, the old or the whole new state is there.

The store and the files are made beside their places and verified. The restore is decided by one rename, to
``state.db.restored``; what comes after it is repeated by the next start of a daemon.
"""

from __future__ import annotations

import shutil
import sqlite3
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from monitor.records.backup import STORE, Backup, BackupError, RefusedError, check_store, copy_durably, stamp_of, verify
from monitor.records.database import StoreError, opened
from monitor.records.durable import (
    exclusive,
    free_name,
    link_durably,
    make_folder,
    put_in_place,
    sync_file,
    sync_folder,
)
from monitor.records.events import EventLog

_KEY = "restored"
"""Key in the table ``meta`` of the stamp of the restore that made the store."""


@dataclass(frozen=True)
class Places:
    """Where the state of a machine is: its store, and the folder of its published files."""

    store: Path
    records_dir: Path

    @property
    def partial(self) -> Path:
        """The new store until it is verified."""
        return self.store.with_name(f"{self.store.name}.restoring")

    @property
    def decided(self) -> Path:
        """The new store once the restore is decided."""
        return self.store.with_name(f"{self.store.name}.restored")

    def staged(self, stamp: str) -> Path:
        """Return the folder of the published files until they are put in place; on the same disk as they."""
        return self.records_dir / f".restoring-{stamp}"


@dataclass(frozen=True)
class Restored:
    """Result of a restore: the backup, the old store that was kept (or None), and the files that were put back."""

    backup: Backup
    aside: Path | None
    files: tuple[str, ...]


def restore(folder: Path, machine: str, places: Places, *, replace: bool, utc: float) -> Restored:
    """Verify the backup in a folder and put it in place; no daemon of the machine runs.

    A published file that is there is never replaced; it may hold more than the backup.

    Args:
        folder: of one backup.
        machine: whose state it is to be.
        places: of that state.
        replace: keep a store that is there as ``state.db.before-restore-STAMP``, instead of refusing.
        utc: seconds since 1970.

    Raises:
        RefusedError: there is a store and not ``replace``, the backup is of another machine, or another process
            writes to the store.
        BackupError: the backup is damaged, or cannot be put in place; the state is unchanged.
    """
    backup = verify(folder)
    if backup.manifest["machine"] != machine:
        raise RefusedError(f"{folder}: is a backup of machine {backup.manifest['machine']!r}, not of {machine!r}")
    try:
        make_folder(places.store.parent)
        with exclusive(places.store, _busy(places.store)):
            _finish(places)
            if not replace and any(path.exists() and path.stat().st_size for path in _parts(places.store)):
                raise RefusedError(
                    f"{places.store}: there is a store already; --replace keeps it as "
                    f"{places.store.name}.before-restore-... and puts the backup in its place"
                )
            stamp = _free_stamp(places, stamp_of(utc))
            files = _put_in_place(backup, places, stamp, utc)
    except (OSError, sqlite3.Error, StoreError) as error:
        raise BackupError(f"{places.store.parent}: the backup cannot be put in place: {error}") from error
    aside = _aside(places.store, stamp)
    return Restored(backup, next((path for path in _parts(aside) if path.exists()), None), files)


def finish_restore(places: Places) -> None:
    """Complete a restore that was decided, and remove what is left of one that was not; usually nothing is.

    Raises:
        RefusedError: another process writes to the store.
        OSError, sqlite3.Error: it cannot be completed yet.
    """
    if places.decided.exists() or places.partial.exists() or any(places.records_dir.glob(".restoring-*")):
        with exclusive(places.store, _busy(places.store)):
            _finish(places)


def _put_in_place(backup: Backup, places: Places, stamp: str, utc: float) -> tuple[str, ...]:
    """Stage a backup, decide the restore and complete it; return the published files that were put back."""
    try:
        _stage(backup, places, stamp, utc)
        staged = sorted(path.name for path in places.staged(stamp).glob("*"))
        missing = tuple(name for name in staged if not (places.records_dir / name).exists())
        _fold_log(places.store)
        places.partial.rename(places.decided)
        sync_folder(places.store.parent)
        _finish(places)
    except Exception:
        with suppress(OSError, sqlite3.Error):
            _finish(places)
        raise
    return missing


def _finish(places: Places) -> None:
    for suffix in ("", "-journal", "-wal", "-shm"):
        places.partial.with_name(places.partial.name + suffix).unlink(missing_ok=True)
    if places.decided.exists():
        _swap(places)
    staged = sorted(places.records_dir.glob(".restoring-*"))
    if not staged:
        return
    stamp = _stamp_in(places.store)
    for folder in staged:
        if stamp is not None and folder == places.staged(stamp):
            for path in sorted(folder.iterdir()):
                # Unlike a rename, a link replaces nothing.
                with suppress(FileExistsError):
                    link_durably(path, places.records_dir / path.name)
            sync_folder(places.records_dir)
        shutil.rmtree(folder)


def _stage(backup: Backup, places: Places, stamp: str, utc: float) -> None:
    """Make the new store and files beside their places, verified and durable."""
    for name, entry in backup.files.items():
        path = PurePosixPath(name)
        if len(path.parts) == 2 and path.parts[0] == "records" and path.suffix == ".nc":
            copied = copy_durably(backup.folder / name, places.staged(stamp) / path.name)
            if copied["sha256"] != entry["sha256"]:
                raise BackupError(f"{backup.folder / name}: changed while it was read")
    if places.staged(stamp).exists():
        sync_folder(places.staged(stamp))
        sync_folder(places.records_dir)
    copied = copy_durably(backup.folder / STORE, places.partial)
    if copied["sha256"] != backup.files[STORE]["sha256"]:
        raise BackupError(f"{backup.folder / STORE}: changed while it was read")
    check_store(places.partial, backup.manifest["rows"])
    with closing(opened(places.partial)) as connection:
        connection.execute("INSERT OR REPLACE INTO meta VALUES (?, ?)", (_KEY, stamp))
    with EventLog(places.partial) as log:
        text = f"the state is that of the backup of {backup.manifest['created_utc']}, {backup.blocks} blocks"
        log.notice(utc, {"kind": "store_restored", "channel": None, "severity": "alert", "text": text})
    sync_file(places.partial)


def _swap(places: Places) -> None:
    """Keep the old store under another name and put the new one in its place; may be repeated."""
    aside = _aside(places.store, _stamp_in(places.decided) or "unknown")
    # Readers leave an empty log.
    old = [path for path in _parts(places.store) if path.exists() and path.stat().st_size]
    kept = [(path, aside.with_name(aside.name + path.name.removeprefix(places.store.name))) for path in old]
    put_in_place(places.decided, places.store, kept)


def _fold_log(store: Path) -> None:
    """Move the write-ahead log of the old store into it: nothing depends on the log while the two are put aside."""
    if not (store.exists() and _log_of(store).exists()):
        return
    with suppress(sqlite3.Error):
        # What is no database is put aside with its log, which a writer would remove.
        with closing(opened(store, "ro")) as connection:
            connection.execute("SELECT count(*) FROM sqlite_master")
        with closing(opened(store)) as connection:
            connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")


def _stamp_in(store: Path) -> str | None:
    """Return the stamp of the restore that made a store, or None."""
    if not store.exists():
        return None
    try:
        with closing(opened(store, "ro")) as connection:
            found = connection.execute("SELECT value FROM meta WHERE key = ?", (_KEY,)).fetchone()
    except sqlite3.Error:
        return None
    return None if found is None else str(found[0])


def _parts(store: Path) -> list[Path]:
    return [store, _log_of(store)]


def _log_of(store: Path) -> Path:
    return store.with_name(f"{store.name}-wal")


def _aside(store: Path, stamp: str) -> Path:
    return store.with_name(f"{store.name}.before-restore-{stamp}")


def _free_stamp(places: Places, stamp: str) -> str:
    """Return a stamp that no earlier restore has used."""

    def is_taken(found: str) -> bool:
        aside = _aside(places.store, found)
        return found == _stamp_in(places.store) or aside.exists() or _log_of(aside).exists()

    return free_name(stamp, is_taken)


def _busy(store: Path) -> RefusedError:
    return RefusedError(f"{store}: another process is writing to it; stop it first")
