"""Structured hexahedra of a stepped shaft: half of a solid of revolution, cut by the plane of its load.

The section is a square core within rings of four-sided cells, one ring or more between any two radii that occur along
the shaft, so that the steps are met by cells and not by cuts. Cells are placed in a square picture of the section, in
which circles are squares (the larger of abs(x) and abs(y) is the radius), and then mapped; the 27 nodes of each cell
are mapped one by one, so that the outside is curved as the quadratic shapes allow.

Coordinates: z along the shaft from its first end, y along the load, x across it; x = 0 is the plane of symmetry. SI.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from models.fe.extra import require_skfem
from models.fe.solid.shape import FeMesh
from models.words.checks import check_numbers, check_whole
from models.words.numerics import find_root

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

# The side of the square core as a share of the innermost radius, and how square its cells are left.
_CORE = 0.5
_SQUARENESS = 0.9
# Places along z or radii nearer to each other than this share of the length are one.
_SAME = 1e-9


@dataclass(frozen=True)
class Step:
    """A length of shaft of one diameter, m; ``bore`` is the diameter of a hole along its axis."""

    length: float
    diameter: float
    bore: float = 0.0

    def __post_init__(self) -> None:
        """Raise a ValueError that names the field of an unusable value."""
        check_numbers(self, "step.", "positive", "length", "diameter")
        check_numbers(self, "step.", "not negative", "bore")
        if self.bore >= self.diameter:
            raise ValueError(f"step.bore must be less than the diameter {self.diameter!r} m, got {self.bore!r}")


@dataclass(frozen=True)
class ShaftMeshRule:
    """Sizes of the cells.

    Attributes:
        eighth: cells along an eighth of the circumference.
        size: largest cell along the shaft and across its rings, as a share of the smallest diameter.
        finest: cells at steps and ends of seats, as a share of the largest.
        order: 2 for 27 nodes a cell, 1 for 8.
    """

    eighth: int = 1
    size: float = 0.8
    finest: float = 0.125
    order: int = 2

    def __post_init__(self) -> None:
        """Raise a ValueError that names the field of an unusable value."""
        check_whole(self.eighth, "rule.eighth", 1)
        check_numbers(self, "rule.", "positive", "size", "finest")
        if self.order not in (1, 2):
            raise ValueError(f"rule.order must be 1 or 2, got {self.order!r}")


def shaft_mesh(
    steps: Sequence[Step],
    seats: dict[str, tuple[float, float]],
    rule: ShaftMeshRule | None = None,
    *,
    upper: bool = False,
) -> FeMesh:
    """Return half of a shaft of hexahedra.

    Args:
        steps: from the first end to the last.
        seats: first and last place along the shaft, m, of surfaces of the outside that get their own boundary.
        upper: whether only the half above the axis, y >= 0, is meshed.

    Returns:
        A mesh with the boundaries "x0" (plane of symmetry), "first" and "last" (the ends) and those of the seats.

    Raises:
        ValueError: there is no step, neighbours do not touch, or a seat is not on one step.
        MissingExtraError: scikit-fem is missing.
    """
    rule = rule or ShaftMeshRule()
    check_shaft(steps, seats)
    skfem = require_skfem()
    ends = _step_ends(steps)
    size = rule.size * min(step.diameter for step in steps)
    radii = _distinct(sorted({0.5 * d for step in steps for d in (step.diameter, step.bore) if d > 0.0}), ends[-1])
    marks = [*ends, *(place for seat in seats.values() for place in seat)]
    planes = _divided(_distinct(sorted(marks), ends[-1]), size, rule.finest * size)
    points, quads, rings = _section(radii, rule.eighth, size, rule.finest * size)
    if upper:
        above = points[1][quads].mean(axis=0) > 0.0
        quads, rings = quads[:, above], rings[above]
    shifted, cells = _extruded(points, quads, rings, planes, steps, ends)
    flat = skfem.MeshHex1(shifted, cells).remove_unused_nodes()
    mesh = flat if rule.order == 1 else skfem.MeshHex2.from_mesh(flat)
    named = _boundaries(flat, steps, ends, seats)
    places = _mapped(mesh.doflocs, radii[0])
    kind: Any = skfem.MeshHex1 if rule.order == 1 else skfem.MeshHex2
    return kind(places, mesh.t).with_boundaries(named)


def check_shaft(steps: Sequence[Step], seats: dict[str, tuple[float, float]]) -> None:
    """Raise a ValueError where steps do not touch, or a seat is not on one step or overlaps another seat."""
    ends = _step_ends(steps)
    near = _SAME * ends[-1]
    for name, (begin, end) in seats.items():
        step = _step_at(0.5 * (begin + end), ends)
        if not (end > begin and begin >= ends[step] - near and end <= ends[step + 1] + near):
            raise ValueError(
                f"seat {name!r} from {begin!r} to {end!r} m must lie on one step of the shaft, which are cut at "
                f"{', '.join(f'{place:.6g}' for place in ends)} m"
            )
    for (name, first), (other, second) in itertools.pairwise(sorted(seats.items(), key=lambda item: item[1])):
        if second[0] < first[1] - near:
            raise ValueError(
                f"seats {name!r} to {first[1]!r} m and {other!r} from {second[0]!r} m of the shaft overlap"
            )


def _step_at(place: float, ends: list[float]) -> int:
    """Return the number of the step at a place, the nearest one of a place beyond the shaft."""
    return min(max(int(np.searchsorted(ends, place)) - 1, 0), len(ends) - 2)


def _step_ends(steps: Sequence[Step]) -> list[float]:
    """Return the places where steps begin and end, m."""
    if not steps:
        raise ValueError("a shaft needs one step at least, got none")
    for number, (step, after) in enumerate(itertools.pairwise(steps), 1):
        if min(step.diameter, after.diameter) <= max(step.bore, after.bore):
            raise ValueError(f"steps {number} and {number + 1} of the shaft do not touch: {step!r}, {after!r}")
    return [0.0, *np.cumsum([step.length for step in steps]).tolist()]


def _distinct(values: list[float], whole: float) -> list[float]:
    """Return ascending values without those that repeat the one before."""
    found = values[:1]
    for value in values[1:]:
        if value - found[-1] > _SAME * whole:
            found.append(value)
    return found


def _divided(marks: list[float], size: float, finest: float) -> NDArray[np.float64]:
    """Return marks with divisions between them: as long as ``finest`` at the marks, growing inwards up to the size.

    Strains are singular where a diameter steps or a rigid seat ends.
    """
    places = [marks[0]]
    for low, high in itertools.pairwise(marks):
        parts = _growing(0.5 * (high - low), min(finest, size), size)
        places.extend((low + np.cumsum([*parts, *parts[::-1]])).tolist())
        places[-1] = high
    return np.array(places)


def _growing(length: float, first: float, size: float) -> list[float]:
    """Return lengths that add up to a length, the first one as given or less, each at most twice the one before."""
    count, total, last = 1, first, first
    while total < length * (1.0 - _SAME):
        last = min(2.0 * last, size)
        count, total = count + 1, total + last

    def parts(factor: float) -> list[float]:
        return [min(first * factor**i, size) for i in range(count)]

    factor = 1.0
    if sum(parts(1.0)) < length < total:
        factor = find_root(lambda factor: sum(parts(factor)) / length - 1.0, 1.0, 2.0, rtol=1e-12)
    found = parts(factor)
    return [part * length / sum(found) for part in found]


def _section(
    radii: list[float], eighth: int, size: float, finest: float
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]:
    """Return points (2, points), cells (4, cells) counter-clockwise and mean radius (cells,) of the square picture."""
    core = _CORE * radii[0]
    # Nothing is singular at the core: the ring about it is the first half of a pair.
    pair = _divided([2.0 * core - radii[0], radii[0]], size, finest)
    squares = np.concatenate(([core], pair[pair > core * (1.0 + _SAME)], _divided(radii, size, finest)[1:]))
    grid = core * np.arange(-eighth, eighth + 1) / eighth
    x, y = np.meshgrid(grid[eighth:], grid, indexing="ij")
    points = [np.stack((x.ravel(), y.ravel()))]
    number = np.arange(x.size).reshape(x.shape)
    quads = [np.stack((number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:])).reshape(4, -1)]
    middles = [np.zeros(quads[0].shape[1])]
    # Round the right half of the core, counter-clockwise from the foot of the plane of symmetry.
    inside = np.concatenate((number[:, 0], number[-1, 1:], number[-2::-1, -1]))
    direction = points[0][:, inside] / core
    count = x.size
    for low, high in itertools.pairwise(squares):
        points.append(high * direction)
        outside = count + np.arange(len(inside))
        count += len(inside)
        quads.append(np.stack((inside[:-1], outside[:-1], outside[1:], inside[1:])))
        middles.append(np.full(len(inside) - 1, 0.5 * (low + high)))
        inside = outside
    return np.concatenate(points, axis=1), np.concatenate(quads, axis=1), np.concatenate(middles)


def _extruded(
    points: NDArray[np.float64],
    quads: NDArray[np.int64],
    rings: NDArray[np.float64],
    planes: NDArray[np.float64],
    steps: Sequence[Step],
    ends: list[float],
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return points (3, points) and cells (8, cells) of the square picture, those within the material."""
    many = points.shape[1]
    whole = np.empty((3, many * len(planes)))
    whole[:2] = np.tile(points, len(planes))
    whole[2] = np.repeat(planes, many)
    cells: list[NDArray[np.int64]] = []
    for layer in range(len(planes) - 1):
        step = steps[_step_at(0.5 * float(planes[layer] + planes[layer + 1]), ends)]
        a, b, c, d = quads[:, (rings < 0.5 * step.diameter) & (rings >= 0.5 * step.bore)] + layer * many
        # The order of scikit-fem: its corners 0, 3, 6, 2 run round the first face, 1, 5, 7, 4 round the one above.
        cells.append(np.stack((a, a + many, d, b, d + many, b + many, c, c + many)))
    return whole, np.concatenate(cells, axis=1)


