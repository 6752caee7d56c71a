"""A linear elastic body of finite elements: stiffness, supports, factorisation, displacement under loads.

Small strain, isotropic; in two dimensions plane strain of a body 1 m thick. Unknown ``dim * node + component`` is the
displacement of a node in m, a load in N belongs to it. The stiffness of an element is the integral of
lambda G_ai G_bj + mu (G_aj G_bi + delta_ij G_a . G_b) over its volume with the gradients G of the shape functions
(Zienkiewicz and Taylor, The Finite Element Method, 5th ed., vol. 1, section 4); it is contracted from all elements of a
chunk at once, which takes a hundredth of the time of a loop over pairs of shape functions.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from models.fe.solid.cholesky import Cholesky, FactorPlan
from models.fe.solid.cholesky import plan as dissect
from models.fe.solid.cost import check_memory
from models.fe.solid.shape import (
    FeDofs,
    FeElement,
    FeMesh,
    boundary_facets,
    displacement_element,
    mesh_dofs,
    quadrature,
    shapes,
)
from models.fe.solid.sparse import SparseMatrix, sparse_matrix
from models.words.errors import SpallwatchError, WrongInputError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    Held = Sequence[int] | NDArray[np.float64]
    # Boundary name or node -> held components, or directions (k, dim).
    Supports = Mapping[str, Held] | Mapping[str | int, Held]

_ELEMENTS_AT_ONCE = 256
# A rigid motion of norm 1 of which the supports stop less than this, squared, is not held.
_HELD_SHARE = 1e-14


class FeError(WrongInputError):
    """A body or contact of finite elements that cannot be computed; the message says why."""


class NotConvergedError(SpallwatchError):
    """A contact or an equilibrium of finite elements that was not found; the message says how far off it is."""


class ElasticBody:
    """One elastic body: assembled at once, factorised when it is first needed.

    Args:
        mesh: mesh of scikit-fem with named boundaries, coordinates in m.
        modulus: Young's modulus, Pa.
        poisson: Poisson's ratio, from 0 to below 0.5.
        fixed: boundary name -> components that are zero on it, such as ``{"x0": (0,), "bore": (0, 1, 2)}``; or, for a
            plane at an angle, an array (k, dim) of directions along which it does not move. An integer instead of a
            name is one node: a body under loads in equilibrium is held at one, whose reaction then is zero.
        order: order of the displacement, 1 or 2; by default that of the mesh.
        name: what messages call the body.

    Attributes:
        mesh, element, dofs: mesh, element of the displacement and scikit-fem's table of scalar unknowns.
        nodes: locations of the nodes, m, shape (dim, nodes).
        dim: 2 or 3.
        stiffness: stiffness without supports, N/m, sparse (dim * nodes, dim * nodes); its product with a displacement
            is the loads and the reactions of the supports.
        admissible: orthonormal sparse matrix (dim * nodes, unknowns): displacement = admissible @ unknowns.

    Raises:
        FeError: if a constant is out of range, an element is turned inside out, or the supports leave the body a rigid
            motion (a contact is no support: hold each body so that it cannot move as a whole).
        WrongInputError: if a boundary is unknown.
    """

    def __init__(
        self,
        mesh: FeMesh,
        modulus: float,
        poisson: float,
        fixed: Supports,
        *,
        order: int | None = None,
        name: str = "a body",
    ) -> None:
        """Assemble the stiffness and apply the supports; nothing is factorised."""
        if not (np.isfinite(modulus) and modulus > 0.0):
            raise FeError(f"modulus must be positive and finite, Pa, got {modulus!r}")
        if not 0.0 <= poisson < 0.5:
            raise FeError(f"poisson must be from 0 to below 0.5, got {poisson!r}")
        self.name = name
        self.mesh: FeMesh = mesh
        self.modulus, self.poisson = float(modulus), float(poisson)
        self.element: FeElement = displacement_element(mesh, order)
        self.dofs: FeDofs
        self.nodes: NDArray[np.float64]
        self.dofs, self.nodes = mesh_dofs(mesh, self.element)
        self.dim = int(self.nodes.shape[0])
        self.admissible: SparseMatrix = _admissible(self, fixed)
        _refuse_rigid_motion(self)
        self.stiffness: SparseMatrix = _assemble(self)
        self._plan: FactorPlan | None = None
        self._factor: Cholesky | None = None

    @property
    def unknowns(self) -> int:
        """Number of displacements that the supports leave free: the size of the matrix that is factorised."""
        return int(self.admissible.shape[1])

    @property
    def plan(self) -> FactorPlan:
        """Order of the factorisation, and its exact entries, operations and memory before it is made."""
        if self._plan is None:
            node_of = np.asarray(self.admissible.indices)[self.admissible.indptr[:-1]] // self.dim
            self._plan = dissect(np.asarray(self.dofs.element_dofs, np.int64), self.nodes, node_of)
        return self._plan

    @property
    def factor_entries(self) -> int | None:
        """Entries of the triangular factor, 8 bytes each, or None before it is made."""
        return None if self._factor is None else self._factor.entries

    @property
    def memory_bytes(self) -> int:
        """Bytes of stiffness and factor as they are now."""
        held = sum(int(part.nbytes) for part in (self.stiffness.data, self.stiffness.indices, self.stiffness.indptr))
        return held + 8 * (self.factor_entries or 0)

    def factorise(self) -> None:
        """Factorise the stiffness of the free unknowns, unless that was done.

        Raises:
            MemoryBoundError: if it needs more memory than there is, known from the plan before it begins.
            FeError: if the stiffness is not positive definite, such as of a body in pieces of which one is not held.
        """
        self._factorised()

    def solve(self, loads: Any) -> NDArray[np.float64]:
        """Return the displacement, m, under loads, N, shape (dim * nodes,) or (dim * nodes, cases), dense or sparse."""
        solution: NDArray[np.float64] = self.admissible @ self._factorised().solve(self._free(loads))
        return solution[:, 0] if len(loads.shape) == 1 else solution

    def flexibility(self, loads: Any, at: Any = None) -> NDArray[np.float64]:
        """Return at' K^-1 loads, shape (columns of ``at``, columns of ``loads``), for dense or sparse columns.

        With ``at`` left out it is that of the loads themselves, exactly symmetric, at half the cost.
        """
        half = self._factorised().forward(self._free(loads))
        return np.asarray((half if at is None else self._factorised().forward(self._free(at))).T @ half, np.float64)

    def _free(self, loads: Any) -> NDArray[np.float64]:
        """Return loads on the free unknowns, dense, shape (unknowns, cases)."""
        free: Any = self.admissible.T @ loads
        dense = np.asarray(free.toarray() if hasattr(free, "toarray") else free, float)
        return dense[:, None] if dense.ndim == 1 else dense

    def _factorised(self) -> Cholesky:
        """Return the factor, made at the first call."""
        if self._factor is None:
            # Three copies of the stiffness are made: with the supports, and two on the way to the order of elimination.
            check_memory(self.unknowns, self.name, memory=8.0 * self.plan.peak_entries + 3.0 * self.memory_bytes)
            try:
                self._factor = Cholesky(self.admissible.T @ self.stiffness @ self.admissible, self.plan)
            except np.linalg.LinAlgError:
                raise FeError(f"{self.name}: the stiffness is not positive definite; is every piece held?") from None
        return self._factor


def _assemble(body: ElasticBody) -> SparseMatrix:
    """Return the stiffness without supports, N/m."""
    points, weights = quadrature(body.mesh, body.element)
    table = np.asarray(body.dofs.element_dofs)
    functions, elements = table.shape
    wide = functions * body.dim
    size = body.dim * body.nodes.shape[1]
    rows = (body.dim * table.T[:, :, None] + np.arange(body.dim)).reshape(elements, wide).astype(np.int32)
    total = sparse_matrix(np.zeros(0), np.zeros(0, int), np.zeros(0, int), (size, size))
    # One sum a batch of chunks keeps the triplets, 12 bytes for each of wide^2 entries an element, within bounds.
    for start in range(0, elements, 4 * _ELEMENTS_AT_ONCE):
        stop = min(start + 4 * _ELEMENTS_AT_ONCE, elements)
        blocks = [
            _element_stiffness(body, np.arange(a, min(a + _ELEMENTS_AT_ONCE, stop)), points, weights)
            for a in range(start, stop, _ELEMENTS_AT_ONCE)
        ]
        i = np.repeat(rows[start:stop], wide, axis=1).ravel()
        j = np.tile(rows[start:stop], (1, wide)).ravel()
        values = np.concatenate([block.ravel() for block in blocks])
        total = total + sparse_matrix(values, i, j, (size, size))
    return total


def _element_stiffness(
    body: ElasticBody, chunk: NDArray[np.int64], points: NDArray[np.float64], weights: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the stiffness of some elements, shape (elements, functions * dim, functions * dim)."""
    lame = body.modulus * body.poisson / ((1.0 + body.poisson) * (1.0 - 2.0 * body.poisson))
    shear = 0.5 * body.modulus / (1.0 + body.poisson)
    inverse, volume = jacobians(body.mesh, chunk, points)
    _, reference = shapes(body.element, points)
    # (elements, functions, dim, q): d shape / d x_i = sum_k d shape / d X_k dX_k / dx_i.
    gradients: NDArray[np.float64] = np.einsum("akq,eqki->eaiq", reference, inverse, optimize=True)
    elements, functions, dim, _ = gradients.shape
    flat = gradients.reshape(elements, functions * dim, -1)
    weighted = flat * (volume * weights)[:, None, :]
    products = (weighted @ flat.transpose(0, 2, 1)).reshape(elements, functions, dim, functions, dim)
    matrix = lame * products + shear * products.transpose(0, 1, 4, 3, 2)
    trace = shear * np.einsum("eaibi->eab", products)
    for i in range(dim):
        matrix[:, :, i, :, i] += trace
    return matrix.reshape(elements, functions * dim, functions * dim)


