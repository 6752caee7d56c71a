"""Kernel of the model of impacts on rings: the exact response of a linear system to pulses at any times.

In modal coordinates the system is a set of first-order ones, q' = lambda q + w F(t), of which the displacement of the
sensor is the sum of Re q, its velocity that of Re lambda q, and its acceleration that of Re lambda^2 q + direct F(t).
Between pulses a step multiplies q by exp(lambda h), which is exact; what a pulse does is known in closed form, during
and after it, so that neither its place between two samples nor the length of the steps makes an error.
"""

from __future__ import annotations

import cmath
import math
from typing import TYPE_CHECKING, NamedTuple

from models.platform.jit import inlined, kernel

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

RECTANGLE, HALF_SINE = 0, 1


class RingModes(NamedTuple):
    """A system from the force on one of its masses to one displacement.

    Attributes:
        rate: lambda, 1/s, of one of each conjugate pair and of each real eigenvalue, complex, (modes,).
        weight: w, m/N per unit of q, complex, doubled for pairs, (modes,).
        direct: acceleration of the displacement by the force itself, 1/kg.
    """

    rate: NDArray[np.complex128]
    weight: NDArray[np.complex128]
    direct: float


class ImpactPulses(NamedTuple):
    """Forces of one shape.

    Attributes:
        start: times at which they begin, ascending, s, (pulses,).
        force: their largest values, N, (pulses,).
        width: duration of each, s.
        shape: RECTANGLE or HALF_SINE.
    """

    start: NDArray[np.float64]
    force: NDArray[np.float64]
    width: float
    shape: int


class Turn(NamedTuple):
    """The angle of the ring's long axis from the sensor, rad: ``begin`` at t = 0, growing by ``rate`` rad/s."""

    begin: float
    rate: float


@inlined
def _during(rate: complex, since: float, pulses: ImpactPulses) -> complex:
    """Return q over w and force, ``since`` seconds after a pulse of unit height began and not after its end."""
    grown = cmath.exp(rate * since)
    if pulses.shape == RECTANGLE:
        return (grown - 1.0) / rate
    omega = math.pi / pulses.width
    inside = omega * grown - omega * math.cos(omega * since) - rate * math.sin(omega * since)
    return inside / (rate * rate + omega * omega)


@inlined
def _height(since: float, pulses: ImpactPulses) -> float:
    if pulses.shape == RECTANGLE:
        return 1.0
    return math.sin(math.pi * since / pulses.width)


@inlined
def _seen(z0: float, z1: float, z2: float, t: float, turn: Turn) -> float:
    """Return the second derivative of z(t) cos(2 angle(t)): what a sensor in a fixed direction sees."""
    double = 2.0 * (turn.begin + turn.rate * t)
    speed = 2.0 * turn.rate
    c = math.cos(double)
    return (z2 - speed * speed * z0) * c - 2.0 * speed * z1 * math.sin(double)


@kernel
def add_response(
    wave: NDArray[np.float64], h: float, modes: RingModes, pulses: ImpactPulses, turn: Turn, q: NDArray[np.complex128]
) -> None:
    """Add to ``wave`` (n,) the acceleration, m/s2, at 0, h, 2 h and so on, that pulses from any time on have left.

    The system is at rest before the first pulse. ``q`` (3, modes) is scratch space.
    """
    count = modes.rate.shape[0]
    for m in range(count):
        q[0, m] = 0.0
        q[1, m] = cmath.exp(modes.rate[m] * h)
        # A pulse of unit height leaves this at its end.
        q[2, m] = modes.weight[m] * _during(modes.rate[m], pulses.width, pulses)
    still = turn.rate == 0.0
    constant = math.cos(2.0 * turn.begin)
    done, known = 0, pulses.start.shape[0]
    for n in range(wave.shape[0]):
        t = n * h
        if n > 0:
            for m in range(count):
                q[0, m] *= q[1, m]
        while done < known and pulses.start[done] + pulses.width <= t:
            since = t - pulses.start[done] - pulses.width
            for m in range(count):
                q[0, m] += pulses.force[done] * q[2, m] * cmath.exp(modes.rate[m] * since)
            done += 1
        z0, z1, z2 = 0.0, 0.0, 0.0
        for m in range(count):
            velocity = modes.rate[m] * q[0, m]
            z0 += q[0, m].real
            z1 += velocity.real
            z2 += (modes.rate[m] * velocity).real
        k = done
        while k < known and pulses.start[k] < t:
            since = t - pulses.start[k]
            for m in range(count):
                inside = pulses.force[k] * modes.weight[m] * _during(modes.rate[m], since, pulses)
                velocity = modes.rate[m] * inside
                z0 += inside.real
                z1 += velocity.real
                z2 += (modes.rate[m] * velocity).real
            z2 += modes.direct * pulses.force[k] * _height(since, pulses)
            k += 1
        wave[n] += constant * z2 if still else _seen(z0, z1, z2, t, turn)
