"""The alarm stage of a watcher: a record and the states that led to it in, the record with its alarm events out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from monitor.health.alarms import (
    BAD_DATA,
    OUT_OF_SPECIFICATION,
    AlarmInput,
    AlarmOutput,
    AlarmSettings,
    AlarmState,
    acknowledge,
    step,
)
from monitor.health.pipeline import ChannelOutput
from monitor.health.quality import Verdict
from monitor.health.state import ChannelState
from monitor.records.record import Record

_BAD_FLAGS = {"flat", "clipped", "clock"}
_TOLD = (BAD_DATA, OUT_OF_SPECIFICATION)


class Alarming:
    """Carries the alarm states of the channels of one source from block to block."""

    def __init__(self, source: str, settings: Mapping[str, AlarmSettings]) -> None:
        """Begin with fresh states for the channels named in ``settings``."""
        self._source, self._settings = source, dict(settings)
        self._states = {name: AlarmState() for name in settings}

    def restore(self, states: Mapping[str, Mapping[str, Any]]) -> None:
        """Take up the states that a store gives back."""
        for name in self._states:
            if self._key(name) in states:
                self._states[name] = AlarmState.from_dict(states[self._key(name)])

    def states(self) -> dict[str, dict[str, Any]]:
        """Return the states by name, to be committed with the record."""
        return {self._key(name): state.to_dict() for name, state in self._states.items()}

    def state(self, channel: str) -> AlarmState:
        """Return the state of one channel."""
        return self._states[channel]

    def acknowledge(self, channel: str, rule: str, sequence: int) -> None:
        """Let go of what a rule of a channel holds since a block or before; it is committed with the next block."""
        if channel in self._states:
            self._states[channel] = acknowledge(self._states[channel], rule, sequence)

    def after(
        self, record: Record, states: Mapping[str, ChannelState], outputs: Mapping[str, ChannelOutput] | None
    ) -> Record:
        """Return the record with the alarm events that it leads to.

        Args:
            record: of a block.
            states: of the channels after it.
            outputs: what the block said of them, or None where it was rejected as a whole.
        """
        events: list[dict[str, Any]] = []
        for name, settings in self._settings.items():
            output = None if outputs is None else outputs.get(name)
            block = _input(record, name, states[name], None if output is None else output.verdict)
            self._states[name], said = step(self._states[name], block, settings)
            events += _events(name, record.sequence, said)
        return replace(record, events=(*record.events, *events)) if events else record

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
        learning=detector.stage == "learning",
        values=values,
        speed=values.get("speed"),
        load=values.get("load"),
        final=detector.t_fs is not None,
        ended=detector.t_eol is not None,
        edv_status=values.get("edv_status"),
        baselines={} if learned is None else {"rms": (learned.ln_rms, learned.ln_rms_sd)},
    )


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
