"""Start of the final stage of life (t_fs), from H_or and RMS together, and the end of life.

A baseline of both is learned once and then frozen: a running one would chase the change that it is to find. Both enter
as logarithms, so that a change counts by its ratio. H_or enters as its ratio to the noise floor under its lines: an
impulsive episode lifts the whole envelope spectrum, lines and floor alike, and is no sign of a damaged outer race.

The score is the length of the vector of both standardised excesses over the baseline, either alone if strong, or both
together if moderate. What a healthy machine drifts by (load, temperature, lubricant) is part of the standard deviation:
without it, a baseline of quiet hours turns any later warm day into an alarm.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import cache
from typing import Any

LEARNING, HEALTHY, FINAL, END_OF_LIFE = "learning", "healthy", "final", "end_of_life"
Lesson = tuple[float | None, float, float | None]
"""Time, ln RMS and ln prominence of one block that teaches the baseline."""

STAGES = (LEARNING, HEALTHY, FINAL, END_OF_LIFE)

_MAX_LEARNING = 3
"""Learning may take at most this many times its nominal length, while the machine still runs in."""
_ONSET = 0.5
"""The final stage began where the score rose for good above this share of the threshold."""


@dataclass(frozen=True)
class DetectSettings:
    """How the onset is detected; the same for every machine unless its owner knows better.

    Attributes:
        learn_blocks: blocks that teach the baseline, or None where ``learn_time`` does.
        learn_time: seconds that teach the baseline, or None.
        run_in_blocks: first blocks, which teach nothing: a bearing runs in.
        false_alarms_per_1000_blocks: most alarms of a healthy machine. It sets the threshold, which so many blocks of a
            steady machine exceed; single knocks exceed it too, but do not persist. As persistence only lowers the rate,
            it holds even where neighbouring blocks are wholly dependent.
        persist_blocks: consecutive blocks over the threshold that make an alarm.
        rms_drift: standard deviation of ln RMS that a healthy machine drifts by.
        h_or_drift: the same of ln (H_or over its floor).
        end_of_life_peak: peak acceleration that ends a life, m/s2.
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
    """What the detector takes from one block.

    Attributes:
        sequence: number of the block.
        time: its time, s, or None where the recording has none.
        rms: RMS in the unit of the channel.
        prominence: H_or over the floor under its lines, or None where there is no envelope.
        peak: largest absolute acceleration, m/s2, or None where the unit is unknown.
        usable: whether quality lets the block move the detector.
    """

    sequence: int
    time: float | None
    rms: float
    prominence: float | None
    peak: float | None
    usable: bool = True


@dataclass(frozen=True)
class Baseline:
    """What healthy looks like: medians and robust standard deviations of ln RMS and ln prominence."""

    ln_rms: float
    ln_rms_sd: float
    ln_prominence: float
    ln_prominence_sd: float


@dataclass(frozen=True)
class Mark:
    """A moment: the block's number and its time in seconds (None where the recording has none)."""

    sequence: int
    time: float | None


@dataclass(frozen=True)
class DetectState:
    """The detector between two blocks; version 1. Latched: t_fs, once known, stays."""

    version: int = 1
    seen: int = 0
    learned: tuple[Lesson, ...] = ()
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
        """RMS of the learned baseline, or None while there is none."""
        return None if self.baseline is None else math.exp(self.baseline.ln_rms)

    def to_dict(self) -> dict[str, Any]:
        """Return the state as plain values for JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> DetectState:
        """Return the state that :meth:`to_dict` gave; refuse another version."""
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
    """What one block changed.

    Attributes:
        stage: stage of life after the block.
        score: distance from the baseline in standard deviations; None while learning or where the block is not used.
        threshold: the distance that counts as an exceedance.
        alarm: whether this block made t_fs known.
        end: whether this block made the end of life known.
    """

    stage: str
    score: float | None
    threshold: float
    alarm: bool = False
    end: bool = False


def exceedance_rate(threshold: float) -> float:
    """Return how often the score of a healthy block exceeds ``threshold``.

    The score is the length of two independent standard normal excesses, each set to zero where it is negative: one in
    four blocks has both, one in two has one, one in four none.
    """
    both = 0.25 * math.exp(-0.5 * threshold * threshold)
    one = 0.5 * math.erfc(threshold / math.sqrt(2.0))
    return both + one


@cache
def threshold_for(false_alarms_per_1000_blocks: float) -> float:
    """Return the score that a healthy block exceeds at the stated rate.

    Raises:
        ValueError: if the rate is not between 1e-9 and 500 per 1000 blocks.
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
    """Take one block into the state and say what it changed.

    Blocks must come in the order of acquisition; one that quality does not let through leaves all but the peak count
    untouched (a clipped block still counts for the end of life).
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
    """Latch the end of life at the first of the consecutive blocks that reach the peak: one burst is none."""
    if state.t_eol is not None or block.peak is None:
        return state
    if block.peak < settings.end_of_life_peak:
        return replace(state, high_peaks=0, first_high_peak=None) if state.high_peaks else state
    first = state.first_high_peak or mark
    count = state.high_peaks + 1
    ended = first if count >= settings.end_of_life_blocks else None
    return replace(state, high_peaks=count, first_high_peak=first, t_eol=ended)


def _learn(state: DetectState, block: DetectInput, settings: DetectSettings) -> DetectState:
    """Collect the block; freeze the baseline when enough settled blocks are there."""
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
    if third and fallen > settings.rms_drift and nominal < _MAX_LEARNING * _nominal(settings, len(learned)):
        # Still running in: what came first is not what healthy will look like.
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
    # Ten blocks are the least that a median and a spread can be taken from.
    return last - first >= settings.learn_time and len(state.learned) >= 10


def _freeze(learned: tuple[Lesson, ...]) -> Baseline:
    """Return medians and robust standard deviations (1.4826 times the median absolute deviation)."""

    def robust(values: list[float]) -> tuple[float, float]:
        if not values:
            return 0.0, 0.0
        middle = statistics.median(values)
        return middle, 1.4826 * statistics.median(abs(value - middle) for value in values)

    rms, rms_sd = robust([r for _, r, _ in learned])
    prominence, prominence_sd = robust([p for _, _, p in learned if p is not None])
    return Baseline(rms, rms_sd, prominence, prominence_sd)


def _score(baseline: Baseline, block: DetectInput, settings: DetectSettings) -> float:
    """Return the length of the vector of positive standardised excesses."""
    z_rms = (math.log(block.rms) - baseline.ln_rms) / math.hypot(baseline.ln_rms_sd, settings.rms_drift)
    z_h = 0.0
    if block.prominence is not None and block.prominence > 0.0:
        sd = math.hypot(baseline.ln_prominence_sd, settings.h_or_drift)
        z_h = (math.log(block.prominence) - baseline.ln_prominence) / sd
    return math.hypot(max(z_rms, 0.0), max(z_h, 0.0))


def _advance(state: DetectState, score: float, threshold: float, mark: Mark, settings: DetectSettings) -> DetectState:
    """Count exceedances; latch t_fs at the start of the elevated stretch that holds the alarm."""
    if state.t_fs is not None:
        return state
    elevated = (state.elevated or mark) if score > _ONSET * threshold else None
    exceeding = state.exceeding + 1 if score > threshold else 0
    if exceeding < settings.persist_blocks:
        return replace(state, elevated=elevated, exceeding=exceeding)
    return replace(state, elevated=elevated, exceeding=exceeding, t_fs=elevated, t_fs_known=mark)
