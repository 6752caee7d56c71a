"""Growth laws of damage: the volume per width V_eq over the time since the onset, as drawn for simulated lives.

A law is a curve W(u) of the share u = t / T of the nominal life T, with W(0) = 0 at the onset and W(1) = 1 at the
population's threshold; V_eq = V_0 + (V_th - V_0) W. Growth is rough: the increments are those of the law times
independent gamma-distributed factors of mean one, so that V_eq never falls and crosses the threshold near T.

Laws: "quadratic" as in the thesis (Table 22: the quadratic term takes 0.56 to 0.98 of the growth); "exponential" (the
rate is in proportion to V_eq); "power" (u to the power of 1.2 to 4); "linear_then_fast" (a line that bends up once);
"stall_then_jump" (growth, a stall, a jump, and growth again); "monotone" (straight between 3 to 13 random levels, over
u to the power of 0.5 to 4: any shape); "two_stage" (slow to 3 to 50 % at 0.3 to 0.92 of the life, then fast);
"run_up" (the rate goes with a power of V_eq from 1.1 to 2.2, as a crack after Paris); "decelerating" (u to a power
below one, or saturating); "standstill" (growth to a level below the threshold, then none).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

Curve = Callable[["NDArray[np.float64]"], "NDArray[np.float64]"]

PATH_STEP = 60.0
"""Spacing of the points between which a path is straight, s."""
ROUGHNESS_STEP = 300.0
"""Time to which the roughness of a path refers, s."""
# Length of a curve, in nominal lives.
_MAX_LIVES = 8.0
# Length of a path over the time that its law takes: blocks are simulated beyond the crossing.
_BEYOND = 2.0
# Length of a path whose law does not get there, in nominal lives.
_STANDSTILL_LIVES = 4.0
# Share of the law's mean rate at which a stalled damage still grows.
_STALLED = 0.03


def _quadratic(rng: np.random.Generator, ratio: float) -> Curve:
    del ratio
    curved = rng.uniform(0.56, 0.98)
    return lambda u: curved * u * u + (1.0 - curved) * u


def _exponential(rng: np.random.Generator, ratio: float) -> Curve:
    del rng
    return lambda u: np.expm1(u * np.log(ratio)) / (ratio - 1.0)


def _power(rng: np.random.Generator, ratio: float) -> Curve:
    del ratio
    exponent = rng.uniform(1.2, 4.0)
    return lambda u: u**exponent


def _linear_then_fast(rng: np.random.Generator, ratio: float) -> Curve:
    del ratio
    bend, level = rng.uniform(0.5, 0.8), rng.uniform(0.1, 0.35)
    rate = level / bend
    curvature = (1.0 - level - rate * (1.0 - bend)) / (1.0 - bend) ** 2
    return lambda u: rate * u + curvature * np.maximum(u - bend, 0.0) ** 2


def _stall_then_jump(rng: np.random.Generator, ratio: float) -> Curve:
    del ratio
    stall = rng.uniform(0.15, 0.45)
    jump = stall + rng.uniform(0.2, 0.45)
    landing = jump + rng.uniform(0.01, 0.05)
    level = rng.uniform(0.08, 0.35)
    height = rng.uniform(0.2, 0.5)
    before = level + _STALLED * (jump - stall)
    after = before + height
    rate = (1.0 - after) / (1.0 - landing)
    places = np.array([0.0, stall, jump, landing, 1.0])
    levels = np.array([0.0, level, before, after, 1.0])
    return lambda u: np.where(u <= 1.0, np.interp(u, places, levels), 1.0 + rate * (u - 1.0))


def _monotone(rng: np.random.Generator, ratio: float) -> Curve:
    del ratio
    increments = rng.gamma(_uniform_ln(rng, 0.3, 3.0), size=int(rng.integers(3, 14)))
    levels = np.concatenate(([0.0], np.cumsum(increments) / increments.sum()))
    power = _uniform_ln(rng, 0.5, 4.0)
    places = np.linspace(0.0, 1.0, levels.size)
    last = float(levels[-1] - levels[-2]) * (levels.size - 1)
    return _continued(lambda u: np.interp(u**power, places, levels), max(power * last, 0.5))


def _two_stage(rng: np.random.Generator, ratio: float) -> Curve:
    del ratio
    bend, level = rng.uniform(0.3, 0.92), _uniform_ln(rng, 0.03, 0.5)
    first, second = rng.uniform(0.6, 1.4), rng.uniform(1.0, 2.5)

    def curve(u: NDArray[np.float64]) -> NDArray[np.float64]:
        slow = level * np.minimum(u / bend, 1.0) ** first
        return slow + (1.0 - level) * np.maximum((u - bend) / (1.0 - bend), 0.0) ** second

    return _continued(curve, (1.0 - level) * second / (1.0 - bend))


def _run_up(rng: np.random.Generator, ratio: float) -> Curve:
    power = rng.uniform(1.1, 2.2) - 1.0
    used = 1.0 - ratio**-power

    def curve(u: NDArray[np.float64]) -> NDArray[np.float64]:
        return ((1.0 - used * u) ** (-1.0 / power) - 1.0) / (ratio - 1.0)

    return _continued(curve, ratio ** (1.0 + power) * used / (power * (ratio - 1.0)))


def _decelerating(rng: np.random.Generator, ratio: float) -> Curve:
    del ratio
    if rng.uniform() < 0.5:
        power = _uniform_ln(rng, 0.3, 0.9)
        return lambda u: u**power
    bend = rng.uniform(0.5, 3.0)
    return _continued(lambda u: np.expm1(-bend * u) / np.expm1(-bend), -bend * np.exp(-bend) / np.expm1(-bend))


def _standstill(rng: np.random.Generator, ratio: float) -> Curve:
    del ratio
    stop, level, power = rng.uniform(0.1, 1.0), _uniform_ln(rng, 0.01, 0.9), _uniform_ln(rng, 0.5, 3.0)
    return lambda u: level * np.minimum(u / stop, 1.0) ** power


def _continued(curve: Curve, slope: float) -> Curve:
    """Return a curve that goes on in a straight line from u = 1."""

    def continued(u: NDArray[np.float64]) -> NDArray[np.float64]:
        return curve(np.minimum(u, 1.0)) + slope * np.maximum(u - 1.0, 0.0)

    return continued


def _uniform_ln(rng: np.random.Generator, low: float, high: float) -> float:
    return math.exp(rng.uniform(math.log(low), math.log(high)))


_LAWS: dict[str, Callable[[np.random.Generator, float], Curve]] = {
    "quadratic": _quadratic,
    "exponential": _exponential,
    "power": _power,
    "linear_then_fast": _linear_then_fast,
    "stall_then_jump": _stall_then_jump,
    "monotone": _monotone,
    "two_stage": _two_stage,
    "run_up": _run_up,
    "decelerating": _decelerating,
    "standstill": _standstill,
}
LAWS = tuple(_LAWS)
WEIGHTS: dict[str, float] = dict.fromkeys(LAWS, 1.0) | {"monotone": 7.0, "standstill": 2.0}
"""Weights of the laws in a population by default: about half of its lives have any shape."""


def draw_law(law: str, rng: np.random.Generator, ratio: float) -> Curve:
    """Return a curve W(u) of a law, continued beyond u = 1, with parameters drawn; ``ratio`` is V_th / V_0 > 1.

    Raises:
        ValueError: if there is no such law.
    """
    if law not in _LAWS:
        raise ValueError(f"law must be one of {', '.join(LAWS)}, got {law!r}")
    return _LAWS[law](rng, ratio)


@dataclass(frozen=True, eq=False)
class GrowthPath:
    """V_eq, m2, never falling, at times ``t``, s since the onset, ascending from zero; straight between its points."""

    t: NDArray[np.float64]
    v_eq: NDArray[np.float64]

    def at(self, t: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return V_eq at times within the path, m2."""
        return np.interp(t, self.t, self.v_eq)

    def crossing(self, threshold: float) -> float:
        """Return when V_eq first reaches a threshold, s since the onset; infinity if it does not."""
        if threshold <= self.v_eq[0]:
            return 0.0
        i = int(np.searchsorted(self.v_eq, threshold, side="left"))
        if i == self.v_eq.size:
            return float("inf")
        share = (threshold - self.v_eq[i - 1]) / (self.v_eq[i] - self.v_eq[i - 1])
        return float(self.t[i - 1] + share * (self.t[i] - self.t[i - 1]))


