"""Lines of several fault families that one spectrum cannot tell apart, such as 3 BPFO = 2 BPFI."""

from __future__ import annotations

from collections.abc import Mapping

from monitor.health.signal.settings import N_HARMONICS

WIDTH_BINS = 2.0
"""Two lines of a Hann-windowed signal that are closer are one peak."""

Line = tuple[str, int]
"""A family and the order of a line in it."""


def shared_lines(
    fundamentals: Mapping[str, float], resolution: float, orders: int = N_HARMONICS
) -> tuple[tuple[Line, ...], ...]:
    """Return the groups of lines of different families that stand on one peak, in the order of their frequency.

    Args:
        fundamentals: first line of each family, Hz; families whose first lines coincide share all of them.
        resolution: spacing of the bins, Hz.
        orders: lines of each family.
    """
    lines = [
        (order * first, family, order)
        for family, first in fundamentals.items()
        if first > 0.0
        for order in range(1, orders + 1)
    ]
    lines.sort(key=lambda line: line[0])
    groups: list[list[tuple[float, str, int]]] = []
    for line in lines:
        if groups and line[0] - groups[-1][-1][0] < WIDTH_BINS * resolution:
            groups[-1].append(line)
        else:
            groups.append([line])
    several = (group for group in groups if len({family for _, family, _ in group}) > 1)
    return tuple(tuple((family, order) for _, family, order in group) for group in several)
