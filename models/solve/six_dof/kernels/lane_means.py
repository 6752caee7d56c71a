"""Kernels of means over a block of many scenes at once; arrays as in ``lanes`` and ``lane_instants``.

Steps that were taken again enter by their integrals, runs of others by the trapezoid rule with the slopes at their ends
(Euler and Maclaurin): rules that take slopes from differences are too coarse where the resonator has few steps a cycle.
A block is taken to repeat.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from models.platform.jit import kernel
from models.solve.six_dof.kernels.lane_instants import LANES

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from models.solve.six_dof.kernels.lane_instants import Splitting


@kernel
def mean_squares(wave: NDArray[np.float64], out: NDArray[np.float64]) -> None:
    """Write the mean over the steps of the squares of ``wave`` to ``out`` (2, L)."""
    out[:] = 0.0
    for n in range(wave.shape[0]):
        for sensor in range(2):
            for i in range(LANES):
                out[sensor, i] += wave[n, sensor, i] * wave[n, sensor, i]
    out /= wave.shape[0]


@kernel
def weigh(
    wave: NDArray[np.float64], split: Splitting, h: float, terms: NDArray[np.float64], out: NDArray[np.float64]
) -> None:
    """Write the mean squares of a block to ``out`` (2, L), and to ``terms`` (4, n, 2, L) what its lines are made of.

    They are the weighted values; of steps that were taken again the mean, and the first moment about the middle, s; and
    the share, s, that the slope of a line itself has at the ends of runs (models.solve.six_dof.lane_group).
    """
    steps = wave.shape[0]
    terms[1:] = 0.0
    out[:] = 0.0
    for n in range(steps):
        before = (n + steps - 1) % steps
        for i in range(LANES):
            weight = (0.0 if split.changed[before, i] else 0.5) + (0.0 if split.changed[n, i] else 0.5)
            for sensor in range(2):
                terms[0, n, sensor, i] = weight * wave[n, sensor, i]
                out[sensor, i] += weight * wave[n, sensor, i] * wave[n, sensor, i]
    for n in range(steps):
        for i in range(LANES):
            if split.changed[n, i]:
                _add_parts(n, i, wave, split, h, terms, out)
    out /= steps
    for sensor in range(2):
        for i in range(LANES):
            out[sensor, i] = max(out[sensor, i], 0.0)


@kernel
def _add_parts(
    n: int,
    i: int,
    wave: NDArray[np.float64],
    split: Splitting,
    h: float,
    terms: NDArray[np.float64],
    out: NDArray[np.float64],
) -> None:
    """Add step ``n`` of lane i, which was taken again, and the slopes at its ends where runs end or begin there."""
    steps = wave.shape[0]
    for sensor in range(2):
        terms[1, n, sensor, i] = split.parts[n, i, sensor] / h
        terms[2, n, sensor, i] = split.parts[n, i, 4 + sensor] / h
        out[sensor, i] += split.parts[n, i, 2 + sensor] / h
        for end in range(2):
            beside, at = (n + steps - 1) % steps if end == 0 else (n + 1) % steps, (n + end) % steps
            if not split.changed[beside, i]:
                share = (-1.0 if end == 0 else 1.0) * h / 12.0
                value, slope = wave[at, sensor, i], split.slopes[n, i, end, sensor]
                terms[0, at, sensor, i] += share * slope
                terms[3, at, sensor, i] -= share * value
                out[sensor, i] += 2.0 * share * value * slope
