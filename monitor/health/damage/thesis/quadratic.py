"""A quadratic through the first point of a history, refitted in constant time as points come (section 5.2.3.2).

With tau the time since the first point, the curve is v = a tau^2 + b tau + c with c the first value: two unknowns. The
running fit keeps the triangular factor of its least-squares problem and turns each new row into it by Givens rotations
(Golub and Van Loan, Matrix Computations, section 5.1.8). Unlike sums of powers it does not square the condition of the
problem, and needs no scale of time: hours of seconds and years of seconds are fitted alike.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

DISTINCT = 1e-12
"""Below this share of its size, what the second column has beyond the first is rounding, and the curve undetermined."""


@dataclass(frozen=True)
class QuadraticFit:
    """v = a tau^2 + b tau + c with tau = t - t_first.

    Attributes:
        t_first: time of the first point, s.
        a: unit of v per s2.
        b: unit of v per s.
        c: value at the first point, unit of v.
        r_squared: 1 - (squares of the residuals) / (squares about the mean), of all points, the first included; NaN
            where all values are equal, and negative where the mean fits better than the curve.
    """

    t_first: float
    a: float
    b: float
    c: float
    r_squared: float

    def value_at(self, t: float) -> float:
        """The curve at time ``t``, in s of the same clock."""
        tau = t - self.t_first
        return (self.a * tau + self.b) * tau + self.c

    def first_crossing(self, threshold: float) -> float | None:
        """When the curve first reaches a threshold above its first value.

        Args:
            threshold: in the unit of v, above c.

        Returns:
            Time in s, which may be infinite where the curve is all but flat; None where it never gets there.
        """
        gap = threshold - self.c
        bend = 2.0 * math.sqrt(abs(self.a)) * math.sqrt(gap)
        if self.a <= 0.0 and (self.b <= 0.0 or self.b < bend):
            return None
        # sqrt(b^2 + 4 a gap) without squares that cancel or vanish, and then the root that does not cancel.
        root = math.hypot(self.b, bend) if self.a > 0.0 else math.sqrt((self.b - bend) * (self.b + bend))
        return self.t_first + (2.0 * gap / (self.b + root) if self.b > 0.0 else (root - self.b) / (2.0 * self.a))


@dataclass(frozen=True)
class RunningFit:
    """All that is kept of a history of any length.

    Attributes:
        points: number of points, the first included.
        t_first: time of the first point, s.
        v_first: value of the first point.
        r11: triangular factor of the columns tau and tau^2, s.
        r12: likewise, s2.
        r22: likewise, s2.
        z1: right-hand side turned with it, in the unit of v.
        z2: likewise.
        residual: sum of squares of the residuals, unit of v squared.
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
        """The fit of the first point alone, at ``t`` in s with value ``v``."""
        return cls(points=1, t_first=t, v_first=v, mean=v)

    def add(self, t: float, v: float) -> RunningFit:
        """The fit with one more point, at ``t`` in s with value ``v``; takes the same time however many came before."""
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
        """The curve, or None where fewer than two distinct times follow the first."""
        if abs(self.r22) <= DISTINCT * math.hypot(self.r12, self.r22):
            return None
        a = self.z2 / self.r22
        b = (self.z1 - self.r12 * a) / self.r11
        r_squared = 1.0 - self.residual / self.scatter if self.scatter > 0.0 else math.nan
        return QuadraticFit(self.t_first, a, b, self.v_first, r_squared)


def fit_quadratic(t: ArrayLike, v: ArrayLike) -> QuadraticFit | None:
    """The quadratic through the first point of a whole history, by least squares.

    Args:
        t: times, shape (n,), s; not decreasing.
        v: values, shape (n,), any unit.

    Returns:
        The curve, or None where fewer than two distinct times follow the first.

    Raises:
        ValueError: shapes that differ or are not (n,), an empty history, or values that are not finite.
    """
    times, values = np.asarray(t, dtype=np.float64), np.asarray(v, dtype=np.float64)
    if times.ndim != 1 or times.shape != values.shape or times.size == 0:
        raise ValueError(f"t and v must be of one shape (n,), n at least 1, got {times.shape} and {values.shape}")
    if not (np.all(np.isfinite(times)) and np.all(np.isfinite(values))):
        raise ValueError("t and v must be finite")
    tau = times - times[0]
    if np.unique(tau[tau > 0]).size < 2:
        return None
    scale = float(tau.max())
    share = tau / scale
    columns = np.column_stack([share * share, share])
    (a, b), *_ = np.linalg.lstsq(columns, values - values[0], rcond=None)
    residual = values - values[0] - columns @ np.array([a, b])
    scatter = float(np.sum((values - values.mean()) ** 2))
    r_squared = 1.0 - float(residual @ residual) / scatter if scatter > 0.0 else math.nan
    return QuadraticFit(float(times[0]), float(a) / scale**2, float(b) / scale, float(values[0]), r_squared)


def _rotation(f: float, g: float) -> tuple[float, float, float]:
    """Length, cosine and sine of the Givens rotation that takes (f, g) to (length, 0)."""
    length = math.hypot(f, g)
    if length == 0.0:
        return 0.0, 1.0, 0.0
    return length, f / length, g / length
