"""Fit of the library forecaster on simulated lives, with errors out of fold.

Each life is read block by block into the history that a monitor would have; at some blocks, before and after the
crossing, its summary is taken. A ridge regression on the summaries gives ln V_eq and ln(TT + offset). Lives are split
into folds; the errors of fits on the other folds are the measure of uncertainty.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from monitor.health.damage.library.model import (
    LINES,
    OFFSET,
    Array,
    FeatureFit,
    Library,
    Regression,
    conditions_row,
    knots_between,
    levels_of,
    quantiles_of,
)
from monitor.health.damage.library.plausible import fit_limits
from monitor.health.damage.library.summaries import LevelHistory

SHARES = (0.25, 0.5, 0.75)
"""Shares of the time to the crossing at which unseen lives are scored."""
SCORED_LEVEL = 0.8
"""Level of the scored intervals."""
_SCORED_NEIGHBOURS = 300
_REFERENCE_RIDGE = 1e-2


class TrainingLife(Protocol):
    """Inputs of the fit; ``models.lives.life.LifeHistory`` provides them."""

    @property
    def t(self) -> Array:
        """Times from the onset, s, shape (n,)."""
        ...

    @property
    def load(self) -> Array:
        """Radial load, N, shape (n,)."""
        ...

    @property
    def speed(self) -> Array:
        """Shaft speed, Hz, shape (n,)."""
        ...

    @property
    def rms(self) -> Array:
        """Measured RMS, m/s2, shape (n,)."""
        ...

    @property
    def harmonics(self) -> Array:
        """Measured lines of BPFO, m/s2, shape (n, 6)."""
        ...

    @property
    def v_eq(self) -> Array:
        """True V_eq, m2, shape (n,)."""
        ...

    def crossing(self, threshold: float) -> float:
        """Return the time at which V_eq reaches a threshold (m2), s; inf where it never does."""
        ...


@dataclass(frozen=True)
class FitSettings:
    """Settings of the fit.

    Attributes:
        seed: of the folds, of the moments and of the random features.
        folds: parts into which the lives are split.
        moments: blocks of each life at which its summary is taken.
        columns: random features.
        bandwidth: standard deviation of their frequencies times the root of the number of inputs.
        ridge: penalty on all coefficients but the constant, for standardised inputs.
    """

    seed: int = 0
    folds: int = 5
    moments: int = 16
    columns: int = 600
    bandwidth: float = 0.5
    ridge: float = 30.0

    def __post_init__(self) -> None:
        """Raise ValueError for a split or a fit that cannot be made."""
        if self.folds < 2 or self.moments < 1 or self.columns < 1 or not self.ridge > 0.0:
            raise ValueError(f"folds must be 2 or more, moments and columns 1 or more, ridge positive, got {self}")


@dataclass(frozen=True, eq=False)
class _Table:
    """Moments of lives: inputs, targets, and the score (threshold and share) of each, -1 for the fit."""

    x: Array
    y: Array
    crossed: NDArray[np.bool_]
    life: NDArray[np.int64]
    trial: NDArray[np.int64]


def fit_library(
    lives: Sequence[TrainingLife],
    *,
    thresholds: Sequence[float],
    interval: float,
    prior: str,
    made_of: Mapping[str, Any],
    settings: FitSettings | None = None,
) -> Library:
    """Fit the forecaster on lives, for all sets of features, and score it out of fold.

    Args:
        lives: at least two per fold. Those that never reach the largest threshold are left out, and counted.
        thresholds: V_th, m2.
        interval: usual block interval, s.
        prior: assumptions of the library, as text.
        made_of: all inputs of the lives, as plain values for JSON; kept with the library.

    Raises:
        ValueError: no thresholds, or too few lives that reach them.
    """
    settings = settings or FitSettings()
    thresholds = tuple(sorted(set(map(float, thresholds))))
    if not thresholds or not all(math.isfinite(v) and v > 0.0 for v in thresholds):
        raise ValueError(f"thresholds must be one or more positive volumes, got {list(thresholds)}")
    used = [life for life in lives if len(life.t) and math.isfinite(life.crossing(thresholds[-1]))]
    if len(used) < 2 * settings.folds:
        raise ValueError(
            f"lives: at least {2 * settings.folds} must reach the largest threshold, "
            f"{thresholds[-1] * 1e6:g} mm2; {len(used)} of {len(lives)} do"
        )
    crossings = np.array([[life.crossing(v) for v in thresholds] for life in used])
    fits: dict[str, FeatureFit] = {}
    scores: dict[str, Any] = {}
    for features in LINES:
        fits[features], table, predicted = _fit_features(features, used, thresholds, interval, settings)
        scores[features] = _score(fits[features], table, predicted, thresholds)
    scores["climatology"] = _climatology(thresholds, crossings)
    return Library(
        thresholds=thresholds,
        load=_range([life.load for life in used]),
        speed=_range([life.speed for life in used]),
        load_spread=max(float(np.log(life.load).std()) for life in used),
        speed_spread=max(float(np.log(life.speed).std()) for life in used),
        prior=prior,
        made_of={**made_of, "lives": len(used), "left_out": len(lives) - len(used), "fit": vars(settings)},
        scores=scores,
        fits=fits,
        calibration={},
    )


def _range(arrays: Sequence[Array]) -> tuple[float, float]:
    return float(min(a.min() for a in arrays)), float(max(a.max() for a in arrays))


def _fit_features(
    features: str, lives: Sequence[TrainingLife], thresholds: tuple[float, ...], interval: float, settings: FitSettings
) -> tuple[FeatureFit, _Table, Array]:
    """Return the fit for a set of features, its moments, and their predictions out of fold."""
    levels = [levels_of(features, life.rms, life.harmonics, life.v_eq) for life in lives]
    every = np.concatenate(levels)
    load, speed = (np.concatenate([getattr(life, name) for life in lives]) for name in ("load", "speed"))
    knots = knots_between(float(speed.min()), float(speed.max()))
    conditions = conditions_row(load, speed, knots)
    reference = np.zeros((conditions.shape[1], every.shape[1]))
    if features != "v_eq":
        # Damage is a regressor so that its effect is not attributed to load or speed.
        ln_v = np.log(np.concatenate([life.v_eq for life in lives]) / thresholds[0])[:, None]
        design = np.concatenate((conditions, ln_v, ln_v**2), axis=1)
        gram = design.T @ design + _REFERENCE_RIDGE * np.eye(design.shape[1])
        solution = np.linalg.solve(gram, design.T @ every)
        reference = np.asarray(solution[: conditions.shape[1]], dtype=np.float64)
    relative = every if features == "v_eq" else every - conditions @ reference
    targets = 1 + len(thresholds)
    blank = FeatureFit(
        features=features,
        interval=interval,
        thresholds=np.array(thresholds),
        knots=knots,
        reference=reference,
        lowest=relative.min(axis=0),
        highest=relative.max(axis=0),
        longest=max(float(life.t[-1] - life.t[0]) for life in lives),
        regression=Regression(*(np.zeros(0) for _ in range(5))),
        said=np.zeros((0, targets)),
        error=np.zeros((0, targets)),
        crossed=np.zeros((0, targets - 1), dtype=bool),
        ln_elapsed=np.zeros(0),
        life=np.zeros(0, dtype=np.int64),
        shift=np.zeros(targets),
        stretch=np.ones(targets),
    )
    parts = np.split(relative, np.cumsum([len(life.t) for life in lives])[:-1])
    if features != "v_eq":
        blank = replace(blank, limits=fit_limits([life.t for life in lives], parts, interval))
    table = _table(blank, lives, parts, thresholds, settings)
    draw = np.random.default_rng([settings.seed, 1])
    fold = draw.permutation(len(lives))[table.life] % settings.folds
    regression, predicted = fit_regression(table.x, table.y, fold, table.trial < 0, settings)
    fitted = table.trial < 0
    fit = replace(
        blank,
        regression=regression,
        said=predicted[fitted],
        error=(table.y - predicted)[fitted],
        crossed=table.crossed[fitted],
        ln_elapsed=table.x[fitted, 0],
        life=table.life[fitted],
    )
    return fit, table, predicted


def _table(
    fit: FeatureFit,
    lives: Sequence[TrainingLife],
    relative: Sequence[Array],
    thresholds: tuple[float, ...],
    settings: FitSettings,
) -> _Table:
    """Take the summaries of all lives at random moments and at the scored ones."""
    rows: list[tuple[Array, list[float], list[bool], int, int]] = []
    for number, (life, values) in enumerate(zip(lives, relative, strict=True)):
        draw = np.random.default_rng([settings.seed, 2, number])
        blocks = len(life.t)
        wanted: dict[int, list[int]] = {}
        for block in draw.choice(blocks, min(settings.moments, blocks), replace=False):
            wanted.setdefault(int(block), []).append(-1)
        crossings = [life.crossing(threshold) for threshold in thresholds]
        for trial, (crossing, share) in enumerate((c, s) for c in crossings for s in SHARES):
            block = int(np.searchsorted(life.t, share * crossing, side="right")) - 1
            wanted.setdefault(max(block, 0), []).append(trial)
        history = LevelHistory.empty(fit.channels)
        for block in range(max(wanted) + 1):
            history = history.add(float(life.t[block]), values[block])
            if block not in wanted:
                continue
            left = [max(crossing - float(life.t[block]), 0.0) for crossing in crossings]
            targets = [math.log(life.v_eq[block]), *(math.log(tt / fit.interval + OFFSET) for tt in left)]
            x = fit.inputs(history, float(life.load[block]), float(life.speed[block]))
            rows += [(x, targets, [tt == 0.0 for tt in left], number, trial) for trial in wanted[block]]
    x, y, crossed, life_numbers, trial = zip(*rows, strict=True)
    return _Table(
        x=np.array(x),
        y=np.array(y),
        crossed=np.array(crossed),
        life=np.array(life_numbers),
        trial=np.array(trial),
    )


def fit_regression(
    x: Array, y: Array, fold: NDArray[np.int64], fitted: NDArray[np.bool_], settings: FitSettings
) -> tuple[Regression, Array]:
    """Fit on all rows, and predict each row by a fit on the other folds.

    Args:
        x: inputs, shape (n, d).
        y: targets, shape (n, k), as the predictions.
        fold: fold of each row, from 0, shape (n,).
        fitted: rows used in the fits; the others are only predicted, shape (n,).
    """
    draw = np.random.default_rng([settings.seed, 3])
    inputs = x.shape[1]
    spread = x[fitted].std(axis=0)
    regression = Regression(
        centre=x[fitted].mean(axis=0),
        scale=np.where(spread > 1e-9, spread, 1.0),
        weights=draw.normal(0.0, settings.bandwidth / math.sqrt(inputs), (inputs, settings.columns)),
        phases=draw.uniform(0.0, 2.0 * math.pi, settings.columns),
        coefficients=np.zeros((1 + inputs + settings.columns, y.shape[1])),
    )
    design = regression.design(x)
    penalty = np.full(design.shape[1], settings.ridge)
    penalty[0] = 1e-6
    parts = [np.flatnonzero(fitted & (fold == number)) for number in range(settings.folds)]
    grams = [design[part].T @ design[part] for part in parts]
    moments = [design[part].T @ y[part] for part in parts]
    gram, moment = np.sum(grams, axis=0) + np.diag(penalty), np.sum(moments, axis=0)
    predicted = np.empty(y.shape)
    for number, (own_gram, own_moment) in enumerate(zip(grams, moments, strict=True)):
        own = fold == number
        predicted[own] = design[own] @ np.linalg.solve(gram - own_gram, moment - own_moment)
    return replace(regression, coefficients=np.linalg.solve(gram, moment)), predicted


def crps(sample: Array, truth: float) -> float:
    """Return the continuous ranked probability score of an ascending sample, in the unit of the truth."""
    n = len(sample)
    weights = 2.0 * np.arange(1, n + 1) - n - 1.0
    return float(np.abs(sample - truth).mean() - weights @ sample / (n * n))


def _score(fit: FeatureFit, table: _Table, predicted: Array, thresholds: tuple[float, ...]) -> dict[str, Any]:
    """Score the predictions for unseen lives at shares of their time to each threshold."""
    ends = [(1.0 - SCORED_LEVEL) / 2.0, 0.5, (1.0 + SCORED_LEVEL) / 2.0]
    scores: dict[str, Any] = {}
    for trial, (index, share) in enumerate((i, s) for i in range(len(thresholds)) for s in SHARES):
        found: list[tuple[bool, float, bool, float]] = []
        for row in np.flatnonzero(table.trial == trial):
            life, ln_elapsed = int(table.life[row]), float(table.x[row, 0])
            count, target = _SCORED_NEIGHBOURS, index + 1
            v_eq = fit.sample_v_eq(float(predicted[row, 0]), ln_elapsed, count, life)
            tt = fit.sample_tt(target, float(predicted[row, target]), ln_elapsed, count, life)
            true_v, true_tt = math.exp(table.y[row, 0]), (math.exp(table.y[row, target]) - OFFSET) * fit.interval
            low_v, median_v, high_v = quantiles_of(v_eq, ends)
            low, _, high = quantiles_of(tt, ends)
            found.append(
                (
                    low_v <= true_v <= high_v,
                    math.log(median_v / true_v) ** 2,
                    low <= true_tt <= high,
                    crps(tt, true_tt),
                )
            )
        v_coverage, v_square, coverage, score = np.mean(np.array(found, dtype=float), axis=0)
        scores.setdefault(f"{thresholds[index] * 1e6:g}", {})[f"{share:g}"] = {
            "v_eq_coverage": float(v_coverage),
            "v_eq_rms_ln_error": math.sqrt(float(v_square)),
            "coverage": float(coverage),
            "crps_s": float(score),
        }
    return scores


def _climatology(thresholds: tuple[float, ...], crossings: Array) -> dict[str, Any]:
    """Score, at the same moments, the remaining lifetimes of the other lives still running."""
    scores: dict[str, Any] = {}
    for threshold, times in zip(thresholds, crossings.T, strict=True):
        ascending = np.sort(times)
        for share in SHARES:
            found: list[float] = []
            for crossing in times:
                now = share * crossing
                others = np.delete(ascending, ascending.searchsorted(float(crossing)))
                left = others[others > now] - now
                found.append(crps(left, crossing - now) if len(left) else crossing - now)
            scores.setdefault(f"{threshold * 1e6:g}", {})[f"{share:g}"] = {"crps_s": float(np.mean(found))}
    return scores
