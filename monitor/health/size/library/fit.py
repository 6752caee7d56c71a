"""Fit of the library forecaster on simulated lives, with errors out of fold.

Each life is read block by block into the history that a monitor would have; at some blocks, before and after the
crossing, its summary is taken. A ridge regression on the summaries gives ln V_eq, ln(TT + offset) and whether V_eq
stands still. Lives are split into folds; the errors of fits on the other folds are the measure of uncertainty.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from monitor.health.size.library.model import (
    LINES,
    NO_GROWTH,
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
from monitor.health.size.library.plausible import fit_limits
from monitor.health.size.library.summaries import LevelHistory

_REFERENCE_RIDGE = 1e-2
POOL = {"rms": 0.1, "rms+harmonics": 0.05, "v_eq": 0.05}
"""Share of lifetimes in a sample of TT, found beside ``acceleration.ACCELERATION``."""
STANDSTILL_BLOCKS, STANDSTILL_GROWTH = 12, 1e-3
"""V_eq stands still where it grows by less than this share within so many blocks to come."""
_MIN_AHEAD = 6


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


def fit_library(
    lives: Sequence[TrainingLife],
    *,
    thresholds: Sequence[float],
    interval: float,
    prior: str,
    made_of: Mapping[str, Any],
    settings: FitSettings | None = None,
    features: Sequence[str] = tuple(LINES),
) -> Library:
    """Fit the forecaster on lives, for sets of features, and score it out of fold.

    Args:
        lives: at least two per fold that reach the largest threshold. Those that never reach it are counted, and tell
            of V_eq and of a standstill, not of TT. What a life has as ``tracked`` stands for V_eq as it is tracked in
            histories of V_eq; else it is the true one.
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
    used = [life for life in lives if len(life.t)]
    crossings = np.array([[life.crossing(v) for v in thresholds] for life in used]).reshape(-1, len(thresholds))
    reached = int(np.count_nonzero(np.isfinite(crossings[:, -1])))
    if reached < 2 * settings.folds:
        raise ValueError(
            f"lives: at least {2 * settings.folds} must reach the largest threshold, "
            f"{thresholds[-1] * 1e6:g} mm2; {reached} of {len(lives)} do"
        )
    fits: dict[str, FeatureFit] = {}
    scores: dict[str, Any] = {"no_growth": {}}
    for name in features:
        fits[name], table, predicted = _fit_features(name, used, thresholds, interval, settings)
        scores[name] = score(fits[name], table, predicted, thresholds)
        scores["no_growth"][name] = score_no_growth(fits[name], settings.seed)
    scores["climatology"] = score_climatology(thresholds, crossings)
    return Library(
        thresholds=thresholds,
        load=_range([life.load for life in used]),
        speed=_range([life.speed for life in used]),
        load_spread=max(float(np.log(life.load).std()) for life in used),
        speed_spread=max(float(np.log(life.speed).std()) for life in used),
        prior=prior,
        made_of={
            **made_of,
            "lives": len(used),
            "never_reached": len(used) - reached,
            "left_out": len(lives) - len(used),
            "fit": vars(settings),
        },
        scores=scores,
        fits=fits,
        calibration={},
    )


def _range(arrays: Sequence[Array]) -> tuple[float, float]:
    return float(min(a.min() for a in arrays)), float(max(a.max() for a in arrays))


def _fit_features(
    features: str, lives: Sequence[TrainingLife], thresholds: tuple[float, ...], interval: float, settings: FitSettings
) -> tuple[FeatureFit, Moments, Array]:
    """Return the fit for a set of features, its moments, and their predictions out of fold."""
    levels = [levels_of(features, life.rms, life.harmonics, getattr(life, "tracked", life.v_eq)) for life in lives]
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
    targets = 2 + len(thresholds)
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
        crossed=np.zeros((0, targets - 2), dtype=bool),
        standing=np.zeros(0, dtype=bool),
        lifetimes=np.array([[life.crossing(v) - float(life.t[0]) for v in thresholds] for life in lives]),
        pool=np.full(targets - 2, POOL[features]),
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
        standing=table.standing[fitted],
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
) -> Moments:
    """Take the summaries of all lives at random moments and at the scored ones."""
    rows: list[tuple[Array, list[float], list[bool], bool, int, int]] = []
    for number, (life, values) in enumerate(zip(lives, relative, strict=True)):
        draw = np.random.default_rng([settings.seed, 2, number])
        blocks = len(life.t)
        wanted: dict[int, list[int]] = {}
        for block in draw.choice(blocks, min(settings.moments, blocks), replace=False):
            wanted.setdefault(int(block), []).append(-1)
        crossings = [life.crossing(threshold) for threshold in thresholds]
        stands = stands_still(life.v_eq)
        for trial, (crossing, share) in enumerate((c, s) for c in crossings for s in SHARES):
            if not math.isfinite(crossing):
                continue
            block = int(np.searchsorted(life.t, share * crossing, side="right")) - 1
            wanted.setdefault(max(block, 0), []).append(trial)
        history = LevelHistory.empty(fit.channels)
        for block in range(max(wanted) + 1):
            history = history.add(float(life.t[block]), values[block])
            if block not in wanted:
                continue
            left = [max(crossing - float(life.t[block]), 0.0) for crossing in crossings]
            ln_tt = (math.log(tt / fit.interval + OFFSET) if math.isfinite(tt) else math.nan for tt in left)
            targets = [math.log(life.v_eq[block]), *ln_tt, float(stands[block])]
            x = fit.inputs(history, float(life.load[block]), float(life.speed[block]))
            crossed = [tt == 0.0 for tt in left]
            rows += [(x, targets, crossed, bool(stands[block]), number, trial) for trial in wanted[block]]
    x, y, crossed, standing, life_numbers, trial = zip(*rows, strict=True)
    return Moments(
        x=np.array(x),
        y=np.array(y),
        crossed=np.array(crossed),
        standing=np.array(standing),
        life=np.array(life_numbers),
        trial=np.array(trial),
    )


