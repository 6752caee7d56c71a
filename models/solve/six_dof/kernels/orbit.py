"""Kernels that find the motion that repeats and tell whether it is stable (described in models.solve.six_dof.orbit)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from models.platform.jit import kernel
from models.solve.six_dof.kernels.period import ball_period, blank_trace, mean_square
from models.solve.six_dof.kernels.step import STATUS_OK, accelerations, contact

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.solve.six_dof.kernels.period import Period, PeriodTrace

# Sizes of the state that count as one: displacements, velocities, and for the stiff resonator a smaller displacement.
STATE_SCALE = np.array([1e-6, 1e-2, 1e-6, 1e-2, 2e-7, 1e-2])
PLAIN_FIRST = 1
CALM_PERIODS = 2
DEPTH = 5
RESIDUAL_FLOOR = 1e-9
# A vibration below this is none (m/s2); relative changes of it mean nothing.
SILENCE = 1e-9
# Where the distance to the orbit falls below this share in one period, what is left of the waveform's change is about
# as small a share of it, within the factor below. (The change of the RMS can be small by chance.)
_FAST = 0.1
_SAFETY = 3.0
# What is left to settle may be so many times what a period may still change: it is known, and not one of many changes.
LEFT = 20.0
# Share of its first distance at which a motion has come near to another.
_COME = 0.05
# Differences of residuals that differ from those of later ones by less than this share add nothing but rounding.
_DEPENDENT = 1e-8
# A pivot below this makes a matrix singular.
_SINGULAR = 1e-9


@kernel
def _dot(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    total = 0.0
    for i in range(a.shape[0]):
        total += a[i] * b[i]
    return total


@kernel
def anderson(xs: NDArray[np.float64], fs: NDArray[np.float64], count: int, x: NDArray[np.float64]) -> None:
    """Write the next iterate, from the last ``count`` iterates (rows, oldest first) and their residuals, to ``x``.

    Least squares by modified Gram-Schmidt on differences of residuals, the latest first; one that depends on later ones
    is left out. (Loops are written out: they compile several times faster than operations on whole arrays.)
    """
    size, last = xs.shape[1], count - 1
    rest, basis, images = np.empty(size), np.empty((DEPTH, size)), np.empty((DEPTH, size))
    for j in range(size):
        x[j], rest[j] = xs[last, j] + fs[last, j], fs[last, j]
    kept = 0
    for k in range(last, 0, -1):
        # ``images`` are the same combinations of the differences of x + f as ``basis`` of those of f.
        v, w = basis[kept], images[kept]
        for j in range(size):
            v[j] = fs[k, j] - fs[k - 1, j]
            w[j] = v[j] + (xs[k, j] - xs[k - 1, j])
        norm = math.sqrt(_dot(v, v))
        for i in range(kept):
            share = _dot(basis[i], v)
            for j in range(size):
                v[j] -= share * basis[i, j]
                w[j] -= share * images[i, j]
        left = math.sqrt(_dot(v, v))
        if left <= _DEPENDENT * norm:
            continue
        share = _dot(v, rest) / left
        for j in range(size):
            v[j] /= left
            w[j] /= left
            rest[j] -= share * v[j]
            x[j] -= share * w[j]
        kept += 1


@kernel
def settle(
    begin: NDArray[np.float64],
    state: NDArray[np.float64],
    trace: PeriodTrace,
    period: Period,
    steering: NDArray[np.float64],
    plain: int,
    calm_periods: int,
    tolerance: float,
    cap: int,
    felt: float,
) -> tuple[int, float, float, bool, float]:
    """Iterate from ``begin`` until the RMS has settled or ``cap`` periods have been simulated.

    It has settled where its relative change was below ``tolerance`` so many periods running as ``calm_periods`` says,
    or where the distance to the orbit, which steered residuals estimate, fell so fast that little is left: what is
    expected, LEFT times the tolerance at most. ``felt`` is the relative change of the waveform by a distance of one,
    infinite where it is not known; what becomes known of it is returned last.
    ``state`` (2, 6) is written: the state at the start of the last period, whose accelerations ``trace`` holds.
    ``steering`` (12, 12) is what residuals are multiplied by, in scaled coordinates; the first ``plain`` periods follow
    each other without it. Return the periods simulated, the relative change of the RMS by the last or expected by the
    next, the RMS of the last, and whether it has settled.
    """
    x, after = np.zeros(12), np.empty((2, 6))
    xs, fs = np.empty((DEPTH + 1, 12)), np.empty((DEPTH + 1, 12))
    for i in range(12):
        x[i] = begin[i // 6, i % 6] / STATE_SCALE[i % 6]
    known, calm = 0, 0
    change, rms, distance, earlier = math.inf, math.nan, math.nan, np.zeros(trace.wave.shape[0])
    for number in range(1, cap + 1):
        for i in range(12):
            state[i // 6, i % 6] = x[i] * STATE_SCALE[i % 6]
        status = ball_period(state, after, trace, period)
        if status != STATUS_OK:
            # The extrapolation left the basin: begin again at rest, plainly.
            for i in range(12):
                x[i] = 0.0
            known, calm, change, rms, distance = 0, 0, math.inf, math.nan, math.nan
            continue
        level = math.sqrt(mean_square(trace, 0))
        change = _change(level, rms)
        calm = calm + 1 if change < tolerance else 0
        rms = level
        if calm >= calm_periods:
            return number, change, rms, True, felt
        known = _remember(xs, fs, known, x, after, steering)
        before, distance = distance, math.sqrt(_dot(fs[known - 1], fs[known - 1]))
        moved = _wave_moved(trace, earlier) / max(level, SILENCE)
        if distance < _FAST * before:
            felt = _SAFETY * moved / (before - distance)
        # In another direction than those of the search a distance can be felt more.
        expected = felt * distance if number > 1 else _SAFETY * felt * distance
        # A stiff mode decays within the period, but is felt far more than those that the search goes along.
        jump = _jump(after, trace, period) / max(level, SILENCE)
        if jump > expected:
            expected = jump
        if expected < LEFT * tolerance:
            return number, expected, rms, True, felt
        if number <= plain or _only_rounding(x, after):
            for i in range(12):
                x[i] = after[i // 6, i % 6] / STATE_SCALE[i % 6]
        else:
            anderson(xs, fs, known, x)
    return cap, change, rms, False, felt


@kernel
def _jump(after: NDArray[np.float64], trace: PeriodTrace, period: Period) -> float:
    """Return by how much the state at the end of the period changes the casing's acceleration at its start, m/s2."""
    x1 = (after[0, 0], after[0, 1], after[0, 2], after[0, 3], after[0, 4], after[0, 5])
    x2 = (after[1, 0], after[1, 1], after[1, 2], after[1, 3], after[1, 4], after[1, 5])
    p, first = period.parameter, np.int64(0)
    f1, f2, _, _ = contact(x1, x2, p, period.balls, period.nodes, first, first, 0.0)
    return abs(accelerations(x1, x2, f1, f2, p)[0] - trace.wave[0, 0])


