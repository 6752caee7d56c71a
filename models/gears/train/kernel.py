"""Kernel of a train of gears: Dormand-Prince steps that end where flanks meet or part, and at samples of the tables.

* Each step lies between two samples of the tables of all meshes and two edges of defects, so the order of the scheme is
  kept; ``Course`` holds where each mesh is.
* Which contacts touch is held in a step. Where one ends on the wrong side of zero (or was there between, as the cubic
  through both ends tells), the step is cut at the first such instant, which is found by Newton steps and bisection on
  its length. Elements of rolling bearings, whose force begins smoothly, are not looked for.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from models.gears.train.kernel_forces import (
    ENERGIES,
    begin_step,
    dot,
    fill_slope,
    gap_of,
    to_sample,
    turns_at,
)
from models.platform.jit import inlined, kernel
from models.solve.engine.kernel_stepping import TINY

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.gears.train.kernel_forces import Course, TrainPlan
    from models.platform.jit import Index

STATUS_OK = 0
STATUS_NOT_FINITE = 1
STATUS_STANDS_STILL = 2

MOST_TRIALS = 60
# Least part of a step after which a contact may change again.
_LEAST_PART = 1e-9
STAGES = 6
# Row k: the slopes that lead to stage k + 1, at _NODES[k] of the step; the last leads to its end.
_NODES = np.array([1.0 / 5.0, 3.0 / 10.0, 4.0 / 5.0, 8.0 / 9.0, 1.0, 1.0])
_WEIGHTS = np.array(
    [
        [1.0 / 5.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [3.0 / 40.0, 9.0 / 40.0, 0.0, 0.0, 0.0, 0.0],
        [44.0 / 45.0, -56.0 / 15.0, 32.0 / 9.0, 0.0, 0.0, 0.0],
        [19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0, 0.0, 0.0],
        [9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0, 0.0],
        [35.0 / 384.0, 0.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0],
    ]
)


@inlined
def _time_of(plan: TrainPlan, mesh: Index, sample: Index) -> float:
    """Return when a mesh comes to a sample of its tables, s, infinite where it never does."""
    turns = (sample - plan.begin[mesh]) / plan.per_turn[mesh]
    square = plan.speed[0] ** 2 + 2.0 * plan.speed[1] * turns
    return 2.0 * turns / (plan.speed[0] + math.sqrt(square)) if square > 0.0 else math.inf


@kernel
def _step(plan: TrainPlan, course: Course, t: float, h: float) -> None:
    """Write into ``trial`` the state after a step, whose first slope is written (Dormand, Prince 1980, order 5)."""
    for stage in range(STAGES):
        for i in range(course.state.shape[0]):
            rise = 0.0
            for k in range(stage + 1):
                rise += _WEIGHTS[stage, k] * course.slope[k, i]
            course.trial[i] = course.state[i] + h * rise
        if stage + 1 < STAGES:
            fill_slope(plan, course, t + _NODES[stage] * h, course.trial, stage + 1)


@inlined
def _cubic(u: float, g0: float, s0: float, g1: float, s1: float) -> float:
    """Return the cubic through values and slopes at both ends of a step of length 1."""
    v = 1.0 - u
    return v * v * ((1.0 + 2.0 * u) * g0 + u * s0) + u * u * ((3.0 - 2.0 * u) * g1 - v * s1)


@kernel
def first_crossing(g0: float, s0: float, g1: float, s1: float) -> float:
    """Return where the cubic through values and slopes at 0 and 1 first rises above 0, 2 where it does not.

    What is above zero at the beginning is rounding and counts as zero.
    """
    g0 = min(g0, 0.0)
    a, b = 3.0 * (2.0 * (g0 - g1) + s0 + s1), 2.0 * (3.0 * (g1 - g0) - 2.0 * s0 - s1)
    left, low = 0.0, g0
    roots = (2.0, 2.0)
    square = b * b - 4.0 * a * s0
    if square > 0.0:
        w = -0.5 * (b + math.copysign(math.sqrt(square), b))
        one, two = (w / a if a != 0.0 else 2.0), (s0 / w if w != 0.0 else 2.0)
        roots = (min(one, two), max(one, two))
    for k in range(3):
        right = 1.0 if k == 2 else roots[k]
        if not left < right <= 1.0:
            continue
        high = g1 if right == 1.0 else _cubic(right, g0, s0, g1, s1)
        if high > 0.0 and low <= 0.0:
            for _ in range(40):
                middle = 0.5 * (left + right)
                if _cubic(middle, g0, s0, g1, s1) > 0.0:
                    right = middle
                else:
                    left = middle
            return right
        left, low = right, high
    return 2.0


@kernel
def _wrong(plan: TrainPlan, course: Course, contact: Index, t: float, z: NDArray[np.float64]) -> tuple[float, float]:
    """Return how far a contact is on the other side of zero than held, m, and its rate, m/s."""
    gap, rate = gap_of(plan, course, contact, t, z)
    return (-gap, -rate) if course.touching[contact] else (gap, rate)


@kernel
def _first_change(plan: TrainPlan, course: Course, t: float, h: float) -> tuple[int, float]:
    """Return which contact changes first in the step in ``trial``, -1 for none, and about after which part of it."""
    found, part = -1, 1.0
    for contact in range(plan.free.shape[0]):
        if plan.linear[contact // 2] or plan.free[contact] == math.inf:
            continue
        g0, s0 = _wrong(plan, course, contact, t, course.state)
        g1, s1 = _wrong(plan, course, contact, t + h, course.trial)
        if g1 <= 0.0 and not (s0 > 0.0 and s1 < 0.0):
            continue
        here = first_crossing(g0, h * s0, g1, h * s1)
        if here <= 1.0 and (here < part or found < 0):
            found, part = contact, here
    return found, part


@kernel
def _cut(plan: TrainPlan, course: Course, contact: Index, t: float, h: float, guess: float) -> float:
    """Write into ``trial`` the state where a contact changes in a step of length h, and return its length.

    The bracket grows from the guess; a contact that turns back before zero keeps the whole of the guess.
    """
    least = _LEAST_PART * h
    low, high, length = least, h, max(guess * h, least)
    for _ in range(MOST_TRIALS):
        _step(plan, course, t, length)
        value, rate = _wrong(plan, course, contact, t + length, course.trial)
        if value > 0.0:
            high = length
        else:
            low = length
        move = -value / rate if rate > 0.0 else 0.0
        if (rate > 0.0 and abs(move) <= 1e-13 * h) or high - low <= 1e-13 * h or length <= least:
            break
        length = length + move
        if rate <= 0.0 or not low < length < high:
            if value <= 0.0 and rate <= 0.0 and high == h:
                # It came near and turned back: nothing changes before this instant.
                return -low
            length = 0.5 * (low + high)
    return length


@inlined
def _add_times(course: Course, h: float) -> None:
    for mesh in range(course.apart.shape[1]):
        if course.touching[2 * mesh + 1]:
            course.apart[1, mesh] += h
        elif not course.touching[2 * mesh]:
            course.apart[0, mesh] += h


@kernel
def _advance(plan: TrainPlan, course: Course, t: float, end: float, longest: float) -> None:
    """Integrate between two instants between which no mesh passes a sample of its tables."""
    fresh = True
    while t < end:
        rest = end - t
        steps = math.ceil(rest / longest - 1e-9)
        h = rest / steps if steps > 1 else rest
        if fresh:
            begin_step(plan, course, t)
        _step(plan, course, t, h)
        contact, part = _first_change(plan, course, t, h)
        changed = False
        if contact >= 0:
            length = _cut(plan, course, contact, t, h, part)
            changed, h = length > 0.0, abs(length)
        _add_times(course, h)
        for i in range(course.state.shape[0]):
            course.state[i] = course.trial[i]
        t = end if h == rest else t + h
        fresh = changed
        if changed:
            course.touching[contact] = not course.touching[contact]
            course.changes[contact] += 1 if course.touching[contact] else 0
        else:
            begin_step(plan, course, t)


@kernel
def _next_edge(plan: TrainPlan, course: Course, end: float) -> tuple[int, float]:
    """Return which mesh next comes to a sample of its tables, and when, s; -1: ``end`` is next, -2: a defect's edge."""
    found, when = -1, end
    for mesh in range(plan.per_turn.shape[0]):
        time = _time_of(plan, mesh, course.at[mesh] + 1)
        if time < when:
            found, when = mesh, time
    edge = float(plan.bounds[course.interval[0] + 1])
    return (-2, edge) if edge < when else (found, when)


