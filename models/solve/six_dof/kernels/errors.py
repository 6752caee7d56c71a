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
# follow, and after them real and imaginary part of each. Also what an accuracy is asked for.
Q_RMS, Q_PEAK, Q_WAVE, Q_LINES = 0, 1, 2, 3

# Error of a quantity over its change and over that of the waveform by the last halving, where only one is known:
# benchmarks/engine/families.py measures how often the larger of both bounds it.
_OF_CHANGE = 0.7
_OF_WAVE = 0.25
# Where there is a second opinion: error over the difference to it, over the change by the last halving, and over that
# of the waveform; of RMS, peak and lines.
_CHECKED_RMS = (3.0, 0.4, 0.15)
_CHECKED_PEAK = (3.0, 0.4, 0.1)
_CHECKED_LINE = (2.0, 0.25, 0.002)
# Of the relative change of the waveform: that of a line over what Parseval's theorem allows, by steps that are halved
# and by what is left to settle. Steps change high frequencies first, which lie beyond the first lines.
_SHARE_OF_LINE = 0.02
_SETTLING_OF_LINE = 0.3
# A larger error than this means that a grid is too coarse for any statement, on itself or on the next.
_TELLING = 0.05


class GridLevels(NamedTuple):
    """What grids of steps show of a motion, by the Q_ constants, m/s2, (Q_LINES + 3 lines,) each.

    Attributes:
        now, coarse: on the last grid, and on the one before with half its steps.
        other: on the grid of a second opinion.
        halved: errors of ``now`` as halving tells them, without what is left to settle; NaN where unknown.
        errors: of ``now``; of the parts of lines there are none.
    """

    now: NDArray[np.float64]
    coarse: NDArray[np.float64]
    other: NDArray[np.float64]
    halved: NDArray[np.float64]
    errors: NDArray[np.float64]


@kernel
def blank_levels(lines: int) -> GridLevels:
    """Return room for so many lines."""
    room = np.zeros((5, Q_LINES + 3 * lines))
    room[3:] = math.nan
    return GridLevels(room[0], room[1], room[2], room[3], room[4])


@kernel
def count_lines(values: NDArray[np.float64]) -> int:
    """Return how many lines there are in a row of ``GridLevels``."""
    return (values.shape[0] - Q_LINES) // 3


@kernel
def _apart(a: NDArray[np.float64], b: NDArray[np.float64], q: int) -> float:
    """Return how far two rows of ``GridLevels`` are apart in a quantity, m/s2: lines by amplitude and phase, since that
    of amplitudes alone may be small by chance.
    """
    if q < Q_LINES:
        return abs(a[q] - b[q])
    real = Q_LINES + count_lines(a) + 2 * (q - Q_LINES)
    return math.hypot(a[real] - b[real], a[real + 1] - b[real + 1])


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
    return values[q], 1.0


@kernel
def _unsettled(values: NDArray[np.float64], q: int, change: float) -> float:
    """Return the error of a quantity by what is left to settle, m/s2, from that of the waveform."""
    return change * (_SETTLING_OF_LINE * line_unit(values) if q >= Q_LINES else values[q])


@kernel
def judge(levels: GridLevels, wave: float, wave_before: float, change: float) -> None:
    """Write the errors of all quantities on a grid as halving the steps tells them.

    ``wave``, ``wave_before``: as in ``error_estimate``; ``change``: of the waveform by what is left to settle.
    """
    now, halved = levels.now, levels.halved
    for q in range(Q_LINES + count_lines(now)):
        unit, share = _unit(now, q)
        if unit <= SILENCE:
            halved[q] = 0.0
        elif q == Q_WAVE:
            least = min(halved[q] / unit, _TELLING) / 4.0 if math.isfinite(halved[q]) else 0.0
            halved[q] = unit * max(least, _left(wave, wave_before))
        else:
            delta = _apart(now, levels.coarse, q) / unit
            halved[q] = unit * error_estimate(delta, share * wave, share * wave_before, halved[q] / unit)
        levels.errors[q] = halved[q] + _unsettled(now, q, change)


@kernel
def judge_again(levels: GridLevels, wave: float, change: float) -> None:
    """Write the errors of all quantities on a grid of which there is a second opinion.

    What both differ by is about the error of the coarser one. It shares nothing with the change by halving, so that
    both are rarely small by chance. A waveform has the error of its RMS and its lines at least. Where more is left than
    halving told, the next grid begins with it. Arguments: as in ``judge``.
    """
    now, halved, errors, least = levels.now, levels.halved, levels.errors, levels.halved[Q_WAVE]
    count = Q_LINES + count_lines(now)
    for q in range(count):
        unit, _ = _unit(now, q)
        of_other, of_change, of_wave = _CHECKED_LINE if q >= Q_LINES else _CHECKED_PEAK if q == Q_PEAK else _CHECKED_RMS
        apart = of_other * _apart(now, levels.other, q)
        if q != Q_PEAK:
            least = max(least, apart / math.sqrt(2.0) if q >= Q_LINES else apart)
        errors[q] = max(apart, of_change * _apart(now, levels.coarse, q), of_wave * wave * unit)
    errors[Q_WAVE] = least
    for q in range(count):
        halved[q] = max(halved[q], errors[q])
        errors[q] += _unsettled(now, q, change)


@kernel
def largest_line(values: NDArray[np.float64]) -> float:
    """Return the largest entry of those of lines."""
    found = 0.0
    for q in range(Q_LINES, Q_LINES + count_lines(values)):
        found = max(found, values[q])
    return found


@kernel
def asked_error(levels: GridLevels, quantity: int) -> float:
    """Return the relative error of the quantity that is asked for; of lines the largest over the largest line."""
    if quantity == Q_LINES:
        return relative(largest_line(levels.errors), largest_line(levels.now))
    return relative(levels.errors[quantity], levels.now[quantity])
