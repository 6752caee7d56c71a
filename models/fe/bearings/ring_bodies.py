"""Influence of a ring from finite elements: half a ring on its support, loaded by one element at angle zero.

Away from the contact the displacement does not depend on the fine mesh there, so that a mesh for a large load serves
all. A support other than the one of the element law also changes what the race yields under the element itself; that
difference is smooth, and one mesh with both supports gives it.

Under a sinusoidal pressure nothing holds the bore. Each force of an element is balanced by a pressure p cos(angle) on
the bore, and so is the pressure that carries the load: once the elements carry the load, these balances cancel. What is
left open, the rigid motion, is fixed by the bore's first harmonic being zero: it is the displacement of the bearing.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from models.fe.bearings.rings import BoreLoad, RingInfluence
from models.fe.extra import require_skfem
from models.fe.meshes.ring_mesh import ring_mesh
from models.fe.meshes.sizing import ContactGrid, MeshRule, contact_grid, half_sizes
from models.fe.solid.condense import ContactCells, ContactFrame, cell_loads
from models.fe.solid.elastic import ElasticBody, FeError
from models.fe.solid.shape import FeMesh, boundary_facets

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.fe.meshes.geometry import FeGeometry, Race

# A coarse patch and fine rows around the ring: what passes between elements is the bending of the ring.
INFLUENCE_RULE = MeshRule(patch=1.6, size=0.8, growth=2.0, along=3, end=0.5, coarse=0.7)
# Share of the closest spacing of elements from which on the influence is tabulated.
_FIRST_SHARE = 0.7
# Half width of the patch's contact by the radius of the element.
_INFLUENCE_WIDTH = 0.03
# Half width of the strip of bore that is read as a line, by the bore's radius.
_LINE_WIDTH = 0.01
# Nodes closer than this angle, rad, stand in one line along the shaft.
_SAME_ANGLE = 1e-7
# Degree of the quadrature over the bore.
_BORE_DEGREE = 6

Traction = Callable[["NDArray[np.float64]"], "NDArray[np.float64]"]


@dataclass(frozen=True, eq=False)
class RingBody:
    """Half a ring with readers of its displacement; loads are per newton on the whole ring.

    Attributes:
        geometry, race, mesh, grid: of the ring and of its contact.
        angle: where the race is read, rad, ascending to pi, shape (n,).
    """

    geometry: FeGeometry
    race: Race
    mesh: FeMesh
    grid: ContactGrid
    angle: NDArray[np.float64]

    @classmethod
    def of(cls, geometry: FeGeometry, race: Race, load: float, rule: MeshRule) -> RingBody:
        """Return the half ring with a mesh for a load on the element, N."""
        grid = contact_grid(geometry, race, load, rule)
        mesh = ring_mesh(geometry, race, grid, rule)
        return cls(geometry, race, mesh, grid, _race_angles(mesh, geometry))

    @property
    def back(self) -> str:
        """Name of the boundary that the shaft or the housing holds."""
        return "bore" if self.race == "inner" else "outside"

    def held(self) -> ElasticBody:
        """Return the ring whose back is fixed to a rigid body."""
        return self._body({self.back: (0, 1, 2)})

    def free(self) -> ElasticBody:
        """Return the ring that nothing holds along the axis of the contact but one node, for loads in balance."""
        lonely = int(np.argmin(np.asarray(self.mesh.doflocs)[1]))
        return self._body({lonely: (1,)})

    def element_load(self, body: ElasticBody) -> NDArray[np.float64]:
        """Return the load of one newton on an element at angle zero, shape (3 nodes,): Hertz' pressure."""
        x, z = self.grid.x, self.grid.z
        cells = ContactCells.grid(x, z)
        loads = cell_loads(body, "contact", cells)
        return loads @ (0.25 * self._share(cells))

    def readers(self, body: ElasticBody) -> NDArray[np.float64]:
        """Return columns whose product with a displacement is how far the race yields at each angle, (3 nodes, n)."""
        return _readers(body, "race", self.angle, float(self.grid.x[-1]), self.grid.z, self._reading)

    def bore_readers(self, body: ElasticBody, angles: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return columns for how far the bore moves outwards at angles, mean over its width, shape (3 nodes, n)."""
        width = _LINE_WIDTH * self.geometry.bore_radius
        return _readers(body, "bore", angles, width, np.array([0.0, 0.5 * self.geometry.width]), _even_share)

    def _body(self, fixed: dict[Any, Any]) -> ElasticBody:
        steel = self.geometry
        return ElasticBody(self.mesh, steel.modulus, steel.poisson, {**fixed, "x0": (0,), "z0": (2,)})

    def _reading(self, cells: ContactCells) -> NDArray[np.float64]:
        """Return the weights, 1/m^2, of cells about another element: Hertz' along the shaft, even across."""
        return self._share(cells, across=False)

    def _share(self, cells: ContactCells, *, across: bool = True) -> NDArray[np.float64]:
        """Return pressures, Pa, of Hertz' kind whose force on the cells is one newton, shape (cells,)."""
        x, z = cells.centre
        left = np.ones_like(x)
        if across:
            left = left - (x / self.grid.half_width) ** 2
        if self.geometry.element == "ball":
            left = left - (z / self.grid.half_length) ** 2
        pressure = np.sqrt(np.maximum(left, 0.0))
        return pressure / float(pressure @ cells.area)


@dataclass(frozen=True, eq=False)
class BalancedBody:
    """Body that nothing holds along y: loads are balanced by a traction that goes with cos(angle) on its round.

    Attributes:
        body: held along y at one node.
        cosine: loads of that traction, shape (3 nodes,).
    """

    body: ElasticBody
    cosine: NDArray[np.float64]

    @classmethod
    def ring(cls, body: ElasticBody) -> BalancedBody:
        """Return it for half a ring, whose boundary "bore" carries the traction."""
        return cls(body, bore_traction(body, np.cos))

    @cached_property
    def shift(self) -> NDArray[np.float64]:
        """Unit shift along y, shape (3 nodes,)."""
        shift = np.zeros(self.body.nodes.size)
        shift[1 :: self.body.dim] = 1.0
        return shift

    def solve(self, load: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the displacement under a load, or loads (3 nodes, cases), and their balance.

        The first harmonic of the round is zero.
        """
        stiffness = float(self.cosine @ self.shift)
        u = self.body.solve(load - np.multiply.outer(self.cosine, self.shift @ load) / stiffness)
        # The traction cos(angle) is also the measure of the first harmonic: a shift by one has one.
        return u - np.multiply.outer(self.shift, self.cosine @ u) / stiffness


def influence_load(geometry: FeGeometry) -> float:
    """Return the load on an element, N, for which the influence's mesh is made: half width 0.03 of its radius.

    So large a patch is far from the next element, and so small that the load is local.
    """
    trial = geometry.element_radius**2 * geometry.modulus * 1e-6
    _, width = half_sizes(geometry, "inner", trial)
    power = 2.0 if geometry.element == "roller" else 3.0
    return trial * (_INFLUENCE_WIDTH * geometry.element_radius / width) ** power


def ring_influence(
    geometry: FeGeometry,
    ring: Race,
    load: float | None = None,
    *,
    balanced: bool = False,
    rule: MeshRule | None = None,
) -> RingInfluence:
    """Return the influence of a ring whose back is fixed, or of an inner one that a pressure on its bore carries.

    Args:
        load: on an element, N, for the size of the patch; by default ``influence_load``.
        balanced: whether nothing holds the bore (``bore_load`` is the other part).

    Raises:
        FeError, WrongInputError: the sizes do not fit the ring, or an outer ring is to be without a support.
    """
    if balanced and ring != "inner":
        raise FeError("the outer ring has no bore that could carry the load: expected balanced for the inner ring only")
    half = RingBody.of(geometry, ring, load or influence_load(geometry), rule or INFLUENCE_RULE)
    held = half.held()
    force, readers = half.element_load(held), half.readers(held)
    under = held.solve(force)
    if not balanced:
        return RingInfluence(half.angle, readers.T @ under)
    u = BalancedBody.ring(half.free()).solve(force)
    return RingInfluence(half.angle, readers.T @ u, float(4.0 * force @ (u - under)), "sinusoidal")


def bore_load(
    geometry: FeGeometry, load: float | None = None, *, extent: float = math.pi, rule: MeshRule | None = None
) -> BoreLoad:
    """Return the inner ring under a pressure of cos(pi angle / extent) on its bore, as a shaft would exert (Fig. 21).

    Args:
        load: on an element, N, for the size of the patch; by default ``influence_load``.
        extent: angle that the pressure spans, rad, up to pi (the load zone of Eq. 26).

    Raises:
        FeError, WrongInputError: the extent is not within (0, pi], or the sizes do not fit the ring.
    """
    if not 0.0 < extent <= math.pi * (1.0 + 1e-12):
        raise FeError(f"extent of the pressure must be above 0 and up to pi, got {extent!r}")
    half = RingBody.of(geometry, "inner", load or influence_load(geometry), rule or INFLUENCE_RULE)
    ring = BalancedBody.ring(half.free())
    pressure = bore_traction(ring.body, lambda angle: np.maximum(np.cos(np.pi / extent * angle), 0.0), extent)
    u = ring.solve(pressure / (4.0 * float(pressure @ ring.shift)))
    force, readers = half.element_load(ring.body), half.readers(ring.body)
    under = ring.solve(force)
    angles = np.concatenate(([0.0], half.angle))
    race = np.concatenate(([4.0 * float(force @ u)], readers.T @ u))
    line = half.bore_readers(ring.body, angles)
    return BoreLoad(angles, race, float(line[:, 0] @ u), line.T @ under)


def bore_traction(
    body: ElasticBody, shape: Traction, extent: float = 2.0 * math.pi, *, surface: str = "bore"
) -> NDArray[np.float64]:
    """Return the load of a traction on a surface of half a ring, along its radius outwards, shape (3 nodes,).

    Args:
        body: half a ring, its contact on the y axis.
        shape: traction, Pa, over the angle from the y axis, rad.
        extent: beyond half of it there is none, rad.
    """
    skfem = require_skfem()
    facets = boundary_facets(body.mesh, surface)
    basis: Any = skfem.FacetBasis(body.mesh, body.element, facets=facets, intorder=_BORE_DEGREE)
    x, y = np.asarray(basis.global_coordinates())[:2]
    angle = np.abs(np.arctan2(x, y))
    weight = np.where(2.0 * angle <= extent, shape(angle), 0.0) * np.asarray(basis.dx)
    load = np.zeros((body.nodes.shape[1], body.dim))
    values: list[Any] = [np.asarray(function[0]) for function in basis.basis]
    for number, value in zip(cast("NDArray[np.int64]", basis.element_dofs), values, strict=True):
        np.add.at(load[:, 0], number, np.sum(weight * np.sin(angle) * value, axis=1))
        np.add.at(load[:, 1], number, np.sum(weight * np.cos(angle) * value, axis=1))
    return load.ravel()


def _readers(
    body: ElasticBody,
    surface: str,
    angles: NDArray[np.float64],
    width: float,
    lines: NDArray[np.float64],
    share: Callable[[ContactCells], NDArray[np.float64]],
) -> NDArray[np.float64]:
    """Return columns for the mean yield of a surface at angles, over cells within a half width and lines along z, m."""
    columns = np.empty((body.nodes.size, len(angles)))
    for i, angle in enumerate(angles):
        # Planes of symmetry cut the first and the last.
        edges = [-width, 0.0, width]
        if angle < _SAME_ANGLE:
            edges = edges[1:]
        elif angle > math.pi - _SAME_ANGLE:
            edges = edges[:2]
        cells = ContactCells.grid(np.array(edges), lines)
        columns[:, i] = cell_loads(body, surface, cells, ContactFrame.rotated(float(angle))) @ share(cells)
    return columns


def _even_share(cells: ContactCells) -> NDArray[np.float64]:
    return np.full(len(cells), 1.0 / float(np.sum(cells.area)))


def _distinct(angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return angles, rad, ascending, each once."""
    ascending = np.sort(angles)
    return ascending[np.append(True, np.diff(ascending) > _SAME_ANGLE)]


def _race_angles(mesh: FeMesh, geometry: FeGeometry) -> NDArray[np.float64]:
    """Return the angles of the corners of elements along the race's middle, beyond the first spacing's share."""
    facets = boundary_facets(mesh, "race")
    points = np.asarray(mesh.p)[:, np.unique(np.asarray(mesh.facets)[:, facets])]
    middle = points[:, points[2] < 1e-9 * geometry.width]
    angles = _distinct(np.arctan2(middle[0], middle[1]))
    first = _FIRST_SHARE * 2.0 * math.pi / geometry.n_elements
    kept = angles[(angles > first) & (angles < math.pi - 1e-6)]
    before = angles[angles <= first]
    return np.concatenate((before[-1:], kept, [math.pi]))
