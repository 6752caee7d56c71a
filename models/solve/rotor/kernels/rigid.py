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
from typing import TYPE_CHECKING

import numpy as np

from models.platform.jit import inlined, kernel
from models.solve.engine.kernel_stepping import (
    EXACT_ANGLES,
    MOST_CHANGES,
    TINY,
    accept,
    attempt,
    fill_depth,
    fill_half,
    fill_rest,
    fill_start,
    runge_kutta,
    to_change,
)
from models.solve.rotor.kernels.forces import (
    B_CLEARANCE,
    B_SIZE,
    P_A,
    P_B,
    P_BOW_1,
    P_BOW_2,
    P_COUNT,
    P_DIRECTION_1,
    P_DIRECTION_2,
    P_PER_BEARING,
    STATUS_NOT_FINITE,
    STATUS_OK,
    end_of,
    new_work,
    overlap_of,
    slope_of,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.platform.jit import Index
    from models.solve.rotor.kernels.forces import RotorPlan, RotorWork


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


@kernel
def _broken_step(t: float, end: float, i: int, plan: RotorPlan, work: RotorWork) -> int:
    """Carry the state, whose nodes at ``t`` are written, to ``end`` over edges and changes of contact.

    Returns:
        The interval at ``end``.
    """
    changes = 0
    while end - t > TINY:
        stop = min(end, plan.bounds[i + 1])
        fill_start(t, plan.parameter, work.turn)
        slope_of(work.state, np.int64(0), plan, work, np.int64(0))
        length = stop - t
        gap = _try(t, length, i, plan, work)
        changed = gap < 0.0
        if changed and changes < MOST_CHANGES:
            length = _to_change(t, length, gap, i, plan, work)
            changes += 1
        t += length
        accept(work)
        edge = plan.bounds[i + 1] - t <= TINY
        while plan.bounds[i + 1] - t <= TINY:
            i += 1
        if changed or edge:
            fill_start(t, plan.parameter, work.turn)
            fill_depth(t, 0.0, i, plan, work.depth)
            hold(work.state, np.int64(0), plan, work)
    return i


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
