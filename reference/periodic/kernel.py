"""Compiled right-hand side and DOP853 over one ball period of the six-degree-of-freedom model, balls or rollers.

Axis 1 points from the centre to the loaded zone, axis 2 across it; theta is the cage angle since the period began. The
state y (12) holds, for both axes each, u: inner ring less outer ring, o: outer ring, e: resonator less outer ring, as
deviations from the static equilibrium, m, and then their velocities, m/s.

With n = (cos, sin) of an element's angle, U the true relative displacement and V its velocity,

    delta = U.n - d - h,    delta' = V.n + U.n' - omega_c d'(phi),    f = k_c delta^m + c delta',  delta > 0,
    c = alpha_c m_b + beta_c k_c delta^(m - 1),

with m = 3/2 for balls and 10/9 for rollers. Eqs. 38 and 39 define c by the secant stiffness f_c / delta, without the
factor m of the tangent stiffness; rollers take the same rule with their own exponent.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numba
import numpy as np

from reference.periodic.tableau import ERROR_3, ERROR_5, STAGES, A, B, C

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

# Places in ``p``.
(
    P_M_I,
    P_M_O,
    P_M_R,
    P_K_I,
    P_C_I,
    P_K_R,
    P_C_R,
    P_K_C,
    P_EXPONENT,
    P_DAMPING,  # alpha_c m_b, N s/m
    P_BETA,  # beta_c k_c
    P_CLEARANCE,
    P_OMEGA,
    P_LOAD,
    P_APPROACH,  # static relative displacement along the load, m
    P_PITCH,
    P_RACE,
    P_ELEMENT,  # radius of the rolling element, m
    P_COSINE,
    P_HALF,
    P_DEPTH,
    P_POSITION,
    P_ROUGHNESS,
    P_SPACING,
) = range(24)
PARAMETERS = 24

# What an element does in an interval (``code``).
ON_RACE, ON_ENTRY, ON_EXIT, ON_FLOOR, PAST_REACH = range(5)

# Quadratures over the period: square of a_o, work put in, work of damping, and a_o by cosine and sine of six lines.
LINES = 6
SUMS = 3 + 2 * LINES
NO_ERROR, TOO_MANY_STEPS, NOT_FINITE = range(3)
SAFETY, SHRINK, GROW, EVENT_CARE = 0.9, 0.333, 6.0, 100.0


@numba.njit(cache=True)
def edge_depth(b: float, race: float, element: float) -> tuple[float, float]:
    """Return depth, m, and slope, m/rad, of Eq. 51 an angle b beyond an edge, written without cancellation."""
    s, c = math.sin(b), math.cos(b)
    root = math.sqrt(max((element - race * s) * (element + race * s), 1e-30))
    sagitta = 2.0 * math.sin(0.5 * b) ** 2
    return race * race * s * s / (element + root) - race * sagitta, race * s * (race * c / root - 1.0)


@numba.njit(cache=True)
def floor_depth(x: float, p: Floats, rough: Floats) -> tuple[float, float]:
    """Return depth, m, and slope, m/rad, of the floor at an angle of the race.

    ``rough`` (pieces, 4) holds the cubic pieces of the rough profile, lowest power first.
    """
    pieces = rough.shape[0]
    if pieces == 0:
        return p[P_DEPTH], 0.0
    place = x / p[P_SPACING]
    k = math.floor(place)
    t = (place - k) * p[P_SPACING]
    k = int(k) % pieces
    height = rough[k, 0] + t * (rough[k, 1] + t * (rough[k, 2] + t * rough[k, 3]))
    slope = rough[k, 1] + t * (2.0 * rough[k, 2] + t * 3.0 * rough[k, 3])
    return p[P_DEPTH] + p[P_ROUGHNESS] * height, p[P_ROUGHNESS] * slope


@numba.njit(cache=True)
def path_at(code: int, x: float, p: Floats, rough: Floats) -> tuple[float, float]:
    """Return d, m, and d', m/rad, at an angle x from the defect's centre, on the branch that ``code`` names."""
    if code == ON_FLOOR:
        d, slope = floor_depth(x + p[P_POSITION], p, rough)
    elif code == ON_ENTRY:
        d, slope = edge_depth(x + p[P_HALF], p[P_RACE], p[P_ELEMENT])
    elif code == ON_EXIT:
        d, slope = edge_depth(p[P_HALF] - x, p[P_RACE], p[P_ELEMENT])
        slope = -slope
    elif code == PAST_REACH:
        d, slope = edge_depth(math.asin(p[P_ELEMENT] / p[P_RACE]), p[P_RACE], p[P_ELEMENT])[0], 0.0
    else:
        d, slope = 0.0, 0.0
    return p[P_COSINE] * d, p[P_COSINE] * slope


@numba.njit(cache=True)
def derivative(
    theta: float,
    y: Floats,
    dy: Floats,
    place: float,
    code: NDArray[np.int8],
    middle: Floats,
    directions: Floats,
    p: Floats,
    rough: Floats,
) -> tuple[float, float, float, int]:
    """Write dy/dt; return a_o along the load, m/s2, the powers put in and lost, W, and a bit per element in contact.

    ``code`` and ``middle`` (elements): branch of each element's path, and its angle from the defect's centre where the
    cage angle is ``place``. ``directions`` (elements, 2): cosine and sine at cage angle zero.
    """
    c, s = math.cos(theta), math.sin(theta)
    omega = p[P_OMEGA]
    u1, u2 = p[P_APPROACH] + y[0], y[1]
    w1, w2 = y[6] + omega * u2, y[7] - omega * u1
    exponent = p[P_EXPONENT] - 1.0
    f1, f2, driven, lost, touching = -p[P_LOAD], 0.0, 0.0, 0.0, 0
    for j in range(directions.shape[0]):
        n1 = c * directions[j, 0] - s * directions[j, 1]
        n2 = s * directions[j, 0] + c * directions[j, 1]
        delta = u1 * n1 + u2 * n2 - p[P_CLEARANCE]
        if delta <= 0.0:
            continue
        slope = 0.0
        if code[j] != ON_RACE:
            d, slope = path_at(code[j], middle[j] + (theta - place), p, rough)
            delta -= d
            if delta <= 0.0:
                continue
        touching |= 1 << j
        power = math.sqrt(delta) if exponent == 0.5 else delta**exponent
        rate = w1 * n1 + w2 * n2 - omega * slope
        damping = (p[P_DAMPING] + p[P_BETA] * power) * rate
        force = p[P_K_C] * power * delta + damping
        f1 += force * n1
        f2 += force * n2
        driven += force * omega * (u2 * n1 - u1 * n2 - slope)
        lost += damping * rate
    for axis in range(2):
        f = f1 if axis == 0 else f2
        v_o, v_e = y[8 + axis], y[10 + axis]
        v_i = y[6 + axis] + v_o
        pull = p[P_K_R] * y[4 + axis] + p[P_C_R] * v_e
        inner = (-f - p[P_K_I] * (y[axis] + y[2 + axis]) - p[P_C_I] * v_i) / p[P_M_I]
        outer = (f + pull) / p[P_M_O]
        dy[axis], dy[2 + axis], dy[4 + axis] = y[6 + axis], v_o, v_e
        dy[6 + axis], dy[8 + axis], dy[10 + axis] = inner - outer, outer, -pull / p[P_M_R] - outer
        lost += p[P_C_I] * v_i * v_i + p[P_C_R] * v_e * v_e
    return dy[8], driven, lost, touching


@numba.njit(cache=True)
def add_sums(
    sums: Floats, weight: float, theta: float, lines_per_rad: float, a: float, driven: float, lost: float
) -> None:
    """Add one node of the quadratures."""
    sums[0] += weight * a * a
    sums[1] += weight * driven
    sums[2] += weight * lost
    c1, s1 = math.cos(lines_per_rad * theta), math.sin(lines_per_rad * theta)
    c, s = c1, s1
    for k in range(LINES):
        sums[3 + 2 * k] += weight * a * c
        sums[4 + 2 * k] += weight * a * s
        c, s = c * c1 - s * s1, s * c1 + c * s1


@numba.njit(cache=True)
def crest(times: Floats, values: Floats) -> float:
    """Return the extreme value, without sign, of the parabola through three values, where it lies between them."""
    largest = max(abs(values[0]), abs(values[1]), abs(values[2]))
    left, right = times[1] - times[0], times[2] - times[1]
    if left <= 0.0 or right <= 0.0:
        return largest
    before, after = (values[1] - values[0]) / left, (values[2] - values[1]) / right
    curvature = (after - before) / (left + right)
    slope = (before * right + after * left) / (left + right)
    if curvature == 0.0 or before * after >= 0.0:
        return largest
    return max(largest, abs(values[1] - 0.25 * slope * slope / curvature))


@numba.njit(cache=True)
def push(times: Floats, values: Floats, t: float, value: float, seen: int) -> int:
    """Keep the last three values and times; return how many there are now."""
    times[0], times[1], times[2] = times[1], times[2], t
    values[0], values[1], values[2] = values[1], values[2], value
    return min(seen + 1, 3)


@numba.njit(cache=True)
def attempt(
    theta: float,
    h: float,
    y: Floats,
    trial: Floats,
    nodes: Floats,
    scale: Floats,
    place: float,
    code: NDArray[np.int8],
    middle: Floats,
    directions: Floats,
    p: Floats,
    rough: Floats,
) -> float:
    """Write the state a step of h s later to ``trial`` and the stages' values of the sums to ``nodes`` (STAGES, 3).

    Return the estimated error of the step in units of ``scale`` (Hairer's combination of orders 5 and 3), times
    EVENT_CARE where a contact opens or closes within the step: the force is not smooth there, and the estimate with it.
    """
    k, stage = np.empty((STAGES, 12)), np.empty(12)
    before, care = 0, 1.0
    for i in range(STAGES):
        for m in range(12):
            stage[m] = y[m]
        for j in range(i):
            factor = h * A[i, j]
            if factor != 0.0:
                for m in range(12):
                    stage[m] += factor * k[j, m]
        where = theta + p[P_OMEGA] * C[i] * h
        a, driven, lost, touching = derivative(where, stage, k[i], place, code, middle, directions, p, rough)
        nodes[i, 0], nodes[i, 1], nodes[i, 2] = a, driven, lost
        if i > 0 and touching != before:
            care = EVENT_CARE
        before = touching
    fifth, third = 0.0, 0.0
    for m in range(12):
        total, e5, e3 = 0.0, 0.0, 0.0
        for i in range(STAGES):
            total += B[i] * k[i, m]
            e5 += ERROR_5[i] * k[i, m]
            e3 += ERROR_3[i] * k[i, m]
        trial[m] = y[m] + h * total
        fifth += (e5 / scale[m // 2]) ** 2
        third += (e3 / scale[m // 2]) ** 2
    e5, e3 = 0.0, 0.0
    for i in range(STAGES):
        e5 += ERROR_5[i] * nodes[i, 0] ** 2
        e3 += ERROR_3[i] * nodes[i, 0] ** 2
    fifth += (e5 / scale[6]) ** 2
    third += (e3 / scale[6]) ** 2
    norm = math.sqrt(13.0 * (fifth + 0.01 * third))
    return care * h * fifth / norm if norm > 0.0 else 0.0


@numba.njit(cache=True)
def fitted(h: float, left: float) -> tuple[float, bool]:
    """Return the step to try where ``left`` s remain of an interval, and whether it ends there."""
    if h >= 0.999 * left:
        return left, True
    return (0.5 * left if h > 0.55 * left else h), False


@numba.njit(cache=True)
def accept(
    y: Floats, trial: Floats, nodes: Floats, theta: float, h: float, p: Floats, sums: Floats, largest: Floats
) -> None:
    """Take a step of h s: add its share to ``sums``, write the new state to ``y``, and keep the largest values."""
    lines_per_rad = 2.0 * math.pi / p[P_PITCH]
    for i in range(STAGES):
        if B[i] != 0.0:
            where = theta + p[P_OMEGA] * C[i] * h
            add_sums(sums, B[i] * h, where, lines_per_rad, nodes[i, 0], nodes[i, 1], nodes[i, 2])
    for m in range(12):
        y[m] = trial[m]
        largest[m // 2] = max(largest[m // 2], abs(trial[m]))


@numba.njit(cache=True)
def ball_period(
    y: Floats,
    begin: float,
    tolerance: float,
    scale: Floats,
    bounds: Floats,
    codes: NDArray[np.int8],
    middles: Floats,
    directions: Floats,
    p: Floats,
    rough: Floats,
    most: int,
    sums: Floats,
    largest: Floats,
) -> tuple[int, int, float, float]:
    """Carry ``y`` over one ball period with DOP853; steps end at ``bounds`` (intervals + 1), rad of cage angle.

    ``begin`` is the first step tried, s; ``scale`` (7) the sizes to which ``tolerance`` refers: of u, o, e, of their
    velocities, and of the first of ``sums``. ``sums`` (SUMS) and ``largest`` (6, largest absolute values of the groups
    of the state) are written. Return a status, the steps tried, the next step, s, and the largest absolute a_o, m/s2.
    """
    omega = p[P_OMEGA]
    trial, nodes, dy = np.empty(12), np.empty((STAGES, 3)), np.empty(12)
    times, values = np.zeros(3), np.zeros(3)
    h, steps, peak = begin, 0, 0.0
    sums[:] = 0.0
    largest[:] = 0.0
    for interval in range(bounds.shape[0] - 1):
        code, middle = codes[interval], middles[interval]
        place = 0.5 * (bounds[interval] + bounds[interval + 1])
        span = (bounds[interval + 1] - bounds[interval]) / omega
        t, seen, growth = 0.0, 0, GROW
        while t < span:
            whole = h
            h, last = fitted(h, span - t)
            steps += 1
            if steps > most:
                return TOO_MANY_STEPS, steps, h, peak
            theta = bounds[interval] + omega * t
            error = attempt(theta, h, y, trial, nodes, scale, place, code, middle, directions, p, rough) / tolerance
            if not error <= 1.0:
                h *= max(SHRINK, SAFETY * error**-0.125) if math.isfinite(error) else 0.1
                growth = 1.0
                if h < 1e-20:
                    return NOT_FINITE, steps, h, peak
                continue
            accept(y, trial, nodes, theta, h, p, sums, largest)
            seen = push(times, values, t, nodes[0, 0], seen)
            peak = max(peak, crest(times, values) if seen > 2 else abs(nodes[0, 0]))
            t = span if last else t + h
            h *= min(growth, SAFETY * error**-0.125) if error > 0.0 else growth
            growth = GROW
            if last:
                # A step that the end of an interval cut short says little about the next one.
                h = max(whole, h)
        a, _, _, _ = derivative(bounds[interval + 1], y, dy, place, code, middle, directions, p, rough)
        seen = push(times, values, span, a, seen)
        peak = max(peak, crest(times, values) if seen > 2 else abs(a))
    return NO_ERROR, steps, h, peak
