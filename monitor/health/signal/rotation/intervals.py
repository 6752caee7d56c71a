# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false, reportUnknownArgumentType=false
"""The elapsed times of a wheel from mark to mark: its speed at equal steps of angle.

The slow course of a quantity that is known at equal steps: a cubic spline through least squares.

Its knots stand one cell apart. A spline of equal cells takes up what varies over two cells and more, and leaves what
swings once a cell or faster: of a line with f cycles a cell it takes about sinc(f)^4, nothing at all at whole f.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.words.errors import SpallwatchError


@dataclass(frozen=True, eq=False)
class PulseTrain:
    """Times at which the marks of a turning wheel passed, each with the number of its mark.

    Attributes:
        times: shape (pulse,), s from the first sample of the block, rising; at least two.
        numbers: shape (pulse,), int64, rising: the marks are counted in the order in which they pass, also those whose
            pulse is missing, so that the wheel turns once in ``per_revolution``.
        per_revolution: places of marks on the wheel, those that are left empty for the index included.
        indexed: whether ``numbers`` are counted from the index of the wheel (an empty place, or a track of its own):
            then ``numbers % per_revolution`` is the same mark in each block.
    """

    times: NDArray[np.float64]
    numbers: NDArray[np.int64]
    per_revolution: int
    indexed: bool = False

    def __post_init__(self) -> None:
        """Raise ValueError where times and numbers do not fit together or do not rise."""
        if self.times.ndim != 1 or self.times.shape != self.numbers.shape or self.times.size < 2:
            shapes = f"{self.times.shape} and {self.numbers.shape}"
            raise ValueError(f"times and numbers of pulses must have one shape (pulse,) from 2 on, got {shapes}")
        if self.numbers.dtype.kind != "i":
            raise ValueError(f"numbers of pulses must be whole, got {self.numbers.dtype}")
        if not (np.all(np.diff(self.times) > 0.0) and np.all(np.diff(self.numbers) > 0)):
            raise ValueError("times and numbers of pulses must rise")
        if self.per_revolution < 1:
            raise ValueError(f"pulses a revolution must be 1 or more, got {self.per_revolution}")

    @property
    def turns(self) -> NDArray[np.float64]:
        """Revolutions of the wheel at each pulse, shape (pulse,), by marks at equal angles."""
        return self.numbers / self.per_revolution

    @property
    def turned(self) -> float:
        """Revolutions from the first pulse to the last."""
        return float(self.numbers[-1] - self.numbers[0]) / self.per_revolution


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
    weights = solved(bands, right, lower=True)
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


def solved(bands: NDArray[np.float64], right: NDArray[np.float64], *, lower: bool = False) -> NDArray[np.float64]:
    """Return the solution of a positive definite system, shape (row,).

    Its diagonal and the bands above it are the rows, the diagonal last; with ``lower``, it comes first.
    """
    from scipy.linalg import solveh_banded

    return np.asarray(solveh_banded(bands, right, lower=lower, check_finite=False))


def spline_slopes(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
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


def running_median(values: NDArray[np.float64], size: int, above: int = 0, stride: int = 1) -> NDArray[np.float64]:
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


CELL_TURNS = 4
"""Turns between two knots of the slow course of the speed."""
MIN_TURNS = 16
"""Turns of the wheel that are needed: multiples of the shaft are 16 bins of a spectrum apart then."""
MIN_MARKS = 2
"""Marks a turn that are needed: of one alone, nothing differs from turn to turn."""
_FAST_PRIMES = (2, 3, 5, 7, 11)


class TooFewPulsesError(SpallwatchError, ValueError):
    """Too few marks a turn, or too few turns."""


class UnevenPulsesError(SpallwatchError, ValueError):
    """Elapsed times that have no slow course, as where the shaft stands still in between."""


@dataclass(frozen=True, eq=False)
class Intervals:
    """Elapsed times at equal steps of angle, over whole turns of the wheel; arrays of shape (interval,).

    Attributes:
        first: number of the mark at which the first interval begins.
        elapsed: from mark to mark, s; where marks are missing, the time between their neighbours in equal parts.
        slow: slow course of ``elapsed``, s.
        per_revolution: intervals a turn of the wheel.
        filled: share of intervals beside a missing mark.
    """

    first: int
    elapsed: NDArray[np.float64]
    slow: NDArray[np.float64]
    per_revolution: int
    filled: float

    @property
    def longer(self) -> NDArray[np.float64]:
        """Elapsed time over its slow course, less 1."""
        return self.elapsed / self.slow - 1.0

    @property
    def turns(self) -> int:
        """Whole turns of the wheel."""
        return self.elapsed.size // self.per_revolution


def intervals(train: PulseTrain, error: NDArray[np.float64] | None = None) -> Intervals:
    """Return the elapsed times of a train over whole turns.

    Args:
        train: repaired pulses.
        error: shape (per_revolution,), revolutions by which each mark stands ahead of its place, by ``numbers %
            per_revolution``: what they are off is taken from the times.

    Raises:
        TooFewPulsesError: fewer than ``MIN_MARKS`` a turn or ``MIN_TURNS`` turns.
        UnevenPulsesError: one interval is so long that the slow course beside it falls below zero.
    """
    marks = train.per_revolution
    turns = _fast_turns(int(train.numbers[-1] - train.numbers[0]) // marks)
    if marks < MIN_MARKS or turns < MIN_TURNS:
        raise TooFewPulsesError(
            f"{MIN_MARKS} marks a turn and {MIN_TURNS} turns or more are needed, got {marks} marks over "
            f"{train.turned:.1f} turns"
        )
    first, count = int(train.numbers[0]), turns * marks
    elapsed, steps = np.diff(train.times), np.diff(train.numbers)
    filled = 0.0
    if train.numbers[-1] - first != steps.size:
        elapsed = (elapsed / steps).repeat(steps)
        filled = float(np.mean((steps > 1).repeat(steps)[:count]))
    elapsed = elapsed[:count]
    slow = slow_course(elapsed, CELL_TURNS * marks)
    if not slow.min() > 0.0:
        longest = float(elapsed.max() / np.median(elapsed))
        raise UnevenPulsesError(
            f"the longest time between two marks is {longest:.0f} times the median: no steady turning"
        )
    if error is not None:
        widths = marks * np.diff(error, append=error[:1])
        elapsed = elapsed - slow * np.tile(np.roll(widths, -(first % marks)), turns)
    return Intervals(first, elapsed, slow, marks, filled)


def _fast_turns(turns: int) -> int:
    """Return the largest number of turns up to this that a transform takes quickly."""
    for count in range(turns, 0, -1):
        rest = count
        for prime in _FAST_PRIMES:
            while rest % prime == 0:
                rest //= prime
        if rest == 1:
            return count
    return 0
