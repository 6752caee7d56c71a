"""Other rules for the time to a level, as probabilities on one grid of times, and scores of all of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.alarm_time_cases import Case, Floats
from monitor.health.rest.trend.growth import AHEAD, PRIOR, Crossing, GrowthPrior, crossing, segments
from monitor.health.rest.trend.stage import MIN_NOISE, points_of

GRID: Floats = np.concatenate(((0.0,), np.geomspace(1e-3, 100.0, 400)))
"""Times ahead at which the probabilities stand, in elapsed times."""
LAST = 20
"""Blocks through which lines are put."""
MAX_SHARE = 10.0
"""Largest CRPS over the time from onset to crossing."""

Method = Callable[[Case], Floats]
"""Gives the probability of having reached the level by each of ``GRID``, for a case."""


def trend_of(case: Case, prior: GrowthPrior = PRIOR) -> Crossing:
    """Return the distribution of the stage, also where it is withheld as no trend."""
    history = case.history.states[case.place].history
    assert history is not None
    times, levels, blocks = points_of(history)
    shares = np.minimum(times / history.elapsed, 1.0)
    distance = math.log(case.factor) - history.level
    noise = max(case.history.noise, MIN_NOISE)
    return crossing(*segments(shares, levels, blocks), history.level, distance, noise, prior)


def trend(case: Case, prior: GrowthPrior = PRIOR) -> Floats:
    """The stage."""
    return np.interp(GRID, np.concatenate(((0.0,), AHEAD)), np.concatenate(((0.0,), trend_of(case, prior).reached)))


def doubling(case: Case) -> Floats:
    """As long again as it has lasted: within v elapsed times with probability v / (1 + v)."""
    return GRID / (1.0 + GRID)


def line(case: Case) -> Floats:
    """A straight line through the last blocks of RMS: one number, never where it does not rise."""
    return _through(case, np.exp(case.level), case.factor)


def exponential(case: Case) -> Floats:
    """A straight line through the last blocks of ln RMS."""
    return _through(case, case.level, math.log(case.factor))


def _through(case: Case, values: Floats, level: float) -> Floats:
    slope, now = np.polyfit(case.time[-LAST:] - case.elapsed, values[-LAST:], 1).tolist()
    ahead = max((level - now) / slope, 0.0) if slope > 0.0 else math.inf
    return (GRID * case.elapsed >= ahead).astype(np.float64)


@dataclass(frozen=True)
class Exponential:
    """The Bayesian exponential degradation model: ln RMS is a straight line with a normal prior, and white noise.

    Attributes:
        mean: of intercept and slope (1/s), shape (2,).
        covariance: shape (2, 2).
        noise: standard deviation.
    """

    mean: Floats
    covariance: Floats
    noise: float

    @classmethod
    def fit(cls, cases: Sequence[Case]) -> Exponential:
        """Fit the prior on whole histories, one of each."""
        whole = {id(case.history): case.history for case in cases}.values()
        lines = np.array([np.polyfit(history.time, history.level, 1)[::-1] for history in whole])
        errors = [
            float(np.std(history.level - found[0] - found[1] * history.time))
            for history, found in zip(whole, lines, strict=True)
        ]
        return cls(lines.mean(axis=0), np.diag(lines.var(axis=0)), float(np.mean(errors)))

    def __call__(self, case: Case) -> Floats:
        """Return the probability that the line has crossed the level."""
        x = np.stack((np.ones(len(case.time)), case.time), axis=1)
        before = np.linalg.inv(self.covariance)
        covariance = np.linalg.inv(before + x.T @ x / self.noise**2)
        mean = covariance @ (before @ self.mean + x.T @ case.level / self.noise**2)
        ahead = np.stack((np.ones(len(GRID)), case.elapsed * (1.0 + GRID)), axis=1)
        sd = np.sqrt(np.einsum("ij,jk,ik->i", ahead, covariance, ahead) + self.noise**2)
        z = (ahead @ mean - math.log(case.factor)) / sd
        normal = 0.5 * (1.0 + np.array([math.erf(value / math.sqrt(2.0)) for value in z.tolist()]))
        normal[0] = 0.0
        return np.maximum.accumulate(normal)


def crps_share(case: Case, reached: Floats) -> float:
    """Return the CRPS over the time from onset to crossing, at most ``MAX_SHARE``; beyond the grid nothing counts."""
    x = GRID * case.elapsed
    widths = np.diff(x)
    middle = 0.5 * (reached[1:] + reached[:-1])
    before = np.clip((case.left - x[:-1]) / widths, 0.0, 1.0)
    return min(
        float(np.sum(widths * (before * middle**2 + (1.0 - before) * (1.0 - middle) ** 2))) / case.life, MAX_SHARE
    )


def quantile(case: Case, reached: Floats, level: float) -> float:
    """Return a quantile, s; infinity beyond the grid."""
    place = int(np.searchsorted(reached, level))
    return math.inf if place == len(reached) else float(GRID[place]) * case.elapsed


def covers(case: Case, reached: Floats) -> bool:
    """Return whether the 80 % interval holds the crossing; of an open case, whether it reaches to the record's end."""
    upper = quantile(case, reached, 0.9)
    if case.open:
        return upper >= case.left
    return quantile(case, reached, 0.1) <= case.left <= upper


def by_run(cases: Sequence[Case], values: Sequence[float]) -> float | None:
    """Return the mean over runs of the means over their cases."""
    grouped: dict[str, list[float]] = {}
    for case, value in zip(cases, values, strict=True):
        grouped.setdefault(case.history.run, []).append(value)
    return float(np.mean([np.mean(found) for found in grouped.values()])) if grouped else None
