"""Integrators that the project's own is compared with, on one plain right-hand side that shares no code with models/.

The equations are those of the thesis (Eqs. 32-52 and 83-89), the path of each ball is evaluated at the time that a
stage asks for, without tables. Axis 1 lies along the load, axis 2 across it. Two sets of coordinates:

- explicit methods: ``x`` (12), the displacements (inner ring, outer ring, resonator; each axis 1, axis 2) from zero
  load, then their velocities, m and m/s;
- exponential methods: ``y`` (12), for each axis (y_i, v_i, s, v_s, r, v_r): inner ring, centre of mass of outer ring
  and resonator, outer ring minus resonator, each as deviation from the static equilibrium, m and m/s.

What all kernels take: ``par`` (see the P_ constants), ``ball`` (3, balls): angle at time zero, rad, and its cosine and
sine; ``faulty`` (balls): 1 where the ball's row is damaged; ``rough`` (4, pieces): cubic pieces of the floor's profile,
highest power first. Fixed-step kernels take ``nodes`` (steps + 1), the ends of all steps, s; with ``sided`` the path is
taken at times within the step, so that a kink at its end is met with the slope from within; without it the slope is
that of the following piece. They write ``wave`` (steps), the casing's acceleration along the load at the start of each
step, m/s2.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from models.platform.jit import kernel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Scene = tuple[Array, Array, Array, Array]

P_RACE, P_BALL, P_COSINE, P_HALF, P_DEPTH, P_REACH, P_ROUGHNESS, P_SPACING = range(8)
P_K_C, P_ALPHA, P_BETA, P_CLEARANCE, P_OMEGA, P_LOAD = range(8, 14)
P_M_I, P_M_O, P_M_R, P_K_I, P_C_I, P_K_R, P_C_R, P_U_1, P_U_2 = range(14, 23)
PARAMETERS = 23

SUBSTEPS = 4
# How far within a step the path is taken, s: more than the rounding of times, less than matters.
NUDGE = 2e-12

# Dormand and Prince's pair of orders 5 and 4: nodes, stages, and the weights of the error.
DP_C = np.array([0.0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0, 1.0])
DP_A = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [1 / 5, 0.0, 0.0, 0.0, 0.0, 0.0],
        [3 / 40, 9 / 40, 0.0, 0.0, 0.0, 0.0],
        [44 / 45, -56 / 15, 32 / 9, 0.0, 0.0, 0.0],
        [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729, 0.0, 0.0],
        [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656, 0.0],
        [35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84],
    ]
)
DP_E = np.array([71 / 57600, 0.0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40])


@kernel
def ball_path(angle: float, par: Array, rough: Array) -> tuple[float, float]:
    """Return d, m, and its derivative by the angle, m/rad, at an angle from the defect's centre, rad."""
    x = angle - 2.0 * math.pi * math.floor(angle / (2.0 * math.pi) + 0.5)
    beyond = min(par[P_HALF] - abs(x), par[P_REACH])
    if beyond <= 0.0:
        return 0.0, 0.0
    sine, cosine = par[P_RACE] * math.sin(beyond), par[P_RACE] * math.cos(beyond)
    root = math.sqrt(par[P_BALL] * par[P_BALL] - sine * sine)
    edge = par[P_BALL] - root - (par[P_RACE] - cosine)
    floor, slope = par[P_DEPTH], 0.0
    if par[P_ROUGHNESS] > 0.0:
        wrapped = x if x >= 0.0 else x + 2.0 * math.pi
        piece = min(int(wrapped / par[P_SPACING]), rough.shape[1] - 1)
        z = wrapped - piece * par[P_SPACING]
        c3, c2, c1, c0 = rough[0, piece], rough[1, piece], rough[2, piece], rough[3, piece]
        floor += par[P_ROUGHNESS] * (((c3 * z + c2) * z + c1) * z + c0)
        slope = par[P_ROUGHNESS] * ((3.0 * c3 * z + 2.0 * c2) * z + c1)
    if edge <= floor:
        floor, slope = edge, sine * (cosine / root - 1.0) * (-1.0 if x > 0.0 else 1.0)
    return par[P_COSINE] * floor, par[P_COSINE] * slope


