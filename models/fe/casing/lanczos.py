"""Lowest eigenpairs of K x = w M x by block Lanczos on K^-1 M with full reorthogonalisation.

(Grimes, Lewis and Simon, SIAM J. Matrix Analysis 15 (1994) 228, without shifts: K is factorised once.) A block costs
little more to solve for than a few single vectors, and modes of one frequency are found together.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from models.fe.solid.elastic import NotConvergedError

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from models.fe.solid.sparse import SparseMatrix

    Array = NDArray[np.float64]

_BLOCK = 12
# An eigenvalue of the inverse is known when its remainder is less than this share of it.
_CONVERGED = 1e-9
# Of the length of a block's vectors: what is left below it is rounding.
_DEPENDENT = 1e-12


def lowest_eigenpairs(
    mass: SparseMatrix,
    solve: Callable[[Array], Array],
    enough: Callable[[Array], bool],
    most: int,
) -> tuple[Array, Array]:
    """Return the least eigenvalues, ascending, and their vectors (unknowns, values) with x' M x = 1.

    The start is the same each time, so is the result.

    Args:
        solve: K^-1 times columns.
        enough: whether the eigenvalues found, ascending and without a gap, suffice.
        most: largest number of vectors of the basis.

    Raises:
        NotConvergedError: the basis is full before there are enough.
    """
    size = int(mass.shape[0])
    start = np.random.default_rng(0).standard_normal((size, min(_BLOCK, size)))
    start = solve(np.asarray(mass @ start, np.float64))
    block, _ = _orthonormal(start, mass, _squares(start, mass))
    basis, weighted = block, np.asarray(mass @ block, np.float64)
    projected = np.zeros((0, 0))
    while True:
        first = basis.shape[1] - block.shape[1]
        image = solve(weighted[:, first:])
        columns = weighted.T @ image
        projected = _bordered(projected, columns)
        scale = _squares(image, mass)
        # Twice is enough (Giraud, Langou and Rozloznik 2005).
        for _ in range(2):
            image -= basis @ (weighted.T @ image)
        block, coupling = _orthonormal(image, mass, scale)
        theta, parts = np.linalg.eigh(projected)
        theta, parts = theta[::-1], parts[:, ::-1]
        remainder = np.linalg.norm(coupling @ parts[first:], axis=0)
        known = int(np.argmin(np.append(remainder <= _CONVERGED * theta, False)))
        whole = block.shape[1] == 0
        if enough(1.0 / theta[:known]) or whole:
            return 1.0 / theta[:known], basis @ parts[:, :known]
        if basis.shape[1] + block.shape[1] > most:
            raise NotConvergedError(f"the casing: {known} modes found with {basis.shape[1]} vectors, more are needed")
        basis = np.concatenate((basis, block), axis=1)
        weighted = np.concatenate((weighted, np.asarray(mass @ block, np.float64)), axis=1)


def _bordered(matrix: Array, columns: Array) -> Array:
    """Return a symmetric matrix grown by its last columns."""
    grown = np.zeros((len(columns), len(columns)))
    before = len(matrix)
    grown[:before, :before] = matrix
    grown[:, before:] = columns
    grown[before:] = columns.T
    corner = columns[before:]
    grown[before:, before:] = 0.5 * (corner + corner.T)
    return grown


def _orthonormal(block: Array, mass: SparseMatrix, scale: Array) -> tuple[Array, Array]:
    """Return Q and R of block = Q R with Q' M Q = 1; columns that depend on others are left out of Q.

    ``scale``: squared lengths that the columns had before the basis was taken from them.
    """
    lengths = np.sqrt(_squares(block, mass))
    kept = lengths > _DEPENDENT * np.sqrt(scale)
    found: Array = block[:, kept] / lengths[kept]
    right: Array = np.diag(lengths)[kept]
    for _ in range(2):
        if not found.shape[1]:
            break
        values, vectors = np.linalg.eigh(found.T @ np.asarray(mass @ found, np.float64))
        good = values > _DEPENDENT * values[-1]
        root = np.sqrt(values[good])
        found, right = found @ (vectors[:, good] / root), (root[:, None] * vectors[:, good].T) @ right
    return found, right


def _squares(block: Array, mass: SparseMatrix) -> Array:
    """Return x' M x of columns."""
    return np.asarray(np.einsum("ij,ij->j", block, np.asarray(mass @ block, np.float64)), np.float64)
