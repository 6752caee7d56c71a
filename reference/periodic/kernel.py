"""Compiled right-hand side of the six-degree-of-freedom model, balls or rollers, several defects, waves of the race.

Axis 1 points from the centre to the loaded zone, axis 2 across it; theta is the cage angle since the period began. The
state y (12) holds, for both axes each, u: inner ring less outer ring, o: outer ring, e: resonator less outer ring, as
deviations from the static equilibrium, m, and then their velocities, m/s.

With n = (cos, sin) of an element's angle phi, U the true relative displacement and V its velocity,

    delta = U.n - d - h,    delta' = V.n + U.n' - omega_c d'(phi),    f = k_c delta^m + c delta',  delta > 0,
    c = alpha_c m_b + beta_c k_c delta^(m - 1),

with m = 3/2 for balls and 10/9 for rollers. Eqs. 38 and 39 define c by the secant stiffness f_c / delta, without the
factor m of the tangent stiffness; rollers take the same rule with their own exponent. The path d is that of a defect
plus that of the waves of the race, each of which recedes by a cos(alpha) cos(order phi + phase).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numba
import numpy as np

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
    P_SPACING,  # of the pieces of the rough profile, rad
) = range(20)
PARAMETERS = 20

# Places in a row of ``pits``: half the extent, rad, depth, m, centre, rad, and factor on the rough profile.
PIT_HALF, PIT_DEPTH, PIT_POSITION, PIT_ROUGHNESS = range(4)
# Places in a row of ``waves``: amplitude along the contact, m, waves around the race, and phase, rad.
WAVE_AMPLITUDE, WAVE_ORDER, WAVE_PHASE = range(3)

# What an element does in an interval: its ``code`` is BRANCHES times the number of its pit, plus one of these.
ON_RACE, ON_ENTRY, ON_EXIT, ON_FLOOR, PAST_REACH = range(5)
BRANCHES = 5


class Model(NamedTuple):
    """One scene in arrays.

    Attributes:
        p: see the P_ constants, (PARAMETERS,).
        directions: cosine, sine and angle, rad, of each element at cage angle zero, (elements, 3).
        pits: see the PIT_ constants, (defects, 4).
        waves: see the WAVE_ constants, (waves, 3).
        rough: cubic pieces of the rough profile, lowest power first, (pieces, 4); none where the floors are smooth.
    """

    p: Floats
    directions: Floats
    pits: Floats
    waves: Floats
    rough: Floats


class Piece(NamedTuple):
    """An interval of cage angles in which the path of every element is smooth.

    Attributes:
        place: a cage angle within it, rad.
        code: of each element, (elements,).
        middle: angle of each element from the centre of its defect where the cage angle is ``place``, rad.
    """

    place: float
    code: NDArray[np.int8]
    middle: Floats


@numba.njit(cache=True)
def edge_depth(b: float, race: float, element: float) -> tuple[float, float]:
    """Return depth, m, and slope, m/rad, of Eq. 51 an angle b beyond an edge, written without cancellation."""
    s, c = math.sin(b), math.cos(b)
    root = math.sqrt(max((element - race * s) * (element + race * s), 1e-30))
    sagitta = 2.0 * math.sin(0.5 * b) ** 2
    return race * race * s * s / (element + root) - race * sagitta, race * s * (race * c / root - 1.0)


@numba.njit(cache=True)
def floor_depth(x: float, pit: int, model: Model) -> tuple[float, float]:
    """Return depth, m, and slope, m/rad, of the floor of a defect at an angle of the race."""
    rough, spacing = model.rough, model.p[P_SPACING]
    depth, roughness = model.pits[pit, PIT_DEPTH], model.pits[pit, PIT_ROUGHNESS]
    pieces = rough.shape[0]
    if pieces == 0:
        return depth, 0.0
    place = x / spacing
    k = math.floor(place)
    t = (place - k) * spacing
    k = int(k) % pieces
    height = rough[k, 0] + t * (rough[k, 1] + t * (rough[k, 2] + t * rough[k, 3]))
    slope = rough[k, 1] + t * (2.0 * rough[k, 2] + t * 3.0 * rough[k, 3])
    return depth + roughness * height, roughness * slope


@numba.njit(cache=True)
def path_at(code: int, x: float, model: Model) -> tuple[float, float]:
    """Return d, m, and d', m/rad, at an angle x from the centre of a defect, on the branch that ``code`` names."""
    p = model.p
    pit, branch = code // BRANCHES, code % BRANCHES
    if branch == ON_FLOOR:
        d, slope = floor_depth(x + model.pits[pit, PIT_POSITION], pit, model)
    elif branch == ON_ENTRY:
        d, slope = edge_depth(x + model.pits[pit, PIT_HALF], p[P_RACE], p[P_ELEMENT])
    elif branch == ON_EXIT:
        d, slope = edge_depth(model.pits[pit, PIT_HALF] - x, p[P_RACE], p[P_ELEMENT])
        slope = -slope
    elif branch == PAST_REACH:
        d, slope = edge_depth(math.asin(p[P_ELEMENT] / p[P_RACE]), p[P_RACE], p[P_ELEMENT])[0], 0.0
    else:
        d, slope = 0.0, 0.0
    return p[P_COSINE] * d, p[P_COSINE] * slope


