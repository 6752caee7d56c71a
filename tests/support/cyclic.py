"""Makers and checks that tests of cyclic share."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from monitor.health.signal.rotation.rotation import Rotation

RATE, DURATION = 8192.0, 4.0


DEPTH, ORDER = 0.6, 6.0


def hunting() -> Rotation:
    time = np.linspace(0.0, DURATION, 801)
    speed = 20.0 * (1.0 + 0.2 * np.sin(2.0 * np.pi * 0.5 * time))
    turns = np.concatenate(([0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(time))))
    return Rotation(time, turns, speed, DURATION)


def modulated(rotation: Rotation, depth: float = DEPTH, order: float = ORDER, seed: int = 1) -> NDArray[np.float64]:
    """Return white noise whose amplitude is modulated by an order."""
    turns = rotation.turns_at(np.arange(int(RATE * DURATION)) / RATE)
    noise = np.random.default_rng(seed).standard_normal(turns.size)
    return (1.0 + depth * np.cos(2.0 * np.pi * order * turns)) * noise
