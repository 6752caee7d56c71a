"""The order in which sources are asked for their next block: one that keeps up is not delayed by one that is behind."""

from __future__ import annotations

_BEHIND = 4
"""Blocks in succession with another one waiting each time, after which a source counts as behind."""
_FAVOURED = 4
"""Blocks of sources that are less behind, after which one that is behind has its turn."""


class Turns:
    """Sources that keep up come before those behind, and these by how far they are; within a class, least recent first.

    A source is further behind with each doubling of its blocks in succession. Those behind get a turn in five at least.
    A source with a folder full of files, or whose files take long, would otherwise delay a prompt one by its share of
    every round; and one that fell behind for a moment would stay so, if it needs more than an equal share.
    """

    def __init__(self, count: int) -> None:
        """Begin with ``count`` sources that keep up."""
        self._queue = list(range(count))
        self._in_succession = [0] * count
        self._favoured = 0

    def order(self) -> list[int]:
        """Return the numbers of all sources in the order in which to ask them."""
        if self._favoured >= _FAVOURED:
            return sorted(self._queue, key=lambda number: self._lag(number) == 0)
        return sorted(self._queue, key=self._lag)

    def asked(self, number: int, *, delivered: bool) -> None:
        """Note whether a source that was asked had a block."""
        lag = self._lag(number)
        if not delivered:
            self._in_succession[number] = 0
            return
        owed = self._favoured >= _FAVOURED and lag > 0
        favoured = not owed and any(self._lag(other) > lag for other in self._queue)
        self._favoured = self._favoured + 1 if favoured else 0
        self._in_succession[number] += 1
        self._queue.remove(number)
        self._queue.append(number)

    def _lag(self, number: int) -> int:
        """Return how far a source is behind: 0 where it keeps up."""
        return (self._in_succession[number] // _BEHIND).bit_length()
