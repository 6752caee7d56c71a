"""Slow and obvious: the least volume on a level of a bilinear map, by scanning every cell along fine lines.

Along a line of constant extent (or depth) inside a cell the map is linear, so its crossing with the level is exact;
only the lines themselves are discrete. Within a cell a level curve is monotone, so next to any point of it the scan
has one that is at most one line away in either direction, which bounds by how much the scan can miss the least volume.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

Axis = NDArray[np.float64]


def scan_least_volume(
    dphi_d: Axis,
    h_d: Axis,
    rms: Axis,
    radius: float,
    level: float,
    corner: tuple[float, float],
    lines: int = 40,
) -> tuple[float, float]:
    """Least volume of the points with RMS ``level`` in the quadrant above ``corner``, and how far off it may be.

    Args:
        dphi_d: extents, shape (n,), rad.
        h_d: depths, shape (m,), m.
        rms: map, shape (m, n), m/s2.
        radius: radius of the outer race, m.
        level: RMS, m/s2.
        corner: least extent in rad and least depth in m.
        lines: lines per cell and direction.

    Returns:
        The least volume found, m2 (infinite where there is none), and the most by which it can be above the true one.
    """
    best = math.inf
    slack = 0.0
    for i in range(dphi_d.size - 1):
        for j in range(h_d.size - 1):
            if np.isnan(rms[j : j + 2, i : i + 2]).any():
                continue
            x0, x1 = max(float(dphi_d[i]), corner[0]), float(dphi_d[i + 1])
            y0, y1 = max(float(h_d[j]), corner[1]), float(h_d[j + 1])
            if x0 > x1 or y0 > y1:
                continue
            for x, y in _crossings(dphi_d, h_d, rms, (i, j), (x0, x1, y0, y1), level, lines):
                if radius * x * y < best:
                    best = radius * x * y
            slack = max(slack, radius * ((x1 - x0) * y1 + (y1 - y0) * x1) / lines)
    return best, slack


def _crossings(
    dphi_d: Axis,
    h_d: Axis,
    rms: Axis,
    cell: tuple[int, int],
    box: tuple[float, float, float, float],
    level: float,
    lines: int,
) -> Iterator[tuple[float, float]]:
    def value(x: float, y: float) -> float:
        i, j = cell
        u = (x - float(dphi_d[i])) / float(dphi_d[i + 1] - dphi_d[i])
        v = (y - float(h_d[j])) / float(h_d[j + 1] - h_d[j])
        (a, b), (c, d) = rms[j, i : i + 2], rms[j + 1, i : i + 2]
        return float((1 - u) * (1 - v) * a + u * (1 - v) * b + (1 - u) * v * c + u * v * d)

    rounding = 1e-12 * float(np.nanmax(np.abs(rms)))

    def fraction(start: float, end: float) -> Iterator[float]:
        on_start, on_end = abs(start - level) <= rounding, abs(end - level) <= rounding
        if on_start:
            yield 0.0
        if on_end:
            yield 1.0
        if not (on_start or on_end) and (start < level) != (end < level):
            yield (level - start) / (end - start)

    x0, x1, y0, y1 = box
    for k in range(lines + 1):
        x = x0 + (x1 - x0) * k / lines
        for share in fraction(value(x, y0), value(x, y1)):
            yield x, y0 + share * (y1 - y0)
        y = y0 + (y1 - y0) * k / lines
        for share in fraction(value(x0, y), value(x1, y)):
            yield x0 + share * (x1 - x0), y
