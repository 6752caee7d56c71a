"""Meshes of the rings of a self-aligning ball bearing at full width, refined about one contact of row 0.

Half a ring, theta from 0 to pi, symmetric about the contact's axis; nothing is symmetric along the shaft. A point is
(r sin theta, r cos theta, z); the contact lies at theta = 0 on the race, its normal is inclined by the contact angle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from models.fe.meshes.grid import Chooser, FeMesh, FeMeshError, HexBlock, build, extrude, on_surface, tensor_section
from models.fe.meshes.roller_mesh import fan_section
from models.fe.meshes.sizing import ContactGrid, MeshRule, growing_lines
from models.fe.solid.condense import ContactFrame

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.fe.bearings.oblique import ObliqueGeometry
    from models.fe.meshes.geometry import Race

MAX_ANGLE = math.radians(20.0)
"""Largest elements around a ring, rad."""


@dataclass(frozen=True)
class RaceProfile:
    """Section of a race through the axis, and the contact of row 0 on it.

    Attributes:
        contact_radius, contact_z: radial and axial place of the contact, m.
        angle: contact angle, rad.
        centre: radial and axial place of the centre of the race's circle of row 0, m.
        radius: of that circle, m.
        land: radius of the lands beside the grooves, m; None for the sphere, which reaches over the whole width.
        back: radius of the bore or of the outside, m.
        width: m.
    """

    contact_radius: float
    contact_z: float
    angle: float
    centre: tuple[float, float]
    radius: float
    land: float | None
    back: float
    width: float

    def race(self, z: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the radius of the race at axial places, m."""
        if self.land is None:
            return np.sqrt(self.radius**2 - z**2)
        inside = np.maximum(self.radius**2 - (np.abs(z) - self.centre[1]) ** 2, 0.0)
        return np.minimum(self.centre[0] - np.sqrt(inside), self.land)

    def place(self, tangent: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the axial place of the points of the race at a distance from the contact along its tangent, m."""
        depth = self.radius - np.sqrt(self.radius**2 - tangent**2)
        side = -1.0 if self.land is None else 1.0
        return self.contact_z + tangent * math.cos(self.angle) + side * depth * math.sin(self.angle)

    def edges(self) -> list[float]:
        """Return the axial places where the section has an end or a corner, m, ascending."""
        half = 0.5 * self.width
        if self.land is None:
            return [-half, 0.0, half]
        reach = math.sqrt(self.radius**2 - (self.centre[0] - self.land) ** 2)
        low, high = self.centre[1] - reach, min(self.centre[1] + reach, half)
        corners = {low, high, half}
        return sorted(corners | {-corner for corner in corners})


def race_profile(geometry: ObliqueGeometry, race: Race) -> RaceProfile:
    """Return the section of a race."""
    angle = geometry.contact_angle
    distance = geometry.inner_contact_distance if race == "inner" else geometry.sphere_radius
    place = (distance * math.cos(angle), distance * math.sin(angle))
    if race == "inner":
        centre, radius, land, back = (
            geometry.groove_centre, geometry.groove_radius, geometry.land_radius, geometry.bore_radius,
        )  # fmt: skip
    else:
        centre, radius, land, back = (0.0, 0.0), geometry.sphere_radius, None, geometry.outside_radius
    return RaceProfile(place[0], place[1], angle, centre, radius, land, back, geometry.width)


def contact_frame(profile: RaceProfile, turn: float = 0.0, *, mirrored: bool = False) -> ContactFrame:
    """Return the frame of the contact of an element at an angle about the shaft, rad, in row 0 or, mirrored, in row 1.

    Rolling is along larger angles; the normal points away from the bearing's centre.
    """
    side = -1.0 if mirrored else 1.0
    s, c = math.sin(turn), math.cos(turn)
    radial, axial = math.cos(profile.angle), side * math.sin(profile.angle)
    rolling = np.array([c, -s, 0.0])
    normal = np.array([radial * s, radial * c, axial])
    along = np.array([-axial * s, -axial * c, radial])
    origin = np.array([profile.contact_radius * s, profile.contact_radius * c, side * profile.contact_z])
    return ContactFrame(origin, np.stack((rolling, normal, along)))


def largest_half_length(geometry: ObliqueGeometry) -> float:
    """Return how far from the contact the groove of the inner ring holds a patch, m, a twentieth within its edge."""
    profile = race_profile(geometry, "inner")
    low = min(edge for edge in profile.edges() if edge > 0.0)
    # The edge in the frame of the contact; the other one is farther.
    radial, axial = profile.race(np.array([low]))[0] - profile.contact_radius, low - profile.contact_z
    tangent = -math.sin(profile.angle) * radial + math.cos(profile.angle) * axial
    return 0.95 * abs(float(tangent))


def axial_lines(profile: RaceProfile, grid: ContactGrid, rule: MeshRule) -> NDArray[np.float64]:
    """Return the axial grid lines of a ring, m: the contact's own, then growing ones with a line at each corner."""
    tangent = np.concatenate((-grid.z[:0:-1], grid.z))
    patch = profile.place(tangent)
    largest = min(rule.coarse * abs(profile.contact_radius - profile.back), rule.max_size)
    edges = np.array(profile.edges())
    if profile.land is not None and bool(np.any((edges > patch[0]) & (edges < patch[-1]))):
        raise FeMeshError(
            f"the patch of the inner contact, {1e3 * float(patch[0]):.3g} to {1e3 * float(patch[-1]):.3g} mm along the "
            "shaft, reaches over the edge of its groove: the load is too large"
        )
    above = _outwards(float(patch[-1]), float(patch[-1] - patch[-2]), edges[edges > patch[-1]], rule.growth, largest)
    below = _outwards(
        -float(patch[0]), float(patch[1] - patch[0]), -edges[edges < patch[0]][::-1], rule.growth, largest
    )
    return np.concatenate((-below[::-1], patch, above))


def _outwards(
    start: float, size: float, edges: NDArray[np.float64], growth: float, largest: float
) -> NDArray[np.float64]:
    """Return lines beyond ``start`` over ascending edges, the sizes growing from edge to edge."""
    lines: list[NDArray[np.float64]] = []
    for edge in edges:
        part = growing_lines(start, float(edge), growth * size, growth, largest)
        lines.append(part[1:])
        start, size = float(edge), float(part[-1] - part[-2])
    return np.concatenate(lines)


def oblique_ring_mesh(geometry: ObliqueGeometry, race: Race, grid: ContactGrid, rule: MeshRule) -> FeMesh:
    """Return the mesh of half a ring of quadratic hexahedra.

    Boundaries: race (grooves and lands, or sphere), bore, outside, x0 (theta = 0 and pi), side.

    Raises:
        FeMeshError: the sizes do not fit the ring.
    """
    profile = race_profile(geometry, race)
    depth = abs(profile.contact_radius - profile.back)
    section = fan_section(grid, depth, rule)
    lines = axial_lines(profile, grid, rule)
    end = math.asin(depth / profile.contact_radius)
    around = growing_lines(end, math.pi, end / (section.far.size - 1), rule.growth, MAX_ANGLE)
    rest = tensor_section((around - end) / (math.pi - end), section.far)

    def body(angle: NDArray[np.float64], v: NDArray[np.float64], z: NDArray[np.float64]) -> NDArray[np.float64]:
        radius = profile.race(z) * (1.0 - v) + profile.back * v
        return np.stack((radius * np.sin(angle), radius * np.cos(angle), z))

    def near(point: NDArray[np.float64]) -> NDArray[np.float64]:
        return body(np.arcsin(point[0] * depth / profile.contact_radius), point[1], point[2])

    def far(point: NDArray[np.float64]) -> NDArray[np.float64]:
        return body(end + point[0] * (math.pi - end), point[1], point[2])

    def radius(p: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.hypot(p[0], p[1])

    back = "bore" if race == "inner" else "outside"
    boundaries: dict[str, Chooser] = {
        back: on_surface(lambda p: radius(p) - profile.back, depth),
        "x0": on_surface(lambda p: p[0], depth),
        "side": on_surface(lambda p: np.abs(p[2]) - 0.5 * profile.width, depth),
        "race": on_surface(lambda p: radius(p) - profile.race(p[2]), depth),
    }
    blocks = [HexBlock(extrude(section.quads, lines), near), HexBlock(extrude(rest.quads, lines), far)]
    return build(blocks, boundaries, 2)
