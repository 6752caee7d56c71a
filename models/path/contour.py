"""The path of a ball over a defect of any part, cut into smooth pieces around the part.

A defect of the outer race is that of ``models.path.defect``. The inner race and the ball follow the same rule, in the
plane and with rigid bodies: the ball sinks until it rests on an edge of the defect or on its floor, whichever is
shallower.

* Inner race, a convex circle of radius r_i: beyond an edge by the angle b the ball has sunk by
  r_i (1 - cos b) + r_b - sqrt(r_b^2 - r_i^2 sin^2 b), Eq. 51 with the sign of the race's curvature changed.
* Ball: it spins about an axis that stays parallel to that of the bearing, at BSF against the cage, so that a spot on
  its running track faces the outer race and, half a spin later, the inner race. While it does, the ball rests on the
  edge of the spot, which is the angle b (about the ball's own axis) short of the contact normal: it has sunk by
  r_b (1 - cos b) -+ (R - sqrt(R^2 - r_b^2 sin^2 b)), minus at the outer race (R = r_o), plus at the inner (R = r_i).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from models.path.defect import BallPath, ball_path, profile_cutoff, race_profile, race_radius, shallower

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.machine.bearing import Bearing
    from models.machine.scene import Defect, Part

    Values = NDArray[np.float64]
    Edge = Callable[[Values], tuple[Values, Values]]

_REACH = 1.0 - 1e-9
_SCAN_POINTS = 400
_SAME_ANGLE = 1e-9
_NUDGE = 1e-11
# Cells of a cubic table: at least so many in a piece, and no wider than a small part of a rough floor's wave.
_CELLS = 64
_CELL_WIDTH = 5e-4


@dataclass(frozen=True, eq=False)
class PartPath:
    """How far a ball has sunk, d(x), while the defect of an inner race or ball passes: zero outside the half width.

    Attributes:
        edge: depth, m, and its slope, m/rad, at an angle beyond an edge.
        centre: where the defect is met, rad.
        floor: height (m) and slope of the rough floor over the angle from the centre, or None.
    """

    edge: Edge
    half_width: float
    h_d: float
    cos_alpha: float
    centre: float
    floor: Edge | None = None

    def __call__(self, angle: Values) -> tuple[Values, Values]:
        """Return d (m) and its derivative (m/rad) at angles within the half width of the centre, any shape."""
        x = angle - self.centre
        edge = self.edge(np.maximum(self.half_width - np.abs(x), 0.0))
        return shallower(x, self.half_width, self.cos_alpha, edge, self._floor(x))

    def _floor(self, x: Values) -> tuple[Values, Values]:
        if self.floor is None:
            return np.full_like(x, self.h_d), np.zeros_like(x)
        height, slope = self.floor(x)
        return self.h_d + height, slope

    def kinks(self) -> Values:
        """Return the angles at which the path is not smooth, rad, ascending: edges, switches to the floor, middle."""

        def gap(x: Values) -> Values:
            return self.edge(self.half_width - np.abs(x))[0] - self._floor(x)[0]

        found = [-self.half_width, 0.0, self.half_width]
        for low, high in ((-self.half_width, 0.0), (0.0, self.half_width)):
            scan = np.linspace(low, high, _SCAN_POINTS)
            over = gap(scan) > 0.0
            switches = np.flatnonzero(over[1:] != over[:-1])
            found.extend(_root(lambda x: float(gap(np.array(x))), scan[i], scan[i + 1]) for i in switches)
        return np.sort(np.array(found)) + self.centre


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    """Return a root between two angles of opposite signs, by bisection."""
    sign = function(low) > 0.0
    while high - low > 1e-14:
        middle = 0.5 * (low + high)
        if not low < middle < high:
            break
        low, high = (middle, high) if (function(middle) > 0.0) == sign else (low, middle)
    return 0.5 * (low + high)


def _inner_edge(r_i: float, r_b: float) -> Edge:
    reach = math.asin(min(1.0, r_b / r_i)) * _REACH

    def edge(delta: Values) -> tuple[Values, Values]:
        b = np.minimum(delta, reach)
        sine = r_i * np.sin(b)
        root = np.sqrt(r_b * r_b - sine * sine)
        depth = 2.0 * r_i * np.sin(0.5 * b) ** 2 + sine * sine / (r_b + root)
        return depth, np.where(delta <= reach, sine * (1.0 + r_i * np.cos(b) / root), 0.0)

    return edge


def _spot_edge(radius: float, r_b: float, sign: float) -> Edge:
    def edge(delta: Values) -> tuple[Values, Values]:
        sine = r_b * np.sin(delta)
        root = np.sqrt(radius * radius - sine * sine)
        depth = 2.0 * r_b * np.sin(0.5 * delta) ** 2 + sign * sine * sine / (radius + root)
        return depth, sine * (1.0 + sign * r_b * np.cos(delta) / root)

    return edge


def inner_radius(bearing: Bearing) -> float:
    """Return r_i, m: the catalogue's, or pitch radius minus r_b cos(alpha) where that is unknown."""
    if bearing.inner_race_radius is not None:
        return bearing.inner_race_radius
    return 0.5 * (bearing.pitch_diameter - bearing.element_diameter * math.cos(bearing.contact_angle))


