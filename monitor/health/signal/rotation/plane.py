"""A time-frequency plane that stays sharp while the speed changes: short spectra over time warped by each growth rate.

Within a short window the speed is taken to grow at a steady relative rate; the signal is read at the times at which a
shaft that grows so turns by equal angles, and its lines are then sharp at all orders at once (the fan-chirp transform:
Weruaga and Kepesi, "The fan-chirp transform for non-stationary harmonic signals", Signal Processing 87 (2007)
1504-1522, doi 10.1016/j.sigpro.2007.01.006).

Whether the lines of a signal read along an angle stand at their orders throughout the block.

The spectrum of the whole block gives the lines; in each short part of the block they must be found at the same orders,
and not somewhat above or below, where they stand in the parts in which a path has lost the shaft, or gained a turn.
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


_BENDS = np.arange(-3, 4)
"""Steps of growth from one window to the next."""
_BEND_COST = 0.3
"""Cost of the square of such a step, in ln of power."""
_SLACK = (-1, 0, 1)
_SLACK_COST = 0.5
"""Steps of speed beside what the growth asks for, and the cost of one."""


def best_path(plane: Plane) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Return ln of the speed and its growth over the times of the plane, and the mean score along them.

    Returns:
        ln of the speed, shape (time,); growth, 1/s, shape (time,); mean of the score over time.
    """
    n_time, n_growth, n_speed = plane.score.shape
    hop = float(plane.time[1] - plane.time[0])
    sources, costs = _moves(plane, hop)
    value = plane.score[0].astype(np.float32)
    choices = np.empty((n_time, n_growth * n_speed), dtype=np.int8)
    flat = np.full(n_growth * n_speed + 1, -np.inf, dtype=np.float32)
    cell = np.arange(n_growth * n_speed, dtype=np.intp)
    for at in range(1, n_time):
        flat[:-1] = value.ravel()
        reached = flat.take(sources) - costs[:, None]
        chosen = reached.argmax(axis=0)
        choices[at] = chosen
        value = reached[chosen, cell].reshape(n_growth, n_speed) + plane.score[at]
    place = int(value.argmax())
    total = float(value.ravel()[place]) / n_time
    places = np.empty(n_time, dtype=np.intp)
    places[-1] = place
    for at in range(n_time - 1, 0, -1):
        place = int(sources[choices[at, place], place])
        places[at - 1] = place
    return plane.log_speed[places % n_speed], plane.growth[places // n_speed], total


def _moves(plane: Plane, hop: float) -> tuple[NDArray[np.intp], NDArray[np.float32]]:
    """Return where each cell can be reached from.

    Returns:
        Flat index of the cell before, the index beyond the last where there is none, shape (move, cell); and the cost
        of each move, shape (move,).
    """
    n_growth, n_speed = plane.growth.size, plane.log_speed.size
    step = float(plane.log_speed[1] - plane.log_speed[0])
    growth_at, speed_at = np.divmod(np.arange(n_growth * n_speed), n_speed)
    sources: list[NDArray[np.intp]] = []
    costs: list[float] = []
    for bend in _BENDS:
        before = growth_at - bend
        inside = (before >= 0) & (before < n_growth)
        mean = 0.5 * (plane.growth[growth_at] + plane.growth[np.clip(before, 0, n_growth - 1)])
        for slack in _SLACK:
            speed = speed_at - np.rint(mean * hop / step).astype(np.intp) - slack
            reachable = inside & (speed >= 0) & (speed < n_speed)
            sources.append(np.where(reachable, before * n_speed + speed, n_growth * n_speed))
            costs.append(_BEND_COST * float(bend) ** 2 + _SLACK_COST * abs(slack))
    return np.array(sources), np.array(costs, dtype=np.float32)


PART_TURNS, PART_HOP = 12.0, 4.0
"""Length of a part, and from one to the next, turns."""
MAX_LINES = 48
MIN_HEIGHT = 1.5
"""Lines that are looked for at most, and the least height of one over the whole block, ln of power."""
_APART, _REACH, _STEPS = 0.2, 4.0, 7
"""Orders by which the lines of another place stand apart, in the mean; the reach of the search and its steps, in it."""
_LEAST_APART, _MOST_APART = 0.02, 0.08
"""Limits of that shift, relative."""
_MIN_AGREEMENT, _MAX_AGREEMENT = -1.0, 4.0
_LINE_SURROUNDINGS = 1.5
"""Limits of a line in a part, ln of power over its surroundings, and half their width, orders."""


def agreement(
    rows: NDArray[np.float32], per_turn: float, heights: tuple[NDArray[np.float64], ...], resolution: float
) -> NDArray[np.float64]:
    """Return how much higher the lines stand at their orders than at any shifted ones, in each part of a block.

    Args:
        rows: signal and envelope by angle, shape (2, sample).
        per_turn: samples per turn.
        heights: of the bins of both spectra over the whole block, each (bin,), ln of power over the floor.
        resolution: orders per bin.

    Returns:
        Mean height of the lines less that of the best shifted ones, shape (part,); empty where there are no lines.
    """
    lines = [_highest(height, resolution, 0.4 * per_turn) for height in heights]
    total = sum(float(weight.sum()) for _, weight in lines)
    if not total > 0.0:
        return np.zeros(0)
    points = round(PART_TURNS * per_turn)
    count = max(1, int((rows.shape[1] - points) / (PART_HOP * per_turn)) + 1)
    starts = np.rint(np.linspace(0.0, float(rows.shape[1] - points), count)).astype(np.intp)
    window = np.hanning(points + 2)[1:-1].astype(np.float32)
    n_fft = next_smooth(2 * points)
    spacing = per_turn / n_fft
    mean_order = sum(float(orders @ weight) for orders, weight in lines) / total
    apart = min(max(_APART / mean_order, _LEAST_APART), _MOST_APART)
    shifts = np.arange(-round(_REACH * _STEPS), round(_REACH * _STEPS) + 1) * (apart / _STEPS)
    score = np.zeros((count, shifts.size))
    for row, (orders, weight) in zip(rows, lines, strict=True):
        pieces = row[starts[:, None] + np.arange(points)] * window
        level = _levels(np.fft.rfft(pieces, n_fft, axis=1), round(_LINE_SURROUNDINGS / spacing))
        places = np.rint(np.outer(1.0 + shifts, orders) / spacing).astype(np.intp)
        score += level[:, np.minimum(places, level.shape[1] - 1)] @ weight
    score /= total
    here = score[:, np.abs(shifts) < 1.5 * apart / _STEPS].max(axis=1)
    return here - score[:, np.abs(shifts) > 0.99 * apart].max(axis=1)


def _highest(
    height: NDArray[np.float64], resolution: float, most: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return orders and heights of the highest lines up to an order."""
    inner = height[1:-1]
    top = (inner >= height[:-2]) & (inner > height[2:]) & (inner > MIN_HEIGHT)
    places = np.flatnonzero(top) + 1
    places = places[places * resolution < most / (1.0 + _REACH * _MOST_APART)]
    chosen = places[np.argsort(-height[places], kind="stable")[:MAX_LINES]]
    return chosen.astype(np.float64) * resolution, height[chosen]


def _levels(spectrum: NDArray[np.complexfloating], half: int) -> NDArray[np.float32]:
    """Return ln of the power of each bin over that of its surroundings, limited; shape (part, bin)."""
    level = np.log(np.square(np.abs(spectrum)) + np.finfo(np.float32).tiny)
    level -= surroundings(level, half)
    return np.clip(level, _MIN_AGREEMENT, _MAX_AGREEMENT)
