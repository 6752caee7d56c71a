"""One block through the rules of a channel, acknowledgements, and the status that follows.

A rejected block, or one outside the operating state of a rule, leaves the rule unchanged, counters included. Levels are
given, or follow from the learning stage: median and robust standard deviation of the logarithm.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, cast

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
from monitor.health.gears.values import UNNAMED
from monitor.health.onset import END_OF_LIFE, FINAL, LEARNING, median_and_sd

_MAX_LEARNED = 512
_MAX_EXPONENT = math.log(sys.float_info.max)
_WORST_FIRST = (FAILURE, NO_DATA, BAD_DATA, OUT_OF_SPECIFICATION, MAINTENANCE, CHECK, NORMAL)
_OF_EPISODE = frozenset(
    {"v_eq", "v_eq_lower", "v_eq_upper", "v_eq_relative", "tt", "tt_lower", "tt_upper", "p_threshold"}
    | {"v_eq_filter", "v_eq_filter_lower", "v_eq_filter_upper"}
)
"""Features that have values in the final stage only."""
_REFUSALS = frozenset(
    {"above_map", "ambiguous", "outside_conditions", "outside_library", "no_absolute_level", "no_map", "no_library"}
    | {"implausible", "not_this_part", "velocity_sensor"}
)


def step(state: AlarmState, block: AlarmInput, settings: AlarmSettings) -> tuple[AlarmState, AlarmOutput]:
    """Apply one block to the state; return it with the changes."""
    recent = (*state.recent_bad, block.bad)[-settings.window :]
    seen = state.seen + (1 if block.usable else 0)
    rules: dict[str, RuleState] = {}
    changes: list[Change] = []
    for rule in settings.rules:
        if rule.suspended:
            rules[rule.name] = RuleState()
            continue
        known = state.rules.get(rule.name, RuleState())
        value = _worst(block.values.get(rule.feature), rule.side)
        if block.usable and value is not None and applies(rule, block.values):
            given = block.baselines.get(rule.feature)
            learning = block.stage == LEARNING
            known = _learn(known, value, given, learning=learning, settled=seen > settings.run_in_blocks)
            relative = block.at_reference.get(rule.feature, value)
            known, changed = _check(known, rule, value, relative, block.sequence)
            changes += changed
        if block.closed and rule.feature in _OF_EPISODE:
            known, changed = _withdraw(known, rule)
            changes += changed
        rules[rule.name] = known
    # A block without a verdict of the tracker leaves its refusal in place.
    refusing = _refuses(block.values, settings) if block.usable else state.refusing
    after = AlarmState(seen=seen, recent_bad=recent, rules=rules, refusing=refusing)
    condition = condition_of(after, settings, block.stage, gear=_gear_named(block.values))
    return replace(after, condition=condition), AlarmOutput(tuple(changes), condition, state.condition)


def _refuses(values: Mapping[str, Any], settings: AlarmSettings) -> bool:
    """Return whether the tracker gives no V_eq, or one that a suspended rule cannot be applied to."""
    return values.get("edv_status") in _REFUSALS or (values.get("v_eq") is not None and bool(settings.suspended))


def acknowledge(state: AlarmState, rule: str, sequence: int, severity: str = "danger") -> AlarmState:
    """Release what a rule has latched at or before a block; idempotent.

    Args:
        sequence: of the block whose alarm was acknowledged.
        severity: of that alarm; acknowledging a danger includes the alert, not the reverse.
    """
    known = state.rules.get(rule)
    if known is None:
        return state

    def release(level: LevelState) -> LevelState:
        past = level.since is not None and level.since <= sequence
        return replace(level, held=False) if past else level

    danger = release(known.danger) if severity == "danger" else known.danger
    released = replace(known, alert=release(known.alert), danger=danger)
    return replace(state, rules={**state.rules, rule: released})


def acknowledged(states: Mapping[str, AlarmState], given: Sequence[AlarmAcknowledgement]) -> dict[str, AlarmState]:
    """Return the alarm states by channel with all latches released that acknowledgements are for."""
    after = dict(states)
    for item in given:
        if item.channel in after:
            after[item.channel] = acknowledge(after[item.channel], item.rule, item.sequence, item.severity)
    return after


def _gear_named(values: Mapping[str, Any]) -> bool:
    """Return whether a wheel of the gears is named as damaged after a block."""
    named: Any = values.get("gear_fault")
    kinds = cast("tuple[str | None, ...]", named) if isinstance(named, tuple) else (named,)
    return any(kind not in (None, UNNAMED) for kind in kinds)


def condition_of(state: AlarmState, settings: AlarmSettings, stage: str, *, gear: bool = False) -> str:
    """Return the worst status of a channel that applies, in the order of :func:`machine_state`.

    Rules that are no longer configured do not count; ``stage`` is that of life, ``gear`` whether a wheel is named.
    """
    rules = [state.rules.get(rule.name, RuleState()) for rule in settings.rules]
    recent = state.recent_bad
    holds = {
        FAILURE: stage == END_OF_LIFE or any(rule.danger.shown for rule in rules),
        BAD_DATA: len(recent) == settings.window and sum(recent) >= settings.bad_share * settings.window,
        OUT_OF_SPECIFICATION: state.refusing,
        MAINTENANCE: stage == FINAL or gear or any(rule.alert.shown for rule in rules),
        CHECK: stage == LEARNING,
        NORMAL: True,
    }
    return machine_state(*(condition for condition, true in holds.items() if true))


def limit_of(rule: Rule, level: Level | None, baseline: Span | None) -> float | None:
    """Return the value of a level, SI; None where not configured or not learned yet."""
    if level is None or level.value is not None:
        return None if level is None else level.value
    if baseline is None:
        return None
    middle, spread = baseline
    sign = 1.0 if rule.side == "above" else -1.0
    # Deviations can reach beyond the largest float where the learned values are nearly 0.
    if level.deviations is not None:
        return math.exp(min(middle + sign * level.deviations * math.hypot(spread, rule.drift), _MAX_EXPONENT))
    return min(math.exp(middle) * (level.factor or 1.0), sys.float_info.max)


def machine_state(*states: str) -> str:
    """Return the worst of several statuses of channels or machines, ``no_data`` for none.

    From the worst: failure, no_data, bad_data, out_of_specification, maintenance_required, check_function, normal. A
    known danger outranks missing data; missing or bad data and a tracker without a result outrank an alert, as the
    damage may be worse by now.
    """
    return min(states, key=_WORST_FIRST.index, default=NO_DATA)


def _worst(value: object, side: str) -> float | None:
    """Return the worst of one or several values, or None without any."""
    items = cast("Sequence[object]", value) if isinstance(value, list | tuple) else (value,)
    found = [float(item) for item in items if isinstance(item, float | int) and math.isfinite(item)]
    if not found:
        return None
    return max(found) if side == "above" else min(found)


def applies(rule: Rule, values: Mapping[str, Any]) -> bool:
    """Return whether ``speed`` and ``load`` are in the ranges of a rule; an unknown one is in no range."""

    def within(value: float | None, span: Span | None) -> bool:
        return span is None or (value is not None and span[0] <= value <= span[1])

    return within(values.get("speed"), rule.speed) and within(values.get("load"), rule.load)


def _learn(known: RuleState, value: float, given: Span | None, *, learning: bool, settled: bool) -> RuleState:
    """Collect values while learning; freeze them at its end, or follow the detector's baseline."""
    if given is not None and not learning:
        return known if known.baseline == given else replace(known, learned=(), baseline=given)
    if known.baseline is not None:
        return known
    if learning:
        if not settled or value <= 0.0:
            return known
        return replace(known, learned=(*known.learned, math.log(value))[-_MAX_LEARNED:])
    if not known.learned:
        return known
    return replace(known, learned=(), baseline=median_and_sd(known.learned))


