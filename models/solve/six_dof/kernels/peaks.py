"""Kernel of the largest acceleration in a ball period, between the recorded values too."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from models.platform.jit import kernel

if TYPE_CHECKING:
    from numpy.typing import NDArray


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
