"""The highest line of an envelope, as the sources of the models read it off their spectra."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from models.response import band_passed

if TYPE_CHECKING:
    from numpy.typing import NDArray

BAND = (500.0, 10_000.0)
"""Band of the envelope, Hz (Ceruti, section 6.1)."""


def highest_line(signal: NDArray[np.float64], rate: float, least: float = 1.0) -> float:
    """Return the frequency of the highest line of the envelope at or above ``least`` Hz, Hz.

    The signal is taken in ``BAND``, its envelope is that of Hilbert's transform less its mean, with Hann's window.
    """
    passed = band_passed(signal, rate, BAND)
    half = np.fft.fft(passed)
    half[len(passed) // 2 :] = 0.0
    envelope = np.abs(np.fft.ifft(2.0 * half))
    lines = np.abs(np.fft.rfft((envelope - np.mean(envelope)) * np.hanning(len(envelope))))
    first = round(least * len(signal) / rate)
    return float(first + np.argmax(lines[first:])) * rate / len(signal)
