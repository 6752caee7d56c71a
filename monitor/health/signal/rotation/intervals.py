"""The elapsed times of a wheel from mark to mark: its speed at equal steps of angle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.words.errors import SpallwatchError
from monitor.health.signal.rotation.slow import slow_course
from monitor.health.signal.rotation.train import PulseTrain

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
