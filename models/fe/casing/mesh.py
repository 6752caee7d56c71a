"""Structured hexahedra of a casing.

The front view is a grid of four-sided cells; about the seats of bearings squares of it are replaced by rings of cells.
Cells are placed in a square picture, in which circles are squares (the larger of abs(x) and abs(y) from the centre is
the radius), drawn out along z where there is material, and then mapped, the 27 nodes of each cell one by one.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from models.fe.extra import require_skfem

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from models.fe.casing.shape import CasingMeshRule, CasingShape, Foot, Patch, Seat
    from models.fe.solid.shape import FeMesh

    Array = NDArray[np.float64]
    Numbers = NDArray[np.int64]

# Places nearer to each other than this share of the size of the casing are one.
_SAME = 1e-9
# Half side of the square in the middle of the innermost bore, by its radius.
_CORE = 0.5


@dataclass(frozen=True)
class _FrontView:
    """Points (2, points) of the square picture, and cells (4, cells), counter-clockwise.

    ``patch`` is the number of the patch of a cell or -1, ``radius`` the mean radius of its ring, 0 in a core.
    """

    points: Array
    cells: Numbers
    patch: Numbers
    radius: Array

    @property
    def middles(self) -> Array:
        return self.points[:, self.cells].mean(axis=1)


def casing_mesh(shape: CasingShape, rule: CasingMeshRule) -> FeMesh:
    """Return a casing of 27-node hexahedra.

    Its boundaries are the outer sides "x0" to "z1", the bores by the names of their seats, and "foot1", "foot2", ...

    Raises:
        MissingExtraError: scikit-fem is missing.
    """
    skfem = require_skfem()
    patches = tuple(shape.patches())
    view = _front_view(shape, patches, rule)
    planes = _divided(_depth_marks(shape), rule.size, _walls(shape, "z", rule.through))
    many = view.points.shape[1]
    places = np.empty((3, many * len(planes)))
    places[:2] = np.tile(view.points, len(planes))
    places[2] = np.repeat(planes, many)
    cells: list[Numbers] = []
    for layer, (low, high) in enumerate(itertools.pairwise(planes)):
        a, b, c, d = view.cells[:, _material(shape, patches, view, 0.5 * float(low + high))] + layer * many
        # The order of scikit-fem: its corners 0, 3, 6, 2 run round the first face, 1, 5, 7, 4 round the one above.
        cells.append(np.stack((a, a + many, d, b, d + many, b + many, c, c + many)))
    flat = skfem.MeshHex1(places, np.concatenate(cells, axis=1)).remove_unused_nodes()
    mesh = skfem.MeshHex2.from_mesh(flat)
    kind: Any = skfem.MeshHex2
    return kind(_mapped(np.asarray(mesh.doflocs, np.float64), patches), mesh.t).with_boundaries(_named(flat, shape))


def _front_view(shape: CasingShape, patches: tuple[Patch, ...], rule: CasingMeshRule) -> _FrontView:
    """Return the cells of the view along z."""
    marks: list[list[float]] = [[0.0, shape.length], [0.0, shape.height]]
    for axis, (room, side) in enumerate(((shape.length, "x"), (shape.height, "y"))):
        marks[axis] += [shape.thickness(f"{side}0"), room - shape.thickness(f"{side}1")]
        marks[axis] += [patch.centre[axis] + sign * patch.half for patch in patches for sign in (-1.0, 1.0)]
    marks[0] += [place for foot in shape.feet for place in foot.x]
    x, y = (
        _divided(places, rule.size, _walls(shape, axis, rule.through)) for axis, places in zip("xy", marks, strict=True)
    )
    grid_x, grid_y = np.meshgrid(x, y, indexing="ij")
    points, number = [np.stack((grid_x.ravel(), grid_y.ravel()))], np.arange(grid_x.size).reshape(grid_x.shape)
    cells = [_quads(number)]
    middles = points[0][:, cells[0]].mean(axis=1)
    owner = np.full(middles.shape[1], -1)
    for k, patch in enumerate(patches):
        within = np.abs(middles - np.array(patch.centre)[:, None]).max(axis=0) < patch.half
        owner[within] = k
    cells, owners, radii = [cells[0][:, owner < 0]], [owner[owner < 0]], [np.zeros(np.count_nonzero(owner < 0))]
    count = grid_x.size
    for k, patch in enumerate(patches):
        span = [_span(places, patch.centre[axis], patch.half) for axis, places in enumerate((x, y))]
        square = number[span[0], span[1]]
        added, quads, radius = _rings(patch, points[0], square, count, rule.size)
        count += added.shape[1]
        points.append(added)
        cells.append(quads)
        owners.append(np.repeat(np.int64(k), quads.shape[1]))
        radii.append(radius)
    return _FrontView(
        np.concatenate(points, axis=1), np.concatenate(cells, axis=1), np.concatenate(owners), np.concatenate(radii)
    )


def _rings(patch: Patch, points: Array, square: Numbers, count: int, size: float) -> tuple[Array, Numbers, Array]:
    """Return further points, from number ``count`` on, cells and their mean radii within a square of the grid."""
    centre = np.array(patch.centre)[:, None]
    inside = np.concatenate((square[:-1, 0], square[-1, :-1], square[:0:-1, -1], square[0, :0:-1]))
    direction = (points[:, inside] - centre) / patch.half
    core = _CORE * patch.radii[0]
    radii = _divided([core, *patch.radii, patch.half], size, {})[::-1]
    added: list[Array] = []
    quads: list[Numbers] = []
    middles: list[Array] = []
    for outer, inner in itertools.pairwise(float(radius) for radius in radii):
        last = inside
        if inner > radii[-1]:
            inside = count + np.arange(len(inside))
            added.append(centre + inner * direction)
            count += len(inside)
        else:
            added.append(centre + core / patch.half * (points[:, square.ravel()] - centre))
            number = np.asarray(count + np.arange(square.size).reshape(square.shape), np.int64)
            inside = np.concatenate((number[:-1, 0], number[-1, :-1], number[:0:-1, -1], number[0, :0:-1]))
            quads.append(_quads(number))
            middles.append(np.zeros(number[1:, 1:].size))
        quads.append(np.stack((last, np.roll(last, -1), np.roll(inside, -1), inside)))
        middles.append(np.repeat(0.5 * (outer + inner), len(inside)))
    return np.concatenate(added, axis=1), np.concatenate(quads, axis=1), np.concatenate(middles)


def _quads(number: Numbers) -> Numbers:
    """Return the cells of a grid of points, counter-clockwise."""
    return np.stack((number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:])).reshape(4, -1)


def _span(places: Array, middle: float, half: float) -> slice:
    """Return which grid lines lie within half a side of a middle."""
    first, last = (int(np.argmin(np.abs(places - edge))) for edge in (middle - half, middle + half))
    return slice(first, last + 1)


def _material(shape: CasingShape, patches: tuple[Patch, ...], view: _FrontView, z: float) -> NDArray[np.bool_]:
    """Return which cells of the view are material at a depth."""
    walls = {side: shape.thickness(side) for side in ("z0", "z1")}
    from_outside = {"z0": z, "z1": shape.depth - z}
    in_wall = any(from_outside[side] < walls[side] for side in walls)
    x, y = view.middles
    strips = (
        (x < shape.thickness("x0")) | (x > shape.length - shape.thickness("x1"))
        | (y < shape.thickness("y0")) | (y > shape.height - shape.thickness("y1"))
    )  # fmt: skip
    kept: NDArray[np.bool_] = np.full(x.shape, in_wall) | (strips & (view.patch < 0))
    for k, patch in enumerate(patches):
        mine = view.patch == k
        for seat in patch.seats:
            cover, wall, end = shape.reach(seat)
            deep = from_outside[seat.wall]
            if cover < deep < end:
                kept[mine & (view.radius < 0.5 * seat.bore)] = False
            if wall < deep < end:
                kept[mine & (view.radius > 0.5 * seat.bore) & (view.radius < 0.5 * seat.boss)] = True
    return kept


def _depth_marks(shape: CasingShape) -> list[float]:
    """Return the places along z where something begins or ends."""
    marks = [0.0, shape.depth, shape.thickness("z0"), shape.depth - shape.thickness("z1")]
    for seat in shape.seats:
        marks += [place if seat.wall == "z0" else shape.depth - place for place in shape.reach(seat)]
    return marks + [place for foot in shape.feet for place in foot.z]


def _walls(shape: CasingShape, axis: str, through: int) -> dict[float, int]:
    """Return the cells at least of an interval that begins at a place: those of the walls across an axis."""
    return {0.0: through, shape.size(f"{axis}0") - shape.thickness(f"{axis}1"): through}


def _divided(marks: Iterable[float], size: float, least: dict[float, int]) -> Array:
    """Return marks, each once and ascending, with even divisions between them that are no longer than a size."""
    ordered = sorted(marks)
    near = _SAME * (ordered[-1] - ordered[0])
    distinct = ordered[:1]
    for mark in ordered[1:]:
        if mark - distinct[-1] > near:
            distinct.append(mark)
    places = distinct[:1]
    for low, high in itertools.pairwise(distinct):
        begins = next((many for begin, many in least.items() if abs(begin - low) <= near), 1)
        parts = max(begins, math.ceil((high - low) / size * (1.0 - _SAME)))
        places.extend((low + (high - low) * np.arange(1, parts) / parts).tolist())
        places.append(high)
    return np.array(places)


def _mapped(places: Array, patches: tuple[Patch, ...]) -> Array:
    """Return points of the square picture in space: squares of the radii of bores and bosses become circles."""
    mapped = places.copy()
    for patch in patches:
        offset = places[:2] - np.array(patch.centre)[:, None]
        rho = np.abs(offset).max(axis=0)
        core = _CORE * patch.radii[0]
        here = (rho < patch.half) & (rho > core)
        rho, offset = rho[here], offset[:, here]
        square = offset / rho
        circle = offset / np.linalg.norm(offset, axis=0)
        # From square at the core over circles back to the square at the edge of the patch.
        shares = (0.0, *(1.0 for _ in patch.radii), 0.0)
        round_share = np.asarray(np.interp(rho, (core, *patch.radii, patch.half), shares), np.float64)
        mapped[:2, here] = np.array(patch.centre)[:, None] + rho * (round_share * circle + (1.0 - round_share) * square)
    return mapped


def _named(flat: FeMesh, shape: CasingShape) -> dict[str, Numbers]:
    """Return the facets of the named boundaries, told by their middles in the square picture."""
    facets = np.asarray(flat.boundary_facets(), np.int64)
    middle = np.asarray(flat.p, np.float64)[:, np.asarray(flat.facets)[:, facets]].mean(axis=1)
    near = _SAME * max(shape.length, shape.height, shape.depth)
    named: dict[str, Numbers] = {}
    for axis, letter in enumerate("xyz"):
        named[f"{letter}0"] = facets[middle[axis] < near]
        named[f"{letter}1"] = facets[middle[axis] > shape.size(f"{letter}0") - near]
    for seat in shape.seats:
        named[seat.name] = facets[_on_bore(middle, shape, seat, near)]
    for number, foot in enumerate(shape.feet, 1):
        named[f"foot{number}"] = facets[_on_foot(middle, foot, near)]
    return named


def _on_bore(middle: Array, shape: CasingShape, seat: Seat, near: float) -> NDArray[np.bool_]:
    rho = np.abs(middle[:2] - np.array(seat.centre)[:, None]).max(axis=0)
    deep = middle[2] if seat.wall == "z0" else shape.depth - middle[2]
    cover, _, end = shape.reach(seat)
    # The middle of a facet on a square lies on it.
    return (np.abs(rho - 0.5 * seat.bore) < near) & (deep > cover + near) & (deep < end - near)


def _on_foot(middle: Array, foot: Foot, near: float) -> NDArray[np.bool_]:
    x, y, z = middle
    return (y < near) & (x > foot.x[0]) & (x < foot.x[1]) & (z > foot.z[0]) & (z < foot.z[1])
