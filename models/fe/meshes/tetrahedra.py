"""Tetrahedra by gmsh: the size is given on patches of a surface and grows with the distance from them.

Tetrahedra are there for the comparison with chapter 3 of the thesis and for shapes that hexahedra do not fit;
``models.fe.meshes.grid`` is the ordinary way, ``models.fe.meshes.tet_bodies`` has the bodies. gmsh is GPL, is imported
here alone, when it is used, and runs with one thread and fixed seeds: the same input gives the same mesh.
"""

from __future__ import annotations

import dataclasses
import math
import threading
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from models.fe.extra import require_gmsh, require_skfem
from models.platform.process_signals import sigpipe_kept
from models.words.errors import SpallwatchError, WrongInputError

if TYPE_CHECKING:
    from collections.abc import Callable, Generator

    from numpy.typing import NDArray

    OffSurface = Callable[[NDArray[np.float64]], NDArray[np.float64]]

Order = Literal[1, 2]

MAX_NODES = 150_000
MM = 1e3
# Size of a tetrahedron per distance from the patch; fitted to the node counts of Tables 5 and 9.
GROWTH = 0.25
TETRAHEDRA_PER_CUBE = 6.0 * math.sqrt(2.0)  # regular tetrahedra of edge h in h^3
# Vertices and edge midpoints per tetrahedron of a large mesh without its surface.
NODES_PER_TETRAHEDRON = {1: 0.18, 2: 1.37}
ON_SURFACE = 1e-6  # mm
MIN_JACOBIAN_RATIO = 0.02  # least over largest Jacobian in a tetrahedron
MAX_STRAIGHTENED_PASSES = 10

_LOCK = threading.Lock()


class MeshingError(SpallwatchError):
    """gmsh cannot mesh this geometry, or a tetrahedron of the mesh is turned inside out."""


@dataclass(frozen=True, slots=True)
class TetPatch:
    """The finely meshed part of a surface: |x| <= half_x, |z| <= half_z about the contact, in m, with its size."""

    half_x: float
    half_z: float
    size: float


@dataclass(frozen=True, slots=True)
class TetRule:
    """The sizes outside the patches.

    Attributes:
        global_size: largest edge of a tetrahedron, m: g of the thesis.
        growth: size per distance from a patch.
        order: 1 for four nodes (CTETRA4), 2 for ten on the exact surface (CTETRA10).
        max_nodes: nodes of a body above which it is refused, before it is meshed.
    """

    global_size: float
    growth: float = GROWTH
    order: Order = 2
    max_nodes: int = MAX_NODES


@dataclass(frozen=True, slots=True)
class TetBody:
    """What gmsh is to mesh; lengths in mm, for which its tolerances are meant.

    Attributes:
        name: for messages.
        build: makes the solid with gmsh's ``occ`` and returns its tag.
        patches: y of each contact and its patch; a patch rules the points of its sign of y.
        depth: of a point (x, y, z) below the surface with the patches.
        surfaces: boundary name -> how far points (3, n) are off it; each surface of the solid lies on one of them. The
            name "contact" is split into "contact_inner" (y < 0) and "contact_outer".
    """

    name: str
    build: Callable[[Any], int]
    patches: tuple[tuple[float, TetPatch], ...]
    depth: Callable[[float, float, float], float]
    surfaces: dict[str, OffSurface]


def estimated_nodes(volume: float, patches: tuple[TetPatch, ...], rule: TetRule) -> int:
    """Return the nodes that a body of a volume, m^3, will have, to about a third; the size field is integrated."""
    growth, largest = rule.growth, rule.global_size
    tetrahedra, filled = 0.0, 0.0
    for patch in patches:
        reach = max(largest - patch.size, 0.0) / growth
        d = np.linspace(0.0, reach, 2001)
        a, b = patch.half_x, patch.half_z
        inside = a * b * d + 0.25 * math.pi * (a + b) * d**2 + math.pi / 6.0 * d**3
        size = patch.size + growth * 0.5 * (d[1:] + d[:-1])
        # Beyond the body's own share the layers lie outside it.
        share = np.diff(np.minimum(inside, volume / len(patches)))
        tetrahedra += TETRAHEDRA_PER_CUBE * float(np.sum(share / size**3))
        filled += float(np.sum(share))
    tetrahedra += TETRAHEDRA_PER_CUBE * max(volume - filled, 0.0) / largest**3
    return round(NODES_PER_TETRAHEDRON[rule.order] * tetrahedra)


