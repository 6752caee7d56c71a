"""Kernels that settle a scene with steps that are halved until what is asked for no longer changes, and measure it.

Grids that are halved share their places: what one misses, an impact between two places, the next may miss as well, and
both agree. Where contacts say that this may be so, the motion is therefore settled once more on a grid that shares
nothing with the last but the ends of the segments, and what both differ by enters the errors.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from models.platform.jit import kernel
from models.solve.six_dof.kernels.errors import (
    Q_LINES,
    Q_PEAK,
    Q_RMS,
    Q_WAVE,
    asked_error,
    blank_levels,
    count_lines,
    judge,
    judge_again,
    largest_line,
    line_unit,
    relative,
)
from models.solve.six_dof.kernels.orbit import (
    CALM_PERIODS,
    PLAIN_FIRST,
    SILENCE,
    STATE_SCALE,
    comes_to,
    jacobian,
    newton_steering,
    settle,
    spectral_radius,
)
from models.solve.six_dof.kernels.parts import MEANS, crest
from models.solve.six_dof.kernels.period import blank_trace, copy_values, mean_square
from models.solve.six_dof.kernels.period_setup import set_up
from models.solve.six_dof.kernels.step import P_CLEARANCE, P_U_1
from models.solve.six_dof.kernels.tangent import tangent_jacobian

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.platform.jit import Index
    from models.solve.six_dof.kernels.errors import GridLevels
    from models.solve.six_dof.kernels.period import Period, PeriodTrace
    from models.solve.six_dof.kernels.period_setup import OperatingPoint

# Places in a row of ``found``. All errors are estimated: those of the steps, and what is left to settle.
R_RMS = 0  # in the band, m/s2
R_CHANGE = 1  # relative change of the full-bandwidth RMS by the last period, or expected by the next
R_SETTLED = 2  # 1 where the search ended
R_PERIODS = 3  # simulated, of all grids of steps
R_ERROR = 4  # relative error of the RMS
R_RADIUS = 5  # largest absolute Floquet multiplier
R_STEPS = 6  # of the last grid
R_WAVE = 7  # relative error of the waveform (RMS)
R_HALVED = 8  # relative error of the RMS as halving alone tells it
R_DOUBTED = 9  # 1 where there may be other motions: the rings part, or the motion from rest does not come to this one
R_POWER = 10  # mean squares of outer ring and resonator, m2/s4
R_OTHER = 12  # relative difference of the RMS to the second opinion, NaN where none was taken on the last grid
R_PEAK = 13  # relative error of the largest value
R_LINES = 14  # amplitudes of the first lines, m/s2, and then their errors

# Multipliers beyond this are looked at again, by differences and with finer steps.
_DOUBTFUL = 0.9
# Size of those differences in scaled coordinates at most, and over the static approach of the contacts: under a light
# load a larger one would leave them.
_DIFFERENCE = 1e-3
_OF_APPROACH = 1e-3
# A search of more periods than this may have gone to another motion than the one that begins at rest. That one is given
# this many times what the slowest mode takes to decay to a share of e^-3, and this many periods at most.
_LONG_SEARCH = 7
_DECAYS, _MOST_FOLLOWED = 6.0, 600
# One halving is believed where it ends with so many steps: of fewer, both grids may miss the same impact, and agree.
_TOLD_BY_ONE = 256
# The coarsest grid is settled to this share of the accuracy: the next begins from there, and is settled whole.
_FIRST_TOLERANCE = 0.25
# A smaller relative change from period to period is rounding.
LEAST_TOLERANCE = 1e-11
# Steps of a second opinion over those of the last grid, and the error over the accuracy up to which one is worth its
# time: where it tells that less is left it spares the next grid.
_OTHER_STEPS = 0.73
_PROMISING = 5.0


class Effort(NamedTuple):
    """How a scene is settled.

    Attributes:
        steps: least steps in a period of the coarsest grid.
        least: least steps in a segment of it.
        grids: number of grids at most, each with half the steps of the one before; at least 1.
        most: steps in a period at most.
        accuracy: relative error of ``quantity`` at which no finer grid is taken.
        quantity: Q_RMS, Q_WAVE, or Q_LINES for the largest error of a line over the largest line.
        tolerance: relative change of the RMS from period to period that counts as none.
        cap: periods on one grid at most.
        low, high: first and last line of the band of the RMS; ``high`` less than ``low`` is the full bandwidth.
        harmonics: number of lines whose amplitudes are wanted.
    """

    steps: int
    least: int
    grids: int
    most: int
    accuracy: float
    quantity: int
    tolerance: float
    cap: int
    low: int
    high: int
    harmonics: int


@kernel
def largest(trace: PeriodTrace, first: NDArray[np.int64], sensor: Index) -> float:
    """Return the largest absolute value of a sensor in a period.

    Between three values it is that of the parabola through them, where that has its vertex there and no contact changes
    between them: steps that are taken in parts know their own. ``first``: see models.solve.six_dof.kernels.period.
    """
    wave, changed, found = trace.wave, trace.changed, 0.0
    for k in range(first.shape[0] - 1):
        start, end = first[k] + k, first[k + 1] + k
        for n in range(start, end + 1):
            found = max(found, abs(wave[n, sensor]))
            if n < end and changed[n - k]:
                found = max(found, trace.parts[n - k, MEANS + sensor])
            elif start < n < end and not changed[n - k - 1]:
                found = max(found, crest(wave[n - 1, sensor], wave[n, sensor], wave[n + 1, sensor]))
    return found


@kernel
def _fill_turns(angle: float, c: NDArray[np.float64], s: NDArray[np.float64]) -> None:
    """Write cosine and sine of the multiples 0, 1, ... of an angle, each from the one before."""
    c_1, s_1 = math.cos(angle), math.sin(angle)
    c[0], s[0] = 1.0, 0.0
    for i in range(1, c.shape[0]):
        c[i], s[i] = c[i - 1] * c_1 - s[i - 1] * s_1, s[i - 1] * c_1 + c[i - 1] * s_1


@kernel
def lines(
    trace: PeriodTrace, time: NDArray[np.float64], first: NDArray[np.int64], count: int, sensors: int
) -> NDArray[np.float64]:
    """Return the Fourier coefficients 0..count of a period, (sensors, 2, count + 1): sensor, real and imaginary part.

    The values of each segment are equally spaced, so that each line turns by the same angle from one to the next. A
    step in parts enters by its mean and its first moment about its middle; the second is taken as that of a constant.

    Args:
        trace, time, first: of the period.
        count: of the last line.
        sensors: 1 for the casing, 2 for the resonator as well.
    """
    wave, weight, duration = trace.wave, trace.weight, time[-1]
    sums = np.zeros((sensors, 2, count + 1))
    c, s, step_c, step_s = np.empty(count + 1), np.empty(count + 1), np.empty(count + 1), np.empty(count + 1)
    for k in range(first.shape[0] - 1):
        start, end = first[k] + k, first[k + 1] + k
        _fill_turns(2.0 * math.pi * (time[end] - time[start]) / duration / (end - start), step_c, step_s)
        for sensor in range(sensors):
            real, imaginary = sums[sensor, 0], sums[sensor, 1]
            _fill_turns(2.0 * math.pi * time[start] / duration, c, s)
            for n in range(start, end + 1):
                a = weight[n] * wave[n, sensor]
                for i in range(count + 1):
                    real[i] += a * c[i]
                    imaginary[i] -= a * s[i]
                    turned = c[i] * step_c[i] - s[i] * step_s[i]
                    s[i] = s[i] * step_c[i] + c[i] * step_s[i]
                    c[i] = turned
        for n in range(first[k], first[k + 1]):
            if trace.changed[n]:
                at, after = time[n + k], time[n + k + 1]
                _fill_turns(math.pi * (at + after) / duration, c, s)
                for i in range(count + 1):
                    # The line turns by this angle in a second; moments of the part up to the second one.
                    turn = 2.0 * math.pi * i / duration
                    share = 1.0 - (turn * (after - at)) ** 2 / 24.0
                    for sensor in range(sensors):
                        even, odd = share * trace.parts[n, sensor], turn * trace.parts[n, 4 + sensor]
                        sums[sensor, 0, i] += even * c[i] - odd * s[i]
                        sums[sensor, 1, i] -= even * s[i] + odd * c[i]
    return sums


def fourier_coefficients(trace: PeriodTrace, period: Period, count: int) -> NDArray[np.complex128]:
    """Return the Fourier coefficients 0..count of the accelerations of a period, shape (sensors, count + 1)."""
    parts = lines(trace, period.time, period.first, count, 2)
    return parts[:, 0] + 1j * parts[:, 1]


@kernel
def _tolerance(effort: Effort, values: NDArray[np.float64]) -> float:
    """Return the relative change that counts as none: less where lines are asked for that are a part of the wave."""
    part = relative(largest_line(values), line_unit(values))
    if effort.quantity != Q_LINES or part == 0.0:
        return effort.tolerance
    return max(effort.tolerance * min(part, 1.0), LEAST_TOLERANCE)


@kernel
def _measure(trace: PeriodTrace, period: Period, effort: Effort, values: NDArray[np.float64]) -> None:
    """Write what a period shows of the casing, m/s2, by the Q_ constants."""
    spectrum = lines(trace, period.time, period.first, max(effort.harmonics, effort.high), 1)
    values[Q_WAVE] = math.sqrt(mean_square(trace, 0))
    values[Q_RMS] = values[Q_WAVE]
    values[Q_PEAK] = largest(trace, period.first, np.int64(0))
    if effort.high >= effort.low:
        power = 0.0
        for k in range(effort.low, effort.high + 1):
            power += spectrum[0, 0, k] ** 2 + spectrum[0, 1, k] ** 2
        values[Q_RMS] = math.sqrt(2.0 * power)
    parts = Q_LINES + effort.harmonics
    for k in range(effort.harmonics):
        real, imaginary = 2.0 * spectrum[0, 0, k + 1], 2.0 * spectrum[0, 1, k + 1]
        values[Q_LINES + k] = math.hypot(real, imaginary)
        values[parts + 2 * k], values[parts + 2 * k + 1] = real, imaginary


@kernel
def _wave_change(
    fine: NDArray[np.float64], coarse: NDArray[np.float64], first: NDArray[np.int64], weight: NDArray[np.float64]
) -> float:
    """Return the RMS of the difference of two waves of the casing, the first with twice the steps of the second."""
    total = 0.0
    for k in range(first.shape[0] - 1):
        for n in range(first[k], first[k + 1] + 1):
            difference = fine[2 * n + k, 0] - coarse[n + k, 0]
            total += weight[n + k] * difference * difference
    return math.sqrt(max(total, 0.0))


@kernel
def _stability(state: NDArray[np.float64], period: Period) -> tuple[float, NDArray[np.float64], bool]:
    """Return the largest absolute Floquet multiplier of an orbit, the steering of Newton's method about it, and whether
    the rings part in it.
    """
    matrix, parted = tangent_jacobian(state, period)
    radius = spectral_radius(matrix)
    if not radius <= _DOUBTFUL:
        approach = (abs(period.parameter[P_U_1]) - period.parameter[P_CLEARANCE]) / STATE_SCALE[0]
        size = min(_DIFFERENCE, _OF_APPROACH * approach) if approach > 0.0 else _DIFFERENCE
        matrix = jacobian(state, period, size)
        radius = spectral_radius(matrix)
    return radius, newton_steering(matrix), parted


@kernel
def _examine(
    state: NDArray[np.float64], period: Period, rms: float, searched: int, found: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Write whether an orbit is stable, and whether there may be others beside it; return the steering about it.

    ``searched``: periods that it took to find it from afar.
    """
    radius, steering, parted = _stability(state, period)
    if rms <= SILENCE:
        # Unloaded rings are free, with multipliers of one; at rest nothing leaves it.
        found[R_RADIUS] = 0.0
        return steering
    found[R_RADIUS] = radius
    if parted:
        found[R_DOUBTED] = 1.0
    elif searched > _LONG_SEARCH and radius < 1.0:
        most = min(_DECAYS / max(1.0 - radius, 1e-9), _MOST_FOLLOWED)
        found[R_DOUBTED] = 0.0 if comes_to(state, period, math.ceil(most)) else 1.0
    return steering


