"""Folders of results: one writer each, workers that see the same, and results that appear there whole."""

from __future__ import annotations

import glob
import hashlib
import os
import re
import secrets
import shutil
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import click

from models.platform.portable import FileLock, may_write
from models.platform.process_signals import ended_as_interrupted
from models.platform.scratch import scratch_folder
from models.words.errors import WrongInputError
from models.work.chunk import default_worker
from models.work.errors import error_of
from models.work.task import Failure
from monitor.commands.common import InputError, output_errors
from monitor.config.load import Config, ConfigError, files_of

_NOT_A_NAME = re.compile(r"[^\w.+-]+")
_MARK = ".spallwatch-"
_OLD = ".old"


class SharedFolderError(WrongInputError):
    """A worker does not see a folder as the caller does; the message names both."""


@dataclass(frozen=True)
class Seen:
    """Files of a recording as the caller sees them: their number, and their size in bytes."""

    files: int
    size: int


def folder_names(texts: Iterable[str], otherwise: str) -> Iterator[str]:
    """Yield a name of a folder for each text, ``otherwise`` where nothing is left of it.

    Of names that differ in case at most, the second and later ones get a number.
    """
    numbers: dict[str, int] = {}
    for text in texts:
        name = _NOT_A_NAME.sub("_", text).strip("._") or otherwise
        numbers[name.lower()] = number = numbers.get(name.lower(), 0) + 1
        yield name if number == 1 else f"{name}-{number}"


def files_below(path: Path) -> list[Path]:
    """Return a file, or all files below a folder."""
    return [path] if path.is_file() else sorted(item for item in path.rglob("*") if item.is_file())


def record_files(path: Path) -> list[Path]:
    """Return the records in a file or folder, else all files, without empty write-ahead logs, which readers create."""
    found = [path, *path.parent.glob(f"{glob.escape(path.name)}-wal")] if path.is_file() else files_below(path)
    records = [item for item in found if item.suffix in (".db", ".nc", ".db-wal")]
    return [item for item in records or found if item.suffix != ".db-wal" or item.stat().st_size > 0]


def seen(files: Iterable[Path]) -> Seen:
    """Return what is seen of files."""
    sizes = [item.stat().st_size for item in files]
    return Seen(len(sizes), sum(sizes))


def input_digest(settings: tuple[object, ...], read: Iterable[Path | None], listed: Iterable[Path]) -> str:
    """Return a digest of what a result depends on, by which one that is there is kept or made anew.

    Args:
        settings: whose representation is the same in each process.
        read: files whose content counts, None for one that there is not.
        listed: files whose path, size and time of change count: they are too large to be read again.
    """
    digest = hashlib.sha256(repr(settings).encode())
    for path in read:
        digest.update(b"-" if path is None else path.read_bytes())
    for path in listed:
        found = path.stat()
        digest.update(repr((str(path), found.st_size, found.st_mtime_ns)).encode())
    return digest.hexdigest()


def config_digest(path: Path, config: Config) -> str:
    """Return a digest of a configuration and of the files that it names; ``config`` is what was loaded of ``path``.

    Raises:
        ConfigError: one of them cannot be read.
    """
    try:
        return input_digest((), [path, *files_of(config)], [])
    except OSError as error:
        raise ConfigError(f"{path}: names {error.filename}, which cannot be read: {error.strerror}") from None


def check_config(path: Path, config: Config, expected: str) -> None:
    """Compare a configuration with the digest of what the caller has loaded.

    Raises:
        SharedFolderError: it is another one, or has changed meanwhile.
    """
    if config_digest(path, config) != expected:
        raise SharedFolderError(
            f"{path}: worker {default_worker()} sees another configuration, or other maps or libraries, than the "
            "command began with"
        )


def check_seen(path: Path, files: Iterable[Path], expected: Seen | None) -> None:
    """Compare the files of a recording with what the caller sees of them; None compares nothing.

    Raises:
        SharedFolderError: it is not there, or it is another one.
    """
    if expected is None:
        return
    if not path.exists():
        raise SharedFolderError(f"{path}: is not there on worker {default_worker()}; all workers must see it")
    found = seen(files)
    if found != expected:
        raise SharedFolderError(
            f"{path}: expected {expected.files} files of {expected.size} bytes as the caller sees, worker "
            f"{default_worker()} sees {found.files} of {found.size}; it is another folder there, or is being written"
        )


@contextmanager
def marked(folder: Path, *, checked: bool) -> Iterator[str]:
    """Put a mark into a folder for :func:`check_mark`, and give its name; "" where it is not ``checked``."""
    if not checked:
        yield ""
        return
    mark = folder / f"{_MARK}{secrets.token_hex(8)}"
    mark.write_bytes(b"")
    try:
        yield mark.name
    finally:
        mark.unlink(missing_ok=True)


