"""Onset and healthy level of a recorded run, as the detector finds them in its default configuration."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median

from monitor.health import onset as detect

_LEAST_HEALTHY = 5
"""Blocks before a stated onset that make a level of the healthy machine where the detector has not learned one."""


@dataclass(frozen=True)
class Onset:
    """The start of the final stage that a run ends in.

    Attributes:
        place: index of its first block.
        known: index of the block with which it became known; None where it was stated.
        ln_baseline: ln RMS of the healthy machine, NaN where it is not known.
    """

    place: int
    known: int | None
    ln_baseline: float


def find_onset(blocks: Sequence[detect.DetectInput]) -> Onset | None:
    """Return the onset of the final stage that is open at the end of a run, or None."""
    state, settings = detect.DetectState(), detect.DetectSettings()
    places = {block.sequence: place for place, block in enumerate(blocks)}
    for block in blocks:
        state, _ = detect.step(state, block, settings)
    if state.t_fs is None or state.t_fs_known is None or state.baseline is None:
        return None
    return Onset(places[state.t_fs.sequence], places[state.t_fs_known.sequence], state.baseline.ln_rms)


def stated_onset(blocks: Sequence[detect.DetectInput], t_fs: float) -> Onset | None:
    """Return the onset of a run whose final stage is said to begin at a time, s; None where no block follows it."""
    place = next((i for i, block in enumerate(blocks) if block.time is not None and block.time >= t_fs), None)
    if place is None:
        return None
    state, settings = detect.DetectState(), detect.DetectSettings()
    for block in blocks[:place]:
        state, _ = detect.step(state, block, settings)
    if state.baseline is not None:
        return Onset(place, None, state.baseline.ln_rms)
    before = [math.log(block.rms) for block in blocks[:place] if block.rms > 0.0]
    return Onset(place, None, median(before) if len(before) >= _LEAST_HEALTHY else math.nan)
