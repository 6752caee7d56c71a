"""A quadratic through the first point of a history, refitted in constant time per point (section 5.2.3.2).

With tau the time since the first point, the curve is v = a tau^2 + b tau + c with c the first value: two unknowns. The
running fit keeps the triangular factor of its least-squares problem and adds each row by Givens rotations (Golub and
Van Loan, Matrix Computations, section 5.1.8), which does not square the condition of the problem as sums of powers do.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

DISTINCT = 1e-12
"""The curve is undetermined where the second column adds less than this share of its size to the first."""


@dataclass(frozen=True)
class QuadraticFit:
    """v = a tau^2 + b tau + c with tau = t - t_first.

    Attributes:
        t_first: time of the first point, s.
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
        """Return the fit of the first point alone, at ``t`` in s with value ``v``."""
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


def fit_quadratic(t: ArrayLike, v: ArrayLike) -> QuadraticFit | None:
    """Return the least-squares quadratic through the first point of a whole history.

    Args:
        t: not decreasing, shape (n,), s.

    Returns:
        None where fewer than two distinct times follow the first.

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
    solution = cast("NDArray[np.float64]", np.linalg.lstsq(columns, values - values[0], rcond=None)[0])
    residual = values - values[0] - columns @ solution
    scatter = float(np.sum((values - values.mean()) ** 2))
    r_squared = 1.0 - float(residual @ residual) / scatter if scatter > 0.0 else math.nan
    return QuadraticFit(
        float(times[0]), float(solution[0]) / scale**2, float(solution[1]) / scale, float(values[0]), r_squared
    )


def _rotation(f: float, g: float) -> tuple[float, float, float]:
    """Return length, cosine and sine of the Givens rotation that takes (f, g) to (length, 0)."""
    length = math.hypot(f, g)
    if length == 0.0:
        return 0.0, 1.0, 0.0
    return length, f / length, g / length
