"""The order in which sources are asked for their next block: one that keeps up is not delayed by one that is behind."""

from __future__ import annotations

import math
from collections.abc import Sequence

_PROMPT_S = 0.1
"""A source whose waiting blocks take less time than this keeps up; beyond, a source is of the next level with each
doubling."""
_UNKNOWN_S = 0.01
"""Time that a block of a source takes of which none was served yet."""
_SHARE = 0.2
"""Share of the time, at least, of the sources that are behind, while others are served before them."""
_WEIGHT = 0.25
"""Weight of the latest block in the mean time that a block of a source takes."""
_MAX_FACTOR = 4.0
"""A block counts as at most this many times the mean: one during which the disk was full says nothing of the next."""


class Turns:
    """The source whose waiting blocks take least time comes first; within a level, the one served least recently.

    Levels are doublings of that time. Sources behind others have a fifth of the time at least. Shares of turns would
    not do: a source that keeps up and needs more than an equal share of them, on a busy machine or with a block every
    50 ms, would fall behind, wait until the others are done, and so be delayed by them for as long as they take.
    """

    def __init__(self, count: int) -> None:
        """Begin with ``count`` sources of which nothing is known."""
        self._queue = list(range(count))
        self._in_succession = [0] * count
        self._block_s: list[float | None] = [None] * count
        self._levels: list[int | None] = [None] * count
        self._owed_s = 0.0

    def order(self, waiting: Sequence[float | None]) -> list[int]:
        """Return the numbers of all sources in the order in which to ask them.

        ``waiting`` is about how many blocks of each source wait; where it is None, as many as came in succession.
        """
        self._levels = [self._level(number, blocks) for number, blocks in enumerate(waiting)]
        ordered = sorted(self._queue, key=lambda number: self._levels[number] or 0)
        behind = [number for number in self._queue if self._is_behind(number)]
        if not behind or self._owed_s < (self._block_s[behind[0]] or _UNKNOWN_S):
            return ordered
        return [*behind, *(number for number in ordered if number not in behind)]

    def missed(self, number: int, seconds: float) -> None:
        """Note that a source had no block, and how long it took to ask it."""
        if self._is_behind(number):
            self._owed_s -= seconds
        self._in_succession[number] = 0
        self._levels[number] = None

    def served(self, number: int, seconds: float) -> None:
        """Note that a block of a source was served, and how long that took."""
        known = self._block_s[number]
        mean = seconds if known is None else known
        seconds = min(seconds, _MAX_FACTOR * mean)
        self._levels[number] = self._levels[number] or 0
        if self._is_behind(number):
            self._owed_s -= seconds
        elif any(map(self._is_behind, self._queue)):
            self._owed_s += seconds * _SHARE / (1.0 - _SHARE)
        else:
            self._owed_s = 0.0
        self._block_s[number] = mean + _WEIGHT * (seconds - mean)
        self._in_succession[number] += 1
        self._queue.remove(number)
        self._queue.append(number)

    def _level(self, number: int, waiting: float | None) -> int | None:
        """Return how far a source is behind, 0 where it keeps up; None where it seems to have no block."""
        blocks = self._in_succession[number] if waiting is None else waiting
        if not blocks and not self._in_succession[number]:
            return None
        work = blocks * (self._block_s[number] or _UNKNOWN_S) / _PROMPT_S
        return math.ceil(math.log2(work)) if work > 1.0 else 0

    def _is_behind(self, number: int) -> bool:
        """Return whether others that have blocks, as of the latest order, come before this source."""
        level = self._levels[number]
        return level is not None and level > min(other for other in self._levels if other is not None)
