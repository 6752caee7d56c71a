"""Kernel: the balls of one bearing in equilibrium, over and over, begun where they were; over spalls too.

As ``models.machine.kernel_ball_statics``, whose safe solution is taken where Newton's method does not settle in a few
steps from a ball's last place. Over a spall the force of a contact still grows with its deflection, so the equilibrium
stays unique at a given contact angle. Force of a contact that lies partly over spalls, and its derivative, are in
closed form.

Source: Thibault et al. 2022, Eqs. 15-18, with the corrections that ``models.machine.spall_contact`` names. Over a spall
the pressure of the sound contact is replaced by that of a contact which is less deep by the depth of the spall; both
are half ellipsoids, whose parts over a rectangle are integrated here. The force grows with the deflection everywhere.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from models.machine.kernel_ball_statics import (
    SETTLED,
    BallBalance,
    Contact,
    Races,
    balance_of,
    contact_of,
    newton_step,
    settle_ball,
)
from models.platform.jit import inlined, kernel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.platform.jit import Index


INNER, OUTER = 0, 1
# Columns of the races of a bearing, row INNER and row OUTER: stiffness, N/m^1.5, semi-axes along and across the race
# over the root of the deflection, m^0.5, radius of the race and of its groove, m.
R_STIFFNESS, R_ALONG, R_ACROSS, R_RADIUS, R_GROOVE = range(5)
R_SIZE = 5
# Columns of a spall: race, depth, half of its length and of its width, m, its angles around and across the race, rad.
S_RACE, S_DEPTH, S_HALF_LENGTH, S_HALF_WIDTH, S_POSITION, S_MIDDLE = range(6)
S_SIZE = 6


@inlined
def wrapped(angle: float, every: float) -> float:
    """Return an angle less the nearest multiple of another."""
    return angle - every * math.floor(angle / every + 0.5)


@inlined
def _corner(x: float, y: float) -> tuple[float, float]:
    """Return the integrals of w and of 1 / w, w^2 = 1 - u^2 - v^2, over the unit disc between (0, 0) and (x, y)."""
    x, y = max(-1.0, min(1.0, x)), max(-1.0, min(1.0, y))
    w = math.sqrt(max(0.0, 1.0 - x * x - y * y))
    a, b, c = math.atan2(y, w), math.atan2(x, w), math.atan2(x * y, w)
    return (
        x * y * w / 3.0 + x * (3.0 - x * x) / 6.0 * a + y * (3.0 - y * y) / 6.0 * b - c / 3.0,
        x * a + y * b - c,
    )


@inlined
def share_in_rectangle(x_0: float, x_1: float, y_0: float, y_1: float) -> tuple[float, float]:
    """Return the shares of a contact's force and of its stiffness within bounds in units of the semi-axes."""
    if x_0 >= 1.0 or x_1 <= -1.0 or y_0 >= 1.0 or y_1 <= -1.0:
        return 0.0, 0.0
    if x_0 <= -1.0 and x_1 >= 1.0 and y_0 <= -1.0 and y_1 >= 1.0:
        return 1.0, 1.0
    a, b, c, d = _corner(x_1, y_1), _corner(x_0, y_1), _corner(x_1, y_0), _corner(x_0, y_0)
    return 1.5 / math.pi * (a[0] - b[0] - c[0] + d[0]), 0.5 / math.pi * (a[1] - b[1] - c[1] + d[1])


@inlined
def _part(d: float, race: NDArray[np.float64], spall: NDArray[np.float64], x: float, y: float) -> tuple[float, float]:
    """Return force and stiffness of the part over a spall of a whole contact of deflection d > 0."""
    root = math.sqrt(d)
    b, a = race[R_ALONG] * root, race[R_ACROSS] * root
    half_length, half_width = spall[S_HALF_LENGTH], spall[S_HALF_WIDTH]
    share, steep = share_in_rectangle(
        (-half_length - x) / b, (half_length - x) / b, (-half_width - y) / a, (half_width - y) / a
    )
    force = race[R_STIFFNESS] * d * root
    return force * share, 1.5 * force / d * steep