@kernel
def _wave_moved(trace: PeriodTrace, earlier: NDArray[np.float64]) -> float:
    """Return the RMS of the change of the casing's wave since the one in ``earlier``, m/s2, and write it there."""
    total = 0.0
    for i in range(earlier.shape[0]):
        difference = trace.wave[i, 0] - earlier[i]
        total += trace.weight[i] * difference * difference
        earlier[i] = trace.wave[i, 0]
    return math.sqrt(max(total, 0.0))


@kernel
def _change(level: float, before: float) -> float:
    """Return the relative change of a level, infinite where there was none before, zero between two silent ones."""
    if level <= SILENCE and not before > SILENCE:
        return 0.0
    change = abs(level - before) / max(level, SILENCE)
    return change if math.isfinite(change) else math.inf


@kernel
def _only_rounding(x: NDArray[np.float64], after: NDArray[np.float64]) -> bool:
    """Tell whether what a period changed is rounding, whose residuals point nowhere."""
    moved, size = 0.0, 0.0
    for i in range(12):
        image = after[i // 6, i % 6] / STATE_SCALE[i % 6]
        moved, size = max(moved, abs(image - x[i])), max(size, abs(image))
    return moved < RESIDUAL_FLOOR * size


@kernel
def _remember(
    xs: NDArray[np.float64],
    fs: NDArray[np.float64],
    known: int,
    x: NDArray[np.float64],
    after: NDArray[np.float64],
    steering: NDArray[np.float64],
) -> int:
    """Append an iterate and its steered residual, drop the oldest where there is no room; return how many are known."""
    if known == DEPTH + 1:
        for k in range(DEPTH):
            for i in range(12):
                xs[k, i], fs[k, i] = xs[k + 1, i], fs[k + 1, i]
        known = DEPTH
    for i in range(12):
        xs[known, i], fs[known, i] = x[i], 0.0
    for j in range(12):
        residual = after[j // 6, j % 6] / STATE_SCALE[j % 6] - x[j]
        for i in range(12):
            fs[known, i] += steering[i, j] * residual
    return known + 1


@kernel
def jacobian(state: NDArray[np.float64], period: Period, size: float) -> NDArray[np.float64]:
    """Return the Jacobian of the scaled period map at a state, by central differences over ``size``, shape (12, 12)."""
    above, below, moved, trace = np.empty((2, 6)), np.empty((2, 6)), state.copy(), blank_trace(period)
    found = np.empty((12, 12))
    for j in range(12):
        moved[j // 6, j % 6] = state[j // 6, j % 6] + size * STATE_SCALE[j % 6]
        ball_period(moved, above, trace, period)
        moved[j // 6, j % 6] = state[j // 6, j % 6] - size * STATE_SCALE[j % 6]
        ball_period(moved, below, trace, period)
        moved[j // 6, j % 6] = state[j // 6, j % 6]
        for i in range(12):
            found[i, j] = 0.5 * (above[i // 6, i % 6] - below[i // 6, i % 6]) / (STATE_SCALE[i % 6] * size)
    return found


@kernel
def comes_to(orbit: NDArray[np.float64], period: Period, most: int) -> bool:
    """Return whether a motion that begins at rest comes near the one that repeats from ``orbit`` (2, 6) on, within so
    many periods: to a small share of the distance at which it begins.
    """
    state, after, trace, begin = np.zeros((2, 6)), np.empty((2, 6)), blank_trace(period), _scaled_size(orbit)
    away = np.empty((2, 6))
    for _ in range(most):
        if ball_period(state, after, trace, period) != STATUS_OK:
            return False
        for i in range(2):
            for j in range(6):
                state[i, j], away[i, j] = after[i, j], after[i, j] - orbit[i, j]
        if _scaled_size(away) <= _COME * begin:
            return True
    return False


@kernel
def _scaled_size(state: NDArray[np.float64]) -> float:
    total = 0.0
    for i in range(12):
        total += (state[i // 6, i % 6] / STATE_SCALE[i % 6]) ** 2
    return math.sqrt(total)


@kernel
def _squared(a: NDArray[np.float64]) -> NDArray[np.float64]:
    size = a.shape[0]
    found = np.zeros((size, size))
    for i in range(size):
        for k in range(size):
            for j in range(size):
                found[i, j] += a[i, k] * a[k, j]
    return found


@kernel
def spectral_radius(matrix: NDArray[np.float64]) -> float:
    """Return the largest absolute eigenvalue of a matrix, from the norm of its power 2**17 (Gelfand's formula)."""
    power, logarithm, weight = matrix.copy(), 0.0, 1.0
    for _ in range(18):
        norm = 0.0
        for i in range(power.shape[0]):
            norm += _dot(power[i], power[i])
        norm = math.sqrt(norm)
        if norm == 0.0 or not math.isfinite(norm):
            return norm
        logarithm += weight * math.log(norm)
        for i in range(power.shape[0]):
            for j in range(power.shape[0]):
                power[i, j] /= norm
        power = _squared(power)
        weight *= 0.5
    return math.exp(logarithm)


@kernel
def newton_steering(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the inverse of identity minus a matrix, by elimination with pivots; the identity if it is singular."""
    size = matrix.shape[0]
    left, right = -matrix, np.eye(size)
    for i in range(size):
        left[i, i] += 1.0
    for k in range(size):
        pivot = k
        for i in range(k + 1, size):
            if abs(left[i, k]) > abs(left[pivot, k]):
                pivot = i
        if not abs(left[pivot, k]) > _SINGULAR:
            return np.eye(size)
        for j in range(size):
            left[k, j], left[pivot, j] = left[pivot, j], left[k, j]
            right[k, j], right[pivot, j] = right[pivot, j], right[k, j]
        factor = 1.0 / left[k, k]
        for j in range(size):
            left[k, j] *= factor
            right[k, j] *= factor
        for i in range(size):
            share = left[i, k]
            if i != k and share != 0.0:
                for j in range(size):
                    left[i, j] -= share * left[k, j]
                    right[i, j] -= share * right[k, j]
    return right
