"""Kernel that settles many defects of one operating point, without the interpreter between them.

Arguments of ``settle_row``:

- ``paths`` (defects, DEFECT): one defect a row, and ``profile`` their floor: see models.kernels.path;
- ``felt`` (defects,), bool: which of them a ball can feel at all;
- ``positions`` to ``linear``: see models.kernels.period_setup.set_up;
- ``parameter`` to ``cap``: see models.kernels.orbit.settle;
- ``low``, ``high``: first and last line of the band of the RMS; ``high`` less than ``low`` means the full bandwidth;
- ``out`` (defects, RESULT + harmonics), written, m/s2: see the R_ constants; amplitudes of the first lines follow.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from models.kernels.jit import kernel
from models.kernels.lines import lines
from models.kernels.orbit import settle
from models.kernels.period_setup import set_up

if TYPE_CHECKING:
    from numpy.typing import NDArray

# Places in a row of ``out``.
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

    See the module for the arguments. Each search begins at rest: what comes out does not depend on its neighbours.
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