def check_mark(folder: Path, mark: str) -> None:
    """Look for the mark of the caller in a folder; "" looks for none.

    Raises:
        SharedFolderError: it is not there.
    """
    if mark and not (folder / mark).is_file():
        raise SharedFolderError(
            f"--out {folder}: worker {default_worker()} does not see this folder of the caller; all workers must "
            "reach it under the same path"
        )


def raise_if_unseen(failure: Failure) -> None:
    """Raise the failure of a task as a SharedFolderError if it is one: each further task would meet it, too."""
    if failure.kind == f"{SharedFolderError.__module__}:{SharedFolderError.__qualname__}":
        raise error_of(failure)


@contextmanager
def replaced(place: Path) -> Iterator[Path]:
    """Give a folder of this machine for a store; without an exception its content becomes ``place`` in one step.

    So ``place`` is whole where it is there, also where workers are lost, or two of them do the same. An earlier store
    in ``place`` is deleted. A database is not written over a network.

    Raises:
        InputError: ``place`` holds files and no store, or cannot be written.
    """
    _refuse_foreign(place)
    with scratch_folder("spallwatch-run-") as scratch:
        work = scratch / place.name
        work.mkdir()
        yield work
        fresh = place.with_name(f".{place.name}.{secrets.token_hex(4)}")
        old = fresh.with_name(fresh.name + _OLD)
        place.parent.mkdir(parents=True, exist_ok=True)
        try:
            shutil.copytree(work, fresh, copy_function=_copy)
            with suppress(FileNotFoundError):
                place.rename(old)
            try:
                fresh.rename(place)
            except OSError:
                # Another worker that did the same was first.
                if not place.is_dir():
                    raise
        finally:
            shutil.rmtree(fresh, ignore_errors=True)
        shutil.rmtree(old, ignore_errors=True)


def _copy(source: str, target: str) -> None:
    try:
        shutil.copy2(source, target)
    except OSError as error:
        raise InputError(f"{target}: cannot be written: {error.strerror or error}") from None


def _refuse_foreign(place: Path) -> None:
    if place.is_symlink() or (place.exists() and not place.is_dir()):
        raise InputError(f"{place}: expected a folder, or nothing yet")
    if place.is_dir() and not (place / "state.db").is_file() and any(place.iterdir()):
        raise InputError(f"{place}: holds files and no state.db; use another --out")


def remove_leftovers(out: Path, names: Iterable[str]) -> None:
    """Remove what :func:`replaced` left in ``out`` where a worker was killed; put back what was there before."""
    for name in names:
        # Nothing else is removed that is named alike.
        ours = re.compile(rf"\.{re.escape(name)}\.[0-9a-f]{{8}}({re.escape(_OLD)})?")
        for leftover in sorted(path for path in out.glob(f".{name}.*") if ours.fullmatch(path.name)):
            if leftover.name.endswith(_OLD) and not (out / name).exists():
                leftover.rename(out / name)
            else:
                shutil.rmtree(leftover, ignore_errors=True)


_WAIT_S = 0.5
"""Time in which a process that was being started when its parent was killed lets go of the lock."""
_POLL_S = 0.02


@contextmanager
def sole_writer(out: Path) -> Iterator[None]:
    """Hold the lock of an output file or folder, ``.NAME.lock`` beside it, while the block runs.

    Of a link the lock is that of what it leads to. The system releases it when the process ends. Where the file system
    has no locks, none is held; nor for a folder in one that may not be written, such as what is mounted at the root of
    a container.

    Raises:
        InputError: another process holds it, or nothing can be written there.
    """
    named, place = out.absolute(), Path(os.path.realpath(out))
    path = place.with_name(f".{place.name or 'root'}.lock")
    with output_errors("--out", out):
        place.parent.mkdir(parents=True, exist_ok=True)
        free = place.is_dir() and not may_write(place.parent)
        lock = None if free else _held(path)
    if free:
        yield
        return
    if lock is None:
        raise InputError(f"--out {out}: another process is writing it")
    try:
        # They are written beside the name that was given.
        for part in named.parent.glob(f".{glob.escape(named.name)}.*.part") if named.name else ():
            part.unlink(missing_ok=True)
        yield
    finally:
        # Its name goes before the lock: one who opened it sees that it is no longer there.
        with suppress(OSError):
            path.unlink()
        lock.close()


def hold_output(out: Path) -> None:
    """Hold an output as :func:`sole_writer` until the command that is running ends; SIGTERM ends it as Ctrl-C does."""
    context = click.get_current_context()
    context.with_resource(ended_as_interrupted())
    context.with_resource(sole_writer(out))


def _held(path: Path) -> FileLock | None:
    """Return the lock at a path, None where another process holds it."""
    until = time.monotonic() + _WAIT_S
    while True:
        lock = FileLock(path)
        try:
            if lock.take() and lock.is_at(path):
                return lock
        except OSError:
            # There are no locks here.
            return lock
        lock.close()
        if time.monotonic() >= until:
            return None
        time.sleep(_POLL_S)