def _boundaries(
    flat: FeMesh, steps: Sequence[Step], ends: list[float], seats: dict[str, tuple[float, float]]
) -> dict[str, NDArray[np.int64]]:
    """Return the facets of the named boundaries, told by their middles in the square picture."""
    facets = np.asarray(flat.boundary_facets())
    x, y, z = np.asarray(flat.p, dtype=np.float64)[:, np.asarray(flat.facets)[:, facets]].mean(axis=1)
    radius, near = np.maximum(np.abs(x), np.abs(y)), _SAME * ends[-1]
    named = {"x0": facets[x < near], "first": facets[z < near], "last": facets[z > ends[-1] - near]}
    for name, (begin, end) in seats.items():
        step = _step_at(0.5 * (begin + end), ends)
        outside = np.abs(radius - 0.5 * steps[step].diameter) < near
        named[name] = facets[outside & (z > begin) & (z < end)]
    return named


def _mapped(places: NDArray[np.float64], innermost: float) -> NDArray[np.float64]:
    """Return points of the square picture on the round section: from the innermost radius on squares are circles."""
    x, y, z = (np.asarray(row, dtype=np.float64) for row in places)
    radius = np.maximum(np.abs(x), np.abs(y))
    safe = np.where(radius > 0.0, radius, 1.0)
    upright = np.abs(y) > np.abs(x)
    angle = 0.25 * math.pi * y / safe
    angle[upright] = (np.sign(y) * (0.5 * math.pi - 0.25 * math.pi * x / safe))[upright]
    weight = np.minimum(radius / innermost, 1.0) ** 2
    square = (1.0 - weight) * _SQUARENESS
    mapped = np.stack((square * x + weight * radius * np.cos(angle), square * y + weight * radius * np.sin(angle), z))
    # The plane of symmetry stays one to the last digit.
    mapped[0, x == 0.0] = 0.0
    return mapped
