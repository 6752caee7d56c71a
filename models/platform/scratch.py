"""Folders for a while, removed after use; those of killed processes are removed by the next one."""

from __future__ import annotations

import re
import secrets
import shutil
import tempfile
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path

from models.platform.portable import FileLock

_FREE_SHARE = 0.9
"""Share of the free space of a disk that may be used where no limit is given."""


@contextmanager
def scratch_folder(prefix: str, parent: Path | None = None) -> Generator[Path]:
    """Make a folder, by default in the temporary folder, and remove it at the end; OSError where that cannot be.

    A lock beside it tells whether its process is alive.

    Args:
        prefix: of its name; folders of killed processes with this prefix are removed.
        parent: made where it is not there.
    """
    parent = Path(tempfile.gettempdir()) if parent is None else parent
    parent.mkdir(parents=True, exist_ok=True)
    remove_abandoned(prefix, parent)
    while True:
        folder = parent / f"{prefix}{secrets.token_hex(8)}"
        beside = _lock_of(folder)
        lock = FileLock(beside)
        if _taken(lock):
            break
        # Another process sweeps and has met it first.
        lock.close()
    try:
        folder.mkdir(mode=0o700)
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        lock.close()
        beside.unlink(missing_ok=True)


def _taken(lock: FileLock) -> bool:
    """Take a lock; a file system without locks has no sweepers."""
    try:
        return lock.take()
    except OSError:
        return True


def free_bytes(folder: Path) -> int:
    """Return how many bytes may be fetched into a folder, which need not be there yet."""
    place = folder.absolute()
    while not place.exists():
        place = place.parent
    return int(_FREE_SHARE * shutil.disk_usage(place).free)


def _lock_of(folder: Path) -> Path:
    return folder.with_name(f"{folder.name}.lock")


def remove_abandoned(prefix: str, parent: Path | None = None) -> None:
    """Remove the folders of :func:`scratch_folder` whose processes were killed."""
    parent = Path(tempfile.gettempdir()) if parent is None else parent
    ours = re.compile(rf"{re.escape(prefix)}[0-9a-f]{{16}}\.lock")
    for beside in [path for path in parent.iterdir() if ours.fullmatch(path.name)]:
        # Another process may sweep too, or end.
        with suppress(OSError):
            lock = FileLock(beside, read_only=True)
            try:
                if lock.take():
                    shutil.rmtree(beside.with_suffix(""), ignore_errors=True)
                    beside.unlink(missing_ok=True)
            finally:
                lock.close()
