"""Structured hexahedra: fans about a contact, extruded and mapped into a body.

A section is a list of quadrilaterals in reference coordinates; a block extrudes it and maps it smoothly into the body.
Blocks that meet share the places of their nodes, by which they are joined. With quadratic geometry the nodes within
edges and faces are mapped too, so that curved surfaces are met to third order.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from models.fe.extra import require_skfem
from models.words.errors import WrongInputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

# skfem has no types: a MeshHex1 or MeshHex2 with named boundaries.
FeMesh = Any
Order = Literal[1, 2]
# Places (3, ...) in m from reference coordinates (3, ...).
Mapper = Callable[["NDArray[np.float64]"], "NDArray[np.float64]"]
# Which facets, by the places of their four vertices, shape (3, 4, facets), belong to a boundary.
Chooser = Callable[["NDArray[np.float64]"], "NDArray[np.bool_]"]

# Nodes closer than this part of the body's size are one, and a facet this near to a surface lies on it.
JOINED = 1e-8


class FeMeshError(WrongInputError):
    """A mesh that cannot be made of the dimensions and sizes given; the message says why."""


@dataclass(frozen=True, eq=False)
class FanSection:
    """Quadrilaterals of the square (u, v) in [0, 1]^2, contact at (0, 0), u along the surface, v into the depth.

    Attributes:
        quads: corners (0, 0), (1, 0), (0, 1), (1, 1) of each in its own coordinates, shape (2, 4, quads).
        far: breaks of v on the side u = 1, shape (far + 1,).
        deep: breaks of u on the side v = 1, shape (deep + 1,).
    """

    quads: NDArray[np.float64]
    far: NDArray[np.float64]
    deep: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class HexBlock:
    """Hexahedra in reference coordinates and the map of these into the body.

    Attributes:
        corners: of each hexahedron, shape (3, 8, hexahedra); corner 4 i + 2 j + k is at (i, j, k) of its own axes.
        place: map of reference coordinates to places, m.
    """

    corners: NDArray[np.float64]
    place: Mapper


def fan(columns: int, lines: NDArray[np.float64]) -> FanSection:
    """Return nested L-shaped layers about the corner (0, 0): ``columns``^2 squares, then 2 ``columns`` quads a layer.

    Args:
        columns: elements across the innermost square, which ends at ``lines[0]``.
        lines: where the square and each layer end, ascending to 1, shape (layers + 1,).
    """
    steps = np.linspace(0.0, 1.0, columns + 1)
    squares = lattice(lines[0] * steps, lines[0] * steps)
    inner, outer = np.meshgrid(lines[:-1], steps[:-1], indexing="ij"), np.meshgrid(lines[1:], steps[1:], indexing="ij")
    (near, low), (far, high) = (np.array(inner).reshape(2, -1), np.array(outer).reshape(2, -1))
    right = np.array([[near, far, near, far], [near * low, far * low, near * high, far * high]])
    below = np.array([[near * low, near * high, far * low, far * high], [near, near, far, far]])
    return FanSection(np.concatenate((squares, right, below), axis=2), steps, steps)


def tensor_section(u: NDArray[np.float64], v: NDArray[np.float64]) -> FanSection:
    """Return rows and columns with the given breaks, each from 0 to 1."""
    return FanSection(lattice(u, v), v, u)


def lattice(u: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the quadrilaterals between the lines u and v, shape (2, 4, (len(u) - 1) (len(v) - 1))."""
    corners = [np.meshgrid(a, b, indexing="ij") for b in (v[:-1], v[1:]) for a in (u[:-1], u[1:])]
    return np.array(corners).reshape(4, 2, -1).swapaxes(0, 1)


