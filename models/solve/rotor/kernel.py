"""Kernel of the rotor on two bearings: classical Runge-Kutta steps that end where a contact opens or closes.

State: positions (``P_COUNT`` of them), then velocities. Positions are x, y (along the load, across it) of the line
through the bearings at the disc and its tilt p + i s = phi_y - i phi_x; where the ends of an elastic shaft have a mass,
also x, y of A and of B. A bow is a force that turns (``models.solve.rotor.solver``).

* The force jumps where a contact closes, by its damping, and has a kink where it opens. In a step the set of loaded
  balls is held; where a ball ends on the wrong side of zero, the step is cut at the first such instant, which is found
  by regula falsi and bisection on the length of the step. The order of the scheme is kept.
* Depth of defects is known beforehand: steps end where a ball meets or leaves one.
* Balls are counted through, those of A first. Their directions turn with the cage; what turns is written at the three
  nodes of a step (its beginning, middle and end).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from models.platform.jit import inlined, kernel
from models.solve.engine.kernel_stepping import (
    EXACT_ANGLES,
    TINY,
    accept,
    attempt,
    broken_step,
    fill_depth,
    fill_half,
    fill_rest,
    fill_start,
    runge_kutta,
    to_change,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.platform.jit import Index

# Places in ``RotorPlan.parameter``, SI.
P_CAGE = 0  # speeds of what turns, rad/s: cage A, cage B; they come first (``kernel_stepping.fill_start``)
P_SHAFT = 2
P_COUNT = 3  # degrees of freedom: 4 with a rigid shaft, 8 with an elastic one whose ends have a mass, as a float
P_A = 4
P_B = 5
P_LOAD = 6
P_DISC_DAMPING = 7
P_TILT_DAMPING = 8
P_GYRATION = 9  # shaft speed times polar inertia
P_INVERSE_11 = 10  # of the matrix of masses of r and phi
P_INVERSE_12 = 11
P_INVERSE_22 = 12
P_FORCE_1 = 13  # what turns with the shaft: force, complex amplitude
P_FORCE_2 = 14
P_MOMENT_1 = 15  # moment, complex amplitude
P_MOMENT_2 = 16
P_BOW_1 = 17  # acceleration of the disc against the line through the bearings, complex amplitude
P_BOW_2 = 18
P_INVERSE_END = 19  # 1 / mass of an end
P_SHAFT_LOSS = 20  # internal damping of the shaft, s
P_DIRECTION_1 = 21
P_DIRECTION_2 = 22
P_PER_BEARING = 23  # from here on of A, then of B:
B_STIFFNESS = 0
B_DAMPING = 1
B_CLEARANCE = 2
B_POWER = 3
B_SPRING = 4  # of the shaft
B_SIZE = 5
P_SIZE = P_PER_BEARING + 2 * B_SIZE

STATUS_OK = 0
STATUS_NOT_FINITE = 1
_BALL_POWER = 1.5


class RotorPlan(NamedTuple):
    """All that stays the same over a run of N balls with I intervals between the edges of defects.

    Attributes:
        parameter: see the P_ constants.
        slots: cosine and sine of the angle of each ball at t = 0, (2, N).
        of_a: balls of A, int64, (1,).
        bounds: times of the edges, the first at or before the first step, the last after the end, s, (I + 1,).
        first: the records of interval i are first[i] to first[i + 1], int64, (I + 1,).
        ball: of each record, int64; depth, rate, offset: it is deeper by depth * sin(rate * t + offset), m.
    """

    parameter: NDArray[np.float64]
    slots: NDArray[np.float64]
    of_a: NDArray[np.int64]
    bounds: NDArray[np.float64]
    first: NDArray[np.int64]
    ball: NDArray[np.int64]
    depth: NDArray[np.float64]
    rate: NDArray[np.float64]
    offset: NDArray[np.float64]


class RotorWork(NamedTuple):
    """Places for what a step needs; see ``new_work``.

    Attributes:
        turn: cosine and sine at the nodes of the angles of cage A, cage B and shaft, (3, 6).
        half: the same of what they turn in half a whole step, and in half a part of one, (2, 6).
        depth: how far each ball is relieved at the nodes, m, (3, N).
        held: the loaded balls, those of A first, int64, (N,); loaded: how many of A and of B, int64, (2,).
        slope: time derivative of the state at four stages, (4, 2 F).
        state, trial: (2 F,).
    """

    turn: NDArray[np.float64]
    half: NDArray[np.float64]
    depth: NDArray[np.float64]
    held: NDArray[np.int64]
    loaded: NDArray[np.int64]
    slope: NDArray[np.float64]
    state: NDArray[np.float64]
    trial: NDArray[np.float64]


@kernel
def new_work(plan: RotorPlan) -> RotorWork:
    """Return places for one run."""
    balls, size = plan.slots.shape[1], 2 * int(plan.parameter[P_COUNT])
    return RotorWork(
        np.zeros((3, 6)),
        np.zeros((2, 6)),
        np.zeros((3, balls)),
        np.zeros(balls, dtype=np.int64),
        np.zeros(2, dtype=np.int64),
        np.zeros((4, size)),
        np.zeros(size),
        np.zeros(size),
    )


@inlined
def power_of(delta: float, exponent: float) -> float:
    """Return a compression to the power of the contact law."""
    if exponent == _BALL_POWER:
        return delta * math.sqrt(delta)
    return delta**exponent


@inlined
def force(
    bearing: Index, end: tuple[float, float, float, float], node: Index, plan: RotorPlan, work: RotorWork
) -> tuple[float, float]:
    """Return the force of a bearing's loaded balls on its inner ring's support; ``end``: place and velocity."""
    p, at = plan.parameter, P_PER_BEARING + bearing * B_SIZE
    x, y, x_dot, y_dot = end
    c, s = work.turn[node, 2 * bearing], work.turn[node, 2 * bearing + 1]
    u, v, u_dot, v_dot = x * c + y * s, y * c - x * s, x_dot * c + y_dot * s, y_dot * c - x_dot * s
    f_u, f_v = 0.0, 0.0
    begin = bearing * work.loaded[0]
    for n in range(begin, begin + work.loaded[bearing]):
        j = work.held[n]
        along, across = plan.slots[0, j], plan.slots[1, j]
        delta = max(u * along + v * across - p[at + B_CLEARANCE] - work.depth[node, j], 0.0)
        q = p[at + B_STIFFNESS] * power_of(delta, p[at + B_POWER])
        q += p[at + B_DAMPING] * (u_dot * along + v_dot * across)
        f_u += q * along
        f_v += q * across
    return f_u * c - f_v * s, f_v * c + f_u * s


@inlined
def end_of(z: NDArray[np.float64], bearing: Index, p: NDArray[np.float64]) -> tuple[float, float, float, float]:
    """Return place and velocity of the inner ring of A (0) or B (1)."""
    count = int(p[P_COUNT])
    if count == 8:
        k = 4 + 2 * bearing
        return z[k], z[k + 1], z[count + k], z[count + k + 1]
    arm = p[P_A] if bearing == 0 else -p[P_B]
    return z[0] + arm * z[2], z[1] + arm * z[3], z[4] + arm * z[6], z[5] + arm * z[7]


@inlined
def spring(
    z: NDArray[np.float64], bearing: Index, end: tuple[float, float, float, float], p: NDArray[np.float64]
) -> tuple[float, float]:
    """Return the force of the elastic shaft on an end."""
    arm = p[P_A] if bearing == 0 else -p[P_B]
    d_1, d_2 = z[0] + arm * z[2] - end[0], z[1] + arm * z[3] - end[1]
    r_1, r_2 = z[8] + arm * z[10] - end[2], z[9] + arm * z[11] - end[3]
    k, loss, speed = p[P_PER_BEARING + bearing * B_SIZE + B_SPRING], p[P_SHAFT_LOSS], p[P_SHAFT]
    # The rate is that seen from the turning shaft: d' - i Omega d.
    return k * (d_1 + loss * (r_1 + speed * d_2)), k * (d_2 + loss * (r_2 - speed * d_1))


@inlined
def disc_acceleration(
    v: tuple[float, float, float, float],
    f_a: tuple[float, float],
    f_b: tuple[float, float],
    turned: tuple[float, float],
    p: NDArray[np.float64],
) -> tuple[float, float, float, float]:
    """Return x'', y'', p'', s'' from their velocities, the forces at A and B on the shaft, and the shaft's angle."""
    c, s = turned
    g_1 = p[P_LOAD] + p[P_FORCE_1] * c - p[P_FORCE_2] * s - p[P_DISC_DAMPING] * v[0] - f_a[0] - f_b[0]
    g_2 = p[P_FORCE_2] * c + p[P_FORCE_1] * s - p[P_DISC_DAMPING] * v[1] - f_a[1] - f_b[1]
    m_1 = p[P_MOMENT_1] * c - p[P_MOMENT_2] * s - p[P_TILT_DAMPING] * v[2] - p[P_GYRATION] * v[3]
    m_2 = p[P_MOMENT_2] * c + p[P_MOMENT_1] * s - p[P_TILT_DAMPING] * v[3] + p[P_GYRATION] * v[2]
    m_1 += p[P_B] * f_b[0] - p[P_A] * f_a[0]
    m_2 += p[P_B] * f_b[1] - p[P_A] * f_a[1]
    i_11, i_12, i_22 = p[P_INVERSE_11], p[P_INVERSE_12], p[P_INVERSE_22]
    return i_11 * g_1 + i_12 * m_1, i_11 * g_2 + i_12 * m_2, i_12 * g_1 + i_22 * m_1, i_12 * g_2 + i_22 * m_2


