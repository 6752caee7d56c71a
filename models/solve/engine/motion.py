"""A motion over time as a model gives it: accelerations from the beginning, with steps of any length.

Its first sensor is the one whose errors are stated.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from models.solve.response import row_of
from models.words.request import Sensor

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.machine.speed_profile import SpeedProfile

# A smaller vibration counts as zero, m/s2.
SILENCE = 1e-9

FromRest = Callable[[int, int], tuple["NDArray[np.float64]", bool]]


@dataclass(frozen=True, eq=False)
class Motion:
    """One scene over one time, with steps of any length that a sample has a whole number of.

    Attributes:
        from_rest: returns, for a number of steps and the steps a sample, the accelerations at the beginning of each
            step from t = 0 on, (steps, sensors), and whether they are finite.
        sensors: of the columns of what it returns.
        model, solver: what answers.
        bpfo: ball-pass frequency over the outer race, Hz.
        block: duration of a block, s: the slowest of the periods with which the level swings.
        settle: time that is simulated before and dropped, s.
        repeats: whether nothing but the passages of the balls drives the motion.
        passages: rate at which balls pass the defect, Hz, whose lines a request may ask for; None is BPFO.
        build_up: time from the beginning, s, before which the error of the steps is not looked at: modes that ring
            have not gathered theirs yet.
        profile: how the shaft turns from the first sample of the response on.
        per_turn: balls that pass the outer race in a turn, where the speed changes; None where it is one.
    """

    from_rest: FromRest
    sensors: tuple[Sensor, ...]
    model: str
    solver: str
    bpfo: float
    block: float
    settle: float
    repeats: bool
    passages: float | None = None
    build_up: float = 0.0
    profile: SpeedProfile | None = None
    per_turn: float | None = None

    def led_by(self, sensor: Sensor | None) -> Motion:
        """Return the motion with a sensor as the first, None for the first as it is."""
        if sensor is None or sensor == self.sensors[0]:
            return self
        row = row_of(self.sensors, sensor)
        order = [row, *(k for k in range(len(self.sensors)) if k != row)]

        def from_rest(steps: int, oversampling: int) -> tuple[NDArray[np.float64], bool]:
            wave, finite = self.from_rest(steps, oversampling)
            return np.ascontiguousarray(wave[:, order]), finite

        return replace(self, from_rest=from_rest, sensors=tuple(self.sensors[k] for k in order))
