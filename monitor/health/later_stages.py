"""The stages of a channel that need no samples: detector, persistent name, V_eq and TT, time to the alarm level.

Blocks with samples and blocks of which only the record is left go through the same function.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from monitor.health import onset as detect
from monitor.health import tracker as damage
from monitor.health.rest import trend
from monitor.health.rest.trend import TimeToAlarm
from monitor.health.signal.condition import Quantity
from monitor.health.signal.quality import Verdict
from monitor.health.signal.rotation.shaft_angle import FoundRotation
from monitor.health.size import Damage, DamageInput, Remaining
from monitor.health.state import ChannelSettings, ChannelState, Named
from streams.dates.observed import UNKNOWN_TIME, JudgedTime


def track(
    state: ChannelState,
    block: ChannelBlock,
    settings: ChannelSettings,
    rms: float,
    harmonics: tuple[float, ...] | None,
    detection: detect.DetectOutput,
) -> tuple[ChannelState, Damage | None, tuple[Remaining, ...]]:
    """Track and forecast, where the channel is tracked.

    Args:
        state: after the detector and the naming.
        block: its verdict, speed and load.
        settings: of the channel.
        rms: in the RMS band, m/s2.
        harmonics: amplitudes of the first six BPFO lines, m/s2, or None where one is unresolved.
        detection: what the detector said of the block.
    """
    if settings.damage is None:
        return state, None, ()
    damage_input = DamageInput(
        time=state.running_time,
        rms=rms,
        harmonics=harmonics,
        load=block.load.value,
        speed=block.speed.value,
        speed_range=block.speed_range,
        reference_rms=_reference_rms(state, detection),
    )
    gate = damage.DamageGate(
        final=state.detect.t_fs is not None,
        raised=state.detect.elevated is not None,
        closed=detection.closed is not None,
        usable=block.for_fit,
        absolute=settings.absolute,
        broadband=not settings.measures_velocity,
        fault=None if state.named is None else state.named.parts,
        baseline=state.detect.reference_rms,
        since_t_fs=_since(state.detect.t_fs, block.time),
    )
    after, found, forecasts = damage.step(state.damage, damage_input, gate, settings.damage)
    return replace(state, damage=after), found if settings.damage.tracks_volume else None, forecasts


def _reference_rms(state: ChannelState, detection: detect.DetectOutput) -> float | None:
    """Return RMS as it were at the reference condition, 0 where not known; None where it depends on no condition."""
    if detection.outside:
        return 0.0
    reference = state.detect.reference_rms
    return None if detection.level is None or reference is None else detection.level * reference


def time_to_alarm(
    state: ChannelState, block: ChannelBlock, settings: ChannelSettings, rms: float, detection: detect.DetectOutput
) -> tuple[ChannelState, trend.TimeToAlarm]:
    """Tell the time to the alarm level by the trend; arguments as of :func:`track`, ``rms`` in any unit.

    A level that is a multiple of the baseline is one at the reference condition of that.
    """
    learned = state.detect.baseline
    reference = _reference_rms(state, detection) if trend.rule_of(settings.alarms).is_relative else None
    given = trend.TrendInput(
        sequence=block.sequence,
        time=state.running_time,
        rms=rms if reference is None else reference,
        usable=block.for_fit,
        outside=reference == 0.0,
        baseline=None if learned is None else (learned.ln_rms, learned.ln_rms_sd),
        elevated=state.detect.elevated is not None,
        final=state.detect.t_fs is not None,
        closed=detection.closed is not None,
        speed=block.speed.value,
        load=block.load.value,
    )
    after, found = trend.step(state.trend, given, settings.alarms, settings.trend)
    return replace(state, trend=after), found


def _since(mark: detect.Mark | None, time: float | None) -> float | None:
    """Return the time since a mark, s, or None; a clock that was set back gives 0."""
    return None if mark is None or mark.time is None or time is None else max(time - mark.time, 0.0)


@dataclass(frozen=True, eq=False)
class ChannelBlock:
    """One channel of a block.

    Attributes:
        samples: shape (sample,), m/s2, or any unit where that is unknown.
        rate: sampling rate, Hz.
        sequence: number of the block in its source, from 1.
        time: seconds of its first sample, UTC where dated, else since the first block; None where unknown.
        verdict: of quality, the flags of the block included.
        speed: of the shaft, Hz; known wherever the block is accepted.
        load: N.
        span: least and largest sample, where known.
        found: angle of the shaft over the block, or why only its mean speed is known.
        recorded_range: least and highest speed, Hz, of a block whose record alone is left.
        judged: how sure its time is.
    """

    samples: NDArray[np.floating]
    rate: float
    sequence: int
    time: float | None
    verdict: Verdict
    speed: Quantity = field(default_factory=Quantity)
    load: Quantity = field(default_factory=Quantity)
    span: tuple[float, float] | None = None
    found: FoundRotation = field(default_factory=FoundRotation)
    recorded_range: tuple[float, float] | None = None
    judged: JudgedTime = UNKNOWN_TIME

    @property
    def for_fit(self) -> bool:
        """Whether it is a point of a fit over time: its level counts, and its distance in time to those before."""
        return self.verdict.for_tracker and self.judged.holds

    @property
    def speed_range(self) -> tuple[float, float] | None:
        """Least and highest speed, Hz, where they are known."""
        rotation = self.found.rotation
        return self.recorded_range if rotation is None else rotation.speed_range


class LaterStages(NamedTuple):
    """What the stages from the detector on say of a block."""

    detection: detect.DetectOutput
    damage: Damage | None
    forecasts: tuple[Remaining, ...]
    to_alarm: TimeToAlarm


def later_stages(
    state: ChannelState,
    block: ChannelBlock,
    settings: ChannelSettings,
    given: detect.DetectInput,
    harmonics: tuple[float, ...] | None,
    named: Named | None,
) -> tuple[ChannelState, LaterStages]:
    """Take an accepted block, of which the samples or a record are there, through the stages from the detector on.

    Args:
        given: for the detector; its RMS is that of the block, m/s2, or any unit where that is unknown.
        harmonics: amplitudes of the first six BPFO lines, m/s2, or None where one is unresolved.
        named: the part that the block names.
    """
    state = _run_clock(state, block)
    detector, detection = detect.step(state.detect, given, settings.detect)
    state = replace(state, detect=detector)
    if block.verdict.for_baseline:
        state = _latch_name(state, named)
    state, damage, forecasts = track(state, block, settings, given.rms, harmonics, detection)
    state, to_alarm = time_to_alarm(state, block, settings, given.rms, detection)
    return state, LaterStages(detection, damage, forecasts, to_alarm)


def _run_clock(state: ChannelState, block: ChannelBlock) -> ChannelState:
    """Advance the damage time, which is the time that the machine ran; between two running blocks it runs.

    A block whose distance in time to those before is not known leaves it: the next one makes up for it.
    """
    flags, judged = set(block.verdict.flags), block.judged
    if block.time is None or {"late", "out_of_order"} & flags or not (judged.holds or judged.advance is not None):
        return state
    running = "stopped" not in flags
    gained = 0.0
    if running and state.was_running and state.last_time is not None:
        gained = block.time - state.last_time if judged.advance is None else judged.advance
        gained = max(gained, 0.0)
    return replace(state, running_time=state.running_time + gained, last_time=block.time, was_running=running)


def _latch_name(state: ChannelState, named: Named | None) -> ChannelState:
    """Keep the name of the fault: the present one before the final stage, that of the highest score in it.

    A part that is decided takes the place of one that is not.
    """
    kept = state.named
    if state.detect.t_fs is None and state.detect.t_eol is None:
        return replace(state, named=named)
    if named is None or (kept is not None and _weight(named) <= _weight(kept)):
        return state
    return replace(state, named=named)


def _weight(named: Named) -> tuple[bool, float]:
    return not named.candidates, named.standing
