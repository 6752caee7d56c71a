"""Alarms of one channel: levels with hysteresis, delays, gating and latching, and the channel's status."""

from __future__ import annotations

from monitor.health.alarms.rules import acknowledge, acknowledged, condition_of, limit_of, machine_state, step
from monitor.health.alarms.state import (
    BAD_DATA,
    CHECK,
    FAILURE,
    MAINTENANCE,
    NO_DATA,
    NORMAL,
    OUT_OF_SPECIFICATION,
    SEVERITIES,
    AlarmAcknowledgement,
    AlarmInput,
    AlarmOutput,
    AlarmSettings,
    AlarmState,
    Change,
    Level,
    LevelState,
    Rule,
    RuleState,
    Span,
)

__all__ = [
    "BAD_DATA",
    "CHECK",
    "FAILURE",
    "MAINTENANCE",
    "NORMAL",
    "NO_DATA",
    "OUT_OF_SPECIFICATION",
    "SEVERITIES",
    "AlarmAcknowledgement",
    "AlarmInput",
    "AlarmOutput",
    "AlarmSettings",
    "AlarmState",
    "Change",
    "Level",
    "LevelState",
    "Rule",
    "RuleState",
    "Span",
    "acknowledge",
    "acknowledged",
    "condition_of",
    "limit_of",
    "machine_state",
    "step",
]
