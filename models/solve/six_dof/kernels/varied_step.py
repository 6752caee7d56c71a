"""Kernels of one step of the six-degree-of-freedom model and of how it changes: by its state and by parameters.

A column is the derivative of the state: twelve by the state at the start of the period, one by each parameter at a
fixed place of the period (a share of a segment), and one more by a shift in time, for which see ``varied_period``. Each
operation of the step (models.solve.six_dof.kernels.step.stages) is differentiated as it is taken, so that the columns
are those of the motion on its grid, exact to rounding.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from models.platform.jit import inlined, kernel
from models.solve.six_dof.kernels.parts import in_the_middle
from models.solve.six_dof.kernels.step import (
    P_ALPHA,
    P_BETA,
    P_C_R,
    P_CLEARANCE,
    P_DAMPING_I,
    P_DAMPING_R,
    P_DIRECTION_1,
    P_DIRECTION_2,
    P_INV_M,
    P_INV_M_I,
    P_INV_M_O,
    P_INV_M_R,
    P_K_C,
    P_K_R,
    P_LOAD_1,
    P_LOAD_2,
    P_SHARE_R,
    P_SQUARE_I,
    P_SQUARE_R,
    P_TURN,
    P_U_1,
    P_U_2,
    Balls,
    StepNodes,
    kick,
    oscillator,
    propagate,
    stages,
)
from models.solve.six_dof.kernels.tangent import linear_forces

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.platform.jit import Index
    from models.solve.six_dof.kernels.step import Axis, Flow

    Values = NDArray[np.float64]

# Stages whose forces are noted: the four of a step, and that of the state in its middle.
STAGES = 5
MIDDLE = 4
# Relative size of the differences of the closed form of an oscillator.
_SIZE = 1e-6
# An approach below this is none: what its root changes has no weight there, m.
_TOUCHING = 1e-24


class Varied(NamedTuple):
    """How what a period is made of changes by each of N parameters; the last of N + 1 columns is zero.

    Attributes:
        parameter: by the P_ constants, (PARAMETERS, N + 1).
        bounds: cage angles at which segments begin and end, rad, (segments + 1, N + 1).
        presses: whether the contact force changes at a fixed state, (N + 1,).
        seen: whether the acceleration changes at a fixed state and force, (N + 1,).
        carries: whether what carries a step or what a force moves changes, (N + 1,).
        start: angle of all balls at the start of the period against everything else, rad, (N + 1,).
        table: row of ``depth`` and ``rate``, int64, (N + 1,); -1 where neither changes, Q in the last column.
        depth, rate: of the moved balls at the nodes (``StepNodes``), (Q, steps, 3, D).
    """

    parameter: Values
    presses: NDArray[np.bool_]
    seen: NDArray[np.bool_]
    carries: NDArray[np.bool_]
    bounds: Values
    start: Values
    table: NDArray[np.int64]
    depth: Values
    rate: Values


class Columns(NamedTuple):
    """The columns and what is noted of a step; C = 12 + N, and one more for the shift in time.

    Attributes:
        at: the columns, first and second axis, (C + 1, 12).
        middle, last: in the middle of a step, and at its last stage, (C + 1, 12).
        slopes: of the contact force at each stage by displacements (4) and velocities (4), (STAGES, 8).
        forced: change of the contact force at each stage by a column's parameter at a fixed state, (STAGES, 2, C + 1).
        force: contact force at each stage, N, (STAGES, 2).
        angle: change of the cage angle at the nodes, (3, N + 1).
        depth, rate: change of the path at the nodes, (Q + 1, 3, D).
        width: relative change of the length of the step, (N + 1,).
        carry: change of what carries the first part of the step and the second, (2, N + 1, 9).
        moved: what a moved ball adds to the force by its depth (2) and its rate (2), (4, D).
    """

    at: Values
    middle: Values
    last: Values
    slopes: Values
    forced: Values
    force: Values
    angle: Values
    depth: Values
    rate: Values
    width: Values
    carry: Values
    moved: Values


@kernel
def make_columns(varied: Varied, moved: int) -> Columns:
    """Return room for the columns, with ``moved`` balls whose path is not level."""
    forced, tables = varied.start.shape[0], varied.depth.shape[0]
    count = 12 + forced
    return Columns(
        np.zeros((count, 12)),
        np.zeros((count, 12)),
        np.zeros((count, 12)),
        np.zeros((STAGES, 8)),
        np.zeros((STAGES, 2, count)),
        np.zeros((STAGES, 2)),
        np.zeros((3, forced)),
        np.zeros((tables + 1, 3, moved)),
        np.zeros((tables + 1, 3, moved)),
        np.zeros(forced),
        np.zeros((2, forced, 9)),
        np.zeros((4, moved)),
    )


@kernel
def note_stage(
    x1: Axis,
    x2: Axis,
    p: Values,
    balls: Balls,
    nodes: StepNodes,
    n: Index,
    node: Index,
    stage: Index,
    varied: Varied,
    columns: Columns,
    count: int,
    held: bool,
) -> tuple[float, float]:
    """Return the contact force at a stage, N, and note it, its slopes and its change by ``count`` parameters.

    With ``held`` the balls that have a direction are in contact, also at an instant where rounding leaves them a gap.
    """
    moved, plain, depth, rate = balls.moved, balls.plain, nodes.depth, nodes.rate
    clearance, k_c, alpha, beta, power = p[P_CLEARANCE], p[P_K_C], p[P_ALPHA], p[P_BETA], balls.power
    share, omega = p[P_SHARE_R], p[P_TURN]
    c, s = nodes.turn[n, node, 0], nodes.turn[n, node, 1]
    u1, u2 = p[P_U_1] + x1[0] - x1[2] - share * x1[4], p[P_U_2] + x2[0] - x2[2] - share * x2[4]
    w1, w2 = x1[1] - x1[3] - share * x1[5] + omega * u2, x2[1] - x2[3] - share * x2[5] - omega * u1
    k11, k22, k12, c11, c22, c12, f1, f2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    # Sums over the balls: of what k_c, alpha and beta are multiplied by, of the stiffness, and by the cage angle.
    e1, e2, v1, v2, r1, r2, s1, s2, t1, t2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    many = moved.shape[1]
    for j in range(many + plain.shape[1]):
        m1 = moved[0, j] if j < many else plain[0, j - many]
        m2 = moved[1, j] if j < many else plain[1, j - many]
        n1, n2 = c * m1 - s * m2, s * m1 + c * m2
        delta = u1 * n1 + u2 * n2 - clearance - (depth[n, node, j] if j < many else 0.0)
        if j < many:
            columns.moved[0, j] = columns.moved[1, j] = columns.moved[2, j] = columns.moved[3, j] = 0.0
        if delta > 0.0 or (held and m1 * m1 + m2 * m2 > 0.5):
            delta = max(delta, 0.0)
            root = math.sqrt(delta) if power == 0.5 else delta**power
            speed = w1 * n1 + w2 * n2 - (rate[n, node, j] if j < many else 0.0)
            steep = power * root / delta if delta > _TOUCHING else 0.0
            stiffness, damping = (1.0 + power) * k_c * root + beta * steep * speed, alpha + beta * root
            force = k_c * delta * root + damping * speed
            k11 += stiffness * n1 * n1
            k22 += stiffness * n2 * n2
            k12 += stiffness * n1 * n2
            c11 += damping * n1 * n1
            c22 += damping * n2 * n2
            c12 += damping * n1 * n2
            f1 += force * n1
            f2 += force * n2
            e1 += delta * root * n1
            e2 += delta * root * n2
            v1 += speed * n1
            v2 += speed * n2
            r1 += root * speed * n1
            r2 += root * speed * n2
            s1 += stiffness * n1
            s2 += stiffness * n2
            turned = stiffness * (u2 * n1 - u1 * n2) + damping * (w2 * n1 - w1 * n2)
            t1 += turned * n1 - force * n2
            t2 += turned * n2 + force * n1
            if j < many:
                columns.moved[0, j], columns.moved[1, j] = stiffness * n1, stiffness * n2
                columns.moved[2, j], columns.moved[3, j] = damping * n1, damping * n2
    slopes, forced, d = columns.slopes[stage], columns.forced[stage], varied.parameter
    # The speed of approach contains the turn of the cage (Eq. 36).
    slopes[0], slopes[1], slopes[2], slopes[3] = (
        k11 - omega * c12,
        k12 + omega * c11,
        k12 - omega * c22,
        k22 + omega * c12,
    )
    slopes[4], slopes[5], slopes[6], slopes[7] = c11, c12, c12, c22
    for m in range(count):
        if not varied.presses[m]:
            continue
        d1, d2 = d[P_U_1, m] - d[P_SHARE_R, m] * x1[4], d[P_U_2, m] - d[P_SHARE_R, m] * x2[4]
        q1, q2 = d[P_TURN, m] * u2 - d[P_SHARE_R, m] * x1[5], -d[P_TURN, m] * u1 - d[P_SHARE_R, m] * x2[5]
        turn, stiffer, alphas, betas, wider = (
            columns.angle[node, m],
            d[P_K_C, m],
            d[P_ALPHA, m],
            d[P_BETA, m],
            d[P_CLEARANCE, m],
        )
        g1 = slopes[0] * d1 + slopes[1] * d2 + c11 * q1 + c12 * q2 + turn * t1 - d[P_LOAD_1, m]
        g2 = slopes[2] * d1 + slopes[3] * d2 + c12 * q1 + c22 * q2 + turn * t2 - d[P_LOAD_2, m]
        g1 += stiffer * e1 + alphas * v1 + betas * r1 - wider * s1
        g2 += stiffer * e2 + alphas * v2 + betas * r2 - wider * s2
        row = varied.table[m]
        if row >= 0:
            for j in range(many):
                g1 -= (
                    columns.moved[0, j] * columns.depth[row, node, j] + columns.moved[2, j] * columns.rate[row, node, j]
                )
                g2 -= (
                    columns.moved[1, j] * columns.depth[row, node, j] + columns.moved[3, j] * columns.rate[row, node, j]
                )
        forced[0, 12 + m], forced[1, 12 + m] = g1, g2
    f1, f2 = f1 - p[P_LOAD_1], f2 - p[P_LOAD_2]
    columns.force[stage, 0], columns.force[stage, 1] = f1, f2
    return f1, f2


@inlined
def _slope(square: float, damping: float, h: float, i: Index) -> tuple[float, float, float, float]:
    """Return the derivative of an oscillator's propagator by its square (0) or its damping (1)."""
    size = _SIZE * square if i == 0 else _SIZE * (damping + math.sqrt(square))
    by_square, by_damping = (size, 0.0) if i == 0 else (0.0, size)
    a = oscillator(square + by_square, damping + by_damping, h)
    b = oscillator(square - by_square, damping - by_damping, h)
    return (
        0.5 * (a[0] - b[0]) / size,
        0.5 * (a[1] - b[1]) / size,
        0.5 * (a[2] - b[2]) / size,
        0.5 * (a[3] - b[3]) / size,
    )


