"""Mean squares in third-octave bands, A-weighting, and levels in decibels.

Bands are those of IEC 61260-1 with ideal edges: the exact mid-band frequencies are 1000 G^(x/3) Hz with G = 10^(3/10),
the edges lie at G^(-1/6) and G^(1/6) of them, so that the bands of 630 to 2500 Hz reach from 562.34 to 2818.38 Hz.

The weighting is made of the poles of IEC 61672-1, annex E, which follow from four round frequencies: 1 kHz, the -3 dB
corners 10^1.5 and 10^3.9 Hz of C, and the -3 dB corner 10^2.45 Hz of the pair that A adds. Its gain is exactly 0 dB at
1 kHz.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from models.words.checks import check_positive

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

G = 10.0**0.3
"""Octave ratio to base ten."""
_REFERENCE = 1000.0
_NOMINAL = (1.0, 1.25, 1.6, 2.0, 2.5, 3.15, 4.0, 5.0, 6.3, 8.0)
"""Nominal mid-band frequencies of a decade (ISO 266)."""
MIN_LINES = 12
"""Least number of FFT lines within the narrowest band of a record."""
_LOW, _HIGH, _A_CORNER = 10.0**1.5, 10.0**3.9, 10.0**2.45
REFERENCE_PRESSURE = 20e-6
"""Pa, of sound pressure in air (ISO 1683)."""


@dataclass(frozen=True)
class Bands:
    """Neighbouring third-octave bands, by the numbers x of the first and the last: 0 is that of 1 kHz."""

    first: int
    last: int

    def __post_init__(self) -> None:
        """Raise a ValueError for bands in the wrong order."""
        if self.last < self.first:
            raise ValueError(f"last must not be below first, got {self.first!r} to {self.last!r}")

    @classmethod
    def between(cls, low: float, high: float) -> Bands:
        """Return the bands from the one that contains a frequency, Hz, to that of another: ``between(630, 2500)``."""
        check_positive(low=low, high=high)
        return cls(number_of(low), number_of(high))

    @property
    def numbers(self) -> NDArray[np.int64]:
        """The numbers x, shape (bands,)."""
        return np.arange(self.first, self.last + 1)

    @property
    def centre(self) -> NDArray[np.float64]:
        """Exact mid-band frequencies, Hz."""
        return _REFERENCE * G ** (self.numbers / 3.0)

    @property
    def lower(self) -> NDArray[np.float64]:
        """Lower edges, Hz."""
        return _REFERENCE * G ** ((2 * self.numbers - 1) / 6.0)

    @property
    def upper(self) -> NDArray[np.float64]:
        """Upper edges, Hz; each is the lower edge of the next band, to the last bit."""
        return _REFERENCE * G ** ((2 * self.numbers + 1) / 6.0)

    @property
    def edges(self) -> NDArray[np.float64]:
        """All edges, Hz, shape (bands + 1,)."""
        return np.append(self.lower, self.upper[-1])

    @property
    def nominal(self) -> tuple[float, ...]:
        """Nominal mid-band frequencies, Hz, as they are printed: 31.5, 1250."""
        decades = (divmod(int(x), 10) for x in self.numbers)
        return tuple(float(f"{_NOMINAL[step] * 10.0 ** (decade + 3):.4g}") for decade, step in decades)


def number_of(frequency: float) -> int:
    """Return the number of the band that contains a frequency, Hz; an edge belongs to the band above it."""
    number = round(10.0 * math.log10(frequency / _REFERENCE))
    band = Bands(number, number)
    return number + int(frequency >= band.upper[0]) - int(frequency < band.lower[0])


def bands_of_density(frequency: ArrayLike, density: ArrayLike, bands: Bands) -> NDArray[np.float64]:
    """Return the mean square in each band of a one-sided power density, shape (..., bands).

    The density is constant from half-way to the line below to half-way to that above; a line whose cell lies across an
    edge is shared.

    Args:
        frequency: (lines,) ascending, Hz.
        density: (..., lines), the unit squared a hertz.
        bands: the bands, all within the lines.

    Raises:
        ValueError: if a band reaches beyond the lines.
    """
    f, values = np.asarray(frequency, np.float64), np.asarray(density, np.float64)
    cells = np.concatenate(([f[0]], 0.5 * (f[1:] + f[:-1]), [f[-1]]))
    if bands.lower[0] < f[0]:
        raise ValueError(
            f"the band of {bands.nominal[0]:g} Hz reaches down to {bands.lower[0]:.2f} Hz, below {f[0]:g} Hz"
        )
    if bands.upper[-1] > f[-1]:
        raise ValueError(
            f"the band of {bands.nominal[-1]:g} Hz reaches up to {bands.upper[-1]:.2f} Hz, above {f[-1]:g} Hz"
        )
    below = np.concatenate((np.zeros((*values.shape[:-1], 1)), np.cumsum(values * np.diff(cells), axis=-1)), axis=-1)
    rows = [np.interp(bands.edges, cells, row) for row in below.reshape(-1, len(cells))]
    return np.diff(np.reshape(rows, (*values.shape[:-1], len(bands.edges))), axis=-1)


def density_of_record(
    record: ArrayLike, rate: float, resolution: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return lines, Hz, and the one-sided power density of a record by Welch's method.

    Hann windows overlap by three quarters. Their density has the mean square of the windowed samples exactly; the mean
    of each segment is not removed.

    Args:
        record: (..., samples), even samples a second.
        rate: samples a second.
        resolution: distance of lines, Hz, at most.

    Raises:
        ValueError: if the record is shorter than one segment.
    """
    check_positive(rate=rate, resolution=resolution)
    values = np.asarray(record, np.float64)
    length = 2 * math.ceil(0.5 * rate / resolution)
    samples = values.shape[-1]
    if samples < length:
        raise ValueError(f"record has {samples / rate:.3g} s, lines at {resolution:.3g} Hz need {length / rate:.3g} s")
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(length) / length)
    step = max(length // 4, 1)
    starts = range(0, samples - length + 1, step)
    total = np.zeros((*values.shape[:-1], length // 2 + 1))
    for start in starts:
        total += np.abs(np.fft.rfft(window * values[..., start : start + length], axis=-1)) ** 2
    density = 2.0 * total / (len(starts) * rate * np.sum(window**2))
    density[..., [0, -1]] *= 0.5
    return np.asarray(np.fft.rfftfreq(length, 1.0 / rate), np.float64), density


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


def a_weighting(frequency: ArrayLike) -> NDArray[np.float64]:
    """Return the squared modulus of the gain of A, one at 1 kHz, by which mean squares and densities are weighted."""
    s = np.asarray(1j * np.asarray(frequency, np.float64), np.complex128)
    return np.abs(_unscaled(s) / abs(_unscaled(np.asarray(1j * _REFERENCE)))) ** 2


def _unscaled(s: NDArray[np.complex128]) -> NDArray[np.complex128]:
    f1, f2, f3, f4 = POLES
    return (s / (s + f1)) ** 2 / (s + f4) ** 2 * s**2 / ((s + f2) * (s + f3))


def level_db(mean_square: ArrayLike, reference: float = REFERENCE_PRESSURE) -> NDArray[np.float64]:
    """Return 10 lg of mean squares by that of the reference, dB; minus infinity of zero.

    Raises:
        ValueError: if a mean square is negative or not a number.
    """
    values = np.asarray(mean_square, np.float64)
    if not np.all(values >= 0.0):
        raise ValueError(f"mean_square must not be negative, got {float(np.min(values))!r}")
    found = np.full(values.shape, -np.inf)
    np.log10(values / reference**2, out=found, where=values > 0.0)
    return 10.0 * found


def sum_db(levels: ArrayLike) -> float:
    """Return the level of the sum of incoherent parts, dB; minus infinity of none."""
    return float(level_db(np.sum(10.0 ** (0.1 * np.asarray(levels, np.float64))), 1.0))
