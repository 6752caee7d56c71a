"""The baseline of the healthy machine: learned once, then frozen; a running one would follow what is to be detected.

It is learned anew where the machine stays well below it for at least as long as all its life before: it was learned
while the machine still ran in, or at a duty that it left. A level that comes and goes never lasts so long.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import replace

from monitor.health.detect.state import (
    LINES,
    Baseline,
    BaselinePoint,
    DetectInput,
    DetectSettings,
    DetectState,
    Relearned,
    Spread,
)

_MAX_LEARNING_FACTOR = 3
"""Longest learning over its nominal length, while the machine runs in."""
_LEAST_POINTS = 10
"""A median and a spread need at least so many."""
_LEAST_SHARE = 0.5
"""Share of the points that must show the lines of a part."""


def learn(state: DetectState, block: DetectInput, settings: DetectSettings) -> DetectState:
    """Add the block to the baseline; freeze it when it has enough settled blocks."""
    if state.seen <= settings.run_in_blocks:
        return state
    learned = (*state.learned, block.point)
    state = replace(state, learned=learned)
    if not _enough(learned, settings):
        return state
    nominal = len(learned) + state.dropped
    if _is_falling(learned, settings) and nominal < _MAX_LEARNING_FACTOR * _nominal(settings, len(learned)):
        # Still running in: the first blocks do not represent the healthy machine.
        third = len(learned) // 3
        return replace(state, learned=learned[third:], dropped=state.dropped + third)
    return replace(state, learned=(), baseline=_freeze(learned))


def learn_lower(
    state: DetectState, block: DetectInput, settings: DetectSettings, *, below: bool
) -> tuple[DetectState, Relearned | None]:
    """Follow a level well below the baseline of a healthy machine; where it lasts, learn the baseline anew from it.

    Args:
        below: RMS of the block is well below the baseline. Fewer than ``persist_blocks`` that are not, such as knocks,
            do not end a level.
    """
    old, since = state.baseline, state.lower_since
    if old is None or (since is None and not below):
        return state, None
    if since is None:
        since = state.seen - 1
        state = replace(state, learned=())
    returned = 0 if below else state.returned + 1
    if returned >= settings.persist_blocks:
        return replace(state, lower_since=None, returned=0, learned=()), None
    learned = _latest((*state.learned, block.point), settings)
    state = replace(state, lower_since=since, returned=returned, learned=learned)
    lasted = state.seen - since >= since
    if not (lasted and below and _enough(learned, settings)) or _is_falling(learned, settings):
        return state, None
    new = _freeze(learned)
    said = Relearned(math.exp(old.ln_rms), math.exp(new.ln_rms))
    # A part that the new blocks do not show keeps what was learned of it.
    new = replace(new, lines={**old.lines, **new.lines})
    return replace(state, learned=(), lower_since=None, returned=0, baseline=new), said


def learn_lines(state: DetectState, block: DetectInput, settings: DetectSettings) -> DetectState:
    """Learn the lines that the baseline lacks and the block shows, of a healthy machine at its level.

    A baseline of an earlier version lacks all but those of the outer race.
    """
    point, baseline = block.point, state.baseline
    shown = {name for name, value in zip(LINES, point[2], strict=True) if value is not None}
    if baseline is None or not shown - set(baseline.lines):
        return state
    learned = (*state.learned, point)
    if not _enough(learned, settings):
        return replace(state, learned=learned)
    lines = {**_freeze(learned).lines, **baseline.lines}
    return replace(state, learned=(), baseline=replace(baseline, lines=lines))


def _nominal(settings: DetectSettings, count: int) -> int:
    return settings.learn_blocks if settings.learn_blocks is not None else count


def _enough(learned: Sequence[BaselinePoint], settings: DetectSettings) -> bool:
    if settings.learn_blocks is not None:
        return len(learned) >= settings.learn_blocks
    first, last = learned[0][0], learned[-1][0]
    if settings.learn_time is None or first is None or last is None:
        return False
    return last - first >= settings.learn_time and len(learned) >= _LEAST_POINTS


def _latest(learned: tuple[BaselinePoint, ...], settings: DetectSettings) -> tuple[BaselinePoint, ...]:
    """Return the latest points of which there are enough, or all."""
    if settings.learn_blocks is not None:
        return learned[-settings.learn_blocks :]
    return learned[1:] if _enough(learned[1:] or learned[:1], settings) else learned


def _is_falling(learned: Sequence[BaselinePoint], settings: DetectSettings) -> bool:
    """Tell whether RMS still falls: the median of the first third lies above that of the last by more than a drift."""
    third = len(learned) // 3
    if not third:
        return False
    early, late = ([rms for _, rms, _ in part] for part in (learned[:third], learned[-third:]))
    return statistics.median(early) - statistics.median(late) > settings.rms_drift


def _freeze(learned: Sequence[BaselinePoint]) -> Baseline:
    ln_rms, ln_rms_sd = median_and_sd([rms for _, rms, _ in learned])
    lines: dict[str, Spread] = {}
    for place, name in enumerate(LINES):
        found = [value for _, _, shown in learned if (value := shown[place]) is not None]
        if found and len(found) >= _LEAST_SHARE * len(learned):
            lines[name] = median_and_sd(found)
    return Baseline(ln_rms, ln_rms_sd, lines)


def median_and_sd(values: Sequence[float]) -> Spread:
    """Return the median and the robust standard deviation, 1.4826 times the median absolute deviation."""
    middle = statistics.median(values)
    return middle, 1.4826 * statistics.median(abs(value - middle) for value in values)
