"""Kernel of the rotor on an elastic shaft whose ends have no mass, as the source has it.

The ends obey no equation of motion: their place follows from the balance of the shaft's force with that of the balls.
The disc takes velocity-Verlet steps; the balance is solved at the end of each by Newton's method, with the rates of the
dampers over the step (backward Euler). First order in the step.

* The matrix of the dampers has rank 0, 1 or 2 as none, one or more balls are loaded: an end that loses its contact has
  no rate at all. A ball therefore never pulls here (else the end would jump), and counts the part of a step in which it
  is loaded only, by which its force is a continuous function of the end's place.
* The Jacobian is that of the shaft's spring plus a positive semidefinite one, so that it can always be solved.
* Accelerations of the ends do not exist: their velocity jumps where a contact closes. Only that of the disc is given.

State: x, y, p, s (models.solve.rotor.kernel), the places x, y of A and of B, then the velocities of the first
    four.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from models.platform.jit import inlined, kernel
from models.solve.engine.kernel_stepping import TINY, fill_depth, fill_start
from models.solve.rotor.kernel import (
    B_CLEARANCE,
    B_DAMPING,
    B_POWER,
    B_SIZE,
    B_SPRING,
    B_STIFFNESS,
    P_A,
    P_B,
    P_BOW_1,
    P_BOW_2,
    P_DIRECTION_1,
    P_DIRECTION_2,
    P_PER_BEARING,
    P_SHAFT,
    P_SHAFT_LOSS,
    STATUS_NOT_FINITE,
    STATUS_OK,
    disc_acceleration,
    new_work,
    power_of,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.platform.jit import Index
    from models.solve.rotor.kernel import RotorPlan, RotorWork

_MOST_ITERATIONS = 60
_BALANCED = 1e-11
_MOST_HALVINGS = 30
_CORRECTIONS = 3

Pair = tuple[float, float]


@inlined
def _balls(
    e: Pair, before: Pair, bearing: Index, tau: float, plan: RotorPlan, work: RotorWork
) -> tuple[Pair, float, float, float]:
    """Return the force of the balls on the end at ``e``, and 11, 12 and 22 of its Jacobian."""
    p, at = plan.parameter, P_PER_BEARING + bearing * B_SIZE
    c, s = work.turn[0, 2 * bearing], work.turn[0, 2 * bearing + 1]
    f_1, f_2, k_11, k_12, k_22 = 0.0, 0.0, 0.0, 0.0, 0.0
    first = 0 if bearing == 0 else plan.of_a[0]
    last = plan.of_a[0] if bearing == 0 else plan.slots.shape[1]
    for j in range(first, last):
        n_1 = plan.slots[0, j] * c - plan.slots[1, j] * s
        n_2 = plan.slots[1, j] * c + plan.slots[0, j] * s
        delta = e[0] * n_1 + e[1] * n_2 - p[at + B_CLEARANCE] - work.depth[0, j]
        if delta > 0.0:
            moved = (e[0] - before[0]) * n_1 + (e[1] - before[1]) * n_2
            loss = p[at + B_DAMPING] / tau
            elastic = p[at + B_STIFFNESS] * power_of(delta, p[at + B_POWER])
            q = elastic + loss * (delta - max(delta - moved, 0.0))
            if q > 0.0:
                # Only a part of the step is counted where the ball was free at its beginning; its end counts whole.
                tangent = p[at + B_POWER] * elastic / delta + loss
                if delta < moved:
                    tangent = max(tangent, q / delta)
                f_1 += q * n_1
                f_2 += q * n_2
                k_11 += tangent * n_1 * n_1
                k_12 += tangent * n_1 * n_2
                k_22 += tangent * n_2 * n_2
    return (f_1, f_2), k_11, k_12, k_22


@inlined
def _shaft(above: Pair, e: Pair, bent: Pair, bearing: Index, tau: float, p: NDArray[np.float64]) -> Pair:
    """Return the force of the shaft on the end at ``e``; ``bent``: its deflection at the beginning of the step."""
    k, loss, speed = p[P_PER_BEARING + bearing * B_SIZE + B_SPRING], p[P_SHAFT_LOSS], p[P_SHAFT]
    d_1, d_2 = above[0] - e[0], above[1] - e[1]
    rate_1, rate_2 = (d_1 - bent[0]) / tau, (d_2 - bent[1]) / tau
    return k * (d_1 + loss * (rate_1 + speed * d_2)), k * (d_2 + loss * (rate_2 - speed * d_1))


@kernel
def _balance(
    above: Pair, before: Pair, bent: Pair, bearing: Index, tau: float, plan: RotorPlan, work: RotorWork
) -> tuple[float, float, float, float, int]:
    """Return the place of an end where shaft and balls are in balance, that force, and the iterations it took."""
    p = plan.parameter
    k, loss = p[P_PER_BEARING + bearing * B_SIZE + B_SPRING], p[P_SHAFT_LOSS]
    straight, across = k * (1.0 + loss / tau), k * loss * p[P_SHAFT]
    e: Pair = before
    s_e = _shaft(above, e, bent, bearing, tau, p)
    f_e, k_11, k_12, k_22 = _balls(e, before, bearing, tau, plan, work)
    r = (s_e[0] - f_e[0], s_e[1] - f_e[1])
    size = math.hypot(r[0], r[1])
    taken = 0
    while taken < _MOST_ITERATIONS and size > _BALANCED * (1.0 + math.hypot(s_e[0], s_e[1])):
        taken += 1
        j_11, j_12, j_21, j_22 = straight + k_11, k_12 + across, k_12 - across, straight + k_22
        determinant = j_11 * j_22 - j_12 * j_21
        g_1, g_2 = (j_22 * r[0] - j_12 * r[1]) / determinant, (j_11 * r[1] - j_21 * r[0]) / determinant
        share, better = 1.0, False
        for _ in range(_MOST_HALVINGS):
            trial: Pair = (e[0] + share * g_1, e[1] + share * g_2)
            s_t = _shaft(above, trial, bent, bearing, tau, p)
            f_t, t_11, t_12, t_22 = _balls(trial, before, bearing, tau, plan, work)
            left = (s_t[0] - f_t[0], s_t[1] - f_t[1])
            if math.hypot(left[0], left[1]) < size:
                e, s_e, r, k_11, k_12, k_22 = trial, s_t, left, t_11, t_12, t_22
                better = True
                break
            share *= 0.5
        if not better:
            break
        size = math.hypot(r[0], r[1])
    return e[0], e[1], s_e[0], s_e[1], taken


@inlined
def _above(z: NDArray[np.float64], bearing: Index, p: NDArray[np.float64]) -> Pair:
    """Return the place of the line through the disc above an end."""
    arm = p[P_A] if bearing == 0 else -p[P_B]
    return z[0] + arm * z[2], z[1] + arm * z[3]


@kernel
def _step(
    t: float,
    tau: float,
    i: int,
    z: NDArray[np.float64],
    f: NDArray[np.float64],
    plan: RotorPlan,
    work: RotorWork,
    tally: NDArray[np.int64],
) -> None:
    """Carry the state ``z`` and the acceleration of the disc ``f`` by ``tau``, which lies in interval i."""
    p = plan.parameter
    bent_a, bent_b = _above(z, np.int64(0), p), _above(z, np.int64(1), p)
    bent_a, bent_b = (bent_a[0] - z[4], bent_a[1] - z[5]), (bent_b[0] - z[6], bent_b[1] - z[7])
    for k in range(4):
        z[k] += tau * (z[8 + k] + 0.5 * tau * f[k])
    fill_start(t + tau, p, work.turn)
    fill_depth(t + tau, 0.0, i, plan, work.depth)
    a_1, a_2, fa_1, fa_2, taken = _balance(
        _above(z, np.int64(0), p), (z[4], z[5]), bent_a, np.int64(0), tau, plan, work
    )
    tally[0] += taken
    tally[1] = max(tally[1], taken)
    b_1, b_2, fb_1, fb_2, taken = _balance(
        _above(z, np.int64(1), p), (z[6], z[7]), bent_b, np.int64(1), tau, plan, work
    )
    tally[0] += taken
    tally[1] = max(tally[1], taken)
    z[4], z[5], z[6], z[7] = a_1, a_2, b_1, b_2
    turned = (work.turn[0, 4], work.turn[0, 5])
    new = (f[0], f[1], f[2], f[3])
    # The damping and the gyroscopic moment at the end depend on what is sought, weakly.
    for _ in range(_CORRECTIONS):
        v = (
            z[8] + 0.5 * tau * (f[0] + new[0]),
            z[9] + 0.5 * tau * (f[1] + new[1]),
            z[10] + 0.5 * tau * (f[2] + new[2]),
            z[11] + 0.5 * tau * (f[3] + new[3]),
        )
        new = disc_acceleration(v, (fa_1, fa_2), (fb_1, fb_2), turned, p)
    for k in range(4):
        z[8 + k] += 0.5 * tau * (f[k] + new[k])
        f[k] = new[k]


@kernel
def run_massless(
    state: NDArray[np.float64],
    wave: NDArray[np.float64],
    place: NDArray[np.float64],
    h: float,
    plan: RotorPlan,
    tally: NDArray[np.int64],
) -> int:
    """Carry a state from t = 0 over the steps of ``wave``, of h seconds each.

    Args:
        state: (12,), overwritten.
        wave: acceleration of C in the sensor's direction at the beginning of each step, (steps, 1), m/s2.
        place: the first eight values of the state then, (steps, 8), or (0, 8) where they are not wanted.
        tally: iterations of Newton's method, all and the most of one solution, (2,), added to.

    Returns:
        A STATUS_ number.
    """
    work, p = new_work(plan), plan.parameter
    f = np.zeros(4)
    z = state.copy()
    k_a, k_b = p[P_PER_BEARING + B_SPRING], p[P_PER_BEARING + B_SIZE + B_SPRING]
    a, b = _above(z, np.int64(0), p), _above(z, np.int64(1), p)
    begin = disc_acceleration(
        (z[8], z[9], z[10], z[11]),
        (k_a * (a[0] - z[4]), k_a * (a[1] - z[5])),
        (k_b * (b[0] - z[6]), k_b * (b[1] - z[7])),
        (1.0, 0.0),
        p,
    )
    for k in range(4):
        f[k] = begin[k]
    i, d_1, d_2 = 0, p[P_DIRECTION_1], p[P_DIRECTION_2]
    for n in range(wave.shape[0]):
        t, end = n * h, (n + 1) * h
        c, s = math.cos(p[P_SHAFT] * t), math.sin(p[P_SHAFT] * t)
        wave[n, 0] = (f[0] + p[P_BOW_1] * c - p[P_BOW_2] * s) * d_1 + (f[1] + p[P_BOW_2] * c + p[P_BOW_1] * s) * d_2
        for k in range(place.shape[1] if place.shape[0] > 0 else 0):
            place[n, k] = z[k]
        while end - t > TINY:
            while plan.bounds[i + 1] - t <= TINY:
                i += 1
            tau = min(end, plan.bounds[i + 1]) - t
            _step(t, tau, i, z, f, plan, work, tally)
            t += tau
    for k in range(12):
        state[k] = z[k]
    return STATUS_OK if np.all(np.isfinite(state)) else STATUS_NOT_FINITE
