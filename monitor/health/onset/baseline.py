"""The baseline of the healthy machine: learned once, then frozen; a running one would follow what is to be detected.

It is learned anew where the machine stays well below it for at least as long as all its life before: it was learned
while the machine still ran in, or at a duty that it left. A level that comes and goes never lasts so long.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import replace

from monitor.health.onset.dependence import Dependence, is_known, learn_dependence, steady_ranges, varying, widens
from monitor.health.onset.state import (
    HEALTHY,
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
_WIDER_SHARE = 0.2
"""Blocks at new conditions over points learned before, with which the dependence is learned wider."""
_SUSPECT = 2
"""Consecutive blocks above the threshold after which no other condition is learned: one can be a knock."""
_MAX_KEPT, _MAX_KEPT_STEADY = 200, 50
"""Points by which a dependence, or the lack of one, was learned that are kept."""


def learn(state: DetectState, block: DetectInput, settings: DetectSettings) -> DetectState:
    """Add the block to the baseline; freeze it when it has enough settled blocks."""
    if state.seen <= settings.run_in_blocks:
        return state
    learned = (*state.learned, block.point)
    state = replace(state, learned=learned)
    if not _enough(learned, settings):
        return state
    early = len(learned) + state.dropped < _MAX_LEARNING_FACTOR * _nominal(settings, len(learned))
    if early and _sees_new_conditions(learned, settings):
        return state
    if early and _is_falling(learned, settings):
        # Still running in: the first blocks do not represent the healthy machine.
        third = len(learned) // 3
        return replace(state, learned=learned[third:], dropped=state.dropped + third)
    return _with_baseline(state, _freeze(learned, settings), learned)


def _with_baseline(state: DetectState, baseline: Baseline, points: tuple[BaselinePoint, ...]) -> DetectState:
    """Return the state with a baseline, and the points by which it can be learned wider where levels depend."""
    most = _MAX_KEPT if baseline.by else _MAX_KEPT_STEADY if baseline.steady else 0
    while len(points) > most:
        points = points[::2] if most else ()
    return replace(state, learned=(), held=(), baseline=baseline, kept=points)


def learn_wider(state: DetectState, block: DetectInput, settings: DetectSettings) -> DetectState:
    """Count a block at a condition at which its RMS was not learned; learn with a number of them, where healthy.

    The baseline is fitted anew to all points, those by which it was learned before among them.
    """
    state = replace(state, outside=state.outside + 1)
    if state.baseline is None or state.stage != HEALTHY or state.exceeding >= _SUSPECT:
        return state
    point = block.point
    depends = state.baseline.by.get("rms")
    if depends is not None and not is_known(point[3], depends.by):
        return state
    held = (*state.held, point)
    if len(held) < _WIDER_SHARE * max(len(state.kept), _LEAST_POINTS):
        return replace(state, held=held)
    old, points = state.baseline, (*state.kept, *held)
    new = _freeze(points, settings, old)
    lines = {name: one for name, one in new.lines.items() if name in old.lines}
    return _with_baseline(state, replace(new, lines={**old.lines, **lines}), points)


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
    new = _freeze(learned, settings)
    said = Relearned(math.exp(old.ln_rms), math.exp(new.ln_rms))
    # A part that the new blocks do not show keeps what was learned of it.
    kept = {name: one for name, one in old.by.items() if name in old.lines and name not in new.lines}
    new = replace(new, lines={**old.lines, **new.lines}, by={**kept, **new.by})
    return replace(_with_baseline(state, new, learned), lower_since=None, returned=0), said


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
    found = _freeze(learned, settings)
    added = {name: one for name, one in found.by.items() if name in found.lines and name not in baseline.lines}
    new = replace(baseline, lines={**found.lines, **baseline.lines}, by={**baseline.by, **added})
    return replace(state, learned=(), baseline=new)


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
    levels, _ = _less_conditions(learned, [rms for _, rms, _, _ in learned], settings)
    third = len(levels) // 3
    if not third:
        return False
    return statistics.median(levels[:third]) - statistics.median(levels[-third:]) > settings.rms_drift


def _sees_new_conditions(learned: Sequence[BaselinePoint], settings: DetectSettings) -> bool:
    """Tell whether speed or load, where levels are taken relative to them, still leave the range seen before."""
    conditions = [condition for *_, condition in learned]
    return widens(conditions, varying(conditions, settings.levels_by))


def _less_conditions(
    points: Sequence[BaselinePoint],
    levels: Sequence[float],
    settings: DetectSettings,
    before: Dependence | None = None,
) -> tuple[list[float], Dependence | None]:
    """Return the levels of points less their dependence on speed and load, and that, or all of them and None.

    Points whose condition is not known, or too rare to be predicted, are left out of the former.
    """
    conditions = [condition for *_, condition in points]
    by = varying(conditions, settings.levels_by)
    known = [place for place, condition in enumerate(conditions) if is_known(condition, by)]
    found = learn_dependence(
        [levels[place] for place in known],
        [conditions[place] for place in known],
        by,
        always=settings.levels_by != "auto" or before is not None,
        before=before,
    )
    if found is None:
        return list(levels), None
    shapes = [found.at(condition) for condition in conditions]
    return [level - shape[0] for level, shape in zip(levels, shapes, strict=True) if shape is not None], found


def _freeze(learned: Sequence[BaselinePoint], settings: DetectSettings, before: Baseline | None = None) -> Baseline:
    """Return the baseline of some points; levels that depended on conditions ``before`` do so still."""
    by: dict[str, Dependence] = {}

    def spread_of(name: str, points: Sequence[BaselinePoint], levels: Sequence[float]) -> Spread:
        depended = None if before is None else before.by.get(name)
        left, dependence = _less_conditions(points, levels, settings, depended)
        if dependence is None or not left:
            return median_and_sd(levels)
        by[name] = dependence
        return median_and_sd(left)

    ln_rms, ln_rms_sd = spread_of("rms", learned, [rms for _, rms, _, _ in learned])
    lines: dict[str, Spread] = {}
    for place, name in enumerate(LINES):
        shown = [(point, value) for point in learned if (value := point[2][place]) is not None]
        if shown and len(shown) >= _LEAST_SHARE * len(learned):
            points, found = zip(*shown, strict=True)
            lines[name] = spread_of(name, points, found)
    taken = by["rms"].by if "rms" in by else ()
    steady = steady_ranges([condition for *_, condition in learned], taken, settings.levels_by)
    return Baseline(ln_rms, ln_rms_sd, lines, by, steady)


def median_and_sd(values: Sequence[float]) -> Spread:
    """Return the median and the robust standard deviation, 1.4826 times the median absolute deviation."""
    middle = statistics.median(values)
    return middle, 1.4826 * statistics.median(abs(value - middle) for value in values)
