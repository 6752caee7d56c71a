"""Makers and checks that tests of reblock share."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from streams.reblock import Cut, Reblocker
from streams.types.samples import Samples


def cut_up(run: NDArray[np.float64], sizes: list[int]) -> list[tuple[int, NDArray[np.float64]]]:
    """Cut a run into pieces of the given sizes, the last one taking what is left."""
    pieces, begin = [], 0
    for size in sizes:
        if begin + size >= run.shape[1]:
            break
        pieces.append((begin, run[:, begin : begin + size]))
        begin += size
    return [*pieces, (begin, run[:, begin:])]


def flushed(cutter: Reblocker, chunks: list[Samples]) -> list[Cut]:
    return [cut for item in chunks for cut in cutter.feed(item)] + list(cutter.flush())
