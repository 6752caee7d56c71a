"""Kernel of the six-degree-of-freedom model simulated over time, for scenes whose motion has no ball period.

Coordinates, scheme (Lawson-RK4) and contact law are those of ``models.kernels.six_dof``. What differs:

* Samples stand at whole multiples of one step h. Events (a ball meets a kink of its path, the cage has turned by one
  pitch) fall where they fall; a step that contains one is split there, with propagators for its parts.
* Between two events every ball stays on one smooth piece of its path, or on none, and every ball of a row can be called
  by its place among the n ``slots`` in which the cage stands, counted from the last turn by one pitch. Which slot meets
  which piece is listed beforehand, so that the loop over time decides nothing.
* A step in which a ball meets or leaves its contact is taken again in SUBSTEPS parts.

Whether a scene has a path and a push is decided outside of the loops over balls.

Arguments, float64 and C-contiguous unless said, S slots, I intervals between events:

- ``parameter`` (PARAMETERS): see the P_ constants.
- ``slots`` (3, S): cosine and sine of the slots' angles and a distinct power of two, sorted by distance from the load.
- ``near``: how many of them can be touched while the displacement across the load is at most NEAR_SLOPE times that
  along it (all of them where the path may rise above the undamaged race).
- ``bounds`` (I + 1): times of the events, the first at or before the first sample, the last after the end, s.
- ``turns``, int64 (I): how many pitches the cage had turned.
- ``first``, int64 (I + 1), ``slot``, ``piece``, int64, and ``offset`` (records): the records of interval i are
  first[i] to first[i + 1]; ball in ``slot`` on ``piece`` at the path coordinate offset + rate * t.
- ``origin``, ``inverse_width``, ``cells_first`` (int64), ``cells``: the pieces, see ``models.path.contour.Pieces``.
- ``waves`` (W, 4): amplitude, m, rate of the phase in a slot, rad/s, its change by one turn, rad, and phase, rad.
- ``crests`` (W, 2, S): cosine and sine of order times the slots' angles.
- ``push`` (3): amplitude, N, angular speed, rad/s, and phase of a force that turns with the shaft.
- ``direction`` (2): the sensor's, along and across the load.
- ``wave`` (samples, 2), written: acceleration of outer ring and resonator in that direction, m/s2.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from models.kernels.jit import inlined, kernel
from models.kernels.six_dof import propagate

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.kernels.jit import Index

    Axis = tuple[float, float, float, float, float, float]
    Flow = tuple[float, float, float, float, float, float, float, float, float]
    # Whether the scene has a path, and a push.
    Uses = tuple[bool, bool]

NEAR_SLOPE = math.tan(math.radians(15.0))
SUBSTEPS = 8
# Parts of a step shorter than this are rounding, s.
TINY = 1e-13

STATUS_OK = 0
STATUS_NOT_FINITE = 1

# Places in ``parameter``.
P_K_C = 0  # contact stiffness, N/m^1.5
P_ALPHA = 1  # alpha_c m_b, N s/m
P_BETA = 2  # beta_c k_c, N s/m^1.5
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
P_RATE = 21  # rate of the path coordinate, rad/s
PARAMETERS = 22


class Plan(NamedTuple):
    """All that stays the same over a run; see the module for the arrays."""

    parameter: NDArray[np.float64]
    slots: NDArray[np.float64]
    near: int
    bounds: NDArray[np.float64]
    turns: NDArray[np.int64]
    first: NDArray[np.int64]
    slot: NDArray[np.int64]
    piece: NDArray[np.int64]
    offset: NDArray[np.float64]
    origin: NDArray[np.float64]
    inverse_width: NDArray[np.float64]
    cells_first: NDArray[np.int64]
    cells: NDArray[np.float64]
    waves: NDArray[np.float64]
    crests: NDArray[np.float64]
    push: NDArray[np.float64]
    direction: NDArray[np.float64]


class Nodes(NamedTuple):
    """What is known beforehand of the beginning, middle and end of a step: scratch of the kernel.

    ``turn`` (3, 2) cosine and sine of the cage angle, ``depth`` and ``rate`` (3, S) of the path, m and m/s, ``force``
    (3, 2) on the shaft, N.
    """

    turn: NDArray[np.float64]
    depth: NDArray[np.float64]
    rate: NDArray[np.float64]
    force: NDArray[np.float64]


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
        c, s = math.cosh(w * h), math.sinh(w * h) / w
    return decay * (c + half * s), decay * s, -decay * omega_squared * s, decay * (c - half * s)


@inlined
def _propagators(p: NDArray[np.float64], h: float) -> Flow:
    """Return what carries half a step of length h."""
    a = oscillator(p[P_SQUARE_I], p[P_DAMPING_I], 0.5 * h)
    b = oscillator(p[P_SQUARE_R], p[P_DAMPING_R], 0.5 * h)
    return (a[0], a[1], a[2], a[3], 0.5 * h, b[0], b[1], b[2], b[3])


@inlined
def _kick(x: Axis, h: float, contact: float, shaft: float, p: NDArray[np.float64]) -> Axis:
    """Return the state after the contact force and a force on the shaft have acted for a time h."""
    return (
        x[0],
        x[1] + h * (shaft - contact) * p[P_INV_M_I],
        x[2],
        x[3] + h * contact * p[P_INV_M],
        x[4],
        x[5] + h * contact * p[P_INV_M_O],
    )


@inlined
def _contact(x1: Axis, x2: Axis, plan: Plan, nodes: Nodes, node: Index, uses: Uses) -> tuple[float, float, float]:
    """Return the contact force on the outer ring minus the static one, N, along and across the load (Eqs. 35-48), and
    the sum of the powers of two of all balls in contact.
    """
    p = plan.parameter
    slots, depth, rate = plan.slots, nodes.depth, nodes.rate
    share, omega, clearance = p[P_SHARE_R], p[P_OMEGA], p[P_CLEARANCE]
    k_c, alpha, beta = p[P_K_C], p[P_ALPHA], p[P_BETA]
    u1 = p[P_U_1] + x1[0] - x1[2] - share * x1[4]
    u2 = p[P_U_2] + x2[0] - x2[2] - share * x2[4]
    w1 = x1[1] - x1[3] - share * x1[5] + omega * u2
    w2 = x2[1] - x2[3] - share * x2[5] - omega * u1
    c, s = nodes.turn[node, 0], nodes.turn[node, 1]
    p1, p2 = c * u1 + s * u2, c * u2 - s * u1
    q1, q2 = c * w1 + s * w2, c * w2 - s * w1
    f1 = 0.0
    f2 = 0.0
    mask = 0.0
    count = plan.near if abs(u2) <= NEAR_SLOPE * u1 else slots.shape[1]
    for j in range(count):
        delta = p1 * slots[0, j] + p2 * slots[1, j] - clearance
        speed = q1 * slots[0, j] + q2 * slots[1, j]
        if uses[0]:
            delta -= depth[node, j]
            speed -= rate[node, j]
        touching = 1.0 if delta > 0.0 else 0.0
        pressed = max(delta, 0.0)
        root = math.sqrt(pressed)
        force = k_c * pressed * root + (alpha * touching + beta * root) * speed
        f1 += force * slots[0, j]
        f2 += force * slots[1, j]
        mask += touching * slots[2, j]
    return c * f1 - s * f2 - p[P_LOAD_1], s * f1 + c * f2 - p[P_LOAD_2], mask


@inlined
def _step(
    x1: Axis, x2: Axis, h: float, e: Flow, plan: Plan, nodes: Nodes, uses: Uses
) -> tuple[Axis, Axis, float, float, bool]:
    """Return both axes after one Lawson-RK4 step, the contact force at its start, and whether a contact changed."""
    p, f = plan.parameter, nodes.force
    a1, a2, mask = _contact(x1, x2, plan, nodes, np.int64(0), uses)
    y1, y2 = propagate(x1, e), propagate(x2, e)
    z1, z2 = _kick(x1, 0.5 * h, a1, f[0, 0], p), _kick(x2, 0.5 * h, a2, f[0, 1], p)
    z1, z2 = propagate(z1, e), propagate(z2, e)
    x1, x2 = _kick(x1, h / 6.0, a1, f[0, 0], p), _kick(x2, h / 6.0, a2, f[0, 1], p)
    x1, x2 = propagate(x1, e), propagate(x2, e)
    g1, g2, mask_2 = _contact(z1, z2, plan, nodes, np.int64(1), uses)
    x1, x2 = _kick(x1, h / 3.0, g1, f[1, 0], p), _kick(x2, h / 3.0, g2, f[1, 1], p)
    z1, z2 = _kick(y1, 0.5 * h, g1, f[1, 0], p), _kick(y2, 0.5 * h, g2, f[1, 1], p)
    g1, g2, mask_3 = _contact(z1, z2, plan, nodes, np.int64(1), uses)
    x1, x2 = _kick(x1, h / 3.0, g1, f[1, 0], p), _kick(x2, h / 3.0, g2, f[1, 1], p)
    z1, z2 = _kick(y1, h, g1, f[1, 0], p), _kick(y2, h, g2, f[1, 1], p)
    z1, z2 = propagate(z1, e), propagate(z2, e)
    g1, g2, mask_4 = _contact(z1, z2, plan, nodes, np.int64(2), uses)
    x1, x2 = propagate(x1, e), propagate(x2, e)
    x1, x2 = _kick(x1, h / 6.0, g1, f[2, 0], p), _kick(x2, h / 6.0, g2, f[2, 1], p)
    return x1, x2, a1, a2, mask != mask_2 or mask != mask_3 or mask != mask_4


@inlined
def _fill_turn(t: float, half: tuple[float, float], turned: int, plan: Plan, nodes: Nodes) -> None:
    """Write the cage angle; ``half`` is cosine and sine of its turn in half a step."""
    angle = plan.parameter[P_OMEGA] * t - turned * plan.parameter[P_PITCH]
    c, s = math.cos(angle), math.sin(angle)
    for node in range(3):
        nodes.turn[node, 0], nodes.turn[node, 1] = c, s
        c, s = c * half[0] - s * half[1], s * half[0] + c * half[1]


@kernel
def _fill_path(t: float, h: float, interval: int, plan: Plan, nodes: Nodes) -> None:
    """Write how far the path has receded from every slot, and how fast, at the three nodes of a step."""
    along = plan.parameter[P_RATE]
    for node in range(3):
        there = t + 0.5 * h * node
        for j in range(plan.slots.shape[1]):
            nodes.depth[node, j] = 0.0
            nodes.rate[node, j] = 0.0
        for k in range(plan.waves.shape[0]):
            amplitude, speed = plan.waves[k, 0], plan.waves[k, 1]
            phase = speed * there - plan.turns[interval] * plan.waves[k, 2] + plan.waves[k, 3]
            c, s = amplitude * math.cos(phase), amplitude * math.sin(phase)
            for j in range(plan.slots.shape[1]):
                nodes.depth[node, j] += c * plan.crests[k, 0, j] - s * plan.crests[k, 1, j]
                nodes.rate[node, j] -= speed * (s * plan.crests[k, 0, j] + c * plan.crests[k, 1, j])
        for r in range(plan.first[interval], plan.first[interval + 1]):
            piece = plan.piece[r]
            low, high = plan.cells_first[piece], plan.cells_first[piece + 1]
            x = (plan.offset[r] + along * there - plan.origin[piece]) * plan.inverse_width[piece]
            cell = min(max(int(x), 0), high - low - 1)
            x -= cell
            a = plan.cells[low + cell]
            nodes.depth[node, plan.slot[r]] += a[0] + x * (a[1] + x * (a[2] + x * a[3]))
            slope = (a[1] + x * (2.0 * a[2] + x * 3.0 * a[3])) * plan.inverse_width[piece]
            nodes.rate[node, plan.slot[r]] += along * slope


@inlined
def _fill_push(t: float, h: float, plan: Plan, nodes: Nodes) -> None:
    """Write the force that turns with the shaft."""
    for node in range(3):
        angle = plan.push[1] * (t + 0.5 * h * node) + plan.push[2]
        nodes.force[node, 0] = plan.push[0] * math.cos(angle)
        nodes.force[node, 1] = plan.push[0] * math.sin(angle)


@inlined
def _fill(t: float, h: float, half: tuple[float, float], interval: int, plan: Plan, nodes: Nodes, uses: Uses) -> None:
    """Write all that is known beforehand of a step of length h that begins at t."""
    _fill_turn(t, half, plan.turns[interval], plan, nodes)
    if uses[0]:
        _fill_path(t, h, interval, plan, nodes)
    if uses[1]:
        _fill_push(t, h, plan, nodes)


@kernel
def _parts(
    x1: Axis, x2: Axis, t: float, length: float, parts: Index, interval: int, plan: Plan, nodes: Nodes, uses: Uses
) -> tuple[Axis, Axis, float, float, bool]:
    """Return what ``_step`` does, for a time of any length, taken in some parts."""
    h = length / parts
    e = _propagators(plan.parameter, h)
    angle = 0.5 * h * plan.parameter[P_OMEGA]
    half = (math.cos(angle), math.sin(angle))
    f1, f2, changed = 0.0, 0.0, False
    for part in range(parts):
        here = t + part * h
        _fill(here, h, half, interval, plan, nodes, uses)
        x1, x2, g1, g2, change = _step(x1, x2, h, e, plan, nodes, uses)
        if part == 0:
            f1, f2 = g1, g2
        changed = changed or change
    return x1, x2, f1, f2, changed


@inlined
def _record(wave: NDArray[np.float64], n: int, x1: Axis, x2: Axis, force: tuple[float, float], plan: Plan) -> None:
    """Write the accelerations in the sensor's direction from the equation of motion at the state (Eq. 44)."""
    p, d = plan.parameter, plan.direction
    spring = d[0] * (p[P_K_R] * x1[4] + p[P_C_R] * x1[5]) + d[1] * (p[P_K_R] * x2[4] + p[P_C_R] * x2[5])
    wave[n, 0] = (d[0] * force[0] + d[1] * force[1] - spring) * p[P_INV_M_O]
    wave[n, 1] = spring * p[P_INV_M_R]


