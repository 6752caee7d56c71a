"""The end of life: peaks that reach a limit."""

from __future__ import annotations

from dataclasses import replace

from monitor.health.detect.state import DetectInput, DetectSettings, DetectState, Mark


def count_peaks(state: DetectState, block: DetectInput, mark: Mark, settings: DetectSettings) -> DetectState:
    """Latch the end of life at the first of the consecutive blocks that reach the peak."""
    if state.t_eol is not None or block.peak is None:
        return state
    if block.peak < settings.end_of_life_peak:
        return replace(state, high_peaks=0, first_high_peak=None) if state.high_peaks else state
    first = state.first_high_peak or mark
    count = state.high_peaks + 1
    ended = first if count >= settings.end_of_life_blocks else None
    return replace(state, high_peaks=count, first_high_peak=first, t_eol=ended)
