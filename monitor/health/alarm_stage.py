"""The alarm stage of a source: a record and the states that led to it in, states and alarm events out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from monitor.health.alarms import (
    BAD_DATA,
    OUT_OF_SPECIFICATION,
    SEVERITIES,
    AlarmInput,
    AlarmOutput,
    AlarmSettings,
    AlarmState,
    acknowledge,
    step,
)
from monitor.health.detect import DetectState
from monitor.health.quality import Verdict
from monitor.health.record import Record
from monitor.health.state import SourceSettings, SourceState

_BAD_FLAGS = {"flat", "clipped", "clock"}
_REPORTED = (BAD_DATA, OUT_OF_SPECIFICATION)
"""An event says when a channel enters or leaves one of these."""

Events = list[dict[str, Any]]


@dataclass(frozen=True)
class AlarmAcknowledgement:
    """Acknowledgement of an alarm: ``sequence`` is the block that raised it, ``utc`` in s since 1970."""

    channel: str
    rule: str
    severity: str
    sequence: int
    utc: float


def acknowledged(states: Mapping[str, AlarmState], given: Sequence[AlarmAcknowledgement]) -> dict[str, AlarmState]:
    """Return the alarm states by channel with all latches released that acknowledgements are for."""
    after = dict(states)
    for item in given:
        if item.channel in after:
            after[item.channel] = acknowledge(after[item.channel], item.rule, item.sequence, item.severity)
    return after


def alarm_step(
    state: SourceState,
    record: Record,
    verdicts: Mapping[str, Verdict],
    settings: SourceSettings,
    acknowledgements: Sequence[AlarmAcknowledgement] = (),
) -> tuple[dict[str, AlarmState], Events]:
    """Take a record into the alarm states of all channels.

    An acknowledgement takes effect before the block, whose record says so: the same blocks and the same
    acknowledgements before them give the same records.

    Args:
        state: its channels as they are after the block.
        record: without alarm events.
        verdicts: by channel, none where the block was rejected as a whole.
    """
    states, events = dict(state.alarms), Events()
    for given in acknowledgements:
        if given.channel in states:
            before = states[given.channel]
            states |= acknowledged({given.channel: before}, (given,))
            rules = settings.channels[given.channel].alarms
            events += _release_events(given, record.sequence, before, states[given.channel], rules)
    for name, channel in settings.channels.items():
        block = _input(record, name, state.channels[name].detect, verdicts.get(name))
        states[name], output = step(states[name], block, channel.alarms)
        events += _events(name, record.sequence, output)
    return states, events


def _input(record: Record, channel: str, detector: DetectState, verdict: Verdict | None) -> AlarmInput:
    learned = detector.baseline
    return AlarmInput(
        sequence=record.sequence,
        usable=verdict is not None and verdict.for_baseline,
        bad=verdict is None or not verdict.accepted or bool(_BAD_FLAGS & set(verdict.flags)),
        stage=detector.stage,
        values=record.channels.get(channel, {}),
        baselines={} if learned is None else {"rms": (learned.ln_rms, learned.ln_rms_sd)},
    )


def _release_events(
    given: AlarmAcknowledgement, sequence: int, before: AlarmState, after: AlarmState, settings: AlarmSettings
) -> Events:
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


def _events(channel: str, sequence: int, output: AlarmOutput) -> Events:
    events: Events = [
        {
            "kind": f"alarm_{change.kind}",
            "channel": channel,
            "block": sequence,
            "rule": change.rule,
            "feature": change.feature,
            "severity": change.severity,
            "value_si": change.value,
            "level_si": change.level,
        }
        for change in output.changes
    ]
    before, now = output.condition_before, output.condition
    if before != now and (before in _REPORTED or now in _REPORTED):
        events.append({"kind": "condition", "channel": channel, "block": sequence, "from": before, "to": now})
    return events
