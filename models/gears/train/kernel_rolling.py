"""Kernel: rolling elements between a body of a train and the casing, and the defects that they pass.

An element is squeezed by delta = u . n - clearance - depth, n its direction, and presses with k delta^n; a loaded one
has the damping c of the rate at which the ring alone approaches it (``models.solve.rotor.plan``). Elements of all
bearings are counted through.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from models.platform.jit import inlined

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from models.gears.train.kernel_forces import Course, Plan
    from models.platform.jit import Index

# Columns of ``Rolling.law``.
# SHARE is 1 / (power + 1): a division can raise, which costs more than all the rest.
L_STIFFNESS, L_POWER, L_CLEARANCE, L_DAMPING, L_CAGE, L_SHARE = 0, 1, 2, 3, 4, 5
L_SIZE = 6
_BALL_POWER = 1.5


class Rolling(NamedTuple):
    """What stays the same of B bearings with E elements over a run; a part of the plan of a train.

    Attributes:
        place: degree of freedom x of the body of each bearing, int64, (B,).
        elements: those of bearing b are elements[b] to elements[b + 1], int64, (B + 1,).
        law: see the L_ constants; of the cage its speed, rad/s, (B, L_SIZE).
        slots: cosine and sine of the angle of each element at time 0, (2, E).
        bounds: times of the edges of defects, s, the first 0, the last after the end, (I + 1,).
        first: the records of interval i are first[i] to first[i + 1], int64, (I + 1,).
        element: of each record, int64; depth, rate, offset: it is deeper by depth * sin(rate * t + offset), m.
    """

    place: NDArray[np.int64]
    elements: NDArray[np.int64]
    law: NDArray[np.float64]
    slots: NDArray[np.float64]
    bounds: NDArray[np.float64]
    first: NDArray[np.int64]
    element: NDArray[np.int64]
    depth: NDArray[np.float64]
    rate: NDArray[np.float64]
    offset: NDArray[np.float64]


class RollingCourse(NamedTuple):
    """Where a run is; all of it changes; a part of the course of a train.

    Attributes:
        interval: between edges of defects, int64, (1,).
        relief, sinking: of each element, m, and its rate, m/s, (E,).
        reaction: of each bearing on its body, N, (B, 2).
        contact_energy: stored in all contacts, J; power that dampers take and that cage and defects give, W, (3,).
    """

    interval: NDArray[np.int64]
    relief: NDArray[np.float64]
    sinking: NDArray[np.float64]
    reaction: NDArray[np.float64]
    contact_energy: NDArray[np.float64]


@inlined
def fill_depths(plan: Plan, course: Course, t: float) -> None:
    """Write how far each element is relieved, and the rate."""
    for j in range(course.relief.shape[0]):
        course.relief[j], course.sinking[j] = 0.0, 0.0
    interval = course.interval[0]
    for r in range(plan.first[interval], plan.first[interval + 1]):
        angle, j = plan.rate[r] * t + plan.offset[r], plan.element[r]
        course.relief[j] += plan.depth[r] * math.sin(angle)
        course.sinking[j] += plan.depth[r] * plan.rate[r] * math.cos(angle)


@inlined
def _power(delta: float, exponent: float) -> float:
    return delta * math.sqrt(delta) if exponent == _BALL_POWER else delta**exponent


@inlined
def fill_reactions(plan: Plan, course: Course, t: float, z: NDArray[np.float64], count: Index) -> None:
    """Write the forces of all bearings on their bodies, and energies; ``count``: degrees of freedom of the state."""
    fill_depths(plan, course, t)
    stored, taken, given = 0.0, 0.0, 0.0
    for b in range(plan.place.shape[0]):
        k = plan.place[b]
        c, s = math.cos(plan.law[b, L_CAGE] * t), math.sin(plan.law[b, L_CAGE] * t)
        # Displacement and velocity as seen from the turning cage.
        u, v = z[k] * c + z[k + 1] * s, z[k + 1] * c - z[k] * s
        u_dot, v_dot = z[count + k] * c + z[count + k + 1] * s, z[count + k + 1] * c - z[count + k] * s
        f_u, f_v = 0.0, 0.0
        for j in range(plan.elements[b], plan.elements[b + 1]):
            along, across = plan.slots[0, j], plan.slots[1, j]
            delta = u * along + v * across - plan.law[b, L_CLEARANCE] - course.relief[j]
            if delta <= 0.0:
                continue
            spring = plan.law[b, L_STIFFNESS] * _power(delta, plan.law[b, L_POWER])
            rate = u_dot * along + v_dot * across
            push = spring + plan.law[b, L_DAMPING] * rate
            f_u += push * along
            f_v += push * across
            stored += spring * delta * plan.law[b, L_SHARE]
            taken += plan.law[b, L_DAMPING] * rate * rate
            given += spring * (plan.law[b, L_CAGE] * (v * along - u * across) - course.sinking[j])
        course.reaction[b, 0], course.reaction[b, 1] = f_v * s - f_u * c, -f_u * s - f_v * c
    course.contact_energy[0], course.contact_energy[1], course.contact_energy[2] = stored, taken, given
