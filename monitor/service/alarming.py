"""The alarm stage of a watcher: a record and the states that led to it in, the record with its alarm events out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from monitor.health.alarms import (
    BAD_DATA,
    OUT_OF_SPECIFICATION,
    SEVERITIES,
    AlarmInput,
    AlarmOutput,
    AlarmSettings,
    AlarmState,
    LevelState,
    RuleState,
    acknowledge,
    condition_of,
    limit_of,
    step,
)
from monitor.health.quality import Verdict
from monitor.health.record import Record
from monitor.health.state import ChannelState
from monitor.health.step import ChannelOutput

_BAD_FLAGS = {"flat", "clipped", "clock"}
_TOLD = (BAD_DATA, OUT_OF_SPECIFICATION)


@dataclass(frozen=True)
class Acknowledged:
    """That somebody knows of an alarm.

    Attributes:
        source: of the block that raised it.
        channel: for which it was raised.
        rule: that raised it.
        severity: "alert" or "danger".
        sequence: block that raised it.
        utc: when it was acknowledged, seconds since 1970.
    """

    source: str
    channel: str
    rule: str
    severity: str
    sequence: int
    utc: float


class Alarming:
    """Carries the alarm states of the channels of one source from block to block.

    An acknowledgement takes effect with the next block, whose record says so: given the same blocks and the same
    acknowledgements before them, records are the same. How a channel stands shows it at once.
    """

    def __init__(self, source: str, settings: Mapping[str, AlarmSettings]) -> None:
        """Begin with fresh states for the channels named in ``settings``."""
        self._source, self._settings = source, dict(settings)
        self._states = {name: AlarmState() for name in settings}
        self._waiting: tuple[Acknowledged, ...] = ()

    def restore(self, states: Mapping[str, Mapping[str, Any]]) -> None:
        """Take up the states that a store gives back."""
        for name in self._states:
            if self._key(name) in states:
                self._states[name] = AlarmState.from_dict(states[self._key(name)])

    def states(self) -> dict[str, dict[str, Any]]:
        """Return the states by name, to be committed with the record."""
        return {self._key(name): state.to_dict() for name, state in self._states.items()}

    def state(self, channel: str) -> AlarmState:
        """Return the state of one channel, all that was acknowledged let go."""
        state = self._states[channel]
        for given in self._waiting:
            if given.channel == channel:
                state = acknowledge(state, given.rule, given.sequence, given.severity)
        return state

    def acknowledge(self, given: Acknowledged) -> bool:
        """Let go of what a rule holds since a block or before, with the next block.

        Returns:
            Whether it holds anything: False for what was never latched, and for what was let go before.
        """
        if given.channel not in self._states:
            return False
        before = self.state(given.channel)
        if acknowledge(before, given.rule, given.sequence, given.severity) == before:
            return False
        self._waiting = (*self._waiting, given)
        return True

    def condition(self, channel: str, state: ChannelState) -> str:
        """Return how a channel stands, given the state of its other stages."""
        return condition_of(self.state(channel), self._settings[channel], **_stage(state))

    def standing(self, channel: str) -> list[dict[str, Any]]:
        """Return the alarms of a channel that stand, dangers first, as plain values for the status."""
        return [
            {
                "rule": rule.name,
                "feature": rule.feature,
                "severity": severity,
                "active": level.active,
                "latched": level.held,
                "since_block": level.since,
            }
            for severity in reversed(SEVERITIES)
            for rule in self._settings[channel].rules
            if (level := _level(self.state(channel), rule.name, severity)).shown
        ]

    def levels(self, channel: str) -> list[dict[str, Any]]:
        """Return where the levels of a channel stand, SI; None where one is not configured, or not learned yet."""
        rules = self._states[channel].rules
        return [
            {
                "rule": rule.name,
                "feature": rule.feature,
                "side": rule.side,
                **{
                    f"{severity}_si": limit_of(
                        rule, getattr(rule, severity), rules.get(rule.name, RuleState()).baseline
                    )
                    for severity in SEVERITIES
                },
            }
            for rule in self._settings[channel].rules
        ]

    def after(
        self, record: Record, states: Mapping[str, ChannelState], outputs: Mapping[str, ChannelOutput] | None
    ) -> Record:
        """Return the record with the alarm events that it leads to.

        Args:
            record: of a block.
            states: of the channels after it.
            outputs: what the block said of them, or None where it was rejected as a whole.
        """
        events: list[dict[str, Any]] = list(self._let_go(record.sequence))
        for name, settings in self._settings.items():
            output = None if outputs is None else outputs.get(name)
            block = _input(record, name, states[name], None if output is None else output.verdict)
            self._states[name], said = step(self._states[name], block, settings)
            events += _events(name, record.sequence, said)
        return replace(record, events=(*record.events, *events)) if events else record

    def _let_go(self, sequence: int) -> Iterator[dict[str, Any]]:
        """Do what the acknowledgements ask for; yield what a record says of it."""
        waiting, self._waiting = self._waiting, ()
        for given in waiting:
            before = self._states[given.channel]
            after = acknowledge(before, given.rule, given.sequence, given.severity)
            self._states[given.channel] = after
            feature = next((r.feature for r in self._settings[given.channel].rules if r.name == given.rule), None)
            for severity in SEVERITIES:
                held = _level(before, given.rule, severity)
                if held.held and not _level(after, given.rule, severity).held:
                    yield {
                        "kind": "alarm_released",
                        "channel": given.channel,
                        "block": sequence,
                        "rule": given.rule,
                        "feature": feature,
                        "severity": severity,
                        "since_block": held.since,
                        "acknowledged_utc_s": given.utc,
                    }

    def _key(self, channel: str) -> str:
        return f"alarms:{self._source}:{channel}"


def _input(record: Record, channel: str, state: ChannelState, verdict: Verdict | None) -> AlarmInput:
    values = record.channels.get(channel, {})
    detector = state.detect
    learned = detector.baseline
    return AlarmInput(
        sequence=record.sequence,
        usable=verdict is not None and verdict.for_baseline,
        bad=verdict is None or not verdict.accepted or bool(_BAD_FLAGS & set(verdict.flags)),
        values=values,
        speed=values.get("speed"),
        load=values.get("load"),
        **_stage(state),
        edv_status=values.get("edv_status"),
        baselines={} if learned is None else {"rms": (learned.ln_rms, learned.ln_rms_sd)},
    )


def _stage(state: ChannelState) -> dict[str, bool]:
    """Return what of its stage of life moves how a channel stands."""
    detector = state.detect
    return {
        "learning": detector.stage == "learning",
        "final": detector.t_fs is not None,
        "ended": detector.t_eol is not None,
    }


def _level(state: AlarmState, rule: str, severity: str) -> LevelState:
    known = state.rules.get(rule)
    return LevelState() if known is None else getattr(known, severity)


def _events(channel: str, sequence: int, said: AlarmOutput) -> list[dict[str, Any]]:
    events: list[dict[str, Any]] = [
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
        for change in said.changes
    ]
    before, now = said.condition_before, said.condition
    if before != now and (before in _TOLD or now in _TOLD):
        events.append({"kind": "condition", "channel": channel, "block": sequence, "from": before, "to": now})
    return events
