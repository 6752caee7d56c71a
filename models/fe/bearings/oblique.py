"""Geometry of self-aligning ball bearings: two rows at a contact angle.

The outer race is a sphere about the bearing's centre O. The normals of all contacts therefore meet in O: the ring does
not resist a tilt about it, three displacements describe its place, and the contact angle does not change with the load
(beyond approach over radius, 1e-3 at the static rating). Neither ring is symmetric about the plane of a row.

SI units and radians; row 0 lies on the positive side of the shaft's axis.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from models.words.checks import check_numbers, check_whole
from models.words.errors import WrongInputError

if TYPE_CHECKING:
    from models.machine.bearing import Bearing, CatalogueEntry

ROWS = 2
# How far the two printed radii of an outer race may differ and still be one sphere.
SAME_RADIUS = 1e-3
_BARREL_REASON = (
    "the profile of its barrel rollers is not in the catalogue, and by its osculation the contact is anything from a "
    "point to a line, and the stiffness uncertain by a half; give the law of a crowned roller to ObliqueBearing"
)


class ObliqueError(WrongInputError):
    """A bearing that the assembly of oblique rows does not describe; the message names field and reason."""


@dataclass(frozen=True)
class ObliqueGeometry:
    """A self-aligning ball bearing, SI units and radians.

    Attributes:
        n_elements: balls in one of the two rows; the rows are staggered by half a spacing.
        contact_angle: between the normals of the contacts and the radial plane.
        ball_radius: r_b.
        sphere_radius: r_o of the outer race, about the bearing's centre.
        groove_radius: of the grooves of the inner ring, in the plane of the axis.
        land_radius: of the inner ring between and beside its grooves.
        bore_radius, outside_radius, width: of the rings; both are of one width.
        modulus, poisson: of balls and rings, Pa and 1.
    """

    n_elements: int
    contact_angle: float
    ball_radius: float
    sphere_radius: float
    groove_radius: float
    land_radius: float
    bore_radius: float
    outside_radius: float
    width: float
    modulus: float = 210e9
    poisson: float = 0.3

    def __post_init__(self) -> None:
        """Raise a ValueError that names a field with which the parts do not fit."""
        check_whole(self.n_elements, "n_elements", 3)
        check_numbers(
            self, "", "positive", "contact_angle", "ball_radius", "sphere_radius", "groove_radius", "land_radius",
            "bore_radius", "outside_radius", "width", "modulus",
        )  # fmt: skip
        if not 0.0 <= self.poisson < 0.5:
            raise ValueError(f"poisson must lie from 0 to below 0.5, got {self.poisson!r}")
        radial = self.inner_contact_distance * math.cos(self.contact_angle)
        rules = (
            ("groove_radius", self.ball_radius < self.groove_radius, "must exceed ball_radius"),
            ("sphere_radius", 2.0 * self.ball_radius < self.sphere_radius, "must exceed the diameter of a ball"),
            ("bore_radius", self.bore_radius < radial, f"must lie below the grooves' bottom, {radial!r}"),
            ("outside_radius", self.sphere_radius < self.outside_radius, "must exceed sphere_radius"),
            ("width", self.axial_distance < 0.5 * self.width, "must hold the balls' centres"),
            ("land_radius", radial < self.land_radius < self.groove_centre[0], "must lie within the grooves' depth"),
        )
        for name, met, rule in rules:
            if not met:
                raise ValueError(f"{name} {rule}, got {getattr(self, name)!r}")

    @property
    def centre_distance(self) -> float:
        """Distance of the balls' centres from the bearing's centre, m."""
        return self.sphere_radius - self.ball_radius

    @property
    def inner_contact_distance(self) -> float:
        """Distance of the contacts with the inner ring from the bearing's centre, m: their radius along rolling."""
        return self.sphere_radius - 2.0 * self.ball_radius

    @property
    def groove_centre(self) -> tuple[float, float]:
        """Radius and axial place of the centre of curvature of the groove of row 0, m."""
        distance = self.inner_contact_distance + self.groove_radius
        return distance * math.cos(self.contact_angle), distance * math.sin(self.contact_angle)

    @property
    def axial_distance(self) -> float:
        """Axial distance of the balls' centres from the middle, m."""
        return self.centre_distance * math.sin(self.contact_angle)

    @property
    def relative_radii(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Relative radii (rolling, across) of a ball on the inner and on the outer race, m."""
        r_b, r_o = self.ball_radius, self.sphere_radius
        inner = (1.0 / (1.0 / r_b + 1.0 / self.inner_contact_distance), 1.0 / (1.0 / r_b - 1.0 / self.groove_radius))
        outer = 1.0 / (1.0 / r_b - 1.0 / r_o)
        return inner, (outer, outer)

    @property
    def effective_modulus(self) -> float:
        """E' of models.machine.hertz: E / (1 - nu^2), Pa."""
        return self.modulus / (1.0 - self.poisson**2)


def oblique_geometry(entry: CatalogueEntry) -> ObliqueGeometry:
    """Return the geometry of a self-aligning ball bearing of the catalogue.

    The contacts follow from outer sphere, ball and contact angle. The ``inner_race_radius`` of the catalogue is taken
    as that of the lands beside the grooves: the 16.64 mm of the 1205 ETN9 and the diameter of a ball would reach
    0.85 mm beyond the sphere, and are the shoulder's radius of the makers' tables.

    Raises:
        ObliqueError: bearing of another kind, or a dimension is unknown; the message names it.
    """
    bearing = entry.bearing
    reason = _refusal(bearing)
    if reason is not None:
        raise ObliqueError(f"{bearing.designation}: {reason}")
    lengths = {
        name: _known(bearing, name) for name in ("outer_race_radius", "inner_groove_radius", "inner_race_radius")
    }
    if entry.dimensions is None:
        raise ObliqueError(f"{bearing.designation}: bore, outside diameter and width of its rings are unknown")
    bore, outside, width = entry.dimensions
    try:
        return ObliqueGeometry(
            bearing.n_elements,
            bearing.contact_angle,
            0.5 * bearing.element_diameter,
            lengths["outer_race_radius"],
            lengths["inner_groove_radius"],
            lengths["inner_race_radius"],
            0.5 * bore,
            0.5 * outside,
            width,
        )
    except ValueError as error:
        raise ObliqueError(f"{bearing.designation}: {error}") from None


def _refusal(bearing: Bearing) -> str | None:
    """Return why a bearing is not one of two oblique rows of balls in a sphere, None where it is."""
    if bearing.contact_angle == 0.0:
        return "its contact angle is zero: it is computed with the symmetry about the plane of its row"
    if bearing.element == "roller" and bearing.rows == 1:
        return (
            "tapered rollers touch both races at different angles and lean on a flange, which carries a part of the "
            "load; flange and angles are not in the catalogue, and a law along one normal does not describe them"
        )
    if bearing.element == "roller":
        return _BARREL_REASON
    if bearing.rows != ROWS:
        return (
            "one row at a contact angle needs an axial load, which changes its angle: "
            "models.machine.ball_statics does that"
        )
    r_o, r_go = bearing.outer_race_radius, bearing.outer_groove_radius
    if r_o is None or r_go is None:
        return f"{'outer_race_radius' if r_o is None else 'outer_groove_radius'} is unknown"
    if abs(r_o - r_go) > SAME_RADIUS * r_o:
        return (
            f"its outer race is no sphere (outer_race_radius {1e3 * r_o:g} mm, outer_groove_radius {1e3 * r_go:g} mm): "
            "the contact angle then changes with the load"
        )
    return None


def _known(bearing: Bearing, name: str) -> float:
    value = getattr(bearing, name)
    if value is None:
        raise ObliqueError(f"{bearing.designation}: {name} is unknown")
    return float(value)
