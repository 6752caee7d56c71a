"""What a particle's features should be, all blocks at once: one large Gaussian instead of a Kalman filter."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def path_covariance(w: Floats, s: Floats, distance: Floats, gain_variance: float, noise: Floats) -> Floats:
    """Covariance of one feature over the n blocks of a known path: w (b + s z) + e.

    Args:
        w: shape (n,).
        s: shape (n,).
        distance: covered between blocks, in correlation lengths, shape (n - 1,).
        gain_variance: of b.
        noise: variance of e, shape (n,).
    """
    place = np.concatenate(([0.0], np.cumsum(distance)))
    z = np.exp(-np.abs(place[:, None] - place[None, :]))
    return np.outer(w, w) * (gain_variance + np.outer(s, s) * z) + np.diag(noise)


def strangeness(w: Floats, s: Floats, distance: Floats, gain_variance: float, noise: Floats, residual: Floats) -> float:
    """Square of the Mahalanobis length of the residuals of a path."""
    covariance = path_covariance(w, s, distance, gain_variance, noise)
    return float(residual @ np.linalg.solve(covariance, residual))


def latest_b_and_z(
    w: Floats, s: Floats, distance: Floats, gain_variance: float, noise: Floats, residual: Floats
) -> tuple[Floats, Floats]:
    """Mean (2,) and covariance (2, 2) of b and of z at the last block, given all residuals."""
    place = np.concatenate(([0.0], np.cumsum(distance)))
    with_b = gain_variance * w
    with_z = w * s * np.exp(-(place[-1] - place))
    cross = np.stack((with_b, with_z))
    gain = np.linalg.solve(path_covariance(w, s, distance, gain_variance, noise), cross.T).T
    return gain @ residual, np.diag([gain_variance, 1.0]) - gain @ cross.T


def posterior_of_one_block(
    ln_v: Floats, ln_density_of_v: Floats, ln_like: Floats, levels: tuple[float, ...]
) -> list[float]:
    """Quantiles of ln V on a fine grid: prior times likelihood, summed."""
    weight = np.exp(ln_density_of_v + ln_like - np.max(ln_density_of_v + ln_like))
    total = np.cumsum(weight)
    return [float(np.interp(level, total / total[-1], ln_v)) for level in levels]
