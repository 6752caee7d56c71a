"""The fast kurtogram: how impulsive a signal is by frequency and bandwidth.

The range up to the Nyquist frequency is divided into 1, 2, 3, 4, 6, 8, 12, ... equal bands, the 1/3-binary tree of
J. Antoni, "Fast computation of the kurtogram for the detection of transient faults", Mechanical Systems and Signal
Processing 21 (2007) 108-124, doi 10.1016/j.ymssp.2005.12.002. The kurtosis of the complex envelope c of a band is

    K = <|c|^4> / <|c|^2>^2 - 2,

0 for stationary Gaussian noise, -1 for one tone, and large where short bursts stand out. Antoni filters and decimates
in the time domain; here a band is a group of bins of one Fourier transform, whose inverse is c at its critical rate.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from monitor.health.signal.interference import Comb, remove_lines
from monitor.health.signal.plans import previous_smooth
from monitor.health.signal.transform import MIN_SAMPLES, Band

PARTS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64)
"""Numbers of bands into which the range is divided."""
MAX_SAMPLES = 32_768
"""A longer block is cut to this length."""
_MIN_SAMPLES_OF_BAND = 64
NOISE_SD = 6.0
"""Standard deviations of the kurtosis of noise above which a value counts, with some 200 bands looked at."""


@dataclass(frozen=True)
class Kurtogram:
    """Kurtosis by level and band.

    Attributes:
        nyquist: upper end of the range, Hz.
        samples: of the complex envelope of the whole range.
        levels: for each of the first of ``PARTS``, the kurtosis of each band, lowest first.
    """

    nyquist: float
    samples: int
    levels: tuple[tuple[float, ...], ...]

    def band(self, level: int, place: int) -> Band:
        """Return (lo, hi) of a band, Hz."""
        width = self.nyquist / len(self.levels[level])
        return place * width, (place + 1) * width

    def noise_limit(self, level: int) -> float:
        """Return the kurtosis that stationary Gaussian noise does not exceed at a level.

        The variance of the estimate from n independent complex samples is 4 / n; its distribution is skewed.
        """
        return NOISE_SD * 2.0 / math.sqrt(self.samples / len(self.levels[level]))

    def best(self) -> tuple[int, int] | None:
        """Return level and place of the band of the highest kurtosis, None where none is beyond that of noise."""
        cells = [
            (value, level, place)
            for level, row in enumerate(self.levels)
            for place, value in enumerate(row)
            if value > self.noise_limit(level)
        ]
        return None if not cells else max(cells)[1:]

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain values for JSON, the kurtosis with two decimals."""
        return {
            "nyquist": self.nyquist,
            "samples": self.samples,
            "levels": [[round(value, 2) for value in row] for row in self.levels],
        }

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Kurtogram:
        """Return what :meth:`to_dict` gave."""
        levels = tuple(tuple(map(float, row)) for row in values["levels"])
        return cls(float(values["nyquist"]), int(values["samples"]), levels)


def kurtogram(x: NDArray[np.number], rate: float, interference: Sequence[Comb] = ()) -> Kurtogram | None:
    """Return the kurtogram of a block; None where the block is constant or shorter than 128 samples.

    Args:
        x: (sample,), any unit; the first ``MAX_SAMPLES`` are taken.
        rate: Hz.
        interference: combs that are removed before.
    """
    if x.size < max(MIN_SAMPLES, 2 * _MIN_SAMPLES_OF_BAND):
        return None
    n = previous_smooth(min(x.size, MAX_SAMPLES))
    block = x[:n].astype(np.float64)
    block -= block.mean()
    scale = float(np.abs(block).max())
    if not (0.0 < scale < math.inf):
        return None
    spectrum = np.fft.rfft((block / scale).astype(np.float32))
    if interference:
        remove_lines(spectrum, rate / n, interference, 0.0, 0.5 * rate)
    half = n // 2
    spectrum = spectrum[:half]
    spectrum[0] = 0.0
    levels = tuple(_level(spectrum, parts) for parts in PARTS if half // parts >= _MIN_SAMPLES_OF_BAND)
    return Kurtogram(0.5 * rate, half, levels)


def _level(spectrum: NDArray[np.complexfloating], parts: int) -> tuple[float, ...]:
    """Return the kurtosis of each of so many bands of equal width."""
    edges = np.rint(np.linspace(0, spectrum.size, parts + 1)).astype(np.intp)
    length = int(np.diff(edges).min())
    bands = spectrum[edges[:-1, None] + np.arange(length)]
    envelope = np.fft.ifft(bands, axis=1, norm="ortho")
    square = np.square(envelope.real) + np.square(envelope.imag)
    second, fourth = square.mean(axis=1, dtype=np.float64), np.square(square).mean(axis=1, dtype=np.float64)
    ratio = np.divide(fourth, second * second, out=np.full(parts, 2.0), where=second > 0.0)
    return tuple((ratio - 2.0).tolist())
