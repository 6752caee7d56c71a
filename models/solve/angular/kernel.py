"""Kernel of an elastic shaft on two bearings, ball by ball, in steps of equal angle of the shaft.

The motion is that of the modes of the shaft on its bearings' tangent stiffness (lateral and axial) and of its torsion
between the couplings; the latter as deviation from the nominal rotation, so that a changing speed is served. What the
balls carry beyond that tangent stiffness is the force on the modes. Time is a state: d/d angle = (d/dt) / speed, where
angle and speed are those of the encoder's node (Bourdon et al. 2014; Thibault et al. 2022, section I.1).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from models.platform.jit import inlined, kernel
from models.solve.angular.ball_ring_kernel import (
    CARRIED,
    COSINE,
    F_Z,
    INNER,
    OUTER,
    R_ALONG,
    R_RADIUS,
    S_HALF_LENGTH,
    S_POSITION,
    S_RACE,
    TORQUE,
    BallRing,
    carry,
    wrapped,
)
from models.solve.engine.kernel_stepping import NODES, accept, at_equal_times, to_end, to_stage

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.platform.jit import Index


# Columns of the wave: angular speed less the nominal one, accelerations of A, B and disc.
SENSORS = 4


# Places in ``AngularPlan.parameter``, SI.
P_SPEED = 0  # nominal, rad/s: of the steps
P_LOSS = 1  # slope of the load's torque by speed, N m s
P_UNBALANCE = 2  # kg m
P_SLIDE = 3  # damping of the outer ring that floats, N s/m
P_FLOATING = 4  # the bearing whose outer ring floats along the shaft, 0 or 1
P_DIRECTION_1 = 5  # of the sensors of acceleration
P_DIRECTION_2 = 6
P_EDGE = 7  # deflection, m, whose contact must not pass an edge in fewer parts of a step than this:
P_PARTS = 8
P_BEARING = 9  # from here on of each bearing: place of the parts below
B_CENTRIFUGAL, B_RATIO, B_BALLS, B_TURNED = range(4)  # m R_m, D / D_m, balls, deviation of its angle at the beginning
B_SIZE = 4
P_SIZE = P_BEARING + 2 * B_SIZE

# Places in the state beside the modes: ``Places`` holds where they begin.
TIME = 0
# Rows of the shapes of torsion: both bearings' nodes, the disc's, the encoder's, the load's end.
T_A, T_B, T_DISC, T_ENCODER, T_LOAD = range(5)
# Columns of a trace: time, angle, the wave, what both bearings carry (CARRIED each).
TRACE = 2 + SENSORS + 2 * CARRIED
NO_ROWS, NO_WAVE = np.zeros((0, TRACE)), np.zeros((0, SENSORS))
STATUS_OK = 0
STATUS_NOT_FINITE = 1
# Sum of the displacements of both inner rings beyond which the shaft is no longer in its bearings, m.
_FARTHEST = 1e-2
# Speed at which balls pass an inner race over that of the shaft, at most.
_INNER_PASSING = 0.8


class ShaftModes(NamedTuple):
    """Mass-normalised modes, M of them, at R places.

    Attributes:
        square, damping: squares of the angular frequencies, 1/s2, and 2 zeta omega, 1/s, (M,).
        shape: displacements at the places, (R, M).
        push: the same, of modes that are slowed (see ``models.solve.angular.plan``) less, (R, M).
        steady: what steady forces do to them, (M,).
    """

    square: NDArray[np.float64]
    damping: NDArray[np.float64]
    shape: NDArray[np.float64]
    push: NDArray[np.float64]
    steady: NDArray[np.float64]


class AngularPlan(NamedTuple):
    """All that stays the same over a run.

    Attributes:
        parameter: see the P_ constants.
        lateral: modes at x, y, z, tilt about x and y of both bearings, and x, y of the disc, (12, M).
        torsion: at the rows T_.
        tangent: stiffness of both bearings that the lateral modes contain, (2, 5, 5).
        ring_a, ring_b: the bearings.
        begin: of each piece of the nominal rotation, s, the first from minus infinity on, (K,).
        nominal: coefficients of its angle, rad, a cubic of the time from there, lowest first, (K, 4).
        inertia: what a nominal acceleration of 1 rad/s2 does to the torsion, (M,).
    """

    parameter: NDArray[np.float64]
    lateral: ShaftModes
    torsion: ShaftModes
    tangent: NDArray[np.float64]
    ring_a: BallRing
    ring_b: BallRing
    begin: NDArray[np.float64]
    nominal: NDArray[np.float64]
    inertia: NDArray[np.float64]


class AngularWork(NamedTuple):
    """Places for what a step needs; see ``new_work``.

    Attributes:
        slope: derivative of the state by the angle at four stages, (4, size).
        state, trial: (size,).
        place: displacements of both inner rings, (10,).
        force: on them and on the disc, (12,).
        turn: deviations of angle and speed at the places of torsion, (2, 5).
        carried: of both bearings, (2, CARRIED).
        warm_a, warm_b: last places of the balls, (N, 2).
        ring: displacement of an inner against its outer ring, (5,).
    """

    slope: NDArray[np.float64]
    state: NDArray[np.float64]
    trial: NDArray[np.float64]
    place: NDArray[np.float64]
    force: NDArray[np.float64]
    turn: NDArray[np.float64]
    carried: NDArray[np.float64]
    warm_a: NDArray[np.float64]
    warm_b: NDArray[np.float64]
    ring: NDArray[np.float64]


@inlined
def cages_at(plan: AngularPlan) -> int:
    """Return where the angles of both cages, their mean cosines, and the floating ring stand in the state."""
    return 1 + 2 * plan.lateral.square.shape[0] + 2 * plan.torsion.square.shape[0]


@kernel
def new_work(plan: AngularPlan) -> AngularWork:
    """Return places for one run."""
    size = cages_at(plan) + 5
    return AngularWork(
        np.zeros((4, size)),
        np.zeros(size),
        np.zeros(size),
        np.zeros(10),
        np.zeros(12),
        np.zeros((2, 5)),
        np.zeros((2, CARRIED)),
        np.zeros((plan.ring_a.angles.shape[0], 2)),
        np.zeros((plan.ring_b.angles.shape[0], 2)),
        np.zeros(5),
    )


@inlined
def _fill_places(z: NDArray[np.float64], plan: AngularPlan, work: AngularWork) -> None:
    """Write displacements, and deviations of angle and speed, from the modes."""
    lateral, torsion = plan.lateral, plan.torsion
    n, m = lateral.square.shape[0], torsion.square.shape[0]
    places = z[1 : 1 + n]
    for r in range(10):
        shape, total = lateral.shape[r], 0.0
        for k in range(n):
            total += shape[k] * places[k]
        work.place[r] = total
    at = 1 + 2 * n
    for r in range(5):
        angle, speed = 0.0, 0.0
        for k in range(m):
            angle += torsion.shape[r, k] * z[at + k]
            speed += torsion.shape[r, k] * z[at + m + k]
        work.turn[0, r], work.turn[1, r] = angle, speed


@inlined
def nominal_at(time: float, plan: AngularPlan) -> tuple[float, float, float]:
    """Return angle, rad, speed and acceleration of the nominal rotation."""
    low, high = 0, plan.begin.shape[0]
    while high - low > 1:
        middle = (low + high) // 2
        if plan.begin[middle] <= time:
            low = middle
        else:
            high = middle
    c1, c2, c3 = plan.nominal[low, 1], plan.nominal[low, 2], plan.nominal[low, 3]
    t = time - plan.begin[low]
    return (
        plan.nominal[low, 0] + t * (c1 + t * (c2 + t * c3)),
        c1 + t * (2.0 * c2 + t * 3.0 * c3),
        2.0 * c2 + t * 6.0 * c3,
    )


@inlined
def _bear(
    z: NDArray[np.float64],
    side: Index,
    nominal: tuple[float, float, float],
    out: NDArray[np.float64],
    plan: AngularPlan,
    ring: BallRing,
    warm: NDArray[np.float64],
    work: AngularWork,
) -> None:
    """Write the forces on one inner ring beyond its tangent stiffness, and the rates of cage and floating ring."""
    p, cages = plan.parameter, cages_at(plan)
    at = P_BEARING + side * B_SIZE
    speed = nominal[1] + work.turn[1, side]
    for k in range(5):
        work.ring[k] = work.place[5 * side + k]
    floats = int(p[P_FLOATING]) == side
    if floats:
        work.ring[2] -= z[cages + 4]
    around = speed * 0.5 * (1.0 - p[at + B_RATIO] * z[cages + 2 + side])
    c_f = p[at + B_CENTRIFUGAL] * around * around
    carried = work.carried[side]
    turned = nominal[0] + work.turn[0, side] - p[at + B_TURNED]
    carry(work.ring, z[cages + side], c_f, turned, ring, warm, carried)
    # The order of forces and moments is that of the displacements.
    for k in range(5):
        held = 0.0
        for j in range(5):
            held += plan.tangent[side, k, j] * work.place[5 * side + j]
        work.force[5 * side + k] = held - carried[k]
    out[cages + side] = speed * 0.5 * (1.0 - p[at + B_RATIO] * carried[COSINE])
    out[cages + 2 + side] = (carried[COSINE] - z[cages + 2 + side]) * p[at + B_BALLS] * around / (2.0 * math.pi)
    if floats:
        out[cages + 4] = carried[F_Z] / p[P_SLIDE]


@inlined
def rates(z: NDArray[np.float64], plan: AngularPlan, work: AngularWork, out: NDArray[np.float64]) -> float:
    """Write the time derivatives of a state; return the speed of the encoder, rad/s."""
    p, lateral, torsion = plan.parameter, plan.lateral, plan.torsion
    n, m = lateral.square.shape[0], torsion.square.shape[0]
    _fill_places(z, plan, work)
    nominal = nominal_at(z[TIME], plan)
    _bear(z, np.int64(0), nominal, out, plan, plan.ring_a, work.warm_a, work)
    _bear(z, np.int64(1), nominal, out, plan, plan.ring_b, work.warm_b, work)
    work.force[10], work.force[11] = 0.0, 0.0
    if p[P_UNBALANCE] != 0.0:
        angle = nominal[0] + work.turn[0, T_DISC]
        speed = nominal[1] + work.turn[1, T_DISC]
        force = p[P_UNBALANCE] * speed * speed
        work.force[10], work.force[11] = force * math.cos(angle), force * math.sin(angle)
    out[TIME] = 1.0
    places, speeds, pushed = z[1 : 1 + n], z[1 + n : 1 + 2 * n], out[1 + n : 1 + 2 * n]
    for k in range(n):
        out[1 + k] = speeds[k]
        pushed[k] = lateral.steady[k] - lateral.square[k] * places[k] - lateral.damping[k] * speeds[k]
    for r in range(12):
        # Of the disc there is an unbalance only.
        force, push = work.force[r], lateral.push[r]
        if force != 0.0:
            for k in range(n):
                pushed[k] += push[k] * force
    at = 1 + 2 * n
    for k in range(m):
        push = torsion.steady[k] + nominal[2] * plan.inertia[k]
        push -= torsion.square[k] * z[at + k] + torsion.damping[k] * z[at + m + k]
        push -= torsion.push[T_A, k] * work.carried[0, TORQUE] + torsion.push[T_B, k] * work.carried[1, TORQUE]
        push -= torsion.push[T_LOAD, k] * p[P_LOSS] * work.turn[1, T_LOAD]
        out[at + k], out[at + m + k] = z[at + m + k], push
    return nominal[1] + work.turn[1, T_ENCODER]


@inlined
def _sense(speed: float, plan: AngularPlan, work: AngularWork, row: NDArray[np.float64]) -> None:
    """Write the sensors from the first slope and its speed."""
    p, lateral = plan.parameter, plan.lateral
    n = lateral.square.shape[0]
    row[0] = work.turn[1, T_ENCODER]
    for sensor in range(3):
        total = 0.0
        for k in range(n):
            along = (
                p[P_DIRECTION_1] * lateral.shape[5 * sensor, k] + p[P_DIRECTION_2] * lateral.shape[5 * sensor + 1, k]
            )
            total += along * work.slope[0, 1 + n + k]
        row[1 + sensor] = total * speed


@inlined
def _at_edge(side: Index, step: float, plan: AngularPlan, ring: BallRing, work: AngularWork) -> bool:
    """Return whether a ball of a bearing is at an edge of a spall in a step, or nearly so."""
    p, cages = plan.parameter, cages_at(plan)
    spacing = 2.0 * math.pi / ring.angles.shape[0]
    nominal, _, _ = nominal_at(work.state[TIME], plan)
    for k in range(ring.spalls.shape[0]):
        spall = ring.spalls[k]
        place = int(spall[S_RACE])
        race = ring.surfaces[place]
        turned = nominal + work.turn[0, side] - p[P_BEARING + side * B_SIZE + B_TURNED] if place == INNER else 0.0
        first = work.state[cages + side] + ring.angles[0] - turned - spall[S_POSITION]
        reach = race[R_ALONG] * math.sqrt(p[P_EDGE]) / race[R_RADIUS]
        # Balls pass an outer race forwards at less than half of the shaft's speed, an inner one backwards.
        forwards, backwards = (0.5 * step, 0.0) if place == OUTER else (0.0, _INNER_PASSING * step)
        half = spall[S_HALF_LENGTH] / race[R_RADIUS]
        for edge in (-half, half):
            past = wrapped(first - edge, spacing)
            if -reach - forwards < past < reach + backwards:
                return True
    return False


@inlined
def _write_trace(speed: float, plan: AngularPlan, work: AngularWork, row: NDArray[np.float64]) -> None:
    """Write a row of a trace from the first slope and its speed."""
    row[0] = work.state[TIME]
    row[1] = nominal_at(row[0], plan)[0] + work.turn[0, T_ENCODER]
    _sense(speed, plan, work, row[2 : 2 + SENSORS])
    for side in range(2):
        for k in range(CARRIED):
            row[2 + SENSORS + side * CARRIED + k] = work.carried[side, k]


@inlined
def _parts(step: float, tracing: bool, plan: AngularPlan, work: AngularWork) -> tuple[int, float]:
    """Return in how many parts a step is taken, as many where a ball meets an edge, and their length, rad."""
    length = step
    if not tracing:
        length *= nominal_at(work.state[TIME], plan)[1] / plan.parameter[P_SPEED]
    parts = 1
    if _at_edge(np.int64(0), length, plan, plan.ring_a, work) or _at_edge(np.int64(1), length, plan, plan.ring_b, work):
        parts = int(plan.parameter[P_PARTS])
    return parts, length / parts


@kernel
def carry_over(
    state: NDArray[np.float64],
    rows: NDArray[np.float64],
    wave: NDArray[np.float64],
    h: float,
    step: float,
    plan: AngularPlan,
) -> int:
    """Carry a state from t = 0 in steps of some angle; return a STATUS_ number.

    Both ways to record are one kernel, and ``rates`` is called in one place, because each copy of its code takes
    seconds to compile.

    Args:
        state: overwritten.
        rows: written: see TRACE, at the beginning of each step, (steps, TRACE); with NO_ROWS the sensors are recorded.
        wave: written where there are no rows: see SENSORS, at times h seconds apart, (times, SENSORS).
        step: angle of a step, rad: of a trace; else at the speed P_SPEED, in proportion to the nominal speed of each.
    """
    work = new_work(plan)
    work.state[:] = state
    node = np.zeros((NODES, 1 + SENSORS))
    tracing = rows.shape[0] > 0
    written, steps = 0, 0
    while written < (rows.shape[0] if tracing else wave.shape[0]):
        # A step is taken in parts where a ball meets an edge.
        parts, length = _parts(step, tracing, plan, work)
        for stage in range(4 * parts):
            at, slope = work.trial, work.slope[stage % 4]
            if stage % 4 == 0:
                at = work.state
            else:
                to_stage(stage % 4 - 1, length, work)
            speed = rates(at, plan, work, slope)
            inverse = 1.0 / speed
            for k in range(slope.shape[0]):
                slope[k] *= inverse
            if stage == 0:
                away = abs(work.place[0]) + abs(work.place[1]) + abs(work.place[5]) + abs(work.place[6])
                if not (away < _FARTHEST and math.isfinite(work.state[TIME]) and (tracing or speed > 0.0)):
                    return STATUS_NOT_FINITE
                steps += 1
                if tracing:
                    _write_trace(speed, plan, work, rows[written])
                    written += 1
                else:
                    for i in range(NODES - 1):
                        for k in range(1 + SENSORS):
                            node[i, k] = node[i + 1, k]
                    node[NODES - 1, 0] = work.state[TIME]
                    _sense(speed, plan, work, node[NODES - 1, 1:])
                    written = at_equal_times(written, steps, h, wave, node)
            if stage % 4 == 3:
                to_end(length, work)
                accept(work)
    state[:] = work.state
    return STATUS_OK
