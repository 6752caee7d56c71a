"""Whether there is room left on the disk for the store to grow."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

_EVERY = 5.0
_ENOUGH = 1.25


def free_bytes(folder: Path) -> int:
    """Return how many bytes a file system has left for whoever is not root.

    Raises:
        OSError: the folder cannot be looked at.
    """
    found = os.statvfs(folder)
    return found.f_bavail * found.f_frsize


class DiskGuard:
    """Says when a file system is too full to go on, and when it is no longer."""

    def __init__(self, folder: Path, free: Callable[[Path], int], least: int) -> None:
        """Take the folder.

        Args:
            folder: any folder of the file system.
            free: gives its free bytes.
            least: bytes below which it counts as full, until a quarter more is free.
        """
        self._folder, self._free, self._least = folder, free, least
        self._due = float("-inf")
        self.problem: str | None = None
        """Why nothing may be written, in one sentence, or None."""

    def check(self, now: float) -> bool:
        """Look at the file system every five seconds, and return whether there is room.

        Args:
            now: seconds of a monotonic clock.
        """
        if now >= self._due:
            self._due = now + _EVERY
            self.problem = self._look()
        return self.problem is None

    def _look(self) -> str | None:
        try:
            free = self._free(self._folder)
        except OSError as error:
            return f"{self._folder}: cannot be looked at ({error.strerror or error})"
        least = self._least if self.problem is None else self._least * _ENOUGH
        if free >= least:
            return None
        return f"{self._folder}: the disk is nearly full, {free / 1e6:.0f} MB are free, {least / 1e6:.0f} MB are needed"
