"""One block through the detector: baseline, score, start of the final stage, end of life."""

from __future__ import annotations

import math
from dataclasses import replace

from monitor.health.detect.baseline import learn
from monitor.health.detect.end_of_life import count_peaks
from monitor.health.detect.state import Baseline, DetectInput, DetectOutput, DetectSettings, DetectState, Mark
from monitor.health.detect.threshold import threshold_for

_ONSET_SHARE = 0.5
"""t_fs is where the score rose for good above this share of the threshold."""


def step(state: DetectState, block: DetectInput, settings: DetectSettings) -> tuple[DetectState, DetectOutput]:
    """Apply one block to the state.

    Blocks must come in the order of acquisition; one that is not usable changes the peak count only (a clipped block
    still counts for the end of life).
    """
    threshold = threshold_for(settings.false_alarms_per_1000_blocks)
    mark = Mark(block.sequence, block.time)
    before = state
    state = count_peaks(state, block, mark, settings)
    score: float | None = None
    if block.usable and block.rms > 0.0:
        state = replace(state, seen=state.seen + 1)
        if state.baseline is None:
            state = learn(state, block, settings)
        else:
            score = _score(state.baseline, block, settings)
            state = _advance(state, score, threshold, mark, settings)
    return state, DetectOutput(
        stage=state.stage,
        score=score,
        threshold=threshold,
        alarm=before.t_fs is None and state.t_fs is not None,
        end=before.t_eol is None and state.t_eol is not None,
    )


def _score(baseline: Baseline, block: DetectInput, settings: DetectSettings) -> float:
    """Return the length of the vector of positive standardised excesses."""
    z_rms = (math.log(block.rms) - baseline.ln_rms) / math.hypot(baseline.ln_rms_sd, settings.rms_drift)
    z_h = 0.0
    if block.prominence is not None and block.prominence > 0.0:
        sd = math.hypot(baseline.ln_prominence_sd, settings.h_or_drift)
        z_h = (math.log(block.prominence) - baseline.ln_prominence) / sd
    return math.hypot(max(z_rms, 0.0), max(z_h, 0.0))


def _advance(state: DetectState, score: float, threshold: float, mark: Mark, settings: DetectSettings) -> DetectState:
    """Count exceedances; latch t_fs at the start of the elevated interval that holds the alarm."""
    if state.t_fs is not None:
        return state
    elevated = (state.elevated or mark) if score > _ONSET_SHARE * threshold else None
    exceeding = state.exceeding + 1 if score > threshold else 0
    if exceeding < settings.persist_blocks:
        return replace(state, elevated=elevated, exceeding=exceeding)
    return replace(state, elevated=elevated, exceeding=exceeding, t_fs=elevated, t_fs_known=mark)
