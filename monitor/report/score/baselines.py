"""Naive forecasts of the time to threshold: references that a forecast has to beat, each from the past alone.

Three use the lifetimes of other bearings (final stages from onset to threshold, s, shape (m,)): of a library, or of
other runs of the same rig. Three extrapolate the history of V_eq, one value a block: times ``t`` (n,), not falling, and
``v_eq`` (n,), NaN for none; they return the time to threshold after each block, NaN for no answer.

Elapsed times count from the onset (t_fs). All times are seconds, all volumes m2. Lifetimes that are missing or not
positive raise ValueError.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from monitor.health.rest import quadratic as forecast

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Sample:
    """A forecast as a sample of remaining times, ascending, with positive weights that add up to one."""

    values: Floats
    weights: Floats

    def quantiles(self, levels: ArrayLike) -> Floats:
        """Return quantiles (s), linear between the members, each in the middle of its weight."""
        middle = np.cumsum(self.weights) - 0.5 * self.weights
        return np.interp(np.asarray(levels, dtype=np.float64), middle, self.values)


def constant(elapsed: ArrayLike, lifetimes: ArrayLike) -> Floats:
    """Forecast the median lifetime less the elapsed time, at least zero."""
    median = float(np.median(_lifetimes(lifetimes)))
    return np.maximum(median - np.asarray(elapsed, dtype=np.float64), 0.0)


def climatology(elapsed: float, lifetimes: ArrayLike) -> Sample:
    """Forecast the lifetimes given survival, less the elapsed time; a single zero without survivors."""
    return _survivors(elapsed, _lifetimes(lifetimes), power=0)


def elapsed_alone(elapsed: float, lifetimes: ArrayLike) -> Sample:
    """Forecast from the elapsed time alone: :func:`climatology` with lives weighted by 1 / T.

    That is the regression on elapsed time where equally many times are drawn from each life, as in the benchmarks: a
    life T is then met at an elapsed time near t < T in proportion to 1 / T.
    """
    return _survivors(elapsed, _lifetimes(lifetimes), power=1)


def doubling(elapsed: ArrayLike, levels: ArrayLike) -> Floats:
    """Return quantiles, shape (n, q), for a present time uniform over the life (Gott, Nature 363, 1993).

    P(remaining > r) = t / (t + r), so that the median of the remaining time is the elapsed time t.
    """
    p = np.asarray(levels, dtype=np.float64)
    return np.asarray(elapsed, dtype=np.float64)[:, np.newaxis] * p / (1.0 - p)


def linear(t: ArrayLike, v_eq: ArrayLike, threshold: float) -> Floats:
    """Extrapolate the line of least squares through all V_eq (or another growing indicator) so far to the threshold.

    Zero once a value or the line has reached it; NaN with fewer than two distinct times or a line that does not rise.
    """
    values = np.asarray(v_eq, dtype=np.float64)
    return _extrapolated(np.asarray(t, dtype=np.float64), values, values, float(threshold), float(threshold))


def exponential(t: ArrayLike, v_eq: ArrayLike, threshold: float) -> Floats:
    """Extrapolate exponential growth: :func:`linear` on the logarithm, without values that are not positive."""
    values = np.asarray(v_eq, dtype=np.float64)
    logs = np.log(np.where(values > 0, values, np.nan))
    return _extrapolated(np.asarray(t, dtype=np.float64), logs, values, math.log(threshold), float(threshold))


def thesis(t: ArrayLike, v_eq: ArrayLike, threshold: float) -> Floats:
    """Forecast by the quadratic of the thesis, :mod:`monitor.health.rest.quadratic`."""
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
    """Return the remaining times of the lives longer than ``elapsed``, weighted by T ** -power."""
    left = lifetimes[lifetimes > elapsed]
    if not left.size:
        return Sample(np.zeros(1), np.ones(1))
    weights = left ** float(-power)
    return Sample(left - elapsed, weights / weights.sum())


def _extrapolated(t: Floats, y: Floats, values: Floats, goal: float, threshold: float) -> Floats:
    """Return the time from each block until the running line through (t, y) reaches the goal.

    Sums are about the running means, for precision with long histories and large times.
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
