"""Self-aligning ball bearings: two rows at a contact angle, assembled from a law of one ball and the rings' influence.

The outer race is a sphere about the bearing's centre O. The normals of all contacts therefore meet in O: the ring does
not resist a tilt about it, three displacements describe its place, and the contact angle does not change with the load
(beyond approach over radius, 1e-3 at the static rating). Neither ring is symmetric about the plane of a row.

SI units and radians. Axis 1 lies along the radial load, axis 2 across it, axis 3 along the shaft; row 0 lies on the
positive side of axis 3.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from models.fe.bearings.balance import Balance, condensed, settle
from models.machine.load_distribution import StiffnessPassage
from models.words.checks import check_choice, check_numbers, check_whole
from models.words.errors import WrongInputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.fe.bearings.law import ElementLaw
    from models.machine.bearing import Bearing, CatalogueEntry

Axial = Literal["free", "held"]
AXIAL: tuple[Axial, ...] = get_args(Axial)
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


@dataclass(frozen=True, eq=False)
class RowInfluence:
    """Normal displacement at an element by a unit force on another one, both rings together, m/N.

    Both rings sit on rigid seats, so that only the angle between the two elements matters. Positive where the
    displacement takes the load off.

    Attributes:
        same: in the same row, at 0, 1, .. spacings, shape (n_elements,); the first is not used.
        other: in the other row, at 0.5, 1.5, .. spacings, shape (n_elements,).
    """

    same: NDArray[np.float64]
    other: NDArray[np.float64]

    def matrix(self) -> NDArray[np.float64]:
        """Return the influence of all elements on each other, row after row, zero on the diagonal."""
        count = len(self.same)
        step = (np.arange(count)[:, None] - np.arange(count)[None, :]) % count
        within = np.where(step == 0, 0.0, self.same[step])
        # Element k of row 1 stands half a spacing after element k of row 0.
        across = self.other[(np.arange(count)[None, :] - np.arange(count)[:, None]) % count]
        return np.block([[within, across], [across.T, within]])

    @classmethod
    def none(cls, count: int) -> RowInfluence:
        """Return that of rings which are rigid but for their contacts."""
        return cls(np.zeros(count), np.zeros(count))


@dataclass(frozen=True, eq=False)
class ObliqueBearing:
    """Two rows of elements at a contact angle between rings on rigid seats.

    Attributes:
        n_elements: in each row.
        contact_angle: rad; zero is two radial rows.
        law: force of one element over the approach of the races along its normal.
        influence: of the elements on each other through the rings.
        clearance: gap along the normals before the ring is displaced, m, not negative.
    """

    n_elements: int
    contact_angle: float
    law: ElementLaw
    influence: RowInfluence
    clearance: float = 0.0

    def __post_init__(self) -> None:
        """Raise a ValueError that names an unusable value."""
        check_whole(self.n_elements, "n_elements", 3)
        check_numbers(self, "", "not negative", "clearance", "contact_angle")
        if len(self.influence.same) != self.n_elements or len(self.influence.other) != self.n_elements:
            raise ValueError(
                f"influence must have {self.n_elements} values in each row, got {len(self.influence.same)} and "
                f"{len(self.influence.other)}"
            )

    @property
    def spacing(self) -> float:
        """Angle between neighbours of a row, rad."""
        return 2.0 * math.pi / self.n_elements

    def angles(self, cage_angle: float = 0.0) -> NDArray[np.float64]:
        """Return the angles of the elements from the load, rad, row after row, shape (2 n_elements,)."""
        row = np.array([0.0, 0.5])[:, None] + np.arange(self.n_elements)[None, :]
        return np.asarray(cage_angle + self.spacing * row.ravel(), dtype=np.float64)

    def normals(self, cage_angle: float = 0.0) -> NDArray[np.float64]:
        """Return the unit vectors from the bearing's centre to the contacts, shape (2 n_elements, 3)."""
        angles = self.angles(cage_angle)
        radial, axial = math.cos(self.contact_angle), math.sin(self.contact_angle)
        sides = np.repeat([axial, -axial], self.n_elements)
        return np.column_stack((radial * np.cos(angles), radial * np.sin(angles), sides))

    def state(self, load: float, *, cage_angle: float = 0.0, axial: Axial = "free") -> Balance:
        """Return the equilibrium under a radial load, N.

        Args:
            axial: "free", no axial force: the ring finds its place between the rows; "held", it does not move axially.
                The third coordinate of the result is then absent.

        Raises:
            ValueError: if the load is not positive, or ``axial`` none of the choices.
            RuntimeError: if no equilibrium is found.
        """
        check_choice(axial, "axial", AXIAL)
        if not (math.isfinite(load) and load > 0.0):
            raise ValueError(f"load must be finite and positive, got {load!r} N")
        kept = 3 if axial == "free" and self.contact_angle > 0.0 else 2
        wanted = np.zeros(kept)
        wanted[0] = load
        matrix = self.influence.matrix()
        return settle(
            self.normals(cage_angle)[:, :kept],
            self.law,
            wanted,
            influence=matrix if matrix.any() else None,
            clearance=self.clearance,
        )

    def stiffness(self, load: float, *, cage_angle: float = 0.0, axial: Axial = "free") -> NDArray[np.float64]:
        """Return the radial stiffness, N/m, shape (2, 2): [0, 0] along the load (k_yy of the thesis), [1, 1] across.

        Arguments and errors as in ``state``; an axial displacement that is free follows.
        """
        matrix = self.state(load, cage_angle=cage_angle, axial=axial).stiffness
        return condensed(matrix, 2) if len(matrix) == 3 else matrix

    def stiffness_over_passage(self, load: float, points: int = 60, *, axial: Axial = "free") -> StiffnessPassage:
        """Return the stiffness while the cage turns by one spacing of a row, at equal steps.

        Raises:
            ValueError: if ``points`` is below 2, or as ``state``.
        """
        check_whole(points, "points", 2)
        angles = np.asarray(self.spacing / points * np.arange(points), dtype=np.float64)
        matrices = [self.stiffness(load, cage_angle=float(angle), axial=axial) for angle in angles]
        return StiffnessPassage(angles, np.array(matrices))
