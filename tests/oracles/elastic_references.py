"""Closed forms that contacts of finite elements are checked against, with their supports.

* Half space under a point load at the origin (Boussinesq; Johnson, Contact Mechanics, 1985, Eq. 3.19) and half plane
  under a line load (Flamant; Eq. 2.20): imposed on the far sides of a block, they make it part of an infinite body.
* A sphere pressed at both poles: Legendre series of Lur'e (Three-dimensional problems of the theory of elasticity,
  1964, section 6) for uniform pressures along the axis on rings about the poles. The contact of these rings with a flat
  is the reference for the approach between pole and middle plane: Hertz's own formula measures from far away in a half
  space.
* A cylinder between flats in plane strain (Johnson, Eq. 5.57).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from models.fe.solid.contact import press_to_force
from models.machine.hertz import point_contact_semi_axes, point_contact_stiffness

if TYPE_CHECKING:
    from numpy.typing import NDArray

MODULUS, POISSON = 210e9, 0.3
PLANE_MODULUS = MODULUS / (1.0 - POISSON**2)
SHEAR = 0.5 * MODULUS / (1.0 + POISSON)
SERIES_TERMS, RINGS = 8000, 100


@dataclass(frozen=True)
class Reference:
    """Approach of one body, m; semi-axes along x and z (of a line: infinite), m; peak pressure, Pa."""

    approach: float
    half_width: float
    half_length: float
    peak: float


def hertz_point(radius_x: float, radius_z: float, force: float) -> Reference:
    """Return Hertz's contact of a half space with a rigid body of two radii, radius_z at least radius_x, m."""
    modulus = PLANE_MODULUS
    # E' of models.machine.hertz is twice the modulus of contact; the rigid body leaves that of one half space.
    axes = point_contact_semi_axes(radius_x, radius_z, force, "elliptic", modulus=2.0 * modulus)
    stiffness = point_contact_stiffness(radius_x, radius_z, "elliptic", modulus=2.0 * modulus)
    peak = 1.5 * force / (math.pi * axes[0] * axes[1])
    return Reference((force / stiffness) ** (2.0 / 3.0), axes[1], axes[0], peak)


def hertz_line(radius: float, load: float, approach_of: Line) -> Reference:
    """Return Hertz's line contact of a body with a rigid one, ``load`` in N/m, with the approach of its supports."""
    half_width = math.sqrt(4.0 * load * radius / (math.pi * PLANE_MODULUS))
    return Reference(approach_of(load, half_width), half_width, math.inf, 2.0 * load / (math.pi * half_width))


class Line:
    """Approach of a line contact: P' / (pi E*) times a logarithm of the support."""

    def __init__(self, depth: float, constant: float) -> None:
        """Take P' / (pi E*) (2 ln(depth / half width) + constant)."""
        self.depth, self.constant = depth, constant

    def __call__(self, load: float, half_width: float) -> float:
        """Return the approach under a load, N/m, at a half width, m."""
        return load / (math.pi * PLANE_MODULUS) * (2.0 * math.log(self.depth / half_width) + self.constant)


def cylinder_between_flats(radius: float) -> Line:
    """Return the approach of the middle of a cylinder to one flat (Johnson, Eq. 5.57)."""
    return Line(4.0 * radius, -1.0)


def half_plane_to_depth(depth: float) -> Line:
    """Return the approach of the surface to a point at a depth under the contact (Johnson, Eq. 5.56)."""
    return Line(2.0 * depth, -POISSON / (1.0 - POISSON))


