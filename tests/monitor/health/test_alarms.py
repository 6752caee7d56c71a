"""Alarms: delays, hysteresis, gating, latching; no alarm from bad blocks; states go through JSON unchanged."""

from __future__ import annotations

import itertools
import json
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.config.alarms import AlarmLevel, AlarmsSection
from monitor.health.alarms import (
    AlarmOutput,
    AlarmSettings,
    AlarmState,
    Level,
    Rule,
    acknowledge,
    limit_of,
    machine_state,
    step,
)
from tests.support.alarms import RULE, block
from tests.support.effort import effort_count

EXAMPLES = effort_count(quick=20, full=2000)


def run(
    values: list[Any], rule: Rule = RULE, state: AlarmState | None = None, **fields: Any
) -> tuple[AlarmState, list[AlarmOutput]]:
    state, outputs = state or AlarmState(), []
    for sequence, value in enumerate(values, 1):
        state, output = step(state, block(sequence, value, **fields), AlarmSettings((rule,)))
        outputs.append(output)
    return state, outputs


def said(outputs: list[AlarmOutput]) -> list[tuple[int, str, str]]:
    return [(n, c.severity, c.kind) for n, output in enumerate(outputs, 1) for c in output.changes]


def test_delays_and_hysteresis() -> None:
    _, outputs = run([11, 5, 11, 11, 9.5, 8, 8, 9.5, 8, 8, 8])
    assert said(outputs) == [(4, "alert", "raised"), (11, "alert", "cleared")]
    assert [output.condition for output in outputs[2:5]] == ["normal", "maintenance_required", "maintenance_required"]


def test_danger_outranks_alert_and_low_values_are_bad_below() -> None:
    state, outputs = run([25, 25])
    assert said(outputs) == [(2, "alert", "raised"), (2, "danger", "raised")]
    assert state.condition == "failure"
    below = Rule("tt", "rms", side="below", alert=Level(10.0), on_delay=1)
    assert said(run([12, (30, 9.0)], below)[1]) == [(2, "alert", "raised")]


def test_levels_from_the_learning_stage() -> None:
    rule = replace(RULE, alert=Level(factor=2.0), danger=Level(deviations=12.0), on_delay=1, drift=0.0)
    state = AlarmState()
    chosen = AlarmSettings((rule,), run_in_blocks=2)
    for sequence, value in enumerate([90.0, 90.0, 0.9, 0.95, 1.0, 1.05, 1.1], 1):
        state, output = step(state, block(sequence, value, stage="learning"), chosen)
        assert not output.changes
        assert output.condition == "check_function"
    state, output = step(state, block(8, 1.9), chosen)
    assert not output.changes
    state, output = step(state, block(9, 2.1), chosen)
    assert [change.level for change in output.changes if change.severity == "alert"] == [pytest.approx(2.0)]
    assert state.rules["rms"].baseline is not None
    assert limit_of(rule, rule.alert, None) is None
    late, output = step(AlarmState(), block(1, 5.0, baselines={"rms": (0.0, 0.1)}), chosen)
    assert late.rules["rms"].baseline == (0.0, 0.1)
    assert output.changes[0].level == pytest.approx(2.0)


def test_gates_hold_the_counters() -> None:
    rule = replace(RULE, speed=(20.0, 40.0), load=(0.0, 100.0))
    state = AlarmState()
    raised = []
    for sequence, (speed, load) in enumerate([(30, 50), (10, 50), (30, 200), (None, 50), (30, 50)], 1):
        state, output = step(state, block(sequence, 15.0, speed=speed, load=load), AlarmSettings((rule,)))
        raised += [sequence] * len(output.changes)
    assert raised == [5]


def test_a_latched_alarm_stands_until_it_is_acknowledged() -> None:
    rule = replace(RULE, latch=True)
    state, outputs = run([15, 15, 5, 5, 5, 5], rule)
    assert said(outputs) == [(2, "alert", "raised"), (5, "alert", "cleared")]
    assert outputs[-1].condition == "maintenance_required"
    assert acknowledge(state, "rms", 1) == state
    released = acknowledge(state, "rms", 2)
    assert acknowledge(released, "rms", 2) == released
    assert acknowledge(released, "other", 2) == released
    both, _ = run([25, 25, 5, 5, 5], rule)
    assert not acknowledge(both, "rms", 2, "alert").rules["rms"].alert.held
    assert acknowledge(both, "rms", 2, "alert").rules["rms"].danger.held
    assert not acknowledge(both, "rms", 2, "danger").rules["rms"].alert.held
    assert step(released, block(7, 5.0), AlarmSettings((rule,)))[1].condition == "normal"


def test_what_is_not_known_is_never_normal() -> None:
    bad = AlarmSettings((), window=4, bad_share=0.5)
    state = AlarmState()
    conditions = []
    for sequence, wrong in enumerate([False, False, True, True, False, False, False], 1):
        state, output = step(state, block(sequence, 1.0, usable=not wrong, bad=wrong), bad)
        conditions.append(output.condition)
    assert conditions == ["normal"] * 3 + ["bad_data"] * 3 + ["normal"]
    _, outputs = run([1.0], edv_status="outside_conditions")
    assert outputs[-1].condition == "out_of_specification"
    assert run([1.0], stage="final")[1][-1].condition == "maintenance_required"
    assert run([1.0], stage="end_of_life")[1][-1].condition == "failure"


