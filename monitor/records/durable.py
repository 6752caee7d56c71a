"""Files that survive a power cut, locks beside them, and how one database takes the place of another."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from models.platform.portable import FileLock, sync_file, sync_folder

_LOCK_WAIT_S, _LOCK_POLL_S = 2.0, 0.05


def take_lock(path: Path) -> FileLock | None:
    """Take the lock beside a file; return it, or None where another process holds it.

    The kernel releases it when the process ends. A child that was being started when the process was killed holds it
    until it has become another program, which is waited for. OSError where the lock file cannot be made.
    """
    lock = FileLock(path.with_name(f"{path.name}.lock"))
    until = time.monotonic() + _LOCK_WAIT_S
    while True:
        with suppress(OSError):
            if lock.take():
                return lock
        if time.monotonic() >= until:
            lock.close()
            return None
        time.sleep(_LOCK_POLL_S)


@contextmanager
def exclusive(path: Path, refusal: Exception) -> Iterator[None]:
    """Hold the lock beside a file, as :func:`take_lock` takes it; raise ``refusal`` where another process holds it."""
    lock = take_lock(path)
    if lock is None:
        raise refusal
    try:
        yield
    finally:
        lock.close()


def make_folder(folder: Path, mode: int = 0o777) -> None:
    """Make a folder with a mode, and those above it, where they are missing; OSError where that fails.

    The names are durable: without that, a power cut takes the folder with all that was made durable in it.
    """
    missing = [place for place in (folder, *folder.parents) if not place.exists()]
    folder.mkdir(mode, parents=True, exist_ok=True)
    for place in reversed(missing):
        # A folder that may be written to but not listed cannot be opened.
        with suppress(PermissionError):
            sync_folder(place.parent)


def free_name(name: str, is_taken: Callable[[str], bool]) -> str:
    """Return a name, or the first of NAME-2, NAME-3, ... that is not taken."""
    number, found = 1, name
    while is_taken(found):
        number += 1
        found = f"{name}-{number}"
    return found


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Hold a lock file, which is made where it is not there; another process that holds it is waited for."""
    lock = FileLock(path)
    try:
        lock.wait()
        yield
    finally:
        lock.close()


def free_bytes(folder: Path) -> int:
    """Return the bytes that are free for users other than root; OSError where the folder cannot be reached."""
    return shutil.disk_usage(folder).free


@contextmanager
def replacing(target: Path, label: str = "") -> Iterator[Path]:
    """Lend a path for the new content of a file: readers see the old one or the new one, never a part.

    The replacement is durable; after an exception the old file stays. Two that write at once need labels.
    """
    temporary = target.with_name(f".{target.name}{label}.tmp")
    try:
        yield temporary
        sync_file(temporary)
        temporary.replace(target)
    except BaseException:
        with suppress(OSError):
            temporary.unlink()
        raise
    sync_folder(target.parent)


def link_durably(source: Path, target: Path) -> None:
    """Give a file a second name, or copy it where the file system has no links; a missing file is ignored.

    The name is that of a whole file at any moment. FileExistsError where it is taken.
    """
    try:
        os.link(source, target)
    except FileExistsError:
        raise
    except FileNotFoundError:
        return
    except OSError:
        if target.exists():
            raise FileExistsError(target) from None
        with suppress(FileNotFoundError), replacing(target) as temporary:
            shutil.copy2(source, temporary)
        return
    sync_folder(target.parent)


def put_in_place(fresh: Path, store: Path, kept: Iterable[tuple[Path, Path]]) -> None:
    """Replace a database by a whole one; may be repeated after any interruption.

    Args:
        fresh: the new database, without a log.
        store: the place of the old one.
        kept: files of the old one that stay, each with its second name; what is missing, or kept already, is left.
    """
    for source, target in kept:
        if source.exists() and not target.exists():
            link_durably(source, target)
    sync_folder(store.parent)
    # SQLite would apply a remaining log to the new database.
    for suffix in ("-wal", "-shm"):
        store.with_name(store.name + suffix).unlink(missing_ok=True)
    sync_folder(store.parent)
    fresh.replace(store)
    sync_folder(store.parent)


def same_file(path: Path, other: Path) -> bool:
    """Return whether two names are of one file; False where one does not exist."""
    try:
        return path.samefile(other)
    except OSError:
        return False