@inlined
def slope_of(z: NDArray[np.float64], node: Index, plan: RotorPlan, work: RotorWork, stage: Index) -> None:
    """Write the time derivative of a state as the slope of a stage."""
    p, out = plan.parameter, work.slope
    count = int(p[P_COUNT])
    for k in range(count):
        out[stage, k] = z[count + k]
    end_a, end_b = end_of(z, 0, p), end_of(z, 1, p)
    f_a, f_b = force(0, end_a, node, plan, work), force(1, end_b, node, plan, work)
    if count == 8:
        s_a, s_b = spring(z, 0, end_a, p), spring(z, 1, end_b, p)
        out[stage, 12], out[stage, 13] = (s_a[0] - f_a[0]) * p[P_INVERSE_END], (s_a[1] - f_a[1]) * p[P_INVERSE_END]
        out[stage, 14], out[stage, 15] = (s_b[0] - f_b[0]) * p[P_INVERSE_END], (s_b[1] - f_b[1]) * p[P_INVERSE_END]
        f_a, f_b = s_a, s_b
    v = (z[count], z[count + 1], z[count + 2], z[count + 3])
    found = disc_acceleration(v, f_a, f_b, (work.turn[node, 4], work.turn[node, 5]), p)
    for k in range(4):
        out[stage, count + k] = found[k]


