"""Start of the final stage of life (t_fs), from RMS and the lines of all parts, its close, and the end of life.

A baseline is learned and frozen. All features enter as logarithms, the lines of a part (H_or, H_ir, H_ball, H_cage) as
their ratio to the noise floor under them: an impulsive episode raises the whole envelope spectrum, lines and floor
alike, and does not show a damaged part.

The score is the length of the vector of two positive standardised excesses over the baseline: of RMS, and of the part
whose lines stand highest (:mod:`monitor.health.onset.detector`). The drift of a healthy machine (load, temperature,
lubricant) is part of the standard deviation; without it a baseline of quiet hours turns any later warm day into an
alarm. Where speed and load vary, levels are taken relative to what is learned of their dependence on these
(:mod:`monitor.health.onset.dependence`).
"""

from __future__ import annotations

from monitor.health.onset.baseline import median_and_sd
from monitor.health.onset.dependence import Dependence, LevelsBy
from monitor.health.onset.detector import exceedance_rate, raised_lines, step, threshold_for
from monitor.health.onset.state import (
    END_OF_LIFE,
    FEATURES,
    FINAL,
    HEALTHY,
    LEARNING,
    LINES,
    MIN_DEPTH,
    STAGES,
    Baseline,
    DetectInput,
    DetectOutput,
    DetectSettings,
    DetectState,
    Episode,
    Mark,
    Relearned,
)

__all__ = [
    "END_OF_LIFE",
    "FEATURES",
    "FINAL",
    "HEALTHY",
    "LEARNING",
    "LINES",
    "MIN_DEPTH",
    "STAGES",
    "Baseline",
    "Dependence",
    "DetectInput",
    "DetectOutput",
    "DetectSettings",
    "DetectState",
    "Episode",
    "LevelsBy",
    "Mark",
    "Relearned",
    "exceedance_rate",
    "median_and_sd",
    "raised_lines",
    "step",
    "threshold_for",
]
