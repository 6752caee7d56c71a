"""The summary of a history from all of its points, one channel and one number at a time."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np


def summarise_slowly(times: np.ndarray, values: np.ndarray, interval: float) -> np.ndarray:
    """What ``summaries.summarise`` should give; exact as long as the history is not thinned."""
    time = [(float(t) - float(times[0])) / interval for t in times]
    columns = [_channel(time, [float(v) for v in column]) for column in values.T]
    found = [math.log(time[-1] + 6.0)]
    for number in range(len(columns[0])):
        found += [column[number] for column in columns]
    return np.array(found)


def _channel(time: list[float], z: list[float]) -> list[float]:
    middle = [v for t, v in zip(time, z, strict=True) if 0.2 * time[-1] <= t <= 0.8 * time[-1]]
    changes = [b - a for a, b in pairwise(z[-48:])]
    smooth = [_mean(z[max(0, i - 4) : i + 1]) for i in range(len(z))]
    steps = [b - a for a, b in pairwise(smooth)]
    signs = [math.copysign(1.0, step) for step in steps if step]
    return [
        _mean(z[-6:]),
        _mean(z[-3:]),
        _mean(z[:6]),
        max(z),
        min(z),
        _mean(middle) if middle else _mean(z[-48:]),
        _sd(z[-6:]),
        _sd(changes) if changes else 0.0,
        math.log1p(sum(abs(step) for step in steps)),
        math.log1p(sum(a != b for a, b in pairwise(signs))),
        *(_slope(time[-n:], z[-n:]) for n in (6, 12, 24, 48)),
        *(_at(time, z, share * time[-1]) for share in (0.2, 0.4, 0.6, 0.8)),
    ]


def _mean(z: list[float]) -> float:
    return sum(z) / len(z)


def _sd(z: list[float]) -> float:
    return math.sqrt(_mean([(v - _mean(z)) ** 2 for v in z]))


def _slope(time: list[float], z: list[float]) -> float:
    if time[0] == time[-1]:
        return 0.0
    return float(np.polynomial.polynomial.polyfit(np.array(time) - time[0], z, 1)[1])


def _at(time: list[float], z: list[float], moment: float) -> float:
    """The value at a moment; where several points have one time, the last of those at or before it counts."""
    before = max(i for i, t in enumerate(time) if t <= moment)
    if before + 1 == len(time):
        return z[-1]
    share = (moment - time[before]) / (time[before + 1] - time[before])
    return z[before] + share * (z[before + 1] - z[before])