@kernel
def pressed(
    d: float,
    place: Index,
    angle: float,
    contact_angle: float,
    races: NDArray[np.float64],
    spalls: NDArray[np.float64],
) -> tuple[float, float]:
    """Return force, N, and stiffness, N/m, of a contact of deflection d, m.

    Args:
        place: INNER or OUTER.
        angle: of the ball on that race, rad.
        contact_angle: of the ball on that race, rad.
        races: of the bearing, (2, R_SIZE).
        spalls: of both races, (spalls, S_SIZE).
    """
    if d <= 0.0:
        return 0.0, 0.0
    race = races[place]
    root = math.sqrt(d)
    force, stiffness = race[R_STIFFNESS] * d * root, 1.5 * race[R_STIFFNESS] * root
    for k in range(spalls.shape[0]):
        spall = spalls[k]
        if int(spall[S_RACE]) != place:
            continue
        x = race[R_RADIUS] * wrapped(angle - spall[S_POSITION], _TURN)
        if abs(x) >= spall[S_HALF_LENGTH] + race[R_ALONG] * root:
            continue
        y = race[R_GROOVE] * (contact_angle - spall[S_MIDDLE])
        covered = _part(d, race, spall, x, y)
        force, stiffness = force - covered[0], stiffness - covered[1]
        sunk = d - spall[S_DEPTH]
        if sunk > 0.0:
            reached = _part(sunk, race, spall, x, y)
            force, stiffness = force + reached[0], stiffness + reached[1]
    return max(force, 0.0), max(stiffness, 0.0)


# Places in what ``carry`` writes: forces, N, and moments, N m, from the inner to the outer ring, resisting torque, N m,
# cosine of the mean contact angle, largest sum of the forces on a ball, N.
F_X, F_Y, F_Z, M_X, M_Y, TORQUE, COSINE, LEFT = range(8)
CARRIED = 8
_WARM_STEPS = 8
_MOST_STEPS, _FROZEN_AFTER, _MOST_HALVINGS = 80, 15, 40
# A ball this far from a spall, m, beyond what its contact reaches at this deflection, m, is not over it.
_DEEPEST = 2e-4
_TURN = 2.0 * math.pi


class BallRing(NamedTuple):
    """One bearing of N balls.

    Attributes:
        races: of the statics.
        surfaces: both races by the R_ constants, (2, R_SIZE).
        spalls: (spalls, S_SIZE).
        angles: of the balls in the cage, rad, (N,), evenly spaced.
        slots: cosine and sine of them, (2, N).
        pitch_radius, ball_radius: m.
        half_resistance: half of the coefficient of rolling resistance.
    """

    races: Races
    surfaces: NDArray[np.float64]
    spalls: NDArray[np.float64]
    angles: NDArray[np.float64]
    slots: NDArray[np.float64]
    pitch_radius: float
    ball_radius: float
    half_resistance: float


@inlined
def _touches(angle: float, turned: float, ring: BallRing) -> bool:
    """Return whether a ball may be over a spall; ``turned`` is the angle of the inner race."""
    for k in range(ring.spalls.shape[0]):
        spall = ring.spalls[k]
        place = int(spall[S_RACE])
        race = ring.surfaces[place]
        on = angle - (turned if place == INNER else 0.0)
        along = race[R_RADIUS] * wrapped(on - spall[S_POSITION], _TURN)
        if abs(along) < spall[S_HALF_LENGTH] + race[R_ALONG] * math.sqrt(_DEEPEST):
            return True
    return False


@inlined
def _over(z: float, r: float, gap: float, place: Index, angle: float, middle: float, ring: BallRing) -> Contact:
    """Return a contact as ``contact_of``, of a ball at a contact angle ``middle`` on a race with spalls."""
    distance = math.sqrt(z * z + r * r)
    d = distance - gap
    if d <= 0.0:
        return Contact(0.0, 1.0, 0.0, 0.0, 0.0, 0.0)
    force, along = pressed(d, place, angle, middle, ring.surfaces, ring.spalls)
    return Contact(z / distance, r / distance, force, along, force / distance, 0.0)


