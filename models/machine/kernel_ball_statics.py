"""Kernels of the statics of a ball bearing, ball by ball, under loads in any direction and centrifugal force.

Each ball is in equilibrium in the plane of the axis and of its own radius (Thibault et al. 2022, Eqs. 3-11). Vectors
there are (axial, radial). ``u`` is the ball's centre and ``p`` the centre of curvature of the inner groove, both from
that of the outer groove: small numbers, so that nothing is lost by subtraction. A contact is closed where the distance
of the centres exceeds the gap of its race. The energy of both contacts is a convex function of u and p; the
equilibrium of a ball, and of the ring on all balls, is therefore the minimum of a convex function.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from models.platform.jit import inlined, kernel

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

# Columns of the results of a ball: its centre (axial, radial), forces and contact angles on both races, and what is
# left of the forces.
U_Z, U_R, N_I, N_O, BETA_I, BETA_O, RESIDUAL = 0, 1, 2, 3, 4, 5, 6
COLUMNS = 7
SETTLED = 1e-7
"""Largest sum of the forces on a ball in equilibrium, N."""
_MOST_STEPS = 100
_MOST_HALVINGS = 60
# Least slope of energy and force that a step must keep.
_DESCENT = 1e-4
# Stiffness without contact, N/m: less than what a force of SETTLED has across its contact. Steps are limited in length.
FLOATING = 1e-5


class Races(NamedTuple):
    """What the equilibrium takes of a bearing.

    Attributes:
        inner_radius: of the circle of the inner groove's centres of curvature, R_i + R_ci, m.
        offset: that radius less the outer one, R_o - R_co, with the rings coaxial, m.
        inner_gap, outer_gap: distance between a ball's centre and a groove's centre of curvature at which they touch,
            R_c - R + c/4, m, positive.
        k_i, k_o: contact stiffness of both races, N/m^1.5.
    """

    inner_radius: float
    offset: float
    inner_gap: float
    outer_gap: float
    k_i: float
    k_o: float


class Contact(NamedTuple):
    """A contact: unit vector from the ball's centre or to it, force, stiffnesses along and across, elastic energy."""

    z: float
    r: float
    force: float
    along: float
    across: float
    energy: float


class BallBalance(NamedTuple):
    """Both contacts of a ball, the sum (axial, radial) of the forces on it, its size, and the energy."""

    inner: Contact
    outer: Contact
    z: float
    r: float
    size: float
    energy: float


@inlined
def contact_of(z: float, r: float, gap: float, k: float) -> Contact:
    """Return the contact of a race whose centre of curvature is (z, r) from the ball's centre, or the other way."""
    distance = math.sqrt(z * z + r * r)
    d = distance - gap
    if d <= 0.0:
        return Contact(0.0, 1.0, 0.0, 0.0, 0.0, 0.0)
    root = math.sqrt(d)
    force = k * d * root
    return Contact(z / distance, r / distance, force, 1.5 * k * root, force / distance, 0.4 * force * d)


@inlined
def balance_of(u_z: float, u_r: float, p_z: float, p_r: float, c_f: float, races: Races) -> BallBalance:
    """Return the forces on a ball at a place."""
    inner = contact_of(p_z - u_z, p_r - u_r, races.inner_gap, races.k_i)
    outer = contact_of(u_z, u_r, races.outer_gap, races.k_o)
    z = inner.force * inner.z - outer.force * outer.z
    r = inner.force * inner.r - outer.force * outer.r + c_f
    return BallBalance(inner, outer, z, r, math.sqrt(z * z + r * r), inner.energy + outer.energy - c_f * u_r)


@inlined
def stiffness_of(contact: Contact) -> tuple[float, float, float]:
    """Return the elements zz, zr and rr of the stiffness matrix of a contact."""
    difference = contact.along - contact.across
    return (
        contact.across + difference * contact.z * contact.z,
        difference * contact.z * contact.r,
        contact.across + difference * contact.r * contact.r,
    )


@inlined
def _wedge(p_z: float, p_r: float, outer: float, inner: float) -> tuple[float, float]:
    """Return the outermost place that is ``outer`` from the outer centre of curvature and ``inner`` from the inner."""
    between = max(math.sqrt(p_z * p_z + p_r * p_r), 1e-12)
    forth = (between * between + outer * outer - inner * inner) / (2.0 * between)
    aside = math.sqrt(max(outer * outer - forth * forth, 0.0)) * (1.0 if p_z > 0.0 else -1.0)
    return (forth * p_z - aside * p_r) / between, (forth * p_r + aside * p_z) / between


@inlined
def _begin(p_z: float, p_r: float, c_f: float, races: Races) -> tuple[float, float, bool]:
    """Return where to begin with a ball, and whether it is in equilibrium there.

    Pressed by the centrifugal force alone it lies at the outer race; if it does not touch the inner one there, that is
    the equilibrium. Else it is pressed between the centres, both contacts in series, or wedged where both races meet,
    or free where there is no centrifugal force.
    """
    outside = races.outer_gap + (c_f / races.k_o) ** (2.0 / 3.0)
    if contact_of(p_z, p_r - outside, races.inner_gap, races.k_i).force <= 0.0:
        return 0.0, outside, True
    between = math.sqrt(p_z * p_z + p_r * p_r)
    pressed = between - races.inner_gap - races.outer_gap
    if pressed <= 0.0:
        if c_f <= SETTLED:
            return 0.0, outside, True
        z, r = _wedge(p_z, p_r, outside, races.inner_gap + (c_f / races.k_i) ** (2.0 / 3.0))
        return z, r, False
    soft_i, soft_o = races.k_i ** (-2.0 / 3.0), races.k_o ** (-2.0 / 3.0)
    share = pressed * soft_o / (soft_i + soft_o)
    if races.k_o * share**1.5 < c_f:
        return 0.0, outside, False
    distance = races.outer_gap + share
    return p_z / between * distance, p_r / between * distance, False


