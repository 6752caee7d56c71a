"""Slow and obvious reference of the impacts on rings: scipy's DOP853 on the three masses, cut at both ends of a pulse.

Shares no code with models/: equations of motion written out mass by mass, hits found by following every element.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Machine:
    """Masses, kg, stiffnesses, N/m, and dampings, N s/m, of outer ring, element and inner ring, and the pulse."""

    m_o: float
    m_b: float
    m_i: float
    k_o: float
    k_of: float
    k_if: float
    k_i: float
    c_of: float
    c_if: float
    shape: str
    width: float


@dataclass(frozen=True)
class Geometry:
    """Elements, diameters of element and pitch, m, and shaft speed, Hz; inner ring turns, no contact angle."""

    count: int
    element: float
    pitch: float
    speed: float


def hits(geometry: Geometry, part: str, position: float, end: float) -> list[tuple[float, float]]:
    """Return time and place (angle from a load that stands still) of each hit between 0 and ``end``."""
    shaft = 2.0 * math.pi * geometry.speed
    ratio = geometry.element / geometry.pitch
    cage = 0.5 * shaft * (1.0 - ratio)
    found: list[tuple[float, float]] = []
    if part == "ball":
        spin = 0.5 * shaft * (1.0 / ratio) * (1.0 - ratio**2)
        k = math.ceil(-position / math.pi)
        while (t := (position + k * math.pi) / spin) < end:
            if t >= 0.0:
                found.append((t, cage * t))
            k += 1
        return sorted(found)
    ring = shaft if part == "inner" else 0.0
    for ball in range(geometry.count):
        place = 2.0 * math.pi * ball / geometry.count
        for turn in range(-int(end * geometry.speed) - 3, int(end * geometry.speed) + 4):
            t = (position - place + 2.0 * math.pi * turn) / (cage - ring)
            if 0.0 <= t < end:
                found.append((t, position + ring * t))
    return sorted(found)


def share(psi: float, factor: float) -> float:
    """Return the load of an element over the largest."""
    inside = 1.0 - (1.0 - math.cos(psi)) / (2.0 * factor)
    return inside**1.5 if inside > 0.0 else 0.0


def motion(machine: Machine, driven: int, pulses: list[tuple[float, float]], at: Floats) -> Floats:
    """Return displacement, velocity and acceleration of the outer ring from rest at given times, (3, times)."""

    def force(t: float, active: tuple[tuple[float, float], ...]) -> float:
        total = 0.0
        for start, height in active:
            total += height * (1.0 if machine.shape == "rectangle" else math.sin(math.pi * (t - start) / machine.width))
        return total

    def right(t: float, y: Floats, active: tuple[tuple[float, float], ...]) -> list[float]:
        yo, yb, yi, vo, vb, vi = y
        outer = machine.k_of * (yo - yb) + machine.c_of * (vo - vb)
        inner = machine.k_if * (yb - yi) + machine.c_if * (vb - vi)
        f = [0.0, 0.0, 0.0]
        f[driven] = force(t, active)
        return [
            vo,
            vb,
            vi,
            (f[0] - machine.k_o * yo - outer) / machine.m_o,
            (f[1] + outer - inner) / machine.m_b,
            (f[2] - machine.k_i * yi + inner) / machine.m_i,
        ]

    edges = sorted(
        {float(at[0]), float(at[-1]) + 1e-9, *(t for t, _ in pulses), *(t + machine.width for t, _ in pulses)}
    )
    state, answer = np.zeros(6), np.empty((3, len(at)))
    for low, high in pairwise(edges):
        middle = 0.5 * (low + high)
        active = tuple((t, f) for t, f in pulses if t < middle < t + machine.width)
        here = np.flatnonzero((at >= low) & (at < high))
        found = solve_ivp(
            right, (low, high), state, "DOP853", t_eval=[*at[here], high], args=(active,), rtol=1e-11, atol=1e-18
        )
        for column, k in enumerate(here):
            y = found.y[:, column]
            answer[:, k] = y[0], y[3], right(float(at[k]), y, active)[3]
        state = found.y[:, -1]
    return answer