def stands_still(v_eq: Array) -> NDArray[np.bool_]:
    """Return at which blocks of a life V_eq stands still, shape (n,).

    It is judged over the blocks to come, over the last ones where the life ends before.
    """
    last = len(v_eq) - 1
    place = np.arange(len(v_eq))
    ahead = np.minimum(place + STANDSTILL_BLOCKS, last)
    behind = np.where(ahead - place >= _MIN_AHEAD, place, np.maximum(last - STANDSTILL_BLOCKS, 0))
    limit = (1.0 + STANDSTILL_GROWTH) ** ((ahead - behind) / STANDSTILL_BLOCKS)
    return (v_eq[ahead] < limit * v_eq[behind]) & (ahead > behind)


def fit_regression(
    x: Array, y: Array, fold: NDArray[np.int64], fitted: NDArray[np.bool_], settings: FitSettings
) -> tuple[Regression, Array]:
    """Fit on all rows, and predict each row by a fit on the other folds.

    Args:
        x: inputs, shape (n, d).
        y: targets, shape (n, k), as the predictions; rows in which one is NaN take no part in the fit of it.
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
    predicted, coefficients = np.empty(y.shape), regression.coefficients
    known, kinds = np.unique(np.isfinite(y), axis=1, return_inverse=True)
    for kind, usable in enumerate(known.T):
        columns = np.flatnonzero(kinds.ravel() == kind)
        parts = [np.flatnonzero(fitted & usable & (fold == number)) for number in range(settings.folds)]
        grams = [design[part].T @ design[part] for part in parts]
        moments = [design[part].T @ y[np.ix_(part, columns)] for part in parts]
        gram, moment = np.sum(grams, axis=0) + np.diag(penalty), np.sum(moments, axis=0)
        for number, (own_gram, own_moment) in enumerate(zip(grams, moments, strict=True)):
            own = np.flatnonzero(fold == number)
            predicted[np.ix_(own, columns)] = design[own] @ np.linalg.solve(gram - own_gram, moment - own_moment)
        coefficients[:, columns] = np.linalg.solve(gram, moment)
    return regression, predicted


SHARES = (0.25, 0.5, 0.75)
"""Shares of the time to the crossing at which unseen lives are scored."""
SCORED_LEVEL = 0.8
"""Level of the scored intervals."""
_SCORED_NEIGHBOURS = 300
_MAX_SCORED = 2000


@dataclass(frozen=True, eq=False)
class Moments:
    """Moments of lives: inputs, targets, and the score (threshold and share) of each, -1 for the fit."""

    x: Array
    y: Array
    crossed: NDArray[np.bool_]
    standing: NDArray[np.bool_]
    life: NDArray[np.int64]
    trial: NDArray[np.int64]


def crps(sample: Array, truth: float) -> float:
    """Return the continuous ranked probability score of an ascending sample, in the unit of the truth."""
    n = len(sample)
    weights = 2.0 * np.arange(1, n + 1) - n - 1.0
    return float(np.abs(sample - truth).mean() - weights @ sample / (n * n))


def score(fit: FeatureFit, table: Moments, predicted: Array, thresholds: tuple[float, ...]) -> dict[str, Any]:
    """Score the predictions for unseen lives at shares of their time to each threshold."""
    ends = [(1.0 - SCORED_LEVEL) / 2.0, 0.5, (1.0 + SCORED_LEVEL) / 2.0]
    scores: dict[str, Any] = {}
    for trial, (index, share) in enumerate((i, s) for i in range(len(thresholds)) for s in SHARES):
        found: list[tuple[bool, float, bool, float]] = []
        for row in np.flatnonzero(table.trial == trial):
            life, ln_elapsed = int(table.life[row]), float(table.x[row, 0])
            count, target = _SCORED_NEIGHBOURS, index + 1
            v_eq = fit.sample_v_eq(float(predicted[row, 0]), ln_elapsed, float(predicted[row, -1]), count, life)
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


def score_no_growth(fit: FeatureFit, seed: int) -> dict[str, float]:
    """Score the probability of no growth at moments of unseen lives: Brier score, and how often half is exceeded."""
    rows = np.random.default_rng([seed, 4]).permutation(len(fit.standing))[:_MAX_SCORED]
    found = [fit.p_no_growth(float(fit.said[r, -1]), _SCORED_NEIGHBOURS, int(fit.life[r])) for r in rows]
    p, stood = np.array(found), fit.standing[rows]
    said = p >= NO_GROWTH
    return {
        "share": float(stood.mean()),
        "brier": float(np.mean((p - stood) ** 2)),
        "found": float(np.mean(said[stood])) if stood.any() else 0.0,
        "false": float(np.mean(said[~stood])) if not stood.all() else 0.0,
    }


def score_climatology(thresholds: tuple[float, ...], crossings: Array) -> dict[str, Any]:
    """Score, at the same moments, the remaining lifetimes of the other lives still running."""
    scores: dict[str, Any] = {}
    for threshold, times in zip(thresholds, crossings.T, strict=True):
        times = times[np.isfinite(times)]
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
