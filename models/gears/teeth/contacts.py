"""How the tooth pairs in contact share a force along the line of action.

Each pair is a spring for both teeth in series with its slices of contact, which have their own gaps; all pairs have one
approach. Force over approach is convex and grows, so that Newton's method from above descends to the one solution.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.gears.teeth.geometry import ToothedWheel
    from models.gears.teeth.tooth import Contact

    Array = NDArray[np.float64]

_STEPS = 80
_CONTACT_STEPS = 40
_CLOSE = 1e-13
_CONTACT_CLOSE = 1e-11
# Share of the mean line load below which the contact's compliance is taken as at it: its logarithm has no bound.
_LEAST_LOAD = 1e-3


@dataclass(frozen=True)
class Springs:
    """Pairs in contact at many positions; arrays of shape (positions, pairs, slices) unless said.

    Attributes:
        gap: along the line of action, m.
        width: carrying width of the slices, m; zero where they are out of contact.
        teeth: compliance of both teeth of a pair, m/N, shape (positions, pairs); finite.
        depths: of the contact below either flank to the centre lines of the teeth, m, with a first axis of two.
        radius: relative radius of the contact, m.
        factor: cosine of the base helix angle: share of the width that carries along the line of action.
    """

    gap: Array
    width: Array
    teeth: Array
    depths: Array
    radius: Array
    factor: float


@dataclass(frozen=True)
class SharedForce:
    """What a force does at each position.

    Attributes:
        approach: along the line of action under the force, m, shape (positions,).
        contact: least gap: the approach at which the first flanks meet, m, shape (positions,).
        slope: change of force over change of approach at the force, N/m, shape (positions,).
        forces: of the pairs, N, shape (positions, pairs).
    """

    approach: Array
    contact: Array
    slope: Array
    forces: Array


def share_force(
    springs: Springs, wheels: tuple[ToothedWheel, ToothedWheel], force: float, contact: Contact
) -> SharedForce:
    """Return how the pairs share a positive force, N.

    Raises:
        ArithmeticError: where the iteration does not end, which finite input does not cause.
    """
    load = np.full(springs.gap.shape, force / max(float(springs.width.sum(axis=(1, 2)).mean()), 1e-9))
    least = _LEAST_LOAD * load
    approach = np.zeros(len(load))
    for _ in range(_CONTACT_STEPS):
        secant, tangent = _contact_compliance(springs, wheels, np.maximum(load, least), contact)
        stiffness = springs.width * springs.factor / secant
        before, (approach, pressed) = approach, _approach(springs, stiffness, force)
        if contact == "linear" or float(np.max(np.abs(approach - before))) <= _CONTACT_CLOSE * float(np.max(approach)):
            break
        load = pressed * springs.factor / secant
    else:
        raise ArithmeticError("the shares of the tooth pairs did not settle")
    inner = np.where(pressed > 0.0, springs.width * springs.factor / tangent, 0.0).sum(axis=2)
    forces = (stiffness * pressed).sum(axis=2)
    slope = (inner / (1.0 + springs.teeth * inner)).sum(axis=1)
    first = np.where(springs.width > 0.0, springs.gap, math.inf).min(axis=(1, 2))
    return SharedForce(approach, first, slope, forces)


def _contact_compliance(
    springs: Springs, wheels: tuple[ToothedWheel, ToothedWheel], load: Array, contact: Contact
) -> tuple[Array, Array]:
    """Return secant and tangent compliance of the contact, m^2/N."""
    soft = [(1.0 - wheel.poisson**2) / wheel.modulus for wheel in wheels]
    if contact == "linear":
        constant = np.full(load.shape, 2.0 * sum(soft) / math.pi)
        return constant, constant
    half = np.sqrt(4.0 / math.pi * load * springs.radius * sum(soft))
    total = np.zeros(load.shape)
    for part, wheel, depth in zip(soft, wheels, springs.depths, strict=True):
        total += 2.0 * part / math.pi * (np.log(2.0 * depth / half) - wheel.poisson / (2.0 * (1.0 - wheel.poisson)))
    # Half the logarithm's change with the load: d(q c)/dq = c - (sum of soft) / pi.
    return total, total - sum(soft) / math.pi


def _approach(springs: Springs, stiffness: Array, force: float) -> tuple[Array, Array]:
    """Return the approach, (positions,), and how far each slice is pressed, (positions, pairs, slices)."""
    whole = stiffness.sum(axis=2)
    carries = whole > 0.0
    deepest = np.where(stiffness > 0.0, springs.gap, -math.inf).max(axis=2)
    alone = np.where(carries, deepest + force * (springs.teeth + 1.0 / np.where(carries, whole, 1.0)), math.inf)
    approach = alone.min(axis=1)
    for _ in range(_STEPS):
        pressed, slope = _pressed(springs, stiffness, approach)
        forces = (stiffness * pressed).sum(axis=2)
        step = (forces.sum(axis=1) - force) / (slope / (1.0 + springs.teeth * slope)).sum(axis=1)
        if float(np.max(np.abs(step))) <= _CLOSE * float(np.max(np.abs(approach))):
            return approach, pressed
        approach = approach - step
    raise ArithmeticError("the approach of the teeth did not settle")


def _pressed(springs: Springs, stiffness: Array, approach: Array) -> tuple[Array, Array]:
    """Return how far each slice is pressed at an approach of the wheels, m, and the slope of each pair's contact."""
    inner = np.broadcast_to(approach[:, np.newaxis], stiffness.shape[:2])
    for _ in range(_STEPS):
        pressed = np.maximum(inner[..., np.newaxis] - springs.gap, 0.0)
        slope = np.where(pressed > 0.0, stiffness, 0.0).sum(axis=2)
        excess = inner + springs.teeth * (stiffness * pressed).sum(axis=2) - approach[:, np.newaxis]
        step = excess / (1.0 + springs.teeth * slope)
        if float(np.max(np.abs(step))) <= _CLOSE * float(np.max(np.abs(approach))):
            return pressed, slope
        inner = inner - step
    raise ArithmeticError("the flanks of the teeth did not settle")
