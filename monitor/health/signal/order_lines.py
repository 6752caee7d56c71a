"""Lines that follow a shaft of varying speed are taken out of a band before its envelope.

Over time such a line is no line. The analytic signal of the band is brought to equal steps of angle with its carrier,
which spreads the band's own edges over a range of orders; there the lines are limited as everywhere
(:mod:`monitor.health.signal.interference`), and the magnitude of what is left is the envelope over the angle.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from monitor.health.signal.interference import Comb, remove_lines
from monitor.health.signal.orders import Warp
from monitor.health.signal.periodic import between, grid_bins

_MIN_ROOM = 1.05
"""Samples over the angle, over the range of orders that the band covers."""
_MIRRORED_SPACINGS, _MIRRORED_BINS = 4.0, 128
"""Beyond the ends of that range the spectrum is mirrored: the noise at a line is read on both sides."""


def envelope_beside(
    bins: NDArray[np.complexfloating], first: int, warp: Warp, combs: Sequence[Comb], least: int
) -> NDArray[np.floating]:
    """Return the envelope of a band at equal steps of angle, without the lines of combs of the shaft.

    Args:
        bins: (bin,) of the band, of the FFT of the signal over ``warp.duration``, not normalised.
        first: number of the first of them.
        warp: times at equal steps of angle.
        combs: at the mean speed.
        least: number of steps.

    Returns:
        Magnitude of the sum of the bins, each turning; shape (step of angle,).
    """
    lowest = math.floor(first / warp.duration * warp.mean_speed / warp.fastest / warp.resolution)
    highest = math.ceil((first + bins.size) / warp.duration * warp.mean_speed / warp.slowest / warp.resolution)
    points = warp.n_points(max(_MIN_ROOM * (highest - lowest), least))
    corrected, length = grid_bins(bins)
    grid = np.fft.ifft(corrected, length, norm="forward")
    times = warp.points(points, 1.0)
    places = times * (length / warp.duration)
    signal = between(grid, places)
    steps = np.arange(points).reshape(-1, places.shape[0]).T
    turns = times * (first / warp.duration) - steps * (lowest / points)
    angle = (2.0 * np.pi * (turns - np.rint(turns))).astype(signal.real.dtype)
    signal *= np.cos(angle) + 1j * np.sin(angle)
    width = highest - lowest
    spectrum = np.fft.fft(signal.T.ravel())
    spectrum[:width] = _without(spectrum[:width], lowest, warp.resolution, combs)
    return np.abs(np.fft.ifft(spectrum))


def _without(
    spectrum: NDArray[np.complexfloating], lowest: int, resolution: float, combs: Sequence[Comb]
) -> NDArray[np.complexfloating]:
    """Return a spectrum, whose first bin has the number ``lowest``, without the lines of combs."""
    spacing = max(comb.fundamental for comb in combs) / resolution
    mirrored = min(round(_MIRRORED_SPACINGS * spacing) + _MIRRORED_BINS, spectrum.size - 1)
    begin, end = lowest, lowest + spectrum.size
    whole = np.zeros(end + mirrored, dtype=spectrum.dtype)
    padded = np.pad(spectrum, mirrored, mode="reflect")
    least = max(begin - mirrored, 0)
    whole[least:] = padded[least - begin + mirrored :]
    remove_lines(whole, resolution, combs, begin * resolution, (end - 1) * resolution)
    return whole[begin:end]