@kernel
def ask_again(
    paths: NDArray[np.float64],
    profile: NDArray[np.float64],
    point: OperatingPoint,
    begin: NDArray[np.float64],
    steering: NDArray[np.float64],
    effort: Effort,
    fold: int,
    calm: int,
    tolerance: float,
    felt: float,
    values: NDArray[np.float64],
) -> int:
    """Settle a scene on a grid whose segments have another, incommensurate number of steps than that of ``fold``.

    ``begin`` is the orbit on that one. ``values`` is written: what the other grid shows, nothing (zeros) where its
    motion does not settle. Return the periods simulated.
    """
    steps = math.ceil(_OTHER_STEPS * fold * effort.steps) | 1
    period = set_up(paths, profile, point, steps, (3 * fold * effort.least) // 4 | 1, 1)
    trace = blank_trace(period)
    number, _, _, settled, _ = settle(
        begin, np.zeros((2, 6)), trace, period, steering, 0, calm, tolerance, effort.cap, felt
    )
    values[:] = 0.0
    if settled:
        _measure(trace, period, effort, values)
    return number


@kernel
def _note(levels: GridLevels, trace: PeriodTrace, found: NDArray[np.float64]) -> None:
    """Write levels and errors of the last grid to their places."""
    now, errors = levels.now, levels.errors
    found[R_RMS], found[R_ERROR] = now[Q_RMS], relative(errors[Q_RMS], now[Q_RMS])
    found[R_WAVE], found[R_PEAK] = relative(errors[Q_WAVE], now[Q_WAVE]), relative(errors[Q_PEAK], now[Q_PEAK])
    found[R_POWER], found[R_POWER + 1] = mean_square(trace, 0), mean_square(trace, 1)
    count = count_lines(now)
    for k in range(count):
        found[R_LINES + k], found[R_LINES + count + k] = now[Q_LINES + k], errors[Q_LINES + k]


@kernel
def solve(
    paths: NDArray[np.float64],
    profile: NDArray[np.float64],
    point: OperatingPoint,
    begin: NDArray[np.float64],
    steering: NDArray[np.float64],
    effort: Effort,
    found: NDArray[np.float64],
) -> tuple[Period, NDArray[np.float64], PeriodTrace]:
    """Settle one scene; return the last period, the state at its start, and its accelerations.

    The coarsest grid is searched from the state ``begin`` (2, 6), each finer one from the orbit of the one before, with
    the Jacobian at that orbit for Newton's method. ``found`` (R_LINES + 2 harmonics), written: see the R_ constants.
    """
    begin, state, levels = begin.copy(), np.zeros((2, 6)), blank_levels(effort.harmonics)
    period = set_up(paths, profile, point, effort.steps, effort.least, 1)
    trace = blank_trace(period)
    found[:] = 0.0
    found[R_RADIUS] = found[R_HALVED] = found[R_OTHER] = math.nan
    felt, wave, plain, calm, settled_before = math.inf, math.nan, PLAIN_FIRST, CALM_PERIODS, False
    tolerance = max(effort.tolerance, _FIRST_TOLERANCE * effort.accuracy)
    # Two opinions of a waveform are compared in its RMS and lines only, which cannot tell that less is left of it.
    promising = effort.accuracy * (1.0 if effort.quantity == Q_WAVE else _PROMISING)
    for grid in range(effort.grids):
        before, trace_before = period, trace
        copy_values(levels.now, levels.coarse)
        if grid > 0:
            period = set_up(paths, profile, point, effort.steps, effort.least, 1 << grid)
            trace, tolerance = blank_trace(period), _tolerance(effort, levels.now)
        number, change, rms, settled, felt = settle(
            begin, state, trace, period, steering, plain, calm, tolerance, effort.cap, felt
        )
        steps = period.nodes.turn.shape[0]
        found[R_PERIODS] += number
        found[R_CHANGE], found[R_SETTLED], found[R_STEPS] = change, 1.0 if settled else 0.0, steps
        _measure(trace, period, effort, levels.now)
        if not settled and grid > 0:
            break
        if settled and settled_before:
            wave_before = wave
            wave = relative(_wave_change(trace.wave, trace_before.wave, before.first, before.weight), rms)
            judge(levels, wave, wave_before, change)
            error, level = asked_error(levels, effort.quantity), levels.now[Q_RMS]
            found[R_HALVED], found[R_OTHER] = relative(levels.errors[Q_RMS], level), math.nan
            if error <= promising and (math.isfinite(wave_before) or steps >= _TOLD_BY_ONE):
                # Where no contact changes the motion is smooth, and halving is believed.
                certain = found[R_RADIUS] >= 1.0 or not np.any(trace.changed)
                if error <= effort.accuracy and certain:
                    break
                found[R_PERIODS] += ask_again(
                    paths,
                    profile,
                    point,
                    state,
                    steering,
                    effort,
                    1 << grid,
                    calm,
                    tolerance,
                    felt,
                    levels.other,
                )
                judge_again(levels, wave, change)
                found[R_OTHER] = relative(abs(level - levels.other[Q_RMS]), level)
                if asked_error(levels, effort.quantity) <= effort.accuracy:
                    break
        if settled:
            if grid == 0 or found[R_RADIUS] > _DOUBTFUL:
                steering = _examine(state, period, rms, number if grid == 0 else 0, found)
                plain = 0
                # Newton's method doubles the digits: the next change would be far smaller.
                calm = 1 if found[R_RADIUS] <= _DOUBTFUL else CALM_PERIODS
            begin = state.copy()
        if 2 * steps > effort.most:
            break
        settled_before = settled
    _note(levels, trace, found)
    return period, state, trace


@kernel
def healthy_steering(
    paths: NDArray[np.float64], profile: NDArray[np.float64], point: OperatingPoint, steps: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the Jacobian of the scaled period map of a healthy bearing at rest, and the steering of it, (12, 12) each.

    ``steps`` are those in a period.
    """
    matrix, _ = tangent_jacobian(np.zeros((2, 6)), set_up(paths, profile, point, steps, 1, 1))
    return matrix, newton_steering(matrix)
