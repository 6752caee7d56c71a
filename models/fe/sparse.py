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


def sparse_lu(matrix: SparseMatrix) -> Any:
    """Return the factors of a symmetric definite matrix: ``solve``, ``L``, ``U`` of SuperLU without pivoting."""
    from scipy.sparse.linalg import splu

    options = {"SymmetricMode": True}
    return cast("Any", splu)(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)


def lower_solve(factor: NDArray[np.float64], right: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return L^-1 right of a lower triangular L, shape as ``right``."""
    from scipy.linalg import solve_triangular

    return np.asarray(cast("Any", solve_triangular)(factor, right, lower=True, check_finite=False), np.float64)


def cholesky_solve(factor: NDArray[np.float64], right: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (L L')^-1 right of a lower triangular L, shape as ``right``."""
    from scipy.linalg import cho_solve

    return np.asarray(cast("Any", cho_solve)((factor, True), right, check_finite=False), np.float64)
