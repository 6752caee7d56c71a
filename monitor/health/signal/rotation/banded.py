# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false, reportUnknownArgumentType=false
"""Banded systems of equations, and what they are solved for: the slopes of a cubic spline; running medians."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def solved(bands: FloatArray, right: FloatArray) -> FloatArray:
    """Return the solution of a positive definite system, shape (row,), its diagonal and the bands above in rows."""
    from scipy.linalg import solveh_banded

    return np.asarray(solveh_banded(bands, right, check_finite=False))


def spline_slopes(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return the slopes of the cubic spline through points, shape (point,); at least four.

    The second and the last but one point are not knots (de Boor, A Practical Guide to Splines, chapter IV).
    """
    from scipy.linalg import solve_banded

    step, chord = np.diff(x), np.diff(y) / np.diff(x)
    bands, right = np.zeros((3, x.size)), np.zeros(x.size)
    bands[0, 2:], bands[1, 1:-1], bands[2, :-2] = step[:-1], 2.0 * (step[:-1] + step[1:]), step[1:]
    right[1:-1] = 3.0 * (step[1:] * chord[:-1] + step[:-1] * chord[1:])
    both = step[0] + step[1]
    bands[1, 0], bands[0, 1] = step[1], both
    right[0] = ((step[0] + 2.0 * both) * step[1] * chord[0] + step[0] ** 2 * chord[1]) / both
    both = step[-1] + step[-2]
    bands[1, -1], bands[2, -2] = step[-2], both
    right[-1] = ((step[-1] + 2.0 * both) * step[-2] * chord[-1] + step[-1] ** 2 * chord[-2]) / both
    return np.asarray(solve_banded((1, 1), bands, right, check_finite=False))


def running_median(values: FloatArray, size: int, above: int = 0, stride: int = 1) -> FloatArray:
    """Return the median of each value and its neighbours, shape (value,); beyond the ends they are mirrored.

    Args:
        size: values that are compared, odd, at most as many as there are.
        above: take the value so many ranks above the median.
        stride: take it at every so many values only, and straight lines between.
    """
    if size < 2:
        return values.copy()
    half = size // 2
    padded = np.concatenate((values[:half][::-1], values, values[values.size - half :][::-1]))
    windows = np.lib.stride_tricks.sliding_window_view(padded, size)[::stride]
    found = np.partition(windows, half + above, axis=1)[:, half + above]
    return found if stride == 1 else np.interp(np.arange(values.size), np.arange(0, values.size, stride), found)
