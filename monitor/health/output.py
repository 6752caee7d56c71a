"""Output of the stages for a block, and its events and issued forecasts as the store keeps them."""

from __future__ import annotations

from collections.abc import Mapping
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
from monitor.health.gears.naming import GearsOutput
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


def issued_forecasts(channel: str, output: ChannelOutput, method: str) -> list[dict[str, Any]]:
    """Return the forecasts of a channel as issued, units in the keys; see ``monitor.records.archive``."""
    return [
        {
            "channel": channel,
            "method": method,
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


def stage_events(channel: str, detector: DetectState, output: ChannelOutput) -> Events:
    """Return the events of the stages of life that became known with the block."""
    events: Events = []
    detection = output.detection
    if detection is None:
        return events
    if detection.alarm and detector.t_fs is not None and detector.t_fs_known is not None:
        events.append(
            {
                "kind": "final_stage",
                "channel": channel,
                "block": detector.t_fs_known.sequence,
                "t_fs_block": detector.t_fs.sequence,
                "score": detection.score,
                "feature": detection.leading,
            }
        )
    if (closed := detection.closed) is not None:
        events.append(
            {
                "kind": "final_stage_closed",
                "channel": channel,
                "block": closed.closed.sequence,
                "t_fs_block": closed.began.sequence,
                "t_fs_known_block": closed.known.sequence,
                "quiet_since_block": closed.quiet.sequence,
                **{f"{name}_s": getattr(closed, name).time for name in ("began", "known", "quiet", "closed")},
            }
        )
    if detection.end and detector.t_eol is not None:
        events.append({"kind": "end_of_life", "channel": channel, "block": detector.t_eol.sequence})
    return events


def baseline_events(channel: str, sequence: int, output: ChannelOutput) -> Events:
    """Return the event of a baseline that was learned anew with a block, or none."""
    found = None if output.detection is None else output.detection.relearned
    if found is None:
        return []
    levels = {"rms_before_si": found.rms_before, "rms_after_si": found.rms_after}
    return [{"kind": "baseline_relearned", "channel": channel, "block": sequence, **levels}]


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
