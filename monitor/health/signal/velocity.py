"""Velocity RMS of a block from 10 to 1000 Hz, integrated in the frequency domain, and what of it may be noise.

Acceleration over 2 pi f is velocity (ISO 2954, ISO 20816-1). The spectrum is that of the Hann-windowed block, whose
leakage falls with the third power of the distance: a slow drift, divided by a low frequency, would otherwise be read as
velocity. The band is a brick wall; ISO 2954 allows a Butterworth filter of third order.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

VELOCITY_BAND = (10.0, 1000.0)
"""Edges of the band, Hz."""
OK, SHORT, LOW_RATE, LOW_FREQUENCY_NOISE, NO_ABSOLUTE_LEVEL, SENSOR_LIMIT = VELOCITY_STATUSES = (
    "ok",
    "short",
    "low_rate",
    "low_frequency_noise",
    "no_absolute_level",
    "sensor_limit",
)
"""What stands beside a velocity."""
MIN_SECONDS = 1.0
"""Ten periods of the lower edge; lines there are then read to 0.5 %."""
MIN_RATE = 2560.0
"""Lowest sampling rate, Hz: below it, anti-alias filters reach into the band."""

_LOW_HZ, _LOW_BINS, _LOW_END, _MIDDLE = 2.0, 3, 14.0, (28.0, 80.0)
_MAX_RISE = 4.0
"""Ratio of the power of the acceleration's floor below 14 Hz to that from 28 to 80 Hz. White noise gives 1, noise of
power 1/f about 7, a step of the sensor's offset about 50."""
_MAX_FLOOR_SHARE = 0.5
_MEDIAN_TO_MEAN = math.log(2.0)
"""Median over mean of the power of a bin of noise, which is distributed exponentially."""


@dataclass(frozen=True)
class Velocity:
    """Velocity of one block.

    Attributes:
        status: one of ``VELOCITY_STATUSES``; both numbers are None unless it is "ok".
        rms: m/s where samples are in m/s2.
        floor: RMS of its continuous part, which noise of the sensor gives as well; the lines hold the rest.
    """

    status: str
    rms: float | None = None
    floor: float | None = None


def velocity_of(spectrum: NDArray[np.complexfloating], n_used: int, rate: float, scale: float = 1.0) -> Velocity:
    """Return the velocity of a block.

    It is refused where the continuous part holds more than half of the power, and that part of the acceleration rises
    towards low frequencies: noise or drift of the sensor cannot be told from vibration there.

    Args:
        spectrum: (n_used // 2 + 1,) real FFT of the samples, without window or scaling.
        n_used: samples.
        rate: sampling rate, Hz.
        scale: factor on the samples.
    """
    if rate < MIN_RATE:
        return Velocity(LOW_RATE)
    if n_used < MIN_SECONDS * rate:
        return Velocity(SHORT)
    resolution = rate / n_used
    last = math.floor(VELOCITY_BAND[1] / resolution + 1e-9)
    windowed = spectrum[1 : last + 1] - 0.5 * spectrum[2 : last + 2]
    # The mean, which the window would carry into the first bin, is not in the signal.
    windowed[1:] -= 0.5 * spectrum[1:last]
    # Mean square of each bin: two sides over the mean square 3/8 of the window, whose half is in the sum above.
    parts = windowed.view(windowed.real.dtype).astype(np.float64).reshape(-1, 2)
    power = np.vecdot(parts, parts) * (0.5 / (0.375 * n_used**2 * scale**2))
    frequency = resolution * np.arange(1, last + 1, dtype=np.float64)
    first = math.ceil(VELOCITY_BAND[0] / resolution - 1e-9) - 1
    weight = np.square(1.0 / (2.0 * math.pi * frequency[first:]))
    total = float(np.vecdot(power[first:], weight))
    floor = min(_floor(power[first:], weight, frequency[first:]), total)
    if floor > _MAX_FLOOR_SHARE * total and _rise(power, frequency) > _MAX_RISE:
        return Velocity(LOW_FREQUENCY_NOISE)
    return Velocity(OK, math.sqrt(total), math.sqrt(floor))


def _floor(power: NDArray[np.float64], weight: NDArray[np.float64], frequency: NDArray[np.float64]) -> float:
    """Return the mean square of the velocity's continuous part: medians of octaves, which lines hardly move.

    Within an octave it is taken to fall as 1/f, between white noise and that of power 1/f2.
    """
    edges = np.searchsorted(frequency, VELOCITY_BAND[0] * 2.0 ** np.arange(1, 7))
    parts = zip(np.split(power * frequency, edges), np.split(weight / frequency, edges), strict=True)
    return sum(_level(part) * float(over.sum()) for part, over in parts)


def _rise(power: NDArray[np.float64], frequency: NDArray[np.float64]) -> float:
    """Return how far the floor of the acceleration stands higher at low frequencies than in the middle of the band."""
    low = (frequency > max(_LOW_HZ, _LOW_BINS * frequency[0])) & (frequency < _LOW_END)
    middle = (frequency >= _MIDDLE[0]) & (frequency < _MIDDLE[1])
    below, above = _level(power[low]), _level(power[middle])
    return below / above if above > 0.0 else math.inf if below > 0.0 else 0.0


def _level(power: NDArray[np.float64]) -> float:
    """Return the mean power of a bin of noise under lines."""
    return float(np.partition(power, power.size // 2)[power.size // 2]) / _MEDIAN_TO_MEAN
