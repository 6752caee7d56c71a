"""The score that a healthy block exceeds at a stated rate."""

from __future__ import annotations

import math
from functools import cache


def exceedance_rate(threshold: float) -> float:
    """Return how often the score of a healthy block exceeds ``threshold``.

    The score is the length of two independent standard normal excesses, negative ones set to zero: of four blocks one
    has both, two have one, one has none.
    """
    both = 0.25 * math.exp(-0.5 * threshold * threshold)
    one = 0.5 * math.erfc(threshold / math.sqrt(2.0))
    return both + one


@cache
def threshold_for(false_alarms_per_1000_blocks: float) -> float:
    """Return the score that a healthy block exceeds at the stated rate.

    Raises:
        ValueError: the rate is not between 1e-9 and 500 per 1000 blocks.
    """
    rate = false_alarms_per_1000_blocks / 1000.0
    if not 1e-12 <= rate <= 0.5:
        raise ValueError(f"false_alarms_per_1000_blocks must be between 1e-9 and 500, got {rate * 1000:g}")
    low, high = 0.0, 10.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if exceedance_rate(middle) > rate else (low, middle)
    return 0.5 * (low + high)
