"""Pulses that come so irregularly that single intervals do not tell marks: whether they can simply be counted."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from monitor.health.signal.rotation.banded import running_median

_GROUPS_A_TURN, _MIN_GROUP, _NEIGHBOURS = 8, 16, 9
_STEP = 0.5
"""A change of the interval by more than this many marks is that of a pulse which is missing or too many."""


def are_complete(times: NDArray[np.float64], per_revolution: int) -> bool:
    """Return whether no pulse is missing and none too many, as far as means over an eighth of a turn tell.

    Jitter averages out in them. A single fault within a block may not be seen: it puts the angle wrong by one mark.

    Args:
        times: shape (pulse,), s, rising.
        per_revolution: marks of a whole turn, all of them there.
    """
    group = per_revolution // _GROUPS_A_TURN
    groups = times.size // max(group, 1)
    if group < _MIN_GROUP or groups < 4 * _NEIGHBOURS:
        return False
    between = np.diff(times[: groups * group].reshape(groups, group).mean(axis=1))
    change = np.diff(between) / between[1:] * group
    return bool(np.max(np.abs(change - running_median(change, _NEIGHBOURS))) < _STEP)