@kernel
def fill_carry(p: Values, h: float, e: Flow, varied: Varied, width: Values, out: Values) -> None:
    """Write how ``e``, which carries ``h`` s, changes by each parameter, (N + 1, 9)."""
    sq_i, c_i, sq_r, c_r = p[P_SQUARE_I], p[P_DAMPING_I], p[P_SQUARE_R], p[P_DAMPING_R]
    i_0, i_1 = _slope(sq_i, c_i, h, np.int64(0)), _slope(sq_i, c_i, h, np.int64(1))
    r_0, r_1 = _slope(sq_r, c_r, h, np.int64(0)), _slope(sq_r, c_r, h, np.int64(1))
    i_h = (e[2], e[3], -sq_i * e[0] - c_i * e[2], -sq_i * e[1] - c_i * e[3])
    r_h = (e[7], e[8], -sq_r * e[5] - c_r * e[7], -sq_r * e[6] - c_r * e[8])
    d = varied.parameter
    for m in range(out.shape[0]):
        longer = h * width[m]
        for k in range(4):
            out[m, k] = i_0[k] * d[P_SQUARE_I, m] + i_1[k] * d[P_DAMPING_I, m] + i_h[k] * longer
            out[m, 5 + k] = r_0[k] * d[P_SQUARE_R, m] + r_1[k] * d[P_DAMPING_R, m] + r_h[k] * longer
        out[m, 4] = longer