@contextmanager
def _session() -> Generator[Any]:
    """Run gmsh silently, with one thread and without its signal handler; always end it."""
    gmsh = require_gmsh()
    with _LOCK:
        if gmsh.isInitialized():
            raise MeshingError("gmsh is in use by this process: its state is global; call gmsh.finalize() first")
        # PETSc, which is in it, lets a broken pipe end the process.
        with sigpipe_kept():
            gmsh.initialize([], readConfigFiles=False, run=False, interruptible=False)
        try:
            for option, value in {
                "General.Terminal": 0,
                "General.NumThreads": 1,
                "Mesh.RandomSeed": 1,
                "Mesh.Algorithm": 6,
                "Mesh.Algorithm3D": 1,
                "Mesh.MeshSizeExtendFromBoundary": 0,
                "Mesh.MeshSizeFromPoints": 0,
                "Mesh.MeshSizeFromCurvature": 0,
            }.items():
                gmsh.option.setNumber(option, value)
            yield gmsh
        finally:
            gmsh.finalize()


def tet_mesh(body: TetBody, rule: TetRule) -> Any:
    """Mesh a body; return a skfem ``MeshTet1`` or ``MeshTet2`` in m with named boundaries.

    Raises:
        MissingExtraError: gmsh or scikit-fem cannot be imported.
        WrongInputError: a size that is not positive, or a mesh with more nodes than ``rule.max_nodes``.
        MeshingError: gmsh fails, is in use by the caller, or a tetrahedron stays turned inside out.
    """
    require_positive(global_size=rule.global_size, growth=rule.growth)
    if rule.order not in (1, 2):
        raise WrongInputError(f"order: expected 1 or 2, got {rule.order!r}")
    for _, patch in body.patches:
        require_positive(half_x=patch.half_x, half_z=patch.half_z, size=patch.size)
    require_skfem()
    with _session() as gmsh:
        try:
            solid = body.build(gmsh.model.occ)
            gmsh.model.occ.synchronize()
            expected = estimated_nodes(
                gmsh.model.occ.getMass(3, solid) / MM**3, tuple(patch for _, patch in body.patches), rule
            )
            if expected > rule.max_nodes:
                raise WrongInputError(
                    f"{body.name}: about {expected} nodes of tetrahedra, more than the bound of {rule.max_nodes}; "
                    "expected larger local or global sizes"
                )
            _set_sizes(gmsh, body, rule)
            gmsh.model.mesh.generate(3)
            if rule.order == 2:
                gmsh.model.mesh.setOrder(2)
            return _as_skfem(gmsh, body, rule.order)
        except SpallwatchError:
            raise
        except Exception as error:  # gmsh raises bare exceptions
            raise MeshingError(f"{body.name}: gmsh cannot mesh it: {error}") from error


def _set_sizes(gmsh: Any, body: TetBody, rule: TetRule) -> None:
    """Let the size be that of the patch on it, and grow with the distance from it."""
    largest, growth = MM * rule.global_size, rule.growth
    patches = [(y, MM * p.half_x, MM * p.half_z, MM * p.size) for y, p in body.patches]

    def size(_dimension: int, _tag: int, x: float, y: float, z: float, _given: float) -> float:
        depth = body.depth(x, y, z)
        smallest = largest
        for side, half_x, half_z, local in patches:
            if side * y > 0.0:
                away = math.hypot(max(abs(x) - half_x, 0.0), depth, max(abs(z) - half_z, 0.0))
                smallest = min(smallest, local + growth * away)
        return smallest

    gmsh.model.mesh.setSizeCallback(size)


