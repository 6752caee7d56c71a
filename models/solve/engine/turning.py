"""What turns in a motion over time: when a profile of the speed begins, lines over the angle, passages."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from models.machine.bearing import kinematics
from models.solve.engine.recorder import margin_of
from models.solve.response import HARMONICS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.machine.scene import Scene
    from models.machine.speed_profile import SpeedProfile
    from models.solve.response import SignalRecord

# What the filter of a recorder may reach beyond the margin of the fewest steps a sample, samples.
_MORE = 2


def lead_in(settle: float, rate: float) -> float:
    """Return the time before the first sample of a response, s, a whole number of samples: at least that to settle."""
    return max(margin_of(2) + _MORE, math.ceil(settle * rate)) / rate


def lines_over_angle(record: SignalRecord, profile: SpeedProfile, per_turn: float) -> NDArray[np.complex128]:
    """Return the Fourier coefficients 0..HARMONICS at multiples of some events a turn, through a Hann window.

    The Fourier integral is over the angle; as ``SignalRecord.coefficients`` else. Shape (sensors, HARMONICS + 1).
    """
    time: NDArray[np.float64] = np.arange(record.signal.shape[1], dtype=np.float64) / record.rate
    turns = profile.turns_at(time)
    share = (turns - turns[0]) / max(turns[-1] - turns[0], 1e-300)
    weight = np.sin(math.pi * share) ** 2 * profile.speed_at(time)
    weight = weight / max(float(weight.sum()), 1e-300)
    # The angle is reduced to one event before it is multiplied, so that long signals lose no digits.
    angle = np.mod(turns * per_turn, 1.0)
    waves = np.exp(-2j * np.pi * np.outer(np.arange(HARMONICS + 1), angle))
    return (record.signal * weight) @ waves.T


def passage_rate(scene: Scene) -> float:
    """Return the rate at which balls pass the first defect of a scene, Hz; BPFO where it has none."""
    part, bearing = "outer", scene.bearing
    if scene.defect is not None:
        part = scene.defect.part
        if scene.defect.support == "b" and scene.second_bearing is not None:
            bearing = scene.second_bearing
    lines = kinematics(bearing, scene.speed)
    return {"outer": lines.bpfo, "inner": lines.bpfi, "ball": 2.0 * lines.bsf}[part]
