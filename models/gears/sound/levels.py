"""Levels in decibels of mean squares, sums of levels, and the frequency weightings A, C and Z of sound level meters.

The weightings are made of the poles of IEC 61672-1, annex E, which follow from four round frequencies: 1 kHz, the -3 dB
corners 10^1.5 and 10^3.9 Hz of C, and the -3 dB corner 10^2.45 Hz of the pair that A adds. Gains are exactly 0 dB at
1 kHz.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from models.words.checks import check_choice, check_positive

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

WEIGHTINGS = ("A", "C", "Z")
_REFERENCE = 1000.0
_LOW, _HIGH, _A_CORNER = 10.0**1.5, 10.0**3.9, 10.0**2.45


def _poles() -> tuple[float, float, float, float]:
    """Return f1 to f4 of Eqs. E.1 to E.6, Hz: about 20.60, 107.65, 737.86 and 12194."""
    d = math.sqrt(0.5)
    b = (_REFERENCE**2 + (_LOW * _HIGH / _REFERENCE) ** 2 - d * (_LOW**2 + _HIGH**2)) / (1.0 - d)
    c = (_LOW * _HIGH) ** 2
    root = math.sqrt(b * b - 4.0 * c)
    half = math.sqrt(5.0) / 2.0
    low, high = math.sqrt(0.5 * (-b - root)), math.sqrt(0.5 * (-b + root))
    return low, (1.5 - half) * _A_CORNER, (1.5 + half) * _A_CORNER, high


POLES = _poles()
"""Frequencies of the poles, Hz: the first and the last are double."""


def response(frequency: ArrayLike, kind: str = "A") -> NDArray[np.complex128]:
    """Return the complex gain of a weighting, of modulus one at 1 kHz; frequencies in Hz.

    Raises:
        ValueError: if the weighting is none of A, C and Z.
    """
    check_choice(kind, "weighting", WEIGHTINGS)
    s = np.asarray(1j * np.asarray(frequency, np.float64), np.complex128)
    if kind == "Z":
        return np.ones_like(s)
    return _unscaled(s, kind) / abs(_unscaled(np.asarray(1j * _REFERENCE), kind))


def _unscaled(s: NDArray[np.complex128], kind: str) -> NDArray[np.complex128]:
    f1, f2, f3, f4 = POLES
    gain = (s / (s + f1)) ** 2 / (s + f4) ** 2
    return gain * s**2 / ((s + f2) * (s + f3)) if kind == "A" else gain


def power(frequency: ArrayLike, kind: str = "A") -> NDArray[np.float64]:
    """Return the squared modulus of the gain, by which mean squares and densities are weighted."""
    return np.abs(response(frequency, kind)) ** 2


def weighting_db(frequency: ArrayLike, kind: str = "A") -> NDArray[np.float64]:
    """Return a weighting, dB; minus infinity at 0 Hz for A and C."""
    gains = power(frequency, kind)
    found = np.full(gains.shape, -np.inf)
    np.log10(gains, out=found, where=gains > 0.0)
    return 10.0 * found


def weigh_record(record: ArrayLike, rate: float, kind: str = "A") -> NDArray[np.float64]:
    """Return a record through the weighting, the same samples long; the record is zero before its begin.

    The exact gain, with its phase, multiplies the spectrum of the record with zeros after it, 0.25 s at least, into
    which the response rings out; there is no warping of a digital filter near half the rate.

    Args:
        record: (..., samples).
        rate: samples a second.
        kind: A, C or Z.
    """
    check_positive(rate=rate)
    values = np.asarray(record, np.float64)
    samples = values.shape[-1]
    padded = 1 << (samples + math.ceil(0.25 * rate) - 1).bit_length()
    spectrum = np.fft.rfft(values, padded, axis=-1)
    spectrum *= response(np.fft.rfftfreq(padded, 1.0 / rate), kind)
    return np.fft.irfft(spectrum, padded, axis=-1)[..., :samples]


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