def part_radius(bearing: Bearing, part: Part) -> float:
    """Return the radius, m, with which an extent of a part becomes a length: r_o, r_i, or that of a rolling element.

    The volume of a defect per width is V_eq = radius * dphi_d * h_d. For the outer race this is Eq. 90 of the thesis;
    the inner race and the ball follow it with the radius about whose axis their extent is measured.
    """
    if part == "ball":
        return 0.5 * bearing.element_diameter
    return inner_radius(bearing) if part == "inner" else race_radius(bearing)


def part_paths(bearing: Bearing, defect: Defect | None) -> list[BallPath | PartPath]:
    """Return the paths over a defect: one over a race, two around a ball, none without extent or depth.

    The angle is that of a ball from the race's zero, or that of a ball's spot from the contact with the outer race.

    Raises:
        ValueError: if extent or depth is negative or not a number, or the extent more than the part has.
    """
    if defect is None or defect.part == "outer":
        path = ball_path(bearing, defect)
        return [] if path is None else [path]
    most = 2.0 * math.pi if defect.part == "inner" else math.pi
    if not 0.0 <= defect.dphi_d <= most:
        raise ValueError(f"dphi_d of the {defect.part} must lie between 0 and {most:.4g} rad, got {defect.dphi_d!r}")
    if not defect.h_d >= 0.0:
        raise ValueError(f"h_d must not be negative, got {defect.h_d!r} m")
    if defect.dphi_d == 0.0 or defect.h_d == 0.0:
        return []
    r_b, r_i, r_o = 0.5 * bearing.element_diameter, inner_radius(bearing), race_radius(bearing)
    half, cosine = 0.5 * defect.dphi_d, math.cos(bearing.contact_angle)
    floor = _rough_floor(defect, r_b, r_i if defect.part == "inner" else r_b)
    if defect.part == "inner":
        return [PartPath(_inner_edge(r_i, r_b), half, defect.h_d, cosine, defect.position, floor)]
    return [
        PartPath(_spot_edge(r_o, r_b, -1.0), half, defect.h_d, cosine, defect.position, floor),
        PartPath(_spot_edge(r_i, r_b, 1.0), half, defect.h_d, cosine, defect.position + math.pi, floor),
    ]


def _rough_floor(defect: Defect, r_b: float, radius: float) -> Edge | None:
    """Return the rough floor over the angle from the defect's centre, scaled as in ``models.path.defect``, or None."""
    if defect.floor.kind != "rough" or defect.floor.sd == 0.0:
        return None
    floor = defect.floor
    profile = race_profile(floor.sd, floor.pitch, profile_cutoff(floor, r_b), floor.seed, radius)
    scale = min(1.0, defect.h_d / profile.lowest)

    def height(x: Values) -> tuple[Values, Values]:
        value, slope = profile(x)
        return scale * value, scale * slope

    return height


@dataclass(frozen=True, eq=False)
class PathPieces:
    """Smooth pieces of all paths as cubics in equal cells, ready for a kernel.

    Attributes:
        start, end: where each piece begins and ends, rad, shape (pieces,).
        first: first cell of each piece, int64, shape (pieces + 1,).
        cells: d in powers of the place in a cell (0 to 1), lowest power first, m, shape (cells, 4).
    """

    start: Values
    end: Values
    first: NDArray[np.int64]
    cells: Values

    @property
    def inverse_width(self) -> Values:
        """One over the width of each piece's cells, 1/rad."""
        return np.diff(self.first) / (self.end - self.start)


def pieces(paths: list[BallPath | PartPath]) -> PathPieces:
    """Return the paths between their kinks, values and one-sided slopes exact at the ends of all cells."""
    starts: list[float] = []
    ends: list[float] = []
    counts: list[int] = []
    cells: list[Values] = [np.zeros((0, 4))]
    for path in paths:
        for a, b in pairwise(float(kink) for kink in path.kinks()):
            if b - a < _SAME_ANGLE:
                continue
            count = max(_CELLS, math.ceil((b - a) / _CELL_WIDTH))
            x = np.linspace(a, b, count + 1)
            x[0], x[-1] = a + _NUDGE, b - _NUDGE
            d, slope = path(x)
            slope = slope * ((b - a) / count)
            rise = np.diff(d)
            cells.append(
                np.stack(
                    (
                        d[:-1],
                        slope[:-1],
                        3.0 * rise - 2.0 * slope[:-1] - slope[1:],
                        slope[:-1] + slope[1:] - 2.0 * rise,
                    ),
                    axis=1,
                )
            )
            starts.append(a)
            ends.append(b)
            counts.append(count)
    first = np.concatenate(([0], np.cumsum(counts))).astype(np.int64)
    return PathPieces(np.array(starts), np.array(ends), first, np.concatenate(cells))


def joined(parts: list[PathPieces]) -> PathPieces:
    """Return all pieces of several paths, in their order."""
    none = pieces([])
    cells = np.cumsum([0, *(len(part.cells) for part in parts)])
    first = [part.first[:-1] + offset for part, offset in zip(parts, cells[:-1], strict=True)]
    return PathPieces(
        np.concatenate([none.start, *(part.start for part in parts)]),
        np.concatenate([none.end, *(part.end for part in parts)]),
        np.concatenate([*first, cells[-1:]]).astype(np.int64),
        np.concatenate([none.cells, *(part.cells for part in parts)]),
    )
