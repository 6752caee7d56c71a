"""Kernels of the errors of what a settled motion shows: RMS, peak, waveform and lines of the casing, one for each."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from models.platform.jit import kernel
from models.solve.six_dof.kernels.orbit import SILENCE

if TYPE_CHECKING:
    from numpy.typing import NDArray

# What is measured on each grid of steps: RMS in the band, largest value, RMS of the waveform; the amplitudes of lines
# follow. Also what an accuracy is asked for.
Q_RMS, Q_PEAK, Q_WAVE, Q_LINES = 0, 1, 2, 3

# Error of a quantity over its change and over that of the waveform by the last halving, where only one is known:
# benchmarks/engine/families.py measures how often the larger of both bounds it.
_OF_CHANGE = 0.7
_OF_WAVE = 0.25
# Error over the difference to a second opinion, and over both changes where there is one.
_OF_OTHER = 4.0
_CHECKED_CHANGE = 0.5
_CHECKED_WAVE = 0.2
# Of the relative error of the waveform: that of the peak, and that of a line over what Parseval's theorem allows.
_SHARE_OF_PEAK = 1.0
_SHARE_OF_LINE = 0.3
# A larger error than this means that a grid is too coarse for any statement, on itself or on the next.
_TELLING = 0.05


class GridLevels(NamedTuple):
    """What grids of steps show of a motion, by the Q_ constants, m/s2, (Q_LINES + lines,) each.

    Attributes:
        now, coarse: on the last grid, and on the one before with half its steps.
        other: on the grid of a second opinion.
        halved: errors of ``now`` as halving tells them, without what is left to settle; NaN where unknown.
        errors: of ``now``.
    """

    now: NDArray[np.float64]
    coarse: NDArray[np.float64]
    other: NDArray[np.float64]
    halved: NDArray[np.float64]
    errors: NDArray[np.float64]


@kernel
def blank_levels(lines: int) -> GridLevels:
    """Return room for so many lines."""
    room = np.zeros((5, Q_LINES + lines))
    room[3:] = math.nan
    return GridLevels(room[0], room[1], room[2], room[3], room[4])


@kernel
def relative(error: float, size: float) -> float:
    """Return an error over the size of what it is of, zero where that is silent."""
    return error / size if size > SILENCE else 0.0


@kernel
def _left(wave: float, wave_before: float) -> float:
    """Return what the last halving, by which the waveform changed by ``wave``, leaves of its error.

    ``wave_before``: by the halving before, NaN where there was none.
    """
    if not math.isfinite(wave_before):
        return wave
    ratio = min(max(wave / wave_before, 0.0625), 0.9) if wave_before > 0.0 else 0.0625
    return wave * ratio / (1.0 - ratio)


@kernel
def error_estimate(delta: float, wave: float, wave_before: float, before: float) -> float:
    """Return an estimate of the relative error of a quantity on a grid.

    From the relative changes of quantity and waveform by the last halving of the steps, the change of the waveform by
    the halving before and the estimate then (NaN where there was none). Steps of fourth order would leave a fifteenth
    of ``wave``; where balls meet kinks or open contacts the order is lower, which two halvings show, and a change may
    be small by chance: so no estimate falls by more than a factor of four. The hard tests of the engine count how often
    it bounds the error.
    """
    found = max(_OF_CHANGE * abs(delta), _OF_WAVE * wave)
    if not math.isfinite(before):
        return found
    return max(found, abs(delta), min(before, _TELLING) / 4.0, _left(wave, wave_before))


@kernel
def line_unit(values: NDArray[np.float64]) -> float:
    """Return what errors of lines are relative to, m/s2: a wave whose RMS is one has lines of the root of two at most
    (Parseval).
    """
    return math.sqrt(2.0) * values[Q_WAVE]


@kernel
def _unit(values: NDArray[np.float64], q: int) -> tuple[float, float]:
    """Return what the error of a quantity is relative to, m/s2, and its share of that of the waveform."""
    if q >= Q_LINES:
        return line_unit(values), _SHARE_OF_LINE
    return values[q], _SHARE_OF_PEAK if q == Q_PEAK else 1.0


@kernel
def judge(levels: GridLevels, wave: float, wave_before: float, change: float) -> None:
    """Write the errors of all quantities on a grid as halving the steps tells them.

    ``wave``, ``wave_before``: as in ``error_estimate``; ``change``: of the waveform by what is left to settle.
    """
    now, coarse, halved = levels.now, levels.coarse, levels.halved
    for q in range(now.shape[0]):
        unit, share = _unit(now, q)
        if unit <= SILENCE:
            halved[q] = 0.0
        elif q == Q_WAVE:
            least = min(halved[q] / unit, _TELLING) / 4.0 if math.isfinite(halved[q]) else 0.0
            halved[q] = unit * max(least, _left(wave, wave_before))
        else:
            delta = (now[q] - coarse[q]) / unit
            halved[q] = unit * error_estimate(delta, share * wave, share * wave_before, halved[q] / unit)
        levels.errors[q] = halved[q] + share * change * unit


@kernel
def judge_again(levels: GridLevels, wave: float, change: float) -> None:
    """Write the errors of all quantities on a grid of which there is a second opinion.

    What both differ by is about the error of the coarser one. It shares nothing with the change by halving, so that
    both are rarely small by chance. A waveform has the error of its RMS and its lines at least. Where more is left than
    halving told, the next grid begins with it. Arguments: as in ``judge``.
    """
    now, halved, errors, least = levels.now, levels.halved, levels.errors, levels.halved[Q_WAVE]
    for q in range(now.shape[0]):
        unit, share = _unit(now, q)
        apart = _OF_OTHER * abs(now[q] - levels.other[q])
        if q != Q_PEAK:
            least = max(least, apart / math.sqrt(2.0) if q >= Q_LINES else apart)
        errors[q] = max(apart, _CHECKED_CHANGE * abs(now[q] - levels.coarse[q]), _CHECKED_WAVE * share * wave * unit)
    errors[Q_WAVE] = least
    for q in range(now.shape[0]):
        unit, share = _unit(now, q)
        halved[q] = max(halved[q], errors[q])
        errors[q] += share * change * unit


@kernel
def largest_line(values: NDArray[np.float64]) -> float:
    """Return the largest entry of those of lines."""
    found = 0.0
    for q in range(Q_LINES, values.shape[0]):
        found = max(found, values[q])
    return found


@kernel
def asked_error(levels: GridLevels, quantity: int) -> float:
    """Return the relative error of the quantity that is asked for; of lines the largest over the largest line."""
    if quantity == Q_LINES:
        return relative(largest_line(levels.errors), largest_line(levels.now))
    return relative(levels.errors[quantity], levels.now[quantity])
