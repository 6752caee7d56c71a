"""The vibration of a simulated bearing: RMS, peak, lines, and the signal at any sampling rate."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

Sensor = Literal["mo", "mr"]
Status = Literal["converged", "not_periodic", "not_converged", "inaccurate"]
STATUSES: tuple[Status, ...] = ("converged", "not_periodic", "not_converged", "inaccurate")

HARMONICS = 6
# Share of the Nyquist frequency below the transition band of a recorder's anti-alias filter.
PASSBAND = 0.9
SENSORS: dict[str, int] = {"mo": 0, "mr": 1}
_CHUNK = 8192
_PEAK_OVERSAMPLING = 8


@dataclass(frozen=True, eq=False)
class Response:
    """The settled vibration of one scene along the load. SI units; sensor "mo" is the casing, "mr" the resonator.

    Attributes:
        rms, peak: RMS (over several periods where the motion does not repeat) and largest absolute value of a_o in
            ``rms_band``, m/s2; ``rms_resonator`` and ``peak_resonator`` the same of a_r.
        rms_error: relative error of ``rms``, estimated: that of the steps from halving them, or the standard error of
            the mean where the motion does not repeat.
        bpfo: ball-pass frequency over the outer race, Hz, with which the motion repeats.
        harmonics: single-sided amplitudes of the first six lines k * bpfo of a_o, m/s2, shape (6,).
        harmonics_error: their estimated errors, m/s2, NaN where the motion does not repeat.
        period_change: relative change of the full-bandwidth RMS between the last two of ``periods`` ball periods.
        spread: standard deviation of that RMS from period to period, m/s2; zero if the motion repeats, NaN if it
            diverged (then the status is "not_converged").
        multiplier: largest absolute Floquet multiplier of the motion that repeats; beyond 1 it is unstable, and what is
            simulated instead is given. NaN where none was found.
        status: "converged" (it repeats, is stable, and ``rms_error`` is within what was asked), "inaccurate" (it is
            not), "not_periodic" (a mean and a spread are given) or "not_converged" (unusable).
        rms_band: the band (lo, hi), Hz, to which RMS and peak refer, or None for the full bandwidth.
        coefficients: complex Fourier coefficients c_k of exp(2 pi i k bpfo t), k = 0..K, of a_o and a_r, m/s2, shape
            (2, K + 1). The amplitude of line k is 2 |c_k|. Where the motion does not repeat, their amplitudes are
            those of the mean power and their phases those of the last period.
    """

    rms: float
    rms_error: float
    peak: float
    rms_resonator: float
    peak_resonator: float
    bpfo: float
    harmonics: NDArray[np.float64]
    harmonics_error: NDArray[np.float64]
    periods: int
    period_change: float
    spread: float
    multiplier: float
    model: str
    status: Status
    rms_band: tuple[float, float] | None
    coefficients: NDArray[np.complex128]

    def lines(self, sensor: Sensor = "mo") -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return frequencies, Hz, and single-sided amplitudes, m/s2, of the lines k * bpfo, k = 1..K."""
        amplitude = 2.0 * np.abs(self.coefficients[SENSORS[sensor], 1:])
        return np.arange(1.0, len(amplitude) + 1.0) * self.bpfo, amplitude

    def rms_in_band(self, low: float, high: float, sensor: Sensor = "mo") -> float:
        """Return the RMS of the lines from ``low`` to ``high`` (both included), Hz, in m/s2.

        Raises:
            ValueError: if the band is empty or reaches beyond the lines that were computed.
        """
        check_band((low, high))
        frequency, amplitude = self.lines(sensor)
        if high > frequency[-1] + self.bpfo:
            raise ValueError(f"band ends at {high!r} Hz, the response was computed up to {frequency[-1]:.0f} Hz")
        inside = (frequency >= low) & (frequency <= high)
        return math.sqrt(0.5 * float(np.sum(amplitude[inside] ** 2)))

    def acceleration(
        self,
        rate: float,
        duration: float,
        phase: float = 0.0,
        *,
        sensor: Sensor = "mo",
        band: tuple[float, float] | None = None,
    ) -> NDArray[np.float64]:
        """Return the signal as a recorder would sample it, m/s2, shape (round(rate * duration),).

        Lines above 0.9 of the Nyquist frequency are left out, as by an ideal anti-alias filter; the others are exact
        at every sample. ``phase`` shifts the ball passages, rad: 2 pi is one ball period.

        Raises:
            ValueError: if rate or duration is not positive and finite, or the band is empty.
        """
        for name, value in (("rate", rate), ("duration", duration)):
            if not (math.isfinite(value) and value > 0.0):
                raise ValueError(f"{name} must be positive and finite, got {value!r}")
        low, high = (0.0, math.inf) if band is None else check_band(band)
        coefficients = 2.0 * self.coefficients[SENSORS[sensor]]
        frequency = self.bpfo * np.arange(len(coefficients))
        keep = (frequency >= low) & (frequency <= high) & (frequency <= PASSBAND * 0.5 * rate) & (frequency > 0.0)
        coefficients = np.where(keep, coefficients, 0.0)[: int(np.flatnonzero(keep)[-1]) + 1 if keep.any() else 1]
        samples = round(rate * duration)
        signal = np.empty(samples)
        for start in range(0, samples, _CHUNK):
            n = np.arange(start, min(start + _CHUNK, samples))
            # The phase is reduced to one turn before it is multiplied by k, so that long signals lose no digits.
            turn = np.mod(n * (self.bpfo / rate), 1.0)
            signal[start : start + len(n)] = _series(coefficients, np.exp(1j * (2.0 * np.pi * turn + phase)))
        return signal


def _series(coefficients: NDArray[np.complex128], unit: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Return the real part of sum c_k unit**k by Horner's rule."""
    total = np.full(unit.shape, coefficients[-1], dtype=np.complex128)
    for c in coefficients[-2::-1]:
        np.multiply(total, unit, out=total)
        np.add(total, c, out=total)
    return np.real(total)


def check_band(band: tuple[float, float]) -> tuple[float, float]:
    """Return a band; raise a ValueError unless 0 <= lo < hi."""
    low, high = band
    if not 0.0 <= low < high:
        raise ValueError(f"a band needs 0 <= lo < hi, got {low!r} to {high!r} Hz")
    return low, high


def peak_in_band(coefficients: NDArray[np.complex128], low: int, high: int) -> float:
    """Return the largest absolute value of the lines low..high (multiples of the fundamental) over one period."""
    size = 1 << max(6, (_PEAK_OVERSAMPLING * (high + 1) - 1).bit_length())
    spectrum = np.zeros(size // 2 + 1, dtype=np.complex128)
    spectrum[low : high + 1] = coefficients[low : high + 1]
    return float(np.max(np.abs(np.fft.irfft(spectrum, size)))) * size