def extrude(quads: NDArray[np.float64], lines: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the hexahedra over quadrilaterals between lines of the third coordinate, shape (3, 8, quads * layers)."""
    count, layers = quads.shape[2], lines.size - 1
    corners = np.empty((3, 2, 2, 2, count, layers))
    corners[:2] = quads.reshape(2, 2, 2, count).swapaxes(1, 2)[:, :, :, None, :, None]
    corners[2, :, :, 0] = lines[:-1]
    corners[2, :, :, 1] = lines[1:]
    return corners.reshape(3, 8, -1)


def build(blocks: list[HexBlock], boundaries: Mapping[str, Chooser], order: Order = 2) -> FeMesh:
    """Return the mesh of joined blocks with named boundaries.

    Args:
        blocks: may meet in whole faces; nodes there agree to ``JOINED`` of the body's size.
        boundaries: the first that chooses a facet on the surface has it.
        order: 1 for ``MeshHex1``, 2 for ``MeshHex2`` (quadratic geometry).

    Raises:
        FeMeshError: an element is turned inside out, or a facet of the surface belongs to no boundary.
    """
    skfem = require_skfem()
    if order not in (1, 2):
        raise FeMeshError(f"order of a mesh must be 1 or 2, got {order!r}")
    blocks = [_right_handed(block) for block in blocks]
    vertices = _mapped(blocks, np.asarray(skfem.ElementHex1.doflocs))
    points, table = _joined(vertices)
    linear = skfem.MeshHex1(points, table)
    if order == 1:
        mesh = linear
    else:
        element = skfem.ElementHex2()
        unknowns = skfem.Dofs(linear, element)
        nodes = np.empty((3, unknowns.N))
        nodes[:, unknowns.element_dofs] = _mapped(blocks, np.asarray(element.doflocs))
        # Vertices keep their numbers: they come first in the table of unknowns.
        mesh = skfem.MeshHex2(nodes, linear.t)
    _check_jacobian(mesh)
    return mesh.with_boundaries(_named(mesh, boundaries))


@dataclass(frozen=True)
class MeshQuality:
    """Size of a mesh, its volume, m^3, and the least Jacobian by the mean one of its element."""

    elements: int
    nodes: int
    volume: float
    least_jacobian: float


def mesh_quality(mesh: FeMesh) -> MeshQuality:
    """Return size, volume and least relative Jacobian of a mesh, at 4^3 points of each element."""
    jacobian, weights = _jacobian(mesh)
    volumes = jacobian @ weights
    return MeshQuality(
        elements=int(mesh.t.shape[1]),
        nodes=int(mesh.doflocs.shape[1]),
        volume=float(np.sum(volumes)),
        least_jacobian=float(np.min(jacobian.min(axis=1) / volumes)),
    )


def _jacobian(mesh: FeMesh) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the determinant at quadrature points, (elements, points), and their weights, which sum to one."""
    skfem = require_skfem()
    points, weights = skfem.quadrature.get_quadrature(skfem.refdom.RefHex, 7)
    return np.asarray(mesh.mapping().detDF(points)), np.asarray(weights)


def _check_jacobian(mesh: FeMesh) -> None:
    jacobian, _ = _jacobian(mesh)
    least = jacobian.min(axis=1)
    if not np.all(least > 0.0):
        worst = int(np.argmin(least))
        where = np.mean(mesh.doflocs[:, mesh.t[:, worst]], axis=1)
        place = ", ".join(f"{1e3 * value:.4g}" for value in where)
        raise FeMeshError(
            f"{int(np.sum(~(least > 0.0)))} of {least.size} elements are turned inside out, the worst about ({place}) "
            "mm: the sizes do not fit the body"
        )


def _right_handed(block: HexBlock) -> HexBlock:
    """Return a block whose own axes map to right-handed ones."""
    middle = block.corners.mean(axis=1)[:, :1]
    axes = block.corners[:, [4, 2, 1], 0] - block.corners[:, [0], 0]
    step = 1e-3
    ends = block.place(middle + step * axes) - block.place(middle - step * axes)
    # skfem counts a vertex by the corner that its coordinates in the element name, as these corners do.
    if np.linalg.det(ends) > 0.0:
        return block
    return HexBlock(block.corners[:, [4, 5, 6, 7, 0, 1, 2, 3]], block.place)


def _mapped(blocks: list[HexBlock], local: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the places of nodes at ``local`` (nodes, 3) of all hexahedra, shape (3, nodes, hexahedra)."""
    corner = (np.arange(8)[:, None] >> np.array([2, 1, 0])) & 1
    shares = np.prod(np.where(corner == 1, local[:, None, :], 1.0 - local[:, None, :]), axis=2)
    places: list[NDArray[np.float64]] = []
    for block in blocks:
        reference = np.einsum("nc,dce->dne", shares, block.corners)
        places.append(block.place(reference.reshape(3, -1)).reshape(reference.shape))
    return np.concatenate(places, axis=2)


def _joined(vertices: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Return the distinct points (3, n) of vertices (3, 8, hexahedra) and the table (8, hexahedra) of their numbers."""
    points = vertices.reshape(3, -1)
    size = float(np.ptp(points, axis=1).max())
    # Along each axis, coordinates without a gap between them are one; points that share all three are one.
    levels = np.array([_levels(coordinate, JOINED * size) for coordinate in points])
    _, first, label = np.unique(levels, axis=1, return_index=True, return_inverse=True)
    table = np.asarray(label).reshape(vertices.shape[1:]).astype(np.int32)
    return np.ascontiguousarray(points[:, first]), table


def _levels(values: NDArray[np.float64], gap: float) -> NDArray[np.int64]:
    """Return the number of each value's group; groups are further apart than ``gap``."""
    ascending = np.argsort(values)
    steps = np.diff(values[ascending], prepend=values[ascending[0]]) > gap
    levels = np.empty(values.size, dtype=np.int64)
    levels[ascending] = np.cumsum(steps)
    return levels


def _named(mesh: FeMesh, boundaries: Mapping[str, Chooser]) -> dict[str, NDArray[np.int32]]:
    facets = np.asarray(mesh.boundary_facets())
    places = mesh.doflocs[:, mesh.facets[:, facets]]
    free = np.ones(facets.size, dtype=np.bool_)
    named: dict[str, NDArray[np.int32]] = {}
    for name, chooser in boundaries.items():
        chosen = chooser(places) & free
        free &= ~chosen
        if np.any(chosen):
            named[name] = facets[chosen].astype(np.int32)
    if np.any(free):
        where = ", ".join(f"{1e3 * value:.4g}" for value in places[:, :, free].mean(axis=1)[:, 0])
        raise FeMeshError(f"{int(np.sum(free))} facets of the surface belong to no boundary, one about ({where}) mm")
    return named


def on_surface(distance: Callable[[NDArray[np.float64]], NDArray[np.float64]], size: float) -> Chooser:
    """Return the chooser of the facets whose vertices are all at distance zero, to 1e-6 of a size, m."""

    def choose(places: NDArray[np.float64]) -> NDArray[np.bool_]:
        return np.all(np.abs(distance(places)) < 1e-6 * size, axis=0)

    return choose


def within(chooser: Chooser, x_end: float, z_end: float) -> Chooser:
    """Return the facets of a chooser whose vertices lie within |x| <= x_end and |z| <= z_end."""

    def choose(places: NDArray[np.float64]) -> NDArray[np.bool_]:
        margin = 1.0 + 1e-6
        inside = (np.abs(places[0]) <= x_end * margin) & (np.abs(places[2]) <= z_end * margin)
        return chooser(places) & np.all(inside & (places[1] > 0.0), axis=0)

    return choose