@inlined
def _axis(values: Values, row: Index, first: Index) -> Axis:
    return (
        values[row, first],
        values[row, first + 1],
        values[row, first + 2],
        values[row, first + 3],
        values[row, first + 4],
        values[row, first + 5],
    )


@inlined
def put(x1: Axis, x2: Axis, values: Values, row: Index) -> None:
    """Write both axes to a row."""
    for i in range(6):
        values[row, i], values[row, 6 + i] = x1[i], x2[i]


@inlined
def pair_of(values: Values, row: Index) -> tuple[Axis, Axis]:
    """Return both axes of a row."""
    return _axis(values, row, np.int64(0)), _axis(values, row, np.int64(6))


@inlined
def _carried(t: Axis, e: Flow, x: Axis, d: Values) -> Axis:
    """Return the change of ``propagate``: of a change of ``x``, and by a change of ``e``."""
    return (
        e[0] * t[0] + e[1] * t[1] + d[0] * x[0] + d[1] * x[1],
        e[2] * t[0] + e[3] * t[1] + d[2] * x[0] + d[3] * x[1],
        t[2] + e[4] * t[3] + d[4] * x[3],
        t[3],
        e[5] * t[4] + e[6] * t[5] + d[5] * x[4] + d[6] * x[5],
        e[7] * t[4] + e[8] * t[5] + d[7] * x[4] + d[8] * x[5],
    )


