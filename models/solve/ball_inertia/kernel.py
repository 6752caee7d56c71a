"""Kernel of a bearing whose balls have inertia: Runge-Kutta steps that end at edges and where a contact closes.

State: place and velocity of the inner ring (along the load, across it), then the radial places of the balls from the
pitch circle, then their radial velocities. Contacts are counted through: those on the inner race, then those on the
outer race, N each.

* The force jumps where a contact closes, by its damping. In a step a contact that was open stays open; where it ends
  closed, the step is cut at the first such instant, which is found by regula falsi and bisection on the length of the
  step. Where a contact opens the force fades to zero (it never pulls), which is left to the step.
* Depth of defects is known beforehand: steps end where a ball meets or leaves one.
* Forces are summed in the frame of the cage, in which the directions of the balls stand still; loops over the balls
  have no branches.
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

# Places in ``BallPlan.parameter``, SI.
P_CAGE = 0  # speeds of what turns, rad/s; they come first (``models.solve.engine.kernel_stepping.fill_start``)
P_SHAFT = 1
P_PITCH = 2  # radius of the pitch circle
P_CLEARANCE = 3
P_STIFFNESS_INNER = 4
P_STIFFNESS_OUTER = 5
P_DAMPING_INNER = 6
P_DAMPING_OUTER = 7
P_INVERSE_MASS = 8  # of rotor and inner ring
P_INVERSE_BALL = 9
P_FORCE_1 = 10  # on the ring, at rest
P_FORCE_2 = 11
P_GRAVITY_1 = 12  # acceleration
P_GRAVITY_2 = 13
P_UNBALANCE = 14  # force that turns with the shaft
P_DIRECTION_1 = 15
P_DIRECTION_2 = 16
P_SIZE = 17

STATUS_OK = 0
# Not finite, or the ring beyond the pitch circle, where steps too long have thrown it.
STATUS_NOT_FINITE = 1
# Where the balls begin in the state.
RING = 4


class BallPlan(NamedTuple):
    """All that stays the same over a run of N balls; see ``models.solve.engine.kernel_stepping`` for the intervals.

    Attributes:
        parameter: see the P_ constants.
        slots: cosine and sine of the angle of each ball at t = 0, (2, N).
        bounds, first, depth, rate, offset: intervals between edges and their records.
        ball: the contact that a record relieves, int64.
    """

    parameter: NDArray[np.float64]
    slots: NDArray[np.float64]
    bounds: NDArray[np.float64]
    first: NDArray[np.int64]
    ball: NDArray[np.int64]
    depth: NDArray[np.float64]
    rate: NDArray[np.float64]
    offset: NDArray[np.float64]


class BallWork(NamedTuple):
    """Places for what a step needs; see ``new_work``.

    Attributes:
        turn: cosine and sine at the nodes of the angles of cage and shaft, (3, 4).
        half: the same of what they turn in half a whole step, and in half a part of one, (2, 4).
        depth: how far each contact is relieved at the nodes, m, (3, 2 N).
        closed: 1 where a contact was closed at the beginning of the step, else 0, (2 N,).
        overlap: of each contact at the end of the last trial, m, (2 N,).
        slope: time derivative of the state at four stages, (4, 4 + 2 N).
        state, trial: (4 + 2 N,).
    """

    turn: NDArray[np.float64]
    half: NDArray[np.float64]
    depth: NDArray[np.float64]
    closed: NDArray[np.float64]
    overlap: NDArray[np.float64]
    slope: NDArray[np.float64]
    state: NDArray[np.float64]
    trial: NDArray[np.float64]


@kernel
def new_work(plan: BallPlan) -> BallWork:
    """Return places for one run."""
    balls = plan.slots.shape[1]
    size = RING + 2 * balls
    return BallWork(
        np.zeros((3, 4)),
        np.zeros((2, 4)),
        np.zeros((3, 2 * balls)),
        np.zeros(2 * balls),
        np.zeros(2 * balls),
        np.zeros((4, size)),
        np.zeros(size),
        np.zeros(size),
    )


@inlined
def _longer(square: float) -> float:
    """Return sqrt(1 + square) - 1: by how much rho exceeds its part along the ball's radius, over that part.

    The terms left out are 1e-14 m for a ring 1 mm beside the middle.
    """
    return square * (0.5 - square * (0.125 - square * 0.0625))


@inlined
def slope_of(z: NDArray[np.float64], node: Index, plan: BallPlan, work: BallWork, stage: Index) -> None:
    """Write the time derivative of a state as the slope of a stage.

    rho is the distance of a ball from the centre of the inner ring, n the direction from there to it.
    """
    p, out, balls = plan.parameter, work.slope, plan.slots.shape[1]
    c, s = work.turn[node, 0], work.turn[node, 1]
    x, y = z[0] * c + z[1] * s, z[1] * c - z[0] * s
    x_dot, y_dot = z[2] * c + z[3] * s, z[3] * c - z[2] * s
    g_x, g_y = p[P_GRAVITY_1] * c + p[P_GRAVITY_2] * s, p[P_GRAVITY_2] * c - p[P_GRAVITY_1] * s
    pitch, cage, clearance = p[P_PITCH], p[P_CAGE], p[P_CLEARANCE]
    k_in, k_out, d_in, d_out = p[P_STIFFNESS_INNER], p[P_STIFFNESS_OUTER], p[P_DAMPING_INNER], p[P_DAMPING_OUTER]
    lightness = p[P_INVERSE_BALL]
    # Views of the rows, and one array that is written, with which LLVM makes vector instructions of the loop.
    slot_1, slot_2, places, rates = plan.slots[0], plan.slots[1], z[RING : RING + balls], z[RING + balls :]
    relief_in, relief_out = work.depth[node, :balls], work.depth[node, balls:]
    closed_in, closed_out = work.closed[:balls], work.closed[balls:]
    pushes = out[stage, RING + balls :]
    f_x, f_y = 0.0, 0.0
    for j in range(balls):
        along, across, place, rate = slot_1[j], slot_2[j], places[j], rates[j]
        ring, side = x * along + y * across, y * along - x * across
        ring_rate, side_rate = x_dot * along + y_dot * across, y_dot * along - x_dot * across
        radius = pitch + place
        apart = radius - ring
        # numpy's division raises no exception, whose branches would hinder vector instructions.
        slant = np.divide(side, apart)
        square = slant * slant
        n_r = 1.0 - square * (0.5 - square * (0.375 - square * 0.3125))
        n_t = -slant * n_r
        delta = ring - place - apart * _longer(square) - relief_in[j]
        delta = delta if delta > 0.0 else 0.0
        parting = n_r * (rate - ring_rate) + n_t * (radius * cage - side_rate)
        inner = k_in * delta * math.sqrt(delta) - d_in * parting
        inner = inner if inner > 0.0 and delta > 0.0 else 0.0
        inner *= closed_in[j]
        sunk = place - clearance - relief_out[j]
        sunk = sunk if sunk > 0.0 else 0.0
        outer = k_out * sunk * math.sqrt(sunk) + d_out * rate
        outer = outer if outer > 0.0 and sunk > 0.0 else 0.0
        outer *= closed_out[j]
        f_x += inner * (n_r * along - n_t * across)
        f_y += inner * (n_r * across + n_t * along)
        weight = g_x * along + g_y * across
        pushes[j] = radius * cage * cage + weight + (inner * n_r - outer) * lightness
    for j in range(balls):
        out[stage, RING + j] = rates[j]
    turned = p[P_UNBALANCE]
    f_1 = p[P_FORCE_1] + turned * work.turn[node, 2] - (f_x * c - f_y * s)
    f_2 = p[P_FORCE_2] + turned * work.turn[node, 3] - (f_y * c + f_x * s)
    out[stage, 0], out[stage, 1] = z[2], z[3]
    out[stage, 2], out[stage, 3] = f_1 * p[P_INVERSE_MASS], f_2 * p[P_INVERSE_MASS]


@inlined
def _fill_overlap(z: NDArray[np.float64], node: Index, plan: BallPlan, work: BallWork) -> None:
    """Write the overlap of each contact, negative where there is a gap."""
    p, balls = plan.parameter, plan.slots.shape[1]
    c, s = work.turn[node, 0], work.turn[node, 1]
    x, y = z[0] * c + z[1] * s, z[1] * c - z[0] * s
    pitch, clearance = p[P_PITCH], p[P_CLEARANCE]
    for j in range(balls):
        place = z[RING + j]
        ring = x * plan.slots[0, j] + y * plan.slots[1, j]
        apart = pitch + place - ring
        slant = np.divide(y * plan.slots[0, j] - x * plan.slots[1, j], apart)
        work.overlap[j] = ring - place - apart * _longer(slant * slant) - work.depth[node, j]
        work.overlap[balls + j] = place - clearance - work.depth[node, balls + j]


@inlined
def _kept(changed: bool, work: BallWork) -> bool:
    """Write which contacts are closed, from their overlaps at the end of the step; nothing is to be looked at anew."""
    for k in range(work.closed.shape[0]):
        work.closed[k] = 1.0 if work.overlap[k] > 0.0 else 0.0
    return False


@inlined
def _hold(z: NDArray[np.float64], node: Index, plan: BallPlan, work: BallWork) -> None:
    """Write which contacts are closed at a node."""
    _fill_overlap(z, node, plan, work)
    _kept(False, work)


@inlined
def _gap_at(z: NDArray[np.float64], node: Index, plan: BallPlan, work: BallWork) -> float:
    """Write the overlaps at a node; return the least gap of a contact that counts as open, negative if closed, m."""
    _fill_overlap(z, node, plan, work)
    least = math.inf
    for k in range(work.closed.shape[0]):
        gap = -work.overlap[k] if work.closed[k] == 0.0 else math.inf
        least = gap if gap < least else least
    return least


@kernel
def _try(t: float, h: float, interval: Index, plan: BallPlan, work: BallWork) -> float:
    return attempt(slope_of, _gap_at, t, h, interval, plan, work)


@kernel
def _to_contact(t: float, h: float, at_end: float, interval: Index, plan: BallPlan, work: BallWork) -> float:
    return to_change(_try, _gap_at, t, h, at_end, interval, plan, work)


@kernel
def _broken_step(t: float, end: float, i: int, plan: BallPlan, work: BallWork) -> int:
    return broken_step(_try, _to_contact, slope_of, _hold, _kept, t, end, i, plan, work)


@kernel
def run(
    state: NDArray[np.float64], wave: NDArray[np.float64], place: NDArray[np.float64], h: float, plan: BallPlan
) -> int:
    """Carry a state from t = 0 over the steps of ``wave``, of h seconds each.

    Args:
        state: (4 + 2 N,), overwritten.
        wave: acceleration of the ring in the sensor's direction at the beginning of each step, (steps, 1), m/s2.
        place: places of ring and balls then, (steps, 2 + N), or (0, 2 + N) where they are not wanted.

    Returns:
        A STATUS_ number.
    """
    work, p = new_work(plan), plan.parameter
    work.state[:] = state
    fill_half(h, p, work.half[0])
    fill_start(0.0, p, work.turn)
    fill_depth(0.0, 0.0, np.int64(0), plan, work.depth)
    _hold(work.state, np.int64(0), plan, work)
    i, exact, written = 0, 0, -1
    for n in range(wave.shape[0]):
        t, end = n * h, (n + 1) * h
        if exact == 0:
            fill_start(t, p, work.turn)
        exact = (exact + 1) % EXACT_ANGLES
        fill_rest(work.half[0], work.turn)
        # Without a passage in the interval the depths stay zero.
        if i != written or plan.first[i + 1] > plan.first[i]:
            fill_depth(t, h, i, plan, work.depth)
            written = i
        slope_of(work.state, np.int64(0), plan, work, np.int64(0))
        wave[n, 0] = work.slope[0, 2] * p[P_DIRECTION_1] + work.slope[0, 3] * p[P_DIRECTION_2]
        if place.shape[0] > 0:
            place[n, 0], place[n, 1] = work.state[0], work.state[1]
            for k in range(2, place.shape[1]):
                place[n, k] = work.state[k + 2]
        whole = plan.bounds[i + 1] - end > TINY
        if whole:
            runge_kutta(slope_of, h, plan, work)
            whole = _gap_at(work.trial, np.int64(2), plan, work) >= 0.0
        if whole:
            accept(work)
            _kept(False, work)
            for k in range(4):
                work.turn[0, k] = work.turn[2, k]
        else:
            i, exact, written = _broken_step(t, end, i, plan, work), 0, -1
    state[:] = work.state
    inside = abs(state[0]) + abs(state[1]) < p[P_PITCH]
    return STATUS_OK if inside and np.all(np.isfinite(state)) else STATUS_NOT_FINITE