@kernel
def contact(
    t: float, path_t: float, u1: float, u2: float, v1: float, v2: float, scene: Scene
) -> tuple[float, float, int]:
    """Return the force on the outer ring along and across the load, N, and one bit for each ball in contact.

    ``u`` and ``v`` are displacement and velocity of the inner ring from the outer one; ``path_t`` is where the path is
    taken.
    """
    par, ball, faulty, rough = scene
    omega = par[P_OMEGA]
    c, s = math.cos(omega * t), math.sin(omega * t)
    w1, w2 = v1 + omega * u2, v2 - omega * u1
    p1, p2, q1, q2 = c * u1 + s * u2, c * u2 - s * u1, c * w1 + s * w2, c * w2 - s * w1
    f1, f2, mask = 0.0, 0.0, 0
    for j in range(ball.shape[1]):
        delta = p1 * ball[1, j] + p2 * ball[2, j] - par[P_CLEARANCE]
        if delta <= 0.0:
            continue
        rate = q1 * ball[1, j] + q2 * ball[2, j]
        if faulty[j] > 0.0:
            depth, slope = ball_path(ball[0, j] + omega * path_t, par, rough)
            delta -= depth
            rate -= omega * slope
            if delta <= 0.0:
                continue
        root = math.sqrt(delta)
        force = par[P_K_C] * delta * root + (par[P_ALPHA] + par[P_BETA] * root) * rate
        f1 += force * ball[1, j]
        f2 += force * ball[2, j]
        mask += 1 << j
    return c * f1 - s * f2, s * f1 + c * f2, mask


@kernel
def derivative(t: float, path_t: float, x: Array, out: Array, scene: Scene) -> None:
    """Write the time derivative of ``x`` (Eq. 44)."""
    par = scene[0]
    f = contact(t, path_t, x[0] - x[2], x[1] - x[3], x[6] - x[8], x[7] - x[9], scene)
    for axis in range(2):
        force = f[0] if axis == 0 else f[1]
        load = par[P_LOAD] if axis == 0 else 0.0
        spring = par[P_K_R] * (x[2 + axis] - x[4 + axis]) + par[P_C_R] * (x[8 + axis] - x[10 + axis])
        out[6 + axis] = (-force - par[P_K_I] * x[axis] - par[P_C_I] * x[6 + axis]) / par[P_M_I]
        out[8 + axis] = (force - spring - load) / par[P_M_O]
        out[10 + axis] = spring / par[P_M_R]
    for k in range(6):
        out[k] = x[6 + k]


@kernel
def path_time(t: float, low: float, high: float, sided: bool) -> float:
    """Return the time at which a stage at ``t`` of the step from ``low`` to ``high`` takes the path."""
    return min(max(t, low + NUDGE), high - NUDGE) if sided else t + NUDGE


@kernel
def runge_kutta_4(nodes: Array, sided: bool, x: Array, wave: Array, scene: Scene) -> None:
    """Carry ``x`` over all steps with the classical explicit method."""
    k = np.empty((4, 12))
    z = np.empty(12)
    for n in range(len(nodes) - 1):
        t, h = nodes[n], nodes[n + 1] - nodes[n]
        for stage in range(4):
            share = (0.0, 0.5, 0.5, 1.0)[stage]
            for i in range(12):
                z[i] = x[i] + h * share * k[stage - 1, i] if stage > 0 else x[i]
            at = t + share * h
            derivative(at, path_time(at, t, nodes[n + 1], sided), z, k[stage], scene)
        wave[n] = k[0, 8]
        for i in range(12):
            x[i] += h / 6.0 * (k[0, i] + 2.0 * k[1, i] + 2.0 * k[2, i] + k[3, i])


