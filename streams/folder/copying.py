"""Whether a folder is being copied into another: files come in any order, so that those before the others wait."""

from __future__ import annotations

Order = tuple[object, ...]

_MIN_BULK_FILES = 8
"""More waiting files than this may be a copy in progress."""
HOLD = 10.0
"""Longest wait for other files or the end of a line, in settling times."""


class CopyDetector:
    """Tells a copy in progress from a logger whose files wait because the machine is busy.

    Files that come without a pause are held back at first, and as long as some come out of order. Those of a logger
    come in order, so that one that is slow to be served is not held back on top of that.
    """

    def __init__(self, settle_s: float, now: float) -> None:
        """Begin at ``now``, s; ``settle_s`` is the settling time of a file."""
        self._settle, self._hold = settle_s, HOLD * settle_s
        self._latest = self._unordered = now
        self._polled = now
        self._highest_polled: Order | None = None
        self._highest: Order | None = None

    def note(self, order: Order, now: float) -> None:
        """Note a new file; those of one poll, which have the same ``now``, come in any order."""
        if now != self._polled:
            self._polled, self._highest_polled = now, self._highest
        before = self._highest_polled
        if now - self._latest >= self._hold or (before is not None and order < before):
            self._unordered = now
        self._latest = now
        self._highest = order if self._highest is None else max(self._highest, order)

    def forget_order(self) -> None:
        """Begin anew with a new order of the files."""
        self._highest = self._highest_polled = None

    def is_copying(self, waiting: int, seen: float, now: float) -> bool:
        """Return whether more files are about to come before the first of ``waiting`` ones, seen first at ``seen``."""
        if waiting <= _MIN_BULK_FILES or now - self._latest >= self._settle:
            return False
        return now - min(seen, self._unordered) < self._hold
