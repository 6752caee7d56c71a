"""What the detector is told, what it carries from block to block, and what it gives."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from monitor.health.codec import StoredState
from monitor.health.onset.dependence import (
    UNKNOWN,
    Condition,
    Dependence,
    LevelsBy,
    Range,
    condition_of,
    leaves,
)
from monitor.words.parts import PARTS

LEARNING, HEALTHY, FINAL, END_OF_LIFE = "learning", "healthy", "final", "end_of_life"
STAGES = (LEARNING, HEALTHY, FINAL, END_OF_LIFE)

LINES = tuple(part.feature for part in PARTS)
"""Sums of the lines of a part in the envelope spectrum, which enter as their ratio to the noise floor under them."""
FEATURES = ("rms", *LINES)
"""Features that the detector can listen to."""

Spread = tuple[float, float]
"""Median and robust standard deviation."""
BaselinePoint = tuple[float | None, float, tuple[float | None, ...], Condition]
"""Time (s or None), ln RMS, the logarithm of each of ``LINES`` (None: not shown) and the condition of one block."""

MIN_DEPTH = 0.1
"""Least depth of modulation of lines that count, but those of the outer race, as in the thesis: half of what a name
needs. Elements that pass the load zone of a healthy bearing, or damage of a far one without a sensor, modulate less."""
MAX_EPISODES = 20
"""Closed episodes that the state keeps; events have all."""


@dataclass(frozen=True)
class DetectSettings:
    """Settings of the detector.

    Attributes:
        learn_blocks: blocks of the baseline, or None where ``learn_time`` applies.
        learn_time: duration of the baseline, s, or None.
        run_in_blocks: first blocks, left out of the baseline.
        features: of ``FEATURES``, "rms" among them; of those, the ones that the spectrum shows are listened to.
        false_alarms_per_1000_blocks: upper limit for a healthy machine. It sets the threshold, which this many blocks
            of a steady machine exceed; persistence only lowers the rate, so the limit holds even if neighbouring blocks
            are wholly dependent.
        persist_blocks: consecutive blocks above the threshold that make an alarm.
        close_blocks: consecutive blocks below half the threshold that close an episode.
        rms_drift: standard deviation of the drift of ln RMS of a healthy machine.
        h_or_drift: the same of ln (lines of a part over their floor).
        end_of_life_peak: m/s2.
        end_of_life_blocks: consecutive blocks that must reach it.
        levels_by: conditions of which RMS and lines are taken relative to a learned dependence; "auto": of those that
            vary while the baseline is learned, where they explain a part of the level.
    """

    learn_blocks: int | None = 100
    learn_time: float | None = None
    run_in_blocks: int = 30
    features: tuple[str, ...] = FEATURES
    false_alarms_per_1000_blocks: float = 1.0
    persist_blocks: int = 5
    close_blocks: int = 50
    rms_drift: float = 0.10
    h_or_drift: float = 0.15
    end_of_life_peak: float = 20 * 9.80665
    end_of_life_blocks: int = 3
    levels_by: LevelsBy = "auto"


@dataclass(frozen=True)
class DetectInput:
    """What the detector uses of one block.

    Attributes:
        time: s, or None where the recording has none.
        rms: in the unit of the channel.
        prominence: of each of ``LINES`` that the spectrum shows, its sum over that of the floor under it.
        peak: largest absolute acceleration, m/s2, or None where the unit is unknown.
        usable: the quality of the block lets it change the detector.
        shallow: those of ``LINES`` that are no deeper than ``MIN_DEPTH``: they are learned but do not count.
        speed: of the shaft, Hz, or None.
        speed_range: its least and highest value within the block, Hz; None: it turns at one speed as far as is known.
        load: N, or None.
    """

    sequence: int
    time: float | None
    rms: float
    prominence: Mapping[str, float]
    peak: float | None
    usable: bool = True
    shallow: frozenset[str] = frozenset()
    speed: float | None = None
    speed_range: tuple[float, float] | None = None
    load: float | None = None

    @property
    def point(self) -> BaselinePoint:
        """The block as a point of the baseline; its RMS must be positive."""
        shown = (self.prominence.get(name, 0.0) for name in LINES)
        ln_lines = tuple(math.log(value) if value > 0.0 else None for value in shown)
        return self.time, math.log(self.rms), ln_lines, condition_of(self.speed, self.speed_range, self.load)


@dataclass(frozen=True)
class Baseline:
    """Medians and robust standard deviations of the healthy machine, of what is left of levels with a dependence.

    Attributes:
        lines: of the logarithm of each of ``LINES`` that its blocks showed.
        by: how the levels depend on speed and load, by feature; those of the others do not, as far as was seen.
        steady: ranges of the logarithms of the conditions, "speed" and "load", that RMS is not taken relative to.
    """

    ln_rms: float
    ln_rms_sd: float
    lines: Mapping[str, Spread] = field(default_factory=dict[str, Spread])
    by: Mapping[str, Dependence] = field(default_factory=dict[str, Dependence])
    steady: Mapping[str, Range] = field(default_factory=dict[str, Range])

    def less_condition(self, name: str, ln_value: float, condition: Condition) -> tuple[float, float] | None:
        """Return the logarithm of a level as it were at the reference condition, and the error of that.

        None at a condition at which the level was not learned.
        """
        if name == "rms" and leaves(condition, self.steady):
            return None
        dependence = self.by.get(name)
        if dependence is None:
            return ln_value, 0.0
        found = dependence.at(condition)
        return None if found is None else (ln_value - found[0], found[1])


@dataclass(frozen=True)
class Mark:
    """A block's number, and its time in s (None where the recording has none)."""

    sequence: int
    time: float | None