@kernel
def _broken_step(
    x1: Axis, x2: Axis, t: float, end: float, i: int, plan: Plan, nodes: Nodes, uses: Uses
) -> tuple[Axis, Axis, float, float, int]:
    """Return both axes at ``end``, the contact force at ``t`` and the interval at ``end``: events lie between."""
    f1, f2, at_start = 0.0, 0.0, True
    while end - t > TINY:
        while plan.bounds[i + 1] <= t + TINY:
            i += 1
        stop = min(end, plan.bounds[i + 1])
        y1, y2, g1, g2, changed = _parts(x1, x2, t, stop - t, np.int64(1), i, plan, nodes, uses)
        if changed:
            y1, y2, g1, g2, changed = _parts(x1, x2, t, stop - t, np.int64(SUBSTEPS), i, plan, nodes, uses)
        if at_start:
            f1, f2, at_start = g1, g2, False
        x1, x2, t = y1, y2, stop
    return x1, x2, f1, f2, i


@kernel
def run(state: NDArray[np.float64], wave: NDArray[np.float64], h: float, plan: Plan) -> int:
    """Carry ``state`` (2, 6), deviations from the static equilibrium at t = 0, over the samples of ``wave``.

    They are ``h`` seconds apart. ``state`` is overwritten; a STATUS_ number is returned.
    """
    x1 = (state[0, 0], state[0, 1], state[0, 2], state[0, 3], state[0, 4], state[0, 5])
    x2 = (state[1, 0], state[1, 1], state[1, 2], state[1, 3], state[1, 4], state[1, 5])
    uses = (plan.waves.shape[0] > 0 or plan.slot.shape[0] > 0, plan.push[0] != 0.0)
    size = plan.slots.shape[1]
    nodes = Nodes(np.empty((3, 2)), np.zeros((3, size)), np.zeros((3, size)), np.zeros((3, 2)))
    e = _propagators(plan.parameter, h)
    angle = 0.5 * h * plan.parameter[P_OMEGA]
    half = (math.cos(angle), math.sin(angle))
    i = 0
    for n in range(wave.shape[0]):
        t, end = n * h, (n + 1) * h
        while plan.bounds[i + 1] <= t + TINY:
            i += 1
        whole = plan.bounds[i + 1] >= end - TINY
        g1, g2, y1, y2, changed = 0.0, 0.0, x1, x2, True
        if whole:
            _fill(t, h, half, i, plan, nodes, uses)
            y1, y2, g1, g2, changed = _step(x1, x2, h, e, plan, nodes, uses)
        if whole and changed:
            y1, y2, g1, g2, _ = _parts(x1, x2, t, h, np.int64(SUBSTEPS), i, plan, nodes, uses)
        if not whole:
            y1, y2, g1, g2, i = _broken_step(x1, x2, t, end, i, plan, nodes, uses)
        _record(wave, n, x1, x2, (g1, g2), plan)
        x1, x2 = y1, y2
    bad = False
    for k in range(6):
        state[0, k], state[1, k] = x1[k], x2[k]
        bad = bad or not math.isfinite(x1[k]) or not math.isfinite(x2[k])
    return STATUS_NOT_FINITE if bad else STATUS_OK
