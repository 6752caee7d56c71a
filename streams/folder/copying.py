"""What a file waits for: a folder that is being copied in any order, and the files that are read with it."""

from __future__ import annotations

from collections.abc import Mapping

from streams.files.groups import FilesBeside
from streams.types.listing import Stat


class Awaited:
    """The files of one folder that are read with others: pulses and channels; since when they have not changed.

    A file waits for those that belong to it as long as others wait for it, and so keeps their order; then it is read
    without pulses, and rejected without a channel.
    """

    def __init__(self, beside: FilesBeside, settle_s: float) -> None:
        """Take the files that are read with others; ``settle_s`` is the settling time."""
        self._beside, self._settle = beside, settle_s
        self._there: dict[str, tuple[Stat, float]] = {}

    def note(self, path: str, stat: Stat, now: float) -> None:
        """Record the status of a file, if it is read with another; ``now`` in s."""
        if self.has(path):
            known = self._there.get(path)
            if known is None or known[0] != stat:
                self._there[path] = (stat, now)

    def keep(self, listing: Mapping[str, Stat]) -> None:
        """Forget the files that are gone."""
        if self._there:
            self._there = {path: known for path, known in self._there.items() if path in listing}

    def holds(self, path: str, changed: float, now: float) -> bool:
        """Return whether a file that last changed at ``changed``, s, waits for one that is read with it."""
        beside = self._beside.awaited(path)
        if not beside or now - changed >= HOLD * self._settle:
            return False
        found = [self._there.get(other) for other in beside]
        return any(known is None or known[0].size == 0 or now - known[1] < self._settle for known in found)

    def has(self, path: str) -> bool:
        """Return whether a file is read with another."""
        return self._beside.has(path)


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
