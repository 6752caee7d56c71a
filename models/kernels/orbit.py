"""Kernel that finds the motion that repeats: Anderson acceleration of the period map (see models.dynamics.orbit)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from models.kernels.jit import kernel
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


@kernel
def anderson(xs: NDArray[np.float64], fs: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Return the next iterate from the last ``count`` iterates (rows, oldest first) and their residuals.

    Least squares by modified Gram-Schmidt on differences of residuals, the latest first; one that depends on later ones
    is left out.
    """
    size = xs.shape[1]
    last = count - 1
    x = xs[last] + fs[last]
    rest = fs[last].copy()
    basis = np.empty((DEPTH, size))
    # The same combinations of the differences of x + f that made the basis from those of f.
    images = np.empty((DEPTH, size))
    kept = 0
    for k in range(last, 0, -1):
        v = fs[k] - fs[k - 1]
        w = v + (xs[k] - xs[k - 1])
        norm = math.sqrt(np.sum(v * v))
        for i in range(kept):
            share = np.sum(basis[i] * v)
            v -= share * basis[i]
            w -= share * images[i]
        left = math.sqrt(np.sum(v * v))
        if left <= _DEPENDENT * norm:
            continue
        v /= left
        w /= left
        share = np.sum(v * rest)
        rest -= share * v
        x -= share * w
        basis[kept], images[kept] = v, w
        kept += 1
    return x


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

    Returns:
        Periods simulated, relative change and value of the RMS of the last, and whether it has settled.
    """
    x, image = np.zeros(12), np.zeros(12)
    here, after = np.empty((2, 6)), np.empty((2, 6))
    xs, fs = np.empty((DEPTH + 1, 12)), np.empty((DEPTH + 1, 12))
    for i in range(12):
        x[i] = begin[i // 6, i % 6] / scale[i]
    known, calm = 0, 0
    change, rms = math.inf, math.nan
    for period in range(1, cap + 1):
        for i in range(12):
            here[i // 6, i % 6] = x[i] * scale[i]
        status = ball_period(
            here, after, wave, first, flow, part, turn, advance, damaged, plain, near, depth, rate, parameter
        )
        state[:] = here
        if status != STATUS_OK:
            # The extrapolation left the basin: begin again at rest, plainly.
            x[:] = 0.0
            known, calm, change, rms = 0, 0, math.inf, math.nan
            continue
        level = math.sqrt(mean_square(wave, weight, 0))
        quiet = level <= SILENCE and not rms > SILENCE
        change = 0.0 if quiet else abs(level - rms) / max(level, SILENCE)
        if not math.isfinite(change):
            change = math.inf
        calm = calm + 1 if change < tolerance else 0
        rms = level
        if calm >= 2:
            return period, change, rms, True
        for i in range(12):
            image[i] = after[i // 6, i % 6] / scale[i]
        if known == DEPTH + 1:
            for k in range(DEPTH):
                xs[k], fs[k] = xs[k + 1], fs[k + 1]
            known = DEPTH
        residual = image - x
        xs[known] = x
        for i in range(12):
            fs[known, i] = np.sum(steering[i] * residual)
        known += 1
        # Residuals of rounding errors point nowhere.
        rounding = np.max(np.abs(residual)) < RESIDUAL_FLOOR * np.max(np.abs(image))
        x = image.copy() if period <= PLAIN_FIRST or rounding else anderson(xs, fs, known)
    return cap, change, rms, False
