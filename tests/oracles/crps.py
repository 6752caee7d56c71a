"""The continuous ranked probability score of samples."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def crps_from_sample(sample: ArrayLike, true: ArrayLike, weights: ArrayLike | None = None) -> NDArray[np.float64]:
    """Return the CRPS of forecasts given as samples, E|X - y| - E|X - X'| / 2.

    Args:
        sample: shape (..., m), s.
        true: y, shape (...), s.
        weights: of the members, same shape as ``sample`` or (m,), not negative; None for equal ones.

    Returns:
        Shape (...), s; NaN where a sample holds NaN.

    Raises:
        ValueError: weights that are negative or all zero.
    """
    x, y = np.asarray(sample, dtype=np.float64), np.asarray(true, dtype=np.float64)
    w = np.broadcast_to(1.0 if weights is None else np.asarray(weights, dtype=np.float64), x.shape)
    total = w.sum(axis=-1, keepdims=True)
    if not x.shape[-1] or (w < 0).any() or (total <= 0).any():
        raise ValueError("weights must not be negative, and some of each sample must be positive")
    order = np.argsort(x, axis=-1)
    x, w = np.take_along_axis(x, order, axis=-1), np.take_along_axis(w / total, order, axis=-1)
    half_spread = (w * x * (2.0 * np.cumsum(w, axis=-1) - w - 1.0)).sum(axis=-1)
    return (w * np.abs(x - y[..., np.newaxis])).sum(axis=-1) - half_spread
