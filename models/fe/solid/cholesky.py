"""Multifrontal Cholesky factorisation of a stiffness in dense blocks (Duff and Reid, ACM TOMS 9 (1983) 302).

Each front of a plan gathers its part of the matrix and the remainders of its children, eliminates its own unknowns by
dense BLAS and passes the rest on. SuperLU with minimum degree has a quarter more entries at 35,000 unknowns and takes
several times as long (benchmarks/fe/cost.py).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from models.fe.solid.sparse import SparseMatrix, dense_cholesky, rank_update, right_solve, triangular_solve

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.fe.solid.dissection import Front, Plan

# A pivot that elimination has brought below this share of the matrix' own is rounding of zero.
_PIVOT = 1e-13


class Cholesky:
    """Factor L of P K P' = L L', stored as dense blocks.

    Args:
        matrix: symmetric positive definite, sparse (unknowns, unknowns).
        plan: order and fronts of its pattern.

    Raises:
        numpy.linalg.LinAlgError: if the matrix is not positive definite, up to rounding.
    """

    def __init__(self, matrix: SparseMatrix, plan: Plan) -> None:
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
