"""Kernels that carry the columns of ``varied_step`` over one ball period, and sum how what it shows changes by them.

Beside an instant at which a ball meets or leaves its contact the damping force sets in with a jump and like a root,
whose slope is infinite there. A stretch that is graded towards an instant is therefore looked at from the instant: its
times are shifted with it, so that the gap, and with it the root, keeps its place. The shifted column of a parameter is
its own plus what the shift of the instant makes of the column of a shift in time, which begins as the rate of the
state; both are carried as they are, and what the endpoint itself would add has no weight. Where the force jumps, what
is before and after the instant gains and loses the time by which it moves.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from models.platform.jit import inlined, kernel
from models.solve.six_dof.kernels.instants import change, fill_gaps, retake
from models.solve.six_dof.kernels.orbit import STATE_SCALE
from models.solve.six_dof.kernels.parts import SUMS, Room, cell_at, fill_node, hold_closed, make_room, stretch
from models.solve.six_dof.kernels.period import REACH, flow_row
from models.solve.six_dof.kernels.step import (
    P_ALPHA,
    P_BETA,
    P_CLEARANCE,
    P_INV_M,
    P_INV_M_I,
    P_INV_M_O,
    P_K_C,
    P_OMEGA,
    P_SHARE_R,
    P_TURN,
    P_U_1,
    P_U_2,
    Balls,
    forces,
    propagators,
    rate_of,
    step,
)
from models.solve.six_dof.kernels.varied_step import (
    MIDDLE,
    Columns,
    Varied,
    fill_carry,
    make_columns,
    note_stage,
    put,
    sensed,
    varied_step,
)
from models.solve.six_dof.kernels.varied_sums import Shown, StepPlace, add_end, add_row, phase_at, turned_by

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.platform.jit import Index
    from models.solve.six_dof.kernels.period import Period, PeriodTrace
    from models.solve.six_dof.kernels.step import Axis, Flow

    Values = NDArray[np.float64]


class Carrying(NamedTuple):
    """What a period is carried with.

    Attributes:
        bounds, varied, shown: those of ``varied_period``.
        room, total: of a step that is taken in parts (models.solve.six_dof.kernels.instants.retake).
        spare: shifts of instants, what a value at a place counts, and rates of a state, one a row.
    """

    period: Period
    bounds: Values
    varied: Varied
    columns: Columns
    shown: Shown
    room: Room
    total: Values
    spare: Values


@inlined
def _normal(j: Index, balls: Balls, c: float, s: float) -> tuple[float, float]:
    """Return the direction of element j in the resting frame; ``c`` and ``s``: of the cage angle."""
    many = balls.moved.shape[1]
    m1 = balls.moved[0, j] if j < many else balls.plain[0, j - many]
    m2 = balls.moved[1, j] if j < many else balls.plain[1, j - many]
    return c * m1 - s * m2, s * m1 + c * m2


@kernel
def _fill_varied(place: float, node: Index, h: float, where: StepPlace, n: Index, work: Carrying) -> None:
    """Write how what is known beforehand changes at a place of step ``n``, as ``models...parts.path_within`` does."""
    period, room, varied, columns = work.period, work.room, work.varied, work.columns
    last, half, s = varied.start.shape[0] - 1, 0.5 * h, 2.0 * place - 1.0
    for m in range(last):
        columns.angle[node, m] = turned_by(place, where, varied, m) + varied.start[m]
    columns.angle[node, last] = period.parameter[P_OMEGA]
    tables = varied.depth.shape[0]
    for m in range(last + 1):
        q = varied.table[m]
        if q < 0:
            continue
        longer = columns.width[m]
        for j in range(columns.depth.shape[2]):
            d0, d1, d2 = period.nodes.depth[n, 0, j], period.nodes.depth[n, 1, j], period.nodes.depth[n, 2, j]
            r0, r1, r2 = (
                half * period.nodes.rate[n, 0, j],
                half * period.nodes.rate[n, 1, j],
                half * period.nodes.rate[n, 2, j],
            )
            if q < tables:
                d0, d1, d2 = varied.depth[q, n, 0, j], varied.depth[q, n, 1, j], varied.depth[q, n, 2, j]
                r0 = half * varied.rate[q, n, 0, j] + longer * r0
                r1 = half * varied.rate[q, n, 1, j] + longer * r1
                r2 = half * varied.rate[q, n, 2, j] + longer * r2
            even, odd = 0.5 * (d2 + d0) - d1, 0.5 * (d2 - d0) - r1
            even_slope, odd_slope = 0.5 * (r2 - r0), 0.5 * (r2 + r0) - r1
            a4, a5 = 0.5 * even_slope - even, 0.5 * (odd_slope - 3.0 * odd)
            a2, a3 = even - a4, odd - a5
            slope = (r1 + s * (2.0 * a2 + s * (3.0 * a3 + s * (4.0 * a4 + s * 5.0 * a5)))) / half
            if q < tables:
                columns.depth[q, node, j] = d1 + s * (r1 + s * (a2 + s * (a3 + s * (a4 + s * a5))))
                columns.rate[q, node, j] = slope - longer * room.within.rate[0, node, j]
            else:
                columns.depth[q, node, j] = room.within.rate[0, node, j]
                columns.rate[q, node, j] = (2.0 * a2 + s * (6.0 * a3 + s * (12.0 * a4 + s * 20.0 * a5))) / (half * half)


@kernel
def _fill_gap_changes(j: Index, x1: Axis, x2: Axis, node: Index, work: Carrying, out: Values) -> None:
    """Write the change of the gap of element j at a node by each column, (C + 1,)."""
    period, room, varied, columns = work.period, work.room, work.varied, work.columns
    p, balls, within, share = period.parameter, period.balls, room.within, period.parameter[P_SHARE_R]
    many = balls.moved.shape[1]
    n1, n2 = _normal(j, balls, within.turn[0, node, 0], within.turn[0, node, 1])
    u1, u2 = p[P_U_1] + x1[0] - x1[2] - share * x1[4], p[P_U_2] + x2[0] - x2[2] - share * x2[4]
    d = varied.parameter
    for k in range(out.shape[0]):
        t = columns.at[k]
        gap = n1 * (t[0] - t[2] - share * t[4]) + n2 * (t[6] - t[8] - share * t[10])
        if k >= 12:
            m = k - 12
            gap += n1 * (d[P_U_1, m] - d[P_SHARE_R, m] * x1[4]) + n2 * (d[P_U_2, m] - d[P_SHARE_R, m] * x2[4])
            gap += columns.angle[node, m] * (u2 * n1 - u1 * n2) - d[P_CLEARANCE, m]
            if varied.table[m] >= 0 and j < many:
                gap -= columns.depth[varied.table[m], node, j]
        out[k] = gap


@inlined
def _nearest(gaps: Values, on: NDArray[np.bool_], sign: float) -> int:
    """Return the element in contact that met it last, or with ``sign`` -1 leaves it first; -1 where there is none."""
    found, element = math.inf, -1
    for j in range(gaps.shape[1]):
        rate = sign * gaps[1, j]
        if on[j] and rate > 0.0 and gaps[0, j] < found * rate:
            found, element = gaps[0, j] / rate, j
    return element


@kernel
def _fill_shift(sign: float, x1: Axis, x2: Axis, node: Index, work: Carrying, out: Values) -> None:
    """Write by how much the instant beside a graded stretch is later by each column, s, (C + 1,)."""
    period, room = work.period, work.room
    fill_gaps(x1, x2, period.parameter, period.balls, room.within, np.int64(0), node, room.there)
    j = _nearest(room.there, room.on, sign)
    if j < 0:
        out[:] = 0.0
        return
    _fill_gap_changes(np.int64(j), x1, x2, node, work, out)
    rate = out[out.shape[0] - 1]
    for k in range(out.shape[0]):
        out[k] = -out[k] / rate if rate != 0.0 else 0.0


@kernel
def _begin_stretch(
    x1: Axis, x2: Axis, place: float, falls: bool, h: float, where: StepPlace, n: Index, work: Carrying
) -> None:
    """Begin the column of a shift in time where a graded stretch begins, and where it is not after one, find it."""
    bounds, period, room, varied, columns, shown, spare = (
        work.bounds,
        work.period,
        work.room,
        work.varied,
        work.columns,
        work.shown,
        work.spare,
    )
    p, within, last, zero = period.parameter, room.within, varied.start.shape[0] - 1, np.int64(0)
    fill_node(place, zero, h, p[P_OMEGA], period.nodes, n, within)
    _fill_varied(place, zero, h, where, n, work)
    f1, f2 = note_stage(x1, x2, p, room.balls, within, zero, zero, zero, varied, columns, last + 1, True)
    put(rate_of(x1, f1, p), rate_of(x2, f2, p), columns.at, np.int64(12 + last))
    shown.change[12 + last] = 0.0
    force, lightness = sensed(x1, x2, f1, f2, p, np.int64(shown.sensor))
    boundary = spare[1, : shown.value.shape[0]]
    boundary[:] = 0.0
    add_end(phase_at(place, where, bounds), force * lightness, 1.0, p, shown, bounds[-1] / p[P_OMEGA], boundary)
    if not falls:
        _fill_shift(1.0, x1, x2, zero, work, spare[0, : 13 + last])


@kernel
def _end_stretch(x1: Axis, x2: Axis, place: float, falls: bool, where: StepPlace, work: Carrying) -> None:
    """Add to each column what the shift of its instant makes of a stretch that ends."""
    bounds, period, room, varied, columns, shown, spare = (
        work.bounds,
        work.period,
        work.room,
        work.varied,
        work.columns,
        work.shown,
        work.spare,
    )
    p, last, two, boundary = period.parameter, varied.start.shape[0] - 1, np.int64(2), spare[1, : shown.value.shape[0]]
    shift, rate = spare[0, : 13 + last], spare[2, :12]
    if falls:
        _fill_shift(-1.0, x1, x2, two, work, shift)
    f1, f2 = note_stage(x1, x2, p, room.balls, room.within, np.int64(0), two, np.int64(3), varied, columns, last, True)
    force, lightness = sensed(x1, x2, f1, f2, p, np.int64(shown.sensor))
    add_end(phase_at(place, where, bounds), force * lightness, -1.0, p, shown, bounds[-1] / p[P_OMEGA], boundary)
    r1, r2 = rate_of(x1, f1, p), rate_of(x2, f2, p)
    for i in range(6):
        rate[i], rate[6 + i] = r1[i], r2[i]
    for k in range(12 + last):
        for i in range(12):
            columns.at[k, i] += shift[k] * (columns.at[12 + last, i] - rate[i])
        for i in range(boundary.shape[0]):
            shown.change[k, i] += shift[k] * (shown.change[12 + last, i] + boundary[i])


@kernel
def _varied_part(
    x1: Axis,
    x2: Axis,
    ends: tuple[float, float],
    since: float,
    until: float,
    h: float,
    reach: float,
    where: StepPlace,
    n: Index,
    work: Carrying,
) -> tuple[Axis, Axis]:
    """Carry axes and columns over a part of a step as ``models.solve.six_dof.kernels.parts.advance`` does."""
    bounds, period, room, varied, columns, shown = (
        work.bounds,
        work.period,
        work.room,
        work.varied,
        work.columns,
        work.shown,
    )
    p, within, balls, last = period.parameter, room.within, room.balls, varied.start.shape[0] - 1
    graded, duration = since < reach or until < reach, bounds[-1] / p[P_OMEGA]
    halves, zero = (2 if since < reach and until < reach else 1), np.int64(0)
    count, span = last + 1 if graded else last, (ends[1] - ends[0]) * h / halves
    for half in range(halves):
        falls = graded and not (since < reach and half == 0)
        offset = (until if falls else since) if graded else 0.0
        begin = ends[0] * h + half * span
        grade, cells, least, most = stretch(graded, offset, span, reach, h, balls.power != 0.5)
        width = (most - least) / cells
        if graded:
            _begin_stretch(x1, x2, begin / h, falls, h, where, n, work)
        for cell in range(cells):
            (t0, tm, t1), weight = cell_at(cell, falls, grade, width, least, most, begin, span, offset)
            for node in range(3):
                place = (t0 if node == 0 else tm if node == 1 else t1) / h
                fill_node(place, np.int64(node), h, p[P_OMEGA], period.nodes, n, within)
                _fill_varied(place, np.int64(node), h, where, n, work)
            e, f = propagators(p, 2.0 * (tm - t0)), propagators(p, 2.0 * (t1 - tm))
            fill_carry(p, tm - t0, e, varied, columns.width, columns.carry[0])
            fill_carry(p, t1 - tm, f, varied, columns.width, columns.carry[1])
            note_stage(x1, x2, p, balls, within, zero, zero, zero, varied, columns, count, True)
            add_row(
                weight[0] / 6.0 / duration,
                t0 / h,
                where,
                x1,
                x2,
                columns.at,
                p,
                zero,
                bounds,
                varied,
                columns,
                shown,
                graded,
            )
            y1, y2, u1, u2, z1, z2 = varied_step(
                x1, x2, weight, e, f, tm - t1, p, balls, within, zero, varied, columns, count, True
            )
            add_row(
                *(weight[2] / 6.0 / duration, t1 / h, where, u1, u2, columns.last, p, np.int64(3)),
                *(bounds, varied, columns, shown, graded),
            )
            note_stage(z1, z2, p, balls, within, zero, np.int64(1), np.int64(MIDDLE), varied, columns, count, True)
            add_row(
                *(weight[1] / 1.5 / duration, tm / h, where, z1, z2, columns.middle, p, np.int64(MIDDLE)),
                *(bounds, varied, columns, shown, graded),
            )
            x1, x2 = y1, y2
        if graded:
            _end_stretch(x1, x2, (begin + span) / h, falls, where, work)
    return x1, x2


@kernel
def _pass_instant(x1: Axis, x2: Axis, target: Index, place: float, h: float, where: StepPlace, work: Carrying) -> None:
    """Change the contacts at the end of a part, and the columns by the jump of the force there."""
    bounds, period, room, varied, columns, shown, spare = (
        work.bounds,
        work.period,
        work.room,
        work.varied,
        work.columns,
        work.shown,
        work.spare,
    )
    p, balls, two = period.parameter, period.balls, np.int64(2)
    last, many, duration = varied.start.shape[0] - 1, balls.moved.shape[1], bounds[-1] / p[P_OMEGA]
    share, sensor, later = p[P_SHARE_R], np.int64(shown.sensor), spare[0, : 12 + last]
    fill_gaps(x1, x2, p, balls, room.within, np.int64(0), two, room.there)
    f1, f2 = note_stage(x1, x2, p, room.balls, room.within, np.int64(0), two, np.int64(3), varied, columns, last, True)
    before = room.on.copy()
    change(target, h, balls, room)
    u1, u2 = p[P_U_1] + x1[0] - x1[2] - share * x1[4], p[P_U_2] + x2[0] - x2[2] - share * x2[4]
    w1 = x1[1] - x1[3] - share * x1[5] + p[P_TURN] * u2
    w2 = x2[1] - x2[3] - share * x2[5] - p[P_TURN] * u1
    c, s = room.within.turn[0, 2, 0], room.within.turn[0, 2, 1]
    for j in range(before.shape[0]):
        rate = room.there[1, j]
        if before[j] == room.on[j] or rate == 0.0:
            continue
        n1, n2 = _normal(np.int64(j), balls, c, s)
        speed = w1 * n1 + w2 * n2 - (room.within.rate[0, 2, j] if j < many else 0.0)
        # What is left of the gap, within the tolerance of the instant, has a root that is not small.
        pressed = max(room.there[0, j], 0.0)
        root = math.sqrt(pressed) if balls.power == 0.5 else pressed**balls.power
        jump = p[P_K_C] * pressed * root + (p[P_ALPHA] + p[P_BETA] * root) * speed
        jump *= 1.0 if room.on[j] else -1.0
        _fill_gap_changes(np.int64(j), x1, x2, two, work, later)
        force, lightness = sensed(x1, x2, f1, f2, p, sensor)
        f1, f2 = f1 + jump * n1, f2 + jump * n2
        force_after, _ = sensed(x1, x2, f1, f2, p, sensor)
        boundary = spare[1, : shown.value.shape[0]]
        boundary[:] = 0.0
        add_end(phase_at(place, where, bounds), force * lightness, 1.0, p, shown, duration, boundary)
        add_end(phase_at(place, where, bounds), force_after * lightness, -1.0, p, shown, duration, boundary)
        for k in range(12 + last):
            moved = -later[k] / rate
            for axis in range(2):
                push = jump * (n1 if axis == 0 else n2) * moved
                columns.at[k, 6 * axis + 1] += push * p[P_INV_M_I]
                columns.at[k, 6 * axis + 3] -= push * p[P_INV_M]
                columns.at[k, 6 * axis + 5] -= push * p[P_INV_M_O]
            for i in range(boundary.shape[0]):
                shown.change[k, i] += moved * boundary[i]


@kernel
def _varied_retaken(
    x1: Axis, x2: Axis, h: float, e: Flow, reach: float, where: StepPlace, n: Index, work: Carrying
) -> tuple[Axis, Axis]:
    """Carry axes and columns over a step that is taken in parts."""
    period, room = work.period, work.room
    p, balls, nodes, zero = period.parameter, period.balls, period.nodes, np.int64(0)
    y1, y2, _, _, _, _ = step(x1, x2, h, e, p, forces, (balls, nodes), n, reach)
    retake(x1, x2, y1, y2, h, reach, True, p, balls, nodes, n, room, work.total)
    marks = room.marks.copy()
    fill_node(0.0, zero, h, p[P_OMEGA], nodes, n, room.within)
    fill_gaps(x1, x2, p, balls, nodes, n, zero, room.here)
    hold_closed(balls, room)
    for part in range(marks.shape[0]):
        mark = marks[part]
        x1, x2 = _varied_part(x1, x2, (mark[0], mark[1]), mark[2], mark[3], h, reach, where, n, work)
        _pass_instant(x1, x2, np.int64(mark[4]), mark[1], h, where, work)
        if mark[1] == 1.0:
            break
    return x1, x2


@kernel
def _varied_run(
    x1: Axis, x2: Axis, h: float, e: Flow, segment: int, n: int, trace: PeriodTrace, work: Carrying
) -> tuple[Axis, Axis, int]:
    """Carry axes and columns over steps from n on, up to the end of the segment or to one in parts, and return it."""
    bounds, period, varied, columns, shown = work.bounds, work.period, work.varied, work.columns, work.shown
    p, balls, nodes, first, zero = period.parameter, period.balls, period.nodes, period.first, np.int64(0)
    last, steps, two, three = varied.start.shape[0] - 1, first[segment + 1] - first[segment], np.int64(2), np.int64(3)
    fill_carry(p, 0.5 * h, e, varied, columns.width, columns.carry[0])
    columns.carry[1] = columns.carry[0]
    while n < first[segment + 1] and not trace.changed[n]:
        where = StepPlace(segment, (n - first[segment]) / steps, 1.0 / steps, bounds[-1])
        for node in range(3):
            for m in range(last):
                columns.angle[node, m] = turned_by(0.5 * node, where, varied, m) + varied.start[m]
        for q in range(varied.depth.shape[0]):
            columns.depth[q] = varied.depth[q, n]
            columns.rate[q] = varied.rate[q, n]
        note_stage(x1, x2, p, balls, nodes, n, zero, zero, varied, columns, last, False)
        weight = trace.weight[n + segment]
        add_row(weight, 0.0, where, x1, x2, columns.at, p, zero, bounds, varied, columns, shown, False)
        x1, x2, _, _, _, _ = varied_step(x1, x2, (h, h, h), e, e, 0.0, p, balls, nodes, n, varied, columns, last, False)
        n += 1
        if n == first[segment + 1] or trace.changed[n]:
            note_stage(x1, x2, p, balls, nodes, n - 1, two, three, varied, columns, last, False)
            weight = trace.weight[n + segment]
            add_row(weight, 1.0, where, x1, x2, columns.at, p, three, bounds, varied, columns, shown, False)
    return x1, x2, n


@kernel
def varied_period(
    state: Values, trace: PeriodTrace, period: Period, bounds: Values, varied: Varied, shown: Shown
) -> tuple[Values, Values]:
    """Return the state after a period, (12,), and the columns there, (C, 12), those by the state in its scale.

    Args:
        state: at the start, (2, 6).
        trace: that ``ball_period`` recorded from there.
        bounds: cage angles at which segments begin and end, rad.
        varied: how the period changes.
        shown: what is wanted; its sums are written.
    """
    p, balls, nodes, first, flow = period.parameter, period.balls, period.nodes, period.first, period.flow
    columns, last = make_columns(varied, balls.moved.shape[1]), varied.start.shape[0] - 1
    spare = np.zeros((3, max(14 + last, shown.value.shape[0])))
    work = Carrying(period, bounds, varied, columns, shown, make_room(balls, nodes), np.zeros(SUMS), spare)
    shown.value[:] = 0.0
    shown.change[:] = 0.0
    x1 = (state[0, 0], state[0, 1], state[0, 2], state[0, 3], state[0, 4], state[0, 5])
    x2 = (state[1, 0], state[1, 1], state[1, 2], state[1, 3], state[1, 4], state[1, 5])
    for i in range(12):
        columns.at[i, i] = STATE_SCALE[i % 6]
    for segment in range(first.shape[0] - 1):
        h, e = flow[segment, 0], flow_row(flow, segment, 1)
        reach, steps = max(h, REACH * period.time[-1]), first[segment + 1] - first[segment]
        wide = bounds[segment + 1] - bounds[segment]
        for m in range(last):
            longer = (varied.bounds[segment + 1, m] - varied.bounds[segment, m]) / wide
            columns.width[m] = longer - varied.parameter[P_OMEGA, m] / p[P_OMEGA]
        n = first[segment]
        while n < first[segment + 1]:
            if trace.changed[n]:
                where = StepPlace(segment, (n - first[segment]) / steps, 1.0 / steps, bounds[-1])
                x1, x2 = _varied_retaken(x1, x2, h, e, reach, where, n, work)
                n += 1
            else:
                x1, x2, n = _varied_run(x1, x2, h, e, segment, n, trace, work)
    after = np.empty(12)
    for i in range(6):
        after[i], after[6 + i] = x1[i], x2[i]
    return after, columns.at[: 12 + last].copy()
