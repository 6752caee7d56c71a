"""Naive forecasts of the time to threshold, to stand beside the real ones; each is issued with only the past.

They need no map, no library and no idea of damage. A forecast that does not beat them is worth nothing, however good it
looks. Two ask for the lifetimes of other bearings (final stages from onset to threshold, s): of a library, or of other
runs of the same rig, never of the run that is forecast. Three extrapolate the history of V_eq, one value a block.

Elapsed times count from the onset (t_fs). All times are seconds, all volumes m2; NaN is "no answer".
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from monitor.health.damage.thesis import forecast

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Sample:
    """A forecast as a sample of remaining times.

    Attributes:
        values: shape (m,), s, ascending.
        weights: shape (m,), positive, adding up to one.
    """

    values: Floats
    weights: Floats

    def quantiles(self, levels: ArrayLike) -> Floats:
        """Return quantiles, straight between the members, each of which stands in the middle of its weight.

        Args:
            levels: shape (q,), within (0, 1).

        Returns:
            Shape (q,), s.
        """
        middle = np.cumsum(self.weights) - 0.5 * self.weights
        return np.interp(np.asarray(levels, dtype=np.float64), middle, self.values)


def constant(elapsed: ArrayLike, lifetimes: ArrayLike) -> Floats:
    """Forecast that this bearing lasts as long as the median one: median lifetime less elapsed time, at least zero.

    This is also the guess that stands in for a missing answer where methods are compared.

    Args:
        elapsed: since the onset, shape (n,) or a number, s.
        lifetimes: of other bearings, shape (m,), s.

    Returns:
        Remaining times, of the shape of ``elapsed``, s.

    Raises:
        ValueError: no lifetimes, or some that are not positive.
    """
    median = float(np.median(_lifetimes(lifetimes)))
    return np.maximum(median - np.asarray(elapsed, dtype=np.float64), 0.0)


def climatology(elapsed: float, lifetimes: ArrayLike) -> Sample:
    """Forecast what was left to those bearings that had lasted as long: lifetimes given survival, less elapsed time.

    Args:
        elapsed: since the onset, s.
        lifetimes: of other bearings, shape (m,), s.

    Returns:
        Members of equal weight; the single one of zero where no other bearing lasted as long.

    Raises:
        ValueError: no lifetimes, or some that are not positive.
    """
    return _survivors(elapsed, _lifetimes(lifetimes), power=0)


def elapsed_alone(elapsed: float, lifetimes: ArrayLike) -> Sample:
    """Forecast what the elapsed time alone says, as a regression on it learns from equally many moments of each life.

    Of m lives that are looked at equally often at random moments, a life T is met at an elapsed time near t (if t < T)
    in proportion to 1 / T. So this is the climatology with the lives weighted by 1 / T: the right forecast where
    moments are drawn life by life, as in the benchmarks, and as with :func:`climatology` it knows of no vibration.

    Args:
        elapsed: since the onset, s.
        lifetimes: of other bearings, shape (m,), s.

    Returns:
        Weighted members; the single one of zero where no other bearing lasted as long.

    Raises:
        ValueError: no lifetimes, or some that are not positive.
    """
    return _survivors(elapsed, _lifetimes(lifetimes), power=1)


def doubling(elapsed: ArrayLike, levels: ArrayLike) -> Floats:
    """Forecast without any other bearing: whatever has lasted t is met at a moment drawn evenly from its life.

    Then P(remaining > r) = t / (t + r): the median of what remains is what has elapsed (Gott, Nature 363, 1993).

    Args:
        elapsed: since the onset, shape (n,), s.
        levels: of the quantiles, shape (q,), within (0, 1).

    Returns:
        Quantiles, shape (n, q), s.
    """
    p = np.asarray(levels, dtype=np.float64)
    return np.asarray(elapsed, dtype=np.float64)[:, np.newaxis] * p / (1.0 - p)


def linear(t: ArrayLike, v_eq: ArrayLike, threshold: float) -> Floats:
    """Forecast by the straight line of least squares through all V_eq so far, extrapolated to the threshold.

    Args:
        t: moments, shape (n,), not falling, s.
        v_eq: V_eq or any other indicator that grows, shape (n,), in any unit; NaN where there is none.
        threshold: in the same unit.

    Returns:
        Time to threshold after each moment, shape (n,), s: zero once a value has reached it, or where the line says so;
        NaN with fewer than two distinct times, or where the line does not rise.
    """
    values = np.asarray(v_eq, dtype=np.float64)
    return _extrapolated(np.asarray(t, dtype=np.float64), values, values, float(threshold), float(threshold))


def exponential(t: ArrayLike, v_eq: ArrayLike, threshold: float) -> Floats:
    """Forecast by exponential growth: as :func:`linear` on the logarithm; values that are not positive are left out.

    Args:
        t: moments, shape (n,), not falling, s.
        v_eq: V_eq or any other indicator that grows, shape (n,), in any unit; NaN where there is none.
        threshold: in the same unit, positive.
    """
    values = np.asarray(v_eq, dtype=np.float64)
    logs = np.log(np.where(values > 0, values, np.nan))
    return _extrapolated(np.asarray(t, dtype=np.float64), logs, values, math.log(threshold), float(threshold))


def thesis(t: ArrayLike, v_eq: ArrayLike, threshold: float) -> Floats:
    """Forecast by the quadratic of the thesis, :mod:`monitor.health.damage.thesis.forecast`.

    Args:
        t: moments, shape (n,), not falling, s.
        v_eq: V_eq, shape (n,), m2; NaN where there is none.
        threshold: m2.

    Returns:
        Time to threshold after each moment, shape (n,), s; NaN where its status says that there is none.
    """
    state, found = forecast.ForecastState(), []
    for moment, value in zip(np.asarray(t, dtype=np.float64), np.asarray(v_eq, dtype=np.float64), strict=True):
        state, results = forecast.step(state, float(moment), float(value), thresholds=(threshold,))
        found.append(results[0].tt)
    return np.array(found, dtype=np.float64)


def quantiles_of(forecasts: Sequence[Sample], levels: ArrayLike) -> Floats:
    """Return the quantiles of several forecasts, shape (n, q), s."""
    p = np.asarray(levels, dtype=np.float64)
    return np.array([sample.quantiles(p) for sample in forecasts], dtype=np.float64).reshape(-1, p.size)


def _lifetimes(lifetimes: ArrayLike) -> Floats:
    values = np.sort(np.asarray(lifetimes, dtype=np.float64).ravel())
    if not values.size or not np.isfinite(values).all() or values[0] <= 0:
        raise ValueError(f"lifetimes must be one or more positive times, got {values.tolist()}")
    return values


def _survivors(elapsed: float, lifetimes: Floats, power: int) -> Sample:
    """Return what was left to the lives longer than ``elapsed``, weighted by T to the power of ``-power``."""
    left = lifetimes[lifetimes > elapsed]
    if not left.size:
        return Sample(np.zeros(1), np.ones(1))
    weights = left ** float(-power)
    return Sample(left - elapsed, weights / weights.sum())


def _extrapolated(t: Floats, y: Floats, values: Floats, goal: float, threshold: float) -> Floats:
    """Return when the running line through (t, y) reaches the goal, counted from each moment.

    The sums are taken about the running means, so that long histories and late clocks cost no digits.
    """
    count, mean_t, mean_y, s_tt, s_ty = 0, 0.0, 0.0, 0.0, 0.0
    crossed, found = False, np.full(t.shape, np.nan)
    for i, (moment, value, raw) in enumerate(zip(t.tolist(), y.tolist(), values.tolist(), strict=True)):
        if math.isfinite(value):
            count += 1
            before = moment - mean_t
            mean_t += before / count
            mean_y += (value - mean_y) / count
            s_tt += before * (moment - mean_t)
            s_ty += before * (value - mean_y)
        crossed = crossed or raw >= threshold
        if crossed:
            found[i] = 0.0
        elif s_tt > 0 and s_ty > 0:
            found[i] = max(mean_t + (goal - mean_y) * s_tt / s_ty - moment, 0.0)
    return found
