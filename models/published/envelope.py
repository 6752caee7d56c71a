"""The highest line of an envelope, as the sources of the models read it off their spectra."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from models.solve.response import band_passed

if TYPE_CHECKING:
    from numpy.typing import NDArray

BAND = (500.0, 10_000.0)
"""Band of the envelope, Hz (Ceruti, section 6.1)."""


def envelope(signal: NDArray[np.float64], rate: float, band: tuple[float, float] = BAND) -> NDArray[np.float64]:
    """Return the magnitude of the analytic signal (Hilbert's transform) within a band, Hz."""
    half = np.fft.fft(band_passed(signal, rate, band))
    half[len(signal) // 2 :] = 0.0
    return np.abs(np.fft.ifft(2.0 * half))


def highest_line(signal: NDArray[np.float64], rate: float, least: float = 1.0) -> float:
    """Return the frequency of the highest line of the envelope in ``BAND`` at or above ``least`` Hz, Hz.

    The envelope is taken less its mean, with Hann's window.
    """
    found = envelope(signal, rate)
    lines = np.abs(np.fft.rfft((found - np.mean(found)) * np.hanning(len(found))))
    first = round(least * len(signal) / rate)
    return float(first + np.argmax(lines[first:])) * rate / len(signal)
