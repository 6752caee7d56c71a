"""Kernels that take a step of one lane again, in parts that end where its contacts change and where its path has kinks.

Lanes share their steps, which therefore end on no kink and at no instant. A step of a lane that holds one, or is near
to an instant, is taken again from its beginning with the kernels of one scene (models.solve.six_dof.kernels.instants),
and its share in the means comes from its parts, as in models.solve.six_dof.kernels.period. The other lanes keep theirs.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from models.platform.jit import inlined, kernel
from models.solve.six_dof.kernels.instants import retake
from models.solve.six_dof.kernels.parts import SUMS, Room, make_room
from models.solve.six_dof.kernels.path import fill_path
from models.solve.six_dof.kernels.period import fill_weights
from models.solve.six_dof.kernels.period_setup import fill_turn
from models.solve.six_dof.kernels.step import (
    P_LOAD_1,
    P_OMEGA,
    P_U_1,
    P_U_2,
    Balls,
    StepNodes,
    forces,
    propagators,
    step,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.solve.six_dof.kernels.step import Axis

# Loops of eight are unrolled before the vectoriser sees them and run without vectors; wider ones are all as quick.
LANES = 32

# Pieces between kinks of a step at most. Kinks so near to the end of a step, rad, are on it.
_PIECES = 8
_ON_THE_END = 1e-8
# Distance from an instant within which a piece between kinks is graded, over its length.
_OF_A_PIECE = 16.0
# What a part is to the four values about its step, inner and outer: its moments up to the third one are theirs, were it
# smooth.
_EVEN, _EVEN_OUTER = 13.0 / 24.0, -1.0 / 24.0
_ODD, _ODD_OUTER = 1.05, -1.0 / 60.0


class LaneTables(NamedTuple):
    """What lanes know beforehand; the arrays of models.solve.six_dof.kernels.lanes."""

    turn: NDArray[np.float64]
    damaged: NDArray[np.float64]
    plain: NDArray[np.float64]
    depth: NDArray[np.float64]
    rate: NDArray[np.float64]
    lane: NDArray[np.float64]


class Splitting(NamedTuple):
    """What lanes need beyond ``LaneTables`` to take steps again, and what they record of it.

    Attributes:
        reach: time from an instant, s, within which steps are graded; 0 where none is taken again.
        cage: cage angle at the beginning of each step, rad, (n,).
        start: angles of the damaged slots, rad, (k, L).
        order: plain slots by their distance from the load, int64, and how many of them can be touched while the
            displacement lies along it (models.solve.six_dof.kernels.step.Balls).
        near: see ``order``.
        path, profiles, which: the defect of each lane (models.solve.six_dof.kernels.path), (L, DEFECT), the profiles of
            rough floors, (p, 4, pieces), and that of each lane, int64, (L,).
        kinks: angles at which the path of each lane is not smooth, rad, NaN beyond their number, (L, kinks).
        marks: bit i tells that lane i meets a kink in a step, int64, (n,).
        changed: whether a step of a lane was taken again, (n, L).
        parts: integrals over such a step (models.solve.six_dof.kernels.parts), (n, L, SUMS).
    """

    reach: float
    cage: NDArray[np.float64]
    start: NDArray[np.float64]
    order: NDArray[np.int64]
    near: int
    path: NDArray[np.float64]
    profiles: NDArray[np.float64]
    which: NDArray[np.int64]
    kinks: NDArray[np.float64]
    marks: NDArray[np.int64]
    changed: NDArray[np.bool_]
    parts: NDArray[np.float64]


class HeldLane(NamedTuple):
    """One lane as the kernels of one scene take it: parameters, balls, a step's pieces at their nodes, and room."""

    parameter: NDArray[np.float64]
    balls: Balls
    nodes: StepNodes
    room: Room
    starts: NDArray[np.float64]
    bounds: NDArray[np.float64]
    total: NDArray[np.float64]


