"""Kernels that take a step of one lane again, in parts that end where its contacts change and where its path has kinks.

Lanes share their steps, which therefore end on no kink and at no instant. A step of a lane that holds one, or is near
to an instant, is taken again from its beginning with the kernels of one scene (models.solve.six_dof.kernels.instants),
and its share in the means comes from its parts (``lane_means``). The other lanes keep theirs.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from models.platform.jit import inlined, kernel
from models.solve.six_dof.kernels.instants import fill_gaps, retake
from models.solve.six_dof.kernels.parts import SUMS, Room, fill_node, hold_closed, make_room
from models.solve.six_dof.kernels.path import fill_path
from models.solve.six_dof.kernels.period_setup import fill_turn
from models.solve.six_dof.kernels.step import (
    P_LOAD_1,
    P_OMEGA,
    P_U_1,
    P_U_2,
    Balls,
    StepNodes,
    accelerations,
    contact,
    forces,
    propagators,
    rate_of,
    step,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.solve.six_dof.kernels.step import Axis

# Loops of eight are unrolled before the vectoriser sees them and run without vectors; wider ones are all as quick.
LANES = 32

# Pieces between kinks of a step at most. Kinks so near to the end of a step, rad, are on it.
_PIECES = 8
ON_THE_END = 1e-8
# Distance from an instant within which a piece between kinks is graded, over its length.
_OF_A_PIECE = 16.0
# Share of a piece over which slopes are differences.
_DIFFERENCE = 1e-3
# Share of a step that is too short a piece for them.
_SHORT = 0.1


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
        slopes: rate of both accelerations at its beginning and end, m/s3, (n, L, 2, 2).
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
    slopes: NDArray[np.float64]


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
    # One row more, for slopes.
    shape = (_PIECES + 1, 3, moved.shape[1])
    nodes = StepNodes(np.zeros((_PIECES + 1, 3, 2)), np.zeros(shape), np.zeros(shape), None)
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
def passed_after(angle: float, start: float) -> float:
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
            at = passed_after(kink, start)
            if abs(at - begin) <= ON_THE_END:
                bounds[0] = at
            elif abs(at - end) <= ON_THE_END:
                bounds[pieces] = at
            elif begin < at < end and pieces < _PIECES:
                place = pieces
                while place > 0 and bounds[place - 1] > at - ON_THE_END:
                    place -= 1
                if place < pieces and bounds[place] < at + ON_THE_END:
                    continue
                for later in range(pieces, place - 1, -1):
                    bounds[later + 1] = bounds[later]
                bounds[place] = at
                pieces += 1
    _fill_rows(i, bounds[: pieces + 1], np.arange(pieces + 1), split, held)
    return pieces


@kernel
def _fill_rows(i: int, bounds: NDArray[np.float64], first: NDArray[np.int64], split: Splitting, held: HeldLane) -> None:
    """Write what is known of lane i between cage angles, in rows from ``first[0]`` on."""
    nodes, begin, end = held.nodes, first[0], first[-1]
    nodes.turn[begin:end] = fill_turn(bounds, first)[begin:]
    nodes.depth[begin:end], nodes.rate[begin:end] = 0.0, 0.0
    fill_path(
        *(split.path[i], split.profiles[split.which[i]], held.starts, np.zeros(held.starts.shape[0], np.int64)),
        *(bounds, first, held.parameter[P_OMEGA], nodes.depth, nodes.rate),
    )


@kernel
def _whole(x1: Axis, x2: Axis, h: float, reach: float, held: HeldLane, n: int) -> tuple[Axis, Axis, bool]:
    """Return both axes after a piece in one step, and whether its stages saw different contacts."""
    e = propagators(held.parameter, h)
    y1, y2, _, _, changed, _ = step(x1, x2, h, e, held.parameter, forces, (held.balls, held.nodes), n, reach)
    return y1, y2, changed


@inlined
def _moved(x: Axis, rate: Axis, time: float) -> Axis:
    """Return one axis after a short time."""
    return (
        x[0] + time * rate[0],
        x[1] + time * rate[1],
        x[2] + time * rate[2],
        x[3] + time * rate[3],
        x[4] + time * rate[4],
        x[5] + time * rate[5],
    )


@kernel
def _write_slopes(
    x1: Axis, x2: Axis, row: int, end: int, span: float, known: bool, held: HeldLane, slopes: NDArray[np.float64]
) -> None:
    """Write the rates of both accelerations to ``slopes`` (2,), by central differences along the motion.

    Args:
        x1, x2: axes at the beginning (``end`` 0) or end (1) of what stands in a row of the nodes, ``span`` s long.
        known: whether the room knows what is in contact there, as it does after the last part of a step.
    """
    p, nodes, within, balls = held.parameter, held.nodes, held.room.within, held.room.balls
    if not known:
        fill_gaps(x1, x2, p, held.balls, nodes, row, np.int64(2 * end), held.room.here)
        hold_closed(held.balls, held.room)
    rate_1, rate_2, time = x1, x2, 0.0
    slopes[:] = 0.0
    for k in range(3):
        place = end + (0.0 if k == 0 else _DIFFERENCE if k == 1 else -_DIFFERENCE)
        fill_node(place, np.int64(0), span, p[P_OMEGA], nodes, row, within)
        time = (place - end) * span
        z1, z2 = (x1, x2) if k == 0 else (_moved(x1, rate_1, time), _moved(x2, rate_2, time))
        f1, f2, _, _ = contact(z1, z2, p, balls, within, np.int64(0), np.int64(0), 0.0)
        if k == 0:
            rate_1, rate_2 = rate_of(x1, f1, p), rate_of(x2, f2, p)
        else:
            a, b = accelerations(z1, z2, f1, f2, p)
            slopes[0] += 0.5 * a / time
            slopes[1] += 0.5 * b / time


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
    w1, w2, z1, z2, taken, span = x1, x2, y1, y2, False, h
    for m in range(pieces):
        near, off, must = reach, 0.0, changed
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
    if taken:
        first = (bounds[1] - bounds[0]) / omega if kinks else h
        for k in range(2):
            # The end first, of which it is known what is in contact.
            end, known = 1 - k, k == 0
            e1, e2, row, length, place = (z1, z2, pieces - 1, span, 1) if known else (w1, w2, 0, first, 0)
            if length < _SHORT * h:
                # Too short for a difference; the path is smooth on the other side, or the step there is in parts too.
                length, row, place = _SHORT * h, _PIECES, 1 - end
                start = split.cage[n] + omega * (end * h - place * length)
                _fill_rows(i, np.array([start, start + omega * length]), np.array([row, row + 1]), split, held)
            _write_slopes(e1, e2, row, place, length, known, held, split.slopes[n, i, end])
    return z1, z2


@kernel
def take_lanes(
    n: int,
    w: NDArray[np.float64],
    rows: tuple[int, int, int, int],
    h: float,
    tables: LaneTables,
    split: Splitting,
    held: HeldLane,
) -> None:
    """Take step ``n`` again in the lanes that need it.

    Args:
        w: holds the states of the lanes.
        rows: where in it those stand at the end of the step and at its beginning; and for each lane whether its stages
            saw different contacts, and by how much one is near.
    """
    end, begin, changes, near = rows
    for i in range(LANES):
        if split.marks[n] >> i & 1 or w[changes + i] > 0.0 or w[near + i] > 0.0:
            x1, x2 = load(w, begin, i), load(w, begin + 6 * LANES, i)
            y1, y2 = load(w, end, i), load(w, end + 6 * LANES, i)
            y1, y2 = take_again(x1, x2, y1, y2, w[changes + i] > 0.0, i, n, h, tables, split, held)
            store(w, end, i, y1)
            store(w, end + 6 * LANES, i, y2)
