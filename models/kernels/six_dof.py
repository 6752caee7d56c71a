"""Kernels of the six-degree-of-freedom model: one ball period by Lawson-RK4.

Conventions. Axis 1 lies along the load, axis 2 across it. The state of one axis is (y_i, v_i, s, v_s, r, v_r): inner
ring, centre of mass of outer ring and resonator, and outer ring minus resonator, each as deviation from the static
equilibrium, m and m/s. In these coordinates the linear part of Eq. 44 is three uncoupled oscillators with closed-form
propagators. ``state`` has shape (2, 6). The contact force on the right-hand side is the true one minus the static load,
so that the equilibrium is kept exactly.

Ball directions are constant in a frame that turns with the cage: only the displacement is rotated, by the cage angle
since the start of the period.

Arguments, float64 and C-contiguous unless said:

- ``first``, int64 (segments + 1): first step of each segment; steps within a segment are equal, and segments end at
  the kinks of the path.
- ``flow`` (segments, 10): step length h, s, then for half a step the 2x2 propagator of the inner ring, h/2, the 2x2
  propagator of the outer ring against the resonator (both row by row).
- ``turn`` (steps, 3, 2): cosine and sine of the cage angle at the beginning, middle and end of each step.
- ``damaged`` (2, D), ``plain`` (2, P): cosine and sine of the ball positions at the start of the period that the
  defect can touch in this period and that it cannot; plain ones sorted by their distance from the load direction.
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

from models.kernels.jit import kernel

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Axis = tuple[float, float, float, float, float, float]
    Flow = tuple[float, float, float, float, float, float, float, float, float]
    Contact = tuple[float, float, float, float, float, float]

NEAR_SLOPE = math.tan(math.radians(15.0))

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


@kernel
def _flow(x: Axis, e: Flow) -> Axis:
    return (
        e[0] * x[0] + e[1] * x[1],
        e[2] * x[0] + e[3] * x[1],
        x[2] + e[4] * x[3],
        x[3],
        e[5] * x[4] + e[6] * x[5],
        e[7] * x[4] + e[8] * x[5],
    )


@kernel
def _kick(x: Axis, impulse: float, inv_m_i: float, inv_m: float, inv_m_o: float) -> Axis:
    return (x[0], x[1] - impulse * inv_m_i, x[2], x[3] + impulse * inv_m, x[4], x[5] + impulse * inv_m_o)


@kernel
def _contact(
    x1: Axis,
    x2: Axis,
    parameter: NDArray[np.float64],
    turn: NDArray[np.float64],
    depth: NDArray[np.float64],
    rate: NDArray[np.float64],
    damaged: NDArray[np.float64],
    plain: NDArray[np.float64],
    near: int,
) -> tuple[float, float]:
    """Return the contact force on the outer ring minus the static load, N, along and across the load (Eqs. 35-48)."""
    share, omega, clearance = parameter[P_SHARE_R], parameter[P_OMEGA], parameter[P_CLEARANCE]
    k_c, alpha, beta = parameter[P_K_C], parameter[P_ALPHA], parameter[P_BETA]
    u1 = parameter[P_U_1] + x1[0] - x1[2] - share * x1[4]
    u2 = parameter[P_U_2] + x2[0] - x2[2] - share * x2[4]
    # The total derivative of u.n for a ball that moves with the cage (Eq. 36).
    w1 = x1[1] - x1[3] - share * x1[5] + omega * u2
    w2 = x2[1] - x2[3] - share * x2[5] - omega * u1
    c, s = turn[0], turn[1]
    p1, p2 = c * u1 + s * u2, c * u2 - s * u1
    q1, q2 = c * w1 + s * w2, c * w2 - s * w1
    f1 = 0.0
    f2 = 0.0
    for j in range(damaged.shape[1]):
        delta = p1 * damaged[0, j] + p2 * damaged[1, j] - clearance - depth[j]
        touching = 1.0 if delta > 0.0 else 0.0
        pressed = max(delta, 0.0)
        root = math.sqrt(pressed)
        speed = q1 * damaged[0, j] + q2 * damaged[1, j] - rate[j]
        force = k_c * pressed * root + (alpha * touching + beta * root) * speed
        f1 += force * damaged[0, j]
        f2 += force * damaged[1, j]
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
    return c * f1 - s * f2 - parameter[P_LOAD], s * f1 + c * f2


@kernel
def _record(wave: NDArray[np.float64], x1: Axis, g1: float, parameter: NDArray[np.float64]) -> None:
    """Write the accelerations along the load from the equation of motion at the state (Eq. 44)."""
    spring = parameter[P_K_R] * x1[4] + parameter[P_C_R] * x1[5]
    wave[0] = (g1 - spring) * parameter[P_INV_M_O]
    wave[1] = spring * parameter[P_INV_M_R]


@kernel
def ball_period(
    state: NDArray[np.float64],
    state_out: NDArray[np.float64],
    wave: NDArray[np.float64],
    first: NDArray[np.int64],
    flow: NDArray[np.float64],
    turn: NDArray[np.float64],
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
    b_i, b_m, b_o = parameter[P_INV_M_I], parameter[P_INV_M], parameter[P_INV_M_O]
    for segment in range(first.shape[0] - 1):
        h = flow[segment, 0]
        e = (
            flow[segment, 1],
            flow[segment, 2],
            flow[segment, 3],
            flow[segment, 4],
            flow[segment, 5],
            flow[segment, 6],
            flow[segment, 7],
            flow[segment, 8],
            flow[segment, 9],
        )
        for n in range(first[segment], first[segment + 1]):
            g1, g2 = _contact(x1, x2, parameter, turn[n, 0], depth[n, 0], rate[n, 0], damaged, plain, near)
            _record(wave[n + segment], x1, g1, parameter)
            y1, y2 = _flow(x1, e), _flow(x2, e)
            z1, z2 = _kick(x1, 0.5 * h * g1, b_i, b_m, b_o), _kick(x2, 0.5 * h * g2, b_i, b_m, b_o)
            x1, x2 = _kick(x1, h / 6.0 * g1, b_i, b_m, b_o), _kick(x2, h / 6.0 * g2, b_i, b_m, b_o)
            x1, x2 = _flow(x1, e), _flow(x2, e)
            z1, z2 = _flow(z1, e), _flow(z2, e)
            g1, g2 = _contact(z1, z2, parameter, turn[n, 1], depth[n, 1], rate[n, 1], damaged, plain, near)
            x1, x2 = _kick(x1, h / 3.0 * g1, b_i, b_m, b_o), _kick(x2, h / 3.0 * g2, b_i, b_m, b_o)
            z1, z2 = _kick(y1, 0.5 * h * g1, b_i, b_m, b_o), _kick(y2, 0.5 * h * g2, b_i, b_m, b_o)
            g1, g2 = _contact(z1, z2, parameter, turn[n, 1], depth[n, 1], rate[n, 1], damaged, plain, near)
            x1, x2 = _kick(x1, h / 3.0 * g1, b_i, b_m, b_o), _kick(x2, h / 3.0 * g2, b_i, b_m, b_o)
            z1, z2 = _kick(y1, h * g1, b_i, b_m, b_o), _kick(y2, h * g2, b_i, b_m, b_o)
            z1, z2 = _flow(z1, e), _flow(z2, e)
            g1, g2 = _contact(z1, z2, parameter, turn[n, 2], depth[n, 2], rate[n, 2], damaged, plain, near)
            x1, x2 = _flow(x1, e), _flow(x2, e)
            x1, x2 = _kick(x1, h / 6.0 * g1, b_i, b_m, b_o), _kick(x2, h / 6.0 * g2, b_i, b_m, b_o)
        last = first[segment + 1] - 1
        g1, g2 = _contact(x1, x2, parameter, turn[last, 2], depth[last, 2], rate[last, 2], damaged, plain, near)
        _record(wave[last + segment + 1], x1, g1, parameter)
    bad = False
    for k in range(6):
        state_out[0, k], state_out[1, k] = x1[k], x2[k]
        bad = bad or not math.isfinite(x1[k]) or not math.isfinite(x2[k])
    return STATUS_NOT_FINITE if bad else STATUS_OK
