"""Lines that the wheels of a gear train put into the envelope, and families of a bearing that are no more than these.

What swells once in a turn of a wheel makes a comb of its turns, and sums and differences with the turns of the
bearing's shaft. With ratios of small numbers these are combs of their own: 30 and 50 teeth put lines at every fifth of
a turn, of which every second one is where a cage may be.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from monitor.health.signal.comb import FaultLines

MIN_CAGE_SPACING_BINS = 24.0
"""Bins between the lines of a cage beside gears: among their many lines, closer ones stand on some by accident."""
MULTIPLES = 3
"""Multiples of the turns of a wheel that a family may not be where the speed is not known."""
_STEPS = 2
_NEAR_BINS, _NEAR_SD = 0.5, 2.0
"""How far a line of a family may be from one of a wheel that explains it."""
_EXPLAINED = 3
"""Lines of a family that must be of wheels for the family to be; all others must be of the shaft."""


@dataclass(frozen=True)
class Wheels:
    """Gear wheels beside a bearing.

    Attributes:
        turns: of the wheels, in a turn of the bearing's shaft.
        speed: of that shaft, Hz, as the signal shows it: by its own lines or by those of the mesh. Or as stated.
        sd: standard deviation of a speed that the signal shows, Hz; None where it is stated.
        tolerance: relative error of one that is stated.
    """

    turns: tuple[float, ...]
    speed: float
    sd: float | None
    tolerance: float

    def leave(self, families: Mapping[str, FaultLines], resolution: float) -> dict[str, FaultLines]:
        """Return the families that cannot be lines of wheels, nor those of a cage too close together beside gears."""
        least = MIN_CAGE_SPACING_BINS * resolution if self.turns else 0.0
        return {
            name: found
            for name, found in families.items()
            if not (name == "cage" and found.fundamental < least) and not self.explain(found, resolution)
        }

    def explain(self, found: FaultLines, resolution: float) -> bool:
        """Tell whether the comb of a family can be that of wheels; ``resolution`` of the spectrum, Hz."""
        wheels = [turn for turn in self.turns if abs(turn - 1.0) > 1e-6]
        if not wheels:
            return False
        if self.sd is None:
            width = max(self.tolerance, 0.5 * resolution / found.fundamental)
            multiples = [k * turn * self.speed for k in range(1, MULTIPLES + 1) for turn in wheels]
            return any(abs(found.fundamental / line - 1.0) <= width for line in multiples)
        lines = found.fundamental * np.arange(1.0, found.amplitude.size + 1.0)
        highest = float(lines[-1]) / self.speed + 1.0
        of_wheels = np.concatenate([_lines_of(turn, highest) for turn in wheels]) * self.speed
        distance = np.abs(lines[:, None] - of_wheels)
        near = (distance <= _NEAR_BINS * resolution + _NEAR_SD * self.sd / self.speed * of_wheels).any(axis=1)
        orders = lines / self.speed
        of_shaft = (
            np.abs(orders - np.rint(orders)) * self.speed <= _NEAR_BINS * resolution + _NEAR_SD * self.sd * orders
        )
        return bool((near | of_shaft).all()) and int(near.sum()) >= _EXPLAINED


def _lines_of(turn: float, highest: float) -> NDArray[np.float64]:
    """Return the lines of a wheel up to an order of the shaft, in no order."""
    own = turn * np.arange(1.0, np.ceil(highest / turn) + 1.0)
    shaft = np.arange(0.0, np.ceil(highest) + 1.0)
    steps = np.arange(1.0, _STEPS + 1.0) * turn
    both = [np.abs(np.add.outer(shaft, sign * steps)).ravel() for sign in (-1.0, 1.0)]
    return np.concatenate([own, *both])
