"""Kernels of the six-degree-of-freedom model for many scenes at once: one scene a lane, Lawson-RK4 with equal steps.

Coordinates, equations and signs are those of models/solve/six_dof/kernels/step.py. The layout is made for vector
instructions: LANES scenes of one bearing, rig, clearance and speed stand side by side in the last, contiguous axis of
every array, and the innermost loops hold no branch, no trigonometry and no evaluation of a path. All lanes share the
cage angle; displacements are turned into the frame of the cage, in which the direction of a ball is constant.

Slots. A slot is a ball position at the start of a period, an arc of one ball pitch that some ball passes in each
period. Slots that the defect of any lane can touch are ``damaged`` and read depth and rate from a table; the others are
``plain``, sorted by angle from -pi to pi. While the displacement across the load is at most NEAR_SLOPE times that along
it in every lane, only plain slots ``near[n, 0]`` to ``near[n, 1]`` can touch in step n, and the others are left out: an
exact shortcut, checked at every evaluation of the force.

Steps. The slope of the path in the middle of a step is chosen such that Simpson's rule, which RK4 makes of it, gives
the exact change of depth over the step, whether or not a kink lies in it: without that the impulse of the damping force
is wrong wherever the slope jumps, and the error of the RMS is at least twice as large
(tests/models/solve/six_dof/test_lanes.py).

Arrays, float64 and C-contiguous, L = LANES; ``n`` counts steps, ``k`` damaged and ``j`` plain slots, node is 0, 1, 2
for the beginning, middle and end of a step:

- ``turn`` (n, 3, 2): cosine and sine of the cage angle.
- ``near``, int64 (n, 2): see above.
- ``damaged`` (k, 3, L), ``plain`` (j, 2, L): cosine and sine of the slot in the frame of the cage, and for damaged ones
  the share of a ball that they stand for (1, or a weight where a force is averaged).
- ``depth``, ``rate`` (n, 3, k, L): d and omega_c d', m and m/s.
- ``flow`` (10): step, s, and the propagators over half of it, as in step.py.
- ``parameter``: as in step.py; the static displacements and load in it are not used.
- ``lane`` (3, L): static load, N, and static displacements along and across the load, m.
- ``state`` (12, L): state along the load and across it, updated in place.
- ``wave`` (n, 2, L), written: acceleration along the load of outer ring and resonator at the beginning of each step,
  m/s2.

``tables`` and ``split``: see ``lane_instants``, which takes steps again in the lanes whose contacts change in them.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from models.platform.jit import inlined, kernel
from models.solve.six_dof.kernels.lane_instants import LANES, load, make_held, store, take_lanes
from models.solve.six_dof.kernels.step import (
    P_ALPHA,
    P_BETA,
    P_C_R,
    P_CLEARANCE,
    P_INV_M,
    P_INV_M_I,
    P_INV_M_O,
    P_INV_M_R,
    P_K_C,
    P_K_R,
    P_SHARE_R,
    P_TURN,
    STATUS_NOT_FINITE,
    STATUS_OK,
    kick,
    propagate,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.platform.jit import Index
    from models.solve.six_dof.kernels.lane_instants import LaneTables, Splitting
    from models.solve.six_dof.kernels.step import Axis, Flow

    # Scale of displacements, share of the resonator in the mass, cage speed; 1 / m_i, 1 / (m_o + m_r), 1 / m_o.
    Relative = tuple[float, float, float]
    Inverse = tuple[float, float, float]

NEAR_ANGLE = math.radians(7.5)
NEAR_SLOPE = math.tan(NEAR_ANGLE)

# Rows of the one scratch array.
_Y = 0 * LANES
_U1 = 12 * LANES
_U2 = 13 * LANES
_P1 = 14 * LANES
_P2 = 15 * LANES
_Q1 = 16 * LANES
_Q2 = 17 * LANES
_F1 = 18 * LANES
_F2 = 19 * LANES
_X = 20 * LANES
_LOAD = 32 * LANES
_S1 = 33 * LANES
_S2 = 34 * LANES
# Powers of two of the slots that are in contact, now and at the beginning of the step; whether they ever differed, and
# by how much one is near to meeting or leaving its contact.
_MASK = 35 * LANES
_FIRST = 36 * LANES
_DIFFERS = 37 * LANES
_NEAR = 38 * LANES
# States at the beginning of the step.
_BEGIN = 39 * LANES
_ROWS = 51


@kernel
def _contact_of(
    w: NDArray[np.float64],
    n: int,
    node: Index,
    near: NDArray[np.int64],
    damaged: NDArray[np.float64],
    plain: NDArray[np.float64],
    depth: NDArray[np.float64],
    rate: NDArray[np.float64],
    scale: float,
    gap: float,
    alpha: float,
    beta: float,
    bits: NDArray[np.float64],
    reach: float | None,
) -> None:
    """Write the contact force of every lane in the frame of the cage, N (Eqs. 35-48), and what tells of an instant.

    Displacements are scaled by k_c^(2/3), so that the force of a spring is their power 1.5. By how much an instant is
    nearer than ``reach``, s, is noted times that scale; None looks for none. ``bits``: a power of two for each slot.
    """
    wide = 0.0
    for i in range(LANES):
        w[_F1 + i] = 0.0
        w[_F2 + i] = 0.0
        w[_MASK + i] = 0.0
        wide += 1.0 if abs(w[_U2 + i]) > NEAR_SLOPE * w[_U1 + i] else 0.0
    for k in range(damaged.shape[0]):
        bit = bits[k]
        for i in range(LANES):
            c, s = damaged[k, 0, i], damaged[k, 1, i]
            delta = w[_P1 + i] * c + w[_P2 + i] * s - gap - scale * depth[n, node, k, i]
            pressed = delta if delta > 0.0 else 0.0
            root = math.sqrt(pressed)
            touching = 1.0 if delta > 0.0 else 0.0
            damping = beta * root + alpha * touching
            speed = w[_Q1 + i] * c + w[_Q2 + i] * s - rate[n, node, k, i]
            force = (pressed * root + damping * speed) * damaged[k, 2, i]
            w[_F1 + i] += force * c
            w[_F2 + i] += force * s
            if reach is not None:
                w[_MASK + i] += bit * touching
                w[_NEAR + i] = max(w[_NEAR + i], abs(speed) * reach - abs(delta))
    first = near[n, 0] if wide == 0.0 else 0
    last = near[n, 1] if wide == 0.0 else plain.shape[0]
    for j in range(first, last):
        bit = bits[damaged.shape[0] + j]
        for i in range(LANES):
            c, s = plain[j, 0, i], plain[j, 1, i]
            delta = w[_P1 + i] * c + w[_P2 + i] * s - gap
            pressed = delta if delta > 0.0 else 0.0
            root = math.sqrt(pressed)
            touching = 1.0 if delta > 0.0 else 0.0
            damping = beta * root + alpha * touching
            speed = w[_Q1 + i] * c + w[_Q2 + i] * s
            force = pressed * root + damping * speed
            w[_F1 + i] += force * c
            w[_F2 + i] += force * s
            if reach is not None:
                w[_MASK + i] += bit * touching
                w[_NEAR + i] = max(w[_NEAR + i], abs(speed) * reach - abs(delta))


@inlined
def _contact(
    w: NDArray[np.float64],
    n: int,
    node: Index,
    near: NDArray[np.int64],
    tables: LaneTables,
    law: tuple[float, float, float, float],
    bits: NDArray[np.float64],
    reach: float,
) -> None:
    """Do what ``_contact_of`` does; with a negative ``reach`` it looks for no instant. Calls compile faster."""
    damaged, plain, depth, rate = tables.damaged, tables.plain, tables.depth, tables.rate
    scale, gap, alpha, beta = law
    if reach < 0.0:
        _contact_of(w, n, node, near, damaged, plain, depth, rate, scale, gap, alpha, beta, bits, None)
    else:
        _contact_of(w, n, node, near, damaged, plain, depth, rate, scale, gap, alpha, beta, bits, reach)


@inlined
def _approach(w: NDArray[np.float64], i: int, x1: Axis, x2: Axis, c: float, s: float, relative: Relative) -> None:
    """Write the displacement between the rings of one lane and its velocity in the frame of the cage (Eq. 36)."""
    scale, share, omega = relative
    u1 = w[_S1 + i] + x1[0] - x1[2] - share * x1[4]
    u2 = w[_S2 + i] + x2[0] - x2[2] - share * x2[4]
    w1 = x1[1] - x1[3] - share * x1[5] + omega * u2
    w2 = x2[1] - x2[3] - share * x2[5] - omega * u1
    w[_U1 + i] = u1
    w[_U2 + i] = u2
    w[_P1 + i] = scale * (c * u1 + s * u2)
    w[_P2 + i] = scale * (c * u2 - s * u1)
    w[_Q1 + i] = c * w1 + s * w2
    w[_Q2 + i] = c * w2 - s * w1


@inlined
def _force(w: NDArray[np.float64], i: int, c: float, s: float) -> tuple[float, float]:
    """Return the force of one lane on the outer ring minus the static load, N, along and across the load."""
    return c * w[_F1 + i] - s * w[_F2 + i] - w[_LOAD + i], s * w[_F1 + i] + c * w[_F2 + i]


@inlined
def _start(
    w: NDArray[np.float64],
    wave: NDArray[np.float64],
    n: int,
    c: float,
    s: float,
    cm: float,
    sm: float,
    h: float,
    e: Flow,
    inverse: Inverse,
    spring: tuple[float, float, float],
    relative: Relative,
) -> None:
    """Record the accelerations at the beginning of a step and go on to the first state in its middle."""
    b_i, b_m, b_o = inverse
    k_r, c_r, b_r = spring
    for i in range(LANES):
        x1, x2 = load(w, _X, i), load(w, _X + 6 * LANES, i)
        g1, g2 = _force(w, i, c, s)
        pull = k_r * x1[4] + c_r * x1[5]
        wave[n, 0, i] = (g1 - pull) * b_o
        wave[n, 1, i] = pull * b_r
        store(w, _Y, i, propagate(x1, e))
        store(w, _Y + 6 * LANES, i, propagate(x2, e))
        store(w, _X, i, propagate(kick(x1, h / 6.0 * g1, 0.0, b_i, b_m, b_o), e))
        store(w, _X + 6 * LANES, i, propagate(kick(x2, h / 6.0 * g2, 0.0, b_i, b_m, b_o), e))
        z1 = propagate(kick(x1, 0.5 * h * g1, 0.0, b_i, b_m, b_o), e)
        z2 = propagate(kick(x2, 0.5 * h * g2, 0.0, b_i, b_m, b_o), e)
        _approach(w, i, z1, z2, cm, sm, relative)


@inlined
def _middle(w: NDArray[np.float64], cm: float, sm: float, h: float, inverse: Inverse, relative: Relative) -> None:
    """Go on to the second state in the middle of a step."""
    b_i, b_m, b_o = inverse
    for i in range(LANES):
        g1, g2 = _force(w, i, cm, sm)
        store(w, _X, i, kick(load(w, _X, i), h / 3.0 * g1, 0.0, b_i, b_m, b_o))
        store(w, _X + 6 * LANES, i, kick(load(w, _X + 6 * LANES, i), h / 3.0 * g2, 0.0, b_i, b_m, b_o))
        z1 = kick(load(w, _Y, i), 0.5 * h * g1, 0.0, b_i, b_m, b_o)
        z2 = kick(load(w, _Y + 6 * LANES, i), 0.5 * h * g2, 0.0, b_i, b_m, b_o)
        _approach(w, i, z1, z2, cm, sm, relative)


@inlined
def _end(
    w: NDArray[np.float64],
    cm: float,
    sm: float,
    c: float,
    s: float,
    h: float,
    e: Flow,
    inverse: Inverse,
    relative: Relative,
) -> None:
    """Go on to the state at the end of a step, which its last force is taken at."""
    b_i, b_m, b_o = inverse
    for i in range(LANES):
        g1, g2 = _force(w, i, cm, sm)
        store(w, _X, i, propagate(kick(load(w, _X, i), h / 3.0 * g1, 0.0, b_i, b_m, b_o), e))
        store(w, _X + 6 * LANES, i, propagate(kick(load(w, _X + 6 * LANES, i), h / 3.0 * g2, 0.0, b_i, b_m, b_o), e))
        z1 = propagate(kick(load(w, _Y, i), h * g1, 0.0, b_i, b_m, b_o), e)
        z2 = propagate(kick(load(w, _Y + 6 * LANES, i), h * g2, 0.0, b_i, b_m, b_o), e)
        _approach(w, i, z1, z2, c, s, relative)


@inlined
def _load_lanes(w: NDArray[np.float64], lane: NDArray[np.float64], state: NDArray[np.float64]) -> None:
    for i in range(LANES):
        w[_LOAD + i] = lane[0, i]
        w[_S1 + i] = lane[1, i]
        w[_S2 + i] = lane[2, i]
        for k in range(12):
            w[_X + k * LANES + i] = state[k, i]


@inlined
def _store_lanes(w: NDArray[np.float64], state: NDArray[np.float64]) -> int:
    bad = False
    for i in range(LANES):
        for k in range(12):
            state[k, i] = w[_X + k * LANES + i]
            bad = bad or not math.isfinite(state[k, i])
    return STATUS_NOT_FINITE if bad else STATUS_OK


@inlined
def _begin(w: NDArray[np.float64]) -> None:
    """Keep the states at the beginning of a step."""
    for k in range(12 * LANES):
        w[_BEGIN + k] = w[_X + k]
    for i in range(LANES):
        w[_NEAR + i] = 0.0
        w[_DIFFERS + i] = 0.0


@inlined
def _compare(w: NDArray[np.float64]) -> None:
    """Note where other slots are in contact than at the beginning of the step."""
    for i in range(LANES):
        w[_DIFFERS + i] += abs(w[_MASK + i] - w[_FIRST + i])


@inlined
def _in_question(w: NDArray[np.float64]) -> bool:
    """Return whether contacts change in a lane, or are near to it."""
    found = 0.0
    for i in range(LANES):
        found += 1.0 if w[_DIFFERS + i] > 0.0 or w[_NEAR + i] > 0.0 else 0.0
    return found > 0.0


@kernel
def advance(
    begin: int,
    end: int,
    near: NDArray[np.int64],
    flow: NDArray[np.float64],
    parameter: NDArray[np.float64],
    tables: LaneTables,
    split: Splitting,
    state: NDArray[np.float64],
    wave: NDArray[np.float64],
) -> int:
    """Carry all lanes over steps ``begin`` to ``end``; see the module for the arrays. Return a STATUS_ number."""
    turn, h = tables.turn, flow[0]
    w, held = np.zeros(_ROWS * LANES), make_held(parameter, tables, split.near)
    inverse = (parameter[P_INV_M_I], parameter[P_INV_M], parameter[P_INV_M_O])
    spring = (parameter[P_K_R], parameter[P_C_R], parameter[P_INV_M_R])
    alpha, beta = parameter[P_ALPHA], parameter[P_BETA] / parameter[P_K_C] ** (1.0 / 3.0)
    scale = parameter[P_K_C] ** (2.0 / 3.0)
    relative = (scale, parameter[P_SHARE_R], parameter[P_TURN])
    law = (scale, scale * parameter[P_CLEARANCE], alpha, beta)
    e = (flow[1], flow[2], flow[3], flow[4], flow[5], flow[6], flow[7], flow[8], flow[9])
    splits, bits = split.reach > 0.0, np.empty(tables.damaged.shape[0] + tables.plain.shape[0])
    # At both ends of a step instants are looked for, in its middle only changes of contacts.
    reach, none = (scale * max(h, split.reach), 0.0) if splits else (-1.0, -1.0)
    for j in range(bits.shape[0]):
        bits[j] = 2.0**j
    _load_lanes(w, tables.lane, state)
    for n in range(begin, end):
        c, s = turn[n, 0, 0], turn[n, 0, 1]
        cm, sm = turn[n, 1, 0], turn[n, 1, 1]
        ce, se = turn[n, 2, 0], turn[n, 2, 1]
        if splits:
            _begin(w)
        for i in range(LANES):
            _approach(w, i, load(w, _X, i), load(w, _X + 6 * LANES, i), c, s, relative)
        _contact(w, n, np.int64(0), near, tables, law, bits, reach)
        for i in range(LANES):
            w[_FIRST + i] = w[_MASK + i]
        _start(w, wave, n, c, s, cm, sm, h, e, inverse, spring, relative)
        _contact(w, n, np.int64(1), near, tables, law, bits, none)
        _compare(w)
        _middle(w, cm, sm, h, inverse, relative)
        _contact(w, n, np.int64(1), near, tables, law, bits, none)
        _compare(w)
        _end(w, cm, sm, ce, se, h, e, inverse, relative)
        _contact(w, n, np.int64(2), near, tables, law, bits, reach)
        _compare(w)
        for i in range(LANES):
            g1, g2 = _force(w, i, ce, se)
            store(w, _X, i, kick(load(w, _X, i), h / 6.0 * g1, 0.0, inverse[0], inverse[1], inverse[2]))
            z2 = kick(load(w, _X + 6 * LANES, i), h / 6.0 * g2, 0.0, inverse[0], inverse[1], inverse[2])
            store(w, _X + 6 * LANES, i, z2)
            split.changed[n, i] = False
        if splits and (split.marks[n] != 0 or _in_question(w)):
            take_lanes(n, w, (_X, _BEGIN, _DIFFERS, _NEAR), h, tables, split, held)
    return _store_lanes(w, state)
