"""Backups of a machine, written while its daemon runs.

A backup is a folder ``MACHINE-YYYYMMDDTHHMMSSZ`` with ``state.db``, the published files below ``records``, the
configuration below ``config``, and ``manifest.json``: size and SHA-256 of each file and the rows of each table. It gets
this name when all of it was read back and is durable.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import closing, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from models.platform.portable import forget_cached
from models.words.errors import SpallwatchError, WrongInputError
from monitor import __version__
from monitor.records.database import APPLICATION_ID, STORE_VERSION, opened
from monitor.records.durable import (
    exclusive,
    free_bytes,
    free_name,
    make_folder,
    replacing,
    sync_file,
    sync_folder,
)
from monitor.records.filing import published_files

STORE, MANIFEST = "state.db", "manifest.json"
NOTE = "backup.json"
"""Name of the file in the state folder that tells when the last backup was made, or failed."""
FORMAT = 1
_CHUNK_BYTES = 1 << 20
_NAME = re.compile(r"(?P<machine>.+)-\d{8}T\d{6}Z(-\d+)?")


class BackupError(SpallwatchError):
    """A backup could not be written, or is not as it was written; the message names the file and the cause."""


class RefusedError(WrongInputError):
    """A backup or restore cannot be what the user means; the message says why, and what is possible."""


@dataclass(frozen=True)
class Contents:
    """What belongs to a machine: its name, its store, its published files, and further files by their name."""

    machine: str
    store: Path
    records_dir: Path
    others: Mapping[str, Path]


@dataclass(frozen=True)
class Backup:
    """A backup: its folder and its manifest."""

    folder: Path
    manifest: Mapping[str, Any]

    @property
    def files(self) -> Mapping[str, Mapping[str, Any]]:
        """Size and digest of each file, by its name below the folder."""
        return self.manifest["files"]

    @property
    def blocks(self) -> int:
        """Number of blocks in the ledger."""
        return self.manifest["rows"].get("blocks", 0)

    @property
    def size(self) -> int:
        """Bytes of all files."""
        return sum(entry["bytes"] for entry in self.files.values())


def back_up(contents: Contents, folder: Path, *, keep: int, utc: float, min_free: int = 0) -> tuple[Backup, list[str]]:
    """Write a backup of a machine below a folder and remove the oldest beyond ``keep``; return it and their names.

    Args:
        contents: of the machine; its daemon may run.
        folder: of the backups of one or several machines, made where it is missing.
        keep: number of backups of this machine that stay, the new one among them.
        utc: seconds since 1970.
        min_free: bytes that stay free on the disk of the store, where the backups are on it.

    Raises:
        RefusedError: there is no store, or another backup of this machine is being written to the folder.
        BackupError: it cannot be written or is not what was written; earlier backups are unchanged.
    """
    if not contents.store.is_file():
        raise RefusedError(f"{contents.store}: no such file; there is nothing to back up before the daemon has run")
    busy = RefusedError(f"{folder}: another backup of machine {contents.machine!r} is being written")
    try:
        make_folder(folder)
        with exclusive(folder / contents.machine, busy):
            left = [path for path in folder.glob(".*.partial") if _is_of(contents.machine, path.stem[1:])]
            if left:
                sync_folder(folder)
            for path in left:
                shutil.rmtree(path)
            earlier = backups_of(folder, contents.machine)
            before = _read_manifest(earlier[-1]) if earlier else None
            _refuse_full_disk(contents, folder, min_free, before)
            backup = _write(contents, folder, utc, before)
            return backup, _prune(folder, contents.machine, keep, backup.folder.name)
    except (OSError, sqlite3.Error) as error:
        raise BackupError(f"{folder}: no backup can be written: {error}; earlier ones are unchanged") from error


def backups_of(folder: Path, machine: str) -> list[Path]:
    """Return the backups of a machine below a folder, the oldest first."""
    found = folder.glob(f"{machine}-*")
    return sorted(path for path in found if _is_of(machine, path.name) and (path / MANIFEST).is_file())


def _is_of(machine: str, name: str) -> bool:
    """Return whether a name is that of a backup of a machine: another one's may begin alike."""
    match = _NAME.fullmatch(name)
    return match is not None and match["machine"] == machine


def find_backup(folder: Path, machine: str) -> Path:
    """Return the newest backup of a machine below a folder, or the folder itself where it is one.

    Raises:
        RefusedError: there is none.
    """
    if (folder / MANIFEST).is_file():
        return folder
    found = backups_of(folder, machine)
    if not found:
        raise RefusedError(f"{folder}: expected a backup of machine {machine!r} or a folder of them; it holds none")
    return found[-1]


