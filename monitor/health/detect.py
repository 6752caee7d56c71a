"""Start of the final stage of life (t_fs), from H_or and RMS, and the end of life.

A baseline of both is learned once and then frozen: a running one would follow the change to be detected. Both enter as
logarithms. H_or enters as its ratio to the noise floor under its lines: an impulsive episode raises the whole envelope
spectrum, lines and floor alike, and does not show a damaged outer race.

The score is the length of the vector of both positive standardised excesses over the baseline. The drift of a healthy
machine (load, temperature, lubricant) is part of the standard deviation; without it a baseline of quiet hours turns any
later warm day into an alarm.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from typing import Any

LEARNING, HEALTHY, FINAL, END_OF_LIFE = "learning", "healthy", "final", "end_of_life"
BaselinePoint = tuple[float | None, float, float | None]
"""Time (s or None), ln RMS and ln prominence (or None) of one block of the baseline."""

STAGES = (LEARNING, HEALTHY, FINAL, END_OF_LIFE)

_MAX_LEARNING_FACTOR = 3
"""Longest learning over its nominal length, while the machine runs in."""
_ONSET_SHARE = 0.5
"""t_fs is where the score rose for good above this share of the threshold."""


@dataclass(frozen=True)
class DetectSettings:
    """Settings of the detector.

    Attributes:
        learn_blocks: blocks of the baseline, or None where ``learn_time`` applies.
        learn_time: duration of the baseline, s, or None.
        run_in_blocks: first blocks, left out of the baseline.
        false_alarms_per_1000_blocks: upper limit for a healthy machine. It sets the threshold, which this many blocks
            of a steady machine exceed; persistence only lowers the rate, so the limit holds even if neighbouring blocks
            are wholly dependent.
        persist_blocks: consecutive blocks above the threshold that make an alarm.
        rms_drift: standard deviation of the drift of ln RMS of a healthy machine.
        h_or_drift: the same of ln (H_or over its floor).
        end_of_life_peak: m/s2.
        end_of_life_blocks: consecutive blocks that must reach it.
    """

    learn_blocks: int | None = 100
    learn_time: float | None = None
    run_in_blocks: int = 30
    false_alarms_per_1000_blocks: float = 1.0
    persist_blocks: int = 5
    rms_drift: float = 0.10
    h_or_drift: float = 0.15
    end_of_life_peak: float = 20 * 9.80665
    end_of_life_blocks: int = 3


@dataclass(frozen=True)
class DetectInput:
    """What the detector uses of one block.

    Attributes:
        time: s, or None where the recording has none.
        rms: in the unit of the channel.
        prominence: H_or over the floor under its lines, or None without an envelope.
        peak: largest absolute acceleration, m/s2, or None where the unit is unknown.
        usable: the quality of the block lets it change the detector.
    """

    sequence: int
    time: float | None
    rms: float
    prominence: float | None
    peak: float | None
    usable: bool = True


@dataclass(frozen=True)
class Baseline:
    """Medians and robust standard deviations of ln RMS and ln prominence of the healthy machine."""

    ln_rms: float
    ln_rms_sd: float
    ln_prominence: float
    ln_prominence_sd: float


@dataclass(frozen=True)
class Mark:
    """A block's number, and its time in s (None where the recording has none)."""

    sequence: int
    time: float | None


