"""Order of elimination by nested dissection of the elements, and what a factorisation in that order will cost.

The elements are halved again and again; the nodes that both halves share are the separator and are eliminated after
all nodes within. Each cut is the best of several sweeps (George, SIAM J. Numerical Analysis 10 (1973) 345, with the
sweep cut of spectral partitioning): the elements are sorted along x, y, z and by their distance from an end of the
mesh, and cut near the middle where the fewest unknowns are shared. The tree of separators is the tree of fronts of a
multifrontal factorisation (``models.fe.solid.cholesky``), so that entries, operations and memory are known beforehand.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from models.fe.solid.sparse import breadth_first, sparse_matrix

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

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
class Plan:
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


def plan(table: NDArray[np.int64], nodes: NDArray[np.float64], node_of: NDArray[np.int64]) -> Plan:
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
    return Plan(order, tuple(fronts), *_cost(fronts))


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