@inlined
def load(w: NDArray[np.float64], row: int, i: int) -> Axis:
    """Return one axis of lane i, whose first number stands at ``row``."""
    return (
        w[row + i],
        w[row + LANES + i],
        w[row + 2 * LANES + i],
        w[row + 3 * LANES + i],
        w[row + 4 * LANES + i],
        w[row + 5 * LANES + i],
    )


@inlined
def store(w: NDArray[np.float64], row: int, i: int, x: Axis) -> None:
    """Write one axis of lane i to where ``load`` reads it."""
    w[row + i] = x[0]
    w[row + LANES + i] = x[1]
    w[row + 2 * LANES + i] = x[2]
    w[row + 3 * LANES + i] = x[3]
    w[row + 4 * LANES + i] = x[4]
    w[row + 5 * LANES + i] = x[5]


@kernel
def make_held(parameter: NDArray[np.float64], tables: LaneTables, near: int) -> HeldLane:
    """Return room for one lane."""
    moved, plain = np.zeros((3, tables.damaged.shape[0])), np.zeros((3, tables.plain.shape[0]))
    power = 1.0
    for k in range(moved.shape[1] + plain.shape[1]):
        if k < moved.shape[1]:
            moved[2, k] = power
        else:
            plain[2, k - moved.shape[1]] = power
        power *= 2.0
    balls = Balls(moved, plain, moved.shape[1], near, 0.5)
    shape = (_PIECES, 3, moved.shape[1])
    nodes = StepNodes(np.zeros((_PIECES, 3, 2)), np.zeros(shape), np.zeros(shape), None)
    starts, bounds = np.zeros(moved.shape[1]), np.zeros(_PIECES + 1)
    return HeldLane(parameter.copy(), balls, nodes, make_room(balls, nodes), starts, bounds, np.zeros(SUMS))


@kernel
def _hold_lane(i: int, tables: LaneTables, split: Splitting, held: HeldLane) -> None:
    """Make lane i the one that is held."""
    p, balls = held.parameter, held.balls
    p[P_LOAD_1], p[P_U_1], p[P_U_2] = tables.lane[0, i], tables.lane[1, i], tables.lane[2, i]
    for k in range(balls.moved.shape[1]):
        balls.moved[0, k], balls.moved[1, k] = tables.damaged[k, 0, i], tables.damaged[k, 1, i]
        held.starts[k] = split.start[k, i]
    for j in range(balls.plain.shape[1]):
        at = split.order[j]
        balls.plain[0, j], balls.plain[1, j] = tables.plain[at, 0, i], tables.plain[at, 1, i]


@kernel
def _hold_step(i: int, n: int, tables: LaneTables, held: HeldLane) -> None:
    """Write a step of lane i in one piece."""
    nodes = held.nodes
    for node in range(3):
        nodes.turn[0, node, 0], nodes.turn[0, node, 1] = tables.turn[n, node, 0], tables.turn[n, node, 1]
        for k in range(nodes.depth.shape[2]):
            nodes.depth[0, node, k], nodes.rate[0, node, k] = tables.depth[n, node, k, i], tables.rate[n, node, k, i]


@inlined
def _passed_after(angle: float, start: float) -> float:
    """Return by which turn of the cage, rad, a ball that begins at ``start`` reaches an angle, from 0 to a turn."""
    turn = angle - start
    return turn - 2.0 * math.pi * math.floor(turn / (2.0 * math.pi))


@kernel
def _hold_pieces(i: int, begin: float, end: float, split: Splitting, held: HeldLane) -> int:
    """Write a step of lane i in pieces between the kinks that it meets; return how many there are.

    ``begin`` and ``end``: cage angles, rad.
    """
    bounds, pieces = held.bounds, 1
    bounds[0], bounds[1] = begin, end
    for kink in split.kinks[i]:
        if not math.isfinite(kink):
            break
        for start in held.starts:
            at = _passed_after(kink, start)
            if abs(at - begin) <= _ON_THE_END:
                bounds[0] = at
            elif abs(at - end) <= _ON_THE_END:
                bounds[pieces] = at
            elif begin < at < end and pieces < _PIECES:
                place = pieces
                while place > 0 and bounds[place - 1] > at - _ON_THE_END:
                    place -= 1
                if place < pieces and bounds[place] < at + _ON_THE_END:
                    continue
                for later in range(pieces, place - 1, -1):
                    bounds[later + 1] = bounds[later]
                bounds[place] = at
                pieces += 1
    first, nodes = np.arange(pieces + 1), held.nodes
    turn = fill_turn(bounds[: pieces + 1], first)
    nodes.turn[:pieces] = turn
    fill_path(
        *(split.path[i], split.profiles[split.which[i]], held.starts, bounds[: pieces + 1], first),
        *(held.parameter[P_OMEGA], nodes.depth, nodes.rate),
    )
    return pieces


