# pyright: standard
"""Least squares of dense complex matrices by normal equations, with typed access to LAPACK."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray


def gram(matrix: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return the Cholesky factor, of the conjugate, of A* A for A of shape (rows, columns), rows >= columns.

    Raises:
        numpy.linalg.LinAlgError: if the columns are not independent.
    """
    from scipy.linalg import blas, lapack

    # The transpose of a matrix by rows is one by columns, which needs no copy; it gives the conjugate.
    square = cast("Any", blas).zherk(1.0, np.ascontiguousarray(matrix).T, lower=1)
    factor, info = cast("Any", lapack).zpotrf(square, lower=1, overwrite_a=1)
    if info != 0:
        raise np.linalg.LinAlgError(f"the columns are not independent: pivot {info} is not positive")
    return factor


def solve_gram(factor: NDArray[np.complex128], right: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return (A* A)^-1 right from ``gram``; right has the shape (columns, cases)."""
    from scipy.linalg import cho_solve

    return np.conj(cast("Any", cho_solve)((factor, True), np.conj(right), check_finite=False))
