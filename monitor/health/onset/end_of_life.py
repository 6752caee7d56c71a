"""The end of life: peaks that reach a limit, in the final stage, at a level that stays up.

A knock, a restart or a loose part gives one or several high peaks; a bearing that is worn out gives them block after
block, and its level lies high between them. So the peaks must be consecutive and, over twice as many blocks and one,
the median of the peaks must reach half the limit and that of RMS the level of an alarm.
"""

from __future__ import annotations

import math
import statistics
from dataclasses import replace

from monitor.health.onset.state import DetectInput, DetectSettings, DetectState, Mark

_PEAK_SHARE = 0.5


def count_peaks(
    state: DetectState,
    block: DetectInput,
    mark: Mark,
    settings: DetectSettings,
    threshold: float,
    level: float | None = None,
) -> DetectState:
    """Latch the end of life at the first of the consecutive blocks that reach the peak.

    Args:
        state: after the onset of this block.
        threshold: of the score.
        level: RMS over what is learned at the condition of the block, or None.
    """
    if state.t_eol is not None or block.peak is None:
        return state
    reference = state.reference_rms
    rms = block.rms if level is None or reference is None else level * reference
    recent = (*state.recent, (block.peak, rms))[-(2 * settings.end_of_life_blocks + 1) :]
    if block.peak < settings.end_of_life_peak:
        return replace(state, recent=recent, high_peaks=0, first_high_peak=None)
    first, count = state.first_high_peak or mark, state.high_peaks + 1
    state = replace(state, recent=recent, high_peaks=count, first_high_peak=first)
    if state.t_fs is None or count < settings.end_of_life_blocks or not _is_sustained(state, settings, threshold):
        return state
    return replace(state, t_eol=first, quiet=0, quiet_since=None)


def _is_sustained(state: DetectState, settings: DetectSettings, threshold: float) -> bool:
    if state.baseline is None:
        return False
    peak, rms = (statistics.median(values) for values in zip(*state.recent, strict=True))
    level = state.baseline.ln_rms + threshold * math.hypot(state.baseline.ln_rms_sd, settings.rms_drift)
    return peak >= _PEAK_SHARE * settings.end_of_life_peak and rms > math.exp(level)
