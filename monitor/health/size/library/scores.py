"""Scores of a library on lives outside the training folds: V_eq, TT, the probability of no growth, climatology."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from monitor.health.size.library.model import NO_GROWTH, OFFSET, Array, FeatureFit, quantiles_of

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
