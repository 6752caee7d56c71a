"""Files beside those of a watched folder without which these are not read: the times of pulses."""

from __future__ import annotations

from collections.abc import Mapping

from streams.files.beside import pulse_file_of
from streams.files.pulse_files import is_pulse_file
from streams.folder.copying import HOLD
from streams.types.listing import Stat


class Awaited:
    """The files of pulses of one folder, and since when they have not changed.

    A file waits for the one that belongs to it as long as others wait for it, and so keeps their order; then it is
    read without.
    """

    def __init__(self, pattern: str | None, settle_s: float) -> None:
        """Take the pattern of the files of pulses, None: there are none; ``settle_s`` is the settling time."""
        self._pattern, self._settle = pattern, settle_s
        self._there: dict[str, tuple[Stat, float]] = {}

    def note(self, path: str, stat: Stat, now: float) -> None:
        """Record the status of a file, if it is one of pulses; ``now`` in s."""
        if is_pulse_file(self._pattern, path):
            known = self._there.get(path)
            if known is None or known[0] != stat:
                self._there[path] = (stat, now)

    def keep(self, listing: Mapping[str, Stat]) -> None:
        """Forget the files that are gone."""
        if self._there:
            self._there = {path: known for path, known in self._there.items() if path in listing}

    def holds(self, path: str, changed: float, now: float) -> bool:
        """Return whether a file that last changed at ``changed``, s, waits for its pulses."""
        beside = pulse_file_of(self._pattern, path)
        if beside is None or now - changed >= HOLD * self._settle:
            return False
        known = self._there.get(beside)
        return known is None or known[0].size == 0 or now - known[1] < self._settle

    def has(self, path: str) -> bool:
        """Return whether a file is one of pulses."""
        return is_pulse_file(self._pattern, path)
