"""The order in which sources are asked for their next block: one that keeps up is not delayed by one that is behind."""

from __future__ import annotations

_BEHIND = 4
"""Blocks in succession with another one waiting each time, after which a source counts as behind."""
_FAVOURED = 4
"""Blocks of sources that keep up, after which one that is behind has its turn."""


class Turns:
    """Least recently served first, sources that keep up before those behind, which get at least a turn in five.

    A source with a folder full of files, or whose files take long, would otherwise delay a prompt one by its share of
    every round.
    """

    def __init__(self, count: int) -> None:
        """Begin with ``count`` sources that keep up."""
        self._queue = list(range(count))
        self._in_succession = [0] * count
        self._favoured = 0

    def order(self) -> list[int]:
        """Return the numbers of all sources in the order in which to ask them."""
        behind_first = self._favoured >= _FAVOURED
        return sorted(self._queue, key=lambda number: self._is_behind(number) is not behind_first)

    def asked(self, number: int, *, delivered: bool) -> None:
        """Note whether a source that was asked had a block."""
        if not delivered:
            self._in_succession[number] = 0
            return
        waits = any(map(self._is_behind, self._queue))
        self._favoured = self._favoured + 1 if waits and not self._is_behind(number) else 0
        self._in_succession[number] += 1
        self._queue.remove(number)
        self._queue.append(number)

    def _is_behind(self, number: int) -> bool:
        return self._in_succession[number] >= _BEHIND
