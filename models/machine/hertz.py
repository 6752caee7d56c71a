"""Hertzian contact of rolling bearings: stiffness and size of contacts, static equilibrium, bearing stiffness, life.

Contact law throughout: f = k_c * delta**n with n = 1.5 for balls and 10/9 for rollers, delta the approach of both rings
along the element (both contacts in series). SI units and radians. Angles are measured from the load direction; axis 1
of every pair and matrix lies along the load, axis 2 across it, so that the loaded zone is around angle zero.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from models.machine.bearing import Bearing
from models.words.numerics import carlson, find_root

if TYPE_CHECKING:
    from numpy.typing import NDArray

Method = Literal["simplified", "elliptic"]

BALL_EXPONENT = 1.5
ROLLER_EXPONENT = 10.0 / 9.0

# Stiffness of a line contact of steel: Palmgren's 8.06e4 N/mm^(10/9) per mm^(8/9) of length (Eq. 15); with both in
# metres the factors 1000^(10/9) and 1000^(8/9) make 1000^2.
PALMGREN = 8.06e10
# E' = 2 E_eq of two bodies of bearing steel (210 GPa, 0.3), Pa: twice Eq. 3, as Eq. 17 needs it.
EFFECTIVE_MODULUS = 210e9 / (1.0 - 0.3**2)
_NEWTON_STEPS = 500


def contact_exponent(bearing: Bearing) -> float:
    """Return n of f = k_c delta**n: 1.5 for balls, 10/9 for rollers (Eqs. 14 and 35)."""
    return BALL_EXPONENT if bearing.element == "ball" else ROLLER_EXPONENT


@dataclass(frozen=True)
class ContactShape:
    """Ellipticity ``kappa`` = a/b >= 1 of a contact, and the complete integrals eps = E and xi = K of 1 - 1/kappa^2."""

    kappa: float
    eps: float
    xi: float


def contact_shape(ratio: float, method: Method = "simplified") -> ContactShape:
    """Return the shape of the contact of two bodies whose relative radii have the ratio r_y / r_x.

    Args:
        ratio: larger over smaller relative radius, 1 or more.
        method: "simplified", the fits of Eqs. 8-10 (Brewe and Hamrock), or "elliptic", Hertz without approximation:
            kappa solves (kappa^2 E - K) / (K - E) = r_y / r_x.

    Raises:
        ValueError: if the ratio is below 1 or not finite.
    """
    if not (math.isfinite(ratio) and ratio >= 1.0):
        raise ValueError(f"ratio of the relative radii must be finite and 1 at least, got {ratio!r}")
    if method == "simplified":
        return ContactShape(1.0339 * ratio**0.636, 1.0003 + 0.5968 / ratio, 1.5277 + 0.6023 * math.log(ratio))
    # kappa lies between 1 (a circle) and the ratio itself; the margins outweigh rounding where both are nearly one.
    low, high = 1.0 - 1e-9, ratio * (1.0 + 1e-9)
    kappa = max(1.0, find_root(lambda kappa: _radii_ratio(kappa) - ratio, low, high, rtol=1e-14))
    second, first = _elliptic_parts(kappa)
    return ContactShape(kappa, first + second / kappa**2, first + second)


def _elliptic_parts(kappa: float) -> tuple[float, float]:
    """Return D and B of K = B + D, E = B + (1 - m) D at m = 1 - 1/kappa^2 (Carlson's forms, no cancellation)."""
    r_f, r_d = carlson(kappa**-2)
    return r_d / 3.0, r_f - r_d / 3.0


def _radii_ratio(kappa: float) -> float:
    d, b = _elliptic_parts(kappa)
    return kappa**2 * b / d


def point_contact_stiffness(
    r_rolling: float, r_across: float, method: Method = "simplified", *, modulus: float = EFFECTIVE_MODULUS
) -> float:
    """Return the stiffness of one elliptical contact of relative radii of Eqs. 6 and 7, N/m^1.5.

    ``modulus`` is E' of the two bodies, Pa; E / (1 - nu^2) where they are of one material.

    Source: thesis, Eqs. 5, 8-10 and 17 with two misprints mended: xi belongs inside the bracket,
    k = pi kappa E' sqrt(eps r_eq / (4.5 xi^3)), and E' is twice the E_eq of Eq. 3.
    """
    r_x, r_y = sorted((r_rolling, r_across))
    r_eq = 1.0 / (1.0 / r_x + 1.0 / r_y)
    shape = contact_shape(r_y / r_x, method)
    return math.pi * shape.kappa * modulus * math.sqrt(shape.eps * r_eq / (4.5 * shape.xi**3))


def point_contact_semi_axes(
    r_rolling: float,
    r_across: float,
    force: float,
    method: Method = "simplified",
    *,
    modulus: float = EFFECTIVE_MODULUS,
) -> tuple[float, float]:
    """Return the longer and the shorter semi-axis of an elliptical contact under a force (N), m.

    ``modulus`` is E' as of :func:`point_contact_stiffness`.

    Source: thesis, Eqs. 11 and 12, in which E_eq must be twice that of Eq. 3 (Table 11 was computed so).
    """
    r_x, r_y = sorted((r_rolling, r_across))
    r_eq = 1.0 / (1.0 / r_x + 1.0 / r_y)
    shape = contact_shape(r_y / r_x, method)
    minor = (6.0 * shape.eps * r_eq * force / (math.pi * shape.kappa * modulus)) ** (1.0 / 3.0)
    return shape.kappa * minor, minor


def line_contact_half_width(r_eq: float, effective_length: float, force: float) -> float:
    """Return the half width of a line contact under a force (N), m (Eq. 4, with E_eq of Eq. 3 as printed)."""
    return math.sqrt(8.0 * r_eq * force / (math.pi * effective_length * EFFECTIVE_MODULUS))


def in_series(k_inner: float, k_outer: float, exponent: float) -> float:
    """Return the stiffness of two contacts in series that share the law f = k delta**n (Eq. 16)."""
    return (k_inner ** (-1.0 / exponent) + k_outer ** (-1.0 / exponent)) ** -exponent


def contact_stiffness(bearing: Bearing, method: Method = "simplified") -> float:
    """Return k_c of one element between both rings from the geometry, N/m^1.5 (balls) or N/m^(10/9) (rollers).

    Raises:
        ValueError: if a radius that the contact needs is unknown or does not conform; the message names it.
    """
    if bearing.element == "roller":
        single = PALMGREN * known_length(bearing, "effective_length") ** (8.0 / 9.0)
        return in_series(single, single, ROLLER_EXPONENT)
    inner, outer = (point_contact_stiffness(*radii, method) for radii in relative_radii(bearing))
    return in_series(inner, outer, BALL_EXPONENT)


def relative_radii(bearing: Bearing) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the relative radii of a ball on the inner and on the outer race, m: (rolling, across) of each (Eqs. 6, 7).

    Raises:
        ValueError: if a radius is unknown or does not conform; the message names it.
    """
    r_b = 0.5 * bearing.element_diameter
    r_i, r_o = known_length(bearing, "inner_race_radius"), known_length(bearing, "outer_race_radius")
    r_gi, r_go = known_length(bearing, "inner_groove_radius"), known_length(bearing, "outer_groove_radius")
    for name, radius in (("inner_groove_radius", r_gi), ("outer_groove_radius", r_go), ("outer_race_radius", r_o)):
        if radius <= r_b:
            raise ValueError(f"{bearing.designation}: {name} {radius!r} m must exceed the ball radius {r_b!r} m")
    inner = (1.0 / (1.0 / r_b + 1.0 / r_i), 1.0 / (1.0 / r_b - 1.0 / r_gi))
    return inner, (1.0 / (1.0 / r_b - 1.0 / r_o), 1.0 / (1.0 / r_b - 1.0 / r_go))


def contact_patches(bearing: Bearing, force: float) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return (half length, half width), m, of the contacts of one element with inner and outer race under a force, N.

    They are a and b of Eqs. 11-12 for balls, half the effective length (across rolling) and a of Eq. 4 for rollers.

    Raises:
        ValueError: if a radius that the contact needs is unknown or does not conform; the message names it.
    """
    if bearing.element == "ball":
        inner, outer = (point_contact_semi_axes(*radii, force) for radii in relative_radii(bearing))
        return inner, outer
    length, r_c = known_length(bearing, "effective_length"), 0.5 * bearing.element_diameter
    r_i, r_o = known_length(bearing, "inner_race_radius"), known_length(bearing, "outer_race_radius")
    widths = [
        line_contact_half_width(1.0 / curvature, length, force)
        for curvature in (1.0 / r_c + 1.0 / r_i, 1.0 / r_c - 1.0 / r_o)
    ]
    return (0.5 * length, widths[0]), (0.5 * length, widths[1])


def known_length(bearing: Bearing, name: str) -> float:
    """Return a length of a bearing, m.

    Raises:
        ValueError: if it is unknown; the message names it.
    """
    value = getattr(bearing, name)
    if value is None:
        raise ValueError(f"{bearing.designation}: contact stiffness needs {name}, which is unknown")
    return float(value)


def element_angles(bearing: Bearing, cage_angle: float = 0.0) -> NDArray[np.float64]:
    """Return the angles of all elements from the load direction, rad, shape (rows * n_elements,) (Eq. 32).

    The rows of a bearing with several are staggered evenly, two of them by half a spacing.
    """
    pitch = 2.0 * math.pi / bearing.n_elements
    row = pitch / bearing.rows * np.arange(bearing.rows)[:, None]
    return (cage_angle + row + pitch * np.arange(bearing.n_elements)[None, :]).ravel()


def contact_forces(
    displacement: NDArray[np.float64],
    angles: NDArray[np.float64],
    k_c: float,
    clearance: float | NDArray[np.float64],
    exponent: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the static contact force (2,) in N and its Jacobian (2, 2) in N/m at a relative displacement (2,) in m.

    The clearance (m) may be that of each element, shape (elements,): h + d where a defect lets an element sink by d.

    Source: Eqs. 20, 23, 24 and, for the Jacobian, 61.
    """
    return _forces(displacement, np.stack((np.cos(angles), np.sin(angles))), k_c, clearance, exponent)


def _forces(
    displacement: NDArray[np.float64],
    normals: NDArray[np.float64],
    k_c: float,
    clearance: float | NDArray[np.float64],
    exponent: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return what :func:`contact_forces` returns, for unit vectors to the elements, shape (2, elements)."""
    delta = np.maximum(displacement @ normals - clearance, 0.0)
    force = normals @ (k_c * delta**exponent)
    tangent, pressed = np.zeros_like(delta), delta > 0.0
    tangent[pressed] = exponent * k_c * delta[pressed] ** (exponent - 1.0)
    return force, (normals * tangent) @ normals.T


def static_equilibrium(
    angles: NDArray[np.float64],
    load: float,
    k_c: float,
    *,
    clearance: float | NDArray[np.float64] = 0.0,
    exponent: float = BALL_EXPONENT,
) -> NDArray[np.float64]:
    """Return the displacement of the inner against the outer ring under a radial load, m (Eqs. 20-25).

    A damped Newton iteration on the convex elastic energy: the loaded ring settles where the contacts carry the load.

    Args:
        angles: of all elements from the load direction, rad, shape (elements,).
        clearance: radial clearance h of Eq. 20, m, not negative (preload is not modelled); of each element, shape
            (elements,), where a defect lets some sink deeper.

    Returns:
        Shape (2,): along the load, across it.

    Raises:
        ValueError: if the load or the clearance is negative or not finite.
        RuntimeError: if the iteration does not settle (it does for every physical input that was tried).
    """
    for name, value in (("load", load), ("clearance", clearance)):
        if not bool(np.all(np.isfinite(value) & (np.asarray(value) >= 0.0))):
            raise ValueError(f"{name} must be finite and not negative, got {value!r}")
    if load == 0.0:
        return np.zeros(2)
    target, unit = np.array([load, 0.0]), np.eye(2)
    cosine, sine = np.cos(angles), np.sin(angles)
    normals = np.stack((cosine, sine))

    def energy(u: NDArray[np.float64]) -> float:
        delta = np.maximum(u[0] * cosine + u[1] * sine - clearance, 0.0)
        return float(k_c / (exponent + 1.0) * np.sum(delta ** (exponent + 1.0)) - load * u[0])

    # The start must touch an element: without one there is no gradient that leads to the load.
    approach = float(np.max(clearance)) + (5.0 * load / (len(angles) * k_c)) ** (1.0 / exponent)
    u = np.array([approach / float(cosine.max()), 0.0])
    level = energy(u)
    # One element in contact leaves the direction across it without stiffness, so the Newton step is damped
    # (Levenberg): less after each success, more after each failure.
    damping = 1e-3
    for _ in range(_NEWTON_STEPS):
        force, jacobian = _forces(u, normals, k_c, clearance, exponent)
        residual = target - force
        if float(np.abs(residual).max()) <= 1e-12 * load:
            return u
        damped = jacobian + damping * float(np.trace(jacobian)) * unit
        trial = u + np.asarray(np.linalg.solve(damped, residual), dtype=np.float64)
        # Near the solution the energy is flat to rounding; an increase within rounding is accepted.
        reached = energy(trial)
        if reached <= level + 1e-14 * load * float(np.abs(u).max()):
            u, level, damping = trial, reached, max(0.1 * damping, 1e-14)
        else:
            damping *= 10.0
    force, jacobian = _forces(u, normals, k_c, clearance, exponent)
    # Beside a large clearance the displacement has no digits for a small compression.
    rounding = 4.0 * np.finfo(float).eps * float(np.trace(jacobian) * np.abs(u).max())
    if float(np.abs(target - force).max()) <= 1e-6 * load + rounding:
        return u
    raise RuntimeError(f"static equilibrium did not settle: load {load!r} N, clearance {clearance!r} m")


def bearing_stiffness(
    bearing: Bearing, load: float, k_c: float, *, clearance: float = 0.0, cage_angle: float = 0.0
) -> NDArray[np.float64]:
    """Return the stiffness matrix of the bearing at one cage angle, N/m, shape (2, 2) (Eq. 61).

    [0, 0] is k_yy of the thesis (along the load), [1, 1] its k_xx (across).
    """
    angles, exponent = element_angles(bearing, cage_angle), contact_exponent(bearing)
    u = static_equilibrium(angles, load, k_c, clearance=clearance, exponent=exponent)
    return contact_forces(u, angles, k_c, clearance, exponent)[1]


def mean_bearing_stiffness(
    bearing: Bearing, load: float, k_c: float, *, clearance: float = 0.0, points: int = 64
) -> NDArray[np.float64]:
    """Return the stiffness matrix averaged over one passage of an element, N/m, shape (2, 2) as bearing_stiffness."""
    period = 2.0 * math.pi / (bearing.n_elements * bearing.rows)
    matrices = [
        bearing_stiffness(bearing, load, k_c, clearance=clearance, cage_angle=period * i / points)
        for i in range(points)
    ]
    return np.mean(matrices, axis=0)


def l10h_life(
    dynamic_load_rating: float, load: float, speed: float, element: str = "ball", factor: float = 1.0
) -> float:
    """Return the rating life that 90 % of bearings reach, s, at a shaft speed in Hz (Eq. 1; ISO 281).

    Args:
        load: equivalent dynamic load P, N.
        element: "ball" (exponent 3) or "roller" (10/3: the 10/9 printed in the thesis is a misprint).
        factor: life factor alpha_l.

    Raises:
        ValueError: if an argument is not positive.
    """
    for name, value in (("dynamic_load_rating", dynamic_load_rating), ("load", load), ("speed", speed)):
        if not value > 0.0:
            raise ValueError(f"{name} must be positive, got {value!r}")
    exponent = 3.0 if element == "ball" else 10.0 / 3.0
    return factor * 1e6 / speed * (dynamic_load_rating / load) ** exponent