def verify(folder: Path) -> Backup:
    """Read a whole backup and compare it with its manifest.

    Raises:
        BackupError: a file is missing or not as it was written, or the store in it is damaged.
    """
    try:
        manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
        backup = Backup(folder, manifest)
        known = manifest["format"] == FORMAT and manifest["machine"] and STORE in backup.files
    except (OSError, ValueError, LookupError, TypeError) as error:
        raise BackupError(f"{folder / MANIFEST}: cannot be read: {type(error).__name__}: {error}") from error
    if not known:
        raise BackupError(f"{folder / MANIFEST}: expected a manifest of format {FORMAT}, got {manifest['format']!r}")
    for name, entry in backup.files.items():
        try:
            digest, size = _digest(folder / name)
        except OSError as error:
            raise BackupError(f"{folder / name}: cannot be read: {error.strerror or error}") from error
        if (digest, size) != (entry["sha256"], entry["bytes"]):
            raise BackupError(
                f"{folder / name}: is not as it was written: expected {entry['bytes']} bytes with SHA-256 "
                f"{entry['sha256'][:16]}..., found {size} with {digest[:16]}..."
            )
    check_store(folder / STORE, manifest["rows"])
    return backup


def check_store(path: Path, rows: Mapping[str, int]) -> None:
    """Check a copied store, which nothing else has open, as a whole; ``rows`` are those of each table.

    Raises:
        BackupError: it is damaged, of another program or a newer version, or has other rows.
    """
    try:
        with closing(opened(path, "ro&immutable=1")) as connection:
            problem = connection.execute("PRAGMA quick_check(1)").fetchone()[0]
            if problem != "ok":
                raise BackupError(f"{path}: is damaged: {' '.join(problem.split())}")
            version = connection.execute("SELECT value FROM meta WHERE key = 'schema_version'").fetchone()[0]
            ours = connection.execute("PRAGMA application_id").fetchone()[0] == APPLICATION_ID
            found = _rows(connection)
    except (sqlite3.Error, TypeError) as error:
        raise BackupError(f"{path}: is damaged: {error}") from error
    if not ours or int(version) > STORE_VERSION:
        raise BackupError(f"{path}: has schema version {version}; this program knows versions up to {STORE_VERSION}")
    for table in sorted(rows.keys() | found.keys()):
        if rows.get(table) != found.get(table):
            raise BackupError(f"{path}: table {table}: expected {rows.get(table)} rows, found {found.get(table)}")


def note_backup(state_dir: Path, values: Mapping[str, Any]) -> None:
    """Note the result of a backup for the status of its machine; may raise OSError."""
    with replacing(state_dir / NOTE) as temporary:
        temporary.write_text(json.dumps(values, allow_nan=False), encoding="utf-8")


def read_note(state_dir: Path) -> dict[str, Any]:
    """Return what was noted last, {} where nothing was or it cannot be read."""
    try:
        found = json.loads((state_dir / NOTE).read_text(encoding="utf-8"))
        if found.get("utc") is not None:
            datetime.fromisoformat(found["utc"])
    except (OSError, ValueError, TypeError, AttributeError):
        return {}
    return found


def stamp_of(utc: float) -> str:
    """Return a moment as it stands in names."""
    return datetime.fromtimestamp(utc, UTC).strftime("%Y%m%dT%H%M%SZ")


def copy_durably(source: Path, target: Path) -> dict[str, Any]:
    """Copy a file; return the size, digest and time of what was read."""
    digest = hashlib.sha256()
    target.parent.mkdir(parents=True, exist_ok=True)
    with source.open("rb") as read, target.open("wb") as written:
        while part := read.read(_CHUNK_BYTES):
            digest.update(part)
            written.write(part)
        found = os.fstat(read.fileno())
        size = written.tell()
    _settle(target)
    return {"bytes": size, "sha256": digest.hexdigest(), "mtime_ns": found.st_mtime_ns}


def _write(contents: Contents, folder: Path, utc: float, before: Backup | None) -> Backup:
    stamp = f"{contents.machine}-{stamp_of(utc)}"
    name = free_name(stamp, lambda found: (folder / found).exists())
    partial = folder / f".{name}.partial"
    try:
        partial.mkdir()
        rows, meta = _copy_store(contents.store, partial / STORE)
        digest, size = _digest(partial / STORE)
        files = {STORE: {"bytes": size, "sha256": digest}}
        for file, source in _files(contents):
            # Files of days may be removed or renamed while they are copied.
            with suppress(FileNotFoundError):
                files[file] = _link_or_copy(source, partial, file, before)
        manifest = {
            "format": FORMAT,
            "machine": contents.machine,
            "created_utc": datetime.fromtimestamp(utc, UTC).isoformat(timespec="seconds").replace("+00:00", "Z"),
            "software_version": __version__,
            "config_hash": meta.get("config_hash"),
            "schema_version": meta.get("schema_version"),
            "rows": rows,
            "files": files,
        }
        (partial / MANIFEST).write_text(json.dumps(manifest, indent=1, allow_nan=False), encoding="utf-8")
        _settle(partial / MANIFEST)
        for place in (path for path in sorted(partial.rglob("*")) if path.is_dir()):
            sync_folder(place)
        sync_folder(partial)
        verify(partial)
        partial.rename(folder / name)
        sync_folder(folder)
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    return Backup(folder / name, manifest)