@inlined
def newton_step(now: BallBalance, longest: float) -> tuple[float, float]:
    """Return Newton's step from a place, limited in length."""
    izz, izr, irr = stiffness_of(now.inner)
    ozz, ozr, orr = stiffness_of(now.outer)
    zz, zr, rr = izz + ozz + FLOATING, izr + ozr, irr + orr + FLOATING
    determinant = zz * rr - zr * zr
    s_z, s_r = (rr * now.z - zr * now.r) / determinant, (zz * now.r - zr * now.z) / determinant
    length = math.sqrt(s_z * s_z + s_r * s_r)
    if length > longest:
        s_z, s_r = s_z * longest / length, s_r * longest / length
    return s_z, s_r


@inlined
def settle_ball(p_z: float, p_r: float, c_f: float, races: Races) -> tuple[float, float, BallBalance]:
    """Return a ball's place in equilibrium, and the forces there: Newton on the convex energy, steps halved."""
    u_z, u_r, _ = _begin(p_z, p_r, c_f, races)
    now = balance_of(u_z, u_r, p_z, p_r, c_f, races)
    longest = races.inner_gap + races.outer_gap
    for _ in range(_MOST_STEPS):
        if now.size <= SETTLED:
            break
        s_z, s_r = newton_step(now, longest)
        slope, step, tried = s_z * now.z + s_r * now.r, 1.0, now
        for _ in range(_MOST_HALVINGS):
            tried = balance_of(u_z + step * s_z, u_r + step * s_r, p_z, p_r, c_f, races)
            smaller = tried.size <= (1.0 - _DESCENT * step) * now.size
            if smaller or tried.energy <= now.energy - _DESCENT * step * slope:
                break
            step *= 0.5
        u_z, u_r, now = u_z + step * s_z, u_r + step * s_r, tried
    return u_z, u_r, now


@inlined
def _free(p_z: float, p_r: float, c_f: float, races: Races) -> bool:
    """Return whether a ball does not press on the inner race."""
    return _begin(p_z, p_r, c_f, races)[2]


@kernel
def settle_balls(
    q: NDArray[np.float64],
    angles: NDArray[np.float64],
    c_f: float,
    races: Races,
    balls: NDArray[np.float64],
    load: NDArray[np.float64],
    tangent: NDArray[np.float64],
) -> tuple[float, float]:
    """Find the equilibrium of every ball and what they carry; return the energy, J, and the largest residual, N.

    Args:
        q: displacement of the inner against the outer ring: x, y, z, m, and tilt about x and y, rad, (5,).
        angles: of the balls from x towards y, rad, (balls,).
        c_f: centrifugal force on a ball, N, not negative.
        races: of the bearing.
        balls: written, (balls, COLUMNS): see the constants of this module.
        load: written: forces, N, and moments, N m, that the balls carry from the inner to the outer ring, (5,).
        tangent: written: its derivatives by q, symmetric, (5, 5).
    """
    energy, worst = 0.0, 0.0
    load[:] = 0.0
    tangent[:] = 0.0
    for j in range(angles.shape[0]):
        cosine, sine = math.cos(angles[j]), math.sin(angles[j])
        arm_x, arm_y = races.inner_radius * sine, -races.inner_radius * cosine
        p_z = q[2] + arm_x * q[3] + arm_y * q[4]
        p_r = races.offset + q[0] * cosine + q[1] * sine
        ball = balls[j]
        if _free(p_z, p_r, c_f, races):
            ball[:] = 0.0
            pressed = (c_f / races.k_o) ** (2.0 / 3.0)
            ball[U_R], ball[N_O] = races.outer_gap + pressed, c_f
            energy += 0.4 * c_f * pressed - c_f * ball[U_R]
            continue
        u_z, u_r, forces = settle_ball(p_z, p_r, c_f, races)
        inner, outer = forces.inner, forces.outer
        ball[U_Z], ball[U_R], ball[N_I], ball[N_O] = u_z, u_r, inner.force, outer.force
        ball[BETA_I] = math.atan2(inner.z, inner.r)
        ball[BETA_O] = math.atan2(outer.z, outer.r)
        ball[RESIDUAL] = forces.size
        energy += forces.energy
        worst = max(worst, forces.size)
        izz, izr, irr = stiffness_of(inner)
        ozz, ozr, orr = stiffness_of(outer)
        # Of both contacts in series, the ball's place eliminated: K_i - K_i (K_i + K_o)^-1 K_i.
        zz, zr, rr = izz + ozz + FLOATING, izr + ozr, irr + orr + FLOATING
        determinant = zz * rr - zr * zr
        a, b = (rr * izz - zr * izr) / determinant, (rr * izr - zr * irr) / determinant
        c, d = (zz * izr - zr * izz) / determinant, (zz * irr - zr * izr) / determinant
        szz, szr, srr = izz - izz * a - izr * c, izr - izz * b - izr * d, irr - izr * b - irr * d
        f_z, f_r = inner.force * inner.z, inner.force * inner.r
        axial = (0.0, 0.0, 1.0, arm_x, arm_y)
        radial = (cosine, sine, 0.0, 0.0, 0.0)
        for m in range(5):
            load[m] += axial[m] * f_z + radial[m] * f_r
            for n in range(5):
                tangent[m, n] += axial[m] * (szz * axial[n] + szr * radial[n]) + radial[m] * (
                    szr * axial[n] + srr * radial[n]
                )
    return energy, worst