def _check(
    known: RuleState, rule: Rule, value: float, relative: float | None, sequence: int
) -> tuple[RuleState, list[Change]]:
    """Compare a value with the levels that are given, and ``relative`` with those that follow from the baseline."""
    changes: list[Change] = []
    after = known
    for severity in SEVERITIES:
        configured: Level | None = getattr(rule, severity)
        limit = limit_of(rule, configured, known.baseline)
        compared = value if configured is None or configured.value is not None else relative
        if limit is None or compared is None:
            continue
        before: LevelState = getattr(known, severity)
        level = move_level(before, rule, compared, limit, sequence)
        after = replace(after, **{severity: level})
        if level.active != before.active:
            kind = "raised" if level.active else "cleared"
            changes.append(Change(kind, rule.name, rule.feature, severity, compared, limit))
    return after, changes


def _withdraw(known: RuleState, rule: Rule) -> tuple[RuleState, list[Change]]:
    """Take back the levels of a rule, which no value will clear; what is latched still waits for an acknowledgement."""
    changes: list[Change] = []
    for severity in SEVERITIES:
        level: LevelState = getattr(known, severity)
        if level.active:
            changes.append(Change("withdrawn", rule.name, rule.feature, severity, None, None, level.since))
        known = replace(known, **{severity: replace(level, active=False, count=0)})
    return known, changes


def move_level(level: LevelState, rule: Rule, value: float, limit: float, sequence: int) -> LevelState:
    """Count blocks towards raising or clearing a level; ``value`` and ``limit`` are in one unit."""
    sign = 1.0 if rule.side == "above" else -1.0
    if not level.active:
        if sign * value < sign * limit:
            return replace(level, count=0) if level.count else level
        if level.count + 1 < rule.on_delay:
            return replace(level, count=level.count + 1)
        return LevelState(active=True, since=sequence, held=rule.latch)
    if sign * value >= sign * limit - rule.hysteresis * abs(limit):
        return replace(level, count=0) if level.count else level
    if level.count + 1 < rule.off_delay:
        return replace(level, count=level.count + 1)
    return replace(level, active=False, count=0)
