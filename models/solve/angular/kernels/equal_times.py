"""Sensors at equal times from those at the steps of a motion that goes on by equal angles."""

from __future__ import annotations

from typing import TYPE_CHECKING

from models.platform.jit import inlined

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

# Columns of the wave: angular speed less the nominal one, accelerations of A, B and disc.
SENSORS = 4
# Nodes of the interpolation from equal angles to equal times.
NODES = 6


@inlined
def _interpolate(t: float, node: NDArray[np.float64], row: NDArray[np.float64]) -> None:
    """Write the sensors at a time from those at NODES times, first column of ``node``, by Lagrange's polynomial."""
    for k in range(SENSORS):
        row[k] = 0.0
    for i in range(NODES):
        weight = 1.0
        for j in range(NODES):
            if j != i:
                weight *= (t - node[j, 0]) / (node[i, 0] - node[j, 0])
        for k in range(SENSORS):
            row[k] += weight * node[i, 1 + k]


@inlined
def write_wave(written: int, steps: int, h: float, wave: NDArray[np.float64], node: NDArray[np.float64]) -> int:
    """Write what the nodes allow after so many steps, by times up to their middle; return how many rows there are."""
    # At the beginning those before the middle too.
    while steps >= NODES and written < wave.shape[0] and written * h <= node[NODES // 2, 0]:
        _interpolate(written * h, node, wave[written])
        written += 1
    return written