def test_the_worst_channel_speaks_for_the_machine() -> None:
    assert machine_state() == "no_data"
    assert machine_state("normal", "check_function") == "check_function"
    assert machine_state("normal", "no_data", "maintenance_required") == "no_data"
    assert machine_state("no_data", "failure") == "failure"
    assert machine_state("maintenance_required", "out_of_specification") == "out_of_specification"


BLOCKS = st.lists(
    st.tuples(st.one_of(st.none(), st.floats(0.0, 30.0)), st.booleans(), st.booleans(), st.booleans()), max_size=60
)
RULES = st.builds(
    Rule,
    name=st.just("rms"),
    feature=st.just("rms"),
    alert=st.sampled_from([Level(10.0), Level(factor=2.0), None]),
    danger=st.sampled_from([Level(20.0), Level(deviations=3.0)]),
    hysteresis=st.sampled_from([0.0, 0.1, 0.5]),
    on_delay=st.integers(1, 4),
    off_delay=st.integers(1, 4),
    latch=st.booleans(),
)


@settings(max_examples=EXAMPLES)
@given(blocks=BLOCKS, rule=RULES, cut=st.integers(0, 60))
def test_a_restart_changes_nothing(blocks: list[Any], rule: Rule, cut: int) -> None:
    chosen = AlarmSettings((rule,), window=5)
    one = other = AlarmState()
    for sequence, (value, usable, bad, learning) in enumerate(blocks, 1):
        item = block(sequence, value, usable=usable, bad=bad, stage="learning" if learning else "healthy")
        one, said_one = step(one, item, chosen)
        if sequence == cut:
            other = AlarmState.from_dict(json.loads(json.dumps(other.to_dict())))
        other, said_other = step(other, item, chosen)
        assert (one, said_one) == (other, said_other)
    assert AlarmState.from_dict(json.loads(json.dumps(one.to_dict()))) == one


@settings(max_examples=EXAMPLES)
@given(values=st.lists(st.floats(0.0, 1e9), max_size=40), rule=RULES)
def test_bad_blocks_raise_nothing_and_clear_nothing(values: list[float], rule: Rule) -> None:
    for state in (AlarmState(), run([30.0] * 6, replace(rule, alert=Level(1.0), danger=Level(2.0)))[0]):
        after, outputs = run(values, rule, state, usable=False, bad=True)
        assert said(outputs) == []
        assert after.rules == (state.rules if values or state.rules else {}) or not state.rules


@settings(max_examples=EXAMPLES)
@given(values=st.lists(st.floats(0.0, 30.0), max_size=80), rule=RULES)
def test_no_more_changes_than_crossings_and_delays_are_kept(values: list[float], rule: Rule) -> None:
    rule = replace(rule, alert=Level(10.0), danger=None)
    _, outputs = run(values, rule)
    changes = said(outputs)
    above = [value >= 10.0 for value in (0.0, *values)]
    crossings = sum(a != b for a, b in itertools.pairwise(above))
    assert len(changes) <= crossings
    for number, _, kind in changes:
        delay = rule.on_delay if kind == "raised" else rule.off_delay
        run_of = values[number - delay : number]
        assert len(run_of) == delay
        assert all((value >= 10.0) if kind == "raised" else (value < 10.0) for value in run_of)
    assert [kind for *_, kind in changes] == (["raised", "cleared"] * len(changes))[: len(changes)]


def test_configured_levels_become_si() -> None:
    rule = AlarmLevel(feature="rms", alert_g=1.0, danger_g=2.0).to_rule()
    assert rule.alert == Level(value=9.80665)
    assert AlarmLevel(feature="tt_lower", alert_hours=2.0).to_rule().side == "below"
    assert AlarmLevel(feature="v_eq_upper", danger_mm2=0.05).to_rule().danger == Level(value=0.05 * 1e-6)
    assert AlarmLevel(feature="kurtosis", alert_sd=4.0).to_rule().alert == Level(deviations=4.0)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"feature": "rms"}, "neither alert_g nor danger_g"),
        ({"feature": "rms", "alert": 1.0}, "allowed is alert_g, alert_factor, alert_sd"),
        ({"feature": "rms", "alert_g": 1.0, "alert_sd": 1.0}, "give one of"),
        ({"feature": "rms", "alert_g": 2.0, "danger_g": 1.0}, "must be above"),
        ({"feature": "tt", "alert_hours": 1.0, "danger_hours": 2.0}, "must be below"),
        ({"feature": "tt", "alert_factor": 1.0}, "does not fit feature 'tt'"),
        ({"feature": "mean", "alert_g": 1.0}, "Input should be"),
        ({"feature": "rms", "alert_g": 1.0, "speed_range_hz": (2.0, 1.0)}, "speed_range_hz"),
    ],
)
def test_a_wrong_level_is_refused_in_words(values: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        AlarmLevel(**values)


def test_levels_name_channels_that_there_are_and_differ_on_each() -> None:
    level = AlarmLevel(feature="rms", alert_g=1.0, channels=("x",))
    section = AlarmsSection(level=(level, AlarmLevel(feature="rms", alert_g=2.0, channels=("y",))))
    section.check_channels(("x", "y"))
    assert [rule.alert for rule in section.to_settings("y", 0).rules] == [Level(value=2.0 * 9.80665)]
    with pytest.raises(ValueError, match="channel 'x' is not one of y"):
        section.check_channels(("y",))
    with pytest.raises(ValueError, match="given twice"):
        AlarmsSection(level=(level, level)).check_channels(("x",))
