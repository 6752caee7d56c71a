"""Kernels that integrate a part of a step of the six-degree-of-freedom model, with one set of contacts.

Balls that are not in contact have no direction, and so no force. A part that begins with a ball that has just met its
contact, or ends with one about to leave it, is graded: taken in a variable whose square (of rollers, the third power)
is the time from that instant. In it the damping force, which sets in with a jump and like a root of the approach, is
smooth, and it has no weight where it jumps. Means over a part are taken by Simpson's rule in the same variable.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from models.platform.jit import inlined, kernel
from models.solve.six_dof.kernels.step import (
    P_INV_M,
    P_INV_M_I,
    P_INV_M_O,
    P_OMEGA,
    Balls,
    StepNodes,
    accelerations,
    contact,
    forces,
    kick,
    propagate,
    propagators,
    stages,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.platform.jit import Index
    from models.solve.six_dof.kernels.step import Axis, Flow

# Cells of a stretch beside an instant, of balls and rollers, where it is graded over one step.
CELLS_OF_BALLS = 4
CELLS_OF_ROLLERS = 4
# Over a step: integrals of both accelerations, of both squares, and of both times the time from its middle, and the
# largest sizes of both.
MEANS, SUMS = 6, 8
# Parts that a step may take.
MOST_PARTS = 96


class Room(NamedTuple):
    """Room for what a step that is taken in parts needs; E elements, the moved ones first.

    Attributes:
        on: whether each is in contact.
        here, there: gap (negative where it is open), m, and its rate, m/s, at the begin and end of a part, (2, E).
        balls: the balls, without a direction where they are not in contact.
        within: what is known of a part at its nodes, one row.
        sums: integrals over a part and largest values in it, (SUMS,).
        marks: of each part that a step was taken in: begin and end, from 0 to 1, the times since the instant before and
            up to the one after it, s, and the element that changes at its end or -1, (MOST_PARTS + 1, 5).
    """

    on: NDArray[np.bool_]
    here: NDArray[np.float64]
    there: NDArray[np.float64]
    balls: Balls
    within: StepNodes
    sums: NDArray[np.float64]
    marks: NDArray[np.float64]


@inlined
def _drive_of_a_part(drive: NDArray[np.float64] | None) -> NDArray[np.float64] | None:
    """Return a place for what the shaft does in a part, None where it does nothing."""
    if drive is None:
        return None
    return np.zeros((1, 3, 3))


@kernel
def make_room(balls: Balls, nodes: StepNodes) -> Room:
    """Return room for steps with these balls."""
    moved, count = balls.moved.shape[1], balls.moved.shape[1] + balls.plain.shape[1]
    held = Balls(balls.moved.copy(), balls.plain.copy(), balls.near_moved, balls.near, balls.power)
    depth, rate = np.zeros((1, 3, moved)), np.zeros((1, 3, moved))
    within = StepNodes(np.zeros((1, 3, 2)), depth, rate, _drive_of_a_part(nodes.drive))
    on, here, there = np.zeros(count, dtype=np.bool_), np.zeros((2, count)), np.zeros((2, count))
    return Room(on, here, there, held, within, np.zeros(SUMS), np.zeros((MOST_PARTS + 1, 5)))


@inlined
def path_within(place: float, node: Index, span: float, nodes: StepNodes, n: Index, within: StepNodes) -> None:
    """Write d and omega_c d' at a place within step ``n`` of ``span`` s, from its three nodes (quintic Hermite).

    The place, from 0 to 1, is written to row 0, ``node``. In s from -1 to 1 over the step, the polynomial has the
    values and slopes of the nodes at s = -1, 0 and 1.
    """
    depth, rate = nodes.depth, nodes.rate
    s = 2.0 * place - 1.0
    half = 0.5 * span
    for j in range(depth.shape[2]):
        middle, m_slope = depth[n, 1, j], half * rate[n, 1, j]
        even = 0.5 * (depth[n, 2, j] + depth[n, 0, j]) - middle
        odd = 0.5 * (depth[n, 2, j] - depth[n, 0, j]) - m_slope
        even_slope = 0.5 * half * (rate[n, 2, j] - rate[n, 0, j])
        odd_slope = 0.5 * half * (rate[n, 2, j] + rate[n, 0, j]) - m_slope
        a4, a5 = 0.5 * even_slope - even, 0.5 * (odd_slope - 3.0 * odd)
        a2, a3 = even - a4, odd - a5
        within.depth[0, node, j] = middle + s * (m_slope + s * (a2 + s * (a3 + s * (a4 + s * a5))))
        within.rate[0, node, j] = (m_slope + s * (2.0 * a2 + s * (3.0 * a3 + s * (4.0 * a4 + s * 5.0 * a5)))) / half


@inlined
def _shaft_within(
    place: float, node: Index, drive: NDArray[np.float64] | None, n: Index, into: NDArray[np.float64] | None
) -> float:
    """Write what the shaft does at a place, as the parabola through the nodes; return the mean pace up to there."""
    if drive is None or into is None:
        return 1.0
    for k in range(3):
        first, middle, last = drive[n, 0, k], drive[n, 1, k], drive[n, 2, k]
        rise, bend = 4.0 * middle - 3.0 * first - last, 2.0 * (first + last) - 4.0 * middle
        into[0, node, k] = first + place * (rise + place * bend)
    first, middle, last = drive[n, 0, 2], drive[n, 1, 2], drive[n, 2, 2]
    rise, bend = 4.0 * middle - 3.0 * first - last, 2.0 * (first + last) - 4.0 * middle
    return first + place * (rise / 2.0 + place * bend / 3.0)


@inlined
def fill_node(place: float, node: Index, h: float, omega: float, nodes: StepNodes, n: Index, within: StepNodes) -> None:
    """Write what is known beforehand at a place, from 0 to 1, within step ``n``."""
    pace = _shaft_within(place, node, nodes.drive, n, within.drive)
    angle = omega * pace * h * place
    c, s = math.cos(angle), math.sin(angle)
    within.turn[0, node, 0] = nodes.turn[n, 0, 0] * c - nodes.turn[n, 0, 1] * s
    within.turn[0, node, 1] = nodes.turn[n, 0, 1] * c + nodes.turn[n, 0, 0] * s
    path_within(place, node, h, nodes, n, within)


@inlined
def hold(j: Index, balls: Balls, room: Room) -> None:
    """Give element j a direction in ``room`` where it is in contact, and none elsewhere."""
    share, count = 1.0 if room.on[j] else 0.0, balls.moved.shape[1]
    if j < count:
        room.balls.moved[0, j], room.balls.moved[1, j] = share * balls.moved[0, j], share * balls.moved[1, j]
    else:
        room.balls.plain[0, j - count] = share * balls.plain[0, j - count]
        room.balls.plain[1, j - count] = share * balls.plain[1, j - count]


@inlined
def hold_closed(balls: Balls, room: Room) -> None:
    """Take those elements as in contact whose gap ``room.here`` says so."""
    for j in range(room.on.shape[0]):
        room.on[j] = room.here[0, j] > 0.0
        hold(j, balls, room)


@inlined
def root_of(x: float, grade: Index) -> float:
    """Return the root of x whose power is ``grade``, 1 to 3."""
    return x if grade == 1 else math.sqrt(x) if grade == 2 else x ** (1.0 / 3.0)


@inlined
def power_of(x: float, grade: Index) -> tuple[float, float]:
    """Return x to the power of ``grade``, 1 to 3, and its slope."""
    if grade == 1:
        return x, 1.0
    if grade == 2:
        return x * x, 2.0 * x
    return x * x * x, 3.0 * x * x


@inlined
def stretch(
    graded: bool, offset: float, span: float, reach: float, h: float, rollers: bool
) -> tuple[int, int, float, float]:
    """Return grade and number of the cells of a stretch of ``span`` s, and its variable at both ends.

    ``offset``: time from the instant to its nearer end, s; for the rest see ``advance``.
    """
    grade = 1 if not graded else 3 if rollers else 2
    cells = 2 if graded else 1
    if graded and offset < span:
        # So many that their error falls with the fourth power of the step.
        cells = math.ceil(CELLS_OF_ROLLERS * reach / h if rollers else CELLS_OF_BALLS * math.sqrt(reach / h))
    return grade, cells, root_of(offset, grade), root_of(offset + span, grade)


@inlined
def cell_at(
    cell: int,
    falls: bool,
    grade: int,
    width: float,
    least: float,
    most: float,
    begin: float,
    span: float,
    offset: float,
) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Return the times of start, middle and end of a cell of a stretch, s, and its weights (``stages``).

    Args:
        falls: whether the variable falls with the time: towards an instant.
        grade, least, most: of ``stretch``; ``width``: of a cell in the variable.
        begin, span: of the stretch, s; ``offset``: as there.
    """
    start = most - cell * width if falls else least + cell * width
    end = start - width if falls else start + width
    (t0, w0), (tm, wm), (t1, w1) = power_of(start, grade), power_of(0.5 * (start + end), grade), power_of(end, grade)
    if falls:
        t0, tm, t1 = begin + span + offset - t0, begin + span + offset - tm, begin + span + offset - t1
    else:
        t0, tm, t1 = begin + t0 - offset, begin + tm - offset, begin + t1 - offset
    return (t0, tm, t1), (width * w0, width * wm, width * w1)