@kernel
def write_motion(
    plan: TrainPlan, course: Course, t: float, motion: NDArray[np.float64], meshes: NDArray[np.float64]
) -> float:
    """Write displacements, velocities and accelerations, (3, F), and gap and force of the contacts, (2, 2 m).

    Returns:
        The energy stored in masses and springs, J.
    """
    n = plan.inverse.shape[0]
    begin_step(plan, course, t)
    stored = course.contact_energy[0]
    for i in range(n):
        motion[0, i], motion[1, i], motion[2, i] = course.state[i], course.state[n + i], course.slope[0, n + i]
        springs = dot(plan.stiffness[i], course.state, 0)
        stored += 0.5 * (course.state[n + i] ** 2 / plan.inverse[i] + course.state[i] * springs)
    for contact in range(plan.free.shape[0]):
        mesh = contact // 2
        gap, rate = gap_of(plan, course, contact, t, course.state)
        along = plan.begin[mesh] + plan.per_turn[mesh] * turns_at(plan, t) - course.at[mesh]
        k = course.k[mesh] + along * course.k_slope[mesh]
        force = 0.0
        if course.touching[contact]:
            force = k * gap + plan.mesh_damping[mesh] * rate
            stored += 0.5 * k * gap * gap
        meshes[0, contact], meshes[1, contact] = gap, force
    return stored