def jacobians(
    mesh: FeMesh, chunk: NDArray[np.int64], points: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return inverse Jacobians (elements, q, dim, dim) as dX_k / dx_i, and their determinants (elements, q)."""
    _, reference = shapes(mesh.elem(), points)
    corners = np.asarray(mesh.doflocs)[:, np.asarray(mesh.dofs.element_dofs)[:, chunk]]
    jacobian: NDArray[np.float64] = np.einsum("iae,akq->eqik", corners, reference, optimize=True)
    volume: NDArray[np.float64] = np.asarray(np.linalg.det(jacobian), np.float64)
    # scikit-fem sorts the corners of tetrahedra, which turns half of them; a sign that changes inside one is wrong.
    sign = np.sign(volume[:, :1])
    wrong = np.nonzero(np.any(volume * sign <= 0.0, axis=1))[0]
    if len(wrong):
        raise FeError(f"mesh: {len(wrong)} elements are turned inside out, the first is element {int(chunk[wrong[0]])}")
    return np.asarray(np.linalg.inv(jacobian), np.float64), np.abs(volume)


def _admissible(body: ElasticBody, fixed: Supports) -> SparseMatrix:
    """Return the orthonormal basis of the displacements that the supports allow, sparse (dim * nodes, unknowns)."""
    nodes = body.nodes.shape[1]
    held: dict[int, list[NDArray[np.float64]]] = {}
    plain = np.zeros((nodes, body.dim), bool)
    for name, what in fixed.items():
        if isinstance(name, str):
            on = np.unique(np.asarray(body.dofs.get_facet_dofs(boundary_facets(body.mesh, name)).flatten()))
        elif 0 <= name < nodes:
            on = np.array([name])
        else:
            raise FeError(f"fixed: expected a node from 0 to {nodes - 1}, got {name}")
        directions = np.asarray(what)
        if directions.ndim == 1:
            plain[np.ix_(on, _components(name, directions, body.dim))] = True
            continue
        for node in on:
            held.setdefault(int(node), []).extend(np.asarray(directions, float))
    free = ~plain
    free[list(held)] = False
    node, component = np.nonzero(free)
    rows, columns = [body.dim * node + component], [np.arange(len(node))]
    values, count = [np.ones(len(node))], len(node)
    for number, directions in held.items():
        basis = _left_free(np.vstack([*directions, *np.eye(body.dim)[plain[number]]]))
        for vector in basis:
            rows.append(body.dim * number + np.arange(body.dim))
            columns.append(np.full(body.dim, count))
            values.append(vector)
            count += 1
    entries = (np.concatenate(values), np.concatenate(rows), np.concatenate(columns))
    return sparse_matrix(*entries, (body.dim * nodes, count))


def _components(name: str | int, components: NDArray[Any], dim: int) -> NDArray[np.int64]:
    """Return the held components of a boundary, checked."""
    if components.size and not (
        np.issubdtype(components.dtype, np.integer) and components.min() >= 0 and components.max() < dim
    ):
        raise FeError(f"fixed {name!r}: expected components from 0 to {dim - 1}, got {components.tolist()}")
    return components.astype(np.int64)


def _left_free(directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return an orthonormal basis (free, dim) of the directions that stay free."""
    _, sizes, basis = np.linalg.svd(directions)
    return basis[int(np.sum(sizes > 1e-8)) :]


def rigid_motions(nodes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rigid motions of nodes (dim, nodes), m: translations, then rotations, shape (dim * nodes, 3 or 6)."""
    dim, count = nodes.shape
    offset = nodes - nodes.mean(axis=1, keepdims=True)
    offset = offset / max(float(np.abs(offset).max()), 1e-300)
    planes = [(0, 1)] if dim == 2 else [(1, 2), (2, 0), (0, 1)]
    motions = np.zeros((count, dim, dim + len(planes)))
    for i in range(dim):
        motions[:, i, i] = 1.0
    for k, (i, j) in enumerate(planes):
        motions[:, i, dim + k], motions[:, j, dim + k] = -offset[j], offset[i]
    return motions.reshape(count * dim, -1)


def _refuse_rigid_motion(body: ElasticBody) -> None:
    """Raise where the supports leave a rigid motion: one whose held part is nothing."""
    motions = rigid_motions(body.nodes)
    motions /= np.linalg.norm(motions, axis=0)
    stopped = motions - body.admissible @ (body.admissible.T @ motions)
    _, sizes, kinds = np.linalg.svd(stopped.T @ stopped)
    if sizes[-1] > _HELD_SHARE:
        return
    names = ("x", "y", "turning") if body.dim == 2 else ("x", "y", "z", "about x", "about y", "about z")
    free = ", ".join(names[i] for i in np.nonzero(np.abs(kinds[-1]) > 0.3)[0])
    raise FeError(
        f"{body.name}: supports leave a rigid motion ({free}): hold boundaries so that it cannot move as a whole"
    )