@inlined
def _add(sums: NDArray[np.float64], weight: float, time: float, a: tuple[float, float]) -> None:
    """Add a value of both accelerations, at a time from the middle of the step."""
    for k in range(2):
        sums[k] += weight * a[k]
        sums[2 + k] += weight * a[k] * a[k]
        sums[4 + k] += weight * time * a[k]


@inlined
def crest(before: float, at: float, after: float) -> float:
    """Return the size of the middle of three values at equal distances, or of the parabola through them at its vertex
    where that is larger and lies between them.
    """
    slope, bend = 0.5 * (after - before), after - 2.0 * at + before
    if at * bend < 0.0 and abs(slope) < abs(bend):
        return abs(at) + 0.5 * slope * slope / abs(bend)
    return abs(at)


@inlined
def in_the_middle(
    x: Axis,
    p: NDArray[np.float64],
    weight: tuple[float, float, float],
    e: Flow,
    back: float,
    a: float,
    b: float,
    g: float,
) -> Axis:
    """Return one axis in the middle of a step: the interpolation of third order that its stages give.

    ``a``, ``b`` and ``g`` are the contact forces at its start, in its middle, summed, and at its end, which acts over
    the negative time ``back``; for the rest see ``stages``. A force on the shaft is left out.
    """
    b_i, b_m, b_o = p[P_INV_M_I], p[P_INV_M], p[P_INV_M_O]
    y = propagate(kick(x, weight[0] * 5.0 / 24.0 * a, 0.0, b_i, b_m, b_o), e)
    y = kick(y, weight[1] / 6.0 * b, 0.0, b_i, b_m, b_o)
    z = kick(y, -weight[2] / 24.0 * g, 0.0, b_i, b_m, b_o)
    gained_i, gained_m, gained_o = back * (z[1] - y[1]), back * (z[3] - y[3]), back * (z[5] - y[5])
    return (z[0] + gained_i, z[1], z[2] + gained_m, z[3], z[4] + gained_o, z[5])


