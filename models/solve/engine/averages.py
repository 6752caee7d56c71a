"""Levels and lines of a signal by blocks, and how far the mean of so many may be from that of all time.

A block is the slowest of the periods with which the level swings. Where a motion does not repeat, the mean squares of
its blocks are a series that may be correlated, and ``mean_error`` tells the error of their mean.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray


# Batches, as many as half the values within these limits.
_BATCHES = (4, 12)
# More alike neighbours are not told from a level that drifts.
_MOST_ALIKE = 0.8
# Bound of an error over the standard error, 95 %, and what few batches add to it: more than by Student's t, since a run
# ends where its own error happens to be small.
_NORMAL, _FEW = 2.0, 2.0
# The same of what the broken swing at the ends of a series leaves.
_BROKEN = 1.5
# Cells of a signal whose lines are sought, where beside a line noise is told, in turns over the length, and bound of an
# error over that noise; what a line there leaves in this one at most; median of a power of noise over its mean.
_CELLS, _BESIDE, _SURE = 128, np.array([-6, -5, -4, -3, -2, 2, 3, 4, 5, 6]), 2.0
_LEFT_BY = np.array([0.002, 0.004, 0.009, 0.03, 1.0, 1.0, 0.03, 0.009, 0.004, 0.002])
_MEDIAN = math.log(2.0)
# A smaller spread of the RMS from ball period to ball period is due to the steps.
_SAME_PERIOD = 2e-2


class MeanError(NamedTuple):
    """How well a mean is known.

    Attributes:
        standard: its standard error, in the unit of the values.
        bound: what the error stays within in 95 % of cases.
    """

    standard: float
    bound: float


def mean_error(values: NDArray[np.float64]) -> MeanError:
    """Return the error of the mean of a stationary series, at least four values, that may be correlated.

    The variance of the mean is the power of the series at frequency zero over its length. It is that of batches, which
    are the whole series weighted by sines (Riedel and Sidorenko 1995): a regular swing leaves nothing in them, as it
    does in the mean of a long series; what its broken end leaves there shows by a mean with a smooth window. Likeness
    of neighbours is taken out of the series before, as of an AR(1) process, and put into the power again; the
    autocorrelation of a few values is too low by about (1 + 3 r) / n (Kendall 1954).
    """
    count = len(values)
    off = values - np.mean(values)
    square = float(off @ off)
    if not square > 0.0:
        return MeanError(0.0, 0.0)
    alike = float(off[1:] @ off[:-1]) / square
    alike = min(max(alike + (1.0 + 3.0 * alike) / count, 0.0), _MOST_ALIKE)
    rest = off[1:] - alike * off[:-1]
    batches = min(max(_BATCHES[0], count // 2), _BATCHES[1], count - 2)
    # Without the first, of which hardly anything is left by the mean.
    order, at = np.arange(2, 2 + batches), np.arange(1, count) / count
    sines = math.sqrt(2.0 / count) * np.sin(math.pi * np.outer(order, at))
    power: NDArray[np.float64] = (sines @ rest) ** 2 / (1.0 - np.sum(sines, axis=1) ** 2 / (count - 1))
    standard = math.sqrt(float(np.mean(power)) / count) / (1.0 - alike)
    window = np.hanning(count + 2)[1:-1]
    broken = abs(float(window @ off)) / float(np.sum(window))
    widened = _NORMAL * (1.0 + _FEW / max(batches - 1, 1)) * standard
    return MeanError(standard, math.hypot(widened, _BROKEN * broken))


@dataclass(frozen=True)
class MeanLevels:
    """The level of one signal.

    Attributes:
        rms: root of the mean square over all whole blocks, m/s2.
        error: its standard error, m/s2.
        bound: what its relative error stays within in 95 % of cases.
        scatter: the relative standard error of as many independent blocks.
        spread: standard deviation of the RMS from block to block, m/s2.
        drift: change of the RMS from the first to the second half, m/s2.
        peak_spread: standard deviation of the largest value from block to block, m/s2.
    """

    rms: float
    error: float
    bound: float
    scatter: float
    spread: float
    drift: float
    peak_spread: float

    def same(self, *, repeats: bool) -> bool:
        """Return whether a motion that may repeat, as ``repeats`` says, does."""
        return repeats and self.spread <= _SAME_PERIOD * self.rms

    def averaging(self, *, repeats: bool) -> float:
        """Return the relative error of the RMS due to the length; periods of a motion that repeats are no sample."""
        return self.scatter if self.same(repeats=repeats) else self.bound


def levels_of(signal: NDArray[np.float64], blocks: float) -> MeanLevels:
    """Return the levels over ``blocks`` blocks; the last, broken one is left out, because it would bias the mean."""
    count = math.floor(blocks + 1e-9)
    energy = np.concatenate(([0.0], np.cumsum(signal**2)))
    edges = np.arange(count + 1) * (len(signal) / blocks)
    means = np.maximum(np.diff(np.interp(edges, np.arange(len(energy)), energy)) / (len(signal) / blocks), 0.0)
    power, half = float(np.mean(means)), count // 2
    rms = math.sqrt(power)
    drift = abs(math.sqrt(np.mean(means[-half:])) - math.sqrt(np.mean(means[:half])))
    first = np.unique(np.minimum(edges[:-1].astype(np.int64), len(signal) - 1))
    peaks = np.maximum.reduceat(np.abs(signal), first)
    spread, peak_spread = float(np.std(np.sqrt(means), ddof=1)), float(np.std(peaks))
    if not 0.0 < power < math.inf:
        return MeanLevels(rms, 0.0, 0.0, 0.0, spread, drift, peak_spread)
    # The relative error of a level is half that of its square.
    known, scatter = mean_error(means / power), float(np.std(means, ddof=1)) / math.sqrt(count) / power
    return MeanLevels(rms, 0.5 * known.standard * rms, 0.5 * known.bound, 0.5 * scatter, spread, drift, peak_spread)


def amplitudes_at(signal: NDArray[np.float64], turn: float, count: int) -> NDArray[np.float64]:
    """Return the amplitudes of lines and what their errors stay within in 95 % of cases, in the unit of the signal.

    Through a Hann window, in which a line is zero from two over the length away from its frequency on: what is there is
    noise, as in the line itself, or another line, which leaves little here.

    Args:
        turn: frequency over the sampling rate, whose multiples 1..count the lines are.

    Returns:
        Amplitudes and errors, (2, count); NaN of a signal of fewer values than cells.
    """
    length = len(signal) // _CELLS
    if length == 0:
        return np.full((2, count), math.nan)
    cut = signal[: length * _CELLS].reshape(_CELLS, length)
    within = np.exp(-2j * np.pi * np.mod(turn * np.arange(length), 1.0))
    between = np.exp(-2j * np.pi * np.mod(turn * length * np.arange(_CELLS), 1.0))
    power, found = np.ones_like(within), np.empty((2, count))
    for k in range(count):
        power = power * within
        # Sums over cells tell frequencies that are a few over the length away.
        plain = np.fft.fft((cut @ power) * between ** (k + 1)) * (2.0 / (length * _CELLS))
        windowed = np.abs(plain - 0.5 * (np.roll(plain, 1) + np.roll(plain, -1)))
        beside = windowed[_BESIDE]
        noise = _SURE * math.sqrt(float(np.median(beside * beside)) / _MEDIAN)
        found[:, k] = windowed[0], noise + float(np.max(_LEFT_BY * beside))
    return found
