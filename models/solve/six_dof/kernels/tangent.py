"""Kernel of the Jacobian of the period map: twelve tangents carried along one ball period.

A tangent obeys the same step as the state, with the contact force linearised about the state at each stage. The damping
force sets in like a square root, whose slope is infinite where a ball just touches; it is taken at ``_SOFT`` of the
static approach there at least, which leaves multipliers off by per cents in motions that lose contact: where they
decide, ``models.solve.six_dof.kernels.orbit.jacobian`` takes differences instead.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from models.platform.jit import inlined, kernel
from models.solve.six_dof.kernels.orbit import STATE_SCALE
from models.solve.six_dof.kernels.period import flow_row
from models.solve.six_dof.kernels.step import (
    P_ALPHA,
    P_BETA,
    P_CLEARANCE,
    P_K_C,
    P_SHARE_R,
    P_TURN,
    P_U_1,
    Balls,
    StepNodes,
    forces,
    node_of,
    relative_motion,
    step,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.platform.jit import Index
    from models.solve.six_dof.kernels.period import Period
    from models.solve.six_dof.kernels.step import Axis

    Context = tuple[Balls, StepNodes, NDArray[np.float64]]

_SOFT = 1e-3
# Per stage: slopes of the force with respect to displacement (4) and velocity (4).
_SLOPES = 8


@inlined
def _slopes_of(
    x1: Axis,
    x2: Axis,
    p: NDArray[np.float64],
    balls: Balls,
    exponent: float | None,
    nodes: StepNodes,
    n: Index,
    node: Index,
) -> tuple[float, float, float, float, float, float]:
    """Return what ``_slopes`` does; ``exponent`` is the power of ``Balls``, None stands for a half."""
    moved, plain, depth, rate = balls.moved, balls.plain, nodes.depth, nodes.rate
    clearance = p[P_CLEARANCE]
    k_c, alpha, beta = p[P_K_C], p[P_ALPHA], p[P_BETA]
    power = 0.5 if exponent is None else exponent
    soft = max(_SOFT * abs(p[P_U_1]), 1e-12)
    c, s = nodes.turn[n, node, 0], nodes.turn[n, node, 1]
    p1, p2, q1, q2, aligned = relative_motion(x1, x2, p, p[P_TURN], c, s)
    k11, k22, k12, c11, c22, c12 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    count = balls.near_moved if aligned else moved.shape[1]
    others = balls.near if aligned else plain.shape[1]
    for j in range(count + others):
        is_moved = j < count
        n1 = moved[0, j] if is_moved else plain[0, j - count]
        n2 = moved[1, j] if is_moved else plain[1, j - count]
        delta = p1 * n1 + p2 * n2 - clearance - (depth[n, node, j] if is_moved else 0.0)
        if delta > 0.0:
            root = delta**power
            speed = q1 * n1 + q2 * n2 - (rate[n, node, j] if is_moved else 0.0)
            stiffness = (1.0 + power) * k_c * root + beta * power * root / max(delta, soft) * speed
            damping = alpha + beta * root
            k11 += stiffness * n1 * n1
            k22 += stiffness * n2 * n2
            k12 += stiffness * n1 * n2
            c11 += damping * n1 * n1
            c22 += damping * n2 * n2
            c12 += damping * n1 * n2
    return k11, k22, k12, c11, c22, c12


@inlined
def _slopes(
    x1: Axis, x2: Axis, p: NDArray[np.float64], balls: Balls, nodes: StepNodes, n: Index, node: Index
) -> tuple[float, float, float, float, float, float]:
    """Return the slopes of the contact force with respect to displacement and speed in the frame of the cage.

    Each is a symmetric matrix: along, across, and between.
    """
    # As in ``models.solve.six_dof.kernels.step.contact``.
    if balls.power == 0.5:
        return _slopes_of(x1, x2, p, balls, None, nodes, n, node)
    return _slopes_of(x1, x2, p, balls, balls.power, nodes, n, node)


@inlined
def _noted_forces(
    x1: Axis, x2: Axis, p: NDArray[np.float64], context: Context, n: Index, stage: Index, h: float
) -> tuple[float, float, float, float, float, float]:
    """Return the forces, and write the slopes of the contact force in the resting frame to the row of the stage."""
    balls, nodes, slopes = context
    node = node_of(stage)
    a11, a22, a12, b11, b22, b12 = _slopes(x1, x2, p, balls, nodes, n, node)
    c, s, omega = nodes.turn[n, node, 0], nodes.turn[n, node, 1], p[P_TURN]
    # Turned back by the cage angle.
    k11 = c * c * a11 - 2.0 * c * s * a12 + s * s * a22
    k22 = s * s * a11 + 2.0 * c * s * a12 + c * c * a22
    k12 = c * s * (a11 - a22) + (c * c - s * s) * a12
    c11 = c * c * b11 - 2.0 * c * s * b12 + s * s * b22
    c22 = s * s * b11 + 2.0 * c * s * b12 + c * c * b22
    c12 = c * s * (b11 - b22) + (c * c - s * s) * b12
    # The speed of approach contains the turn of the cage (Eq. 36).
    slopes[stage, 0], slopes[stage, 1] = k11 - omega * c12, k12 + omega * c11
    slopes[stage, 2], slopes[stage, 3] = k12 - omega * c22, k22 + omega * c12
    slopes[stage, 4], slopes[stage, 5], slopes[stage, 6], slopes[stage, 7] = c11, c12, c12, c22
    return forces(x1, x2, p, (balls, nodes), n, stage, h)


@inlined
def linear_forces(
    x1: Axis, x2: Axis, p: NDArray[np.float64], context: NDArray[np.float64], n: Index, stage: Index, h: float
) -> tuple[float, float, float, float, float, float]:
    """Return the change of the forces by a change of the state."""
    share = p[P_SHARE_R]
    u1, u2 = x1[0] - x1[2] - share * x1[4], x2[0] - x2[2] - share * x2[4]
    v1, v2 = x1[1] - x1[3] - share * x1[5], x2[1] - x2[3] - share * x2[5]
    f1 = context[stage, 0] * u1 + context[stage, 1] * u2 + context[stage, 4] * v1 + context[stage, 5] * v2
    f2 = context[stage, 2] * u1 + context[stage, 3] * u2 + context[stage, 6] * v1 + context[stage, 7] * v2
    return f1, f2, 0.0, 0.0, 0.0, 0.0


@kernel
def tangent_jacobian(state: NDArray[np.float64], period: Period) -> tuple[NDArray[np.float64], bool]:
    """Return the Jacobian of the scaled period map at a state, shape (12, 12), and whether the rings part.

    They part where no ball is in contact at a stage of a step.
    """
    p, context = period.parameter, (period.balls, period.nodes, np.empty((4, _SLOPES)))
    slopes = context[2]
    x1 = (state[0, 0], state[0, 1], state[0, 2], state[0, 3], state[0, 4], state[0, 5])
    x2 = (state[1, 0], state[1, 1], state[1, 2], state[1, 3], state[1, 4], state[1, 5])
    t, moved, parted = np.zeros((12, 12)), np.empty((12, 12)), False
    for i in range(12):
        t[i, i] = STATE_SCALE[i % 6]
    for segment in range(period.first.shape[0] - 1):
        h, e = period.flow[segment, 0], flow_row(period.flow, segment, 1)
        for n in range(period.first[segment], period.first[segment + 1]):
            x1, x2, _, _, _, _ = step(x1, x2, h, e, p, _noted_forces, context, n, 0.0)
            for stage in range(4):
                parted = parted or slopes[stage, 4] + slopes[stage, 7] == 0.0
            for k in range(12):
                t1 = (t[0, k], t[1, k], t[2, k], t[3, k], t[4, k], t[5, k])
                t2 = (t[6, k], t[7, k], t[8, k], t[9, k], t[10, k], t[11, k])
                t1, t2, _, _, _, _ = step(t1, t2, h, e, p, linear_forces, slopes, n, 0.0)
                moved[0, k], moved[1, k], moved[2, k] = t1[0], t1[1], t1[2]
                moved[3, k], moved[4, k], moved[5, k] = t1[3], t1[4], t1[5]
                moved[6, k], moved[7, k], moved[8, k] = t2[0], t2[1], t2[2]
                moved[9, k], moved[10, k], moved[11, k] = t2[3], t2[4], t2[5]
            t, moved = moved, t
    for i in range(12):
        for k in range(12):
            t[i, k] /= STATE_SCALE[i % 6]
    return t, parted
