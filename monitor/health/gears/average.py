"""Synchronous average of a wheel: the mean over its turns of what a block holds at each angle of it.

What does not repeat with the wheel falls with the number of turns N: noise by the root of N. A line of another wheel at
``d`` orders from an order of this one reads at most ``1 / (pi d N)`` of its amplitude. Between samples the block is
its own trigonometric series, interpolated with an error of 2e-6 of the amplitude (``spectrum.periodic``); an error of
the angle of standard deviation s, turns of the wheel, lets order k read ``exp(-(2 pi k s)^2 / 2)`` of its amplitude.

After McFadden, doi 10.1016/0888-3270(87)90072-1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from monitor.health.signal.orders import between, grid_bins
from monitor.health.signal.plans import next_smooth
from monitor.health.signal.rotation.rotation import Rotation

MIN_TURNS = 8
"""Turns of a wheel in an average: the parts of other wheels and noise fall by three and more."""
HARMONICS = 5
"""Mesh harmonics that an average holds, where the sampling rate does."""
MAX_SPEED_RATIO = 3.0
"""Highest over lowest speed of a block that is averaged."""
MAX_ERROR = 0.08
"""Largest standard deviation of the angle in teeth: the first mesh line reads 12 % low."""
OK, TOO_SHORT, NO_ANGLE, ABOVE_BAND = "ok", "too_short", "no_angle", "above_band"
_NYQUIST, _ROOM = 0.48, 1.02
_NODES_PER_SECOND, _MIN_NODES, _NODES_PER_KNOT = 200.0, 1024, 2


@dataclass(frozen=True, eq=False)
class WheelAverage:
    """The mean turn of a wheel.

    Attributes:
        lines: (order,) complex amplitudes of the mean turn at whole orders of the wheel, the mean at 0; a line reads
            its peak amplitude.
        noise: (order,) expected power of a line, ``abs(lines) ** 2``, of what does not repeat with the wheel.
        turns: that were averaged.
        per_turn: samples of the mean turn.
    """

    lines: NDArray[np.complex128]
    noise: NDArray[np.float64]
    turns: int
    per_turn: int

    def signal(self, kept: NDArray[np.bool_] | None = None) -> NDArray[np.float64]:
        """Return the mean turn, shape (per_turn,), of all orders or of those of a mask of shape (order,)."""
        lines = self.lines if kept is None else self.lines * kept
        bins = np.zeros(self.per_turn // 2 + 1, dtype=np.complex128)
        bins[: lines.size] = lines
        bins[1:] *= 0.5
        return np.fft.irfft(bins, self.per_turn, norm="forward")


def wheel_average(
    samples: NDArray[np.floating], rate: float, rotation: Rotation | None, turns: float, teeth: tuple[int, ...]
) -> tuple[WheelAverage | None, str]:
    """Return the average of a wheel over the whole turns in a block, and its status.

    The status is "ok"; "no_angle" without an angle, with one that is not good enough for the teeth, or where the speed
    varies by more than ``MAX_SPEED_RATIO``; "too_short" below ``MIN_TURNS`` turns; or "above_band" where the sampling
    rate does not hold the mesh with its sidebands.

    Args:
        samples: (sample,), any unit.
        rate: Hz.
        rotation: of the bearing's shaft over the samples, or None.
        turns: of the wheel in one of that shaft.
        teeth: of the wheel, or of all that turn with it.
    """
    if rotation is None:
        return None, NO_ANGLE
    low, high = rotation.speed_range
    if rotation.turns_sd * turns * min(teeth) > MAX_ERROR or high > MAX_SPEED_RATIO * low:
        return None, NO_ANGLE
    count = math.floor(rotation.turned * turns + 1e-9)
    if count < MIN_TURNS:
        return None, TOO_SHORT
    orders = math.floor(min((HARMONICS + 0.5) * max(teeth), _NYQUIST * rate / (high * turns)))
    if orders < 1.5 * min(teeth):
        return None, ABOVE_BAND
    per_turn = next_smooth(math.ceil(orders * (1.0 + high / low) * _ROOM) + 2)
    per_turn += per_turn % 2
    block = _over_angle(samples, rate, rotation, (turns, count, per_turn, orders * high * turns))
    each = np.fft.rfft(block, axis=1)[:, : orders + 1] * (2.0 / per_turn)
    each[:, 0] *= 0.5
    lines = each.mean(axis=0)
    spread = np.square(np.abs(each - lines)).sum(axis=0) / (count - 1)
    return WheelAverage(lines, spread / count, count, per_turn), OK


def _over_angle(
    samples: NDArray[np.floating], rate: float, rotation: Rotation, wanted: tuple[float, int, int, float]
) -> NDArray[np.float64]:
    """Return the block by turn and angle of a wheel, shape (turn, angle), without what lies above a frequency.

    Args:
        wanted: turns of the wheel in one of the shaft, turns to give, samples in each, and the frequency, Hz.
    """
    turns, count, per_turn, highest = wanted
    bins = np.fft.rfft(samples.astype(np.float64) - float(samples.mean()))
    kept = min(bins.size, math.ceil(highest * samples.size / rate * _ROOM) + 2)
    corrected, length = grid_bins(bins[:kept] / samples.size)
    period = np.fft.irfft(corrected, length, norm="forward")
    time = _times(rotation, count / turns, count * per_turn)
    places = time * (length * rate / samples.size)
    return np.asarray(between(period, places.reshape(count, per_turn)), dtype=np.float64)


def _times(rotation: Rotation, turned: float, count: int) -> NDArray[np.float64]:
    """Return when the shaft stood at equal steps over its first ``turned`` revolutions, s, shape (count,)."""
    begin = rotation.turns_at(0.0)
    nodes = max(_MIN_NODES, _NODES_PER_KNOT * rotation.time.size, math.ceil(_NODES_PER_SECOND * rotation.duration))
    at = np.linspace(0.0, turned, nodes + 1)
    times = rotation.time_at(begin + at)
    slopes = (turned / nodes) / rotation.speed_at(times)
    place = np.arange(count) * (nodes / count)
    node = np.minimum(place.astype(np.intp), nodes - 1)
    u = place - node
    rise, first, last = (times[1:] - times[:-1])[node], slopes[:-1][node], slopes[1:][node]
    return times[:-1][node] + u * (first + u * (3.0 * rise - 2.0 * first - last + u * (first + last - 2.0 * rise)))
