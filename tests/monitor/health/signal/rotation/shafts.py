"""Shafts of known angle and the pulses of their marks, some missing, some too many."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Angle = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Revolutions at some times, s."""


def even(speed: float) -> Angle:
    """A shaft at one speed, Hz."""
    return lambda time: speed * time


def run_up(begin: float, end: float, duration: float) -> Angle:
    """A shaft whose speed goes evenly from one to another, Hz, in a duration, s."""
    return lambda time: begin * time + 0.5 * (end - begin) / duration * np.square(time)


def hunting(speed: float, share: float, rate: float) -> Angle:
    """A shaft whose speed goes up and down by a share at a rate, Hz."""
    return lambda time: speed * (time + share / (2.0 * np.pi * rate) * (1.0 - np.cos(2.0 * np.pi * rate * time)))


@dataclass(frozen=True, eq=False)
class Marks:
    """What passes a sensor: times, s, and the marks that do, shape (pulse,) each."""

    times: NDArray[np.float64]
    numbers: NDArray[np.int64]


def marks(angle: Angle, duration: float, per_revolution: int, missing_teeth: int = 0, first: float = 0.37) -> Marks:
    """Return the times at which the marks of a wheel pass, to 1e-13 s.

    Args:
        first: place of the first mark at the beginning, in marks.
    """
    fine = np.linspace(0.0, duration, 20001)
    count = int(angle(np.array([duration]))[0] * per_revolution - first) + 1
    numbers = np.arange(max(count, 0))
    wanted = (numbers + first) / per_revolution
    times = np.interp(wanted, angle(fine), fine)
    for _ in range(3):
        slope = (angle(times + 1e-5) - angle(times - 1e-5)) / 2e-5
        times = times - (angle(times) - wanted) / slope
    there = (numbers % per_revolution < per_revolution - missing_teeth) & (times >= 0.0) & (times < duration)
    return Marks(times[there], numbers[there])


def with_faults(
    times: NDArray[np.float64],
    rng: np.random.Generator,
    *,
    missing: float = 0.0,
    doubled: float = 0.0,
    jitter: float = 0.0,
) -> NDArray[np.float64]:
    """Return times of pulses with shares of missing ones and of extra ones anywhere, and jitter, s."""
    lost, twice = rng.random(times.size) < missing, rng.random(times.size) < doubled
    late = times + jitter * rng.standard_normal(times.size)
    extra = times[:-1][twice[:-1]] + rng.random(np.count_nonzero(twice[:-1])) * np.diff(times)[twice[:-1]]
    return np.sort(np.concatenate((late[~lost], extra)))
