"""The choice of a band from a stream, block by block, with a state that fits into a line of JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from monitor.health.spectrum.bands import find_band
from monitor.health.spectrum.transform import Band

ENOUGH_VOTES = 20
"""Blocks that decide. They are the first ones, in which the bearing runs in and nothing is learned yet: the choice
looks at no later block, and costs the learning of the baseline no time."""


@dataclass(frozen=True)
class BandVotes:
    """How many blocks found each band the best.

    Attributes:
        counts: (lo, hi) in Hz and the number of blocks that chose it, in the order in which they were first chosen.
    """

    counts: tuple[tuple[Band, int], ...] = ()

    @property
    def total(self) -> int:
        """How many blocks have voted."""
        return sum(count for _, count in self.counts)

    @property
    def enough(self) -> bool:
        """Whether enough blocks have voted."""
        return self.total >= ENOUGH_VOTES

    def add(self, samples: NDArray[np.floating], rate: float, fundamentals: Mapping[str, float]) -> BandVotes:
        """Return the votes with that of one more block: the band that would be chosen on it alone."""
        choice = find_band([samples], rate, fundamentals)
        counts = dict(self.counts)
        counts[choice] = counts.get(choice, 0) + 1
        return BandVotes(tuple(counts.items()))

    def best(self) -> Band:
        """Return the band with most votes, of equals the widest.

        Raises:
            ValueError: if nobody has voted.
        """
        if not self.counts:
            raise ValueError("no block has voted for a band")
        return max(self.counts, key=lambda item: (item[1], item[0][1] - item[0][0]))[0]

    def to_dict(self) -> dict[str, Any]:
        """Return the votes as plain values for JSON."""
        return {"counts": [[list(band), count] for band, count in self.counts]}

    @classmethod
    def from_dict(cls, stored: Mapping[str, Any]) -> BandVotes:
        """Return what :meth:`to_dict` gave."""
        counts: Sequence[Any] = stored["counts"]
        return cls(tuple(((float(low), float(high)), int(count)) for (low, high), count in counts))