@kernel
def _whole(x1: Axis, x2: Axis, h: float, reach: float, held: HeldLane, n: int) -> tuple[Axis, Axis, bool]:
    """Return both axes after a piece in one step, and whether its stages saw different contacts."""
    e = propagators(held.parameter, h)
    y1, y2, _, _, changed, _ = step(x1, x2, h, e, held.parameter, forces, (held.balls, held.nodes), n, reach)
    return y1, y2, changed


@kernel
def take_again(
    x1: Axis,
    x2: Axis,
    y1: Axis,
    y2: Axis,
    changed: bool,
    i: int,
    n: int,
    h: float,
    tables: LaneTables,
    split: Splitting,
    held: HeldLane,
) -> tuple[Axis, Axis]:
    """Return both axes of lane i after step ``n``, taken again where it holds an instant or a kink or is near to one.

    Args:
        x1, x2: axes at its beginning.
        y1, y2: the same at its end after a step in one.
        changed: whether the stages of that step saw different contacts, or it has to be taken again for another reason.
        h: step, s.
    """
    _hold_lane(i, tables, split, held)
    p, bounds, total, parts = held.parameter, held.bounds, held.total, split.parts[n, i]
    omega, reach, pieces = p[P_OMEGA], max(h, split.reach), 1
    kinks = (split.marks[n] >> i & 1) != 0
    if kinks:
        pieces = _hold_pieces(i, split.cage[n], split.cage[n] + omega * h, split, held)
    else:
        _hold_step(i, n, tables, held)
    parts[:] = 0.0
    z1, z2, taken = y1, y2, False
    for m in range(pieces):
        span, near, off, must = h, reach, 0.0, changed
        if kinks:
            span = (bounds[m + 1] - bounds[m]) / omega
            near = max(span, min(reach, _OF_A_PIECE * span))
            off = (0.5 * (bounds[m] + bounds[m + 1]) - bounds[0]) / omega - 0.5 * h
            y1, y2, must = _whole(x1, x2, span, near, held, m)
        # A piece is taken in parts in any case: its integrals are wanted.
        for _ in range(2 if kinks else 1):
            z1, z2, taken, _, _ = retake(
                *(x1, x2, y1, y2, span, near, must, p, held.balls, held.nodes, m, held.room, total)
            )
            if taken:
                break
            must = True
        if taken:
            for k in range(2):
                parts[k] += total[k]
                parts[2 + k] += total[2 + k]
                parts[4 + k] += total[4 + k] + off * total[k]
        x1, x2 = z1, z2
    split.changed[n, i] = taken
    return z1, z2


@inlined
def _alone(split: Splitting, n: int, i: int) -> bool:
    """Return whether a step of lane i was taken in one, and the one before it was not, or there is none."""
    return not split.changed[n, i] and (n == 0 or split.changed[n - 1, i])


