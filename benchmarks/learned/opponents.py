"""Opponents of learned forecasts on recorded runs, each a sample of the time to the end.

All but the first are fitted on the other runs: none sees more of the run that is asked than its blocks so far.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray

from monitor.health.rest.learned.fit import MIN_POINTS, LearnedRun, fit_runs
from monitor.health.rest.learned.history import StageHistory
from monitor.health.rest.learned.model import Distribution, LearnedModel

Array = NDArray[np.float64]
Forecast = Callable[[LearnedRun, int], Array | None]
"""A run and the place of its latest block; the ascending sample of the time to the end, s, None for no answer."""

LEVELS = (np.arange(400) + 0.5) / 400
_LONGEST = 1e9
_DRAWS = 4000


def of_distribution(found: Distribution) -> Array:
    """Return the quantiles of a learned forecast."""
    return np.array([found.quantile(level) for level in LEVELS.tolist()])


def doubling(run: LearnedRun, place: int) -> Array | None:
    """As long again as it has lasted: P(TT > x) = t / (t + x)."""
    return of_distribution(Distribution(float(run.t[place]))) if run.t[place] > 0.0 else None


@cache
def histories(run: LearnedRun) -> list[StageHistory]:
    """Return the history of a run after each of its blocks."""
    found = [StageHistory.begin(0.0)]
    for t, ln_rms in zip(run.t.tolist(), run.ln_rms.tolist(), strict=True):
        found.append(found[-1].add(t, ln_rms))
    return found[1:]


def learned(model: LearnedModel) -> Forecast:
    """The program."""

    def ask(run: LearnedRun, place: int) -> Array | None:
        history = histories(run)[place]
        if history.count < MIN_POINTS:
            return None
        return of_distribution(model.distribution(history.inputs(run.ln_baseline), history.elapsed))

    return ask


def climatology(others: Sequence[LearnedRun]) -> Forecast:
    """What was left to the other runs that lasted as long, all alike; past all of them as long again."""
    return _lifetimes(np.array([run.life for run in others]), equal=True)


def elapsed_alone(others: Sequence[LearnedRun]) -> Forecast:
    """The same, runs weighted by 1 / life, which is right for moments at random shares of a life."""
    return _lifetimes(np.array([run.life for run in others]), equal=False)


def _lifetimes(lives: Array, *, equal: bool) -> Forecast:
    def ask(run: LearnedRun, place: int) -> Array | None:
        longer = np.sort(lives[lives > run.t[place]])
        if not longer.size:
            return doubling(run, place)
        weights = np.cumsum(np.ones(longer.size) if equal else 1.0 / longer)
        return longer[np.searchsorted(weights / weights[-1], LEVELS * (1.0 - 1e-12))] - run.t[place]

    return ask


def exponential(others: Sequence[LearnedRun], *, empirical: bool) -> Forecast:
    """A Bayesian exponential degradation model, as MATLAB's exponentialDegradationModel (Gebraeel et al., 2005).

    RMS over the baseline less 1 is theta exp(beta t + error): ln theta and beta are normal and updated by all blocks so
    far. The end is where the median end level of the other runs is reached. The prior is vague (MATLAB's default), or,
    ``empirical``, the means and covariance of least-squares fits of the other runs in their own life, with beta times
    the life; beta is drawn positive, and TT at most 1e9 s.
    """
    fits = np.array([_line(run) for run in others])
    threshold = math.log(max(math.exp(float(np.median([run.end_level for run in others]))) - 1.0, 0.1))
    noise = float(np.median(fits[:, 2]))
    typical = float(np.exp(np.mean([math.log(run.life) for run in others])))
    mean, prior = np.array([0.0, 1.0]), np.diag([1e-6, 1e-6])
    if empirical:
        rates = fits[:, :2].copy()
        rates[:, 1] *= typical / np.array([run.life for run in others])
        mean, prior = rates.mean(axis=0), np.linalg.inv(np.cov(rates.T) + 1e-3 * np.eye(2))

    def ask(run: LearnedRun, place: int) -> Array | None:
        x = run.t[: place + 1] / typical
        y = _excess(run)[: place + 1]
        design = np.stack((np.ones_like(x), x), axis=1)
        precision = prior + design.T @ design / noise
        covariance = np.linalg.inv(precision)
        centre = covariance @ (prior @ mean + design.T @ y / noise)
        draws = np.random.default_rng(place).multivariate_normal(centre, covariance, _DRAWS)
        draws = draws[draws[:, 1] > 0.0]
        if len(draws) < 20:
            return np.full(LEVELS.size, _LONGEST)
        left = typical * ((threshold - draws[:, 0]) / draws[:, 1] - x[-1])
        return np.quantile(np.clip(left, 0.0, _LONGEST), LEVELS)

    return ask


def _excess(run: LearnedRun) -> Array:
    """Return ln(RMS / baseline - 1), at least that of 5 %."""
    return np.log(np.maximum(np.exp(run.ln_rms - run.ln_baseline) - 1.0, 0.05))


def _line(run: LearnedRun) -> tuple[float, float, float]:
    """Return intercept, slope over the life, and variance of the least-squares line through the excess."""
    x, y = run.t / run.life, _excess(run)
    slope, intercept = np.polyfit(x, y, 1)
    return float(intercept), float(slope), float(np.var(y - intercept - slope * x, ddof=2))


def opponents(others: Sequence[LearnedRun]) -> dict[str, Forecast]:
    """Return all forecasts by name, fitted on some runs."""
    return {
        "learned": learned(fit_runs(others)),
        "as long again (doubling)": doubling,
        "climatology": climatology(others),
        "elapsed time alone": elapsed_alone(others),
        "exponential, vague prior": exponential(others, empirical=False),
        "exponential, empirical prior": exponential(others, empirical=True),
    }
