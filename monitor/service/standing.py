"""The status of a channel for people: the alarms that it shows, their levels, and its NAMUR NE 107 status."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from monitor.health.alarm_stage import life_stage
from monitor.health.alarms import (
    BAD_DATA,
    FAILURE,
    MAINTENANCE,
    NO_DATA,
    SEVERITIES,
    AlarmSettings,
    AlarmState,
    RuleState,
    condition_of,
    limit_of,
    machine_state,
)
from monitor.health.state import SourceState
from monitor.words.statuses import STATES

_SEVERITIES = {FAILURE: "danger", MAINTENANCE: "alert"}
_STAGES = {FAILURE: ("end_of_life", "the end of life was reached"), MAINTENANCE: ("final", "the final stage has begun")}


def shown_alarms(state: AlarmState, settings: AlarmSettings) -> list[dict[str, Any]]:
    """Return the alarms of a channel that are active or latched, dangers first."""
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
        for rule in settings.rules
        if (level := state.level(rule.name, severity)).shown
    ]


def alarm_levels(state: AlarmState, settings: AlarmSettings) -> list[dict[str, Any]]:
    """Return the levels of a channel, SI; None for one that is not configured, or not learned yet."""
    found = []
    for rule in settings.rules:
        baseline = state.rules.get(rule.name, RuleState()).baseline
        limits = {f"{severity}_si": limit_of(rule, getattr(rule, severity), baseline) for severity in SEVERITIES}
        found.append({"rule": rule.name, "feature": rule.feature, "side": rule.side, **limits})
    return found


def channel_condition(state: SourceState, channel: str, settings: AlarmSettings) -> str:
    """Return the status of a channel by its blocks alone, acknowledgements since the latest one included."""
    return condition_of(state.alarms[channel], settings, **life_stage(state.channels[channel].detect))


def channel_state(
    condition: str,
    standing: Sequence[Mapping[str, Any]] = (),
    *,
    stage: str = "healthy",
    silent: str | None = None,
    refused: str | None = None,
) -> tuple[str, str]:
    """Return the state of a channel after NAMUR NE 107, the worst of all that holds, and why, in words.

    Args:
        condition: what the alarm stage makes of its blocks.
        standing: its alarms that stand.
        stage: of its life.
        silent: where its blocks stay away, since when.
        refused: where its latest block was rejected, why.
    """
    state = machine_state(condition, *([NO_DATA] if silent else []), *([BAD_DATA] if refused else []))
    reached, text = _STAGES.get(state, ("", ""))
    said = [text] if stage == reached else []
    for alarm in standing:
        if alarm["severity"] == _SEVERITIES.get(state):
            waits = "" if alarm["active"] else ", which is over and waits to be acknowledged"
            said.append(f"{alarm['severity']} of {alarm['rule']} since block {alarm['since_block']}{waits}")
    given = {NO_DATA: silent, BAD_DATA: refused}.get(state)
    return state, "; ".join(said) or given or STATES[state][1]
