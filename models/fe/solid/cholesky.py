"""Multifrontal Cholesky factorisation of a stiffness in dense blocks, in nested dissection order of the elements.

The elements are halved again and again; the nodes that both halves share are the separator and are eliminated after
all nodes within. Each cut is the best of several sweeps (George, SIAM J. Numerical Analysis 10 (1973) 345, with the
sweep cut of spectral partitioning): the elements are sorted along x, y, z and by their distance from an end of the
mesh, and cut near the middle where the fewest unknowns are shared. The tree of separators is that of the fronts, whose
entries, operations and memory are known beforehand. Each front gathers its part of the matrix and the remainders of its
children, eliminates its own unknowns by dense BLAS and passes the rest on (Duff and Reid, ACM TOMS 9 (1983) 302).

Own work: scipy's SuperLU with minimum degree has a quarter more entries at 35,000 unknowns, takes several times as long
(benchmarks/fe/cost.py), and says its memory only when it is used.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from models.fe.solid.sparse import (
    SparseMatrix,
    breadth_first,
    dense_cholesky,
    rank_update,
    right_solve,
    sparse_matrix,
    triangular_solve,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

# A pivot that elimination has brought below this share of the matrix' own is rounding of zero.
_PIVOT = 1e-13
# Elements of a part that is not cut any further.
LEAF_ELEMENTS = 4
# A cut leaves at least this share of the elements on each side.
_SMALLER_SIDE = 0.4


@dataclass(frozen=True)
class Front:
    """One dense step of the factorisation, in the order of elimination.

    Attributes:
        start, stop: the unknowns start to stop - 1 are eliminated here.
        boundary: later unknowns that they are coupled to, increasing.
        children: numbers of the fronts whose remainders are added here.
    """

    start: int
    stop: int
    boundary: NDArray[np.int64]
    children: tuple[int, ...]


@dataclass(frozen=True)
class FactorPlan:
    """Order and fronts of a factorisation.

    Attributes:
        order: unknown of the matrix that is eliminated at each place, shape (unknowns,).
        fronts: children before their parents.
        entries: numbers that the factor stores.
        operations: floating point operations of the factorisation.
        peak_entries: numbers held at once at most while factorising, the factor among them.
    """

    order: NDArray[np.int64]
    fronts: tuple[Front, ...]
    entries: int
    operations: float
    peak_entries: int


@dataclass
class _Part:
    """A set of elements on the way through the tree, and the nodes that its separators own."""

    elements: NDArray[np.int64]
    own: NDArray[np.int64]
    children: tuple[int, ...]


def plan(table: NDArray[np.int64], nodes: NDArray[np.float64], node_of: NDArray[np.int64]) -> FactorPlan:
    """Return the plan of a matrix whose unknowns belong to nodes of elements.

    Args:
        table: nodes of each element, shape (functions, elements).
        nodes: locations, shape (dim, nodes).
        node_of: node of each unknown, shape (unknowns,).
    """
    free = np.bincount(node_of, minlength=nodes.shape[1])
    parts = _dissect(table, nodes, free)
    owner = np.zeros(nodes.shape[1], np.int64)
    for number, part in enumerate(parts):
        owner[part.own] = number
    # Unknowns by the front that eliminates them, then by node; ``first`` is where those of a node begin.
    order = np.lexsort((node_of, owner[node_of]))
    sequence = np.lexsort((np.arange(len(owner)), owner))
    first = np.empty(len(owner), np.int64)
    first[sequence] = np.cumsum(free[sequence]) - free[sequence]
    places = np.searchsorted(owner[node_of][order], np.arange(len(parts) + 1))
    fronts: list[Front] = []
    for number, part in enumerate(parts):
        touched = np.unique(table[:, part.elements])
        later = touched[owner[touched] > number]
        boundary = np.sort(np.repeat(first[later], free[later]) + _running(free[later]))
        fronts.append(Front(int(places[number]), int(places[number + 1]), boundary, part.children))
    return FactorPlan(order, tuple(fronts), *_cost(fronts))


def _running(counts: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return 0 .. count - 1 for each count, one after the other."""
    return np.arange(int(counts.sum())) - np.repeat(np.cumsum(counts) - counts, counts)


