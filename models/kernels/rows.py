"""Kernel that settles many defects of one operating point, without the interpreter between them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from models.kernels.jit import kernel
from models.kernels.lines import lines
from models.kernels.orbit import settle
from models.kernels.tables import set_up

if TYPE_CHECKING:
    from numpy.typing import NDArray

# Places in a row of ``out``; the amplitudes of the harmonics follow.
R_RMS = 0
R_CHANGE = 1
R_SETTLED = 2
R_PERIODS = 3
RESULT = 4


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

    Each begins at rest, so that what comes out does not depend on what stands beside it.

    Args:
        paths: one defect a row (models.kernels.path); ``profile`` is their floor.
        profile: see there.
        felt: which of them a ball can feel at all.
        positions: to ``linear``: see models.kernels.tables.set_up.
        rows: see there.
        offsets: see there.
        pitch: see there.
        steps: see there.
        omega: see there.
        linear: see there.
        parameter: to ``cap``: see models.kernels.orbit.settle.
        scale: see there.
        steering: see there.
        tolerance: see there.
        cap: see there.
        low: first line of the band of the RMS.
        high: its last line; less than ``low`` means the full bandwidth.
        out: shape (defects, RESULT + harmonics), written; m/s2.
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
        if high >= low:
            rms = 0.0
            for k in range(low, high + 1):
                rms += found[0, 0, k] ** 2 + found[0, 1, k] ** 2
            rms = math.sqrt(2.0 * rms)
        out[i, R_RMS], out[i, R_CHANGE], out[i, R_PERIODS] = rms, change, periods
        out[i, R_SETTLED] = 1.0 if settled else 0.0
        for k in range(harmonics):
            out[i, RESULT + k] = 2.0 * math.sqrt(found[0, 0, k + 1] ** 2 + found[0, 1, k + 1] ** 2)
