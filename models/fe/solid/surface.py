"""Surface facets cut by the rectangles of contact cells, and the shape functions at points of the pieces.

Each facet is taken in the tangent plane as the polygon of its corners; its intersection with each cell is cut out
(Sutherland and Hodgman 1974), split into triangles and integrated by a rule of degree 4. Neighbouring facets share
their chords, so that the pieces tile each cell exactly, however curved the facets are; where they are rectangles along
x and z the integrals of quadratic shape functions are exact.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from models.fe.solid.shape import boundary_facets, shapes
from models.words.errors import WrongInputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.fe.solid.condense import ContactCells, ContactFrame
    from models.fe.solid.elastic import ElasticBody

# Symmetric rule of degree 4 on a triangle: barycentric coordinates and weights (Strang and Fix 1973).
_A, _B = 0.445948490915965, 0.091576213509771
_BARY = np.array([np.roll((1.0 - 2.0 * a, a, a), k) for a in (_A, _B) for k in range(3)])
_BARY_WEIGHTS = np.array([0.223381589678011] * 3 + [1.0 / 3.0 - 0.223381589678011] * 3)
# Gauss points on [0, 1], degree 5.
_LINE = 0.5 + 0.5 * np.sqrt(0.6) * np.array([-1.0, 0.0, 1.0])
_LINE_WEIGHTS = np.array([5.0, 8.0, 5.0]) / 18.0
# A piece below this share of its cell is dust of rounding.
_DUST = 1e-12
_NEWTON_STEPS = 30


@dataclass(frozen=True)
class Pieces:
    """Triangles (segments in plane strain) of the tangent plane, each within one facet and one cell.

    Attributes:
        corners: m, shape (pieces, 3, 2), or (pieces, 2, 1) in plane strain.
        area: m^2, shape (pieces,).
        cell, facet: indices, shape (pieces,).
    """

    corners: NDArray[np.float64]
    area: NDArray[np.float64]
    cell: NDArray[np.int64]
    facet: NDArray[np.int64]


@dataclass(frozen=True)
class SurfacePoints:
    """Points of integration: place in the tangent plane (p, dim - 1), m; weight, m^2, cell and facet, shape (p,)."""

    place: NDArray[np.float64]
    weight: NDArray[np.float64]
    cell: NDArray[np.int64]
    facet: NDArray[np.int64]


def cut_facets(body: ElasticBody, surface: str, cells: ContactCells, frame: ContactFrame) -> tuple[Pieces, float]:
    """Return the pieces of a surface in all cells, and the sense (1 or -1) of the outward normal along the frame's.

    The contact is where the surface reaches farthest along the frame's y; facets of the other sense, on the far side of
    a closed surface, are left out.
    """
    facets = boundary_facets(body.mesh, surface)
    corners, height, sense = _facet_corners(body, facets, frame)
    low, high = corners.min(axis=1), corners.max(axis=1)
    window = (np.stack((cells.x0, cells.z0), axis=1), np.stack((cells.x1, cells.z1), axis=1))
    tangential = body.dim - 1
    from_, to = window[0][:, :tangential], window[1][:, :tangential]
    near = np.all((low <= to.max(axis=0)) & (high >= from_.min(axis=0)), axis=1) & (sense != 0.0)
    if not np.any(near):
        raise WrongInputError(f"contact cells: no facet of {surface!r} lies under them")
    outward = _outward(height[near], sense[near])
    pieces: list[tuple[NDArray[np.float64], int, int]] = []
    for f in np.nonzero(near & (sense == outward))[0]:
        meets = np.all((low[f] < to) & (high[f] > from_), axis=1)
        for m in np.nonzero(meets)[0]:
            cut = _cut_line if tangential == 1 else _cut_polygon
            pieces.extend((piece, int(m), int(facets[f])) for piece in cut(corners[f], from_[m], to[m]))
    return _as_pieces(pieces, cells), outward


def _outward(height: NDArray[np.float64], sense: NDArray[np.float64]) -> float:
    """Return the sense of the facet farthest along the frame's normal; there the contact is."""
    return float(sense[np.argmax(height)])


