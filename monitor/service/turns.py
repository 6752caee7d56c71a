"""The order in which sources are asked for their next block: one that keeps up is not delayed by one that is behind."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from statistics import median_low

_PROMPT_S = 0.1
"""A source whose waiting blocks take less time than this keeps up."""
_LEVEL = 2.0
"""Sources whose waiting blocks take up to this many times as long as the shortest of a level are of the same level."""
_UNKNOWN_S = 0.01
"""Time that a block of a source takes of which none was served yet."""
_SHARE = 0.2
"""Share of the time, at least, of the sources that are behind, while others are served before them."""
_RECENT_BLOCKS = 5
"""Blocks whose median is the time that a block of a source takes: the first one may load libraries."""
_MAX_FACTOR = 4.0
"""A block counts as at most this many times the median: one during which the disk was full says nothing of the next."""


class Turns:
    """The source whose waiting blocks take least time comes first; within a level, the one served least recently.

    Sources with about as much waiting share the turns. Sources behind others have a fifth of the time at least. Shares
    of turns would not do: a source that keeps up and needs more than an equal share of them, on a busy machine or with
    a block every 50 ms, would fall behind, and be delayed by the others for as long as these take.
    """

    def __init__(self, count: int) -> None:
        """Begin with ``count`` sources of which nothing is known."""
        self._queue = list(range(count))
        self._in_succession = [0] * count
        self._recent: list[deque[float]] = [deque(maxlen=_RECENT_BLOCKS) for _ in range(count)]
        self._block_s = [_UNKNOWN_S] * count
        self._levels: list[int | None] = [None] * count
        self._owed_s = 0.0

    def order(self, waiting: Sequence[float | None]) -> list[int]:
        """Return the numbers of all sources in the order in which to ask them.

        ``waiting`` is about how many blocks of each source wait; where it is None, as many as came in succession.
        """
        work = {number: self._work(number, blocks) for number, blocks in enumerate(waiting)}
        known = {number: seconds for number, seconds in work.items() if seconds is not None}
        self._levels = [None] * len(self._levels)
        level, limit = -1, -1.0
        for number, seconds in sorted(known.items(), key=lambda item: item[1]):
            if seconds > limit:
                level, limit = level + 1, max(_LEVEL * seconds, _PROMPT_S)
            self._levels[number] = level
        ordered = sorted(self._queue, key=lambda number: self._levels[number] or 0)
        behind = [number for number in self._queue if self._is_behind(number)]
        if not behind or self._owed_s < self._block_s[behind[0]]:
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
        recent = self._recent[number]
        recent.append(seconds)
        self._block_s[number] = median_low(recent)
        seconds = min(seconds, _MAX_FACTOR * self._block_s[number])
        self._levels[number] = self._levels[number] or 0
        if self._is_behind(number):
            self._owed_s -= seconds
        elif any(map(self._is_behind, self._queue)):
            self._owed_s += seconds * _SHARE / (1.0 - _SHARE)
        else:
            self._owed_s = 0.0
        self._in_succession[number] += 1
        self._queue.remove(number)
        self._queue.append(number)

    def _work(self, number: int, waiting: float | None) -> float | None:
        """Return the time that the waiting blocks of a source take, s; None where it seems to have no block."""
        blocks = self._in_succession[number] if waiting is None else waiting
        if not blocks and not self._in_succession[number]:
            return None
        return blocks * self._block_s[number]

    def _is_behind(self, number: int) -> bool:
        """Return whether others that have blocks, as of the latest order, come before this source."""
        level = self._levels[number]
        return level is not None and level > min(other for other in self._levels if other is not None)
