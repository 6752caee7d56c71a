"""The (run, moment) pairs of ``forecast.methods``, what a method answers to them, and how answers are
scored.

Every figure is a mean over runs of one value a run and moment: never pooled over the blocks of a run, which all share
one life, one floor and one set of gains.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.forecast.population import FRACTIONS, THRESHOLD
from models.lives.life import LifeHistory
from monitor.health.size.library.forecaster import QUANTILES
from monitor.report.score.metrics import Mean, crps_from_quantiles, mean_over_runs

Floats = NDArray[np.float64]

LEVEL = 0.8
"""Level of the intervals."""
LEVELS = np.array(QUANTILES)
"""Levels of the quantiles by which forecasts are scored, those of the archive."""
WORST = 1500.0 * 60.0
"""Errors of TT count as this at most, s, so that one wild root does not make the mean of a method."""


@dataclass(frozen=True, eq=False)
class Cases:
    """Runs and moments: arrays of shape (runs, moments) unless said.

    Attributes:
        runs: the lives.
        blocks: how many blocks of its run are known.
        t: time of the last of them since the onset, s.
        v_eq: true V_eq in it, m2.
        tt: true time from it to the threshold, s.
        law: growth law, shape (runs,).
    """

    runs: Sequence[LifeHistory]
    blocks: NDArray[np.int64]
    t: Floats
    v_eq: Floats
    tt: Floats
    law: NDArray[np.str_]


def cases_of(runs: Sequence[LifeHistory]) -> Cases:
    """Return the moments of lives: the last block before each share of the time to the threshold."""
    ends = np.array([run.crossing(THRESHOLD) for run in runs])
    blocks = np.array(
        [
            [max(1, int(np.searchsorted(run.t, share * end, side="right"))) for share in FRACTIONS]
            for run, end in zip(runs, ends, strict=True)
        ]
    )
    t = np.array([run.t[known - 1] for run, known in zip(runs, blocks, strict=True)])
    v_eq = np.array([run.v_eq[known - 1] for run, known in zip(runs, blocks, strict=True)])
    return Cases(runs, blocks, t, v_eq, ends[:, None] - t, np.array([run.law for run in runs]))


@dataclass(frozen=True, eq=False)
class Answers:
    """What a method says of all cases; NaN where it says nothing. Shapes (runs, moments), of quantiles with ``LEVELS``.

    Attributes:
        v_eq: median (or the only) V_eq, m2.
        v_lower: lower end of the interval of V_eq, m2; NaN for a method without intervals.
        v_upper: upper end of it, m2.
        tt: quantiles of the time to threshold, s, shape (runs, moments, levels), or (runs, moments, 1) for one number.
    """

    v_eq: Floats
    v_lower: Floats
    v_upper: Floats
    tt: Floats


def no_volume(shape: tuple[int, ...]) -> tuple[Floats, Floats, Floats]:
    """Return V_eq and interval of a method that forecasts without one."""
    return np.full(shape, np.nan), np.full(shape, np.nan), np.full(shape, np.nan)


def only_time(tt: Floats) -> Answers:
    """Return the answers of a method that says nothing of V_eq."""
    return Answers(*no_volume(tt.shape[:2]), tt if tt.ndim == 3 else tt[..., None])


def only_volume(v_eq: Floats, v_lower: Floats, v_upper: Floats) -> Answers:
    """Return the answers of a method that forecasts nothing."""
    return Answers(v_eq, v_lower, v_upper, np.full((*v_eq.shape, 1), np.nan))


def crps(quantiles: Floats, truth: Floats) -> Floats:
    """Return the continuous ranked probability score of forecasts; of a single number it is the absolute error.

    Args:
        quantiles: at ``LEVELS``, shape (runs, moments, levels), or (runs, moments, 1) for a forecast of one number.
        truth: shape (runs, moments).
    """
    count = quantiles.shape[-1]
    levels = [0.5] if count == 1 else LEVELS
    return crps_from_quantiles(levels, quantiles.reshape(-1, count), truth.ravel()).reshape(truth.shape)


def quantiles_of(sample: Floats) -> Floats:
    """Return the quantiles of a sample at ``LEVELS``."""
    return np.quantile(sample, LEVELS)


@dataclass(frozen=True, eq=False)
class Scores:
    """Scores of a method, shape (runs, moments).

    Attributes:
        error: CRPS of TT (of one number: the absolute error), missing answers scored as the constant guess, s; NaN for
            a method that forecasts nothing.
        tt_inside: 1 where TT lies in the interval, 0 where not, NaN without an interval.
        tt_width: width of the interval, s.
        v_error: ln of V_eq found over true, missing answers scored as the constant guess; NaN for a method that says
            nothing of V_eq.
        v_inside: 1 where V_eq lies in the interval, 0 where not, NaN without an interval.
        v_width: ln of the upper over the lower end.
        refused: 1 where there is no answer.
    """

    error: Floats
    tt_inside: Floats
    tt_width: Floats
    v_error: Floats
    v_inside: Floats
    v_width: Floats
    refused: Floats


def score(cases: Cases, answers: Answers, constant: Answers) -> Scores:
    """Return the scores of answers.

    Args:
        cases: the truth.
        answers: of the method.
        constant: what a missing answer is scored as.
    """
    missing = np.isnan(answers.tt).any(axis=-1)
    tail = 0.5 * (1.0 - LEVEL)
    lower, upper = _at(answers.tt, tail), _at(answers.tt, 1.0 - tail)
    error = np.where(missing, crps(constant.tt, cases.tt), crps(answers.tt, cases.tt))
    v_missing = ~(answers.v_eq > 0.0)
    v_said = np.where(v_missing, constant.v_eq, answers.v_eq)
    nothing = np.full(cases.t.shape, np.nan)
    return Scores(
        error=nothing if missing.all() else np.minimum(error, WORST),
        tt_inside=_inside(cases.tt, lower, upper),
        tt_width=upper - lower,
        v_error=nothing if v_missing.all() else np.log(v_said / cases.v_eq),
        v_inside=_inside(cases.v_eq, answers.v_lower, answers.v_upper),
        v_width=np.log(answers.v_upper / answers.v_lower),
        refused=missing.astype(float) if not missing.all() else v_missing.astype(float),
    )


def _at(quantiles: Floats, level: float) -> Floats:
    """Return one quantile, NaN of forecasts that are one number."""
    if quantiles.shape[-1] == 1:
        return np.full(quantiles.shape[:-1], np.nan)
    after = int(np.searchsorted(LEVELS, level))
    share = (level - LEVELS[after - 1]) / (LEVELS[after] - LEVELS[after - 1])
    return quantiles[..., after - 1] * (1.0 - share) + quantiles[..., after] * share


def _inside(truth: Floats, lower: Floats, upper: Floats) -> Floats:
    found = ((truth >= lower) & (truth <= upper)).astype(float)
    return np.where(np.isnan(lower) | np.isnan(upper), np.nan, found)


def means(values: Floats, chosen: NDArray[np.bool_] | None = None) -> list[Mean]:
    """Return the mean over (chosen) runs that have a value, and its standard error, at each moment."""
    rows = values if chosen is None else values[chosen]
    return [mean_over_runs(column.tolist()) for column in rows.T]