@inlined
def _kicked(t: Axis, force: float, change: float, by: float, longer: float, p: Values, d: Values, m: Index) -> Axis:
    """Return the change of ``kick`` by a force that acts for ``by`` s."""
    push, more = by * force, by * (change + longer * force)
    return (
        t[0],
        t[1] - more * p[P_INV_M_I] - push * d[P_INV_M_I, m],
        t[2],
        t[3] + more * p[P_INV_M] + push * d[P_INV_M, m],
        t[4],
        t[5] + more * p[P_INV_M_O] + push * d[P_INV_M_O, m],
    )


@inlined
def _pushed(
    t1: Axis, t2: Axis, p: Values, context: tuple[Values, Values], k: Index, stage: Index, h: float
) -> tuple[float, float, float, float, float, float]:
    """Return the change of the contact force at a stage by column k, and four zeros."""
    slopes, forced = context
    f1, f2, _, _, _, _ = linear_forces(t1, t2, p, slopes, k, stage, h)
    return f1 + forced[stage, 0, k], f2 + forced[stage, 1, k], 0.0, 0.0, 0.0, 0.0


@kernel
def varied_step(
    x1: Axis,
    x2: Axis,
    weight: tuple[float, float, float],
    e: Flow,
    f: Flow,
    back: float,
    p: Values,
    balls: Balls,
    nodes: StepNodes,
    n: Index,
    varied: Varied,
    columns: Columns,
    count: int,
    held: bool,
) -> tuple[Axis, Axis, Axis, Axis, Axis, Axis]:
    """Return both axes after a step, at its last stage and in its middle, and carry the columns over it.

    ``columns.width``, ``angle``, ``depth``, ``rate`` and ``carry`` are given; what starts at stage 0 is noted before.

    Args:
        weight, e, f: see ``stages``.
        back: time from the end to the middle, s, negative.
        count: of the columns by parameters that are carried.
        held: of a part of a step: see ``note_stage``; the states in the middle are wanted.
    """
    b_i, b_m, b_o, zero = p[P_INV_M_I], p[P_INV_M], p[P_INV_M_O], np.int64(0)
    h, w, t = weight
    a1, a2 = columns.force[0, 0], columns.force[0, 1]
    y1, y2 = propagate(x1, e), propagate(x2, e)
    k1, k2 = kick(x1, 0.5 * h * a1, 0.0, b_i, b_m, b_o), kick(x2, 0.5 * h * a2, 0.0, b_i, b_m, b_o)
    l1, l2 = kick(x1, h / 6.0 * a1, 0.0, b_i, b_m, b_o), kick(x2, h / 6.0 * a2, 0.0, b_i, b_m, b_o)
    m1, m2 = kick(x1, h * 5.0 / 24.0 * a1, 0.0, b_i, b_m, b_o), kick(x2, h * 5.0 / 24.0 * a2, 0.0, b_i, b_m, b_o)
    z1, z2 = propagate(k1, e), propagate(k2, e)
    b1, b2 = note_stage(z1, z2, p, balls, nodes, n, np.int64(1), np.int64(1), varied, columns, count, held)
    z1, z2 = kick(y1, 0.5 * w * b1, 0.0, b_i, b_m, b_o), kick(y2, 0.5 * w * b2, 0.0, b_i, b_m, b_o)
    c1, c2 = note_stage(z1, z2, p, balls, nodes, n, np.int64(1), np.int64(2), varied, columns, count, held)
    n1, n2 = kick(y1, w * c1, 0.0, b_i, b_m, b_o), kick(y2, w * c2, 0.0, b_i, b_m, b_o)
    z1, z2 = propagate(n1, f), propagate(n2, f)
    g1, g2 = note_stage(z1, z2, p, balls, nodes, n, np.int64(2), np.int64(3), varied, columns, count, held)
    o1, o2 = propagate(l1, e), propagate(l2, e)
    o1 = kick(o1, w / 3.0 * (b1 + c1), 0.0, b_i, b_m, b_o)
    o2 = kick(o2, w / 3.0 * (b2 + c2), 0.0, b_i, b_m, b_o)
    r1, r2 = propagate(o1, f), propagate(o2, f)
    r1, r2 = kick(r1, t / 6.0 * g1, 0.0, b_i, b_m, b_o), kick(r2, t / 6.0 * g2, 0.0, b_i, b_m, b_o)
    i1, i2 = x1, x2
    if held:
        i1 = in_the_middle(x1, p, weight, e, back, a1, b1 + c1, g1)
        i2 = in_the_middle(x2, p, weight, e, back, a2, b2 + c2, g2)
    d, context = varied.parameter, (columns.slopes, columns.forced)
    for k in range(12 + count):
        if k >= 12 and varied.carries[k - 12]:
            continue
        t1, t2 = pair_of(columns.at, k)
        s1, s2, (da1, da2), (db1, db2), (dc1, dc2), (u1, u2, dg1, dg2), _, _ = stages(
            t1, t2, weight, e, f, p, _pushed, context, k, 0.0
        )
        put(s1, s2, columns.at, k)
        if held:
            put(u1, u2, columns.last, k)
            t1 = in_the_middle(t1, p, weight, e, back, da1, db1 + dc1, dg1)
            t2 = in_the_middle(t2, p, weight, e, back, da2, db2 + dc2, dg2)
            put(t1, t2, columns.middle, k)
    for m in range(count):
        if not varied.carries[m]:
            continue
        q = columns.width[m]
        d_e, d_f = columns.carry[0, m], columns.carry[1, m]
        t1, t2 = pair_of(columns.at, 12 + m)
        da1, da2, _, _, _, _ = _pushed(t1, t2, p, context, 12 + m, zero, 0.0)
        v1, v2 = _carried(t1, e, x1, d_e), _carried(t2, e, x2, d_e)
        s1 = _carried(_kicked(t1, a1, da1, 0.5 * h, q, p, d, m), e, k1, d_e)
        s2 = _carried(_kicked(t2, a2, da2, 0.5 * h, q, p, d, m), e, k2, d_e)
        db1, db2, _, _, _, _ = _pushed(s1, s2, p, context, 12 + m, np.int64(1), 0.0)
        s1, s2 = _kicked(v1, b1, db1, 0.5 * w, q, p, d, m), _kicked(v2, b2, db2, 0.5 * w, q, p, d, m)
        dc1, dc2, _, _, _, _ = _pushed(s1, s2, p, context, 12 + m, np.int64(2), 0.0)
        s1 = _carried(_kicked(v1, c1, dc1, w, q, p, d, m), f, n1, d_f)
        s2 = _carried(_kicked(v2, c2, dc2, w, q, p, d, m), f, n2, d_f)
        dg1, dg2, _, _, _, _ = _pushed(s1, s2, p, context, 12 + m, np.int64(3), 0.0)
        if held:
            put(s1, s2, columns.last, 12 + m)
        s1 = _carried(_kicked(t1, a1, da1, h / 6.0, q, p, d, m), e, l1, d_e)
        s2 = _carried(_kicked(t2, a2, da2, h / 6.0, q, p, d, m), e, l2, d_e)
        s1 = _carried(_kicked(s1, b1 + c1, db1 + dc1, w / 3.0, q, p, d, m), f, o1, d_f)
        s2 = _carried(_kicked(s2, b2 + c2, db2 + dc2, w / 3.0, q, p, d, m), f, o2, d_f)
        s1, s2 = _kicked(s1, g1, dg1, t / 6.0, q, p, d, m), _kicked(s2, g2, dg2, t / 6.0, q, p, d, m)
        put(s1, s2, columns.at, 12 + m)
        if held:
            s1 = _carried(_kicked(t1, a1, da1, h * 5.0 / 24.0, q, p, d, m), e, m1, d_e)
            s2 = _carried(_kicked(t2, a2, da2, h * 5.0 / 24.0, q, p, d, m), e, m2, d_e)
            s1, s2 = (
                _kicked(s1, b1 + c1, db1 + dc1, w / 6.0, q, p, d, m),
                _kicked(s2, b2 + c2, db2 + dc2, w / 6.0, q, p, d, m),
            )
            s1 = _pulled(s1, _kicked(s1, g1, dg1, -t / 24.0, q, p, d, m), g1, -t / 24.0, back, q, p)
            s2 = _pulled(s2, _kicked(s2, g2, dg2, -t / 24.0, q, p, d, m), g2, -t / 24.0, back, q, p)
            put(s1, s2, columns.middle, 12 + m)
    return r1, r2, z1, z2, i1, i2


