"""Locks between processes that the kernel lets go of when a process ends, however it ends."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path


def take_lock(path: Path) -> int | None:
    """Take the lock beside a file; return what :func:`let_go` needs, or None where another holds it.

    Raises:
        OSError: the lock file cannot be made.
    """
    descriptor = os.open(path.with_name(f"{path.name}.lock"), os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(descriptor)
        return None
    return descriptor


def let_go(descriptor: int | None) -> None:
    """Let go of a lock, if it is one."""
    if descriptor is not None:
        os.close(descriptor)
