"""When a shaft had turned so far, where its phase is a cubic between knots, continuous with its slope."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
_NEWTON_STEPS = 40


def time_of_turns(
    wanted: ArrayLike,
    knots: tuple[Floats, Floats, Floats],
    evaluate: Callable[[Floats], tuple[Floats, Floats]],
    *,
    duration: float,
    settled: float,
) -> Floats:
    """Return the times of some revolutions, s, by Newton's method within a piece; the shape is that of the revolutions.

    Args:
        wanted: revolutions, any shape.
        knots: time (s), revolutions and speed (Hz), each (knot,); beyond them the speed stays.
        evaluate: revolutions and speed at some times.
        duration: s.
        settled: it ends where no time moves by more than this share of the duration, or of the latest time.
    """
    turns = np.asarray(wanted, dtype=np.float64)
    time, phase, speed = knots
    found = np.interp(turns, phase, time)
    found = np.where(turns < phase[0], time[0] + (turns - phase[0]) / speed[0], found)
    found = np.where(turns > phase[-1], time[-1] + (turns - phase[-1]) / speed[-1], found)
    piece = np.searchsorted(phase, turns, side="right")
    low, high = np.concatenate(([-np.inf], time))[piece], np.concatenate((time, [np.inf]))[piece]
    for _ in range(_NEWTON_STEPS):
        at, slope = evaluate(found)
        following = np.clip(found - (at - turns) / slope, low, high)
        moved = np.max(np.abs(following - found), initial=0.0)
        found = following
        if moved <= settled * max(duration, float(np.max(np.abs(found), initial=0.0))):
            break
    return found
