"""What follows from the onset for one channel: V_eq and TT by the tracker, the time to the alarm level by the trend."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from monitor.health import onset as detect
from monitor.health import tracker as damage
from monitor.health.rest import trend
from monitor.health.size import Damage, DamageInput, Remaining
from monitor.health.state import ChannelSettings, ChannelState

if TYPE_CHECKING:
    from monitor.health.channel import ChannelBlock


def level_status(detection: detect.DetectOutput) -> str | None:
    """Return the status of the level relative to the condition of the block; None where none is learned."""
    if detection.outside:
        return "outside_conditions"
    return None if detection.level is None else "ok"


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
        usable=block.verdict.for_tracker,
        absolute=settings.absolute,
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
        usable=block.verdict.for_tracker,
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
