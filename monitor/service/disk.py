"""Free space on the disk of the store."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

_EVERY = 5.0
_ENOUGH = 1.25


def free_bytes(folder: Path) -> int:
    """Return the bytes that a file system has left for users other than root.

    Raises:
        OSError: the folder cannot be reached.
    """
    found = os.statvfs(folder)
    return found.f_bavail * found.f_frsize


class DiskGuard:
    """Detects a file system that is too full to go on, with hysteresis."""

    def __init__(self, folder: Path, free: Callable[[Path], int], least: int) -> None:
        """Keep the settings.

        Args:
            folder: any folder of the file system.
            free: returns its free bytes.
            least: bytes below which it counts as full, until a quarter more is free.
        """
        self._folder, self._free, self._least = folder, free, least
        self._due = float("-inf")
        self.problem: str | None = None
        """Why nothing may be written, in one sentence, or None."""

    def check(self, now: float) -> bool:
        """Check the file system every five seconds; return whether there is room.

        Args:
            now: seconds of a monotonic clock.
        """
        if now >= self._due:
            self._due = now + _EVERY
            self.problem = self._poll()
        return self.problem is None

    def _poll(self) -> str | None:
        try:
            free = self._free(self._folder)
        except OSError as error:
            return f"{self._folder}: cannot be looked at ({error.strerror or error})"
        least = self._least if self.problem is None else self._least * _ENOUGH
        if free >= least:
            return None
        return f"{self._folder}: the disk is nearly full, {free / 1e6:.0f} MB are free, {least / 1e6:.0f} MB are needed"
