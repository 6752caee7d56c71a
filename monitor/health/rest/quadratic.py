"""The time to threshold (TT) of section 5.2.3.2 of the thesis: a quadratic through the first V_eq, and its root.

After each block the curve v = a tau^2 + b tau + c, fixed at the first point of the final stage, is refitted to all V_eq
up to now; the time at which it reaches the threshold is the forecast: TT = t_th - t_c (Eq. 92). It has no interval and
varies strongly while the points are few; see ``docs/explanation/tracking.md``. Times are damage time.

The fit keeps the triangular factor of its least-squares problem and adds each row by Givens rotations (Golub and Van
Loan, Matrix Computations, section 5.1.8), which does not square the condition of the problem as sums of powers do.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from monitor.health.codec import StoredState
from monitor.health.size import Remaining, TtStatus

MIN_POINTS = 3
"""Least number of V_eq points for a fit, the first included: they determine a curve."""
HORIZON = 365 * 86400.0
"""Longest TT that is given as ``ok``, s of damage time."""
DISTINCT = 1e-12
"""The curve is undetermined where the second column adds less than this share of its size to the first."""


@dataclass(frozen=True)
class QuadraticFit:
    """v = a tau^2 + b tau + c with tau = t - t_first, the time since the first point, s.

    Attributes:
        r_squared: coefficient of determination over all points; NaN where all values are equal, negative where the mean
            fits better.
    """

    t_first: float
    a: float
    b: float
    c: float
    r_squared: float

    def value_at(self, t: float) -> float:
        """Return the curve at time ``t``, s."""
        tau = t - self.t_first
        return (self.a * tau + self.b) * tau + self.c

    def first_crossing(self, threshold: float) -> float | None:
        """Return the time (s) at which the curve first reaches a threshold above c, or None; may be inf."""
        gap = threshold - self.c
        bend = 2.0 * math.sqrt(abs(self.a)) * math.sqrt(gap)
        if self.a <= 0.0 and (self.b <= 0.0 or self.b < bend):
            return None
        # sqrt(b^2 + 4 a gap) without squares that cancel or vanish, and then the root that does not cancel.
        root = math.hypot(self.b, bend) if self.a > 0.0 else math.sqrt((self.b - bend) * (self.b + bend))
        return self.t_first + (2.0 * gap / (self.b + root) if self.b > 0.0 else (root - self.b) / (2.0 * self.a))


@dataclass(frozen=True)
class RunningFit:
    """The running fit of a history of any length.

    Attributes:
        r11: triangular factor of the columns tau and tau^2, with r12 and r22.
        z1: right-hand side turned with it, with z2.
        residual: sum of squares of the residuals.
        mean: mean of all values.
        scatter: sum of squares about the mean (Welford's recurrence).
    """

    points: int
    t_first: float
    v_first: float
    r11: float = 0.0
    r12: float = 0.0
    r22: float = 0.0
    z1: float = 0.0
    z2: float = 0.0
    residual: float = 0.0
    mean: float = 0.0
    scatter: float = 0.0

    @classmethod
    def start(cls, t: float, v: float) -> RunningFit:
        """Return the fit of the first point alone, at ``t``, s."""
        return cls(points=1, t_first=t, v_first=v, mean=v)

    def add(self, t: float, v: float) -> RunningFit:
        """Return the fit with one more point, in constant time."""
        tau, y = t - self.t_first, v - self.v_first
        r11, cos, sin = _rotation(self.r11, tau)
        r12, x = cos * self.r12 + sin * tau * tau, cos * tau * tau - sin * self.r12
        z1, y = cos * self.z1 + sin * y, cos * y - sin * self.z1
        r22, cos, sin = _rotation(self.r22, x)
        z2, y = cos * self.z2 + sin * y, cos * y - sin * self.z2
        points = self.points + 1
        mean = self.mean + (v - self.mean) / points
        return replace(
            self,
            points=points,
            r11=r11,
            r12=r12,
            r22=r22,
            z1=z1,
            z2=z2,
            residual=self.residual + y * y,
            mean=mean,
            scatter=self.scatter + (v - self.mean) * (v - mean),
        )

    def solve(self) -> QuadraticFit | None:
        """Return the curve, or None where fewer than two distinct times follow the first."""
        if abs(self.r22) <= DISTINCT * math.hypot(self.r12, self.r22):
            return None
        a = self.z2 / self.r22
        b = (self.z1 - self.r12 * a) / self.r11
        r_squared = 1.0 - self.residual / self.scatter if self.scatter > 0.0 else math.nan
        return QuadraticFit(self.t_first, a, b, self.v_first, r_squared)


@dataclass(frozen=True)
class Crossing:
    """The crossing of a threshold (m2) by V_eq, with the fit at that time.

    Attributes:
        t: interpolated between the points on either side, s; None where the threshold was first given after the
            crossing.
        fit: its last point interpolated onto the threshold; None where it is not determined.
    """

    threshold: float
    t: float | None
    fit: QuadraticFit | None


@dataclass(frozen=True)
class ForecastState(StoredState):
    """State of the forecast, of constant size.

    Attributes:
        fit: None before the first point.
        t_last: time of the latest point, s.
    """

    VERSIONS = (1,)

    fit: RunningFit | None = None
    t_last: float | None = None
    v_last: float | None = None
    v_most: float = 0.0
    crossings: tuple[Crossing, ...] = ()
    version: int = VERSIONS[-1]


def step(
    state: ForecastState,
    t: float,
    v_eq: float,
    *,
    thresholds: Sequence[float],
    final_stage: bool = True,
) -> tuple[ForecastState, tuple[Remaining, ...]]:
    """Add one V_eq to the fit and forecast each threshold, in their order.

    Where several statuses apply, the first is given of: not in the final stage, already crossed, too few points (than
    ``MIN_POINTS``, or two distinct times after the first), and what the curve gives.

    Args:
        state: ``ForecastState()`` at t_fs.
        t: damage time, s; may repeat, may not go back.
        v_eq: m2; NaN where the tracker had none: the fit is unchanged and read at ``t``.
        thresholds: one or more V_th, m2.
        final_stage: where False, the state is returned unchanged.

    Raises:
        ValueError: a time that is not finite or goes back, a V_eq that is negative or infinite, or thresholds that are
            none or not positive.
    """
    if not thresholds or not all(math.isfinite(v) and v > 0 for v in thresholds):
        raise ValueError(f"thresholds must be one or more positive volumes, got {list(thresholds)}")
    if not final_stage:
        return state, tuple(_result(v, TtStatus.NOT_FINAL_STAGE) for v in thresholds)
    if not math.isfinite(t) or (state.t_last is not None and t < state.t_last):
        raise ValueError(f"t must be finite and not before the latest point ({state.t_last} s), got {t}")
    if v_eq < 0 or math.isinf(v_eq):
        raise ValueError(f"v_eq must be a volume, or NaN where there is none; got {v_eq}")
    state = _take(state, float(t), float(v_eq), thresholds)
    enough = state.fit is not None and state.fit.points >= MIN_POINTS
    fit = state.fit.solve() if state.fit is not None and enough else None
    crossed = {crossing.threshold: crossing for crossing in state.crossings}
    return state, tuple(_crossed(crossed[v]) if v in crossed else _forecast(fit, float(t), v) for v in thresholds)


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


def _crossed(crossing: Crossing) -> Remaining:
    t_cross = math.nan if crossing.t is None else crossing.t
    return _result(crossing.threshold, TtStatus.ALREADY_CROSSED, crossing.fit, 0.0, t_cross)


def _forecast(fit: QuadraticFit | None, t: float, threshold: float) -> Remaining:
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
    status = TtStatus.OK if t_cross - t <= HORIZON else TtStatus.BEYOND_HORIZON
    return _result(threshold, status, fit, t_cross - t, t_cross)


def _result(
    threshold: float,
    status: TtStatus,
    fit: QuadraticFit | None = None,
    tt: float = math.nan,
    t_threshold: float = math.nan,
) -> Remaining:
    result = Remaining(float(threshold), status, tt=tt, t_threshold=t_threshold)
    return result if fit is None else replace(result, coefficients=(fit.a, fit.b, fit.c), r_squared=fit.r_squared)


def _rotation(f: float, g: float) -> tuple[float, float, float]:
    """Return length, cosine and sine of the Givens rotation that takes (f, g) to (length, 0)."""
    length = math.hypot(f, g)
    if length == 0.0:
        return 0.0, 1.0, 0.0
    return length, f / length, g / length