@kernel
def take_lanes(
    n: int,
    begin: int,
    last: bool,
    w: NDArray[np.float64],
    rows: tuple[int, int, int, int, int],
    h: float,
    tables: LaneTables,
    split: Splitting,
    held: HeldLane,
) -> None:
    """Take step ``n`` again in the lanes that need it, and a step before it that is left alone by that.

    Args:
        begin: first step with the same balls.
        last: whether the block ends with this step.
        w: holds the states of the lanes.
        rows: where in it those stand at the end of the step, at its beginning, and at that of the step before; and for
            each lane whether its stages saw different contacts, and by how much one is near.
    """
    end, here, before, changes, near = rows
    for i in range(LANES):
        alone = last and n > 0 and split.changed[n - 1, i]
        if not (alone or split.marks[n] >> i & 1 or w[changes + i] > 0.0 or w[near + i] > 0.0):
            continue
        for back in range(2):
            start, stop = (here, end) if back == 0 else (before, here)
            x1, x2 = load(w, start, i), load(w, start + 6 * LANES, i)
            y1, y2 = load(w, stop, i), load(w, stop + 6 * LANES, i)
            changed = back == 1 or alone or w[changes + i] > 0.0
            y1, y2 = take_again(x1, x2, y1, y2, changed, i, n - back, h, tables, split, held)
            if back == 0:
                store(w, end, i, y1)
                store(w, end + 6 * LANES, i, y2)
            if not (split.changed[n, i] and n > begin and _alone(split, n - 1, i)):
                break


@kernel
def mark_kinks(begin: int, end: int, bounds: NDArray[np.int64], turn: float, split: Splitting) -> None:
    """Write ``marks`` of steps ``begin`` to ``end``, in each of which the cage turns by ``turn``, rad.

    ``bounds``: first step of each ball period, and the number of steps.
    """
    split.marks[begin:end] = 0
    for period in range(bounds.shape[0] - 1):
        first, stop = bounds[period], bounds[period + 1]
        if first < begin or stop > end:
            continue
        for i in range(LANES):
            for kink in split.kinks[i]:
                if not math.isfinite(kink):
                    break
                for k in range(split.start.shape[0]):
                    at = _passed_after(kink, split.start[k, i]) - split.cage[first]
                    for side in (-_ON_THE_END, _ON_THE_END):
                        n = first + math.floor((at + side) / turn)
                        if first <= n < stop:
                            split.marks[n] |= 1 << i


@kernel
def weigh(wave: NDArray[np.float64], split: Splitting, h: float, out: NDArray[np.float64]) -> None:
    """Write the mean squares of a block to ``out`` (2, L), and make of ``wave`` (n + 1, 2, L) what a sum over its first
    n values makes lines of: each value by its weight, and steps that were taken again by their parts.

    Lanes in which none was are left as they are.
    """
    steps = wave.shape[0] - 1
    flow, first, weight = np.full((1, 10), h), np.array([0, steps]), np.empty(steps + 1)
    smooth, changed = np.empty(0), np.empty(steps, dtype=np.bool_)
    out[:] = 0.0
    for n in range(steps):
        for sensor in range(2):
            for i in range(LANES):
                out[sensor, i] += wave[n, sensor, i] * wave[n, sensor, i]
    out /= steps
    for i in range(LANES):
        any_changed = False
        for n in range(steps):
            changed[n] = split.changed[n, i]
            any_changed = any_changed or changed[n]
        if not any_changed:
            continue
        fill_weights(flow, first, smooth, changed, True, weight)
        for sensor in range(2):
            power = 0.0
            for n in range(steps + 1):
                power += weight[n] * wave[n, sensor, i] * wave[n, sensor, i]
                wave[n, sensor, i] *= weight[n] * steps
            wave[0, sensor, i] += wave[steps, sensor, i]
            for n in range(steps):
                if changed[n]:
                    part = split.parts[n, i]
                    power += part[2 + sensor] / (steps * h)
                    even, odd = part[sensor] / h, part[4 + sensor] / (h * h)
                    wave[(n + steps - 1) % steps, sensor, i] += _EVEN_OUTER * even - _ODD_OUTER * odd
                    wave[n, sensor, i] += _EVEN * even - _ODD * odd
                    wave[(n + 1) % steps, sensor, i] += _EVEN * even + _ODD * odd
                    wave[(n + 2) % steps, sensor, i] += _EVEN_OUTER * even + _ODD_OUTER * odd
            out[sensor, i] = max(power, 0.0)
