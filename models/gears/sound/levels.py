"""Levels of sound: decibels of mean squares, their sums, the weightings A, C and Z, and third-octave bands.

The weightings are made of the poles of IEC 61672-1, annex E, which follow from four round frequencies: 1 kHz, the -3 dB
corners 10^1.5 and 10^3.9 Hz of C, and the -3 dB corner 10^2.45 Hz of the pair that A adds. Gains are exactly 0 dB at
1 kHz.

The exact mid-band frequencies of third-octave bands (IEC 61260-1) are 1000 G^(x/3) Hz with G = 10^(3/10), the edges lie
at G^(-1/6) and G^(1/6) of them: the bands of 630 to 2500 Hz reach from 562.34 to 2818.38 Hz. Bands here have ideal
edges by default; ``power_gain`` is the response of the filters of ``filter_bank``, which shares a tone near an edge
between two bands as an analyser does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from models.words.checks import check_choice, check_positive

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

WEIGHTINGS = ("A", "C", "Z")
_REFERENCE = 1000.0
_LOW, _HIGH, _A_CORNER = 10.0**1.5, 10.0**3.9, 10.0**2.45
G = 10.0**0.3
"""Octave ratio to base ten."""
_NOMINAL = (1.0, 1.25, 1.6, 2.0, 2.5, 3.15, 4.0, 5.0, 6.3, 8.0)
"""Nominal mid-band frequencies of a decade (ISO 266)."""
ORDER = 6
"""Order of the low pass behind a filter's band pass; its effective bandwidth is then scaled to that of the band."""
SHAPES = ("ideal", "filter")
MIN_LINES = 12
"""Least number of FFT lines within the narrowest band of a record."""


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

    def __len__(self) -> int:
        """Return the number of bands."""
        return self.last - self.first + 1


def number_of(frequency: float) -> int:
    """Return the number of the band that contains a frequency, Hz; an edge belongs to the band above it."""
    number = round(10.0 * math.log10(frequency / _REFERENCE))
    band = Bands(number, number)
    return number + int(frequency >= band.upper[0]) - int(frequency < band.lower[0])


AUDIBLE = Bands(-17, 13)
"""20 Hz to 20 kHz."""


def power_gain(bands: Bands, frequency: ArrayLike, shape: str = "ideal") -> NDArray[np.float64]:
    """Return the squared modulus of the gain of each band at frequencies in Hz, shape (bands, frequencies).

    Args:
        bands: the bands.
        frequency: (frequencies,) Hz.
        shape: "ideal", one from the lower edge to just below the upper one, else zero; or "filter", the analogue
            Butterworth band pass of order 2 * ``ORDER`` whose effective bandwidth is the band's.
    """
    check_choice(shape, "shape", SHAPES)
    f = np.atleast_1d(np.asarray(frequency, np.float64))
    if shape == "ideal":
        edges = bands.edges[:, None]
        return ((f >= edges[:-1]) & (f < edges[1:])).astype(np.float64)
    centre = bands.centre[:, None]
    width = (bands.upper - bands.lower)[:, None] * bandwidth_factor()
    with np.errstate(divide="ignore", over="ignore"):
        return 1.0 / (1.0 + ((f - centre**2 / f) / width) ** (2 * ORDER))


def bandwidth_factor() -> float:
    """Return the width between the -3 dB points of a Butterworth filter by its effective bandwidth, below one."""
    angle = 0.5 * math.pi / ORDER
    return math.sin(angle) / angle


def bands_of_lines(
    frequency: ArrayLike, mean_square: ArrayLike, bands: Bands, *, shape: str = "ideal"
) -> NDArray[np.float64]:
    """Return the mean square in each band of sines, shape (..., bands).

    Args:
        frequency: (lines,) Hz.
        mean_square: (..., lines), weighted or not.
        bands: the bands; lines outside all of them count nowhere.
        shape: as in ``power_gain``.
    """
    return np.asarray(mean_square, np.float64) @ power_gain(bands, frequency, shape).T


def bands_of_density(
    frequency: ArrayLike, density: ArrayLike, bands: Bands, *, shape: str = "ideal"
) -> NDArray[np.float64]:
    """Return the mean square in each band of a one-sided power density, shape (..., bands).

    The density is constant from half-way to the line below to half-way to that above; a line whose cell lies across an
    edge is shared.

    Args:
        frequency: (lines,) ascending, Hz.
        density: (..., lines), the unit squared a hertz.
        bands: the bands, all within the lines.
        shape: as in ``power_gain``.

    Raises:
        ValueError: if a band reaches beyond the lines.
    """
    f, values = np.asarray(frequency, np.float64), np.asarray(density, np.float64)
    cells = np.concatenate(([f[0]], 0.5 * (f[1:] + f[:-1]), [f[-1]]))
    _check_covered(bands, float(f[0]), float(f[-1]))
    if shape == "filter":
        return bands_of_lines(f, values * np.diff(cells), bands, shape=shape)
    below = np.concatenate((np.zeros((*values.shape[:-1], 1)), np.cumsum(values * np.diff(cells), axis=-1)), axis=-1)
    rows = [np.interp(bands.edges, cells, row) for row in below.reshape(-1, len(cells))]
    return np.diff(np.reshape(rows, (*values.shape[:-1], len(bands) + 1)), axis=-1)


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


def bands_of_record(
    record: ArrayLike, rate: float, bands: Bands, *, shape: str = "ideal", weighting: str = "Z"
) -> NDArray[np.float64]:
    """Return the mean square of a record in each band by FFT, shape (..., bands).

    At least ``MIN_LINES`` lines lie within the narrowest band. Where tones matter that lie within a line or two of an
    edge, a longer record shares them more sharply.

    Args:
        record: (..., samples), even samples a second.
        rate: samples a second.
        bands: the bands, below half the rate.
        shape: as in ``power_gain``.
        weighting: A, C or Z, applied to each line.

    Raises:
        ValueError: if the record is too short for the narrowest band or a band reaches beyond half the rate.
    """
    check_positive(rate=rate)
    _check_covered(bands, 0.0, 0.5 * rate)
    longest = np.asarray(record).shape[-1] / rate
    # Up to eight times the lines that the narrowest band needs, while 16 segments remain.
    needed = float(bands.upper[0] - bands.lower[0]) / MIN_LINES
    resolution = min(needed, max(needed / 8.0, 5.0 / longest))
    frequency, density = density_of_record(record, rate, resolution)
    return bands_of_density(frequency, density * power(frequency, weighting), bands, shape=shape)


def _check_covered(bands: Bands, low: float, high: float) -> None:
    """Raise a ValueError that names a band which is not within two frequencies, Hz."""
    if bands.lower[0] < low:
        raise ValueError(
            f"the band of {bands.nominal[0]:g} Hz reaches down to {bands.lower[0]:.2f} Hz, below {low:g} Hz"
        )
    if bands.upper[-1] > high:
        raise ValueError(
            f"the band of {bands.nominal[-1]:g} Hz reaches up to {bands.upper[-1]:.2f} Hz, above {high:g} Hz"
        )
