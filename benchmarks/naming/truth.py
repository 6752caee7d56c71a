"""What is really in a recording: the depth of a comb, measured without the code that names it.

The definition is the one of the program: root sum of squares of the first five lines of the envelope spectrum over the
mean envelope, the power of the noise taken off, the highest line at most four times the others. The way is another:
double precision, the analytic signal of the whole recording, the noise from the median of the bins between the lines.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len

Samples = NDArray[np.float64]
FINDABLE = 0.3
"""Depth from which a comb is expected to be found."""

N_LINES = 5
_HANN_POWER = 1.5
_HALF = 2
_MOST_BINS = 60
_MOST_OF_ONE = 4.0


@dataclass(frozen=True)
class Envelope:
    """Power spectrum of the envelope over its mean, Hann window, bin 0 at 0 Hz.

    Attributes:
        power: (bin,) square of the single-sided amplitude.
        resolution: spacing of the bins, Hz.
    """

    power: Samples
    resolution: float


def envelope_spectrum(x: NDArray[np.floating], rate: float, band: tuple[float, float]) -> Envelope:
    """Return the spectrum of the envelope of the samples (n,) in a band (lo, hi), Hz."""
    n = x.size
    while next_fast_len(n, real=True) != n:
        n -= 1
    lines = np.fft.rfft(x[:n].astype(np.float64))
    frequency = np.arange(lines.size) * (rate / n)
    lines[(frequency < band[0]) | (frequency > band[1])] = 0.0
    analytic = np.zeros(n, dtype=np.complex128)
    analytic[: lines.size] = 2.0 * lines
    envelope = np.abs(np.fft.ifft(analytic))
    window = np.hanning(n + 1)[:n]
    amplitude = 2.0 * np.abs(np.fft.rfft(window * (envelope / envelope.mean() - 1.0))) / window.sum()
    return Envelope(np.square(amplitude), rate / n)


def comb_depth(envelope: Envelope, line: float, reach: float = 0.0) -> float:
    """Return the depth of the comb of a fundamental (Hz), the deepest within ``reach`` (relative) of it.

    0 where its lines are closer than eight bins or lie beyond the spectrum.
    """
    spacing = line / envelope.resolution
    if spacing < 8.0 or N_LINES * spacing * (1.0 + reach) + _HALF >= envelope.power.size:
        return 0.0
    noise = np.array([_noise(envelope.power, k * spacing, spacing) for k in range(1, N_LINES + 1)])
    step = 0.25 / (N_LINES * spacing)
    count = max(0, int(np.ceil(reach / step)))
    best = 0.0
    for factor in 1.0 + step * np.arange(-count, count + 1):
        bins = np.rint(factor * spacing * np.arange(1, N_LINES + 1)).astype(int)
        power = np.array([envelope.power[b - _HALF : b + _HALF + 1].sum() for b in bins]) / _HANN_POWER
        best = max(best, _depth(power - noise))
    return best


def _noise(power: Samples, place: float, spacing: float) -> float:
    """Return the power that noise puts under a line: five bins of the mean of exponential noise, from its median."""
    reach = round(min(0.45 * spacing, _MOST_BINS))
    middle = round(place)
    near = np.arange(max(2, middle - reach), min(power.size, middle + reach + 1))
    beside = power[near[np.abs(near - middle) > _HALF]]
    if beside.size == 0:
        return 0.0
    return float(np.median(beside)) / np.log(2.0) * (2 * _HALF + 1) / _HANN_POWER


def _depth(net: Samples) -> float:
    highest = float(net.max())
    others = max(float(net.sum()) - highest, 0.0)
    return float(np.sqrt(others + min(max(highest, 0.0), _MOST_OF_ONE**2 * others)))
