"""When a level will be reached, from the levels so far: a mixture over the shape of the growth, in closed form.

The levels since the onset are averaged in at most ten segments. The change of ln RMS from one segment to the next is
that of a curve ``a phi(u)`` over the share ``u`` of the elapsed time, plus a random walk whose variance is learned with
``a``, plus the noise of the segment's mean:

    d_i = a (phi(u_i) - phi(u_{i-1})) + e_i,    e_i ~ N(0, s^2 V_i),    V_i = u_i - u_{i-1} + noise / s_0^2

A random walk and not only noise about a curve: errors of neighbouring levels are correlated, and many blocks are no
proof of the shape. ``phi`` is a power of the time since the onset, or of the time since a later start, scaled to slope
1 now; or it has risen in a straight line up to a moment and stands since. ``a`` and ``s^2`` have the conjugate (normal,
inverse gamma) prior, so that each shape gives its evidence and a Student t distribution of the level at each later
time; the shapes are weighted by evidence. The curve goes on from the present level.

No smooth growth foresees a step or an acceleration, by which most recorded runs reached high levels. Beside the trend
the level is therefore reached by one that comes at any time with the chance that has no time scale of its own: within
``v`` elapsed times with probability ``v / (v + step)``. All is in units of the elapsed time: the same for hours and for
months.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


RATE, RATE_SD = 0.2, 1.0
"""Expected growth of ln RMS in one elapsed time, and its standard deviation."""
WALK, WALK_AHEAD = 0.2, 1.0
"""Standard deviation of the random walk of ln RMS over one elapsed time; variance of that ahead over that so far."""
FREEDOM = 1.0
"""What the prior of the walk counts, in segments."""
JUMP = 0.7
"""Standard deviation of a step at the onset, ln RMS."""
STEP = 1.0
"""Elapsed times within which half of all levels are reached by a step or an acceleration."""
SHAPES: tuple[tuple[float, float], ...] = (
    *((0.0, power) for power in (0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0)),
    *((start, 1.0) for start in (0.5, 0.75, 0.9)),
)
"""Start of the growth as a share of the elapsed time, and its power."""
STOPS: tuple[float, ...] = (0.05, 0.25, 0.5)
"""Ends of a growth that has stopped, as shares of the elapsed time."""
_BOUNDARIES = np.array((0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875, 0.9375))
_MIN_BLOCKS = 2
_START, _POWER = (np.array(column)[:, None] for column in zip(*SHAPES, strict=True))
_STOP = np.array(STOPS)[:, None]
_SCALE = _POWER * (1.0 - _START) ** (_POWER - 1.0)
MAX_AHEAD = 100.0
"""Longest time ahead, in elapsed times."""
AHEAD: Array = np.geomspace(1e-3, MAX_AHEAD, 49)
"""Times ahead at which the probability is computed, in elapsed times."""


def _phi(u: Array) -> Array:
    """Return the curve of each shape at shares of the elapsed time, shape (shape, u); those that stopped come last."""
    return np.concatenate((np.maximum(u - _START, 0.0) ** _POWER / _SCALE, np.minimum(u, _STOP)))


_GROWN = _phi(1.0 + AHEAD) - _phi(np.ones(1))


@dataclass(frozen=True, eq=False)
class LevelCrossing:
    """When a level is reached.

    Attributes:
        by_trend: probability that the trend reaches it by each of ``AHEAD``, shape (49,); rises.
        reached: the same of the trend, or a step or an acceleration before it.
        p_no_growth: probability that the level does not grow: of the shapes that stand, of ``a <= 0`` in the others.
    """

    by_trend: Array
    reached: Array
    p_no_growth: float

    def quantile(self, level: float) -> float:
        """Return the time ahead in elapsed times, at most ``MAX_AHEAD``: infinity beyond."""
        place = int(np.searchsorted(self.reached, level))
        if place == len(self.reached):
            return math.inf
        high, after = float(self.reached[place]), float(AHEAD[place])
        if place == 0:
            return after * level / high
        low, before = float(self.reached[place - 1]), float(AHEAD[place - 1])
        return before * (after / before) ** ((level - low) / (high - low))

    def probability_of_trend(self, ahead: float) -> float:
        """Return the probability that the trend reaches the level within a time, in elapsed times."""
        return float(np.interp(ahead, AHEAD, self.by_trend))


def segments(times: Array, levels: Array, blocks: Array) -> tuple[Array, Array, Array]:
    """Average levels in segments that are finer towards now.

    Args:
        times: shares of the elapsed time, rising to at most 1, shape (n,).
        levels: ln RMS, shape (n,).
        blocks: that each level stands for, shape (n,).

    Returns:
        times, levels and blocks of the segments.
    """
    cuts = np.searchsorted(times, _BOUNDARIES)
    kept = [0]
    total = np.concatenate(((0.0,), np.cumsum(blocks)))
    for cut in cuts.tolist():
        if total[cut] - total[kept[-1]] >= _MIN_BLOCKS and total[-1] - total[cut] >= _MIN_BLOCKS:
            kept.append(cut)
    weight = np.add.reduceat(blocks, kept)
    return np.add.reduceat(times * blocks, kept) / weight, np.add.reduceat(levels * blocks, kept) / weight, weight


def crossing(times: Array, levels: Array, blocks: Array, now: float, distance: float, noise: float) -> LevelCrossing:
    """Return when a level is reached.

    Args:
        times: of the segments, shares of the elapsed time, shape (n,).
        levels: their ln RMS over the baseline, shape (n,).
        blocks: in each, shape (n,).
        now: present ln RMS over the baseline.
        distance: of the level above the present one, ln RMS.
        noise: standard deviation of ln RMS from block to block.
    """
    u = np.concatenate(((0.0,), times, (1.0,)))
    y = np.concatenate(((0.0,), levels, (now,)))
    unit = WALK**2
    error = noise**2 / np.minimum(np.concatenate((blocks[:1], blocks, (3.0,))), 25.0)
    error[0] = JUMP**2
    variance = np.maximum(np.diff(u), 1e-3) + (error[1:] + error[:-1]) / unit
    change = np.diff(y)
    x = np.diff(_phi(u), axis=1)
    weighted = x / variance
    known, told = np.sum(weighted * x, axis=1), weighted @ change
    freedom = FREEDOM + len(change)
    squares = FREEDOM * unit + change @ (change / variance)
    # The prior of the rate does not narrow with the walk: it is given in units of a first estimate of that.
    certainty = np.maximum(squares - told**2 / known, 1e-9) / freedom / RATE_SD**2
    precision = certainty + known
    rate = (certainty * RATE + told) / precision
    spread = np.maximum(squares + certainty * RATE**2 - precision * rate**2, 1e-9) / freedom
    evidence = 0.5 * np.log(certainty / precision) - 0.5 * freedom * np.log(spread)
    weight = np.exp(evidence - evidence.max())
    weight /= weight.sum()
    sd = np.sqrt(spread[:, None] * (_GROWN**2 / precision[:, None] + WALK_AHEAD * AHEAD + error[-1] / unit))
    by_shape = _student((rate[:, None] * _GROWN - distance) / sd, freedom)
    still = _student(-rate * np.sqrt(precision / spread), freedom)
    still[len(SHAPES) :] = 1.0
    by_trend = np.maximum.accumulate(weight @ by_shape)
    reached = 1.0 - (1.0 - by_trend) * STEP / (STEP + AHEAD)
    return LevelCrossing(by_trend, reached, float(weight @ still))


def _student(t: Array, freedom: float) -> Array:
    """Return Student's distribution, after Wallace (1959)."""
    z = np.sign(t) * np.sqrt(freedom * np.log1p(t * t / freedom)) * (8.0 * freedom + 1.0) / (8.0 * freedom + 3.0)
    return 1.0 / (1.0 + np.exp(-np.clip(1.5976 * z + 0.07056 * z**3, -60.0, 60.0)))
