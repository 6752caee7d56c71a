"""One command at a time writes an output: a second one is refused, and what a killed one left half written removed."""

from __future__ import annotations

import glob
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import click

from models.platform.portable import FileLock, may_write
from models.platform.process_signals import ended_as_interrupted
from monitor.commands.common import InputError, output_errors

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
