"""The noise floor under the lines of a spectrum."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from models.words.numerics import gamma_quantile

MIN_FLOOR_BINS = 65
"""Least width of the windows from which the floor is taken."""

LINE_OVER_FLOOR = 8.0
"""Bins above this many times the first estimate of the floor are lines and take no part in the second."""


def noise_floor(amplitude: NDArray[np.floating], width: int, n_averages: int = 1) -> NDArray[np.float64]:
    """Return the local mean power of the noise under the lines, shape (bin,).

    The median of the power in windows that overlap by half, without what stands ``LINE_OVER_FLOOR`` times above a first
    median, joined linearly in log power. The power of a bin of Gaussian noise, averaged over K spectra, has the gamma
    distribution of shape K, whose median is a known part of its mean.

    Args:
        amplitude: (bin,).
        width: of a window, in bins.
        n_averages: K.
    """
    windows = _floor_windows(amplitude.size, min(width, amplitude.size))
    # The order of the amplitudes is that of the powers, and float32 is sorted several times as fast as float64.
    rows = amplitude.take(windows.bins)
    rows.sort(axis=1)
    part = _median_of_mean(n_averages)
    middle = rows.shape[1] // 2
    first = 0.5 * (_power(rows[:, (rows.shape[1] - 1) // 2]) + _power(rows[:, middle]))
    highest = np.sqrt((LINE_OVER_FLOOR / part) * first)
    below = np.count_nonzero(rows <= highest.astype(rows.dtype)[:, None], axis=1)
    row = np.arange(len(rows))
    medians = 0.5 * (_power(rows[row, (below - 1) // 2]) + _power(rows[row, below // 2]))
    floor = windows.joined(np.log(np.maximum(medians, np.finfo(np.float64).tiny)))
    np.exp(floor, out=floor)
    floor /= part
    return floor


def _power(amplitude: NDArray[np.floating]) -> NDArray[np.float64]:
    return np.square(amplitude, dtype=np.float64)


@dataclass(frozen=True, eq=False)
class _FloorWindows:
    """Windows of bins, and where each bin stands between their middles.

    Attributes:
        bins: (window, bin in it).
        spacing: (window - 1,) from the middle of one window to that of the next, bins.
        counts: (window + 1,) bins before the first middle, from each middle to the next, and from the last one on.
        beyond: (bin,) bins from the middle before it; 0 before the first one.
    """

    bins: NDArray[np.intp]
    spacing: NDArray[np.float64]
    counts: NDArray[np.intp]
    beyond: NDArray[np.float64]

    def joined(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the values of the windows joined linearly from middle to middle, shape (bin,), level at the ends."""
        slopes = np.zeros(self.counts.size)
        np.divide(np.diff(values), self.spacing, out=slopes[1:-1])
        line = slopes.repeat(self.counts)
        line *= self.beyond
        line += np.concatenate([values[:1], values]).repeat(self.counts)
        return line


@lru_cache(maxsize=16)
def _floor_windows(n_bins: int, width: int) -> _FloorWindows:
    """Return windows of one width that overlap by half and reach both ends."""
    half = max(1, width // 2)
    starts = np.arange(0, max(1, n_bins - width + 1), half)
    if starts[-1] + width < n_bins:
        starts = np.append(starts, n_bins - width)
    middles = starts + half
    counts = np.diff(middles, prepend=0, append=n_bins)
    before = np.concatenate([[0], middles]).repeat(counts)
    beyond = (np.arange(n_bins) - before).astype(np.float64)
    beyond[: middles[0]] = 0.0
    bins = starts[:, None] + np.arange(width)
    return _FloorWindows(bins.astype(np.intp), np.diff(middles).astype(np.float64), counts, beyond)


@lru_cache(maxsize=256)
def _median_of_mean(n_averages: int) -> float:
    """Return the median of the gamma distribution of this shape over its mean: ln 2 for one spectrum."""
    return gamma_quantile(n_averages, 0.5) / n_averages
