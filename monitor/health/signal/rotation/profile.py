"""The angle of a shaft from a signal of its speed over time."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from monitor.health.signal.rotation.banded import spline_slopes
from monitor.health.signal.rotation.fit import limited
from monitor.health.signal.rotation.rotation import Rotation

GAIN_SD = 1e-3
"""Relative standard deviation of the calibration of a speed signal, which the signal itself does not show."""
_PIECES, _SAMPLES_A_PIECE, _MIN_PIECES = 256, 8, 4
_STOPPED = 0.02
"""A part of the block below this share of the highest speed stands still."""


def rotation_of_speed(speed: NDArray[np.floating], rate: float) -> tuple[Rotation | None, str]:
    """Return the angle of a shaft over a block and "ok", or None and why there is none.

    The signal is integrated; the knots of the angle are the ends of up to 256 equal pieces.

    Args:
        speed: shape (sample,), Hz.
        rate: Hz.
    """
    pieces = min(_PIECES, speed.size // _SAMPLES_A_PIECE)
    if pieces < _MIN_PIECES:
        return None, "too_few"
    if not (np.isfinite(speed.min()) and np.isfinite(speed.max())):
        return None, "irregular"
    sums = np.cumsum(speed, dtype=np.float64)
    at = np.rint(np.linspace(0, speed.size - 1, pieces + 1)).astype(np.intp)
    turns = (sums[at] - 0.5 * (speed[at].astype(np.float64) + float(speed[0]))) / rate
    time = at / rate
    mean = np.diff(turns) / np.diff(time)
    highest = float(mean.max())
    if highest <= 0.0 or float(mean.min()) < -_STOPPED * highest:
        return None, "stopped" if highest == 0.0 and not np.any(mean) else "reversed"
    if float(mean.min()) < _STOPPED * highest:
        return None, "stopped"
    slopes = limited(time, turns, spline_slopes(time, turns))
    noise = float(np.sqrt(np.mean(np.square(np.diff(mean, 2))) / 6.0))
    duration = speed.size / rate
    overall = (turns[-1] - turns[0]) / time[-1]
    return Rotation(
        time,
        turns,
        slopes,
        duration,
        "profile",
        turns_sd=noise * duration / pieces * math.sqrt(pieces / 6.0),
        speed_sd=math.hypot(noise / math.sqrt(pieces) / overall, GAIN_SD),
    ), "ok"
