"""Scores the slow and obvious way: integrals by many small steps, sums by loops, lines by numpy's own fit."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np


def distribution(levels: Sequence[float], row: Sequence[float], x: float) -> float:
    """F(x) of a row of quantiles: straight between them, all the rest at the outermost."""
    if x < row[0]:
        return 0.0
    if x >= row[-1]:
        return 1.0
    for p, q, p_next, q_next in zip(levels, row, levels[1:], row[1:], strict=False):
        if q <= x < q_next:
            return p + (p_next - p) * (x - q) / (q_next - q)
    raise AssertionError(x)


def crps_by_steps(levels: Sequence[float], row: Sequence[float], y: float, steps: int = 100_000) -> float:
    """The integral of the definition by the midpoint rule."""
    low, high = min(row[0], y), max(row[-1], y)
    if low == high:
        return 0.0
    width = (high - low) / steps
    points = low + width * (np.arange(steps) + 0.5)
    total = sum((distribution(levels, row, x) - (x >= y)) ** 2 for x in points.tolist())
    return total * width


def crps_of_pairs(sample: Sequence[float], weights: Sequence[float], y: float) -> float:
    """E|X - y| - E|X - X'| / 2 by two loops."""
    total = sum(weights)
    near = sum(w * abs(x - y) for x, w in zip(sample, weights, strict=True)) / total
    apart = sum(
        v * w * abs(x - z) for x, v in zip(sample, weights, strict=True) for z, w in zip(sample, weights, strict=True)
    )
    return near - 0.5 * apart / total**2


def convergence_by_steps(t: Sequence[float], error: Sequence[float], end: float, steps: int = 200_000) -> float:
    """Centroid of the area under the staircase of errors, by thin columns."""
    width = (end - t[0]) / steps
    points = t[0] + width * (np.arange(steps) + 0.5)
    place = np.searchsorted(np.asarray(t), points, side="right") - 1
    height = np.asarray(error)[place]
    area = float(height.sum())
    if area == 0.0:
        return 0.0
    return math.hypot(float((height * (points - t[0])).sum()) / area, float((0.5 * height**2).sum()) / area)


def horizon_by_looking(t: Sequence[float], good: Sequence[bool], end: float) -> float:
    """The horizon of the first forecast after which all are good, by trying each."""
    for i, moment in enumerate(t):
        if all(good[i:]):
            return end - moment
    return 0.0


def line_ahead(t: Sequence[float], v: Sequence[float], goal: float) -> float:
    """Time from the last moment to where numpy's straight line reaches the goal; NaN where it does not rise."""
    if len(set(t)) < 2:
        return math.nan
    centre = float(np.mean(t))
    slope, at_centre = np.polyfit(np.asarray(t) - centre, np.asarray(v), 1)
    return max(centre + (goal - at_centre) / slope - t[-1], 0.0) if slope > 0 else math.nan
