"""How good forecasts were, once the end is known: pure functions on the arrays of one run.

Notation: r is the forecast time to the end and r* = end - t the true one, both times-to-event. An accuracy on absolute
times would depend on where the clock begins, and with UTC it is always near one. All times are seconds, on any clock.

A forecast is a row of quantiles at common levels. Its distribution function is linear between them, with the mass
beyond the outermost at them, so that one quantile at the level 0.5 is a point forecast. A missing answer is a row of
NaN. Unless stated otherwise, arrays have the shape (n,) or, for quantiles, (n, q); ``levels`` (q,) rise within (0, 1),
quantiles do not fall along them, and ValueError is raised where they do.

One run is one sample, because forecasts of one run are strongly correlated; see :func:`mean_over_runs`.

Sources: relative accuracy, alpha-lambda, prognostic horizon and convergence are those of Saxena, Celaya, Saha, Saha and
Goebel, International Journal of Prognostics and Health Management 1(1), 2010; the continuous ranked probability score
(CRPS) that of Gneiting and Raftery, Journal of the American Statistical Association 102, 2007, Eqs. 20-21.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class AlphaLambda:
    """Result of :func:`alpha_lambda`; time NaN and ``passed`` None where no forecast had been issued.

    Attributes:
        t: time of the judged forecast.
        mass: its probability of (1 - alpha) r* .. (1 + alpha) r*; 0 for no answer.
        passed: whether that is at least beta.
    """

    t: float
    mass: float
    passed: bool | None


@dataclass(frozen=True)
class Mean:
    """Mean of a figure over the runs that have it (NaN for none), and its standard error (NaN for fewer than two)."""

    mean: float
    standard_error: float
    runs: int


def relative_accuracy(predicted: ArrayLike, true: ArrayLike) -> Floats:
    """Return RA = 1 - |r - r*| / r* of each forecast (Saxena et al. 2010, section 4.3).

    ``predicted`` is r, ``true`` is r*. At most 1, without a lower bound; NaN for no answer or where r* is not positive.
    """
    r, r_true = np.asarray(predicted, dtype=np.float64), np.asarray(true, dtype=np.float64)
    ahead = r_true > 0
    return np.where(ahead, 1.0 - np.abs(r - r_true) / np.where(ahead, r_true, 1.0), np.nan)


def cumulative_relative_accuracy(predicted: ArrayLike, true: ArrayLike) -> float:
    """Return CRA, the mean of the relative accuracy over the answers (Saxena et al. 2010, section 4.3).

    Missing answers and times at or after the end are left out; NaN where nothing is left.
    """
    accuracy = relative_accuracy(predicted, true)
    kept = accuracy[np.isfinite(accuracy)]
    return float(kept.sum() / kept.size) if kept.size else math.nan


def probability_within(levels: ArrayLike, quantiles: ArrayLike, low: ArrayLike, high: ArrayLike) -> Floats:
    """Return the probability of low <= r <= high by each forecast, NaN for no answer."""
    p, rows = _checked(levels, quantiles)
    low, high = np.broadcast_to(low, rows.shape[:1]), np.broadcast_to(high, rows.shape[:1])
    mass = [
        _probability_up_to(p, row, float(b), "right") - _probability_up_to(p, row, float(a), "left")
        for row, a, b in zip(rows, low, high, strict=True)
    ]
    return np.array(mass, dtype=np.float64)


def _probability_up_to(p: Floats, row: Floats, x: float, side: Literal["left", "right"]) -> float:
    """Return P(r <= x), or with side "left" P(r < x), of one row of quantiles."""
    if not np.isfinite(row).all():
        return math.nan
    k = int(np.searchsorted(row, x, side=side))
    if k in (0, row.size):
        return float(k == row.size)
    share = (x - row[k - 1]) / (row[k] - row[k - 1])
    return float(p[k - 1] + share * (p[k] - p[k - 1]))


def alpha_lambda(
    t: ArrayLike,
    end: float,
    levels: ArrayLike,
    quantiles: ArrayLike,
    *,
    alpha: float = 0.2,
    lam: float = 0.5,
    beta: float = 0.5,
) -> AlphaLambda:
    """Judge the forecast valid at t_P + lam (end - t_P), t_P being the first of ``t`` (Saxena et al. 2010, 4.2).

    Args:
        t: times of the forecasts, rising.
        end: true end on the same clock.
        levels, quantiles: of r.
        alpha: half-width of the band as a share of r*.
        lam: share of the time from the first forecast to the end.
        beta: least probability within the band.
    """
    moments = np.asarray(t, dtype=np.float64)
    _, rows = _checked(levels, quantiles)
    if not moments.size or moments[0] >= end:
        return AlphaLambda(math.nan, 0.0, None)
    place = int(np.searchsorted(moments, moments[0] + lam * (end - moments[0]), side="right")) - 1
    left = end - float(moments[place])
    mass = float(probability_within(levels, rows[place : place + 1], (1 - alpha) * left, (1 + alpha) * left)[0])
    mass = mass if math.isfinite(mass) else 0.0
    return AlphaLambda(float(moments[place]), mass, mass >= beta)


def prognostic_horizon(
    t: ArrayLike, end: float, levels: ArrayLike, quantiles: ArrayLike, *, alpha: float = 0.2, beta: float = 0.5
) -> float:
    """Return the time before the end from which on all forecasts are good.

    Good is P[|r - r*| <= alpha (end - t_P)] >= beta (Saxena et al. 2010, section 4.1), but with a band relative to the
    time from the first forecast t_P, and for all later forecasts too; a missing answer is not good. Arguments as in
    :func:`alpha_lambda`. 0 s where the last forecast is not good; NaN without a forecast before the end.
    """
    moments = np.asarray(t, dtype=np.float64)
    _, rows = _checked(levels, quantiles)
    rows, moments = rows[moments < end], moments[moments < end]
    if not moments.size:
        return math.nan
    half = alpha * (end - moments[0])
    good = probability_within(levels, rows, end - moments - half, end - moments + half) >= beta
    bad = np.flatnonzero(~good)
    first = 0 if not bad.size else int(bad[-1]) + 1
    return float(end - moments[first]) if first < moments.size else 0.0


def convergence(t: ArrayLike, error: ArrayLike, end: float) -> float:
    """Return the distance from (t_P, 0) to the centroid of the area under the error curve (s); smaller is faster.

    Saxena et al. 2010, section 4.4, with M constant from each answer to the next. 0 where all errors are zero; NaN
    without an answer before the end.

    Args:
        t: times of the forecasts, rising; the first is t_P.
        error: M = |r - r*|, s, or another non-negative error; NaN is left out.
        end: true end on the same clock.
    """
    moments, m = np.asarray(t, dtype=np.float64), np.asarray(error, dtype=np.float64)
    kept = np.isfinite(m) & (moments < end)
    if not kept.any():
        return math.nan
    begin = moments[kept] - moments[0]
    m = m[kept]
    steps = np.diff(begin, append=end - moments[0])
    area = float((steps * m).sum())
    if area == 0:
        return 0.0
    x = 0.5 * float(((steps + 2 * begin) * steps * m).sum()) / area
    y = 0.5 * float((steps * m**2).sum()) / area
    return math.hypot(x, y)


def crps_from_quantiles(levels: ArrayLike, quantiles: ArrayLike, true: ArrayLike) -> Floats:
    """Return the CRPS of each forecast (s): the integral of (F(x) - 1[x >= y])^2 over x, exact for this module's F.

    ``true`` is y. For a point forecast it is the absolute error; NaN for no answer. It depends on the levels, so that
    methods must be compared at the same ones.
    """
    p, rows = _checked(levels, quantiles)
    y = np.broadcast_to(np.asarray(true, dtype=np.float64), rows.shape[:1])
    score = np.maximum(rows[:, 0] - y, 0.0) + np.maximum(y - rows[:, -1], 0.0)
    for i in range(p.size - 1):
        a, b = rows[:, i], rows[:, i + 1]
        width = b - a
        m = np.clip(y, a, b)
        p_m = p[i] + (p[i + 1] - p[i]) * np.where(width > 0, (m - a) / np.where(width > 0, width, 1.0), 0.0)
        score = score + (m - a) * _mean_square(p[i], p_m) + (b - m) * _mean_square(p_m - 1.0, p[i + 1] - 1.0)
    return score


def _mean_square(a: Floats | float, b: Floats | float) -> Floats | float:
    """Return the mean square of a line from a to b."""
    return (a * a + a * b + b * b) / 3.0


def coverage(lower: ArrayLike, upper: ArrayLike, true: ArrayLike) -> float:
    """Return the share of intervals that contain the truth, without missing intervals; NaN where all are missing.

    Within one run it is often 0 or 1; its mean over runs is informative.
    """
    low, high, y = (np.asarray(values, dtype=np.float64) for values in (lower, upper, true))
    given = np.isfinite(low) & np.isfinite(high) & np.isfinite(y)
    return float(((low <= y) & (y <= high))[given].mean()) if given.any() else math.nan


def mean_width(lower: ArrayLike, upper: ArrayLike) -> float:
    """Return the mean width of intervals, without missing ones; NaN where all are missing."""
    width = np.asarray(upper, dtype=np.float64) - np.asarray(lower, dtype=np.float64)
    width = width[np.isfinite(width)]
    return float(width.mean()) if width.size else math.nan


def onset_delay(known: float, onset: float) -> float:
    """Return the delay from the onset to its detection at ``known`` (NaN: missed).

    NaN for a miss, and for a detection before the onset, which is a false alarm.
    """
    return known - onset if known >= onset else math.nan


def false_alarms_per_1000(alarms: ArrayLike, healthy: int, onset: float) -> float:
    """Return the alarms before the onset per 1000 blocks; NaN without a block.

    ``alarms`` are their times; ``healthy`` is the number of blocks before the onset that the detector judged.
    """
    early = int((np.asarray(alarms, dtype=np.float64) < onset).sum())
    return 1000.0 * early / healthy if healthy > 0 else math.nan


def mean_over_runs(values: Sequence[float]) -> Mean:
    """Return the mean of one figure per run and its standard error, without NaN."""
    kept = np.array([value for value in values if math.isfinite(value)], dtype=np.float64)
    if not kept.size:
        return Mean(math.nan, math.nan, 0)
    error = float(kept.std(ddof=1) / math.sqrt(kept.size)) if kept.size > 1 else math.nan
    return Mean(float(kept.mean()), error, int(kept.size))


def _checked(levels: ArrayLike, quantiles: ArrayLike) -> tuple[Floats, Floats]:
    p, rows = np.asarray(levels, dtype=np.float64), np.asarray(quantiles, dtype=np.float64)
    if p.ndim != 1 or not p.size or p[0] <= 0 or p[-1] >= 1 or (np.diff(p) <= 0).any():
        raise ValueError(f"levels must rise within (0, 1), got {p.tolist()}")
    if rows.ndim != 2 or rows.shape[1] != p.size:
        raise ValueError(f"quantiles must have the shape (n, {p.size}), got {rows.shape}")
    if (np.diff(rows, axis=1) < 0).any():
        raise ValueError("quantiles must not fall along their levels")
    return p, rows
