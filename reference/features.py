"""Slow and obvious counterparts of the features: float64, full length, one formula after the other.

They share no code with ``monitor/health``.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray


def envelope_spectrum(
    x: NDArray[np.floating], rate: float, band: tuple[float, float]
) -> tuple[NDArray[np.float64], float]:
    """Spectrum of the envelope of a brick-wall band, at the full sampling rate.

    Args:
        x: (n,) samples; n is not cut.
        rate: Hz.
        band: (lo, hi), Hz, edges included; the mean and the Nyquist frequency are not.

    Returns:
        (n // 2 + 1,) single-sided amplitudes of the Hann-windowed envelope without its mean, and the mean.
    """
    n = x.size
    transform = np.fft.fft(np.asarray(x, np.float64))
    frequency = np.fft.fftfreq(n, 1.0 / rate)
    tiny = 1e-9 * rate / n
    inside = (frequency > tiny) & (frequency >= band[0] - tiny) & (frequency <= band[1] + tiny)
    if n % 2 == 0:
        inside[n // 2] = False
    analytic = np.fft.ifft(np.where(inside, 2.0 * transform, 0.0))
    envelope = np.sqrt(analytic.real**2 + analytic.imag**2)
    mean = float(envelope.mean())
    return hann_spectrum(envelope - mean), mean


def hann_spectrum(x: NDArray[np.floating]) -> NDArray[np.float64]:
    """Single-sided amplitude spectrum of x under a periodic Hann window, (n // 2 + 1,)."""
    n = x.size
    window = 0.5 * (1.0 - np.cos(2.0 * np.pi * np.arange(n) / n))
    return 2.0 * np.abs(np.fft.rfft(np.asarray(x, np.float64) * window)) / window.sum()


def line_amplitude(amplitude: NDArray[np.floating], resolution: float, frequency: float, half: int = 2) -> float:
    """Root of the sum of squares of the bins nearest to a frequency, over sqrt(1.5)."""
    centre = round(frequency / resolution)
    return math.sqrt(sum(float(amplitude[k]) ** 2 for k in range(centre - half, centre + half + 1)) / 1.5)


def best_factor(amplitude: NDArray[np.floating], resolution: float, fundamental: float, search: float) -> float:
    """The speed factor with the greatest sum of five amplitudes, from a very fine grid."""
    step = 0.02 * resolution / (5.0 * fundamental)
    factors = np.arange(1.0 - search, 1.0 + search, step)
    sums = [
        sum(line_amplitude(amplitude, resolution, h * factor * fundamental, half=1) for h in range(1, 6))
        for factor in factors
    ]
    # The nearest-bin sum has plateaus: the middle of the best one.
    best = np.flatnonzero(np.isclose(sums, max(sums), rtol=1e-12))
    return float(factors[best].mean())


def band_rms(x: NDArray[np.floating], rate: float, band: tuple[float, float]) -> float:
    """Root mean square of what a brick-wall band (edges included, mean excluded) leaves of x, in the time domain."""
    n = x.size
    transform = np.fft.fft(np.asarray(x, np.float64))
    frequency = np.abs(np.fft.fftfreq(n, 1.0 / rate))
    tiny = 1e-9 * rate / n
    inside = (frequency >= band[0] - tiny) & (frequency <= band[1] + tiny) & (frequency > tiny)
    if n % 2 == 0:
        inside[n // 2] = False
    filtered = np.fft.ifft(np.where(inside, transform, 0.0)).real
    return math.sqrt(float(np.mean(filtered**2)))


def indicators(x: NDArray[np.floating]) -> dict[str, float]:
    """The time-domain indicators, sample by sample, with exact sums."""
    samples = [float(value) for value in x]
    n = len(samples)
    mean = math.fsum(samples) / n
    variance = math.fsum((v - mean) ** 2 for v in samples) / n
    rms = math.sqrt(variance)
    peak = max(abs(v) for v in samples)
    mean_abs = math.fsum(abs(v) for v in samples) / n
    mean_root = math.fsum(math.sqrt(abs(v)) for v in samples) / n
    return {
        "mean": mean,
        "rms": rms,
        "peak": peak,
        "peak_half_range": 0.5 * (max(samples) - min(samples)),
        "kurtosis": math.fsum((v - mean) ** 4 for v in samples) / n / variance**2,
        "skewness": math.fsum((v - mean) ** 3 for v in samples) / n / variance**1.5,
        "crest_factor": peak / rms,
        "shape_factor": rms / mean_abs,
        "impulse_factor": peak / mean_abs,
        "clearance_factor": peak / mean_root**2,
    }