@numba.njit(cache=True)
def waves_at(phi: float, waves: Floats) -> tuple[float, float]:
    """Return by how much the race recedes at an angle from the load, m, and the slope of that, m/rad."""
    d, slope = 0.0, 0.0
    for w in range(waves.shape[0]):
        turn = waves[w, WAVE_ORDER] * phi + waves[w, WAVE_PHASE]
        d += waves[w, WAVE_AMPLITUDE] * math.cos(turn)
        slope -= waves[w, WAVE_AMPLITUDE] * waves[w, WAVE_ORDER] * math.sin(turn)
    return d, slope


@numba.njit(cache=True)
def gap_of(
    j: int, theta: float, c: float, s: float, y: Floats, piece: Piece, model: Model, lazy: bool
) -> tuple[float, float, float, float, float]:
    """Return direction (two components), delta, m, delta', m/s, and slope of the path, m/rad, of an element.

    ``c`` and ``s``: cosine and sine of the cage angle. ``lazy`` leaves out what does not matter without contact: a
    defect takes away from delta only.
    """
    p, directions = model.p, model.directions
    n1 = c * directions[j, 0] - s * directions[j, 1]
    n2 = s * directions[j, 0] + c * directions[j, 1]
    u1, u2 = p[P_APPROACH] + y[0], y[1]
    delta, slope = u1 * n1 + u2 * n2 - p[P_CLEARANCE], 0.0
    if model.waves.shape[0] > 0:
        d, slope = waves_at(theta + directions[j, 2], model.waves)
        delta -= d
    if lazy and delta <= 0.0:
        return n1, n2, delta, 0.0, slope
    code = piece.code[j]
    if code % BRANCHES != ON_RACE:
        d, more = path_at(code, piece.middle[j] + (theta - piece.place), model)
        delta -= d
        slope += more
    omega = p[P_OMEGA]
    rate = (y[6] + omega * u2) * n1 + (y[7] - omega * u1) * n2 - omega * slope
    return n1, n2, delta, rate, slope


@numba.njit(cache=True)
def gaps(theta: float, y: Floats, piece: Piece, model: Model, found: Floats) -> None:
    """Write delta, m, and delta', m/s, of every element to ``found``, (elements, 2)."""
    c, s = math.cos(theta), math.sin(theta)
    for j in range(model.directions.shape[0]):
        _, _, delta, rate, _ = gap_of(j, theta, c, s, y, piece, model, False)
        found[j, 0], found[j, 1] = delta, rate


@numba.njit(cache=True)
def derivative(theta: float, y: Floats, dy: Floats, piece: Piece, model: Model) -> tuple[float, float, float, int]:
    """Write dy/dt; return a_o along the load, m/s2, the powers put in and lost, W, and a bit per element in contact."""
    p = model.p
    c, s = math.cos(theta), math.sin(theta)
    omega, exponent = p[P_OMEGA], p[P_EXPONENT] - 1.0
    u1, u2 = p[P_APPROACH] + y[0], y[1]
    f1, f2, driven, lost, touching = -p[P_LOAD], 0.0, 0.0, 0.0, 0
    for j in range(model.directions.shape[0]):
        n1, n2, delta, rate, slope = gap_of(j, theta, c, s, y, piece, model, True)
        if delta <= 0.0:
            continue
        touching |= 1 << j
        power = math.sqrt(delta) if exponent == 0.5 else delta**exponent
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
