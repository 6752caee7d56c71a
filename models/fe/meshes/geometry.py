"""Dimensions of a bearing as its finite elements need them, and the profile of its rollers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Literal

import numpy as np

from models.words.errors import WrongInputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.machine.bearing import Bearing, CatalogueEntry, Element

Race = Literal["inner", "outer"]
Profile = Literal["straight", "crowned", "logarithmic"]

STEEL_MODULUS = 210e9
STEEL_POISSON = 0.3
# Height of the shoulders over the bottom of the groove by the ball's diameter, where no drawing is known: assumed.
SHOULDER_HEIGHT = 0.2
# Radius of a roller's rounded edge by its diameter, where no drawing is known: 0.2 mm of the 5.5 mm of NU 202 ECP
# (thesis, section 3.2.1).
EDGE_RADIUS = 0.2 / 5.5
# Factor of the diameter in the logarithmic profile, for rollers up to 2.5 diameters long and for longer ones.
_LOG_SHORT, _LOG_LONG, _LOG_RATIO = 0.00035, 0.0005, 2.5


class FeGeometryError(WrongInputError):
    """A bearing that the meshes cannot describe; the message names the field and the reason."""


@dataclass(frozen=True)
class FeGeometry:
    """Dimensions of a bearing, m and rad, and the elastic constants of its steel.

    Attributes:
        inner_race_radius, outer_race_radius: at the bottom of the race, from the shaft's axis.
        inner_groove_radius, outer_groove_radius: radii of curvature across rolling, or None (rollers); an outer groove
            of the radius of the race itself is a sphere (self-aligning).
        effective_length: length of the line contact, or None (balls).
        roller_length: whole length with both rounded edges, or None.
        profile: of the roller within its effective length; ``crown_radius`` is the radius of a crowned one.
        shoulder_height: of the shoulders over the bottom of the groove.
        width: of the rings.
        modulus, poisson: Young's modulus, Pa, and Poisson's ratio.
    """

    designation: str
    element: Element
    n_elements: int
    rows: int
    contact_angle: float
    element_radius: float
    inner_race_radius: float
    outer_race_radius: float
    bore_radius: float
    outside_radius: float
    width: float
    inner_groove_radius: float | None = None
    outer_groove_radius: float | None = None
    shoulder_height: float = 0.0
    effective_length: float | None = None
    roller_length: float | None = None
    edge_radius: float = 0.0
    profile: Profile = "straight"
    crown_radius: float | None = None
    modulus: float = STEEL_MODULUS
    poisson: float = STEEL_POISSON

    def __post_init__(self) -> None:
        """Refuse dimensions that contradict each other."""
        self._check_order("bore_radius", "inner_race_radius", "outer_race_radius", "outside_radius")
        for name in ("element_radius", "width", "modulus", "bore_radius"):
            if not (math.isfinite(self._number(name)) and self._number(name) > 0.0):
                raise self._error(name, f"must be positive and finite, got {self._number(name)!r}")
        if not 0.0 <= self.poisson < 0.5:
            raise self._error("poisson", f"must be from 0 to below 0.5, got {self.poisson!r}")
        if self.element == "ball":
            self._check_grooves()
        else:
            self._check_roller()

    def race_radius(self, race: Race) -> float:
        """Return the radius of a race at the bottom, m."""
        return self.inner_race_radius if race == "inner" else self.outer_race_radius

    def back_radius(self, race: Race) -> float:
        """Return the radius of the bore (inner ring) or of the outside (outer ring), m."""
        return self.bore_radius if race == "inner" else self.outside_radius

    def groove_radius(self, race: Race) -> float | None:
        """Return the radius of curvature of a race across rolling, m, or None for a cylinder."""
        return self.inner_groove_radius if race == "inner" else self.outer_groove_radius

    @property
    def spherical_outer(self) -> bool:
        """Whether the outer race is a sphere about the bearing's centre."""
        groove = self.outer_groove_radius
        return groove is not None and math.isclose(groove, self.outer_race_radius, rel_tol=1e-6)

    def drop(self, z: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how far a roller's surface lies below its largest radius at ``z`` from its middle, m; inf beyond it.

        Within the effective length it is zero (straight), z^2 / (2 R) (crowned) or 0.00035 D ln(1 / (1 - (2 z / l)^2))
        (logarithmic; 0.0005 where l > 2.5 D; ISO 16281); beyond, the rounded edge takes over.

        Raises:
            FeGeometryError: balls have no profile.
        """
        if self.effective_length is None or self.roller_length is None:
            raise self._error("effective_length", "is unknown, and a profile needs it")
        half, end = 0.5 * self.effective_length, 0.5 * self.roller_length
        place = np.abs(np.asarray(z, dtype=np.float64))
        over = np.clip(place - half, 0.0, self.edge_radius)
        rounding = self.edge_radius - np.sqrt(self.edge_radius**2 - over**2)
        shape = self._shape(np.minimum(place, half * (1.0 - 1e-6)))
        return np.where(place <= end * (1.0 + 1e-12), shape + rounding, np.inf)

    def _shape(self, place: NDArray[np.float64]) -> NDArray[np.float64]:
        assert self.effective_length is not None
        if self.profile == "crowned":
            assert self.crown_radius is not None
            return 0.5 * place**2 / self.crown_radius
        if self.profile == "logarithmic":
            diameter = 2.0 * self.element_radius
            factor = _LOG_SHORT if self.effective_length <= _LOG_RATIO * diameter else _LOG_LONG
            return -factor * diameter * np.log1p(-((2.0 * place / self.effective_length) ** 2))
        return np.zeros_like(place)

    def _check_order(self, *names: str) -> None:
        for small, large in pairwise(names):
            if not self._number(small) < self._number(large):
                raise self._error(small, f"{self._number(small)!r} m must be below {large} {self._number(large)!r} m")

    def _check_grooves(self) -> None:
        for name in ("inner_groove_radius", "outer_groove_radius"):
            groove: float | None = getattr(self, name)
            if groove is None:
                raise self._error(name, "is unknown, and a ball's contact needs it")
            if groove <= self.element_radius:
                raise self._error(name, f"{groove!r} m must exceed the ball's radius {self.element_radius!r} m")
        if not 0.0 <= self.shoulder_height < self.element_radius:
            reason = f"{self.shoulder_height!r} m must be below the ball's radius {self.element_radius!r} m"
            raise self._error("shoulder_height", reason)

    def _check_roller(self) -> None:
        if self.effective_length is None or self.roller_length is None:
            raise self._error("effective_length", "is unknown, and a roller's contact needs it")
        if not 0.0 < self.effective_length <= self.roller_length <= self.width * (1.0 + 1e-12):
            reason = f"{self.effective_length!r} m must be positive, up to roller_length {self.roller_length!r} m"
            raise self._error("effective_length", f"{reason} and width {self.width!r} m")
        if not 0.0 <= self.edge_radius < self.element_radius:
            raise self._error("edge_radius", f"{self.edge_radius!r} m must be below element_radius")
        if self.roller_length > self.effective_length + 2.0 * self.edge_radius * (1.0 + 1e-9):
            reason = f"{self.roller_length!r} m exceeds effective_length by more than two rounded edges"
            raise self._error("roller_length", reason)
        if self.profile == "crowned" and not (self.crown_radius is not None and self.crown_radius > 0.0):
            raise self._error("crown_radius", f"must be positive for a crowned roller, got {self.crown_radius!r}")

    def _number(self, name: str) -> float:
        return float(getattr(self, name))

    def _error(self, name: str, reason: str) -> FeGeometryError:
        return FeGeometryError(f"{self.designation}: {name} {reason}")


def _race_radii(bearing: Bearing) -> tuple[float, float]:
    """Return the radii of the inner and the outer race, m; without a contact angle they follow from the pitch."""
    races = {"inner": bearing.inner_race_radius, "outer": bearing.outer_race_radius}
    for race, side in (("inner", -0.5), ("outer", 0.5)):
        if races[race] is None and bearing.contact_angle == 0.0:
            races[race] = 0.5 * bearing.pitch_diameter + side * bearing.element_diameter
    inner, outer = races["inner"], races["outer"]
    if inner is None or outer is None:
        missing = f"{bearing.designation}: {'inner' if inner is None else 'outer'}_race_radius is unknown"
        raise FeGeometryError(f"{missing}, and does not follow from the pitch at a contact angle")
    return inner, outer


def fe_geometry(
    entry: CatalogueEntry,
    *,
    modulus: float = STEEL_MODULUS,
    poisson: float = STEEL_POISSON,
    profile: Profile = "straight",
    crown_radius: float | None = None,
    edge_radius: float | None = None,
    shoulder_height: float | None = None,
) -> FeGeometry:
    """Return the dimensions of a bearing of the catalogue for finite elements.

    Race radii that the catalogue lacks follow from pitch and element diameter where the contact angle is zero. The
    edge radius of rollers is that of NU 202 ECP in proportion to the diameter unless given, the shoulders of grooves a
    fifth of the ball's diameter: neither is in the catalogue.

    Raises:
        FeGeometryError: a dimension is unknown or contradicts another, or the bearing is a tapered one.
    """
    bearing = entry.bearing
    name = bearing.designation
    if entry.dimensions is None:
        raise FeGeometryError(
            f"{name}: dimensions (bore, outside diameter, width) are unknown, and the rings need them"
        )
    if bearing.element == "roller" and bearing.rows == 1 and bearing.contact_angle != 0.0:
        raise FeGeometryError(f"{name}: contact_angle of rollers in one row is a tapered bearing, which has no mesh")
    bore, outside, width = entry.dimensions
    inner, outer = _race_radii(bearing)
    roller = bearing.element == "roller"
    edge = (EDGE_RADIUS * bearing.element_diameter if edge_radius is None else edge_radius) if roller else 0.0
    length = bearing.effective_length if bearing.effective_length is not None else entry.series_length
    shoulder = SHOULDER_HEIGHT * bearing.element_diameter if shoulder_height is None else shoulder_height
    return FeGeometry(
        designation=name,
        element=bearing.element,
        n_elements=bearing.n_elements,
        rows=bearing.rows,
        contact_angle=bearing.contact_angle,
        element_radius=0.5 * bearing.element_diameter,
        inner_race_radius=inner,
        outer_race_radius=outer,
        bore_radius=0.5 * bore,
        outside_radius=0.5 * outside,
        width=width,
        inner_groove_radius=None if roller else bearing.inner_groove_radius,
        outer_groove_radius=None if roller else bearing.outer_groove_radius,
        shoulder_height=0.0 if roller else shoulder,
        effective_length=length if roller else None,
        roller_length=length + 2.0 * edge if roller and length is not None else None,
        edge_radius=edge,
        profile=profile,
        crown_radius=crown_radius,
        modulus=modulus,
        poisson=poisson,
    )
