"""The sub-model of section 3.3 of the thesis in tetrahedra: a quarter rolling element and sectors of both races.

A sector of one element pitch, cut at the middle of the ring width (z = 0) and at the plane of the load (x = 0). Axes: x
in the rolling direction, y along the contact normal, from the inner to the outer ring, z along the shaft. The origin is
the centre of the element, or for a race that of the bearing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from models.fe.meshes.tetrahedra import MM, TetBody, TetPatch, TetRule, require_positive, tet_mesh
from models.words.errors import WrongInputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.fe.meshes.tetrahedra import OffSurface


def tet_roller(
    radius: float, length: float, edge_radius: float, patches: tuple[TetPatch, TetPatch], rule: TetRule
) -> Any:
    """Mesh the quarter x >= 0, z >= 0 of a straight roller with rounded edges.

    Args:
        radius, length, edge_radius: of the roller, m; its contact length is ``length - 2 edge_radius``.
        patches: at the inner race (y = -radius) and at the outer one.

    Returns:
        A skfem ``MeshTet1`` or ``MeshTet2`` in m with the boundaries "x0", "z0", "contact_inner" and "contact_outer"
        (the halves y < 0 and y > 0 of the cylinder with its rounding) and "side".

    Raises:
        MissingExtraError: gmsh or scikit-fem cannot be imported.
        WrongInputError: a dimension or size that has no mesh, or one with more nodes than ``rule.max_nodes``.
        MeshingError: gmsh fails, or a tetrahedron is turned inside out.
    """
    r, half, edge = radius * MM, 0.5 * length * MM, edge_radius * MM
    require_positive(radius=radius, length=length)
    if not 0.0 <= edge < min(r, half):
        raise WrongInputError(f"edge_radius: expected 0 to the roller's radius and half length, got {edge_radius!r} m")

    def build(occ: Any) -> int:
        outline = _Outline(occ, 0.0, 0.0)
        outline.line(-r, 0.0)
        outline.line(-r, half - edge)
        if edge > 0.0:
            outline.arc((-r + edge, half - edge), -r + edge, half)
        outline.line(0.0, half)
        return _revolved(occ, outline.closed(), math.pi)

    def off_contact(p: NDArray[np.float64]) -> NDArray[np.float64]:
        across = np.hypot(p[0], p[1])
        beyond = np.maximum(p[2] - (half - edge), 0.0)
        # On the rounding the distance from the circle, elsewhere from the cylinder.
        rounded: NDArray[np.float64] = np.hypot(across - (r - edge), beyond) - edge
        off: NDArray[np.float64] = np.where(beyond > 0.0, rounded, across - r)
        return off

    surfaces = _element_surfaces(off_contact)
    surfaces["side"] = lambda p: p[2] - half
    return tet_mesh(
        TetBody("roller", build, ((-r, patches[0]), (r, patches[1])), lambda x, y, _: r - math.hypot(x, y), surfaces),
        rule,
    )


def tet_ball(radius: float, patches: tuple[TetPatch, TetPatch], rule: TetRule) -> Any:
    """Mesh the quarter x >= 0, z >= 0 of a ball; result and errors as of ``tet_roller``, without "side"."""
    require_positive(radius=radius)
    r = radius * MM

    def build(occ: Any) -> int:
        # About the shaft's direction: the degenerate pole of the sphere is then far from both contacts.
        outline = _Outline(occ, 0.0, 0.0)
        outline.line(-r, 0.0)
        outline.arc((0.0, 0.0), 0.0, r)
        return _revolved(occ, outline.closed(), math.pi)

    surfaces = _element_surfaces(lambda p: np.sqrt(np.sum(p**2, axis=0)) - r)
    return tet_mesh(
        TetBody("ball", build, ((-r, patches[0]), (r, patches[1])), lambda x, y, z: r - math.hypot(x, y, z), surfaces),
        rule,
    )


@dataclass(frozen=True, slots=True)
class RaceSector:
    """A half sector of a ring, 0 to ``angle`` from the plane of the load, of half the width; SI.

    Attributes:
        race_radius: from the bearing's axis to the race, for a groove to its bottom, m.
        back_radius: of the bore of an inner ring or the outside of an outer one, m; says which of them it is.
        half_width: half the width of the ring, m.
        angle: half a pitch of the elements, rad.
        groove_radius: of the groove across the rolling direction, m; None for a cylindrical race.
        groove_depth: from the shoulder to the bottom of the groove, m.
        corner_radius: of the rounding between bore or outside and side, m.
    """

    race_radius: float
    back_radius: float
    half_width: float
    angle: float
    groove_radius: float | None = None
    groove_depth: float | None = None
    corner_radius: float = 0.0


def tet_race(sector: RaceSector, patch: TetPatch, rule: TetRule) -> Any:
    """Mesh a sector of a race with the contact at (0, race_radius, 0).

    Returns:
        A skfem mesh in m with the boundaries "x0", "z0", "cut" (the other radial plane), "race", "bore" or
        "outside", "side" and, where there are such, "shoulder" and "corner".

    Raises:
        MissingExtraError, WrongInputError, MeshingError: as ``tet_roller``.
    """
    race, back, half = (MM * value for value in (sector.race_radius, sector.back_radius, sector.half_width))
    require_positive(race_radius=race, back_radius=back, half_width=half, angle=sector.angle)
    if sector.angle > 0.5 * math.pi or race == back:
        raise WrongInputError(f"sector: expected an angle up to pi/2 and a back_radius off the race, got {sector!r}")
    away = math.copysign(1.0, race - back)  # +1 for an inner ring: the element is outside
    groove = None if sector.groove_radius is None else MM * sector.groove_radius
    rise, rim = (0.0, 0.0) if groove is None else _shoulder(sector)
    shoulder, corner = race + away * rise, MM * sector.corner_radius
    inside = back + away * corner
    if not 0.0 <= corner < min(abs(race - back), half):
        raise WrongInputError(f"corner_radius: expected 0 to the ring's thickness and half width, got {sector!r}")

    def build(occ: Any) -> int:
        outline = _Outline(occ, shoulder, half)
        outline.line(inside, half)
        if corner > 0.0:
            outline.arc((inside, half - corner), back, half - corner)
        outline.line(back, 0.0)
        outline.line(race, 0.0)
        if groove is not None:
            outline.arc((race + away * groove, 0.0), shoulder, rim)
        return _revolved(occ, outline.closed(), -sector.angle)

    def off_race(p: NDArray[np.float64]) -> NDArray[np.float64]:
        across = np.hypot(p[0], p[1])
        return across - race if groove is None else np.hypot(across - race - away * groove, p[2]) - groove

    def depth(x: float, y: float, z: float) -> float:
        across = math.hypot(x, y) - race
        return -away * across if groove is None else math.hypot(across - away * groove, z) - groove

    surfaces: dict[str, OffSurface] = {
        "x0": lambda p: p[0],
        "z0": lambda p: p[2],
        "cut": lambda p: p[0] * math.cos(sector.angle) - p[1] * math.sin(sector.angle),
        "race": off_race,
        "side": lambda p: p[2] - half,
        "bore" if away > 0.0 else "outside": lambda p: np.hypot(p[0], p[1]) - back,
    }
    if groove is not None:
        surfaces["shoulder"] = lambda p: np.hypot(p[0], p[1]) - shoulder
    if corner > 0.0:
        surfaces["corner"] = lambda p: np.hypot(np.hypot(p[0], p[1]) - inside, p[2] - half + corner) - corner
    name = "inner race" if away > 0.0 else "outer race"
    return tet_mesh(TetBody(name, build, ((race, patch),), depth, surfaces), rule)


def _element_surfaces(off_contact: OffSurface) -> dict[str, OffSurface]:
    return {"x0": lambda p: p[0], "z0": lambda p: p[2], "contact": off_contact}


def _shoulder(sector: RaceSector) -> tuple[float, float]:
    """Return how far the shoulder is above the bottom of the groove, and the half width of the groove, in mm."""
    radius, rise = MM * (sector.groove_radius or 0.0), MM * (sector.groove_depth or 0.0)
    rim = math.sqrt(max(radius**2 - (radius - rise) ** 2, 0.0))
    if not (0.0 < rise < radius and rim < MM * sector.half_width):
        raise WrongInputError(f"groove_depth: expected the rim of the groove inside the half width, got {sector!r}")
    return rise, rim


class _Outline:
    """The outline of a cross-section in the plane x = 0, from point to point (y, z), mm."""

    def __init__(self, occ: Any, y: float, z: float) -> None:
        self._occ = occ
        self._first = self._last = occ.addPoint(0.0, y, z)
        self._lines: list[int] = []

    def line(self, y: float, z: float) -> None:
        """Go straight to a point."""
        end = self._occ.addPoint(0.0, y, z)
        self._lines.append(self._occ.addLine(self._last, end))
        self._last = end

    def arc(self, centre: tuple[float, float], y: float, z: float) -> None:
        """Go to a point on a circle."""
        end = self._occ.addPoint(0.0, y, z)
        self._lines.append(self._occ.addCircleArc(self._last, self._occ.addPoint(0.0, *centre), end))
        self._last = end

    def closed(self) -> list[int]:
        """Return all lines, the last straight to the first point."""
        return [*self._lines, self._occ.addLine(self._last, self._first)]


def _revolved(occ: Any, lines: list[int], angle: float) -> int:
    face = occ.addPlaneSurface([occ.addCurveLoop(lines)])
    solids = occ.revolve([(2, face)], 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, angle)
    return next(tag for dimension, tag in solids if dimension == 3)
