"""The time to threshold (TT) of section 5.2.3.2 of the thesis: a quadratic through the first V_eq, and its root.

After each block the curve v = a tau^2 + b tau + c, fixed at the first point of the final stage, is refitted to all V_eq
up to now; the time at which it reaches the threshold is the forecast: TT = t_th - t_c (Eq. 92). It has no interval and
varies strongly while the points are few; see ``docs/explanation/tracking.md``.

Times are damage time: standstill does not count.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from typing import Any

from monitor.health.damage.thesis.quadratic import QuadraticFit, RunningFit

STATE_VERSION = 1


class TtStatus(StrEnum):
    """Outcome of one forecast; where several apply, the first in this order is given.

    ``not_final_stage``: the bearing is not in the final stage. ``already_crossed``: V_eq has reached the threshold; TT
    is zero from then on, whatever V_eq does later. ``too_few_points``: fewer points than ``min_points``, or fewer than
    two distinct times after the first. ``crossing_in_past``: the curve reached the threshold before now, though V_eq
    has not. ``beyond_horizon``: it will, but later than the horizon. ``ok``: it will; also where the curve bends down
    but reaches the threshold first. ``concave``: it bends down and turns back below the threshold. ``no_crossing``: it
    is flat or falls in a straight line.
    """

    NOT_FINAL_STAGE = "not_final_stage"
    ALREADY_CROSSED = "already_crossed"
    TOO_FEW_POINTS = "too_few_points"
    CROSSING_IN_PAST = "crossing_in_past"
    BEYOND_HORIZON = "beyond_horizon"
    OK = "ok"
    CONCAVE = "concave"
    NO_CROSSING = "no_crossing"


@dataclass(frozen=True)
class ForecastSettings:
    """Settings of the thesis' forecast.

    Attributes:
        min_points: least number of V_eq points for a fit, the first included; 3 determine a curve.
        horizon: longest TT that is given as ``ok``, s of damage time.
    """

    min_points: int = 3
    horizon: float = 365 * 86400.0

    def __post_init__(self) -> None:
        """Raise ValueError for too few points or a horizon that is not positive."""
        if self.min_points < 3:
            raise ValueError(f"min_points must be 3 or more, got {self.min_points}")
        if not self.horizon > 0:
            raise ValueError(f"horizon must be positive, got {self.horizon}")


@dataclass(frozen=True)
class Crossing:
    """The crossing of a threshold by V_eq, with the fit at that time.

    Attributes:
        threshold: m2.
        t: interpolated between the points on either side, s; None where the threshold was first given after the
            crossing.
        fit: its last point interpolated onto the threshold; None where it is not determined.
    """

    threshold: float
    t: float | None
    fit: QuadraticFit | None


@dataclass(frozen=True)
class ForecastState:
    """State of the forecast, of constant size.

    Attributes:
        fit: None before the first point.
        t_last: time of the latest point, s.
    """

    fit: RunningFit | None = None
    t_last: float | None = None
    v_last: float | None = None
    v_most: float = 0.0
    crossings: tuple[Crossing, ...] = ()
    version: int = STATE_VERSION

    def to_dict(self) -> dict[str, Any]:
        """Return the state as plain values for JSON."""
        stored = asdict(self)
        return {**stored, "crossings": list(stored["crossings"])}

    @classmethod
    def from_dict(cls, stored: Mapping[str, Any]) -> ForecastState:
        """Restore a state written by :meth:`to_dict`.

        Raises:
            ValueError: the state has another version.
        """
        if stored.get("version") != STATE_VERSION:
            raise ValueError(f"forecast state: version {STATE_VERSION} expected, got {stored.get('version')!r}")
        return cls(
            fit=None if stored["fit"] is None else RunningFit(**stored["fit"]),
            t_last=stored["t_last"],
            v_last=stored["v_last"],
            v_most=stored["v_most"],
            crossings=tuple(
                Crossing(c["threshold"], c["t"], None if c["fit"] is None else QuadraticFit(**c["fit"]))
                for c in stored["crossings"]
            ),
        )


@dataclass(frozen=True)
class ForecastResult:
    """One forecast for one threshold; NaN wherever ``status`` says that there is no value.

    Attributes:
        threshold: V_th, m2.
        tt: s of damage time; zero once crossed. Given with ``ok``, ``already_crossed`` and, where finite,
            ``beyond_horizon``.
        t_threshold: when the curve or V_eq reaches the threshold, s; also given with ``crossing_in_past``.
        coefficients: a in m2/s2, b in m2/s and c in m2 of a tau^2 + b tau + c, tau counted from the first point.
        r_squared: coefficient of determination of the fit.
    """

    threshold: float
    tt: float
    t_threshold: float
    coefficients: tuple[float, float, float]
    r_squared: float
    status: TtStatus


def step(
    state: ForecastState,
    t: float,
    v_eq: float,
    *,
    thresholds: Sequence[float],
    settings: ForecastSettings | None = None,
    final_stage: bool = True,
) -> tuple[ForecastState, tuple[ForecastResult, ...]]:
    """Add one V_eq to the fit and forecast each threshold.

    Args:
        state: ``ForecastState()`` at t_fs.
        t: damage time, s; may repeat, may not go back.
        v_eq: m2; NaN where the tracker had none: the fit is unchanged and read at ``t``.
        thresholds: one or more V_th, m2.
        final_stage: where False, the state is returned unchanged.

    Returns:
        The next state, and one result per threshold, in their order.

    Raises:
        ValueError: a time that is not finite or goes back, a V_eq that is negative or infinite, or thresholds that are
            none or not positive.
    """
    settings = settings or ForecastSettings()
    if not thresholds or not all(math.isfinite(v) and v > 0 for v in thresholds):
        raise ValueError(f"thresholds must be one or more positive volumes, got {list(thresholds)}")
    if not final_stage:
        return state, tuple(_result(v, TtStatus.NOT_FINAL_STAGE) for v in thresholds)
    if not math.isfinite(t) or (state.t_last is not None and t < state.t_last):
        raise ValueError(f"t must be finite and not before the latest point ({state.t_last} s), got {t}")
    if v_eq < 0 or math.isinf(v_eq):
        raise ValueError(f"v_eq must be a volume, or NaN where there is none; got {v_eq}")
    state = _take(state, float(t), float(v_eq), thresholds)
    enough = state.fit is not None and state.fit.points >= settings.min_points
    fit = state.fit.solve() if state.fit is not None and enough else None
    crossed = {crossing.threshold: crossing for crossing in state.crossings}
    return state, tuple(
        _crossed(crossed[v]) if v in crossed else _forecast(fit, float(t), v, settings.horizon) for v in thresholds
    )


def _take(state: ForecastState, t: float, v_eq: float, thresholds: Sequence[float]) -> ForecastState:
    """Return the state with one more point and the thresholds reached by now."""
    known = {crossing.threshold for crossing in state.crossings}
    most = state.v_most if math.isnan(v_eq) else max(state.v_most, v_eq)
    reached = [v for v in dict.fromkeys(thresholds) if v not in known and v <= most]
    crossings = (*state.crossings, *(_cross(state, t, v_eq, float(v)) for v in reached))
    if math.isnan(v_eq):
        return replace(state, crossings=crossings)
    fit = RunningFit.start(t, v_eq) if state.fit is None else state.fit.add(t, v_eq)
    return replace(state, fit=fit, t_last=t, v_last=v_eq, v_most=most, crossings=crossings)


def _cross(state: ForecastState, t: float, v_eq: float, threshold: float) -> Crossing:
    """Return the crossing between the latest point and the present one (section 5.4.3)."""
    if state.fit is None or state.t_last is None or state.v_last is None:
        return Crossing(threshold, t, None)
    if state.v_most >= threshold:
        # The threshold was first given after V_eq had passed it; the points of that time are not kept.
        return Crossing(threshold, None, None)
    share = (threshold - state.v_last) / (v_eq - state.v_last)
    t_cross = state.t_last + share * (t - state.t_last)
    return Crossing(threshold, t_cross, state.fit.add(t_cross, threshold).solve())


def _crossed(crossing: Crossing) -> ForecastResult:
    t_cross = math.nan if crossing.t is None else crossing.t
    return _result(crossing.threshold, TtStatus.ALREADY_CROSSED, crossing.fit, 0.0, t_cross)


def _forecast(fit: QuadraticFit | None, t: float, threshold: float, horizon: float) -> ForecastResult:
    """Return the root nearest ahead; for a curve that begins below the threshold, its first."""
    if fit is None:
        return _result(threshold, TtStatus.TOO_FEW_POINTS)
    t_cross = fit.first_crossing(threshold)
    if t_cross is None:
        return _result(threshold, TtStatus.CONCAVE if fit.a < 0 else TtStatus.NO_CROSSING, fit)
    if t_cross <= t:
        return _result(threshold, TtStatus.CROSSING_IN_PAST, fit, math.nan, t_cross)
    if math.isinf(t_cross):
        return _result(threshold, TtStatus.BEYOND_HORIZON, fit)
    status = TtStatus.OK if t_cross - t <= horizon else TtStatus.BEYOND_HORIZON
    return _result(threshold, status, fit, t_cross - t, t_cross)


def _result(
    threshold: float,
    status: TtStatus,
    fit: QuadraticFit | None = None,
    tt: float = math.nan,
    t_threshold: float = math.nan,
) -> ForecastResult:
    coefficients = (math.nan, math.nan, math.nan) if fit is None else (fit.a, fit.b, fit.c)
    r_squared = math.nan if fit is None else fit.r_squared
    return ForecastResult(float(threshold), tt, t_threshold, coefficients, r_squared, status)