@inlined
def advance(
    x1: Axis,
    x2: Axis,
    ends: tuple[float, float],
    since: float,
    until: float,
    h: float,
    reach: float,
    p: NDArray[np.float64],
    nodes: StepNodes,
    n: Index,
    room: Room,
) -> tuple[Axis, Axis]:
    """Return both axes at the end of a part, and write its integrals to ``room``.

    Args:
        ends: of the part, from 0 to 1 over the step ``n`` of ``h`` s.
        since, until: times from the instant before its begin, and to the one after its end, s; it is graded towards
            those within ``reach``.
    """
    sums, within = room.sums, room.within
    sums[:] = 0.0
    halves = 2 if since < reach and until < reach else 1
    graded = since < reach or until < reach
    rollers = room.balls.power != 0.5
    span = (ends[1] - ends[0]) * h / halves
    for half in range(halves):
        # Towards an instant the variable falls.
        falls = graded and not (since < reach and half == 0)
        offset = (until if falls else since) if graded else 0.0
        begin = ends[0] * h + half * span
        grade, cells, least, most = stretch(graded, offset, span, reach, h, rollers)
        width = (most - least) / cells
        for cell in range(cells):
            (t0, tm, t1), weight = cell_at(cell, falls, grade, width, least, most, begin, span, offset)
            fill_node(t0 / h, np.int64(0), h, p[P_OMEGA], nodes, n, within)
            fill_node(tm / h, np.int64(1), h, p[P_OMEGA], nodes, n, within)
            fill_node(t1 / h, np.int64(2), h, p[P_OMEGA], nodes, n, within)
            e, f = propagators(p, 2.0 * (tm - t0)), propagators(p, 2.0 * (t1 - tm))
            y1, y2, (a1, a2), (b1, b2), (c1, c2), (u1, u2, g1, g2), _, _ = stages(
                x1, x2, weight, e, f, p, forces, (room.balls, within), np.int64(0), 0.0
            )
            z1 = in_the_middle(x1, p, weight, e, tm - t1, a1, b1 + c1, g1)
            z2 = in_the_middle(x2, p, weight, e, tm - t1, a2, b2 + c2, g2)
            f1, f2, _, _ = contact(z1, z2, p, room.balls, within, np.int64(0), np.int64(1), 0.0)
            first, middle = accelerations(x1, x2, a1, a2, p), accelerations(z1, z2, f1, f2, p)
            last = accelerations(u1, u2, g1, g2, p)
            _add(sums, weight[0] / 6.0, t0 - 0.5 * h, first)
            _add(sums, weight[1] / 1.5, tm - 0.5 * h, middle)
            _add(sums, weight[2] / 6.0, t1 - 0.5 * h, last)
            for k in range(2):
                highest = max(abs(first[k]), crest(first[k], middle[k], last[k]), abs(last[k]))
                sums[MEANS + k] = max(sums[MEANS + k], highest)
            x1, x2 = y1, y2
    return x1, x2