@inlined
def overlap_of(z: NDArray[np.float64], bearing: Index, j: int, node: Index, plan: RotorPlan, work: RotorWork) -> float:
    """Return the compression of a ball, negative where there is a gap, m."""
    end = end_of(z, bearing, plan.parameter)
    c, s = work.turn[node, 2 * bearing], work.turn[node, 2 * bearing + 1]
    u, v = end[0] * c + end[1] * s, end[1] * c - end[0] * s
    clearance = plan.parameter[P_PER_BEARING + bearing * B_SIZE + B_CLEARANCE]
    return u * plan.slots[0, j] + v * plan.slots[1, j] - clearance - work.depth[node, j]


@kernel
def hold(z: NDArray[np.float64], node: Index, plan: RotorPlan, work: RotorWork) -> None:
    """Write which balls are loaded."""
    count = 0
    for bearing in range(2):
        begin = count
        first = 0 if bearing == 0 else plan.of_a[0]
        last = plan.of_a[0] if bearing == 0 else plan.slots.shape[1]
        for j in range(first, last):
            if overlap_of(z, bearing, j, node, plan, work) > 0.0:
                work.held[count] = j
                count += 1
        work.loaded[bearing] = count - begin


@inlined
def _worst(z: NDArray[np.float64], node: Index, plan: RotorPlan, work: RotorWork) -> float:
    """Return the least distance of a ball from zero, negative where it is on the other side than held, m."""
    p, least, n = plan.parameter, math.inf, 0
    loaded = work.loaded[0] + work.loaded[1]
    for bearing in range(2):
        x, y, _, _ = end_of(z, bearing, p)
        c, s = work.turn[node, 2 * bearing], work.turn[node, 2 * bearing + 1]
        u, v, clearance = x * c + y * s, y * c - x * s, p[P_PER_BEARING + bearing * B_SIZE + B_CLEARANCE]
        first = 0 if bearing == 0 else plan.of_a[0]
        last = plan.of_a[0] if bearing == 0 else plan.slots.shape[1]
        for j in range(first, last):
            overlap = u * plan.slots[0, j] + v * plan.slots[1, j] - clearance - work.depth[node, j]
            if n < loaded and work.held[n] == j:
                n += 1
            else:
                overlap = -overlap
            least = min(least, overlap)
    return least