def _as_pieces(found: list[tuple[NDArray[np.float64], int, int]], cells: ContactCells) -> Pieces:
    """Return pieces as arrays, without the dust of rounding."""
    corners = np.array([piece for piece, _, _ in found])
    cell, facet = (np.array(column, np.int64) for column in ([m for _, m, _ in found], [f for _, _, f in found]))
    if corners.shape[2] == 1:
        area = np.abs(corners[:, 1, 0] - corners[:, 0, 0]) * (cells.z1 - cells.z0)[cell]
    else:
        a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        area = 0.5 * np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    keep = area > _DUST * cells.area[cell]
    return Pieces(corners[keep], area[keep], cell[keep], facet[keep])


def _facet_corners(
    body: ElasticBody, facets: NDArray[np.int64], frame: ContactFrame
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return corners in the tangent plane (facets, corners, dim - 1), mean height, m, and sense of the normal."""
    mesh: Any = body.mesh
    element, local = _local_facets(mesh, facets)
    reference = _facet_reference(mesh)[local]
    places = _placed(body, element, reference, frame)
    tangential = [0, 2][: body.dim - 1]
    corners = places[:, :, tangential]
    middle = np.asarray(mesh.doflocs)[:, np.asarray(mesh.t)[:, element]].mean(axis=1).T
    height = places[:, :, 1].mean(axis=1)
    flat = _spread(corners) <= 1e-9 * np.abs(places - places[:, :1]).max(axis=(1, 2)) ** (body.dim - 1)
    # The outward normal of a facet, from its edges; it points away from the middle of its element.
    normal = _normals(places)
    away = np.einsum("fi,fi->f", normal, places.mean(axis=1) - (middle - frame.origin) @ frame.axes.T)
    sense = np.sign(normal[:, 1] * away)
    sense[flat] = 0.0
    return corners, height, sense


def _normals(places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return normals, of either sense, of facets of corners (facets, corners, dim)."""
    if places.shape[2] == 2:
        along = places[:, 1] - places[:, 0]
        return np.stack((-along[:, 1], along[:, 0]), axis=1)
    return np.cross(places[:, 1] - places[:, 0], places[:, -1] - places[:, 0])


def _spread(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return length or area of polygons (facets, corners, 1 or 2) in the tangent plane."""
    if corners.shape[2] == 1:
        return np.abs(corners[:, 1, 0] - corners[:, 0, 0])
    x, z = corners[:, :, 0], corners[:, :, 1]
    return 0.5 * np.abs(np.sum(x * np.roll(z, -1, axis=1) - np.roll(x, -1, axis=1) * z, axis=1))


def _local_facets(mesh: Any, facets: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the element of each facet and its number within it."""
    element = np.asarray(mesh.f2t)[0, facets].astype(np.int64)
    return element, np.argmax(np.asarray(mesh.t2f)[:, element] == facets, axis=0)


def _facet_reference(mesh: Any) -> NDArray[np.float64]:
    """Return the corners of all facets of the reference element, shape (facets, corners, dim)."""
    domain = mesh.elem.refdom
    return np.asarray(domain.p).T[np.asarray(domain.facets)]


def _placed(
    body: ElasticBody, element: NDArray[np.int64], reference: NDArray[np.float64], frame: ContactFrame
) -> NDArray[np.float64]:
    """Return places in the frame of reference points (n, points, dim) of elements (n,), shape (n, points, dim), m."""
    mesh: Any = body.mesh
    values, _ = shapes(mesh.elem(), reference.reshape(-1, body.dim).T)
    nodes = np.asarray(mesh.doflocs)[:, np.asarray(mesh.dofs.element_dofs)[:, element]]
    values = values.reshape(len(values), *reference.shape[:2])
    points = np.einsum("iae,aep->epi", nodes, values, optimize=True)
    return (points - frame.origin) @ frame.axes.T


def _cut_line(
    corners: NDArray[np.float64], low: NDArray[np.float64], high: NDArray[np.float64]
) -> list[NDArray[np.float64]]:
    """Return the part of a segment (2, 1) between two bounds, as a list of none or one."""
    a, b = max(float(corners.min()), float(low[0])), min(float(corners.max()), float(high[0]))
    return [np.array([[a], [b]])] if b > a else []


def _cut_polygon(
    corners: NDArray[np.float64], low: NDArray[np.float64], high: NDArray[np.float64]
) -> list[NDArray[np.float64]]:
    """Return triangles (3, 2) of the part of a convex polygon (corners, 2) within a rectangle."""
    points = [(float(x), float(z)) for x, z in corners]
    for axis in (0, 1):
        for bound, side in ((float(low[axis]), 1.0), (float(high[axis]), -1.0)):
            points = _clip(points, axis, bound, side)
    return [np.array((points[0], points[k], points[k + 1])) for k in range(1, len(points) - 1)]


def _clip(points: list[tuple[float, float]], axis: int, bound: float, side: float) -> list[tuple[float, float]]:
    """Return the part of a polygon on one side of a line: side * (coordinate - bound) >= 0."""
    kept: list[tuple[float, float]] = []
    for k, here in enumerate(points):
        before = points[k - 1]
        d_here, d_before = side * (here[axis] - bound), side * (before[axis] - bound)
        if (d_here > 0.0) != (d_before > 0.0) and d_here != 0.0 and d_before != 0.0:
            share = d_before / (d_before - d_here)
            other = before[1 - axis] + share * (here[1 - axis] - before[1 - axis])
            kept.append((bound, other) if axis == 0 else (other, bound))
        if d_here >= 0.0:
            kept.append(here)
    return kept


def piece_points(pieces: Pieces) -> SurfacePoints:
    """Return the points of integration of all pieces; their weights add up to the areas."""
    bary, weights = _BARY, _BARY_WEIGHTS
    if pieces.corners.shape[1] == 2:
        bary, weights = np.stack((1.0 - _LINE, _LINE), axis=1), _LINE_WEIGHTS
    place = np.einsum("qc,pci->pqi", bary, pieces.corners).reshape(-1, pieces.corners.shape[2])
    count = len(weights)
    weight = (pieces.area[:, None] * weights).ravel()
    return SurfacePoints(place, weight, np.repeat(pieces.cell, count), np.repeat(pieces.facet, count))


def surface_values(
    body: ElasticBody, points: SurfacePoints, frame: ContactFrame
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the nodes (functions, p) of the elements at surface points and their shape functions there."""
    element, local = _local_facets(body.mesh, points.facet)
    corners = _facet_reference(body.mesh)[local]
    origin, edges = corners[:, 0], np.stack((corners[:, 1] - corners[:, 0], corners[:, -1] - corners[:, 0]), axis=1)
    edges = edges[:, : body.dim - 1]
    reference: NDArray[np.float64] = _inverse(body, points.place, element, (origin, edges), frame)
    values, _ = shapes(body.element, reference.T)
    return np.asarray(body.dofs.element_dofs)[:, element], values


def _inverse(
    body: ElasticBody,
    place: NDArray[np.float64],
    element: NDArray[np.int64],
    facet: tuple[NDArray[np.float64], NDArray[np.float64]],
    frame: ContactFrame,
) -> NDArray[np.float64]:
    """Return the reference points (p, dim) on facets at places of the tangent plane (p, dim - 1), by Newton."""
    origin, edges = facet
    mesh: Any = body.mesh
    tangent = frame.axes[[0, 2][: body.dim - 1]]
    nodes = np.asarray(mesh.doflocs)[:, np.asarray(mesh.dofs.element_dofs)[:, element]]
    flat: NDArray[np.float64] = np.einsum("ti,iap->tap", tangent, np.asarray(nodes - frame.origin[:, None, None]))
    size = np.abs(flat - flat[:, :1]).max(axis=(0, 1))
    # Of a small facet far from the frame's origin, coordinates are known to their rounding.
    least = 1e-12 * size + 1e-15 * np.abs(flat).max(axis=(0, 1))
    steps = np.full(place.shape, 1.0 / 3.0, np.float64)
    for _ in range(_NEWTON_STEPS):
        reference = origin + np.asarray(np.einsum("pt,pti->pi", steps, edges), np.float64)
        values, gradients = shapes(mesh.elem(), reference.T)
        miss = place - np.einsum("tap,ap->pt", flat, values)
        if np.all(np.abs(miss).max(axis=1) <= least):
            return reference
        slope = np.asarray(np.einsum("tap,akp,psk->pts", flat, gradients, edges, optimize=True), np.float64)
        steps += np.asarray(np.linalg.solve(slope, miss[:, :, None]), np.float64)[:, :, 0]
    raise WrongInputError("contact cells: a facet under them is too distorted for its shape functions to be found")