@dataclass(frozen=True)
class DetectState:
    """State of the detector; version 1. t_fs and t_eol, once known, stay."""

    version: int = 1
    seen: int = 0
    learned: tuple[BaselinePoint, ...] = ()
    dropped: int = 0
    baseline: Baseline | None = None
    exceeding: int = 0
    elevated: Mark | None = None
    t_fs: Mark | None = None
    t_fs_known: Mark | None = None
    high_peaks: int = 0
    first_high_peak: Mark | None = None
    t_eol: Mark | None = None

    @property
    def stage(self) -> str:
        """Stage of life: learning, healthy, final or end_of_life."""
        if self.t_eol is not None:
            return END_OF_LIFE
        if self.t_fs is not None:
            return FINAL
        return LEARNING if self.baseline is None else HEALTHY

    @property
    def reference_rms(self) -> float | None:
        """RMS of the baseline, or None while there is none."""
        return None if self.baseline is None else math.exp(self.baseline.ln_rms)

    def to_dict(self) -> dict[str, Any]:
        """Return the state as plain values for JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> DetectState:
        """Restore a state written by :meth:`to_dict`; raise ValueError for another version."""
        if values.get("version") != 1:
            raise ValueError(f"detector state of version {values.get('version')!r}, expected 1")
        fields = dict(values)
        fields["learned"] = tuple(tuple(row) for row in fields["learned"])
        if fields["baseline"] is not None:
            fields["baseline"] = Baseline(**fields["baseline"])
        for name in ("elevated", "t_fs", "t_fs_known", "first_high_peak", "t_eol"):
            if fields[name] is not None:
                fields[name] = Mark(**fields[name])
        return cls(**fields)


@dataclass(frozen=True)
class DetectOutput:
    """Result of one block.

    Attributes:
        score: in standard deviations; None while learning or where the block is not used.
        threshold: the score that counts as an exceedance.
        alarm: t_fs became known with this block.
        end: the end of life became known with this block.
    """

    stage: str
    score: float | None
    threshold: float
    alarm: bool = False
    end: bool = False


def exceedance_rate(threshold: float) -> float:
    """Return how often the score of a healthy block exceeds ``threshold``.

    The score is the length of two independent standard normal excesses, negative ones set to zero: of four blocks one
    has both, two have one, one has none.
    """
    both = 0.25 * math.exp(-0.5 * threshold * threshold)
    one = 0.5 * math.erfc(threshold / math.sqrt(2.0))
    return both + one


@cache
def threshold_for(false_alarms_per_1000_blocks: float) -> float:
    """Return the score that a healthy block exceeds at the stated rate.

    Raises:
        ValueError: the rate is not between 1e-9 and 500 per 1000 blocks.
    """
    rate = false_alarms_per_1000_blocks / 1000.0
    if not 1e-12 <= rate <= 0.5:
        raise ValueError(f"false_alarms_per_1000_blocks must be between 1e-9 and 500, got {rate * 1000:g}")
    low, high = 0.0, 10.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if exceedance_rate(middle) > rate else (low, middle)
    return 0.5 * (low + high)


def step(state: DetectState, block: DetectInput, settings: DetectSettings) -> tuple[DetectState, DetectOutput]:
    """Apply one block to the state.

    Blocks must come in the order of acquisition; one that is not usable changes the peak count only (a clipped block
    still counts for the end of life).
    """
    threshold = threshold_for(settings.false_alarms_per_1000_blocks)
    mark = Mark(block.sequence, block.time)
    before = state
    state = _count_peaks(state, block, mark, settings)
    score: float | None = None
    if block.usable and block.rms > 0.0:
        state = replace(state, seen=state.seen + 1)
        if state.baseline is None:
            state = _learn(state, block, settings)
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


def _count_peaks(state: DetectState, block: DetectInput, mark: Mark, settings: DetectSettings) -> DetectState:
    """Latch the end of life at the first of the consecutive blocks that reach the peak."""
    if state.t_eol is not None or block.peak is None:
        return state
    if block.peak < settings.end_of_life_peak:
        return replace(state, high_peaks=0, first_high_peak=None) if state.high_peaks else state
    first = state.first_high_peak or mark
    count = state.high_peaks + 1
    ended = first if count >= settings.end_of_life_blocks else None
    return replace(state, high_peaks=count, first_high_peak=first, t_eol=ended)


def _learn(state: DetectState, block: DetectInput, settings: DetectSettings) -> DetectState:
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
