"""Kernels that find the instants within a step of the six-degree-of-freedom model at which contacts change.

The damping force jumps where a ball meets its contact or leaves it, which no step of high order follows: a step beside
such an instant is taken again (``retake``) in parts (models.solve.six_dof.kernels.parts) that end at the instants. They
are found on the cubic that gap and rate at both ends of a part make, and then by Newton's method on the gap at the end
of a part that ends there. That a gap closes and opens again within a step shows in the cubic as well; where its
extremum is too near to zero to tell, it grazes: a part ends there, and the gap itself tells.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from models.platform.jit import inlined, kernel
from models.solve.six_dof.kernels.parts import MEANS, MOST_PARTS, SUMS, Room, advance, hold, hold_closed
from models.solve.six_dof.kernels.step import P_CLEARANCE, P_OMEGA, Balls, StepNodes, relative_motion

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.platform.jit import Index
    from models.solve.six_dof.kernels.step import Axis

# Error of the cubic over its bend: within it an extremum may be on either side of zero.
GRAZING = 0.02
# No part ends at an extremum so near to its ends.
_INNER = 0.05
# Parts of a step that end at an extremum, and corrections of one instant.
_LOOKS = 3
_CORRECTIONS = 30
# Distance from an instant over the step at which it counts as found; of two so near neither is the first.
_FOUND = 1e-7
_TOGETHER = 1e-6
# A gap that is none, m.
_NO_GAP = 1e-18


@inlined
def _pace(drive: NDArray[np.float64] | None, n: Index, node: Index) -> float:
    if drive is None:
        return 1.0
    return drive[n, node, 2]


@inlined
def fill_gaps(
    x1: Axis,
    x2: Axis,
    p: NDArray[np.float64],
    balls: Balls,
    nodes: StepNodes,
    n: Index,
    node: Index,
    out: NDArray[np.float64],
) -> None:
    """Write the gap of each element and its rate at a node, (2, E)."""
    moved, plain, count = balls.moved, balls.plain, balls.moved.shape[1]
    omega = p[P_OMEGA] * _pace(nodes.drive, n, node)
    p1, p2, q1, q2, _ = relative_motion(x1, x2, p, omega, nodes.turn[n, node, 0], nodes.turn[n, node, 1])
    for j in range(count):
        out[0, j] = p1 * moved[0, j] + p2 * moved[1, j] - p[P_CLEARANCE] - nodes.depth[n, node, j]
        out[1, j] = q1 * moved[0, j] + q2 * moved[1, j] - nodes.rate[n, node, j]
    for j in range(plain.shape[1]):
        out[0, count + j] = p1 * plain[0, j] + p2 * plain[1, j] - p[P_CLEARANCE]
        out[1, count + j] = q1 * plain[0, j] + q2 * plain[1, j]


@inlined
def _nearest(gaps: NDArray[np.float64], sign: float, within: float) -> float:
    """Return the time, s, since the latest instant at which one that is in contact met it, or with ``sign`` -1 up to
    the first at which one leaves it, at the rates of ``gaps``; infinite where it is not less than ``within``.
    """
    found = math.inf
    for j in range(gaps.shape[1]):
        rate = sign * gaps[1, j]
        if rate > 0.0 and 0.0 <= gaps[0, j] < within * rate:
            found = min(found, gaps[0, j] / rate)
    return found


@inlined
def _zero_between(q0: float, r0: float, a: float, b: float, low: float, high: float) -> float:
    """Return where the cubic q0 + r0 t + a t^2 + b t^3 becomes negative between ``low`` and ``high``."""
    root = 0.5 * (low + high)
    for _ in range(40):
        value = q0 + root * (r0 + root * (a + root * b))
        slope = r0 + root * (2.0 * a + root * 3.0 * b)
        if value >= 0.0:
            low = root
        else:
            high = root
        following = root - value / slope if slope != 0.0 else low
        if not low < following < high:
            following = 0.5 * (low + high)
        done = abs(following - root) < 1e-10
        root = following
        if done:
            break
    return root


@inlined
def _crossing(q0: float, r0: float, q1: float, r1: float, look: bool) -> tuple[float, bool]:
    """Return where a gap first changes its sign, over the part, and whether it certainly does; 2 where it does not.

    ``q0`` and ``q1`` are the gaps at both ends, signed such that they count as positive up to there, ``r0`` and ``r1``
    their rates times the part. With ``look`` an extremum that may be on either side of zero is returned as uncertain.
    """
    q0 = max(q0, 0.0)
    a, b = 3.0 * (q1 - q0) - 2.0 * r0 - r1, r0 + r1 - 2.0 * (q1 - q0)
    margin = GRAZING * (abs(a) + abs(b))
    first, second, under = 2.0, 2.0, a * a - 3.0 * b * r0
    if under > 0.0:
        sum_of = -(a + math.copysign(math.sqrt(under), a))
        first = sum_of / (3.0 * b) if b != 0.0 else 2.0
        second = r0 / sum_of if sum_of != 0.0 else 2.0
    if first > second:
        first, second = second, first
    low = 0.0
    for k in range(3):
        t = first if k == 0 else second if k == 1 else 1.0
        if k < 2 and not 0.0 < t < 1.0:
            continue
        value = q0 + t * (r0 + t * (a + t * b)) if k < 2 else q1
        if value < 0.0 and (k == 2 or value < -margin):
            return _zero_between(q0, r0, a, b, low, t), True
        lowest = k < 2 and 2.0 * a + 6.0 * b * t > 0.0
        if look and lowest and value <= margin and _INNER < t < 1.0 - _INNER:
            return t, False
        low = t
    return 2.0, True


@inlined
def _first_event(room: Room, span: float, skip: Index, look: bool) -> tuple[float, int, bool]:
    """Return where in a part of ``span`` s the first contact changes, which, and whether it certainly does (as in
    ``_crossing``); -1 is none. One is left out.
    """
    here, there = room.here, room.there
    at, element, sure = 1.0, -1, True
    for j in range(here.shape[1]):
        side = 1.0 if room.on[j] else -1.0
        q0, q1, r0, r1 = side * here[0, j], side * there[0, j], side * here[1, j] * span, side * there[1, j] * span
        # A curve bent one way that comes back has tangents at both ends that meet zero between them.
        if j == skip or (q1 >= 0.0 and (r0 >= 0.0 or r1 <= 0.0 or q0 > -r0 or q1 > r1)):
            continue
        place, certain = _crossing(q0, r0, q1, r1, look)
        if place < at:
            at, element, sure = place, j, certain
    return at, element, sure


@inlined
def change(target: Index, h: float, balls: Balls, room: Room) -> int:
    """Go on to the end of a part at which ``target`` changes its contact, if it is one; return how many do.

    Others change at the same time: those whose gap says so, or will within a vanishing share of the step ``h``, s.
    """
    changes = 0
    for j in range(room.on.shape[0]):
        gap, rate = room.there[0, j], room.there[1, j]
        room.here[0, j], room.here[1, j] = gap, rate
        passed = (gap > 0.0) != room.on[j]
        passes = (rate > 0.0) != room.on[j] and abs(gap) <= _TOGETHER * h * abs(rate)
        if j == target or passed or passes:
            room.on[j] = not room.on[j]
            room.here[0, j] = 0.0
            hold(j, balls, room)
            changes += 1
    return changes


@inlined
def _corrected(gap: float, rate: float, h: float, place: float, low: float, high: float) -> float:
    """Return a better place for an instant where the gap at ``place`` is not zero: Newton's, within the bracket.

    ``gap`` counts as positive up to the instant, with its ``rate``. Without a sign of one before ``high`` that is it.
    """
    following = place - gap / (rate * h) if rate < 0.0 else math.inf
    if gap > 0.0:
        return min(following, high)
    return following if low < following < high else 0.5 * (low + high)


@kernel
def retake(
    x1: Axis,
    x2: Axis,
    y1: Axis,
    y2: Axis,
    h: float,
    reach: float,
    changed: bool,
    p: NDArray[np.float64],
    balls: Balls,
    nodes: StepNodes,
    n: Index,
    room: Room,
    total: NDArray[np.float64],
) -> tuple[Axis, Axis, bool, int, int]:
    """Return both axes after a step that may hold instants, whether it was taken in parts, how many contacts change in
    it and how many extrema graze.

    Args:
        x1, x2: axes at the begin of step ``n``, of ``h`` s.
        y1, y2: the same at its end after a step in one; they are returned where no instant is near.
        reach: time from an instant, s, within which parts are graded; at least ``h``.
        changed: whether the stages of that step saw different contacts.
        total: written where the step was taken in parts: integrals over it and largest values in it, (SUMS,).
    """
    here, there, on = room.here, room.there, room.on
    fill_gaps(x1, x2, p, balls, nodes, n, np.int64(0), here)
    fill_gaps(y1, y2, p, balls, nodes, n, np.int64(2), there)
    hold_closed(balls, room)
    since, beyond, grazing = _nearest(here, 1.0, reach), _nearest(there, -1.0, reach), 0
    at, target, sure = _first_event(room, h, np.int64(-1), grazing < _LOOKS)
    if target < 0 and not changed and not since < reach and not beyond < reach:
        return y1, y2, False, 0, 0
    total[:] = 0.0
    instants, corrections, done = 0, 0, 0
    grazing += 0 if sure else 1
    place, stop, low, high = 0.0, at, 0.0, 1.0
    target = target if sure else -1
    for part in range(MOST_PARTS + 1):
        last = part == MOST_PARTS
        if last:
            stop, target = 1.0, -1
        until = beyond if stop == 1.0 else 0.0 if target >= 0 and on[target] else math.inf
        y1, y2 = advance(x1, x2, (place, stop), since, until, h, reach, p, nodes, n, room)
        fill_gaps(y1, y2, p, balls, room.within, np.int64(0), np.int64(2), there)
        at, element, sure = _first_event(room, (stop - place) * h, target, grazing < _LOOKS)
        if element >= 0 and (1.0 - at) * (stop - place) > _TOGETHER and not last:
            grazing += 0 if sure else 1
            low, high, corrections = place, stop, 0
            stop, target = place + at * (stop - place), element if sure else -1
            continue
        if target >= 0:
            side = 1.0 if on[target] else -1.0
            gap, rate = side * there[0, target], side * there[1, target]
            if gap > 0.0:
                low = stop
            else:
                high = stop
            better = _corrected(gap, rate, h, stop, low, high)
            if abs(better - stop) > _FOUND and abs(gap) > _NO_GAP and corrections < _CORRECTIONS:
                # Where nothing tells of an instant before ``high``, the part is taken up to there, and looked at again.
                target = target if better < high else -1
                stop, corrections = better, corrections + 1
                continue
        for k in range(SUMS):
            total[k] = total[k] + room.sums[k] if k < MEANS else max(total[k], room.sums[k])
        mark = room.marks[done]
        mark[0], mark[1], mark[2], mark[3], mark[4] = place, stop, since, until, target
        done += 1
        x1, x2 = y1, y2
        instants += change(target, h, balls, room)
        if stop == 1.0:
            break
        since = _nearest(here, 1.0, reach)
        place, low, high, corrections, stop, target = stop, stop, 1.0, 0, 1.0, -1
    return x1, x2, True, instants, grazing
