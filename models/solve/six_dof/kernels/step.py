"""Contact law, kick, propagator and step of the six-degree-of-freedom model, once for all of its kernels.

Conventions. Axis 1 lies along the load, axis 2 across it. The state of one axis is (y_i, v_i, s, v_s, r, v_r): inner
ring, centre of mass of outer ring and resonator, and outer ring minus resonator, each as deviation from the static
equilibrium, m and m/s. In these coordinates the linear part of Eq. 44 is three uncoupled oscillators with closed-form
propagators. States in arrays have shape (2, 6). The contact force on the right-hand side is the true one minus the
static load, so that the equilibrium is kept exactly.

Ball directions are constant in a frame that turns with the cage: only the displacement is rotated, by the cage angle.
A step knows its three nodes (beginning, middle, end) beforehand; ``Balls`` and ``StepNodes`` hold them.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from models.platform.jit import inlined

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from models.platform.jit import Index

    Axis = tuple[float, float, float, float, float, float]
    Context = Any
    Force = Callable[
        [Axis, Axis, NDArray[np.float64], Context, Index, Index, float], tuple[float, float, float, float, float, float]
    ]
    Flow = tuple[float, float, float, float, float, float, float, float, float]
    Pair = tuple[float, float]
    Stage = tuple[Axis, Axis, float, float]

NEAR_SLOPE = math.tan(math.radians(15.0))

STATUS_OK = 0
STATUS_NOT_FINITE = 1

# Places in ``parameter``.
P_K_C = 0  # contact stiffness, N/m^n
P_ALPHA = 1  # alpha_c m_b, N s/m
P_BETA = 2  # beta_c k_c, N s/m^n
P_CLEARANCE = 3  # radial clearance, m
P_OMEGA = 4  # cage speed, rad/s
P_PITCH = 5  # angle between balls of a row, rad
P_LOAD_1 = 6  # static contact force along the load, N
P_LOAD_2 = 7  # the same across it, N
P_U_1 = 8  # static relative displacement along the load, m
P_U_2 = 9  # the same across it, m
P_INV_M_I = 10  # 1 / m_i, 1/kg
P_INV_M = 11  # 1 / (m_o + m_r), 1/kg
P_INV_M_O = 12  # 1 / m_o, 1/kg
P_INV_M_R = 13  # 1 / m_r, 1/kg
P_SHARE_R = 14  # m_r / (m_o + m_r)
P_K_R = 15  # resonator stiffness, N/m
P_C_R = 16  # resonator damping, N s/m
P_SQUARE_I = 17  # k_i / m_i, 1/s2
P_DAMPING_I = 18  # c_i / m_i, 1/s
P_SQUARE_R = 19  # resonator stiffness over reduced mass, 1/s2
P_DAMPING_R = 20  # resonator damping over reduced mass, 1/s
P_DIRECTION_1 = 21  # of the sensor, along the load
P_DIRECTION_2 = 22  # the same across it
P_TURN = 23  # cage speed that enters the rate of approach, rad/s: P_OMEGA, or 0 where the turn is left out of it
PARAMETERS = 24


class Balls(NamedTuple):
    """The balls of a step: those whose path may leave the undamaged race, and the others.

    Attributes:
        moved, plain: cosine and sine of their directions in the turning frame and a distinct power of two, (3, D) and
            (3, P), each sorted by distance from the load.
        near_moved, near: how many of them can be touched while the displacement across the load is at most NEAR_SLOPE
            times that along it.
        power: exponent of the contact law less one: 1/2 of balls, 1/9 of rollers.
    """

    moved: NDArray[np.float64]
    plain: NDArray[np.float64]
    near_moved: int
    near: int
    power: float


class StepNodes(NamedTuple):
    """What is known beforehand of steps at their beginning, middle and end.

    Attributes:
        turn: cosine and sine of the cage angle, (steps, 3, 2).
        depth, rate: how far and how fast the path of the moved balls recedes, m and m/s, (steps, 3, D); at the ends of
            a step the one-sided limits from within it.
        drive: force on the shaft, N, along and across the load, and the speed of the cage over P_OMEGA, (steps, 3, 3);
            None where there is no force and one speed.
    """

    turn: NDArray[np.float64]
    depth: NDArray[np.float64]
    rate: NDArray[np.float64]
    drive: NDArray[np.float64] | None


@inlined
def oscillator(omega_squared: float, damping: float, h: float) -> tuple[float, float, float, float]:
    """Return the propagator over a time h of x'' + damping x' + omega_squared x = 0, row by row of (x, x')."""
    half = 0.5 * damping
    under = omega_squared - half * half
    decay = math.exp(-half * h)
    c, s = 1.0, h
    if under > 0.0:
        w = math.sqrt(under)
        c, s = math.cos(w * h), math.sin(w * h) / w
    elif under < 0.0:
        w = math.sqrt(-under)
        # Not decay times cosh: that is zero times infinity where the damping is strong.
        grown, gone = math.exp((w - half) * h), math.exp(-(w + half) * h)
        c, s, decay = 0.5 * (grown + gone), 0.5 * (grown - gone) / w, 1.0
    return decay * (c + half * s), decay * s, -decay * omega_squared * s, decay * (c - half * s)


@inlined
def propagators(p: NDArray[np.float64], h: float) -> Flow:
    """Return what carries half a step of length h: the inner ring's matrix, h / 2, the resonator's matrix."""
    a = oscillator(p[P_SQUARE_I], p[P_DAMPING_I], 0.5 * h)
    b = oscillator(p[P_SQUARE_R], p[P_DAMPING_R], 0.5 * h)
    return (a[0], a[1], a[2], a[3], 0.5 * h, b[0], b[1], b[2], b[3])


@inlined
def propagate(x: Axis, e: Flow) -> Axis:
    """Return the state of one axis after the linear part alone has acted for half a step."""
    return (
        e[0] * x[0] + e[1] * x[1],
        e[2] * x[0] + e[3] * x[1],
        x[2] + e[4] * x[3],
        x[3],
        e[5] * x[4] + e[6] * x[5],
        e[7] * x[4] + e[8] * x[5],
    )


@inlined
def kick(x: Axis, contact: float, shaft: float, inv_m_i: float, inv_m: float, inv_m_o: float) -> Axis:
    """Return one axis after impulses, N s: of the contact on the outer ring and against it on the inner one, and of a
    force on the shaft.
    """
    return (x[0], x[1] + (shaft - contact) * inv_m_i, x[2], x[3] + contact * inv_m, x[4], x[5] + contact * inv_m_o)


@inlined
def _root(pressed: float, power: float | None) -> float:
    """Return the approach to the exponent of the contact law less one; None stands for a half."""
    if power is None:
        return math.sqrt(pressed)
    return pressed**power


@inlined
def relative_motion(
    x1: Axis, x2: Axis, p: NDArray[np.float64], omega: float, c: float, s: float
) -> tuple[float, float, float, float, bool]:
    """Return displacement and velocity of the inner ring against the outer in the frame of the cage, along and across,
    and whether only near balls can touch; ``c`` and ``s`` are cosine and sine of the cage angle, ``omega`` its speed in
    the rate of approach, rad/s.
    """
    share = p[P_SHARE_R]
    u1 = p[P_U_1] + x1[0] - x1[2] - share * x1[4]
    u2 = p[P_U_2] + x2[0] - x2[2] - share * x2[4]
    # The total derivative of u.n for a ball that moves with the cage (Eq. 36).
    w1 = x1[1] - x1[3] - share * x1[5] + omega * u2
    w2 = x2[1] - x2[3] - share * x2[5] - omega * u1
    aligned = abs(u2) <= NEAR_SLOPE * u1
    return c * u1 + s * u2, c * u2 - s * u1, c * w1 + s * w2, c * w2 - s * w1, aligned


@inlined
def _turning(p: NDArray[np.float64], drive: NDArray[np.float64] | None, n: Index, node: Index) -> float:
    """Return the cage speed that enters the rate of approach, rad/s."""
    if drive is None:
        return p[P_TURN]
    return p[P_TURN] * drive[n, node, 2]


@inlined
def _contact(
    x1: Axis,
    x2: Axis,
    p: NDArray[np.float64],
    balls: Balls,
    power: float | None,
    nodes: StepNodes,
    n: Index,
    node: Index,
    h: float,
) -> tuple[float, float, float, float]:
    """Return what ``contact`` does; ``power`` as in ``_root``."""
    moved, plain, depth, rate = balls.moved, balls.plain, nodes.depth, nodes.rate
    clearance = p[P_CLEARANCE]
    k_c, alpha, beta = p[P_K_C], p[P_ALPHA], p[P_BETA]
    c, s = nodes.turn[n, node, 0], nodes.turn[n, node, 1]
    p1, p2, q1, q2, aligned = relative_motion(x1, x2, p, _turning(p, nodes.drive, n, node), c, s)
    f1 = 0.0
    f2 = 0.0
    mask = 0.0
    near = 0.0
    count = balls.near_moved if aligned else moved.shape[1]
    for j in range(count):
        delta = p1 * moved[0, j] + p2 * moved[1, j] - clearance - depth[n, node, j]
        touching = 1.0 if delta > 0.0 else 0.0
        pressed = max(delta, 0.0)
        root = _root(pressed, power)
        speed = q1 * moved[0, j] + q2 * moved[1, j] - rate[n, node, j]
        force = k_c * pressed * root + (alpha * touching + beta * root) * speed
        f1 += force * moved[0, j]
        f2 += force * moved[1, j]
        mask += touching * moved[2, j]
        near += 1.0 if abs(delta) < abs(speed) * h else 0.0
    count = balls.near if aligned else plain.shape[1]
    for j in range(count):
        delta = p1 * plain[0, j] + p2 * plain[1, j] - clearance
        touching = 1.0 if delta > 0.0 else 0.0
        pressed = max(delta, 0.0)
        root = _root(pressed, power)
        speed = q1 * plain[0, j] + q2 * plain[1, j]
        force = k_c * pressed * root + (alpha * touching + beta * root) * speed
        f1 += force * plain[0, j]
        f2 += force * plain[1, j]
        mask += touching * plain[2, j]
        near += 1.0 if abs(delta) < abs(speed) * h else 0.0
    return c * f1 - s * f2 - p[P_LOAD_1], s * f1 + c * f2 - p[P_LOAD_2], mask, near


@inlined
def contact(
    x1: Axis, x2: Axis, p: NDArray[np.float64], balls: Balls, nodes: StepNodes, n: Index, node: Index, h: float
) -> tuple[float, float, float, float]:
    """Return the contact force on the outer ring minus the static one, N, along and across the load (Eqs. 35-48), the
    sum of the powers of two of all balls in contact, and how many balls, at their speed, reach or left the instant at
    which they touch or part within a time ``h``.
    """
    # One branch outside of the loops: a loop that may call the power function is a fifth slower with square roots.
    if balls.power == 0.5:
        return _contact(x1, x2, p, balls, None, nodes, n, node, h)
    return _contact(x1, x2, p, balls, balls.power, nodes, n, node, h)


@inlined
def node_of(stage: Index) -> Index:
    """Return the node at which a stage of the step stands."""
    return (stage + 1) // 2


@inlined
def _on_shaft(drive: NDArray[np.float64] | None, n: Index, node: Index) -> tuple[float, float]:
    """Return the force on the shaft, N."""
    if drive is None:
        return 0.0, 0.0
    return drive[n, node, 0], drive[n, node, 1]


@inlined
def forces(
    x1: Axis, x2: Axis, p: NDArray[np.float64], context: tuple[Balls, StepNodes], n: Index, stage: Index, h: float
) -> tuple[float, float, float, float, float, float]:
    """Return the contact force and that on the shaft, N, along and across the load, and the sums of ``contact``."""
    balls, nodes = context
    node = node_of(stage)
    f1, f2, mask, near = contact(x1, x2, p, balls, nodes, n, node, h)
    s1, s2 = _on_shaft(nodes.drive, n, node)
    return f1, f2, s1, s2, mask, near


@inlined
def stages(
    x1: Axis,
    x2: Axis,
    weight: tuple[float, float, float],
    e: Flow,
    f: Flow,
    p: NDArray[np.float64],
    force: Force,
    context: Context,
    n: Index,
    reach: float,
) -> tuple[Axis, Axis, Pair, Pair, Pair, Stage, bool, bool]:
    """Return both axes after one Lawson-RK4 step, the contact force at its start and at both stages in its middle, the
    states and contact force of the stage at its end, whether a contact changed, and whether one is near to changing.

    Args:
        weight: how long, s, the forces at start, middle and end act: three times the length of the step. Where the time
            is a function of another variable, in which the step is taken, its slopes at start, middle and end, times
            the step of that variable.
        e, f: carry the first part of the step, up to the stages in its middle, and the second.
        force: ``forces``, with balls and nodes as its ``context``, or another function with its arguments and results.
        n: row of the step in ``nodes``.
        reach: time from start or end, s, within which a change of a contact counts as near.
    """
    b_i, b_m, b_o = p[P_INV_M_I], p[P_INV_M], p[P_INV_M_O]
    h, m, t = weight
    a1, a2, s1, s2, mask, near = force(x1, x2, p, context, n, np.int64(0), reach)
    y1, y2 = propagate(x1, e), propagate(x2, e)
    z1, z2 = kick(x1, 0.5 * h * a1, 0.5 * h * s1, b_i, b_m, b_o), kick(x2, 0.5 * h * a2, 0.5 * h * s2, b_i, b_m, b_o)
    z1, z2 = propagate(z1, e), propagate(z2, e)
    x1, x2 = kick(x1, h / 6.0 * a1, h / 6.0 * s1, b_i, b_m, b_o), kick(x2, h / 6.0 * a2, h / 6.0 * s2, b_i, b_m, b_o)
    x1, x2 = propagate(x1, e), propagate(x2, e)
    b1, b2, s1, s2, mask_2, _ = force(z1, z2, p, context, n, np.int64(1), reach)
    x1, x2 = kick(x1, m / 3.0 * b1, m / 3.0 * s1, b_i, b_m, b_o), kick(x2, m / 3.0 * b2, m / 3.0 * s2, b_i, b_m, b_o)
    z1, z2 = kick(y1, 0.5 * m * b1, 0.5 * m * s1, b_i, b_m, b_o), kick(y2, 0.5 * m * b2, 0.5 * m * s2, b_i, b_m, b_o)
    c1, c2, s1, s2, mask_3, _ = force(z1, z2, p, context, n, np.int64(2), reach)
    x1, x2 = kick(x1, m / 3.0 * c1, m / 3.0 * s1, b_i, b_m, b_o), kick(x2, m / 3.0 * c2, m / 3.0 * s2, b_i, b_m, b_o)
    z1, z2 = kick(y1, m * c1, m * s1, b_i, b_m, b_o), kick(y2, m * c2, m * s2, b_i, b_m, b_o)
    z1, z2 = propagate(z1, f), propagate(z2, f)
    g1, g2, s1, s2, mask_4, near_4 = force(z1, z2, p, context, n, np.int64(3), reach)
    x1, x2 = propagate(x1, f), propagate(x2, f)
    x1, x2 = kick(x1, t / 6.0 * g1, t / 6.0 * s1, b_i, b_m, b_o), kick(x2, t / 6.0 * g2, t / 6.0 * s2, b_i, b_m, b_o)
    changed = mask != mask_2 or mask != mask_3 or mask != mask_4
    return x1, x2, (a1, a2), (b1, b2), (c1, c2), (z1, z2, g1, g2), changed, near + near_4 > 0.0


@inlined
def step(
    x1: Axis,
    x2: Axis,
    h: float,
    e: Flow,
    p: NDArray[np.float64],
    force: Force,
    context: Context,
    n: Index,
    reach: float,
) -> tuple[Axis, Axis, float, float, bool, bool]:
    """Return both axes after a step of length ``h``, the contact force at its start, whether a contact changed, and
    whether one is near to changing; ``e`` carries half of it, the others: see ``stages``.
    """
    x1, x2, (a1, a2), _, _, _, changed, near = stages(x1, x2, (h, h, h), e, e, p, force, context, n, reach)
    return x1, x2, a1, a2, changed, near


@inlined
def rate_of(x: Axis, force: float, p: NDArray[np.float64]) -> Axis:
    """Return the rate of one axis under a contact force, N, on the outer ring."""
    return (
        x[1],
        -p[P_SQUARE_I] * x[0] - p[P_DAMPING_I] * x[1] - force * p[P_INV_M_I],
        x[3],
        force * p[P_INV_M],
        x[5],
        -p[P_SQUARE_R] * x[4] - p[P_DAMPING_R] * x[5] + force * p[P_INV_M_O],
    )


@inlined
def accelerations(x1: Axis, x2: Axis, f1: float, f2: float, p: NDArray[np.float64]) -> tuple[float, float]:
    """Return those of outer ring and resonator in the sensor's direction, m/s2, from the state (Eq. 44)."""
    d1, d2 = p[P_DIRECTION_1], p[P_DIRECTION_2]
    spring = d1 * (p[P_K_R] * x1[4] + p[P_C_R] * x1[5]) + d2 * (p[P_K_R] * x2[4] + p[P_C_R] * x2[5])
    return (d1 * f1 + d2 * f2 - spring) * p[P_INV_M_O], spring * p[P_INV_M_R]
