"""The shaft speed near a stated one, from the comb of the shaft in the raw and the envelope spectrum.

Each candidate speed is scored by the excess of both spectra at the first multiples of it. A comb whose every second,
third or fifth line alone stands high is that of passing elements or of a supply, and the shaft a sub-multiple of its
fundamental by accident: the score is the least mean over the multiples that are left without those. A speed is given
only if its score stands clear of noise, and clear of that of every other candidate, and if nothing as high stands
between its multiples.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from monitor.health.signal.comb import GRID_STEP, LineSpectrum, comb_grid

REACH = 0.1
"""Half width of the range about the stated speed that is looked at."""
ACCEPTED = 0.085
"""Distance from the stated speed up to which a speed is given: one at the end of the range may stand outside."""
SHAFT_ORDERS = 12
MIN_SCORE, MIN_RAW, MIN_MARGIN = 3.0, 1.5, 0.5
"""Least score, of which noise reads up to 2 in the search; least part of the raw spectrum in it, for the lines of
damage and their sidebands can pass for those of a shaft in the envelope; least margin over any other candidate."""
MIN_TURNS = 16
"""Turns of the shaft that a block must hold."""
SEPARATED_TURNS = 70
"""Turns in which a comb near a multiple of the shaft is apart from it: with half a percent of slip, the first line."""
_PARTS = (2, 3)
MOST_BETWEEN = 0.6
"""Height of the lines between the multiples, at parts of the shaft, over that of the multiples at which they are all
lines of one comb: that of a cage or of passages, of which the shaft would be a multiple by accident."""
_BESIDE_PEAK = 0.6
"""Share of the height of a line that counts in the bins beside its top."""
_LEFT_OUT = (2, 3, 5)
_SAME_SPEED, _SAME_BINS = 0.004, 3.0
"""Candidates this near are the same: relative, or in bins of the highest multiple."""
_PEAK = 0.15
"""Candidates of a peak whose score is within this share of its height over the noise state its width."""


@dataclass(frozen=True)
class ShaftSpeed:
    """A shaft speed with the standard deviation of its error, Hz.

    Attributes:
        score: of the comb, mean excess of a line in both spectra; NaN where the speed was not measured.
        margin: of the score over that of the best other candidate; NaN likewise.
    """

    speed: float
    sd: float
    score: float = math.nan
    margin: float = math.nan

    @property
    def measured(self) -> bool:
        """Whether the speed was found in the signal, and not stated."""
        return not math.isnan(self.score)


def measurable(speed: float, resolution: float) -> bool:
    """Return whether a block is long enough for lines of the shaft to be apart."""
    return speed >= MIN_TURNS * resolution


def highest_order(stated: float) -> float:
    """Return the highest frequency that is looked at, Hz."""
    return SHAFT_ORDERS * (1.0 + REACH) * stated


def measure_shaft(raw: LineSpectrum, envelope: LineSpectrum, stated: float) -> ShaftSpeed | None:
    """Return the shaft speed near a stated one, or None where no comb of the shaft stands clear.

    Args:
        raw: spectrum of the signal.
        envelope: spectrum of the envelope, of the same resolution.
        stated: speed, Hz.
    """
    resolution = raw.resolution
    shorter = min(raw.excess.size, envelope.excess.size)
    if not measurable(stated, resolution) or shorter * resolution < SHAFT_ORDERS * stated:
        return None
    grid = comb_grid((1.0 - REACH) * stated, (1.0 + REACH) * stated, resolution, SHAFT_ORDERS)
    tops = _tops(raw)[:shorter], _tops(envelope)[:shorter]
    heights = [each.take(np.minimum(grid.bins, shorter - 1)) for each in tops]
    score = (_kept_orders() @ (heights[0] + heights[1])).min(axis=0)
    best = int(np.argmax(score))
    in_raw = float((_kept_orders() @ heights[0][:, best]).min())
    speed = float(grid.lines[best])
    distance = np.abs(grid.lines - speed)
    apart = distance > max(_SAME_SPEED * stated, _SAME_BINS * resolution / SHAFT_ORDERS)
    margin = float(score[best] - np.max(score, where=apart, initial=0.0))
    if score[best] < MIN_SCORE or in_raw < MIN_RAW or margin < MIN_MARGIN or abs(speed / stated - 1.0) > ACCEPTED:
        return None
    if _is_multiple(tops[0] + tops[1], speed / resolution):
        return None
    level = float(np.median(score))
    weight = np.maximum(score - (score[best] - _PEAK * (score[best] - level)), 0.0) * ~apart
    speed = float(np.average(grid.lines, weights=weight))
    spread = float(np.average((grid.lines - speed) ** 2, weights=weight))
    step = GRID_STEP * resolution / SHAFT_ORDERS
    return ShaftSpeed(speed, math.sqrt(spread + step * step), float(score[best]), margin)


def _is_multiple(heights: NDArray[np.float64], spacing: float) -> bool:
    """Tell whether lines stand between the multiples of a shaft as well, at all its halves or thirds.

    Args:
        heights: of the tops of lines, shape (bin,).
        spacing: of the multiples, bins.
    """
    for parts in _PARTS:
        orders = np.arange(1, SHAFT_ORDERS * parts + 1)
        places = np.rint(orders * (spacing / parts)).astype(np.intp)
        lines = heights.take(np.minimum(places, heights.size - 1))
        between = orders % parts != 0
        if float(lines[between].mean()) > MOST_BETWEEN * float(lines[~between].mean()):
            return True
    return False


def _tops(spectrum: LineSpectrum) -> NDArray[np.float64]:
    """Return the excess at the tops of lines, a share of it beside them, 0 elsewhere; shape (bin,)."""
    power = spectrum.power
    tops = np.zeros(power.size)
    tops[1:-1] = spectrum.excess[1:-1] * ((power[1:-1] >= power[:-2]) & (power[1:-1] > power[2:]))
    heights = tops.copy()
    np.maximum(heights[1:], _BESIDE_PEAK * tops[:-1], out=heights[1:])
    np.maximum(heights[:-1], _BESIDE_PEAK * tops[1:], out=heights[:-1])
    return heights


@lru_cache(maxsize=1)
def _kept_orders() -> NDArray[np.float64]:
    """Return for each of ``_LEFT_OUT`` the weights of the multiples that are kept, shape (left out, order)."""
    orders = np.arange(1, SHAFT_ORDERS + 1)
    kept = np.array([orders % left_out != 0 for left_out in _LEFT_OUT], dtype=np.float64)
    return kept / kept.sum(axis=1, keepdims=True)
