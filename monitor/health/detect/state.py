"""What the detector is told, what it carries from block to block, and what it gives."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

LEARNING, HEALTHY, FINAL, END_OF_LIFE = "learning", "healthy", "final", "end_of_life"
STAGES = (LEARNING, HEALTHY, FINAL, END_OF_LIFE)

BaselinePoint = tuple[float | None, float, float | None]
"""Time (s or None), ln RMS and ln prominence (or None) of one block of the baseline."""


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
