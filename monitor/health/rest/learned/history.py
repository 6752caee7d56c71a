"""The levels of one final stage in bounded memory, and what the regression takes of them.

Levels are ln RMS. A running median of five blocks keeps single spikes out; its values are averaged in at most 64 bins
of equal numbers of blocks, which are merged in pairs when they are full.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import median

import numpy as np
from numpy.typing import NDArray

from monitor.health.codec import StoredState

Array = NDArray[np.float64]

MEDIAN_BLOCKS = 5
MAX_BINS = 64
WINDOWS = (1.0, 0.5, 0.25)
"""Windows of the growth, shares of the elapsed time up to now."""
INPUTS = ("ln_elapsed", "level", *(f"growth_{share:g}" for share in WINDOWS))
"""Names of the inputs: ln of the elapsed time in s; ln(RMS / baseline); the growth of ln RMS in each window, scaled to
the whole elapsed time."""
_SHRINKING_BINS = 4.0
"""A growth from n bins counts n / (n + 4): the noise of a slope over few bins is larger than the slope."""


@dataclass(frozen=True)
class StageHistory(StoredState):
    """Levels since t_fs.

    Attributes:
        origin: time of the first block, s; ``latest`` of the last one.
        count: blocks.
        recent: the latest levels, at most five.
        bins: (elapsed time, level) means of ``bin_blocks`` blocks each, oldest first.
        filling: sums of elapsed time and level of the bin that is not full, and its blocks.
    """

    origin: float
    latest: float
    count: int = 0
    recent: tuple[float, ...] = ()
    bins: tuple[tuple[float, float], ...] = ()
    bin_blocks: int = 1
    filling: tuple[float, float, int] = (0.0, 0.0, 0)

    @classmethod
    def begin(cls, time: float) -> StageHistory:
        """Return the empty history of a final stage that begins at a time, s."""
        return cls(time, time)

    @property
    def elapsed(self) -> float:
        """Time since the first block, s."""
        return self.latest - self.origin

    @property
    def level(self) -> float:
        """Median of the latest levels."""
        return median(self.recent)

    def add(self, time: float, level: float) -> StageHistory:
        """Return the history with a block at ``time``, s, that must not go back, and its ln RMS, finite."""
        recent = (*self.recent, level)[-MEDIAN_BLOCKS:]
        at, total, blocks = self.filling
        at, total, blocks = at + (time - self.origin), total + median(recent), blocks + 1
        bins, bin_blocks = self.bins, self.bin_blocks
        if blocks == bin_blocks:
            bins, at, total, blocks = (*bins, (at / blocks, total / blocks)), 0.0, 0.0, 0
            if len(bins) == MAX_BINS:
                pairs = zip(bins[::2], bins[1::2], strict=True)
                bins = tuple((0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])) for a, b in pairs)
                bin_blocks *= 2
        return StageHistory(self.origin, time, self.count + 1, recent, bins, bin_blocks, (at, total, blocks))

    def inputs(self, ln_baseline: float) -> Array:
        """Return the inputs of the regression, shape (len(INPUTS),); the elapsed time must be positive.

        Without a baseline (NaN) the level is NaN.
        """
        at, total, blocks = self.filling
        points = np.array((*self.bins, *([(at / blocks, total / blocks)] if blocks else [])))
        growths = (_growth(points, self.elapsed, share) for share in WINDOWS)
        return np.array([math.log(self.elapsed), self.level - ln_baseline, *growths])


def _growth(points: Array, elapsed: float, share: float) -> float:
    """Return the least-squares slope over the last share of the elapsed time, times the elapsed time, shrunk."""
    inside = points[points[:, 0] >= elapsed * (1.0 - share) * (1.0 - 1e-12)]
    if len(inside) < 2:
        return 0.0
    x = inside[:, 0] - inside[:, 0].mean()
    squares = float(x @ x)
    slope = float(x @ inside[:, 1]) / squares if squares > 0.0 else 0.0
    return slope * elapsed * len(inside) / (len(inside) + _SHRINKING_BINS)
