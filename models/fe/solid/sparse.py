# pyright: standard
"""Sparse matrices and triangular solves of scipy, which has no types here: imported late and typed once."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

SparseMatrix = Any


def sparse_matrix(
    values: NDArray[np.float64], rows: NDArray[Any], columns: NDArray[Any], shape: tuple[int, int]
) -> SparseMatrix:
    """Return the matrix (compressed columns) of triplets, those of one place added up."""
    from scipy.sparse import coo_matrix

    return cast("Any", coo_matrix)((values, (rows, columns)), shape=shape).tocsc()


def cholesky_solve(factor: NDArray[np.float64], right: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (L L')^-1 right of a lower triangular L, shape as ``right``."""
    from scipy.linalg import cho_solve

    return np.asarray(cast("Any", cho_solve)((factor, True), right, check_finite=False), np.float64)


def breadth_first(graph: SparseMatrix, start: int) -> NDArray[np.float64]:
    """Return the number of edges from one vertex to each; vertices out of reach count as one step beyond the last."""
    from scipy.sparse.csgraph import breadth_first_order

    order, parents = breadth_first_order(graph, start, directed=False)
    steps = np.full(graph.shape[0], np.inf)
    steps[start] = 0.0
    for vertex in order[1:]:
        steps[vertex] = steps[parents[vertex]] + 1.0
    return np.where(np.isfinite(steps), steps, steps[np.isfinite(steps)].max() + 1.0)


def non_negative(matrix: NDArray[np.float64], right: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return x >= 0 of the least |matrix x - right|; zeros where the method gives up, which no caller takes for it."""
    from scipy.optimize import nnls

    try:
        return np.asarray(cast("Any", nnls)(matrix, right, maxiter=30 * len(right))[0], np.float64)
    except RuntimeError:
        return np.zeros(matrix.shape[1])


def dense_cholesky(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the lower Cholesky factor of a matrix whose lower triangle is given.

    Raises:
        numpy.linalg.LinAlgError: if it is not positive definite.
    """
    factor, info = _lapack().dpotrf(matrix, lower=1, clean=1) if matrix.size else (matrix, 0)
    if info != 0:
        raise np.linalg.LinAlgError("not positive definite")
    return factor


def right_solve(factor: NDArray[np.float64], matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return matrix L^-T of a lower triangular L."""
    return _blas().dtrsm(1.0, factor, matrix, side=1, lower=1, trans_a=1) if matrix.size else np.array(matrix)


def rank_update(below: NDArray[np.float64], matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return matrix - below below' in the lower triangle; the upper one is left as it was."""
    return _blas().dsyrk(-1.0, below, beta=1.0, c=matrix, lower=1) if below.size else np.array(matrix)


def triangular_solve(
    factor: NDArray[np.float64], right: NDArray[np.float64], *, transposed: bool = False
) -> NDArray[np.float64]:
    """Return L^-1 right, or L^-T right, of a lower triangular L; right has shape (rows, cases)."""
    return _blas().dtrsm(1.0, factor, right, lower=1, trans_a=int(transposed))


def _blas() -> Any:
    """Return scipy's BLAS."""
    from scipy.linalg import blas

    return blas


def _lapack() -> Any:
    """Return scipy's LAPACK."""
    from scipy.linalg import lapack

    return lapack
