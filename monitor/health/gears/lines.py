"""Lines that the wheels of a gear train put into the envelope, and families of a bearing that are no more than these.

What swells once in a turn of a wheel makes a comb of its turns, and sums and differences with the turns of the
bearing's shaft. With ratios of small numbers these are combs of their own: 30 and 50 teeth put lines at every fifth of
a turn, of which every second one is where a cage may be.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from monitor.health.spectrum.family import FaultLines

MIN_CAGE_SPACING_BINS = 24.0
"""Bins between the lines of a cage beside gears: among their many lines, closer ones stand on some by accident."""
MULTIPLES = 3
"""Multiples of the turns of a wheel that a family may not be where the speed is not known."""
_STEPS = 2
_NEAR_BINS, _NEAR_SD = 0.5, 2.0
"""How far a line of a family may be from one of a wheel that explains it."""
_EXPLAINED = 3
"""Lines of a family that are of wheels, from which the family is."""


def beside_wheels(
    families: Mapping[str, FaultLines],
    speed: float,
    turns: Sequence[float],
    resolution: float,
    *,
    sd: float | None,
    tolerance: float,
) -> dict[str, FaultLines]:
    """Return the families that cannot be lines of wheels; arguments as of :func:`is_of_wheels`."""
    least = MIN_CAGE_SPACING_BINS * resolution
    return {
        name: found
        for name, found in families.items()
        if not (name == "cage" and found.fundamental < least)
        and not is_of_wheels(found, speed, turns, resolution, sd=sd, tolerance=tolerance)
    }


def is_of_wheels(
    found: FaultLines, speed: float, turns: Sequence[float], resolution: float, *, sd: float | None, tolerance: float
) -> bool:
    """Tell whether the comb of a family can be that of wheels.

    Args:
        found: lines of the family.
        speed: of the bearing's shaft, Hz.
        turns: of the wheels, in one turn of it.
        resolution: of the spectrum, Hz.
        sd: standard deviation of a speed that was found, Hz; None where the speed is a stated one.
        tolerance: relative error of that.
    """
    wheels = [turn for turn in turns if abs(turn - 1.0) > 1e-6]
    if not wheels:
        return False
    if sd is None:
        width = max(tolerance, 0.5 * resolution / found.fundamental)
        multiples = [k * turn * speed for k in range(1, MULTIPLES + 1) for turn in wheels]
        return any(abs(found.fundamental / line - 1.0) <= width for line in multiples)
    lines = found.fundamental * np.arange(1.0, found.amplitude.size + 1.0)
    of_wheels = np.concatenate([_lines_of(turn, float(lines[-1]) / speed + 1.0) for turn in wheels]) * speed
    distance = np.abs(lines[:, None] - of_wheels)
    near = distance <= _NEAR_BINS * resolution + _NEAR_SD * sd / speed * of_wheels
    return int(near.any(axis=1).sum()) >= _EXPLAINED


def _lines_of(turn: float, highest: float) -> NDArray[np.float64]:
    """Return the lines of a wheel up to an order of the shaft, in no order."""
    own = turn * np.arange(1.0, np.ceil(highest / turn) + 1.0)
    shaft = np.arange(0.0, np.ceil(highest) + 1.0)
    steps = np.arange(1.0, _STEPS + 1.0) * turn
    both = [np.abs(np.add.outer(shaft, sign * steps)).ravel() for sign in (-1.0, 1.0)]
    return np.concatenate([own, *both])
