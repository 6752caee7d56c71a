"""Folders for what is fetched, removed after use; those of killed processes are removed by the next one."""

from __future__ import annotations

import secrets
import shutil
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path

from models.portable import FileLock

_PREFIX = "fetched-"
_FREE_SHARE = 0.9
"""Share of the free space of a disk that may be used where no limit is given."""


@contextmanager
def scratch_folder(parent: Path) -> Generator[Path]:
    """Make a folder in ``parent`` and remove it at the end; OSError where that cannot be.

    A lock beside it tells whether its process is alive.
    """
    parent.mkdir(parents=True, exist_ok=True)
    _sweep(parent)
    while True:
        folder = parent / f"{_PREFIX}{secrets.token_hex(8)}"
        beside = _lock_of(folder)
        lock = FileLock(beside)
        if lock.take():
            break
        # Another process sweeps and has met it first.
        lock.close()
    try:
        folder.mkdir()
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        lock.close()
        beside.unlink(missing_ok=True)


def free_bytes(folder: Path) -> int:
    """Return how many bytes may be fetched into a folder, which need not be there yet."""
    place = folder.absolute()
    while not place.exists():
        place = place.parent
    return int(_FREE_SHARE * shutil.disk_usage(place).free)


def _lock_of(folder: Path) -> Path:
    return folder.with_name(f"{folder.name}.lock")


def _sweep(parent: Path) -> None:
    """Remove the folders whose processes were killed."""
    for beside in parent.glob(f"{_PREFIX}*.lock"):
        # Another process may sweep too, or end.
        with suppress(OSError):
            lock = FileLock(beside, read_only=True)
            try:
                if lock.take():
                    shutil.rmtree(beside.with_suffix(""), ignore_errors=True)
                    beside.unlink(missing_ok=True)
            finally:
                lock.close()