def _files(contents: Contents) -> Iterator[tuple[str, Path]]:
    """Yield the name in the backup and the path of each file but the store."""
    for path in published_files(contents.records_dir, contents.machine):
        yield f"records/{path.name}", path
    yield from contents.others.items()


def _copy_store(source: Path, target: Path) -> tuple[dict[str, int], dict[str, str]]:
    """Copy a store that may be written to meanwhile; return the rows of each table and the table ``meta``."""
    with closing(opened(source, "ro", timeout=30.0)) as read, closing(opened(target)) as written:
        # Rows are counted in the state that is copied; the writer goes on in its log.
        read.execute("BEGIN")
        rows, meta = _rows(read), dict(read.execute("SELECT key, value FROM meta"))
        # One step: a copy in several begins anew with each commit of the writer.
        read.backup(written)
        read.execute("ROLLBACK")
        # The copy needs no other files beside it.
        written.execute("PRAGMA journal_mode = DELETE")
    _settle(target)
    return rows, meta


def _rows(connection: sqlite3.Connection) -> dict[str, int]:
    query = "SELECT name FROM sqlite_master WHERE type = 'table' AND name NOT LIKE 'sqlite_%' ORDER BY name"
    tables = [name for (name,) in connection.execute(query)]
    return {name: connection.execute(f'SELECT count(*) FROM "{name}"').fetchone()[0] for name in tables}


def _link_or_copy(source: Path, partial: Path, name: str, before: Backup | None) -> dict[str, Any]:
    """Copy a file, or give that of the earlier backup a second name where it has not changed since."""
    target = partial / name
    known = None if before is None else before.files.get(name)
    if before is not None and known is not None and _is_unchanged(source, known):
        target.parent.mkdir(parents=True, exist_ok=True)
        with suppress(OSError):
            os.link(before.folder / name, target)
            if _digest(target) == (known["sha256"], known["bytes"]):
                return dict(known)
        target.unlink(missing_ok=True)
    return copy_durably(source, target)


def _read_manifest(folder: Path) -> Backup | None:
    try:
        backup = Backup(folder, json.loads((folder / MANIFEST).read_text(encoding="utf-8")))
        return backup if backup.manifest["format"] == FORMAT else None
    except (OSError, ValueError, LookupError, TypeError):
        return None


def _digest(path: Path) -> tuple[str, int]:
    """Return the SHA-256 and the size of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest(), file.tell()


def _settle(path: Path) -> None:
    """Make a file durable, and have what is read next come from the disk."""
    sync_file(path)
    with path.open("rb") as file:
        forget_cached(file.fileno())


def _is_unchanged(source: Path, known: Mapping[str, Any]) -> bool:
    """Return whether a file has the size and time that an earlier backup noted; FileNotFoundError where it is gone."""
    found = source.stat()
    return (found.st_size, found.st_mtime_ns) == (known.get("bytes"), known.get("mtime_ns"))


def _refuse_full_disk(contents: Contents, folder: Path, min_free: int, before: Backup | None) -> None:
    """Refuse a backup for which there is no room, so that it does not stop the daemon."""
    needed = sum(path.stat().st_size for path in _parts(contents.store))
    for name, path in _files(contents):
        known = {} if before is None else before.files.get(name, {})
        with suppress(FileNotFoundError):
            needed += 0 if _is_unchanged(path, known) else path.stat().st_size
    kept = min_free if folder.stat().st_dev == contents.store.stat().st_dev else 0
    free = free_bytes(folder)
    if free < needed + kept:
        also = f" and {kept / 1e6:.0f} MB for the daemon" if kept else ""
        raise BackupError(
            f"{folder}: the disk is too full for a backup: {free / 1e6:.0f} MB are free, {needed / 1e6:.1f} MB{also} "
            "are needed; give a folder on another disk, or a smaller --keep"
        )


def _parts(store: Path) -> list[Path]:
    return [path for path in (store, store.with_name(f"{store.name}-wal")) if path.exists()]


def _prune(folder: Path, machine: str, keep: int, newest: str) -> list[str]:
    """Remove the oldest backups of a machine beyond ``keep``, never the newest; return their names."""
    others = [path for path in backups_of(folder, machine) if path.name != newest]
    removed = []
    for path in others[: max(0, len(others) + 1 - keep)]:
        # Killed halfway, no part of a backup has the name of a whole one. What stays is removed with the next backup.
        going = path.with_name(f".{path.name}.partial")
        with suppress(OSError):
            path.rename(going)
            # A power cut must not bring the name back without the files.
            sync_folder(folder)
            removed.append(path.name)
            shutil.rmtree(going)
    return removed