def grow(
    curve: Curve,
    rng: np.random.Generator,
    *,
    duration: float,
    v_0: float,
    threshold: float,
    until: float,
    roughness: float,
) -> GrowthPath:
    """Return a path along a law with gamma-distributed increments.

    Args:
        duration: nominal life T, s.
        v_0: V_eq at the onset, m2.
        threshold: V_eq at u = 1, m2.
        until: V_eq that the path must reach, m2; it lasts twice as long as its law takes to get there, at most eight
            nominal lives; four of them where the law never gets there.
        roughness: standard deviation of the factor on the growth within ``ROUGHNESS_STEP``; 0 is a smooth path.
    """
    steps = int(np.ceil(_MAX_LIVES * duration / PATH_STEP))
    t = PATH_STEP * np.arange(steps + 1, dtype=np.float64)
    growth = np.diff((threshold - v_0) * curve(t / duration))
    reached = int(np.searchsorted(np.cumsum(growth), until - v_0))
    stands = reached == growth.size and growth[-1] == 0.0
    growth = growth[: int(_STANDSTILL_LIVES * duration / PATH_STEP) if stands else int(_BEYOND * (reached + 1))]
    if roughness > 0.0:
        shape = PATH_STEP / (ROUGHNESS_STEP * roughness**2)
        growth = growth * rng.gamma(shape, 1.0 / shape, growth.size)
    v_eq = v_0 + np.concatenate(([0.0], np.cumsum(growth)))
    return GrowthPath(t[: growth.size + 1], np.asarray(v_eq, dtype=np.float64))
