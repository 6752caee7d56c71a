"""Blocks of a stream the obvious way: put each gapless run together whole, then slice it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def blocks_of_runs(runs: list[NDArray[np.float64]], length: int) -> list[tuple[int, int, NDArray[np.float64], bool]]:
    """Slice runs into blocks.

    Args:
        runs: arrays of shape (channel, sample), between which there are gaps.
        length: samples of a block.

    Returns:
        Number of the run, index of the first sample in it, samples, and whether it is a block rather than too short.
    """
    found = []
    for number, run in enumerate(runs):
        for begin in range(0, run.shape[1], length):
            part = run[:, begin : begin + length]
            found.append((number, begin, part, part.shape[1] >= 0.9 * length))
    return found