@kernel
def dormand_prince(
    end: float, rtol: float, atol: Array, x: Array, times: Array, wave: Array, scene: Scene
) -> tuple[int, int]:
    """Carry ``x`` to ``end`` with the adaptive pair and the step control that MATLAB documents for ode45.

    The error per step is at most ``rtol`` times the larger of the state and ``atol / rtol``, component by component.
    Writes the start of each accepted step and the acceleration there; returns the numbers of steps and of evaluations
    (steps -1 where the arrays were too short).
    """
    k = np.empty((7, 12))
    z = np.empty(12)
    derivative(0.0, 0.0, x, k[0], scene)
    rate = 0.0
    for i in range(12):
        rate = max(rate, abs(k[0, i]) / max(abs(x[i]), atol[i] / rtol))
    h = min(0.1 * end, 0.8 * rtol**0.2 / max(rate, 1e-300))
    t, n, evaluations, failed = 0.0, 0, 1, False
    while t < end:
        if n == len(times):
            return -1, evaluations
        h = min(h, 0.1 * end, end - t)
        for stage in range(1, 7):
            for i in range(12):
                total = 0.0
                for j in range(stage):
                    total += DP_A[stage, j] * k[j, i]
                z[i] = x[i] + h * total
            derivative(t + DP_C[stage] * h, t + DP_C[stage] * h, z, k[stage], scene)
        evaluations += 6
        error = 0.0
        for i in range(12):
            part = 0.0
            for j in range(7):
                part += DP_E[j] * k[j, i]
            error = max(error, abs(h * part) / max(abs(x[i]), abs(z[i]), atol[i] / rtol))
        if error > rtol:
            h *= 0.5 if failed else max(0.1, 0.8 * (rtol / error) ** 0.2)
            failed = True
            continue
        times[n], wave[n] = t, k[0, 8]
        n += 1
        t += h
        x[:] = z
        k[0] = k[6]
        if not failed:
            h /= max(0.2, 1.25 * (error / rtol) ** 0.2)
        failed = False
    return n, evaluations


@kernel
def excess(t: float, path_t: float, y: Array, scene: Scene) -> tuple[float, float, int]:
    """Return the contact force minus the static load at ``y``, and the balls in contact."""
    par = scene[0]
    share = par[P_M_R] / (par[P_M_O] + par[P_M_R])
    u1, u2 = par[P_U_1] + y[0] - y[2] - share * y[4], par[P_U_2] + y[6] - y[8] - share * y[10]
    v1, v2 = y[1] - y[3] - share * y[5], y[7] - y[9] - share * y[11]
    f1, f2, mask = contact(t, path_t, u1, u2, v1, v2, scene)
    return f1 - par[P_LOAD], f2, mask


@kernel
def casing(y: Array, g1: float, par: Array) -> float:
    """Return the casing's acceleration along the load, m/s2."""
    return (g1 - par[P_K_R] * y[4] - par[P_C_R] * y[5]) / par[P_M_O]


@kernel
def flow(y: Array, e: Array) -> None:
    """Carry ``y`` along the linear part; ``e`` (3, 2, 2): the propagators of the three oscillators of an axis."""
    for axis in range(2):
        for m in range(3):
            k = 6 * axis + 2 * m
            a, b = y[k], y[k + 1]
            y[k], y[k + 1] = e[m, 0, 0] * a + e[m, 0, 1] * b, e[m, 1, 0] * a + e[m, 1, 1] * b


@kernel
def kick(y: Array, impulse_1: float, impulse_2: float, par: Array) -> None:
    """Add what an impulse of the contact force, N s, does to the velocities."""
    for axis in range(2):
        impulse = impulse_1 if axis == 0 else impulse_2
        y[6 * axis + 1] -= impulse / par[P_M_I]
        y[6 * axis + 3] += impulse / (par[P_M_O] + par[P_M_R])
        y[6 * axis + 5] += impulse / par[P_M_O]


