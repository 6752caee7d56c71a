"""Kernel of a train of gears: Dormand-Prince steps that end where flanks meet or part, and at samples of the tables.

State: displacements of the F degrees of freedom, their velocities, and three energies from the beginning: what the
torques did, what the dampers took, what the mean rotation gave through stiffness and error of the meshes, J.

* Between samples of its tables, stiffness k and error e of a mesh are linear in the turns. Each step lies between two
  samples, so the order of the scheme is kept; ``Course`` holds where each mesh is.
* Each mesh has two contacts: 2 m of the flanks that drive, 2 m + 1 of the others. Which of them touch is held in a
  step. Where one ends on the wrong side of zero (or was there between, as the cubic through both ends tells), the step
  is cut at the first such instant, which is found by Newton steps and bisection on its length.
* The force of a contact is k delta + c delta'; it may pull for an instant before the flanks part, as in the published
  models with viscous damping.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from models.kernels.jit import inlined, kernel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.kernels.jit import Index

STATUS_OK = 0
STATUS_NOT_FINITE = 1
STATUS_STANDS_STILL = 2

# Columns of ``Plan.table``: where each table of a mesh begins in ``Plan.values``, and its samples (0: none).
T_SIZE = 5
T_BASE = np.int64(0)
T_DRIVER_LOSS = np.int64(1)
T_DRIVEN_LOSS = np.int64(2)
T_DRIVER_ERROR = np.int64(3)
T_DRIVEN_ERROR = np.int64(4)

MOST_TRIALS = 60
# Least part of a step after which a contact may change again.
_LEAST_PART = 1e-9
# Parts of an interval of the tables shorter than this are rounding.
_TINY_PART = 1e-9
ENERGIES = 3
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


class Plan(NamedTuple):
    """All that stays the same over a run of a train with F degrees of freedom and m meshes.

    Attributes:
        inverse: 1 / mass, (F,).
        stiffness, damping: of all but the meshes, (F, F).
        force: (F,).
        row: w of each contact, (2 m, F).
        free: way before each contact, m: 0, or the backlash; infinite where there is none, (2 m,).
        linear: whether a mesh is a spring without backlash, (m,).
        film: whether its damping acts without contact, (m,).
        mesh_damping: N s/m, (m,).
        table: first place and size of each table, int64, (m, T_SIZE, 2).
        values: the tables, N/m and m.
        begin: samples at turn 0 of the drive, (m,); per_turn: samples a turn of the drive, (m,).
        shift: samples by which the driven wheel is ahead of the driver, whole, int64, (m,).
        speed: of the drive at time 0, Hz, and its rise, Hz/s, (2,).
    """

    inverse: NDArray[np.float64]
    stiffness: NDArray[np.float64]
    damping: NDArray[np.float64]
    force: NDArray[np.float64]
    row: NDArray[np.float64]
    free: NDArray[np.float64]
    linear: NDArray[np.bool_]
    film: NDArray[np.bool_]
    mesh_damping: NDArray[np.float64]
    table: NDArray[np.int64]
    values: NDArray[np.float64]
    begin: NDArray[np.float64]
    per_turn: NDArray[np.float64]
    shift: NDArray[np.int64]
    speed: NDArray[np.float64]


class Course(NamedTuple):
    """Where a run is; all of it changes.

    Attributes:
        state: (2 F + ENERGIES,).
        touching: which contacts touch, (2 m,).
        at: sample of its tables at which each mesh is, int64, (m,).
        k, k_slope, e, e_slope: at that sample, and their change to the next, (m,).
        apart: time without contact of each mesh, s, and time on the other flanks, (2, m).
        changes: how often each contact closed, int64, (2 m,).
        slope: of the state at the stages, (7, 2 F + ENERGIES).
        trial: (2 F + ENERGIES,).
    """

    state: NDArray[np.float64]
    touching: NDArray[np.bool_]
    at: NDArray[np.int64]
    k: NDArray[np.float64]
    k_slope: NDArray[np.float64]
    e: NDArray[np.float64]
    e_slope: NDArray[np.float64]
    apart: NDArray[np.float64]
    changes: NDArray[np.int64]
    slope: NDArray[np.float64]
    trial: NDArray[np.float64]


@inlined
def _value(plan: Plan, mesh: Index, which: Index, sample: Index) -> float:
    """Return a table at a sample, 0 where there is none."""
    begin, size = int(plan.table[mesh, which, 0]), int(plan.table[mesh, which, 1])
    return float(plan.values[begin + int(sample) % size]) if size > 0 else 0.0


@inlined
def _stiffness_at(plan: Plan, mesh: Index, sample: Index) -> float:
    driven = sample + plan.shift[mesh]
    k = _value(plan, mesh, T_BASE, sample) - _value(plan, mesh, T_DRIVER_LOSS, sample)
    return max(k - _value(plan, mesh, T_DRIVEN_LOSS, driven), 0.0)


@inlined
def _error_at(plan: Plan, mesh: Index, sample: Index) -> float:
    driven = sample + plan.shift[mesh]
    return _value(plan, mesh, T_DRIVER_ERROR, sample) + _value(plan, mesh, T_DRIVEN_ERROR, driven)


@kernel
def to_sample(plan: Plan, course: Course, mesh: Index, sample: Index) -> None:
    """Place a mesh between a sample of its tables and the next."""
    course.at[mesh] = sample
    course.k[mesh], course.e[mesh] = _stiffness_at(plan, mesh, sample), _error_at(plan, mesh, sample)
    course.k_slope[mesh] = _stiffness_at(plan, mesh, sample + 1) - course.k[mesh]
    course.e_slope[mesh] = _error_at(plan, mesh, sample + 1) - course.e[mesh]


@inlined
def _turns(plan: Plan, t: float) -> float:
    return t * (plan.speed[0] + 0.5 * plan.speed[1] * t)


@inlined
def _samples_per_second(plan: Plan, mesh: Index, t: float) -> float:
    return plan.per_turn[mesh] * (plan.speed[0] + plan.speed[1] * t)


@inlined
def _time_of(plan: Plan, mesh: Index, sample: Index) -> float:
    """Return when a mesh comes to a sample of its tables, s, infinite where it never does."""
    turns = (sample - plan.begin[mesh]) / plan.per_turn[mesh]
    square = plan.speed[0] ** 2 + 2.0 * plan.speed[1] * turns
    return 2.0 * turns / (plan.speed[0] + math.sqrt(square)) if square > 0.0 else math.inf


@inlined
def _dot(row: NDArray[np.float64], values: NDArray[np.float64], begin: Index) -> float:
    found = 0.0
    for i in range(row.shape[0]):
        found += row[i] * values[begin + i]
    return found


@inlined
def _gap(plan: Plan, course: Course, contact: Index, t: float, z: NDArray[np.float64]) -> tuple[float, float]:
    """Return how far the flanks of a contact overlap, m, negative where they are apart, and its rate, m/s."""
    mesh, sign, n = contact // 2, 1.0 - 2.0 * (contact % 2), plan.inverse.shape[0]
    along = plan.begin[mesh] + plan.per_turn[mesh] * _turns(plan, t) - course.at[mesh]
    error = course.e[mesh] + along * course.e_slope[mesh]
    rate = course.e_slope[mesh] * _samples_per_second(plan, mesh, t)
    row = plan.row[contact]
    return _dot(row, z, 0) - sign * error - plan.free[contact], _dot(row, z, n) - sign * rate


@inlined
def _add_mesh(plan: Plan, course: Course, mesh: Index, t: float, z: NDArray[np.float64], stage: Index) -> None:
    """Add the forces of a mesh to those on the degrees of freedom, and its power to the energies."""
    n, out = plan.inverse.shape[0], course.slope
    along = plan.begin[mesh] + plan.per_turn[mesh] * _turns(plan, t) - course.at[mesh]
    per_second = _samples_per_second(plan, mesh, t)
    k, c = course.k[mesh] + along * course.k_slope[mesh], plan.mesh_damping[mesh]
    error, error_rate = course.e[mesh] + along * course.e_slope[mesh], course.e_slope[mesh] * per_second
    both = course.touching[2 * mesh] or course.touching[2 * mesh + 1]
    for contact in range(2 * mesh, 2 * mesh + 2):
        touches, sign = course.touching[contact], 1.0 - 2.0 * (contact % 2)
        if not touches and (both or contact % 2 == 1 or not plan.film[mesh]):
            continue
        gap, closing = -sign * error - plan.free[contact], -sign * error_rate
        for i in range(n):
            gap += plan.row[contact, i] * z[i]
            closing += plan.row[contact, i] * z[n + i]
        force = c * closing
        if touches:
            force += k * gap
            out[stage, 2 * n + 2] += 0.5 * course.k_slope[mesh] * per_second * gap * gap
        out[stage, 2 * n + 1] += c * closing * closing
        out[stage, 2 * n + 2] -= force * sign * error_rate
        for i in range(n):
            out[stage, n + i] -= force * plan.row[contact, i]


@inlined
def _fill_slope(plan: Plan, course: Course, t: float, z: NDArray[np.float64], stage: Index) -> None:
    """Write the time derivative of a state at a stage, with the contacts that are held."""
    n, out = plan.inverse.shape[0], course.slope
    did, took = 0.0, 0.0
    for i in range(n):
        springs, dampers = 0.0, 0.0
        for j in range(n):
            springs += plan.stiffness[i, j] * z[j]
            dampers += plan.damping[i, j] * z[n + j]
        out[stage, i] = z[n + i]
        out[stage, n + i] = plan.force[i] - springs - dampers
        did += plan.force[i] * z[n + i]
        took += dampers * z[n + i]
    out[stage, 2 * n], out[stage, 2 * n + 1], out[stage, 2 * n + 2] = did, took, 0.0
    for mesh in range(plan.per_turn.shape[0]):
        _add_mesh(plan, course, mesh, t, z, stage)
    for i in range(n):
        out[stage, n + i] *= plan.inverse[i]


@kernel
def _begin(plan: Plan, course: Course, t: float) -> None:
    """Write the first slope of a step."""
    _fill_slope(plan, course, t, course.state, 0)


@kernel
def _step(plan: Plan, course: Course, t: float, h: float) -> None:
    """Write into ``trial`` the state after a step, whose first slope is written (Dormand, Prince 1980, order 5)."""
    for stage in range(STAGES):
        for i in range(course.state.shape[0]):
            rise = 0.0
            for k in range(stage + 1):
                rise += _WEIGHTS[stage, k] * course.slope[k, i]
            course.trial[i] = course.state[i] + h * rise
        if stage + 1 < STAGES:
            _fill_slope(plan, course, t + _NODES[stage] * h, course.trial, stage + 1)


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
def _wrong(plan: Plan, course: Course, contact: Index, t: float, z: NDArray[np.float64]) -> tuple[float, float]:
    """Return how far a contact is on the other side of zero than held, m, and its rate, m/s."""
    gap, rate = _gap(plan, course, contact, t, z)
    return (-gap, -rate) if course.touching[contact] else (gap, rate)


@kernel
def _first_change(plan: Plan, course: Course, t: float, h: float) -> tuple[int, float]:
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
def _cut(plan: Plan, course: Course, contact: Index, t: float, h: float, guess: float) -> float:
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
def _advance(plan: Plan, course: Course, t: float, end: float, longest: float) -> None:
    """Integrate between two instants between which no mesh passes a sample of its tables."""
    fresh = True
    while t < end:
        rest = end - t
        steps = math.ceil(rest / longest - 1e-9)
        h = rest / steps if steps > 1 else rest
        if fresh:
            _begin(plan, course, t)
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
            _begin(plan, course, t)


@kernel
def _next_sample(plan: Plan, course: Course, end: float) -> tuple[int, float]:
    """Return which mesh next comes to a sample of its tables, -1 for none before ``end``, and when, s."""
    found, when = -1, end
    for mesh in range(plan.per_turn.shape[0]):
        time = _time_of(plan, mesh, course.at[mesh] + 1)
        if time < when:
            found, when = mesh, time
    return found, when


@kernel
def write_motion(
    plan: Plan, course: Course, t: float, motion: NDArray[np.float64], meshes: NDArray[np.float64]
) -> float:
    """Write displacements, velocities and accelerations, (3, F), and gap and force of the contacts, (2, 2 m).

    Returns:
        The energy stored in masses and springs, J.
    """
    n, stored = plan.inverse.shape[0], 0.0
    _begin(plan, course, t)
    for i in range(n):
        motion[0, i], motion[1, i], motion[2, i] = course.state[i], course.state[n + i], course.slope[0, n + i]
        springs = _dot(plan.stiffness[i], course.state, 0)
        stored += 0.5 * (course.state[n + i] ** 2 / plan.inverse[i] + course.state[i] * springs)
    for contact in range(plan.free.shape[0]):
        mesh = contact // 2
        gap, rate = _gap(plan, course, contact, t, course.state)
        along = plan.begin[mesh] + plan.per_turn[mesh] * _turns(plan, t) - course.at[mesh]
        k = course.k[mesh] + along * course.k_slope[mesh]
        force = 0.0
        if course.touching[contact]:
            force = k * gap + plan.mesh_damping[mesh] * rate
            stored += 0.5 * k * gap * gap
        meshes[0, contact], meshes[1, contact] = gap, force
    return stored


@kernel
def integrate(
    plan: Plan,
    course: Course,
    start: float,
    interval: float,
    first: Index,
    longest: float,
    motion: NDArray[np.float64],
    meshes: NDArray[np.float64],
    energy: NDArray[np.float64],
) -> int:
    """Integrate a run from ``start`` and write what it is at the instants start + (first + j) * interval.

    Args:
        longest: longest step, s.
        motion: displacements, velocities, accelerations of N instants, (N, 3, F).
        meshes: gap and force of the contacts, (N, 2, 2 m).
        energy: that stored, and the energies of the state, J, (N, 1 + ENERGIES).

    Returns:
        STATUS_OK, STATUS_NOT_FINITE or STATUS_STANDS_STILL; what was not reached is not written.
    """
    n, t = plan.inverse.shape[0], start + (first - 1) * interval if first > 0 else start
    for j in range(motion.shape[0]):
        end = start + (first + j) * interval
        if plan.speed[0] + plan.speed[1] * end <= 0.0:
            return STATUS_STANDS_STILL
        while t < end:
            mesh, when = _next_sample(plan, course, end)
            if mesh < 0:
                _advance(plan, course, t, end, longest)
                t = end
                break
            if when - t > _TINY_PART / _samples_per_second(plan, mesh, t):
                _advance(plan, course, t, when, longest)
                t = when
            to_sample(plan, course, mesh, course.at[mesh] + 1)
        energy[j, 0] = write_motion(plan, course, t, motion[j], meshes[j])
        for i in range(ENERGIES):
            energy[j, 1 + i] = course.state[2 * n + i]
        if not math.isfinite(energy[j, 0]):
            return STATUS_NOT_FINITE
    return STATUS_OK
