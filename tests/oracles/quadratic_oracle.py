"""The quadratic of the thesis' forecast, fitted at once to a whole history."""

from __future__ import annotations

import math
from typing import cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from monitor.health.rest.quadratic import QuadraticFit


def fit_quadratic(t: ArrayLike, v: ArrayLike) -> QuadraticFit | None:
    """Return the least-squares quadratic through the first point; None with fewer than two distinct times after it.

    Args:
        t: not decreasing, shape (n,), s.

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
