"""The score that a healthy block exceeds at a stated rate, and what it costs to listen to several parts.

Of the lines of several parts the highest excess z counts. Any of m may be the one that chance lifts, however they
depend on each other (the lines of two parts can share bins, all share a floor): P(max z > x) <= m Q(x), with Q the
upper tail of the normal distribution. So z gives up 2 ln m of its square,

    g = sqrt(max(z^2 - 2 ln m, 0)),    m Q(z) <= Q(g),

since Q(x) = phi(x) M(x), phi(g) = m phi(z), and Mills' ratio M falls: g exceeds any value at most as often as one
standard normal excess does, and the threshold is that of the level and one family of lines.
"""

from __future__ import annotations

import math
from functools import cache


def one_of(excess: float, count: int) -> float:
    """Return what the highest of ``count`` standardised excesses is worth as the only one, at least 0."""
    if count <= 1 or excess <= 0.0:
        return max(excess, 0.0)
    return math.sqrt(max(excess * excess - 2.0 * math.log(count), 0.0))


def exceedance_rate(threshold: float, groups: int = 2) -> float:
    """Return how often the score of a healthy block exceeds ``threshold`` (positive).

    The score is the length of ``groups`` independent standard normal excesses, negative ones set to zero: the number of
    positive ones is binomial, and the length of k of them has the chi distribution of k degrees of freedom.
    """
    return sum(math.comb(groups, k) * _chi_tail(threshold, k) for k in range(1, groups + 1)) / 2.0**groups


def _chi_tail(x: float, freedom: int) -> float:
    """Return the upper tail of the chi distribution, in closed form."""
    half = 0.5 * x * x
    if freedom % 2:
        total, term = math.erfc(x / math.sqrt(2.0)), math.sqrt(2.0 / math.pi) * x * math.exp(-half)
        for k in range(3, freedom + 1, 2):
            total, term = total + term, term * x * x / k
        return total
    total = term = math.exp(-half)
    for k in range(1, freedom // 2):
        term *= half / k
        total += term
    return total


@cache
def threshold_for(false_alarms_per_1000_blocks: float, groups: int = 2) -> float:
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
        low, high = (middle, high) if exceedance_rate(middle, groups) > rate else (low, middle)
    return 0.5 * (low + high)
