"""The baseline of the healthy machine: learned once, then frozen."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import replace

from monitor.health.detect.state import Baseline, BaselinePoint, DetectInput, DetectSettings, DetectState

_MAX_LEARNING_FACTOR = 3
"""Longest learning over its nominal length, while the machine runs in."""


def learn(state: DetectState, block: DetectInput, settings: DetectSettings) -> DetectState:
    """Add the block to the baseline; freeze it when it has enough settled blocks."""
    if state.seen <= settings.run_in_blocks:
        return state
    ln_prominence = math.log(block.prominence) if block.prominence and block.prominence > 0.0 else None
    learned = (*state.learned, (block.time, math.log(block.rms), ln_prominence))
    state = replace(state, learned=learned)
    if not _enough(state, settings):
        return state
    third = len(learned) // 3
    fallen = statistics.median(r for _, r, _ in learned[:third]) - statistics.median(r for _, r, _ in learned[-third:])
    nominal = len(learned) + state.dropped
    if third and fallen > settings.rms_drift and nominal < _MAX_LEARNING_FACTOR * _nominal(settings, len(learned)):
        # Still running in: the first blocks do not represent the healthy machine.
        return replace(state, learned=learned[third:], dropped=state.dropped + third)
    return replace(state, learned=(), baseline=_freeze(learned))


def _nominal(settings: DetectSettings, count: int) -> int:
    return settings.learn_blocks if settings.learn_blocks is not None else count


def _enough(state: DetectState, settings: DetectSettings) -> bool:
    if settings.learn_blocks is not None:
        return len(state.learned) >= settings.learn_blocks
    first, last = state.learned[0][0], state.learned[-1][0]
    if settings.learn_time is None or first is None or last is None:
        return False
    # A median and a spread need at least ten blocks.
    return last - first >= settings.learn_time and len(state.learned) >= 10


def _freeze(learned: tuple[BaselinePoint, ...]) -> Baseline:
    rms = median_and_sd([r for _, r, _ in learned])
    prominences = [p for _, _, p in learned if p is not None]
    return Baseline(*rms, *(median_and_sd(prominences) if prominences else (0.0, 0.0)))


def median_and_sd(values: Sequence[float]) -> tuple[float, float]:
    """Return the median and the robust standard deviation, 1.4826 times the median absolute deviation."""
    middle = statistics.median(values)
    return middle, 1.4826 * statistics.median(abs(value - middle) for value in values)
