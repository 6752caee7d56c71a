"""Kernels that settle a scene with steps that are halved until the RMS no longer changes, and measure its period."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from models.platform.jit import kernel
from models.solve.six_dof.kernels.orbit import (
    CALM_PERIODS,
    PLAIN_FIRST,
    SILENCE,
    STATE_SCALE,
    jacobian,
    newton_steering,
    settle,
    spectral_radius,
)
from models.solve.six_dof.kernels.period import blank_trace, mean_square
from models.solve.six_dof.kernels.period_setup import set_up
from models.solve.six_dof.kernels.step import P_CLEARANCE, P_U_1
from models.solve.six_dof.kernels.tangent import tangent_jacobian

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.solve.six_dof.kernels.period import Period, PeriodTrace
    from models.solve.six_dof.kernels.period_setup import OperatingPoint

# Places in a row of ``found``.
R_RMS = 0  # in the band, m/s2
R_CHANGE = 1  # relative change of the full-bandwidth RMS by the last period, or expected by the next
R_SETTLED = 2  # 1 where the search ended
R_PERIODS = 3  # simulated, of all grids of steps
R_ERROR = 4  # relative error of the RMS due to the steps and what is left to settle, estimated
R_RADIUS = 5  # largest absolute Floquet multiplier
R_STEPS = 6  # of the last grid
R_WAVE = 7  # relative change of the waveform by the last halving of the steps (RMS)
R_DELTA = 8  # relative change of the RMS by it
R_PARTED = 9  # 1 where the rings part for a moment, so that no ball is in contact
R_POWER = 10  # mean squares of outer ring and resonator, m2/s4
R_LINES = 12  # amplitudes of the first lines, m/s2, and then their changes by the last halving

# Multipliers beyond this are looked at again, by differences and with finer steps.
_DOUBTFUL = 0.9
# Size of those differences in scaled coordinates at most, and over the static approach of the contacts: under a light
# load a larger one would leave them.
_DIFFERENCE = 1e-3
_OF_APPROACH = 1e-3
# Error of the RMS over its change and over that of the waveform by the last halving, where only one is known:
# benchmarks/engine/families.py measures how often the larger of both bounds it.
_OF_CHANGE = 0.7
_OF_WAVE = 0.25
# One halving is believed where it ends with so many steps: of fewer, both grids may miss the same impact, and agree.
_TOLD_BY_ONE = 256
# A larger error than this means that a grid is too coarse for any statement, on itself or on the next.
_TELLING = 0.05
# The coarsest grid is settled to this share of the accuracy: the next begins from there, and is settled whole.
_FIRST_TOLERANCE = 0.25


class Effort(NamedTuple):
    """How a scene is settled.

    Attributes:
        steps: least steps in a period of the coarsest grid.
        least: least steps in a segment of it.
        grids: number of grids at most, each with half the steps of the one before; at least 1.
        most: steps in a period at most.
        accuracy: relative error of the RMS at which no finer grid is taken.
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
    tolerance: float
    cap: int
    low: int
    high: int
    harmonics: int


@kernel
def largest(wave: NDArray[np.float64], first: NDArray[np.int64], sensor: int, stride: int) -> float:
    """Return the largest absolute value of a sensor, as seen at every ``stride``-th value of each segment.

    Between three of them it is that of the parabola through them, where that has its vertex there. ``wave`` and
    ``first``: see models.solve.six_dof.kernels.period.
    """
    found = 0.0
    for k in range(first.shape[0] - 1):
        start, end = first[k] + k, first[k + 1] + k
        for n in range(start, end + 1, stride):
            at = wave[n, sensor]
            size = abs(at)
            if n - stride >= start and n + stride <= end:
                before, after = wave[n - stride, sensor], wave[n + stride, sensor]
                slope, bend = 0.5 * (after - before), after - 2.0 * at + before
                if at * bend < 0.0 and abs(slope) < abs(bend):
                    size += 0.5 * slope * slope / abs(bend)
            found = max(found, size)
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

    The values of each segment are equally spaced, so that each line turns by the same angle from one to the next.

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
                _fill_turns(math.pi * (time[n + k] + time[n + k + 1]) / duration, c, s)
                for sensor in range(sensors):
                    for i in range(count + 1):
                        sums[sensor, 0, i] += trace.parts[n, sensor] * c[i]
                        sums[sensor, 1, i] -= trace.parts[n, sensor] * s[i]
    return sums


def fourier_coefficients(trace: PeriodTrace, period: Period, count: int) -> NDArray[np.complex128]:
    """Return the Fourier coefficients 0..count of the accelerations of a period, shape (sensors, count + 1)."""
    parts = lines(trace, period.time, period.first, count, 2)
    return parts[:, 0] + 1j * parts[:, 1]


