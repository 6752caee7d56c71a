"""A casing of finite elements: stiffness, mass, seats of bearings as ports for forces and motions, and its outside.

The unknowns q are the free displacements; u = T q gives those of all nodes. A rigid seat has no nodes of its own left:
they move with its six unknowns, three translations and three rotations about its centre (these times the radius of the
bore, m). A force on a seat and its motion have the same column b: the load is b f, the motion b' q.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from models.fe.casing.mesh import casing_mesh
from models.fe.casing.shape import SIDES
from models.fe.solid.cholesky import Cholesky
from models.fe.solid.cholesky import plan as dissect
from models.fe.solid.cost import check_memory
from models.fe.solid.elastic import ElasticBody, FeError, jacobians
from models.fe.solid.shape import quadrature, shapes
from models.fe.solid.sparse import SparseMatrix, sparse_matrix
from models.fe.solid.traction import boundary_points, mean_weights

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from models.fe.casing.shape import CasingMeshRule, CasingShape, Material, Seat
    from models.fe.solid.cholesky import FactorPlan

    Array = NDArray[np.float64]

_ELEMENTS_AT_ONCE = 256


def mass_matrix(body: ElasticBody, density: float) -> SparseMatrix:
    """Return the mass matrix, kg, sparse (dim * nodes, dim * nodes), of a density, kg/m3.

    The points of the stiffness integrate it exactly for cells with parallel faces.

    Raises:
        FeError: the cells are tetrahedra or triangles, for which those points are too few.
    """
    if str(body.mesh.elem.refdom.name) not in ("Hexahedral", "Quadrilateral"):
        raise FeError(f"{body.name}: masses need hexahedra or quadrilaterals, got {body.mesh.elem.refdom.name}")
    points, weights = quadrature(body.mesh, body.element)
    values, _ = shapes(body.element, points)
    table = np.asarray(body.dofs.element_dofs, np.int64)
    functions, elements = table.shape
    count = body.nodes.shape[1]
    total = sparse_matrix(np.zeros(0), np.zeros(0, int), np.zeros(0, int), (count, count))
    for start in range(0, elements, _ELEMENTS_AT_ONCE):
        chunk = np.arange(start, min(start + _ELEMENTS_AT_ONCE, elements))
        _, volume = jacobians(body.mesh, chunk, points)
        blocks = density * np.einsum("aq,bq,eq->eab", values, values, volume * weights, optimize=True)
        rows = table[:, chunk].T
        i, j = np.repeat(rows, functions, axis=1).ravel(), np.tile(rows, (1, functions)).ravel()
        total = total + sparse_matrix(blocks.ravel(), i, j, (count, count))
    # The same for each component: node and component to the unknown dim * node + component.
    entries = total.tocoo()
    values_, row, column = (np.asarray(part) for part in (entries.data, entries.row, entries.col))
    parts = [(values_, body.dim * row + k, body.dim * column + k) for k in range(body.dim)]
    stacked = [np.concatenate([part[n] for part in parts]) for n in range(3)]
    return sparse_matrix(stacked[0], stacked[1], stacked[2], (body.dim * count, body.dim * count))


AXES = ("x", "y", "z")


@dataclass(frozen=True)
class Point:
    """A place on the casing, m; the nearest node stands for it."""

    name: str
    place: tuple[float, float, float]


class Casing:
    """A casing, assembled at once and factorised when that is first needed.

    Args:
        shape: walls, seats and feet.
        material: of all of it.
        rule: sizes of the cells.
        fixed: side, foot or seat -> components that are held; by default the feet, or the underside, in all three.

    Attributes:
        body: the elastic body, with the supports.
        transform: T, sparse (3 nodes, unknowns).
        stiffness, mass: of the unknowns, sparse; the mass carried by seats is in it.

    Raises:
        FeError: the supports leave a rigid motion, or hold a rigid seat.
        MissingExtraError: scikit-fem is missing.
    """

    def __init__(
        self,
        shape: CasingShape,
        material: Material,
        rule: CasingMeshRule,
        fixed: Mapping[str, Sequence[int]] | None = None,
    ) -> None:
        """Assemble."""
        self.shape, self.material, self.rule = shape, material, rule
        held = [f"foot{n}" for n in range(1, len(shape.feet) + 1)] or ["y0"]
        supports = dict.fromkeys(held, (0, 1, 2)) if fixed is None else dict(fixed)
        mesh = casing_mesh(shape, rule)
        self.body = ElasticBody(mesh, material.modulus, material.poisson, supports, name="the casing")
        self._masters = _masters(self.body, [seat for seat in shape.seats if seat.spider == "rigid"])
        self.transform: SparseMatrix = _transform(self.body, self._masters)
        self._ports: dict[str, Array] = {}
        for seat in shape.seats:
            points = boundary_points(self.body, seat.name)
            for axis, letter in enumerate(AXES):
                weights = mean_weights(self.body, points, axis)
                self._ports[f"{seat.name}.{letter}"] = np.asarray(self.transform.T @ weights, np.float64)
        self.stiffness: SparseMatrix = self.transform.T @ self.body.stiffness @ self.transform
        mass = self.transform.T @ mass_matrix(self.body, material.density) @ self.transform
        for seat in shape.seats:
            for letter in AXES if seat.mass else ():
                column = self._ports[f"{seat.name}.{letter}"]
                places = np.nonzero(column)[0]
                entries = seat.mass * np.outer(column[places], column[places]).ravel()
                i, j = np.repeat(places, len(places)), np.tile(places, len(places))
                mass = mass + sparse_matrix(entries, i, j, mass.shape)
        self.mass: SparseMatrix = mass
        self._plan: FactorPlan | None = None
        self._factor: Cholesky | None = None

    @property
    def unknowns(self) -> int:
        """Number of unknowns."""
        return int(self.transform.shape[1])

    @property
    def total_mass(self) -> float:
        """Mass of the material and of what the seats carry, kg."""
        moved = np.zeros((self.body.nodes.shape[1], 3))
        moved[:, 0] = 1.0
        weight = mass_matrix(self.body, self.material.density)
        return float(moved.ravel() @ (weight @ moved.ravel())) + sum(seat.mass for seat in self.shape.seats)

    @property
    def plan(self) -> FactorPlan:
        """Order and cost of the factorisation."""
        if self._plan is None:
            table = np.asarray(self.body.dofs.element_dofs, np.int64)
            count = self.body.nodes.shape[1]
            owner: NDArray[np.int64] = np.arange(count, dtype=np.int64)
            for number, master in enumerate(self._masters):
                owner[master.nodes] = count + number
            centres = [master.centre[:, None] for master in self._masters]
            nodes = np.concatenate([self.body.nodes, *centres], axis=1)
            first = np.asarray(self.transform.indices)[np.asarray(self.transform.indptr)[:-1]] // 3
            self._plan = dissect(owner[table], nodes, owner[first])
        return self._plan

    def solve(self, loads: Array) -> Array:
        """Return the unknowns under loads, both of shape (unknowns, cases).

        Raises:
            MemoryBoundError: the factor needs more memory than there is, known before it is made.
        """
        if self._factor is None:
            held = 12.0 * (self.stiffness.nnz + self.mass.nnz)
            check_memory(self.unknowns, self.body.name, memory=8.0 * self.plan.peak_entries + 3.0 * held)
            try:
                self._factor = Cholesky(self.stiffness, self.plan)
            except np.linalg.LinAlgError:
                raise FeError("the casing: the stiffness is not positive definite; is every piece held?") from None
        return self._factor.solve(loads)

    def node(self, point: Point) -> int:
        """Return the node nearest to a point.

        Raises:
            ValueError: it is farther away than a cell is long.
        """
        distance = np.linalg.norm(self.body.nodes - np.array(point.place)[:, None], axis=0)
        nearest = int(np.argmin(distance))
        if distance[nearest] > self.rule.size:
            place = ", ".join(f"{x:.4g}" for x in self.body.nodes[:, nearest])
            raise ValueError(
                f"point {point.name!r} is {distance[nearest]:.4g} m from the casing, whose nearest node is at {place} m"
            )
        return nearest

    def columns(self, points: Sequence[Point] = ()) -> dict[str, Array]:
        """Return the column b, shape (unknowns,), of each direction of each seat and point, by ``NAME.x`` ..."""
        found = dict(self._ports)
        for point in points:
            node = self.node(point)
            for axis, letter in enumerate(AXES):
                found[f"{point.name}.{letter}"] = np.asarray(self.transform[3 * node + axis].toarray()[0], np.float64)
        return found


@dataclass(frozen=True, eq=False)
class _Master:
    """The nodes of a rigid seat, its centre, m, and the radius of its bore, m."""

    nodes: NDArray[np.int64]
    centre: Array
    radius: float


def _masters(body: ElasticBody, seats: Sequence[Seat]) -> list[_Master]:
    """Return the rigid seats of a body, checked to be free of supports and of each other."""
    free = np.zeros(body.nodes.shape[1], np.int64)
    np.add.at(free, np.asarray(body.admissible.indices) // body.dim, 1)
    taken = np.zeros(len(free), bool)
    found: list[_Master] = []
    for seat in seats:
        nodes = np.unique(np.asarray(body.dofs.get_facet_dofs(body.mesh.boundaries[seat.name]).flatten(), np.int64))
        if np.any(free[nodes] < body.dim):
            raise FeError(f"seat {seat.name!r} is rigid and cannot be held: give it the spider 'mean'")
        if np.any(taken[nodes]):
            raise FeError(f"seat {seat.name!r} is rigid and shares nodes with another rigid seat")
        taken[nodes] = True
        depth = body.nodes[2, nodes]
        centre = np.array([*seat.centre, 0.5 * (depth.min() + depth.max())])
        found.append(_Master(nodes, centre, 0.5 * seat.bore))
    return found


def _transform(body: ElasticBody, masters: Sequence[_Master]) -> SparseMatrix:
    """Return T: the free columns of the supports without the nodes of rigid seats, then six columns a seat."""
    admissible = body.admissible
    slave = np.zeros(body.nodes.shape[1], bool)
    for master in masters:
        slave[master.nodes] = True
    first = np.asarray(admissible.indices)[np.asarray(admissible.indptr)[:-1]] // body.dim
    kept = admissible[:, np.nonzero(~slave[first])[0]].tocoo()
    values, rows, columns = ([np.asarray(part)] for part in (kept.data, kept.row, kept.col))
    count = int(kept.shape[1])
    for master in masters:
        arm = (body.nodes[:, master.nodes] - master.centre[:, None]) / master.radius
        one, none = np.ones(arm.shape[1]), np.zeros(arm.shape[1])
        # Unit translations, and rotation vectors of unit length crossed with the arms.
        motions = [[one, none, none], [none, one, none], [none, none, one], [none, -arm[2], arm[1]],
                   [arm[2], none, -arm[0]], [-arm[1], arm[0], none]]  # fmt: skip
        for motion in motions:
            for axis, moved in enumerate(motion):
                values.append(moved)
                rows.append(3 * master.nodes + axis)
                columns.append(np.full(len(moved), count))
            count += 1
    matrix = sparse_matrix(
        np.concatenate(values), np.concatenate(rows), np.concatenate(columns), (admissible.shape[0], count)
    )
    matrix.eliminate_zeros()
    return matrix


@dataclass(frozen=True, eq=False)
class RadiatingSurface:
    """Elements of the outside, in the axes of a half space: the casing's (x, y, z) is (x, -z, y) here.

    Attributes:
        corners: m, shape (corners, 3); the underside of the casing is the plane z = 0.
        elements: corners of each, anticlockwise from outside, shape (elements, 4).
        columns: name -> column b of the mean normal displacement of an element, outwards, shape (unknowns,) each; the
            names are "0", "1", ... in the order of the elements.
    """

    corners: Array
    elements: NDArray[np.int64]
    columns: dict[str, Array]


def radiating_surface(casing: Casing) -> RadiatingSurface:
    """Return the outer sides of a casing but its underside, which stands on a plane.

    The inside of open bores is left out, so that the surface is closed only where seats have covers and sides walls.
    """
    body = casing.body
    facets = np.asarray(body.mesh.facets, np.int64)
    corners: list[NDArray[np.int64]] = []
    normals: list[Array] = []
    columns: list[Array] = []
    for side in (side for side in SIDES if side != "y0"):
        chosen = np.asarray(body.mesh.boundaries[side], np.int64)
        if not chosen.size:
            continue
        points = boundary_points(body, side)
        corners.append(facets[:, chosen].T)
        normals.append(points.normals.mean(axis=2).T)
        area = points.weights.sum(axis=1)
        shares = np.einsum("afp,ifp,fp->afi", points.values, points.normals, points.weights) / area[:, None]
        rows = 3 * points.nodes[:, :, None] + np.arange(3)
        places = np.broadcast_to(np.arange(len(chosen))[:, None], rows.shape[1:])
        where = np.broadcast_to(places, rows.shape)
        weights = sparse_matrix(shares.ravel(), rows.ravel(), where.ravel(), (3 * body.nodes.shape[1], len(chosen)))
        columns.append(np.asarray((casing.transform.T @ weights).toarray(), np.float64))
    used, numbers = np.unique(np.concatenate(corners), return_inverse=True)
    places = np.asarray(body.mesh.p, np.float64)[:, used].T
    elements = _anticlockwise(places, numbers.reshape(-1, 4), np.concatenate(normals))
    turned = np.stack((places[:, 0], -places[:, 2], places[:, 1]), axis=1)
    names = [str(number) for number in range(len(elements))]
    return RadiatingSurface(turned, elements, dict(zip(names, np.concatenate(columns, axis=1).T, strict=True)))


def _anticlockwise(places: Array, elements: NDArray[np.int64], normals: Array) -> NDArray[np.int64]:
    """Return the corners of elements in order round their middles, anticlockwise about the normals."""
    offset = places[elements] - places[elements].mean(axis=1, keepdims=True)
    across = np.cross(normals, offset[:, 0])
    angle = np.arctan2(np.einsum("eci,ei->ec", offset, across), np.einsum("eci,ei->ec", offset, offset[:, 0]))
    return np.take_along_axis(elements, np.argsort(angle, axis=1), axis=1)