@inlined
def _pulled(before: Axis, after: Axis, force: float, by: float, back: float, longer: float, p: Values) -> Axis:
    """Return the change of the end of ``in_the_middle``: velocities gained by a kick act over the time ``back``."""
    push, more = by * force, back * longer
    return (
        after[0] + back * (after[1] - before[1]) - more * push * p[P_INV_M_I],
        after[1],
        after[2] + back * (after[3] - before[3]) + more * push * p[P_INV_M],
        after[3],
        after[4] + back * (after[5] - before[5]) + more * push * p[P_INV_M_O],
        after[5],
    )


@inlined
def sensed(x1: Axis, x2: Axis, f1: float, f2: float, p: Values, sensor: Index) -> tuple[float, float]:
    """Return the force on outer ring (0) or resonator (1) in the sensor's direction, N, and one over its mass."""
    d1, d2 = p[P_DIRECTION_1], p[P_DIRECTION_2]
    spring = d1 * (p[P_K_R] * x1[4] + p[P_C_R] * x1[5]) + d2 * (p[P_K_R] * x2[4] + p[P_C_R] * x2[5])
    return (d1 * f1 + d2 * f2 - spring, p[P_INV_M_O]) if sensor == 0 else (spring, p[P_INV_M_R])


@inlined
def sensed_change(
    t1: Axis,
    t2: Axis,
    x1: Axis,
    x2: Axis,
    p: Values,
    varied: Varied,
    columns: Columns,
    stage: Index,
    k: Index,
    sensor: Index,
) -> float:
    """Return the change of an acceleration at a noted stage by column k."""
    f1, f2, _, _, _, _ = _pushed(t1, t2, p, (columns.slopes, columns.forced), k, stage, 0.0)
    force, lightness = sensed(t1, t2, f1, f2, p, sensor)
    if k < 12 or not varied.seen[k - 12]:
        return force * lightness
    m, d, d1, d2 = k - 12, varied.parameter, p[P_DIRECTION_1], p[P_DIRECTION_2]
    whole, _ = sensed(x1, x2, columns.force[stage, 0], columns.force[stage, 1], p, sensor)
    pulled_1, pulled_2 = p[P_K_R] * x1[4] + p[P_C_R] * x1[5], p[P_K_R] * x2[4] + p[P_C_R] * x2[5]
    spring = d[P_DIRECTION_1, m] * pulled_1 + d[P_DIRECTION_2, m] * pulled_2
    spring += d[P_K_R, m] * (d1 * x1[4] + d2 * x2[4]) + d[P_C_R, m] * (d1 * x1[5] + d2 * x2[5])
    if sensor == 0:
        turned = d[P_DIRECTION_1, m] * columns.force[stage, 0] + d[P_DIRECTION_2, m] * columns.force[stage, 1]
        return (force + turned - spring) * lightness + whole * d[P_INV_M_O, m]
    return (force + spring) * lightness + whole * d[P_INV_M_R, m]
