# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false, reportUnknownArgumentType=false
"""The slow course of a quantity that is known at equal steps: a cubic spline through least squares.

Its knots stand one cell apart. A spline of equal cells takes up what varies over two cells and more, and leaves what
swings once a cell or faster: of a line with f cycles a cell it takes about sinc(f)^4, nothing at all at whole f.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_PIECES = 4
"""Cubic pieces of a basis function, and basis functions over a cell."""


def slow_course(values: NDArray[np.float64], cell: int) -> NDArray[np.float64]:
    """Return the slow course of values at equal steps.

    Args:
        values: shape (step,).
        cell: steps of a cell, at least; cells become longer where the last one would be less than half full.

    Returns:
        Shape (step,), in the unit of the values; their least-squares polynomial of third order where they are less than
        one cell.

    Raises:
        ValueError: fewer than four values, or a cell of less than four steps.
    """
    if values.ndim != 1 or values.size < _PIECES or cell < _PIECES:
        raise ValueError(
            f"expected values of shape (step,) from 4 on and cells of 4 steps or more, got shape {values.shape} and "
            f"cells of {cell}"
        )
    cells, steps = _division(values.size, cell)
    basis = _basis(steps)
    padded = np.zeros(cells * steps)
    padded[: values.size] = values
    # No matrix products: BLAS would start threads, which take longer than the sums.
    moments = np.einsum("cs,ks->ck", padded.reshape(cells, steps), basis)
    last = basis[:, : values.size - (cells - 1) * steps]
    size = cells + _PIECES - 1
    right, bands = np.zeros(size), np.zeros((_PIECES, size))
    for first in range(_PIECES):
        right[first : first + cells] += moments[:, first]
        for second in range(first, _PIECES):
            products = np.full(cells, np.sum(basis[first] * basis[second]))
            products[-1] = np.sum(last[first] * last[second])
            bands[second - first, first : first + cells] += products
    weights = _solved(bands, right)
    over = np.lib.stride_tricks.sliding_window_view(weights, _PIECES)
    return np.einsum("ck,ks->cs", over, basis).reshape(-1)[: values.size]


def _division(size: int, cell: int) -> tuple[int, int]:
    """Return how many cells of how many steps cover so many values, the last one at least half full."""
    for cells in range(max(1, size // cell), 1, -1):
        steps = -(-size // cells)
        if size - (cells - 1) * steps >= 0.5 * steps:
            return cells, steps
    return 1, size


def _basis(steps: int) -> NDArray[np.float64]:
    """Return the four cubic B-splines over a cell at the middles of its steps, shape (4, steps)."""
    u = (np.arange(steps) + 0.5) / steps
    v = 1.0 - u
    return np.stack([v**3, 3.0 * u**3 - 6.0 * u**2 + 4.0, 3.0 * v**3 - 6.0 * v**2 + 4.0, u**3]) / 6.0


def _solved(bands: NDArray[np.float64], right: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the solution of a banded positive definite system, its lower bands in rows."""
    from scipy.linalg import solveh_banded

    return np.asarray(solveh_banded(bands, right, lower=True, check_finite=False))