def boussinesq(places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the displacement (3, n), m/N, at places (3, n) with y < 0 of a unit load along -y at the origin."""
    x, depth, z = places[0], -places[1], places[2]
    r = np.sqrt(x**2 + depth**2 + z**2)
    scale = 1.0 / (4.0 * math.pi * SHEAR)
    radial = depth / r**3 - (1.0 - 2.0 * POISSON) / (r * (r + depth))
    down = depth**2 / r**3 + 2.0 * (1.0 - POISSON) / r
    return scale * np.stack((x * radial, -down, z * radial))


def flamant(places: NDArray[np.float64], depth: float) -> NDArray[np.float64]:
    """Return the displacement (2, n), m per N/m, of a unit line load along -y, zero at a depth under it."""
    x, down = places[0], -places[1]
    r, angle = np.hypot(x, down), np.arctan2(x, down)
    k = 1.0 - POISSON

    def parts(r: NDArray[np.float64], angle: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        # Johnson's Eq. 2.20 with plane strain constants; radial and tangential towards larger angles.
        radial = -2.0 * k * np.cos(angle) * np.log(r) - (1.0 - 2.0 * POISSON) * angle * np.sin(angle)
        turning = 2.0 * POISSON * np.sin(angle) + 2.0 * k * np.log(r) * np.sin(angle)
        turning += (1.0 - 2.0 * POISSON) * (np.sin(angle) - angle * np.cos(angle))
        return radial, turning

    radial, turning = parts(r, angle)
    rigid = parts(np.array([depth]), np.array([0.0]))[0][0]
    across = radial * np.sin(angle) + turning * np.cos(angle)
    below = radial * np.cos(angle) - turning * np.sin(angle) - rigid
    return np.stack((across, -below)) / (2.0 * math.pi * SHEAR)


def sphere_compliance(angles: NDArray[np.float64], *, along_axis: bool = True) -> NDArray[np.float64]:
    """Return C of a unit sphere, m^3/Pa, for rings between angles from both poles, (rings, rings).

    The pressure is along the axis, per area of the tangent plane, and so is the displacement read: a flat stays flat.
    With ``along_axis=False`` both are along the normals of the sphere.
    """
    count = len(angles) - 1
    nodes, weights = np.polynomial.legendre.leggauss(4)
    half = 0.5 * np.diff(angles)
    theta = (0.5 * (angles[1:] + angles[:-1]) + half * nodes[:, None]).ravel()
    p = legendre(np.cos(theta), SERIES_TERMS)
    n = np.arange(2.0, SERIES_TERMS + 1.0, 2.0)[:, None]
    sine, cosine = np.sin(theta), np.cos(theta)
    slope = n * (cosine * p[2::2] - p[1:-1:2]) / sine
    measure = (weights[:, None] * half).ravel() * sine * cosine

    def over_rings(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return (values * measure).reshape(-1, len(nodes), count).sum(axis=1)

    normal, turning = over_rings(cosine * p[2::2]), over_rings(-sine * slope)
    if not along_axis:
        normal, turning = over_rings(p[2::2] / cosine), np.zeros_like(turning)
    modes = _sphere_modes(n[:, 0])
    spread = (n * (n + 1.0))[:, 0]
    scale = 2.0 * math.pi * (2.0 * n[:, 0] + 1.0)
    matrix = np.einsum("na,n,nb->ab", normal, scale * modes[:, 0, 0], normal, optimize=True)
    matrix += np.einsum("na,n,nb->ab", normal, scale * modes[:, 0, 1] / spread, turning, optimize=True)
    matrix += np.einsum("na,n,nb->ab", turning, scale * modes[:, 1, 0], normal, optimize=True)
    matrix += np.einsum("na,n,nb->ab", turning, scale * modes[:, 1, 1] / spread, turning, optimize=True)
    # The mean pressure, n = 0, compresses the sphere evenly.
    mean = over_rings((cosine if along_axis else 1.0 / cosine)[None])[0]
    matrix += 2.0 * math.pi * (1.0 - 2.0 * POISSON) / MODULUS * np.outer(mean, mean)
    return 0.5 * (matrix + matrix.T)


def _sphere_modes(n: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (u_r, u_theta) of tractions (P_n normal, dP_n/dtheta tangential) on a unit sphere, m/Pa, (n, 2, 2).

    Source: Lur'e 1964: u_r = (A (n + 1)(n - 2 + 4 nu) + B n) P_n, u_theta = (A (n + 5 - 4 nu) + B) dP_n/dtheta,
    sigma = 2 G (A (n + 1)(n^2 - n - 2 - 2 nu) + B n (n - 1)) P_n and
    tau = 2 G (A (n^2 + 2 n - 1 + 2 nu) + B (n - 1)) dP_n/dtheta on the surface.
    """
    nu, one = POISSON, np.ones_like(n)
    traction = np.array(
        [[(n + 1.0) * (n**2 - n - 2.0 - 2.0 * nu), n * (n - 1.0)], [n**2 + 2.0 * n - 1.0 + 2.0 * nu, n - 1.0]]
    )
    motion = np.array([[(n + 1.0) * (n - 2.0 + 4.0 * nu), n], [n + 5.0 - 4.0 * nu, one]])
    return np.moveaxis(motion, 2, 0) @ np.linalg.inv(2.0 * SHEAR * np.moveaxis(traction, 2, 0))


def legendre(x: NDArray[np.float64], highest: int) -> NDArray[np.float64]:
    """Return P_0 .. P_highest at x, shape (highest + 1, len(x))."""
    values = np.empty((highest + 1, len(x)))
    values[0], values[1] = 1.0, x
    for n in range(1, highest):
        values[n + 1] = ((2 * n + 1) * x * values[n] - n * values[n - 1]) / (n + 1)
    return values


def sphere_between_flats(radius: float, force: float, *, along_axis: bool = True) -> Reference:
    """Return the contact of a sphere with one of two flats: approach from its middle plane, by the series."""
    hertz = hertz_point(radius, radius, force)
    angles = np.linspace(0.0, 1.6 * hertz.half_width / radius, RINGS + 1)
    area = math.pi * radius**2 * np.diff(np.sin(angles) ** 2)
    # Mean of R (1 - cos theta) over the area of the tangent plane.
    gap = radius * (1.0 + 2.0 / 3.0 * np.diff(np.cos(angles) ** 3) / np.diff(np.sin(angles) ** 2))
    state = press_to_force(radius**3 * sphere_compliance(angles, along_axis=along_axis), gap, area, force)
    assert state.converged
    return Reference(state.approach, hertz.half_width, hertz.half_length, hertz.peak)
