"""Kernels of the six-degree-of-freedom model: one ball period by Lawson-RK4.

Conventions. Axis 1 lies along the load, axis 2 across it. The state of one axis is (y_i, v_i, s, v_s, r, v_r): inner
ring, centre of mass of outer ring and resonator, and outer ring minus resonator, each as deviation from the static
equilibrium, m and m/s. In these coordinates the linear part of Eq. 44 is three uncoupled oscillators with closed-form
propagators. ``state`` has shape (2, 6). The contact force on the right-hand side is the true one minus the static load,
so that the equilibrium is kept exactly.

The damping force sets in like a square root where a ball meets or leaves its contact, which no step of high order
follows. A step in which any ball does so is taken again as SUBSTEPS smaller ones, with the path interpolated between
the nodes of the step.

Ball directions are constant in a frame that turns with the cage: only the displacement is rotated, by the cage angle
since the start of the period.

Arguments, float64 and C-contiguous unless said:

- ``first``, int64 (segments + 1): first step of each segment; steps within a segment are equal, and segments end at
  the kinks of the path.
- ``flow`` (segments, 10): step length h, s, then for half a step the 2x2 propagator of the inner ring, h/2, the 2x2
  propagator of the outer ring against the resonator (both row by row).
- ``turn`` (steps, 3, 2): cosine and sine of the cage angle at the beginning, middle and end of each step.
- ``part`` (segments, 9): the last nine of ``flow`` for a step of h / SUBSTEPS.
- ``advance`` (segments, 2 SUBSTEPS + 1, 2): cosine and sine of the cage's turn within a step, in steps of
  h / (2 SUBSTEPS).
- ``damaged`` (3, D), ``plain`` (3, P): cosine and sine of the ball positions at the start of the period that the
  defect can touch in this period and that it cannot, and a distinct power of two; plain ones sorted by their distance
  from the load direction.
- ``depth``, ``rate`` (steps, 3, D): d and omega_c d' of the damaged positions, m and m/s; at the ends of a step they
  are the one-sided limits from within it.
- ``near``: how many plain positions lie close enough to the load direction to be touched while the displacement
  across the load is at most ``NEAR_SLOPE`` times that along it.
- ``parameter`` (15): see the P_ constants.
- ``wave`` (steps + segments, 2), written: acceleration along the load of outer ring and resonator, m/s2, at both ends
  of every step, each segment with its own two ends.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from models.kernels.jit import inlined, kernel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.kernels.jit import Index

    Axis = tuple[float, float, float, float, float, float]
    Flow = tuple[float, float, float, float, float, float, float, float, float]
    Contact = tuple[float, float, float, float, float, float]

NEAR_SLOPE = math.tan(math.radians(15.0))

# Parts of a step in which a contact opens or closes.
SUBSTEPS = 4

STATUS_OK = 0
STATUS_NOT_FINITE = 1

# Places in ``parameter``.
P_K_C = 0  # contact stiffness, N/m^1.5
P_ALPHA = 1  # alpha_c m_b, N s/m
P_BETA = 2  # beta_c k_c, N s/m^1.5
P_CLEARANCE = 3  # radial clearance, m
P_OMEGA = 4  # cage speed, rad/s
P_LOAD = 5  # static load, N
P_INV_M_I = 6  # 1 / m_i, 1/kg
P_INV_M = 7  # 1 / (m_o + m_r), 1/kg
P_INV_M_O = 8  # 1 / m_o, 1/kg
P_INV_M_R = 9  # 1 / m_r, 1/kg
P_SHARE_R = 10  # m_r / (m_o + m_r)
P_K_R = 11  # resonator stiffness, N/m
P_C_R = 12  # resonator damping, N s/m
P_U_1 = 13  # static relative displacement along the load, m
P_U_2 = 14  # the same across the load, m
PARAMETERS = 15


@inlined
def propagate(x: Axis, e: Flow) -> Axis:
    """Return the state of one axis after the linear part alone has acted (nine entries of ``flow``)."""
    return (
        e[0] * x[0] + e[1] * x[1],
        e[2] * x[0] + e[3] * x[1],
        x[2] + e[4] * x[3],
        x[3],
        e[5] * x[4] + e[6] * x[5],
        e[7] * x[4] + e[8] * x[5],
    )


@inlined
def kick(x: Axis, impulse: float, inv_m_i: float, inv_m: float, inv_m_o: float) -> Axis:
    """Return one axis after an impulse, N s, on the outer ring and against it on the inner one."""
    return (x[0], x[1] - impulse * inv_m_i, x[2], x[3] + impulse * inv_m, x[4], x[5] + impulse * inv_m_o)


@inlined
def _contact(
    x1: Axis,
    x2: Axis,
    parameter: NDArray[np.float64],
    turn: NDArray[np.float64],
    depth: NDArray[np.float64],
    rate: NDArray[np.float64],
    n: Index,
    node: Index,
    damaged: NDArray[np.float64],
    plain: NDArray[np.float64],
    near: int,
) -> tuple[float, float, float]:
    """Return the contact force on the outer ring minus the static load, N, along and across the load (Eqs. 35-48), and
    the sum of the powers of two of all balls in contact.
    """
    share, omega, clearance = parameter[P_SHARE_R], parameter[P_OMEGA], parameter[P_CLEARANCE]
    k_c, alpha, beta = parameter[P_K_C], parameter[P_ALPHA], parameter[P_BETA]
    u1 = parameter[P_U_1] + x1[0] - x1[2] - share * x1[4]
    u2 = parameter[P_U_2] + x2[0] - x2[2] - share * x2[4]
    # The total derivative of u.n for a ball that moves with the cage (Eq. 36).
    w1 = x1[1] - x1[3] - share * x1[5] + omega * u2
    w2 = x2[1] - x2[3] - share * x2[5] - omega * u1
    c, s = turn[n, node, 0], turn[n, node, 1]
    p1, p2 = c * u1 + s * u2, c * u2 - s * u1
    q1, q2 = c * w1 + s * w2, c * w2 - s * w1
    f1 = 0.0
    f2 = 0.0
    mask = 0.0
    for j in range(damaged.shape[1]):
        delta = p1 * damaged[0, j] + p2 * damaged[1, j] - clearance - depth[n, node, j]
        touching = 1.0 if delta > 0.0 else 0.0
        pressed = max(delta, 0.0)
        root = math.sqrt(pressed)
        speed = q1 * damaged[0, j] + q2 * damaged[1, j] - rate[n, node, j]
        force = k_c * pressed * root + (alpha * touching + beta * root) * speed
        f1 += force * damaged[0, j]
        f2 += force * damaged[1, j]
        mask += touching * damaged[2, j]
    count = near if abs(u2) <= NEAR_SLOPE * u1 else plain.shape[1]
    for j in range(count):
        delta = p1 * plain[0, j] + p2 * plain[1, j] - clearance
        touching = 1.0 if delta > 0.0 else 0.0
        pressed = max(delta, 0.0)
        root = math.sqrt(pressed)
        speed = q1 * plain[0, j] + q2 * plain[1, j]
        force = k_c * pressed * root + (alpha * touching + beta * root) * speed
        f1 += force * plain[0, j]
        f2 += force * plain[1, j]
        mask += touching * plain[2, j]
    return c * f1 - s * f2 - parameter[P_LOAD], s * f1 + c * f2, mask


@inlined
def _record(wave: NDArray[np.float64], index: int, x1: Axis, g1: float, parameter: NDArray[np.float64]) -> None:
    """Write the accelerations along the load from the equation of motion at the state (Eq. 44)."""
    spring = parameter[P_K_R] * x1[4] + parameter[P_C_R] * x1[5]
    wave[index, 0] = (g1 - spring) * parameter[P_INV_M_O]
    wave[index, 1] = spring * parameter[P_INV_M_R]


@inlined
def _step(
    x1: Axis,
    x2: Axis,
    h: float,
    e: Flow,
    parameter: NDArray[np.float64],
    turn: NDArray[np.float64],
    depth: NDArray[np.float64],
    rate: NDArray[np.float64],
    n: Index,
    damaged: NDArray[np.float64],
    plain: NDArray[np.float64],
    near: int,
) -> tuple[Axis, Axis, float, bool]:
    """Return both axes after one Lawson-RK4 step, the force along the load at its start, and whether contact changed.

    ``n`` is its row in ``turn``, ``depth`` and ``rate``; ``e`` carries half of it.
    """
    b_i, b_m, b_o = parameter[P_INV_M_I], parameter[P_INV_M], parameter[P_INV_M_O]
    start, g2, mask = _contact(x1, x2, parameter, turn, depth, rate, n, np.int64(0), damaged, plain, near)
    y1, y2 = propagate(x1, e), propagate(x2, e)
    z1, z2 = kick(x1, 0.5 * h * start, b_i, b_m, b_o), kick(x2, 0.5 * h * g2, b_i, b_m, b_o)
    z1, z2 = propagate(z1, e), propagate(z2, e)
    x1, x2 = kick(x1, h / 6.0 * start, b_i, b_m, b_o), kick(x2, h / 6.0 * g2, b_i, b_m, b_o)
    x1, x2 = propagate(x1, e), propagate(x2, e)
    g1, g2, mask_2 = _contact(z1, z2, parameter, turn, depth, rate, n, np.int64(1), damaged, plain, near)
    x1, x2 = kick(x1, h / 3.0 * g1, b_i, b_m, b_o), kick(x2, h / 3.0 * g2, b_i, b_m, b_o)
    z1, z2 = kick(y1, 0.5 * h * g1, b_i, b_m, b_o), kick(y2, 0.5 * h * g2, b_i, b_m, b_o)
    g1, g2, mask_3 = _contact(z1, z2, parameter, turn, depth, rate, n, np.int64(1), damaged, plain, near)
    x1, x2 = kick(x1, h / 3.0 * g1, b_i, b_m, b_o), kick(x2, h / 3.0 * g2, b_i, b_m, b_o)
    z1, z2 = kick(y1, h * g1, b_i, b_m, b_o), kick(y2, h * g2, b_i, b_m, b_o)
    z1, z2 = propagate(z1, e), propagate(z2, e)
    g1, g2, mask_4 = _contact(z1, z2, parameter, turn, depth, rate, n, np.int64(2), damaged, plain, near)
    x1, x2 = propagate(x1, e), propagate(x2, e)
    x1, x2 = kick(x1, h / 6.0 * g1, b_i, b_m, b_o), kick(x2, h / 6.0 * g2, b_i, b_m, b_o)
    return x1, x2, start, mask != mask_2 or mask != mask_3 or mask != mask_4


@inlined
def _path_within(
    index: int,
    node: int,
    span: float,
    depth: NDArray[np.float64],
    rate: NDArray[np.float64],
    n: int,
    depth_out: NDArray[np.float64],
    rate_out: NDArray[np.float64],
) -> None:
    """Write d and omega_c d' at a place within step ``n`` of ``span`` s, from its three nodes (quintic Hermite).

    The place is ``index`` of 2 SUBSTEPS; it is written to row 0, ``node``. In s from -1 to 1 over the step, the
    polynomial has the values and slopes of the nodes at s = -1, 0 and 1.
    """
    s = index / SUBSTEPS - 1.0
    half = 0.5 * span
    for j in range(depth.shape[2]):
        middle, m_slope = depth[n, 1, j], half * rate[n, 1, j]
        even = 0.5 * (depth[n, 2, j] + depth[n, 0, j]) - middle
        odd = 0.5 * (depth[n, 2, j] - depth[n, 0, j]) - m_slope
        even_slope = 0.5 * half * (rate[n, 2, j] - rate[n, 0, j])
        odd_slope = 0.5 * half * (rate[n, 2, j] + rate[n, 0, j]) - m_slope
        a4, a5 = 0.5 * even_slope - even, 0.5 * (odd_slope - 3.0 * odd)
        a2, a3 = even - a4, odd - a5
        depth_out[0, node, j] = middle + s * (m_slope + s * (a2 + s * (a3 + s * (a4 + s * a5))))
        rate_out[0, node, j] = (m_slope + s * (2.0 * a2 + s * (3.0 * a3 + s * (4.0 * a4 + s * 5.0 * a5)))) / half


@inlined
def _row(values: NDArray[np.float64], row: int, offset: int) -> Flow:
    return (
        values[row, offset],
        values[row, offset + 1],
        values[row, offset + 2],
        values[row, offset + 3],
        values[row, offset + 4],
        values[row, offset + 5],
        values[row, offset + 6],
        values[row, offset + 7],
        values[row, offset + 8],
    )


@kernel
def _refined_step(
    x1: Axis,
    x2: Axis,
    h: float,
    e: Flow,
    parameter: NDArray[np.float64],
    turn: NDArray[np.float64],
    advance: NDArray[np.float64],
    segment: int,
    depth: NDArray[np.float64],
    rate: NDArray[np.float64],
    n: int,
    damaged: NDArray[np.float64],
    plain: NDArray[np.float64],
    near: int,
) -> tuple[Axis, Axis]:
    """Return both axes after step ``n`` taken in SUBSTEPS parts; ``e`` carries half of a part."""
    within = np.empty((1, 3, 2))
    sub_depth = np.empty((1, 3, damaged.shape[1]))
    sub_rate = np.empty((1, 3, damaged.shape[1]))
    for part in range(SUBSTEPS):
        for node in range(3):
            index = 2 * part + node
            c, s = advance[segment, index, 0], advance[segment, index, 1]
            within[0, node, 0] = turn[n, 0, 0] * c - turn[n, 0, 1] * s
            within[0, node, 1] = turn[n, 0, 1] * c + turn[n, 0, 0] * s
            _path_within(index, node, h, depth, rate, n, sub_depth, sub_rate)
        x1, x2, _, _ = _step(
            x1, x2, h / SUBSTEPS, e, parameter, within, sub_depth, sub_rate, np.int64(0), damaged, plain, near
        )
    return x1, x2


@kernel
def ball_period(
    state: NDArray[np.float64],
    state_out: NDArray[np.float64],
    wave: NDArray[np.float64],
    first: NDArray[np.int64],
    flow: NDArray[np.float64],
    part: NDArray[np.float64],
    turn: NDArray[np.float64],
    advance: NDArray[np.float64],
    damaged: NDArray[np.float64],
    plain: NDArray[np.float64],
    near: int,
    depth: NDArray[np.float64],
    rate: NDArray[np.float64],
    parameter: NDArray[np.float64],
) -> int:
    """Carry the state over one ball period; see the module for the arrays. Return a STATUS_ number."""
    x1 = (state[0, 0], state[0, 1], state[0, 2], state[0, 3], state[0, 4], state[0, 5])
    x2 = (state[1, 0], state[1, 1], state[1, 2], state[1, 3], state[1, 4], state[1, 5])
    for segment in range(first.shape[0] - 1):
        h = flow[segment, 0]
        e, e_part = _row(flow, segment, 1), _row(part, segment, 0)
        for n in range(first[segment], first[segment + 1]):
            y1, y2, g1, changed = _step(x1, x2, h, e, parameter, turn, depth, rate, n, damaged, plain, near)
            _record(wave, n + segment, x1, g1, parameter)
            if changed:
                y1, y2 = _refined_step(
                    x1, x2, h, e_part, parameter, turn, advance, segment, depth, rate, n, damaged, plain, near
                )
            x1, x2 = y1, y2
        last = first[segment + 1] - 1
        g1, _, _ = _contact(x1, x2, parameter, turn, depth, rate, last, np.int64(2), damaged, plain, near)
        _record(wave, last + segment + 1, x1, g1, parameter)
    bad = False
    for k in range(6):
        state_out[0, k], state_out[1, k] = x1[k], x2[k]
        bad = bad or not math.isfinite(x1[k]) or not math.isfinite(x2[k])
    return STATUS_NOT_FINITE if bad else STATUS_OK