def _cost(fronts: list[Front]) -> tuple[int, float, int]:
    """Return stored entries, operations and the most entries held at once."""
    entries, operations, waiting, peak = 0, 0.0, 0, 0
    for front in fronts:
        k, m = front.stop - front.start, len(front.boundary)
        remainders = sum(len(fronts[child].boundary) ** 2 for child in front.children)
        peak = max(peak, entries + waiting + 2 * (k + m) ** 2)
        entries += k * (k + m)
        waiting += m * m - remainders
        operations += k**3 / 3.0 + k * k * m + float(k) * m * m
    return entries, operations, peak


def _dissect(table: NDArray[np.int64], nodes: NDArray[np.float64], free: NDArray[np.int64]) -> list[_Part]:
    """Return the parts of the tree, children first, each with the nodes that it eliminates."""
    centres = nodes[:, table].mean(axis=1)
    parts: list[_Part] = []
    taken = np.zeros(nodes.shape[1], bool)

    def descend(elements: NDArray[np.int64]) -> int:
        if len(elements) <= LEAF_ELEMENTS:
            touched = np.unique(table[:, elements])
            own = touched[~taken[touched]]
            taken[own] = True
            parts.append(_Part(elements, own, ()))
            return len(parts) - 1
        left, right = _cut(table, centres, free * ~taken, elements)
        shared = np.intersect1d(table[:, left], table[:, right])
        own = shared[~taken[shared]]
        taken[own] = True
        children = (descend(left), descend(right))
        parts.append(_Part(elements, own, children))
        return len(parts) - 1

    descend(np.arange(table.shape[1], dtype=np.int64))
    return parts