@kernel
def error_estimate(delta: float, wave: float, wave_before: float, before: float) -> float:
    """Return an estimate of the relative error of the RMS on a grid.

    From the relative changes of RMS and waveform by the last halving of the steps, the change of the waveform by the
    halving before and the estimate then (NaN where there was none). Steps of fourth order would leave a fifteenth of
    ``wave``; where balls meet kinks or open contacts the order is lower, which two halvings show, and a change may be
    small by chance: so no estimate falls by more than a factor of four. The hard tests of the engine count how often
    it bounds the error.
    """
    found = max(_OF_CHANGE * abs(delta), _OF_WAVE * wave)
    if not math.isfinite(before):
        return found
    before = min(before, _TELLING)
    ratio = min(max(wave / wave_before, 0.0625), 0.9) if wave_before > 0.0 else 0.0625
    return max(found, abs(delta), before / 4.0, wave * ratio / (1.0 - ratio))


@kernel
def _band_rms(found: NDArray[np.float64], low: int, high: int) -> float:
    """Return the RMS of the casing's lines from ``low`` to ``high``."""
    power = 0.0
    for k in range(low, high + 1):
        power += found[0, 0, k] ** 2 + found[0, 1, k] ** 2
    return math.sqrt(2.0 * power)


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
def solve(
    path: NDArray[np.float64],
    profile: NDArray[np.float64],
    damaged_rows: tuple[int, int],
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
    begin, state, count = begin.copy(), np.zeros((2, 6)), max(effort.harmonics, effort.high)
    period = set_up(path, profile, point, damaged_rows, effort.steps, effort.least, 1)
    trace = blank_trace(period)
    found[:] = 0.0
    found[R_ERROR] = found[R_RADIUS] = found[R_WAVE] = found[R_DELTA] = math.nan
    felt, estimate = math.inf, math.nan
    periods, plain, calm, rms_before, settled_before = 0, PLAIN_FIRST, CALM_PERIODS, math.nan, False
    for grid in range(effort.grids):
        before, trace_before = period, trace
        if grid > 0:
            period = set_up(path, profile, point, damaged_rows, effort.steps, effort.least, 1 << grid)
            trace = blank_trace(period)
        tolerance = effort.tolerance if grid > 0 else max(effort.tolerance, _FIRST_TOLERANCE * effort.accuracy)
        number, found[R_CHANGE], rms, settled, felt = settle(
            begin, state, trace, period, steering, plain, calm, tolerance, effort.cap, felt
        )
        periods += number
        found[R_PERIODS], found[R_STEPS] = periods, period.nodes.turn.shape[0]
        found[R_SETTLED] = 1.0 if settled else 0.0
        spectrum = lines(trace, period.time, period.first, count, 1)
        level = _band_rms(spectrum, effort.low, effort.high) if effort.high >= effort.low else rms
        found[R_RMS] = level
        found[R_POWER], found[R_POWER + 1] = mean_square(trace, 0), mean_square(trace, 1)
        for k in range(effort.harmonics):
            amplitude = 2.0 * math.sqrt(spectrum[0, 0, k + 1] ** 2 + spectrum[0, 1, k + 1] ** 2)
            found[R_LINES + effort.harmonics + k] = amplitude - found[R_LINES + k]
            found[R_LINES + k] = amplitude
        if not settled and grid > 0:
            break
        if settled and settled_before:
            change_before = found[R_WAVE]
            change = _wave_change(trace.wave, trace_before.wave, before.first, before.weight)
            found[R_WAVE] = change / rms if rms > SILENCE else 0.0
            found[R_DELTA] = (level - rms_before) / level if level > SILENCE else 0.0
            estimate = error_estimate(found[R_DELTA], found[R_WAVE], change_before, estimate)
            found[R_ERROR] = estimate + found[R_CHANGE]
            told = math.isfinite(change_before) or period.nodes.turn.shape[0] >= _TOLD_BY_ONE
            if found[R_ERROR] <= effort.accuracy and told:
                break
        if settled:
            if grid == 0 or found[R_RADIUS] > _DOUBTFUL:
                found[R_RADIUS], steering, parted = _stability(state, period)
                found[R_PARTED] = 1.0 if parted and rms > SILENCE else 0.0
                if rms <= SILENCE:
                    # Unloaded rings are free, with multipliers of one; at rest nothing leaves it.
                    found[R_RADIUS] = 0.0
                plain = 0
                # Newton's method doubles the digits: the next change would be far smaller.
                calm = 1 if found[R_RADIUS] <= _DOUBTFUL else CALM_PERIODS
            begin[:] = state
        if 2 * period.nodes.turn.shape[0] > effort.most:
            break
        rms_before, settled_before = level, settled
    return period, state, trace


@kernel
def healthy_steering(
    path: NDArray[np.float64], profile: NDArray[np.float64], point: OperatingPoint, steps: int, size: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the Jacobian of the scaled period map of a healthy bearing at rest, and the steering of it, (12, 12) each.

    ``steps`` are those in a period, ``size`` that of the differences in scaled coordinates.
    """
    matrix = jacobian(np.zeros((2, 6)), set_up(path, profile, point, (0, 0), steps, 1, 1), size)
    return matrix, newton_steering(matrix)
