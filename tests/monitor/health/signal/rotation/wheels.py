"""Pulse trains of a wheel whose motion and marks are known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from monitor.health.signal.rotation.intervals import PulseTrain

Floats = NDArray[np.float64]
MARKS = 256


def eccentric(degrees: float, marks: int = MARKS, seed: int = 1) -> Floats:
    """Return errors of marks, revolutions: one harmonic of an RMS in degrees, and a tenth of it from mark to mark."""
    angle = 2.0 * np.pi * np.arange(marks) / marks
    rough = np.random.default_rng(seed).normal(size=marks)
    error = degrees / 360.0 * (np.sqrt(2.0) * np.cos(angle + 1.0) + 0.1 * rough)
    return error - error.mean()


def wheel(
    turns: int,
    *,
    marks: int = MARKS,
    speed: float = 40.0,
    slope: float = 0.0,
    lines: Sequence[tuple[float, float, float]] = (),
    error: Floats | None = None,
    start: int = 0,
    jitter: float = 0.0,
    clock: float | None = None,
    seed: int = 0,
) -> PulseTrain:
    """Return the pulses of a wheel.

    Args:
        turns: whole turns.
        marks: a turn.
        speed: at the beginning, Hz.
        slope: of the speed, Hz/s.
        lines: order, relative amplitude and phase of sinusoidal changes of 1/speed over the angle.
        error: revolutions by which each mark stands ahead of its place.
        start: mark with which the train begins.
        jitter: standard deviation of a time, s.
        clock: to whose ticks times are rounded, Hz.
        seed: of the jitter.
    """
    numbers = np.arange(turns * marks + 1, dtype=np.int64)
    angle = numbers / marks
    if error is not None:
        angle = angle + error[(numbers + start) % marks]
    time = angle / speed if slope == 0.0 else (np.sqrt(speed * speed + 2.0 * slope * angle) - speed) / slope
    for order, amplitude, phase in lines:
        time = time + amplitude / speed * np.cos(2.0 * np.pi * order * angle + phase) / (2.0 * np.pi * order)
    time = time + jitter * np.random.default_rng(seed).normal(size=time.size)
    return PulseTrain(time if clock is None else np.round(time * clock) / clock, numbers, marks)


def thinned(train: PulseTrain, share: float, seed: int = 2) -> PulseTrain:
    """Return a train without a share of its pulses, counted all the same."""
    kept = np.random.default_rng(seed).random(train.times.size) >= share
    return PulseTrain(train.times[kept], train.numbers[kept], train.per_revolution, train.indexed)