@kernel
def integrate(
    plan: TrainPlan,
    course: Course,
    start: float,
    interval: float,
    first: Index,
    longest: float,
    motion: NDArray[np.float64],
    meshes: NDArray[np.float64],
    energy: NDArray[np.float64],
    rolling: NDArray[np.float64],
) -> int:
    """Integrate a run from ``start`` and write what it is at the instants start + (first + j) * interval.

    Args:
        longest: longest step, s.
        motion: displacements, velocities, accelerations of N instants, (N, 3, F).
        meshes: gap and force of the contacts, (N, 2, 2 m).
        energy: that stored, and the energies of the state, J, (N, 1 + ENERGIES).
        rolling: forces of the rolling bearings on their bodies, N, (N, B, 2).

    Returns:
        STATUS_OK, STATUS_NOT_FINITE or STATUS_STANDS_STILL; what was not reached is not written.
    """
    n, t = plan.inverse.shape[0], start + (first - 1) * interval if first > 0 else start
    for j in range(motion.shape[0]):
        end = start + (first + j) * interval
        if plan.speed[0] + plan.speed[1] * end <= 0.0:
            return STATUS_STANDS_STILL
        while t < end:
            mesh, when = _next_edge(plan, course, end)
            if when - t > TINY or mesh == -1:
                _advance(plan, course, t, when, longest)
                t = when
            if mesh >= 0:
                to_sample(plan, course, mesh, course.at[mesh] + 1)
            elif mesh == -2:
                course.interval[0] += 1
        energy[j, 0] = write_motion(plan, course, t, motion[j], meshes[j])
        for i in range(ENERGIES):
            energy[j, 1 + i] = course.state[2 * n + i]
        for b in range(rolling.shape[1]):
            rolling[j, b, 0], rolling[j, b, 1] = course.reaction[b, 0], course.reaction[b, 1]
        if not math.isfinite(energy[j, 0]):
            return STATUS_NOT_FINITE
    return STATUS_OK
