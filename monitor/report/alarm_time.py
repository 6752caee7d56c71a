"""The time to the alarm level in the records of a channel, after its last block that has one."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from monitor.report.runs import Channel
from monitor.words.numbers import acceleration, figure
from monitor.words.statuses import ALARM_LEVELS, TTA_REFUSALS


@dataclass(frozen=True)
class AlarmTime:
    """What the records say.

    Attributes:
        level: the level in words.
        refusal: why there is no time, "" where there is one.
        time: s, with ``lower`` and ``upper``; NaN without one, the upper end also where it is open.
    """

    level: str
    refusal: str = ""
    reached: bool = False
    time: float = math.nan
    lower: float = math.nan
    upper: float = math.nan


def alarm_time(channel: Channel) -> AlarmTime | None:
    """Return the time to the alarm level, None where the records have none."""
    statuses = channel.word("tta_status")
    rows = np.flatnonzero(statuses != "")
    if not rows.size:
        return None
    row = int(rows[-1])
    status = str(statuses[row])
    time, lower, upper, level = (
        float(channel.column(name)[row]) for name in ("tta", "tta_lower", "tta_upper", "tta_level")
    )
    words = ALARM_LEVELS.get(str(channel.word("tta_level_source")[row]), "the alarm level")
    baseline = channel.baseline("rms")
    if math.isfinite(level) and channel.has_level:
        words += f", {acceleration(level)}"
    elif math.isfinite(level) and baseline > 0.0:
        words += f", {figure(level / baseline, 2)} times the baseline"
    if status == "reached":
        return AlarmTime(words, reached=True)
    if not math.isfinite(time):
        return AlarmTime(words, TTA_REFUSALS.get(status, status))
    return AlarmTime(words, time=time, lower=lower, upper=upper)
