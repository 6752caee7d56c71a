"""How a level of a healthy machine depends on speed and load: a regression learned with the baseline, then frozen.

    ln level = c + shape(speed, load) + e
    shape    = p a + q a^2 + r b + s b^2 + t a b + sum of c_k hat_k(a),    a = ln speed, b = ln load

The powers are what unbalance, contact forces and impacts follow. Triangular hats between knots of ln speed take the
resonances that lines cross as the speed changes. Each coefficient has a normal prior about 0, so that few blocks give
a smooth curve, and the residuals are weighted after Huber, so that knocks do not bend it. Over a block that does not
turn at one speed the terms are averaged, by Simpson's rule over its least, mean and highest speed.

The posterior states its own error. Where it is large, at conditions between those that were learned, and beyond their
range, nothing is predicted. The errors of neighbouring blocks are correlated as a machine drifts: the posterior counts
the blocks as so many fewer.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from monitor.health.codec import StoredState

Array = NDArray[np.float64]
LevelsBy = Literal["none", "speed", "load", "speed_and_load", "auto"]
Condition = tuple[float | None, float | None, float | None, float | None]
"""ln of the least, the mean and the highest speed of a block, and of its load; None where not known."""
UNKNOWN: Condition = (None, None, None, None)
Range = tuple[float, float]
_PLACES = {"speed": (0, 2), "load": (3, 3)}
"""Where the least and the highest value of a condition stand."""

MIN_SPREAD = {"speed": 0.02, "load": 0.05}
"""Least spread (5 to 95 %) of the logarithm of a condition that "auto" takes for one that varies."""
_LEAST_SHARE = 0.1
"""Least share of the variance that "auto" takes for a dependence, each block predicted without itself."""
MAX_ERROR = 0.1
"""Largest standard deviation of a prediction that is used, ln level: that of the drift of a healthy machine."""
_MARGIN = {"speed": 0.005, "load": 0.02}
"""By how much the logarithm of a condition may lie outside the learned range: errors of its measurement. 2 % of speed
once reached the flank of a resonance that was not learned."""
_STEADY_MARGIN = {"speed": 0.05, "load": 0.15}
"""The same of a condition that did not vary, on which nothing was learned: a level may change with its fourth power."""
_PRIOR = {"a": 3.0, "aa": 3.0, "b": 2.0, "bb": 1.0, "ab": 2.0, "hat": 0.25}
_KNOT_STEP = 0.03
_MIN_KNOTS, _MAX_KNOTS = 3, 15
_KNOWN_SHARE = 0.9
"""Share of the blocks that must state a condition."""
_HUBER = 1.5
_ROUNDS = 8
_LEAST_SD = 0.005
_MAX_CORRELATION = 0.9
_SIMPSON = np.array((1.0, 4.0, 1.0)) / 6.0


def condition_of(speed: float | None, span: tuple[float, float] | None, load: float | None) -> Condition:
    """Return the condition of a block from its speed and the span of that in Hz, and its load in N."""

    def ln(value: float | None) -> float | None:
        return math.log(value) if value is not None and value > 0.0 and math.isfinite(value) else None

    low, high = (speed, speed) if span is None else span
    return ln(low), ln(speed), ln(high), ln(load)


@dataclass(frozen=True)
class Dependence(StoredState):
    """The shape of a level over speed and load, 0 at a reference.

    Attributes:
        by: conditions that it takes: "speed", "load" or both.
        centre: the reference, ln speed and ln load: the medians when the baseline was learned first.
        knots: of ln speed less the centre, rising; () without hats.
        mean: of the terms over the learned blocks, shape (term,).
        coefficients: shape (term,).
        covariance: of their errors, shape (term, term).
        speed: least and highest ln speed that was learned.
        load: the same of ln load.
    """

    by: tuple[str, ...]
    centre: tuple[float, float]
    knots: tuple[float, ...]
    mean: tuple[float, ...]
    coefficients: tuple[float, ...]
    covariance: tuple[tuple[float, ...], ...]
    speed: tuple[float, float] = (0.0, 0.0)
    load: tuple[float, float] = (0.0, 0.0)

    def at(self, condition: Condition) -> tuple[float, float] | None:
        """Return shape and its standard deviation at a condition; None where it was not learned."""
        if not is_known(condition, self.by) or not self._covers(condition):
            return None
        speed, load = self.centre
        reference: Condition = (speed, speed, speed, load)
        terms, zero = _terms([condition, reference], self.by, self.centre, self.knots)
        apart = terms - self.mean
        error = math.sqrt(max(float(apart @ np.array(self.covariance) @ apart), 0.0))
        return (float((terms - zero) @ self.coefficients), error) if error <= MAX_ERROR else None

    def _covers(self, condition: Condition) -> bool:
        low, _, high, load = condition
        inside = True
        if "speed" in self.by and low is not None and high is not None:
            inside = self.speed[0] - _MARGIN["speed"] <= low and high <= self.speed[1] + _MARGIN["speed"]
        if "load" in self.by and load is not None:
            inside = inside and self.load[0] - _MARGIN["load"] <= load <= self.load[1] + _MARGIN["load"]
        return inside


def steady_ranges(conditions: Sequence[Condition], by: Sequence[str], levels_by: LevelsBy) -> dict[str, Range]:
    """Return the learned ranges of the known conditions that "auto" does not take levels relative to."""
    found: dict[str, Range] = {}
    for name in ("speed", "load") if levels_by == "auto" else ():
        low, high = ([v for one in conditions if (v := one[place]) is not None] for place in _PLACES[name])
        if name not in by and len(low) >= _KNOWN_SHARE * len(conditions):
            found[name] = (min(low), max(high))
    return found


def leaves(condition: Condition, ranges: Mapping[str, Range]) -> bool:
    """Return whether a block is at another condition than those that did not vary; an unknown one is not."""
    for name, (least, highest) in ranges.items():
        low, high = (condition[place] for place in _PLACES[name])
        margin = _STEADY_MARGIN[name]
        if low is not None and high is not None and not least - margin <= low <= high <= highest + margin:
            return True
    return False


def is_known(condition: Condition, by: Sequence[str]) -> bool:
    """Return whether a block states the conditions that a dependence takes."""
    return ("speed" not in by or None not in condition[:3]) and ("load" not in by or condition[3] is not None)


def varying(conditions: Sequence[Condition], levels_by: LevelsBy) -> tuple[str, ...]:
    """Return the conditions that a dependence is sought on: those asked for, or by "auto" those that vary."""
    asked = {"none": (), "auto": ("speed", "load"), "speed_and_load": ("speed", "load")}.get(levels_by, (levels_by,))
    found: list[str] = []
    for name in asked:
        values = [value for one in conditions if (value := one[1 if name == "speed" else 3]) is not None]
        if len(values) < max(_KNOWN_SHARE * len(conditions), 2.0):
            continue
        low, high = np.quantile(values, (0.05, 0.95))
        if levels_by != "auto" or high - low >= MIN_SPREAD[name]:
            found.append(name)
    return tuple(found)


def widens(conditions: Sequence[Condition], by: Sequence[str]) -> bool:
    """Return whether the last third of some conditions widened the range of one by more than a tenth."""
    begun = 2 * len(conditions) // 3

    def width(name: str, part: Sequence[Condition]) -> float:
        low, high = ([value for one in part if (value := one[place]) is not None] for place in _PLACES[name])
        return max(high) - min(low) if low and high else 0.0

    return any(width(name, conditions) - width(name, conditions[:begun]) > 0.1 * width(name, conditions) for name in by)


def learn_dependence(
    levels: Sequence[float],
    conditions: Sequence[Condition],
    by: tuple[str, ...],
    *,
    always: bool,
    before: Dependence | None = None,
) -> Dependence | None:
    """Learn the shape of ln levels over conditions that are all known.

    Args:
        levels: shape (n,).
        conditions: of the same blocks.
        by: conditions to take.
        always: also where they explain no significant part of the levels.
        before: a dependence whose reference is kept.
    """
    if not by or len(levels) < 2:
        return None
    found = np.array([[math.nan if value is None else value for value in one] for one in conditions])
    load = found[:, 3] if "load" in by else np.zeros(len(found))
    centre = (float(np.median(found[:, 1])) if "speed" in by else 0.0, float(np.median(load)))
    if before is not None:
        kept = ("speed" in before.by and "speed" in by, "load" in before.by and "load" in by)
        centre = (before.centre[0] if kept[0] else centre[0], before.centre[1] if kept[1] else centre[1])
    speeds = (float(found[:, 0].min()), float(found[:, 2].max())) if "speed" in by else (0.0, 0.0)
    knots = _knots(speeds[0] - centre[0], speeds[1] - centre[0]) if "speed" in by else ()
    terms = _terms(conditions, by, centre, knots)
    fitted = _fit(terms, np.array(levels), _priors(by, len(knots)))
    if not always and fitted.share < _LEAST_SHARE:
        return None
    return Dependence(
        by=by,
        centre=centre,
        knots=knots,
        mean=tuple(fitted.mean.tolist()),
        coefficients=tuple(fitted.coefficients.tolist()),
        covariance=tuple(map(tuple, fitted.covariance.tolist())),
        speed=speeds,
        load=(float(load.min()), float(load.max())),
    )


def _knots(low: float, high: float) -> tuple[float, ...]:
    if high - low < 0.5 * MIN_SPREAD["speed"]:
        return ()
    count = min(max(round((high - low) / _KNOT_STEP) + 1, _MIN_KNOTS), _MAX_KNOTS)
    return tuple(np.linspace(low, high, count).tolist())


def _terms(
    conditions: Sequence[Condition], by: Sequence[str], centre: tuple[float, float], knots: Sequence[float]
) -> Array:
    """Return the terms of blocks, shape (n, term)."""
    columns: list[Array] = []
    n = len(conditions)
    load = np.array([one[3] or 0.0 for one in conditions]) - centre[1] if "load" in by else np.zeros(n)
    if "speed" in by:
        speed = np.array([one[:3] for one in conditions], dtype=np.float64) - centre[0]
        mean = speed @ _SIMPSON
        columns += [mean, speed**2 @ _SIMPSON]
        if "load" in by:
            columns.append(mean * load)
        width = knots[1] - knots[0] if knots else 1.0
        columns += [np.maximum(1.0 - np.abs(speed - knot) / width, 0.0) @ _SIMPSON for knot in knots]
    if "load" in by:
        columns += [load, load**2]
    return np.stack(columns, axis=1)


def _priors(by: Sequence[str], knots: int) -> Array:
    """Return the standard deviations of the coefficients before any block, in the order of the terms."""
    names: list[str] = []
    if "speed" in by:
        names += ["a", "aa", *(["ab"] if "load" in by else []), *["hat"] * knots]
    if "load" in by:
        names += ["b", "bb"]
    return np.array([_PRIOR[name] for name in names])


@dataclass(frozen=True, eq=False)
class _Fit:
    """A fitted shape; ``share`` of the variance is explained, each block predicted without itself."""

    mean: Array
    coefficients: Array
    covariance: Array
    share: float


def _fit(terms: Array, levels: Array, priors: Array) -> _Fit:
    """Fit by iteratively reweighted ridge regression; the noise follows from the residuals."""
    weights = np.ones(len(levels))
    sd = max(1.4826 * float(np.median(np.abs(levels - np.median(levels)))), _LEAST_SD)
    mean: Array = terms.mean(axis=0)
    centred = terms
    coefficients = np.zeros(terms.shape[1], dtype=np.float64)
    residuals, level = levels, 0.0
    precision = np.diag(priors**-2.0)
    for _ in range(_ROUNDS):
        mean, level = np.average(terms, axis=0, weights=weights), float(np.average(levels, weights=weights))
        centred = terms - mean
        normal = (centred.T * weights) @ centred / sd**2 + precision
        coefficients[:] = np.linalg.solve(normal, (centred.T * weights) @ (levels - level) / sd**2)
        residuals = levels - level - centred @ coefficients
        residuals = residuals - np.median(residuals)
        sd = max(1.4826 * float(np.median(np.abs(residuals))), _LEAST_SD)
        weights = np.minimum(1.0, _HUBER * sd / np.maximum(np.abs(residuals), 1e-12))
    gram: Array = np.asarray((centred.T * weights) @ centred / sd**2, dtype=np.float64)
    normal = gram + precision
    leverage = weights * (np.einsum("ij,ji->i", centred, np.linalg.solve(normal, centred.T)) / sd**2)
    left_out = residuals / np.maximum(1.0 - leverage - weights / weights.sum(), 0.05)
    total = float(np.sum(weights * (levels - level) ** 2))
    share = 1.0 - float(np.sum(weights * left_out**2)) / total if total > 0.0 else 0.0
    fewer = _blocks_per_one(np.clip(residuals, -3.0 * sd, 3.0 * sd))
    covariance = np.asarray(np.linalg.inv(gram / fewer + precision), dtype=np.float64)
    return _Fit(mean, coefficients, covariance, share)


def _blocks_per_one(residuals: Array) -> float:
    """Return how many neighbouring blocks count as one, by the correlation of their residuals."""
    power = float(residuals @ residuals)
    correlation = float(residuals[1:] @ residuals[:-1]) / power if power > 0.0 else 0.0
    correlation = min(max(correlation, 0.0), _MAX_CORRELATION)
    return (1.0 + correlation) / (1.0 - correlation)
