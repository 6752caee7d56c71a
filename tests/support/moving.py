"""Motions whose velocity and acceleration are both known: tones, chirps, a resonance that impacts excite."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class KnownMotion:
    """Velocity in m/s and its exact derivative in m/s2, (sample,)."""

    velocity: Floats
    acceleration: Floats

    def __add__(self, other: KnownMotion) -> KnownMotion:
        return KnownMotion(self.velocity + other.velocity, self.acceleration + other.acceleration)


def moved(velocity: float, phase: Floats, angular: Floats | float) -> KnownMotion:
    """Return v sin(phase), whose phase changes by ``angular`` in rad/s."""
    return KnownMotion(velocity * np.sin(phase), velocity * angular * np.cos(phase))


def tone(t: Floats, hertz: float, velocity: float, phase: float = 0.4) -> KnownMotion:
    """Return a tone of an amplitude in m/s."""
    angular = 2.0 * math.pi * hertz
    return moved(velocity, angular * t + phase, angular)


def chirp(t: Floats, first: float, last: float, velocity: float) -> KnownMotion:
    """Return a tone whose frequency runs from one to another, Hz."""
    rise = (last - first) / t[-1]
    return moved(velocity, 2.0 * math.pi * (first * t + 0.5 * rise * t**2), 2.0 * math.pi * (first + rise * t))


def rung(t: Floats, line: float, resonance: float, velocity: float, sharpness: float = 4.0) -> KnownMotion:
    """Return a resonance (Hz) that swells at each period of a line (Hz), as by impacts of a damaged bearing."""
    slow, fast = 2.0 * math.pi * line, 2.0 * math.pi * resonance
    swell = velocity * np.exp(sharpness * (np.cos(slow * t) - 1.0))
    change = -sharpness * slow * np.sin(slow * t) * swell
    return KnownMotion(swell * np.sin(fast * t), change * np.sin(fast * t) + swell * fast * np.cos(fast * t))
