"""Whether the lines of a signal read along an angle stand at their orders throughout the block.

The spectrum of the whole block gives the lines; in each short part of the block they must be found at the same orders,
and not somewhat above or below, where they stand in the parts in which a path has lost the shaft, or gained a turn.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from monitor.health.signal.plans import next_smooth
from monitor.health.signal.rotation.plane import surroundings

PART_TURNS, PART_HOP = 12.0, 4.0
"""Length of a part, and from one to the next, turns."""
MAX_LINES = 48
MIN_HEIGHT = 1.5
"""Lines that are looked for at most, and the least height of one over the whole block, ln of power."""
_APART, _REACH, _STEPS = 0.2, 4.0, 7
"""Orders by which the lines of another place stand apart, in the mean; the reach of the search and its steps, in it."""
_LEAST_APART, _MOST_APART = 0.02, 0.08
"""Limits of that shift, relative."""
_LEAST, _MOST = -1.0, 4.0
_SURROUNDINGS = 1.5
"""Limits of a line in a part, ln of power over its surroundings, and half their width, orders."""


def agreement(
    rows: NDArray[np.float32], per_turn: float, heights: tuple[NDArray[np.float64], ...], resolution: float
) -> NDArray[np.float64]:
    """Return how much higher the lines stand at their orders than at any shifted ones, in each part of a block.

    Args:
        rows: signal and envelope by angle, shape (2, sample).
        per_turn: samples per turn.
        heights: of the bins of both spectra over the whole block, each (bin,), ln of power over the floor.
        resolution: orders per bin.

    Returns:
        Mean height of the lines less that of the best shifted ones, shape (part,); empty where there are no lines.
    """
    lines = [_highest(height, resolution, 0.4 * per_turn) for height in heights]
    total = sum(float(weight.sum()) for _, weight in lines)
    if not total > 0.0:
        return np.zeros(0)
    points = round(PART_TURNS * per_turn)
    count = max(1, int((rows.shape[1] - points) / (PART_HOP * per_turn)) + 1)
    starts = np.rint(np.linspace(0.0, float(rows.shape[1] - points), count)).astype(np.intp)
    window = np.hanning(points + 2)[1:-1].astype(np.float32)
    n_fft = next_smooth(2 * points)
    spacing = per_turn / n_fft
    mean_order = sum(float(orders @ weight) for orders, weight in lines) / total
    apart = min(max(_APART / mean_order, _LEAST_APART), _MOST_APART)
    shifts = np.arange(-round(_REACH * _STEPS), round(_REACH * _STEPS) + 1) * (apart / _STEPS)
    score = np.zeros((count, shifts.size))
    for row, (orders, weight) in zip(rows, lines, strict=True):
        pieces = row[starts[:, None] + np.arange(points)] * window
        level = _levels(np.fft.rfft(pieces, n_fft, axis=1), round(_SURROUNDINGS / spacing))
        places = np.rint(np.outer(1.0 + shifts, orders) / spacing).astype(np.intp)
        score += level[:, np.minimum(places, level.shape[1] - 1)] @ weight
    score /= total
    here = score[:, np.abs(shifts) < 1.5 * apart / _STEPS].max(axis=1)
    return here - score[:, np.abs(shifts) > 0.99 * apart].max(axis=1)


def _highest(
    height: NDArray[np.float64], resolution: float, most: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return orders and heights of the highest lines up to an order."""
    inner = height[1:-1]
    top = (inner >= height[:-2]) & (inner > height[2:]) & (inner > MIN_HEIGHT)
    places = np.flatnonzero(top) + 1
    places = places[places * resolution < most / (1.0 + _REACH * _MOST_APART)]
    chosen = places[np.argsort(-height[places], kind="stable")[:MAX_LINES]]
    return chosen.astype(np.float64) * resolution, height[chosen]


def _levels(spectrum: NDArray[np.complexfloating], half: int) -> NDArray[np.float32]:
    """Return ln of the power of each bin over that of its surroundings, limited; shape (part, bin)."""
    level = np.log(np.square(np.abs(spectrum)) + np.finfo(np.float32).tiny)
    level -= surroundings(level, half)
    return np.clip(level, _LEAST, _MOST)