@kernel
def _balance_over(
    u_z: float,
    u_r: float,
    p_z: float,
    p_r: float,
    c_f: float,
    angle: float,
    turned: float,
    middles: tuple[float, float],
    ring: BallRing,
) -> BallBalance:
    """Return the forces on a ball at a place, as ``balance_of``, without the energy."""
    inner = _over(p_z - u_z, p_r - u_r, ring.races.inner_gap, np.int64(INNER), angle - turned, middles[INNER], ring)
    outer = _over(u_z, u_r, ring.races.outer_gap, np.int64(OUTER), angle, middles[OUTER], ring)
    z = inner.force * inner.z - outer.force * outer.z
    r = inner.force * inner.r - outer.force * outer.r + c_f
    return BallBalance(inner, outer, z, r, math.sqrt(z * z + r * r), 0.0)


@inlined
def _middles(u_z: float, u_r: float, p_z: float, p_r: float) -> tuple[float, float]:
    """Return the contact angles of a ball on the inner and on the outer race."""
    return math.atan2(p_z - u_z, p_r - u_r), math.atan2(u_z, u_r)


@kernel
def _deepened(c_f: float, angle: float, ring: BallRing) -> float:
    """Return the deflection of the outer contact, m, that the centrifugal force alone makes over spalls."""
    low = (c_f / ring.races.k_o) ** (2.0 / 3.0)
    high = low
    for k in range(ring.spalls.shape[0]):
        high += ring.spalls[k, 1] if int(ring.spalls[k, S_RACE]) == OUTER else 0.0
    # On the floor, or on the sound race: mostly one of both.
    d = high
    for trial in range(62):
        d = low if trial == 1 else d
        force, stiffness = pressed(d, np.int64(OUTER), angle, 0.0, ring.surfaces, ring.spalls)
        if abs(force - c_f) <= 0.1 * SETTLED:
            break
        if force < c_f:
            low = d
        else:
            high = d
        newton = d + (c_f - force) / stiffness if stiffness > 0.0 else math.inf
        d = newton if low < newton < high else 0.5 * (low + high)
    return d


@kernel
def _settle_over(
    p_z: float, p_r: float, c_f: float, angle: float, turned: float, ring: BallRing, warm: NDArray[np.float64]
) -> BallBalance:
    """Return the forces on a ball in equilibrium near spalls; ``warm`` is its last place and is overwritten.

    Newton's method on the sum of the forces, steps halved; the place of the contact ellipse across the race follows
    the ball for the first steps and then stays.
    """
    outside = ring.races.outer_gap + _deepened(c_f, angle, ring)
    flat = _middles(0.0, outside, p_z, p_r)
    now = _balance_over(0.0, outside, p_z, p_r, c_f, angle, turned, (flat[INNER], 0.0), ring)
    u_z, u_r = 0.0, outside
    if now.inner.force > 0.0:
        before = _balance_over(
            warm[0], warm[1], p_z, p_r, c_f, angle, turned, _middles(warm[0], warm[1], p_z, p_r), ring
        )
        if before.size < now.size:
            u_z, u_r, now = warm[0], warm[1], before
        longest = ring.races.inner_gap + ring.races.outer_gap
        middles = _middles(u_z, u_r, p_z, p_r)
        for step in range(_MOST_STEPS):
            if step < _FROZEN_AFTER:
                middles = _middles(u_z, u_r, p_z, p_r)
                now = _balance_over(u_z, u_r, p_z, p_r, c_f, angle, turned, middles, ring)
            if now.size <= SETTLED:
                break
            s_z, s_r = newton_step(now, longest)
            size, tried = 1.0, now
            for _ in range(_MOST_HALVINGS):
                tried = _balance_over(u_z + size * s_z, u_r + size * s_r, p_z, p_r, c_f, angle, turned, middles, ring)
                if tried.size <= (1.0 - 1e-4 * size) * now.size:
                    break
                size *= 0.5
            u_z, u_r, now = u_z + size * s_z, u_r + size * s_r, tried
    warm[0], warm[1] = u_z, u_r
    return now