@dataclass(frozen=True)
class Episode:
    """A final stage that closed again: where it began, was known, was quiet from, and was closed."""

    began: Mark
    known: Mark
    quiet: Mark
    closed: Mark


@dataclass(frozen=True)
class Relearned:
    """A baseline that was learned anew: RMS of the old and of the new one, in the unit of the channel."""

    rms_before: float
    rms_after: float


@dataclass(frozen=True)
class DetectState(StoredState):
    """State of the detector.

    Attributes:
        seen: usable blocks.
        learned: points of the baseline that is being learned: the first one, a lower one, or that of lines which an
            earlier version did not listen to.
        dropped: points that were left out as the machine ran in.
        exceeding: consecutive blocks above the threshold.
        elevated: where the score rose for good above half the threshold.
        t_fs, t_fs_known: of the episode that is open.
        quiet: consecutive blocks of it below half the threshold; ``quiet_since`` is the first.
        lower_since: ``seen`` where the level fell well below the baseline, or None.
        returned: latest consecutive blocks that were not well below it.
        high_peaks: consecutive blocks that reached the peak of the end of life; ``first_high_peak`` is the first.
        recent: peak and RMS of the latest blocks, RMS as it were at the reference condition.
        t_eol: the end of life; once known, it stays.
        episodes: the latest that closed, oldest first.
        outside: usable blocks at a condition at which RMS was not learned.
        kept: points by which the baseline was learned.
        held: those of healthy blocks outside, with which it will be learned wider.
    """

    VERSIONS = (1, 2, 3)
    LATER = frozenset({"quiet", "lower_since", "returned", "outside", "kept", "held"})

    version: int = VERSIONS[-1]
    seen: int = 0
    learned: tuple[BaselinePoint, ...] = ()
    dropped: int = 0
    baseline: Baseline | None = None
    exceeding: int = 0
    elevated: Mark | None = None
    t_fs: Mark | None = None
    t_fs_known: Mark | None = None
    quiet: int = 0
    quiet_since: Mark | None = None
    lower_since: int | None = None
    returned: int = 0
    high_peaks: int = 0
    first_high_peak: Mark | None = None
    recent: tuple[tuple[float, float], ...] = ()
    t_eol: Mark | None = None
    episodes: tuple[Episode, ...] = ()
    outside: int = 0
    kept: tuple[BaselinePoint, ...] = ()
    held: tuple[BaselinePoint, ...] = ()

    @property
    def stage(self) -> str:
        """Stage of life: learning, healthy, final or end_of_life."""
        if self.t_eol is not None:
            return END_OF_LIFE
        if self.t_fs is not None:
            return FINAL
        return LEARNING if self.baseline is None else HEALTHY

    @classmethod
    def upgraded(cls, stored: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the values of an earlier version; before version 3 no block had a condition."""
        fields = dict(stored if stored["version"] > 1 else _of_version_1(stored))
        for name in ("learned", "kept", "held"):
            fields[name] = [point if len(point) > 3 else (*point, UNKNOWN) for point in fields.get(name, ())]
        return fields

    @property
    def reference_rms(self) -> float | None:
        """RMS of the baseline at its reference condition, or None while there is none."""
        return None if self.baseline is None else math.exp(self.baseline.ln_rms)


def _of_version_1(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of a state of version 1, which knew RMS and H_or only; the other lines are learned yet."""
    fields = {name: value for name, value in values.items() if name != "version"}
    unknown = (None,) * (len(LINES) - 1)
    fields["learned"] = [(time, rms, (h_or, *unknown)) for time, rms, h_or in fields["learned"]]
    if (old := fields["baseline"]) is not None:
        h_or = old["ln_prominence"], old["ln_prominence_sd"]
        lines = {} if h_or == (0.0, 0.0) else {LINES[0]: h_or}
        fields["baseline"] = {"ln_rms": old["ln_rms"], "ln_rms_sd": old["ln_rms_sd"], "lines": lines}
    new = {"quiet_since": None, "recent": (), "episodes": ()}
    return {**new, **fields}


@dataclass(frozen=True)
class DetectOutput:
    """Result of one block.

    Attributes:
        score: in standard deviations; None while learning or where the block is not used.
        threshold: the score that counts as an exceedance.
        leading: the feature that stands highest above the baseline, or None where none stands above it.
        raised: the lines that stand above the baseline by half the threshold.
        alarm: t_fs became known with this block.
        end: the end of life became known with this block.
        closed: the episode that closed with this block.
        relearned: the baseline was learned anew with this block.
        level: RMS over what is learned at the condition of the block; None without a dependence on that.
        expected_rms: what is learned at the condition of the block, in the unit of the channel; None where nothing is.
        outside: RMS was not learned at the condition of the block, which is therefore not judged.
    """

    stage: str
    score: float | None
    threshold: float
    leading: str | None = None
    raised: tuple[str, ...] = ()
    alarm: bool = False
    end: bool = False
    closed: Episode | None = None
    relearned: Relearned | None = None
    level: float | None = None
    expected_rms: float | None = None
    outside: bool = False
