"""A time-frequency plane that stays sharp while the speed changes: short spectra over time warped by each growth rate.

Within a short window the speed is taken to grow at a steady relative rate; the signal is read at the times at which a
shaft that grows so turns by equal angles, and its lines are then sharp at all orders at once (the fan-chirp transform:
Weruaga and Kepesi, "The fan-chirp transform for non-stationary harmonic signals", Signal Processing 87 (2007)
1504-1522, doi 10.1016/j.sigpro.2007.01.006).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from monitor.health.signal.plans import next_smooth

_DENSITY = 16
"""Samples per period of the highest line in the rows that are read at the nearest sample: errors below -29 dB."""
_ENVELOPE_SPAN = (0.05, 0.45)
"""Band that is demodulated, of the sampling rate."""
_MAINS = (50.0, 60.0)
_MAINS_HALF_WIDTH = 0.25
_MAINS_HEIGHT = 30.0
"""Lines of a supply, Hz, half width of what is taken out, and power over that of their surroundings from which."""
_SAMPLES_PER_PERIOD = 2.5
_PADDING = 2
_LEAST, _MOST = -1.0, 4.0
"""Limits of one line, ln of power over its surroundings, so that a comb needs several lines."""
_BEYOND = 0.6
"""Share of what stands above the limit that counts."""
_SURROUNDINGS = 1.5
"""Half width of the surroundings of a line, in multiples of the lowest candidate."""


@dataclass(frozen=True, eq=False)
class LowRows:
    """The lower part of a signal and of its envelope, densely sampled.

    Attributes:
        rate: sampling rate, Hz.
        rows: shape (2, sample): the signal and its envelope, each with a mean of zero.
        top: highest frequency that they hold, Hz.
    """

    rate: float
    rows: NDArray[np.float32]
    top: float

    @property
    def duration(self) -> float:
        """Length of the rows, s."""
        return self.rows.shape[1] / self.rate


def low_rows(samples: NDArray[np.floating], rate: float, top: float) -> LowRows:
    """Return signal and envelope up to a frequency.

    Args:
        samples: shape (sample,), any unit.
        rate: Hz.
        top: highest frequency that is kept, Hz.
    """
    used = next_smooth(samples.size)
    x = samples - samples.mean(dtype=np.float64)
    scale = float(np.abs(x).max())
    if scale > 0.0:
        x /= scale
    spectrum = np.fft.rfft(x.astype(np.float32), used)
    resolution = rate / used
    top = min(top, 0.5 * rate)
    kept = min(math.ceil(top / resolution) + 1, used // 2)
    length = next_smooth(max(2 * kept, math.ceil(_DENSITY * kept)))
    first, last = (round(edge * used) for edge in _ENVELOPE_SPAN)
    analytic = np.zeros(next_smooth(math.ceil(1.3 * (last - first))), dtype=np.complex64)
    analytic[: last - first] = spectrum[first:last]
    envelope = np.abs(np.fft.ifft(analytic))
    envelope -= envelope.mean()
    lower = np.zeros((2, length // 2 + 1), dtype=np.complex64)
    lower[0, 1:kept] = _without_supply(spectrum[:kept], resolution)[1:]
    demodulated = np.fft.rfft(envelope)[:kept]
    lower[1, 1 : demodulated.size] = demodulated[1:]
    rows = np.fft.irfft(lower, length, axis=1)
    deviation = rows.std(axis=1, keepdims=True)
    rows /= np.maximum(deviation, np.finfo(np.float32).tiny)
    # Zeros were added at the end for a fast transform.
    kept = math.ceil(length * samples.size / used)
    return LowRows(length * resolution, rows[:, :kept].astype(np.float32, copy=False), top)


def _without_supply(spectrum: NDArray[np.complexfloating], resolution: float) -> NDArray[np.complexfloating]:
    """Return the spectrum without the lines of a supply that stand high: they do not follow the speed."""
    kept = spectrum.copy()
    half = max(2, math.ceil(_MAINS_HALF_WIDTH / resolution))
    for mains in _MAINS:
        for order in range(1, math.floor(spectrum.size * resolution / mains) + 1):
            middle = round(order * mains / resolution)
            low, high = max(0, middle - half), min(spectrum.size, middle + half + 1)
            beside = np.abs(np.concatenate((spectrum[max(0, low - 4 * half) : low], spectrum[high : high + 4 * half])))
            if beside.size and np.max(np.abs(spectrum[low:high]), initial=0.0) ** 2 > _MAINS_HEIGHT * np.mean(
                beside**2
            ):
                kept[low:high] = 0.0
    return kept


@dataclass(frozen=True, eq=False)
class Plane:
    """Scores of candidate speeds over time.

    Attributes:
        time: shape (time,), s, equally spaced.
        log_speed: shape (speed,), ln of Hz, in equal steps.
        growth: shape (growth,), relative rate of change of the speed, 1/s.
        score: shape (time, growth, speed), ln of power over its surroundings, summed over the orders.
    """

    time: NDArray[np.float64]
    log_speed: NDArray[np.float64]
    growth: NDArray[np.float64]
    score: NDArray[np.float32]


def plane_of(
    signals: LowRows, limits: tuple[float, float], orders: NDArray[np.float64], growth: NDArray[np.float64],
    turns: float, hop: float, step: float = 0.01,
) -> Plane:  # fmt: skip
    """Return the plane of candidate speeds.

    Args:
        signals: they hold the highest order at the highest speed.
        limits: lowest and highest speed, Hz.
        orders: shape (order,), lines per revolution that add to the score; what stands half a revolution below each
            is taken off, for lines there show that the speed is half of the candidate.
        growth: shape (growth,), relative rates of change that are tried, 1/s.
        turns: length of a window at the lowest speed of each octave.
        hop: from one window to the next, s.
        step: relative, from one candidate speed to the next.
    """
    duration = signals.duration
    outside = 0.25 * turns / limits[0]
    count = max(2, math.floor((duration - 2.0 * outside) / hop) + 1)
    time = np.linspace(outside, duration - outside, count)
    log_speed = np.arange(math.log(limits[0]), math.log(limits[1]) + step, step)
    octaves = max(1, math.ceil((log_speed[-1] - log_speed[0]) / math.log(2.0) - 1e-9))
    parts = np.array_split(log_speed, octaves)
    scores = [_octave(signals, time, np.exp(part), orders, growth, turns) for part in parts]
    return Plane(time, log_speed, growth, np.concatenate(scores, axis=2))


def _octave(
    signals: LowRows, time: NDArray[np.float64], speeds: NDArray[np.float64], orders: NDArray[np.float64],
    growth: NDArray[np.float64], turns: float,
) -> NDArray[np.float32]:  # fmt: skip
    """Return the scores of some speeds within about an octave, shape (time, growth, speed)."""
    lowest = float(speeds[0])
    length = turns / lowest
    points = math.ceil(length * _SAMPLES_PER_PERIOD * float(orders[-1] * speeds[-1]) / 2) * 2
    offsets = (np.arange(points) - 0.5 * (points - 1)) * (length / points)
    # The times at which a shaft whose speed grows by exp(growth t) has turned by equal angles.
    with np.errstate(invalid="ignore", divide="ignore"):
        warped = np.where(
            np.abs(growth[:, None]) < 1e-9,
            offsets,
            np.log1p(np.maximum(growth[:, None] * offsets, -0.95)) / np.where(growth == 0.0, 1.0, growth)[:, None],
        )
    steps = np.rint(warped * signals.rate).astype(np.intp)
    starts = np.rint(time * signals.rate).astype(np.intp)
    margin = int(np.abs(steps).max()) + 1
    padded = np.pad(signals.rows, ((0, 0), (margin, margin)))
    window = np.hanning(points + 2)[1:-1].astype(np.float32)
    n_fft = next_smooth(_PADDING * points)
    resolution = points / (length * n_fft)
    weights = _comb_weights(orders, speeds, resolution, n_fft // 2 + 1)
    half = max(1, round(_SURROUNDINGS * lowest / resolution))
    total = np.zeros((time.size, growth.size, n_fft // 2 + 1), dtype=np.float32)
    places = starts[:, None, None] + margin + steps
    for row in padded:
        pieces = row.take(places)
        pieces *= window
        spectrum = np.fft.rfft(pieces, n_fft, axis=2)
        power = np.square(spectrum.real) + np.square(spectrum.imag)
        total += _heights(power, half)
    return total @ weights


def _heights(power: NDArray[np.float32], half: int) -> NDArray[np.float32]:
    """Return ln of each power over its surroundings, limited; shape (time, growth, bin) as given."""
    level = np.log(power + np.finfo(np.float32).tiny)
    # The surroundings are wider than what a growth shifts: those of one growth serve for all.
    level -= surroundings(level[:, level.shape[1] // 2], half)[:, None]
    np.maximum(level, _LEAST, out=level)
    # A high line still has one top: what is above the limit counts for a part.
    beyond = level - _MOST
    np.maximum(beyond, 0.0, out=beyond)
    beyond *= 1.0 - _BEYOND
    level -= beyond
    return level


def surroundings(level: NDArray[np.float32], half: int) -> NDArray[np.float32]:
    """Return the mean of each bin and so many beside it on either side, shape (row, bin) as given."""
    count = level.shape[1]
    summed = np.zeros((level.shape[0], count + 1))
    np.cumsum(level, axis=1, out=summed[:, 1:])
    bins = np.arange(count, dtype=np.intp)
    low, high = np.maximum(bins - half, 0), np.minimum(bins + half + 1, count)
    return ((summed[:, high] - summed[:, low]) / (high - low)).astype(np.float32)


def _comb_weights(
    orders: NDArray[np.float64], speeds: NDArray[np.float64], resolution: float, n_bins: int
) -> NDArray[np.float32]:
    """Return what each bin adds to the score of each speed, shape (bin, speed)."""
    weights = np.zeros((n_bins, speeds.size), dtype=np.float32)
    column = np.arange(speeds.size)
    share = np.where(orders <= 0.5 * orders[-1], 1.0, 0.5) if orders.size > 2 else np.ones(orders.size)
    for order, part in zip(orders, share, strict=True):
        for at, sign in ((order, part), (order - 0.5, -0.5 * part), (order + 0.5, -0.5 * part)):
            position = at * speeds / resolution
            below = np.minimum(position.astype(np.intp), n_bins - 2)
            upper = np.clip(position - below, 0.0, 1.0)
            np.add.at(weights, (below, column), sign * (1.0 - upper))
            np.add.at(weights, (below + 1, column), sign * upper)
    return weights
