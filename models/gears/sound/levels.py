"""Levels in decibels of mean squares, and sums of levels."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

REFERENCE_PRESSURE = 20e-6
"""Pa, of sound pressure in air (ISO 1683)."""


def level_db(mean_square: ArrayLike, reference: float = REFERENCE_PRESSURE) -> NDArray[np.float64]:
    """Return 10 lg of mean squares by that of the reference, dB; minus infinity of zero.

    Raises:
        ValueError: if a mean square is negative or not a number, or the reference is not positive.
    """
    values = np.asarray(mean_square, np.float64)
    if not np.all(values >= 0.0):
        raise ValueError(f"mean_square must not be negative, got {float(np.min(values))!r}")
    if not (math.isfinite(reference) and reference > 0.0):
        raise ValueError(f"reference must be positive and finite, got {reference!r}")
    found = np.full(values.shape, -np.inf)
    np.log10(values / reference**2, out=found, where=values > 0.0)
    return 10.0 * found


def mean_square_of(level: ArrayLike, reference: float = REFERENCE_PRESSURE) -> NDArray[np.float64]:
    """Return the mean squares of levels in dB."""
    return reference**2 * 10.0 ** (0.1 * np.asarray(level, np.float64))


def sum_db(levels: ArrayLike) -> float:
    """Return the level of the sum of incoherent parts, dB; minus infinity of none."""
    return float(level_db(np.sum(mean_square_of(levels, 1.0)), 1.0))


def line_mean_squares(amplitude: ArrayLike) -> NDArray[np.float64]:
    """Return the mean squares of sines from their (complex) amplitudes, peak values."""
    return 0.5 * np.abs(np.asarray(amplitude)) ** 2
