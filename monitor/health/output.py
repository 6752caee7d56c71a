"""Output of the stages for a block, and its events and issued forecasts as the store keeps them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from monitor.health.alarms import (
    BAD_DATA,
    OUT_OF_SPECIFICATION,
    SEVERITIES,
    AlarmAcknowledgement,
    AlarmOutput,
    AlarmSettings,
    AlarmState,
)
from monitor.health.gears.naming import NAMED, GearsOutput
from monitor.health.later_stages import ChannelBlock
from monitor.health.name.machine import BearingVerdict
from monitor.health.name.naming import Naming
from monitor.health.onset import DetectOutput, DetectState
from monitor.health.record import plain
from monitor.health.rest.trend import TimeToAlarm
from monitor.health.signal.features import BlockFeatures
from monitor.health.signal.transform import Band
from monitor.health.size import Damage, Remaining
from monitor.health.state import ChannelSettings

Events = list[dict[str, Any]]


_REPORTED = (BAD_DATA, OUT_OF_SPECIFICATION)


"""An event says when a channel enters or leaves one of these."""


@dataclass(frozen=True)
class ChannelOutput:
    """Output of one block for one channel; None for stages that did not run.

    Attributes:
        settings: of the channel.
        stage: stage of life after the block.
        bands: bands that were demodulated, Hz.
        band_source: "configured", "learning", "recording" (chosen from a single short recording) or "provisional".
        leading: index of the band on which the fault was named; 0 where none was.
        naming: of the damaged part, from the averaged envelope spectrum.
        damage: equivalent damaged volume, or None where the channel is not tracked.
        forecasts: one for each threshold.
        to_alarm: time to the alarm level.
        gears: what is said of the wheels, None without gears.
    """

    block: ChannelBlock
    settings: ChannelSettings
    stage: str
    bands: tuple[Band, ...] = ()
    band_source: str = "configured"
    features: BlockFeatures | None = None
    leading: int = 0
    naming: Naming | None = None
    detection: DetectOutput | None = None
    damage: Damage | None = None
    forecasts: tuple[Remaining, ...] = ()
    to_alarm: TimeToAlarm | None = None
    gears: GearsOutput | None = None


def issued_forecasts(output: ChannelOutput) -> list[dict[str, Any]]:
    """Return the forecasts of a channel as issued, units in the keys; see ``monitor.records.archive``."""
    settings = output.settings
    return [
        {
            "channel": settings.name,
            "method": "thesis" if settings.damage is None else settings.damage.forecast_method,
            "threshold_mm2": result.threshold * 1e6,
            "status": str(result.status),
            **{f"{name}_s": plain(getattr(result, name)) for name in ("tt", "tt_lower", "tt_upper")},
            "p_threshold": plain(result.p_threshold),
            "p_no_growth": plain(result.p_no_growth),
            "p_crossed": plain(result.p_crossed),
            "quantiles_s": {str(level): value for level, value in result.quantiles} or None,
        }
        for result in output.forecasts
        if result.status != "not_final_stage"
    ]


def channel_events(detector: DetectState, output: ChannelOutput) -> Iterator[dict[str, Any]]:
    """Yield the events that became known with the block of a channel: stages of life, baseline, a named wheel."""
    detection, gears, channel, block = output.detection, output.gears, output.settings.name, output.block.sequence
    if detection is not None:
        if detection.alarm and detector.t_fs is not None and detector.t_fs_known is not None:
            yield {
                "kind": "final_stage",
                "channel": channel,
                "block": detector.t_fs_known.sequence,
                "t_fs_block": detector.t_fs.sequence,
                "score": detection.score,
                "feature": detection.leading,
            }
        if (closed := detection.closed) is not None:
            yield {
                "kind": "final_stage_closed",
                "channel": channel,
                "block": closed.closed.sequence,
                "t_fs_block": closed.began.sequence,
                "t_fs_known_block": closed.known.sequence,
                "quiet_since_block": closed.quiet.sequence,
                **{f"{name}_s": getattr(closed, name).time for name in ("began", "known", "quiet", "closed")},
            }
        if detection.end and detector.t_eol is not None:
            yield {"kind": "end_of_life", "channel": channel, "block": detector.t_eol.sequence}
        if (learned := detection.relearned) is not None:
            levels = {"rms_before_si": learned.rms_before, "rms_after_si": learned.rms_after}
            yield {"kind": "baseline_relearned", "channel": channel, "block": block, **levels}
    if gears is not None and gears.changed:
        yield {
            "kind": "fault_changed",
            "channel": channel,
            "block": block,
            "from": None if gears.replaced is None else NAMED + gears.replaced,
            "to": gears.fault,
            "gear_kind": gears.kind,
        }


def name_events(sequence: int, bearings: Mapping[str, BearingVerdict]) -> Events:
    """Return the events of the bearings whose verdict names another part from this block on."""
    return [
        {
            "kind": "fault_changed",
            "channel": verdict.channels[0],
            "block": sequence,
            "bearing": bearing,
            "from": verdict.replaced,
            "to": verdict.fault,
            "support": None if verdict.support is None else round(verdict.support, 4),
        }
        for bearing, verdict in bearings.items()
        if verdict.replaced is not None
    ]


def release_events(
    given: AlarmAcknowledgement, sequence: int, before: AlarmState, after: AlarmState, settings: AlarmSettings
) -> Events:
    """Return the events of the latches that an acknowledgement released."""
    feature = next((rule.feature for rule in settings.rules if rule.name == given.rule), None)
    return [
        {
            "kind": "alarm_released",
            "channel": given.channel,
            "block": sequence,
            "rule": given.rule,
            "feature": feature,
            "severity": severity,
            "since_block": held.since,
            "acknowledged_utc_s": given.utc,
        }
        for severity in SEVERITIES
        if (held := before.level(given.rule, severity)).held and not after.level(given.rule, severity).held
    ]


def alarm_events(channel: str, sequence: int, output: AlarmOutput) -> Events:
    """Return the events of what a block changed in the alarms and the status of a channel."""
    events: Events = [
        {
            "kind": f"alarm_{change.kind}",
            "channel": channel,
            "block": sequence,
            "rule": change.rule,
            "feature": change.feature,
            "severity": change.severity,
            **(
                {"since_block": change.since}
                if change.kind == "withdrawn"
                else {"value_si": change.value, "level_si": change.level}
            ),
        }
        for change in output.changes
    ]
    before, now = output.condition_before, output.condition
    if before != now and (before in _REPORTED or now in _REPORTED):
        events.append({"kind": "condition", "channel": channel, "block": sequence, "from": before, "to": now})
    return events
