"""Kernel of the six-degree-of-freedom model simulated over time, for scenes whose motion has no ball period.

The scheme is that of ``models.solve.six_dof.kernels.step``. What differs from ``models.solve.six_dof.kernels.period``:

* Samples stand at whole multiples of one step h. Events (a ball meets a kink of its path, the cage has turned by one
  pitch) fall where they fall; a step that contains one is split there, with propagators for its parts.
* Between two events every ball stays on one smooth piece of its path, or on none, and every ball of a row can be called
  by its place among the n slots in which the cage stands, counted from the last turn by one pitch. Which slot meets
  which piece is listed beforehand, so that the loop over time decides nothing.
* A step beside an instant at which a contact changes is taken in parts as there; what they sum up is left.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from models.platform.jit import inlined, kernel
from models.solve.engine.kernel_stepping import TINY
from models.solve.six_dof.kernels.instants import retake
from models.solve.six_dof.kernels.parts import SUMS, Room, make_room
from models.solve.six_dof.kernels.step import (
    P_OMEGA,
    P_PITCH,
    STATUS_NOT_FINITE,
    STATUS_OK,
    Balls,
    StepNodes,
    accelerations,
    forces,
    propagators,
    step,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.solve.six_dof.kernels.step import Axis, Flow


class TimePlan(NamedTuple):
    """All that stays the same over a run: S slots, I intervals between events.

    Attributes:
        parameter: see the P_ constants of models.solve.six_dof.kernels.step.
        balls: the slots; those of a scene with a path are all moved, else all plain. A path may rise above the
            undamaged race; then all of them count as near.
        bounds: times of the events, the first at or before the first sample, the last after the end, s, (I + 1,).
        turns: how many pitches the cage had turned, int64, (I,).
        first: the records of interval i are first[i] to first[i + 1], int64, (I + 1,).
        slot, piece, offset: of each record: the ball in ``slot`` is on ``piece`` at the path coordinate
            offset + rate * t.
        rate: rate of the path coordinate of each piece, rad/s.
        origin, inverse_width, cells_first, cells: the pieces, see ``models.path.contour.PathPieces``.
        waves: amplitude, m, rate of the phase in a slot, rad/s, its change by one turn, rad, and phase, rad, (W, 4).
        crests: cosine and sine of order times the slots' angles, (W, 2, S).
        push: amplitude, N, angular speed, rad/s, and phase of a force that turns with the shaft, and amplitude over
            angular speed, N s, (4,); None where none turns and the speed is one.
        clock: for each interval, where the speed changes: a time, s, and the coefficients of a cubic of the time from
            there, lowest first, (I, 5). It is the nominal time: how long the shaft takes to turn as far at its nominal
            speed. Path coordinates, phases and turns are those of the nominal time; ``bounds`` remain times. None
            where the speed is one.
    """

    parameter: NDArray[np.float64]
    balls: Balls
    bounds: NDArray[np.float64]
    turns: NDArray[np.int64]
    first: NDArray[np.int64]
    slot: NDArray[np.int64]
    piece: NDArray[np.int64]
    offset: NDArray[np.float64]
    rate: NDArray[np.float64]
    origin: NDArray[np.float64]
    inverse_width: NDArray[np.float64]
    cells_first: NDArray[np.int64]
    cells: NDArray[np.float64]
    waves: NDArray[np.float64]
    crests: NDArray[np.float64]
    push: NDArray[np.float64] | None
    clock: NDArray[np.float64] | None = None


@inlined
def _clock(t: float, interval: int, clock: NDArray[np.float64] | None) -> tuple[float, float, float]:
    """Return the nominal time, and its first and second derivative by the time."""
    if clock is None:
        return t, 1.0, 0.0
    x, c1, c2, c3 = t - clock[interval, 0], clock[interval, 2], clock[interval, 3], clock[interval, 4]
    nominal = clock[interval, 1] + x * (c1 + x * (c2 + x * c3))
    return nominal, c1 + x * (2.0 * c2 + x * 3.0 * c3), 2.0 * c2 + x * 6.0 * c3


@inlined
def _fill_turn(t: float, half: tuple[float, float], turned: int, plan: TimePlan, nodes: StepNodes) -> None:
    """Write the cage angle at one speed; ``half`` is cosine and sine of its turn in half a step."""
    angle = plan.parameter[P_OMEGA] * t - turned * plan.parameter[P_PITCH]
    c, s = math.cos(angle), math.sin(angle)
    for node in range(3):
        nodes.turn[0, node, 0], nodes.turn[0, node, 1] = c, s
        c, s = c * half[0] - s * half[1], s * half[0] + c * half[1]


@kernel
def _fill_path(t: float, h: float, interval: int, plan: TimePlan, nodes: StepNodes) -> None:
    """Write how far the path has receded from every slot, and how fast, at the three nodes of a step."""
    for node in range(3):
        there, pace, _ = _clock(t + 0.5 * h * node, interval, plan.clock)
        for j in range(plan.balls.moved.shape[1]):
            nodes.depth[0, node, j] = 0.0
            nodes.rate[0, node, j] = 0.0
        for k in range(plan.waves.shape[0]):
            amplitude, speed = plan.waves[k, 0], plan.waves[k, 1] * pace
            phase = plan.waves[k, 1] * there - plan.turns[interval] * plan.waves[k, 2] + plan.waves[k, 3]
            c, s = amplitude * math.cos(phase), amplitude * math.sin(phase)
            for j in range(plan.balls.moved.shape[1]):
                nodes.depth[0, node, j] += c * plan.crests[k, 0, j] - s * plan.crests[k, 1, j]
                nodes.rate[0, node, j] -= speed * (s * plan.crests[k, 0, j] + c * plan.crests[k, 1, j])
        for r in range(plan.first[interval], plan.first[interval + 1]):
            piece = plan.piece[r]
            along = plan.rate[piece]
            low, high = plan.cells_first[piece], plan.cells_first[piece + 1]
            x = (plan.offset[r] + along * there - plan.origin[piece]) * plan.inverse_width[piece]
            cell = min(max(int(x), 0), high - low - 1)
            x -= cell
            a = plan.cells[low + cell]
            nodes.depth[0, node, plan.slot[r]] += a[0] + x * (a[1] + x * (a[2] + x * a[3]))
            slope = (a[1] + x * (2.0 * a[2] + x * 3.0 * a[3])) * plan.inverse_width[piece]
            nodes.rate[0, node, plan.slot[r]] += along * pace * slope


@inlined
def _fill_push(t: float, h: float, push: NDArray[np.float64] | None, drive: NDArray[np.float64] | None) -> None:
    """Write the force that turns with the shaft at one speed."""
    if push is not None and drive is not None:
        for node in range(3):
            angle = push[1] * (t + 0.5 * h * node) + push[2]
            drive[0, node, 0] = push[0] * math.cos(angle)
            drive[0, node, 1] = push[0] * math.sin(angle)


@inlined
def _fill_drive(t: float, h: float, interval: int, plan: TimePlan, nodes: StepNodes) -> None:
    """Write cage angle, pace, and the force of a mass out of the axis of a shaft, whose speed changes."""
    turn, drive, push, clock = nodes.turn, nodes.drive, plan.push, plan.clock
    if drive is None or push is None or clock is None:
        return
    back = plan.turns[interval] * plan.parameter[P_PITCH]
    for node in range(3):
        nominal, pace, change = _clock(t + 0.5 * h * node, interval, clock)
        angle = plan.parameter[P_OMEGA] * nominal - back
        turn[0, node, 0], turn[0, node, 1] = math.cos(angle), math.sin(angle)
        drive[0, node, 2] = pace
        if push[0] > 0.0:
            angle = push[1] * nominal + push[2]
            outwards, against = push[0] * pace * pace, push[3] * change
            c, s = math.cos(angle), math.sin(angle)
            drive[0, node, 0] = outwards * c + against * s
            drive[0, node, 1] = outwards * s - against * c


@inlined
def _fill_shaft(
    t: float,
    h: float,
    half: tuple[float, float],
    interval: int,
    plan: TimePlan,
    nodes: StepNodes,
    clock: NDArray[np.float64] | None,
) -> None:
    """Write cage angle and what the shaft does."""
    if clock is None:
        _fill_turn(t, half, plan.turns[interval], plan, nodes)
        _fill_push(t, h, plan.push, nodes.drive)
    else:
        _fill_drive(t, h, interval, plan, nodes)


@inlined
def _fill(t: float, h: float, half: tuple[float, float], interval: int, plan: TimePlan, nodes: StepNodes) -> None:
    """Write all that is known beforehand of a step of length h that begins at t."""
    _fill_shaft(t, h, half, interval, plan, nodes, plan.clock)
    if plan.balls.moved.shape[1] > 0:
        _fill_path(t, h, interval, plan, nodes)


@inlined
def _step(
    x1: Axis,
    x2: Axis,
    t: float,
    h: float,
    e: Flow,
    half: tuple[float, float],
    interval: int,
    plan: TimePlan,
    nodes: StepNodes,
    room: Room,
    sums: NDArray[np.float64],
) -> tuple[Axis, Axis, float, float]:
    """Return both axes after a step of ``h`` from ``t`` on, without an event in it, and the contact force at ``t``."""
    _fill(t, h, half, interval, plan, nodes)
    y1, y2, g1, g2, changed, near = step(x1, x2, h, e, plan.parameter, forces, (plan.balls, nodes), np.int64(0), h)
    if changed or near:
        y1, y2, _, _, _ = retake(
            *(x1, x2, y1, y2, h, h, changed),
            *(plan.parameter, plan.balls, nodes, np.int64(0), room, sums),
        )
    return y1, y2, g1, g2


@kernel
def _broken_step(
    x1: Axis,
    x2: Axis,
    t: float,
    end: float,
    i: int,
    plan: TimePlan,
    nodes: StepNodes,
    room: Room,
    sums: NDArray[np.float64],
) -> tuple[Axis, Axis, float, float, int]:
    """Return both axes at ``end``, the contact force at ``t`` and the interval at ``end``: events lie between."""
    f1, f2, at_start = 0.0, 0.0, True
    while end - t > TINY:
        while plan.bounds[i + 1] <= t + TINY:
            i += 1
        stop = min(end, plan.bounds[i + 1])
        h = stop - t
        angle = 0.5 * h * plan.parameter[P_OMEGA]
        half, e = (math.cos(angle), math.sin(angle)), propagators(plan.parameter, h)
        x1, x2, g1, g2 = _step(x1, x2, t, h, e, half, i, plan, nodes, room, sums)
        if at_start:
            f1, f2, at_start = g1, g2, False
        t = stop
    return x1, x2, f1, f2, i


@inlined
def _no_drive(push: NDArray[np.float64] | None) -> NDArray[np.float64] | None:
    """Return a place for what the shaft does at the nodes of a step, None where it does nothing."""
    if push is None:
        return None
    drive = np.zeros((1, 3, 3))
    drive[:, :, 2] = 1.0
    return drive


@kernel
def run(state: NDArray[np.float64], wave: NDArray[np.float64], h: float, plan: TimePlan) -> int:
    """Carry ``state`` (2, 6), deviations from the static equilibrium at t = 0, over the samples of ``wave``.

    They are ``h`` seconds apart. ``state`` is overwritten; a STATUS_ number is returned.
    """
    x1 = (state[0, 0], state[0, 1], state[0, 2], state[0, 3], state[0, 4], state[0, 5])
    x2 = (state[1, 0], state[1, 1], state[1, 2], state[1, 3], state[1, 4], state[1, 5])
    size = plan.balls.moved.shape[1]
    nodes = StepNodes(np.empty((1, 3, 2)), np.zeros((1, 3, size)), np.zeros((1, 3, size)), _no_drive(plan.push))
    room, sums = make_room(plan.balls, nodes), np.zeros(SUMS)
    e = propagators(plan.parameter, h)
    angle = 0.5 * h * plan.parameter[P_OMEGA]
    half = (math.cos(angle), math.sin(angle))
    i = 0
    for n in range(wave.shape[0]):
        t, end = n * h, (n + 1) * h
        while plan.bounds[i + 1] <= t + TINY:
            i += 1
        if plan.bounds[i + 1] >= end - TINY:
            y1, y2, g1, g2 = _step(x1, x2, t, h, e, half, i, plan, nodes, room, sums)
        else:
            y1, y2, g1, g2, i = _broken_step(x1, x2, t, end, i, plan, nodes, room, sums)
        wave[n, 0], wave[n, 1] = accelerations(x1, x2, g1, g2, plan.parameter)
        x1, x2 = y1, y2
    bad = False
    for k in range(6):
        state[0, k], state[1, k] = x1[k], x2[k]
        bad = bad or not math.isfinite(x1[k]) or not math.isfinite(x2[k])
    return STATUS_NOT_FINITE if bad else STATUS_OK
