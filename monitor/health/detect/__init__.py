"""Start of the final stage of life (t_fs), from H_or and RMS, and the end of life.

A baseline of both is learned once and then frozen: a running one would follow the change to be detected. Both enter as
logarithms. H_or enters as its ratio to the noise floor under its lines: an impulsive episode raises the whole envelope
spectrum, lines and floor alike, and does not show a damaged outer race.

The score is the length of the vector of both positive standardised excesses over the baseline. The drift of a healthy
machine (load, temperature, lubricant) is part of the standard deviation; without it a baseline of quiet hours turns any
later warm day into an alarm.
"""

from __future__ import annotations

from monitor.health.detect.baseline import median_and_sd
from monitor.health.detect.onset import step
from monitor.health.detect.state import (
    END_OF_LIFE,
    FINAL,
    HEALTHY,
    LEARNING,
    STAGES,
    Baseline,
    DetectInput,
    DetectOutput,
    DetectSettings,
    DetectState,
    Mark,
)
from monitor.health.detect.threshold import exceedance_rate, threshold_for

__all__ = [
    "END_OF_LIFE",
    "FINAL",
    "HEALTHY",
    "LEARNING",
    "STAGES",
    "Baseline",
    "DetectInput",
    "DetectOutput",
    "DetectSettings",
    "DetectState",
    "Mark",
    "exceedance_rate",
    "median_and_sd",
    "step",
    "threshold_for",
]