@inlined
def _settle_near(
    p_z: float, p_r: float, c_f: float, outside: float, ring: BallRing, warm: NDArray[np.float64]
) -> BallBalance:
    """Return the forces on a ball in equilibrium on sound races; ``warm`` is its last place and is overwritten."""
    races = ring.races
    free = contact_of(p_z, p_r - outside, races.inner_gap, races.k_i)
    if free.force <= 0.0:
        warm[0], warm[1] = 0.0, outside
        return BallBalance(free, Contact(0.0, 1.0, c_f, 0.0, 0.0, 0.0), 0.0, 0.0, 0.0, 0.0)
    u_z, u_r = warm[0], warm[1]
    now = balance_of(u_z, u_r, p_z, p_r, c_f, races)
    longest = 0.1 * (races.inner_gap + races.outer_gap)
    for _ in range(_WARM_STEPS):
        if now.size <= SETTLED:
            break
        s_z, s_r = newton_step(now, longest)
        u_z, u_r = u_z + s_z, u_r + s_r
        now = balance_of(u_z, u_r, p_z, p_r, c_f, races)
    # The comparison also finds what is not a number.
    if not now.size <= SETTLED:
        u_z, u_r, now = settle_ball(p_z, p_r, c_f, races)
    warm[0], warm[1] = u_z, u_r
    return now


@kernel
def carry(
    q: NDArray[np.float64],
    cage: float,
    c_f: float,
    turned: float,
    ring: BallRing,
    warm: NDArray[np.float64],
    out: NDArray[np.float64],
) -> None:
    """Write what the balls carry.

    Args:
        q: displacement of the inner against the outer ring: x, y, z, m, and tilt about x and y, rad, (5,).
        cage: angle of the cage, rad.
        c_f: centrifugal force on a ball, N, not negative.
        turned: angle of the inner race, rad.
        ring: the bearing.
        warm: last places of the balls, (N, 2), overwritten.
        out: written, (CARRIED,).
    """
    races = ring.races
    outside = races.outer_gap + (c_f / races.k_o) ** (2.0 / 3.0)
    cage_c, cage_s = math.cos(cage), math.sin(cage)
    f_x, f_y, f_z, m_x, m_y, torque, total, turns, left = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    damaged = ring.spalls.shape[0] > 0
    for j in range(ring.angles.shape[0]):
        cosine = cage_c * ring.slots[0, j] - cage_s * ring.slots[1, j]
        sine = cage_s * ring.slots[0, j] + cage_c * ring.slots[1, j]
        arm_x, arm_y = races.inner_radius * sine, -races.inner_radius * cosine
        p_z = q[2] + arm_x * q[3] + arm_y * q[4]
        p_r = races.offset + q[0] * cosine + q[1] * sine
        angle = cage + ring.angles[j]
        if damaged and _touches(angle, turned, ring):
            forces = _settle_over(p_z, p_r, c_f, angle, turned, ring, warm[j])
        else:
            forces = _settle_near(p_z, p_r, c_f, outside, ring, warm[j])
        inner, outer = forces.inner, forces.outer
        axial, radial = inner.force * inner.z, inner.force * inner.r
        f_x, f_y, f_z = f_x + radial * cosine, f_y + radial * sine, f_z + axial
        m_x, m_y = m_x + axial * arm_x, m_y + axial * arm_y
        arm = ring.pitch_radius - ring.ball_radius * inner.r
        torque += ring.half_resistance * (inner.force + outer.force) * arm
        if inner.force > 0.0:
            total += inner.force
            # The sum of both contact angles.
            both = math.atan2(inner.z * outer.r + inner.r * outer.z, inner.r * outer.r - inner.z * outer.z)
            turns += 0.5 * inner.force * both
        left = max(left, forces.size)
    out[F_X], out[F_Y], out[F_Z], out[M_X], out[M_Y] = f_x, f_y, f_z, m_x, m_y
    out[TORQUE] = torque
    out[COSINE] = math.cos(turns / total) if total > 0.0 else 1.0
    out[LEFT] = left
