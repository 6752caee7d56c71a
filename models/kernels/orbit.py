"""Kernels that find the motion that repeats and its lines: Anderson acceleration of the period map.

``models.dynamics.orbit`` describes the search; ``settle`` is that of one scene, ``settle_row`` of many defects.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from models.kernels.jit import kernel
from models.kernels.period_setup import set_up
from models.kernels.six_dof import STATUS_OK, ball_period

if TYPE_CHECKING:
    from numpy.typing import NDArray

PLAIN_FIRST = 2
DEPTH = 5
RESIDUAL_FLOOR = 1e-9
# A vibration below this is none (m/s2); relative changes of it mean nothing.
SILENCE = 1e-9
# Differences of residuals that differ from those of later ones by less than this share add nothing but rounding.
_DEPENDENT = 1e-8

# Places in a row of ``out``.
R_RMS = 0
R_CHANGE = 1
R_SETTLED = 2
R_PERIODS = 3
RESULT = 4


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
def mean_square(wave: NDArray[np.float64], weight: NDArray[np.float64], sensor: int) -> float:
    """Return the mean square of a recorded period."""
    total = 0.0
    for i in range(weight.shape[0]):
        total += weight[i] * wave[i, sensor] * wave[i, sensor]
    return max(total, 0.0)


@kernel
def settle(
    begin: NDArray[np.float64],
    state: NDArray[np.float64],
    wave: NDArray[np.float64],
    first: NDArray[np.int64],
    flow: NDArray[np.float64],
    part: NDArray[np.float64],
    turn: NDArray[np.float64],
    advance: NDArray[np.float64],
    damaged: NDArray[np.float64],
    plain: NDArray[np.float64],
    near: int,
    depth: NDArray[np.float64],
    rate: NDArray[np.float64],
    parameter: NDArray[np.float64],
    weight: NDArray[np.float64],
    scale: NDArray[np.float64],
    steering: NDArray[np.float64],
    tolerance: float,
    cap: int,
) -> tuple[int, float, float, bool]:
    """Iterate from ``begin`` until the RMS has settled or ``cap`` periods have been simulated.

    ``state`` (2, 6) is written: the state at the start of the last period, whose accelerations ``wave`` holds.
    ``scale`` (12) are the sizes of the state that count as one, ``steering`` (12, 12) what residuals are multiplied by.
    Return the periods simulated, relative change and value of the RMS of the last, and whether it has settled.
    """
    x, after = np.zeros(12), np.empty((2, 6))
    xs, fs = np.empty((DEPTH + 1, 12)), np.empty((DEPTH + 1, 12))
    for i in range(12):
        x[i] = begin[i // 6, i % 6] / scale[i]
    known, calm = 0, 0
    change, rms = math.inf, math.nan
    for period in range(1, cap + 1):
        for i in range(12):
            state[i // 6, i % 6] = x[i] * scale[i]
        status = ball_period(
            state, after, wave, first, flow, part, turn, advance, damaged, plain, near, depth, rate, parameter
        )
        if status != STATUS_OK:
            # The extrapolation left the basin: begin again at rest, plainly.
            for i in range(12):
                x[i] = 0.0
            known, calm, change, rms = 0, 0, math.inf, math.nan
            continue
        level = math.sqrt(mean_square(wave, weight, 0))
        change = _change(level, rms)
        calm = calm + 1 if change < tolerance else 0
        rms = level
        if calm >= 2:
            return period, change, rms, True
        known = _remember(xs, fs, known, x, after, scale, steering)
        if period <= PLAIN_FIRST or _only_rounding(x, after, scale):
            for i in range(12):
                x[i] = after[i // 6, i % 6] / scale[i]
        else:
            anderson(xs, fs, known, x)
    return cap, change, rms, False


@kernel
def _change(level: float, before: float) -> float:
    """Return the relative change of a level, infinite where there was none before, zero between two silent ones."""
    if level <= SILENCE and not before > SILENCE:
        return 0.0
    change = abs(level - before) / max(level, SILENCE)
    return change if math.isfinite(change) else math.inf


@kernel
def _only_rounding(x: NDArray[np.float64], after: NDArray[np.float64], scale: NDArray[np.float64]) -> bool:
    """Tell whether what a period changed is rounding, whose residuals point nowhere."""
    moved, size = 0.0, 0.0
    for i in range(12):
        image = after[i // 6, i % 6] / scale[i]
        moved, size = max(moved, abs(image - x[i])), max(size, abs(image))
    return moved < RESIDUAL_FLOOR * size


@kernel
def _remember(
    xs: NDArray[np.float64],
    fs: NDArray[np.float64],
    known: int,
    x: NDArray[np.float64],
    after: NDArray[np.float64],
    scale: NDArray[np.float64],
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
        residual = after[j // 6, j % 6] / scale[j] - x[j]
        for i in range(12):
            fs[known, i] += steering[i, j] * residual
    return known + 1


@kernel
def lines(
    wave: NDArray[np.float64],
    weight: NDArray[np.float64],
    time: NDArray[np.float64],
    first: NDArray[np.int64],
    duration: float,
    count: int,
) -> NDArray[np.float64]:
    """Return the Fourier coefficients 0..count of both sensors, shape (2, 2, count + 1): sensor, real and imaginary.

    The values of each segment are equally spaced, so that each line turns by the same angle from one to the next.
    """
    sums = np.zeros((2, 2, count + 1))
    c, s, step_c, step_s = np.empty(count + 1), np.empty(count + 1), np.empty(count + 1), np.empty(count + 1)
    for k in range(first.shape[0] - 1):
        start, end = first[k] + k, first[k + 1] + k
        angle = 2.0 * math.pi * time[start] / duration
        step = 2.0 * math.pi * (time[end] - time[start]) / duration / (end - start)
        for i in range(count + 1):
            c[i], s[i] = math.cos(i * angle), math.sin(i * angle)
            step_c[i], step_s[i] = math.cos(i * step), math.sin(i * step)
        for n in range(start, end + 1):
            a, b = weight[n] * wave[n, 0], weight[n] * wave[n, 1]
            for i in range(count + 1):
                sums[0, 0, i] += a * c[i]
                sums[0, 1, i] -= a * s[i]
                sums[1, 0, i] += b * c[i]
                sums[1, 1, i] -= b * s[i]
                turned = c[i] * step_c[i] - s[i] * step_s[i]
                s[i] = s[i] * step_c[i] + c[i] * step_s[i]
                c[i] = turned
    return sums


def fourier_coefficients(
    waves: NDArray[np.float64],
    time: NDArray[np.float64],
    weight: NDArray[np.float64],
    first: NDArray[np.int64],
    duration: float,
    count: int,
) -> NDArray[np.complex128]:
    """Return the Fourier coefficients 0..count of a period of ``duration`` s, shape (sensors, count + 1).

    ``waves`` (periods, values, 2): of several periods the powers are averaged, the last gives the phases. ``time``,
    ``weight`` and ``first`` are those of ``models.dynamics.six_dof.BallPeriod``.
    """
    parts = lines(waves[-1], weight, time, first, duration, count)
    coefficients = parts[:, 0] + 1j * parts[:, 1]
    if len(waves) > 1:
        every = [lines(wave, weight, time, first, duration, count) for wave in waves]
        power = np.mean([np.sum(part * part, axis=1) for part in every], axis=0)
        size = np.abs(coefficients)
        coefficients = np.sqrt(power) * np.where(size > 0.0, coefficients / np.where(size > 0.0, size, 1.0), 1.0)
    return coefficients


@kernel
def settle_row(
    paths: NDArray[np.float64],
    profile: NDArray[np.float64],
    felt: NDArray[np.bool_],
    positions: NDArray[np.float64],
    rows: NDArray[np.int64],
    offsets: NDArray[np.float64],
    pitch: float,
    steps: int,
    omega: float,
    linear: NDArray[np.float64],
    parameter: NDArray[np.float64],
    scale: NDArray[np.float64],
    steering: NDArray[np.float64],
    tolerance: float,
    cap: int,
    low: int,
    high: int,
    out: NDArray[np.float64],
) -> None:
    """Write RMS, its last relative change, whether it settled, periods and harmonics of the casing for each defect.

    Each search begins at rest, so that the result of a defect does not depend on its neighbours.

    - ``paths`` (defects, DEFECT): one defect a row, and ``profile`` their floor: see models.kernels.path;
    - ``felt`` (defects,), bool: which of them a ball can feel at all;
    - ``positions`` to ``linear``: see models.kernels.period_setup.set_up;
    - ``parameter`` to ``cap``: see ``settle``;
    - ``low``, ``high``: first and last line of the band of the RMS; ``high`` less than ``low`` is the full bandwidth;
    - ``out`` (defects, RESULT + harmonics), written, m/s2: see the R_ constants; amplitudes of the first lines follow.
    """
    duration = pitch / omega
    harmonics = out.shape[1] - RESULT
    rest, state = np.zeros((2, 6)), np.empty((2, 6))
    for i in range(paths.shape[0]):
        first, flow, part, turn, advance, damaged, plain, near, depth, rate, time, weight = set_up(
            paths[i], profile, positions, rows, offsets if felt[i] else offsets[:0], pitch, steps, omega, linear
        )
        wave = np.empty((time.shape[0], 2))
        periods, change, rms, settled = settle(
            rest,
            state,
            wave,
            first,
            flow,
            part,
            turn,
            advance,
            damaged,
            plain,
            near,
            depth,
            rate,
            parameter,
            weight,
            scale,
            steering,
            tolerance,
            cap,
        )
        found = lines(wave, weight, time, first, duration, max(harmonics, high))
        out[i, R_RMS] = _band_rms(found, low, high) if high >= low else rms
        out[i, R_CHANGE], out[i, R_PERIODS] = change, periods
        out[i, R_SETTLED] = 1.0 if settled else 0.0
        for k in range(harmonics):
            out[i, RESULT + k] = 2.0 * math.sqrt(found[0, 0, k + 1] ** 2 + found[0, 1, k + 1] ** 2)


@kernel
def _band_rms(found: NDArray[np.float64], low: int, high: int) -> float:
    """Return the RMS of the casing's lines from ``low`` to ``high``."""
    power = 0.0
    for k in range(low, high + 1):
        power += found[0, 0, k] ** 2 + found[0, 1, k] ** 2
    return math.sqrt(2.0 * power)