def _as_skfem(gmsh: Any, body: TetBody, order: Order) -> Any:
    """Return the mesh in m with its named boundaries; each surface of the solid must lie on a named one."""
    skfem = require_skfem()
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    points = coordinates.reshape(-1, 3).T
    row = np.zeros(int(tags.max()) + 1, dtype=np.int64)
    row[tags.astype(np.int64)] = np.arange(tags.size)
    nodes = gmsh.model.mesh.getElementsByType(4 if order == 1 else 11)[1].astype(np.int64)
    t = row[nodes].reshape(-1, 4 if order == 1 else 10).T
    if order == 2:
        t = t[[0, 1, 2, 3, 4, 5, 6, 7, 9, 8]]  # skfem has edge 1-3 before edge 2-3
    used, t_used = np.unique(t, return_inverse=True)  # the centre of an arc is a node of no tetrahedron
    t = t_used.reshape(t.shape)
    mesh = (skfem.MeshTet1 if order == 1 else skfem.MeshTet2)(
        np.ascontiguousarray(points[:, used]) / MM, np.ascontiguousarray(t)
    )
    vertices = np.unique(t[:4])

    triangles: dict[str, list[NDArray[np.int64]]] = {}
    for _, surface in gmsh.model.getEntities(2):
        name = _surface_name(gmsh, body, surface)
        corners = gmsh.model.mesh.getElementsByType(2 if order == 1 else 9, surface)[1].astype(np.int64)
        corners = row[corners].reshape(-1, 3 if order == 1 else 6)[:, :3]
        triangles.setdefault(name, []).append(np.searchsorted(vertices, np.searchsorted(used, corners)))
    boundaries = {name: _facets_of(mesh, np.concatenate(found)) for name, found in triangles.items()}
    if "contact" in boundaries:
        contact = boundaries.pop("contact")
        above = mesh.p[1, mesh.facets[:, contact]].mean(axis=0) > 0.0
        boundaries |= {"contact_inner": contact[~above], "contact_outer": contact[above]}
    return _upright(mesh.with_boundaries(boundaries), body.name)


def _surface_name(gmsh: Any, body: TetBody, surface: int) -> str:
    _, coordinates, _ = gmsh.model.mesh.getNodes(2, surface, includeBoundary=True)
    points = coordinates.reshape(-1, 3).T
    off = {name: float(np.max(np.abs(distance(points)))) for name, distance in body.surfaces.items()}
    name = min(off, key=lambda known: off[known])
    if off[name] > ON_SURFACE:
        raise MeshingError(f"{body.name}: nodes of a surface are {off[name]:.2g} mm off the nearest named one, {name}")
    return name


def _facets_of(mesh: Any, corners: NDArray[np.int64]) -> NDArray[np.int32]:
    """Return the facets of a mesh with given vertices, (triangles, 3)."""
    count = np.int64(mesh.p.shape[1])

    def key(vertices: NDArray[np.int64]) -> NDArray[np.int64]:
        first, second, third = np.sort(vertices.astype(np.int64), axis=0)
        return (first * count + second) * count + third

    facets = mesh.boundary_facets()
    keys = key(mesh.facets[:, facets])
    order = np.argsort(keys)
    wanted = key(corners.T)
    place = order[np.minimum(np.searchsorted(keys, wanted, sorter=order), keys.size - 1)]
    if not np.array_equal(keys[place], wanted):
        raise MeshingError("triangles of the surface are not facets of the tetrahedra")
    return np.sort(facets[place]).astype(np.int32)


def _upright(mesh: Any, name: str) -> Any:
    """Return the mesh with straight edges where curved ones would turn a tetrahedron inside out.

    That happens where an edge as long as the global size follows a rounding; its middle then leaves the surface.
    """
    corners = np.array([[0, 1, 2, 0, 1, 2], [1, 2, 0, 3, 3, 3]])
    turned = np.zeros(0, dtype=np.int64)
    for _ in range(MAX_STRAIGHTENED_PASSES):
        # At the nodes, where a quadratic map turns first.
        jacobian = mesh.mapping().detDF(np.array(mesh.elem.doflocs).T)
        low, high = jacobian.min(axis=1), jacobian.max(axis=1)
        turned = np.flatnonzero(low * np.sign(high) <= MIN_JACOBIAN_RATIO * np.abs(high))
        if not turned.size:
            return mesh
        if mesh.elem.maxdeg == 1:
            break
        doflocs = mesh.doflocs.copy()
        middles = mesh.dofs.element_dofs[4:, turned]
        ends = mesh.t[:, turned]
        doflocs[:, middles] = 0.5 * (doflocs[:, ends[corners[0]]] + doflocs[:, ends[corners[1]]])
        mesh = dataclasses.replace(mesh, doflocs=doflocs)
    raise MeshingError(f"{name}: {turned.size} of {mesh.t.shape[1]} tetrahedra are turned inside out; expected 0")


def require_positive(**values: float) -> None:
    """Raise WrongInputError that names the first value that is not positive and finite."""
    for name, value in values.items():
        if not (math.isfinite(value) and value > 0.0):
            raise WrongInputError(f"{name}: expected a positive number, got {value!r}")