def _cut(
    table: NDArray[np.int64], centres: NDArray[np.float64], weight: NDArray[np.int64], elements: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return two parts of the elements that share few free unknowns."""
    local_nodes, local = np.unique(table[:, elements], return_inverse=True)
    local = local.reshape(len(table), len(elements))
    weights = weight[local_nodes].astype(float)
    orders = [np.argsort(keys, kind="stable") for keys in _sweeps(local, centres[:, elements], len(local_nodes))]
    cuts = [_best_cut(local[:, order], weights) for order in orders]
    best = int(np.argmin([shared for shared, _ in cuts]))
    order, cut = orders[best], cuts[best][1]
    return elements[order[:cut]], elements[order[cut:]]


def _best_cut(local: NDArray[np.int64], weights: NDArray[np.float64]) -> tuple[float, int]:
    """Return the fewest unknowns shared by a head and a tail of sorted elements, and the length of the head."""
    functions, count = local.shape
    place = np.tile(np.arange(count, dtype=np.int64), (functions, 1))
    first, last = np.full(len(weights), count), np.zeros(len(weights), np.int64)
    np.minimum.at(first, local.ravel(), place.ravel())
    np.maximum.at(last, local.ravel(), place.ravel())
    # A node is shared by cuts first + 1 .. last.
    change = np.bincount(first + 1, weights, count + 2) - np.bincount(last + 1, weights, count + 2)
    shared = np.cumsum(change)[: count + 1]
    low = max(1, int(np.ceil(_SMALLER_SIDE * count)))
    high = max(low, count - low)
    cut = low + int(np.argmin(shared[low : high + 1]))
    return float(shared[cut]), cut


def _sweeps(local: NDArray[np.int64], centres: NDArray[np.float64], nodes: int) -> Iterator[NDArray[np.float64]]:
    """Yield numbers by which to sort the elements: places, and steps from one end and from the other."""
    yield from centres
    functions, count = local.shape
    columns = np.tile(np.arange(count, dtype=np.int64), (functions, 1)).ravel()
    incidence = sparse_matrix(np.ones(local.size), local.ravel(), columns, (nodes, count))
    graph = (incidence.T @ incidence).tocsr()
    far = int(np.argmax(breadth_first(graph, 0)))
    steps = breadth_first(graph, far)
    yield steps
    other = breadth_first(graph, int(np.argmax(steps)))
    yield steps - other


class Cholesky:
    """Factor L of P K P' = L L', stored as dense blocks.

    Args:
        matrix: symmetric positive definite, sparse (unknowns, unknowns).
        plan: order and fronts of its pattern.

    Raises:
        numpy.linalg.LinAlgError: if the matrix is not positive definite, up to rounding.
    """

    def __init__(self, matrix: SparseMatrix, plan: FactorPlan) -> None:
        """Factorise."""
        self.plan = plan
        ordered = matrix[plan.order][:, plan.order].tocsc()
        pivots = np.asarray(ordered.diagonal())
        self._diagonal: list[NDArray[np.float64]] = []
        self._below: list[NDArray[np.float64]] = []
        waiting: dict[int, NDArray[np.float64]] = {}
        for number, front in enumerate(plan.fronts):
            dense = _gather(ordered, front)
            for child in front.children:
                _extend(dense, front, waiting.pop(child), plan.fronts[child])
            own = front.stop - front.start
            diagonal = dense_cholesky(dense[:own, :own])
            if np.any(np.diag(diagonal) ** 2 < _PIVOT * pivots[front.start : front.stop]):
                raise np.linalg.LinAlgError("not positive definite")
            below = right_solve(diagonal, dense[own:, :own])
            self._diagonal.append(diagonal)
            self._below.append(below)
            waiting[number] = rank_update(below, dense[own:, own:])

    @property
    def entries(self) -> int:
        """Numbers stored, 8 bytes each."""
        return sum(block.size for block in (*self._diagonal, *self._below))

    def forward(self, right: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return L^-1 P right, shape (unknowns, cases): the scalar product of two columns is right' K^-1 right."""
        x = np.asfortranarray(right[self.plan.order])
        for front, diagonal, below in zip(self.plan.fronts, self._diagonal, self._below, strict=True):
            part = x[front.start : front.stop]
            if not len(part) or not np.any(part):
                continue
            part = triangular_solve(diagonal, part)
            x[front.start : front.stop] = part
            if len(front.boundary):
                x[front.boundary] -= below @ part
        return x

    def solve(self, right: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return K^-1 right, shape (unknowns, cases)."""
        x = self.forward(right)
        blocks = zip(reversed(self.plan.fronts), reversed(self._diagonal), reversed(self._below), strict=True)
        for front, diagonal, below in blocks:
            part = x[front.start : front.stop]
            if not len(part):
                continue
            if len(front.boundary):
                part = part - below.T @ x[front.boundary]
            x[front.start : front.stop] = triangular_solve(diagonal, part, transposed=True)
        solution = np.empty_like(x)
        solution[self.plan.order] = x
        return solution


def _gather(ordered: SparseMatrix, front: Front) -> NDArray[np.float64]:
    """Return the dense front with the matrix' own entries in its lower triangle."""
    own = front.stop - front.start
    size = own + len(front.boundary)
    dense = np.zeros((size, size), order="F")
    begin, end = int(ordered.indptr[front.start]), int(ordered.indptr[front.stop])
    rows = np.asarray(ordered.indices[begin:end], np.int64)
    columns = np.repeat(np.arange(own), np.diff(ordered.indptr[front.start : front.stop + 1]))
    keep = rows >= front.start
    rows, columns, values = rows[keep], columns[keep], np.asarray(ordered.data[begin:end])[keep]
    dense[_local(front, rows), columns] = values
    return dense


def _local(front: Front, rows: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the places within a front of unknowns that it has."""
    own = front.stop - front.start
    return np.where(rows < front.stop, rows - front.start, own + np.searchsorted(front.boundary, rows))


def _extend(dense: NDArray[np.float64], front: Front, remainder: NDArray[np.float64], child: Front) -> None:
    """Add the lower triangle of the remainder of a child to a front, a run of neighbouring columns at a time."""
    places = _local(front, child.boundary)
    if not len(places):
        return
    breaks = np.flatnonzero(np.diff(places) != 1) + 1
    for begin, end in zip((0, *breaks), (*breaks, len(places)), strict=True):
        # Both are stored by columns: their transposes are read and written along them.
        columns = dense.T[places[begin] : places[begin] + end - begin]
        columns[:, places[begin:]] += remainder.T[begin:end, begin:]
