"""Makers and checks that tests of ridge share."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from models.machine.bearing import from_catalogue
from monitor.health.signal.rotation.rotation import Rotation

RATE, DURATION = 8192.0, 5.0


BEARING = from_catalogue("6205")


ORDERS = (1, 2, 3, 4, 5)


def turning(speed: NDArray[np.float64]) -> Rotation:
    """Return the rotation of speeds at equal steps of time."""
    time = np.linspace(0.0, DURATION, speed.size)
    turns = np.concatenate(([0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(time))))
    return Rotation(time, turns, speed, DURATION)


def shaken(
    rotation: Rotation, orders: Sequence[float] = ORDERS, noise: float = 1.0, seed: int = 0
) -> NDArray[np.float64]:
    """Return a signal with lines of the shaft, of unit amplitude, in noise."""
    rng = np.random.default_rng(seed)
    turns = rotation.turns_at(np.arange(int(DURATION * RATE)) / RATE)
    signal = noise * rng.standard_normal(turns.size)
    for order in orders:
        signal += np.cos(2.0 * np.pi * (order * turns + rng.uniform()))
    return signal
