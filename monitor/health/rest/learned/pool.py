"""The learned forecast and one by a physical library as one: a weighted mean of their distributions.

The weights come from runs that neither was fitted on. TT then means either end: that of the recorded runs, or the
threshold of V_eq.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from monitor.health.size import Remaining, RemainingSettings, TtStatus
from monitor.health.size.library.forecaster import QUANTILES

_MIN_TT = 1e-3
"""Shorter times are this, s: a crossed threshold has no logarithm. Nor has one that is never reached."""
_MAX_TT = 1e12
_GRID = 1200
_TAIL = 3.0
"""Logistic tails continue a distribution beyond its outermost quantiles up to this many of their own distances."""


def pool(learned: Remaining, physical: Remaining, weight: float, settings: RemainingSettings) -> Remaining:
    """Return the mean of two forecasts, the physical one with a weight from 0 to 1.

    It is the learned one where either has no distribution.
    """
    known = physical.status in (TtStatus.OK, TtStatus.ALREADY_CROSSED, TtStatus.BEYOND_HORIZON)
    if not learned.quantiles or not (known and physical.quantiles) or weight <= 0.0:
        return replace(learned, threshold=physical.threshold)
    ours, theirs = _knots(learned), _knots(physical)
    x = np.linspace(min(ours[0][0], theirs[0][0]), max(ours[0][-1], theirs[0][-1]), _GRID)
    mixed = (1.0 - weight) * _probability(x, *ours) + weight * _probability(x, *theirs)
    half = 0.5 * settings.interval
    levels = (0.5 - half, 0.5, 0.5 + half, *QUANTILES)
    lower, median, upper, *quantiles = np.exp(np.interp(levels, mixed, x)).tolist()
    status = TtStatus.OUTSIDE_LIBRARY if learned.status is TtStatus.OUTSIDE_LIBRARY else TtStatus.OK
    if median > settings.horizon and status is TtStatus.OK:
        status = TtStatus.BEYOND_HORIZON
    window = settings.window
    return replace(
        learned,
        threshold=physical.threshold,
        status=status,
        tt=median,
        tt_lower=lower,
        tt_upper=upper,
        t_threshold=learned.t_threshold - learned.tt + median,
        p_threshold=math.nan if window is None else float(np.interp(math.log(window), x, mixed)),
        quantiles=tuple(zip(QUANTILES, quantiles, strict=True)),
    )


def _knots(found: Remaining) -> tuple[list[float], list[float]]:
    """Return ascending ln TT and their logits, with tails that go on as the outermost quantiles do."""
    x = [math.log(min(max(tt, _MIN_TT), _MAX_TT)) for _, tt in found.quantiles]
    z = [math.log(level / (1.0 - level)) for level, _ in found.quantiles]
    for here, beside, place in ((0, 1, 0), (-1, -2, len(x))):
        slope = max(abs(x[here] - x[beside]) / abs(z[here] - z[beside]), 1e-3)
        sign = 1.0 if here else -1.0
        at, logit = x[here] + sign * _TAIL * slope, z[here] + sign * _TAIL
        x.insert(place if sign < 0 else len(x), at)
        z.insert(place if sign < 0 else len(z), logit)
    return x, z


def _probability(x: np.ndarray, knots: list[float], logits: list[float]) -> np.ndarray:
    """Return the probability that ln TT is at most each of ascending values."""
    reached = 1.0 / (1.0 + np.exp(-np.interp(x, knots, logits)))
    return np.where(x < knots[0], 0.0, np.where(x > knots[-1], 1.0, reached))