@kernel
def lawson_step(
    y: Array, work: Array, t: float, h: float, span: tuple[float, float], sided: bool, e: Array, scene: Scene
) -> tuple[float, bool]:
    """Carry ``y`` over one Lawson-RK4 step; return its force along the load at the start and whether contact changed.

    ``e`` carries half a step; ``span`` are the times within which the path may be taken; ``work`` (2, 12).
    """
    par, half, z = scene[0], work[0], work[1]
    low, high = span
    z[:] = y
    half[:] = y
    flow(half, e)
    middle, end = t + 0.5 * h, t + h
    a1, a2, mask = excess(t, path_time(t, low, high, sided), y, scene)
    kick(z, 0.5 * h * a1, 0.5 * h * a2, par)
    flow(z, e)
    kick(y, h / 6.0 * a1, h / 6.0 * a2, par)
    flow(y, e)
    at = path_time(middle, low, high, sided)
    b1, b2, mask_2 = excess(middle, at, z, scene)
    kick(y, h / 3.0 * b1, h / 3.0 * b2, par)
    z[:] = half
    kick(z, 0.5 * h * b1, 0.5 * h * b2, par)
    b1, b2, mask_3 = excess(middle, at, z, scene)
    kick(y, h / 3.0 * b1, h / 3.0 * b2, par)
    z[:] = half
    kick(z, h * b1, h * b2, par)
    flow(z, e)
    b1, b2, mask_4 = excess(end, path_time(end, low, high, sided), z, scene)
    flow(y, e)
    kick(y, h / 6.0 * b1, h / 6.0 * b2, par)
    return a1, mask != mask_2 or mask != mask_3 or mask != mask_4


@kernel
def lawson(
    nodes: Array,
    segment: NDArray[np.int64],
    whole: Array,
    part: Array,
    sided: bool,
    refined: bool,
    y: Array,
    wave: Array,
    scene: Scene,
) -> int:
    """Carry ``y`` over all steps; return how many evaluations that took.

    ``segment`` (steps) names each step's propagators in ``whole`` (segments, 3, 2, 2), which carry half a step, and in
    ``part``, which carry half of a step's SUBSTEPS-th part. With ``refined``, steps in which a ball meets or leaves its
    contact are taken again in such parts.
    """
    work = np.empty((2, 12))
    before = np.empty(12)
    evaluations = 0
    for n in range(len(nodes) - 1):
        t, h = nodes[n], nodes[n + 1] - nodes[n]
        span = (t, nodes[n + 1])
        before[:] = y
        g1, changed = lawson_step(y, work, t, h, span, sided, whole[segment[n]], scene)
        wave[n] = casing(before, g1, scene[0])
        evaluations += 4
        if refined and changed:
            y[:] = before
            for k in range(SUBSTEPS):
                lawson_step(y, work, t + k * h / SUBSTEPS, h / SUBSTEPS, span, sided, part[segment[n]], scene)
            evaluations += 4 * SUBSTEPS
    return evaluations


@kernel
def exponential_multistep(
    h: float, first: int, full: Array, weights: Array, history: Array, y: Array, wave: Array, scene: Scene
) -> None:
    """Carry ``y`` from time ``first * h`` on with the exponential Adams-Bashforth method of the order of ``weights``.

    ``full`` (3, 2, 2) carries a whole step; ``weights`` (order, 6): what one newton at the latest time, one step
    earlier, ... adds to an axis; ``history`` (order, 2): the forces at these times, latest first (row 0 unset).
    """
    order = len(weights)
    for n in range(len(wave)):
        t = (first + n) * h
        g1, g2, _ = excess(t, t, y, scene)
        history[0, 0], history[0, 1] = g1, g2
        wave[n] = casing(y, g1, scene[0])
        flow(y, full)
        for j in range(order):
            for m in range(6):
                y[m] += weights[j, m] * history[j, 0]
                y[6 + m] += weights[j, m] * history[j, 1]
        for j in range(order - 1, 0, -1):
            history[j, 0], history[j, 1] = history[j - 1, 0], history[j - 1, 1]