@kernel
def _try(t: float, h: float, interval: Index, plan: RotorPlan, work: RotorWork) -> float:
    return attempt(slope_of, _worst, t, h, interval, plan, work)


@kernel
def _to_change(t: float, h: float, at_end: float, interval: Index, plan: RotorPlan, work: RotorWork) -> float:
    return to_change(_try, _worst, t, h, at_end, interval, plan, work)


@inlined
def _kept(changed: bool, work: RotorWork) -> bool:
    """Return whether the loaded balls may be others: they stay as they are while none opens or closes."""
    return changed


@kernel
def _broken_step(t: float, end: float, i: int, plan: RotorPlan, work: RotorWork) -> int:
    return broken_step(_try, _to_change, slope_of, hold, _kept, t, end, i, plan, work)


@inlined
def _sense(n: int, plan: RotorPlan, work: RotorWork, wave: NDArray[np.float64]) -> None:
    """Write the accelerations of A, B and C from the first slope."""
    p, slope = plan.parameter, work.slope
    count = int(p[P_COUNT])
    d_1, d_2 = p[P_DIRECTION_1], p[P_DIRECTION_2]
    c, s = work.turn[0, 4], work.turn[0, 5]
    disc = slope[0, count] * d_1 + slope[0, count + 1] * d_2
    tilt = slope[0, count + 2] * d_1 + slope[0, count + 3] * d_2
    wave[n, 0], wave[n, 1] = disc + p[P_A] * tilt, disc - p[P_B] * tilt
    if count == 8:
        wave[n, 0], wave[n, 1] = slope[0, 12] * d_1 + slope[0, 13] * d_2, slope[0, 14] * d_1 + slope[0, 15] * d_2
    wave[n, 2] = disc + (p[P_BOW_1] * c - p[P_BOW_2] * s) * d_1 + (p[P_BOW_2] * c + p[P_BOW_1] * s) * d_2


@kernel
def run(
    state: NDArray[np.float64], wave: NDArray[np.float64], place: NDArray[np.float64], h: float, plan: RotorPlan
) -> int:
    """Carry a state from t = 0 over the steps of ``wave``, of h seconds each.

    Args:
        state: (2 F,), overwritten.
        wave: accelerations of A, B and C in the sensor's direction at the beginning of each step, (steps, 3), m/s2.
        place: the positions of the state then, (steps, F), or (0, F) where they are not wanted.

    Returns:
        A STATUS_ number.
    """
    work, p = new_work(plan), plan.parameter
    work.state[:] = state
    fill_half(h, p, work.half[0])
    fill_start(0.0, p, work.turn)
    fill_depth(0.0, 0.0, np.int64(0), plan, work.depth)
    hold(work.state, np.int64(0), plan, work)
    i, exact = 0, 0
    for n in range(wave.shape[0]):
        t, end = n * h, (n + 1) * h
        if exact == 0:
            fill_start(t, p, work.turn)
        exact = (exact + 1) % EXACT_ANGLES
        fill_rest(work.half[0], work.turn)
        fill_depth(t, h, i, plan, work.depth)
        slope_of(work.state, np.int64(0), plan, work, np.int64(0))
        _sense(n, plan, work, wave)
        if place.shape[0] > 0:
            for k in range(place.shape[1]):
                place[n, k] = work.state[k]
        whole = plan.bounds[i + 1] - end > TINY
        if whole:
            runge_kutta(slope_of, h, plan, work)
            whole = _worst(work.trial, np.int64(2), plan, work) >= 0.0
        if whole:
            accept(work)
            for k in range(6):
                work.turn[0, k] = work.turn[2, k]
        else:
            i, exact = _broken_step(t, end, i, plan, work), 0
    state[:] = work.state
    return STATUS_OK if np.all(np.isfinite(state)) else STATUS_NOT_FINITE
