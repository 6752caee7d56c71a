"""Kernel: what a train of gears is made of, its forces and the time derivative of its state.

State: displacements of the F degrees of freedom, their velocities, and three energies from the beginning: what the
torques did, what the dampers took, what the mean rotation gave through stiffness and error of the meshes, cages and
defects, J. Between samples of its tables, stiffness k and error e of a mesh are linear in the turns.

Each mesh has two contacts: 2 m of the flanks that drive, 2 m + 1 of the others. The force of one that touches is
k delta + c delta'; it may pull for an instant before the flanks part, as in the published models with viscous damping.

A rolling element is squeezed by delta = u . n - clearance - depth, n its direction, and presses with k delta^n; a
loaded one has the damping c of the rate at which the ring alone approaches it (``models.solve.rotor.plan``). Elements
of all bearings are counted through.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from models.platform.jit import inlined, kernel

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

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
def fill_depths(plan: TrainPlan, course: Course, t: float) -> None:
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
def fill_reactions(plan: TrainPlan, course: Course, t: float, z: NDArray[np.float64], count: Index) -> None:
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


# Columns of ``TrainPlan.table``: where each table of a mesh begins in ``TrainPlan.values``, and its samples (0: none).
T_SIZE = 5
T_BASE = np.int64(0)
T_DRIVER_LOSS = np.int64(1)
T_DRIVEN_LOSS = np.int64(2)
T_DRIVER_ERROR = np.int64(3)
T_DRIVEN_ERROR = np.int64(4)
ENERGIES = 3


class TrainPlan(NamedTuple):
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

    The rest describes bearings whose elements press by themselves, see ``models.gears.train.kernel_forces.Rolling``.
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

    The rest belongs to the bearings, see ``models.gears.train.kernel_forces.RollingCourse``.
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
    interval: NDArray[np.int64]
    relief: NDArray[np.float64]
    sinking: NDArray[np.float64]
    reaction: NDArray[np.float64]
    contact_energy: NDArray[np.float64]


@inlined
def _value(plan: TrainPlan, mesh: Index, which: Index, sample: Index) -> float:
    """Return a table at a sample, 0 where there is none."""
    begin, size = int(plan.table[mesh, which, 0]), int(plan.table[mesh, which, 1])
    return float(plan.values[begin + int(sample) % size]) if size > 0 else 0.0


@inlined
def _stiffness_at(plan: TrainPlan, mesh: Index, sample: Index) -> float:
    driven = sample + plan.shift[mesh]
    k = _value(plan, mesh, T_BASE, sample) - _value(plan, mesh, T_DRIVER_LOSS, sample)
    return max(k - _value(plan, mesh, T_DRIVEN_LOSS, driven), 0.0)


@inlined
def _error_at(plan: TrainPlan, mesh: Index, sample: Index) -> float:
    driven = sample + plan.shift[mesh]
    return _value(plan, mesh, T_DRIVER_ERROR, sample) + _value(plan, mesh, T_DRIVEN_ERROR, driven)


@kernel
def to_sample(plan: TrainPlan, course: Course, mesh: Index, sample: Index) -> None:
    """Place a mesh between a sample of its tables and the next."""
    course.at[mesh] = sample
    course.k[mesh], course.e[mesh] = _stiffness_at(plan, mesh, sample), _error_at(plan, mesh, sample)
    course.k_slope[mesh] = _stiffness_at(plan, mesh, sample + 1) - course.k[mesh]
    course.e_slope[mesh] = _error_at(plan, mesh, sample + 1) - course.e[mesh]


@inlined
def turns_at(plan: TrainPlan, t: float) -> float:
    """Return how far the drive has turned."""
    return t * (plan.speed[0] + 0.5 * plan.speed[1] * t)


@inlined
def samples_per_second(plan: TrainPlan, mesh: Index, t: float) -> float:
    """Return how fast a mesh passes the samples of its tables, 1/s."""
    return plan.per_turn[mesh] * (plan.speed[0] + plan.speed[1] * t)


@inlined
def dot(row: NDArray[np.float64], values: NDArray[np.float64], begin: Index) -> float:
    """Return the product of a row with values from a place on."""
    found = 0.0
    for i in range(row.shape[0]):
        found += row[i] * values[begin + i]
    return found


@inlined
def gap_of(plan: TrainPlan, course: Course, contact: Index, t: float, z: NDArray[np.float64]) -> tuple[float, float]:
    """Return how far the flanks of a contact overlap, m, negative where they are apart, and its rate, m/s."""
    mesh, sign, n = contact // 2, 1.0 - 2.0 * (contact % 2), plan.inverse.shape[0]
    along = plan.begin[mesh] + plan.per_turn[mesh] * turns_at(plan, t) - course.at[mesh]
    error = course.e[mesh] + along * course.e_slope[mesh]
    rate = course.e_slope[mesh] * samples_per_second(plan, mesh, t)
    row = plan.row[contact]
    return dot(row, z, 0) - sign * error - plan.free[contact], dot(row, z, n) - sign * rate


@inlined
def _add_mesh(plan: TrainPlan, course: Course, mesh: Index, t: float, z: NDArray[np.float64], stage: Index) -> None:
    """Add the forces of a mesh to those on the degrees of freedom, and its power to the energies."""
    n, out = plan.inverse.shape[0], course.slope
    along = plan.begin[mesh] + plan.per_turn[mesh] * turns_at(plan, t) - course.at[mesh]
    per_second = samples_per_second(plan, mesh, t)
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
def fill_slope(plan: TrainPlan, course: Course, t: float, z: NDArray[np.float64], stage: Index) -> None:
    """Write the time derivative of a state at a stage, with the contacts that are held."""
    n, out = plan.inverse.shape[0], course.slope
    did, took, gave = 0.0, 0.0, 0.0
    for i in range(n):
        springs, dampers = 0.0, 0.0
        for j in range(n):
            springs += plan.stiffness[i, j] * z[j]
            dampers += plan.damping[i, j] * z[n + j]
        out[stage, i] = z[n + i]
        out[stage, n + i] = plan.force[i] - springs - dampers
        did += plan.force[i] * z[n + i]
        took += dampers * z[n + i]
    if plan.place.shape[0] > 0:
        fill_reactions(plan, course, t, z, n)
        took += course.contact_energy[1]
        gave += course.contact_energy[2]
        for b in range(plan.place.shape[0]):
            out[stage, n + plan.place[b]] += course.reaction[b, 0]
            out[stage, n + plan.place[b] + 1] += course.reaction[b, 1]
    out[stage, 2 * n], out[stage, 2 * n + 1], out[stage, 2 * n + 2] = did, took, gave
    for mesh in range(plan.per_turn.shape[0]):
        _add_mesh(plan, course, mesh, t, z, stage)
    for i in range(n):
        out[stage, n + i] *= plan.inverse[i]


@kernel
def begin_step(plan: TrainPlan, course: Course, t: float) -> None:
    """Write the first slope of a step."""
    fill_slope(plan, course, t, course.state, 0)
