"""Makers and checks that tests of interference share."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from reference.signals import bearing_lines, impacts

RATE, BAND, SPEED = 25600.0, (1000.0, 9000.0), 30.0


_, LINES = bearing_lines("6205", SPEED)


def mesh(n: int, level: float, speed: float = SPEED * 1.001) -> NDArray[np.float64]:
    """Return harmonics of 23 turns with sidebands, shape (n,)."""
    t = np.arange(n) / RATE
    return sum(
        level * 0.4 ** abs(side) * np.cos(2.0 * np.pi * (23 * k + side) * speed * t + k * k + side)
        for k in range(1, 15)
        for side in range(-2, 3)
    ) + np.zeros(n)


def damaged(seed: int = 0, fault: str = "outer", duration: float = 2.0) -> NDArray[np.float64]:
    return impacts(np.random.default_rng(seed), fault, LINES, duration=duration)
