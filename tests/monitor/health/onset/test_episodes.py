"""A final stage that closes again: records, events, forecasts, tracker and alarms, live, restarted and retraced."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from monitor.health.alarms import AlarmSettings, Level, Rule
from monitor.health.name.machine import weigh
from monitor.health.onset import DetectState
from monitor.health.record import Record
from monitor.health.retrace import retrace
from monitor.health.signal.condition import ConditionSettings
from monitor.health.state import SourceSettings, SourceState
from monitor.health.tracker import DamageState
from monitor.words.events import event_text
from reference.steps import Steps
from streams.types.block import Block
from tests.support.pipeline import DETECT, RATE, SPEED, TRACKED, life

# The volumes of this toy map are 0, so that a level below is reached.
ALARMS = AlarmSettings(
    (
        Rule("volume", "v_eq", side="below", alert=Level(value=1e-9)),
        Rule("latched", "v_eq", side="below", alert=Level(value=1e-9), latch=True),
        Rule("level", "rms", alert=Level(factor=1.3), on_delay=2),
    )
)
ONE = replace(
    TRACKED,
    average_blocks=1,
    detect=replace(DETECT, close_blocks=8),
    alarms=ALARMS,
    condition=ConditionSettings(speed=SPEED, load=4200.0),
)
SETTINGS = SourceSettings("source", {"one": ONE}, RATE)
LOUD = (range(60, 72), range(88, 96))
"""Blocks of damage; those between and before are healthy."""


@cache
def lived() -> tuple[list[Block], list[SourceState], list[Record]]:
    """Return the blocks, the state before each and after the last one, and the records."""
    healthy, damaged = life(96, first_bad=1000), life(80, first_bad=60)
    blocks: list[Block] = []
    for i in range(96):
        stretch = next((stretch for stretch in LOUD if i in stretch), None)
        x = healthy[i] if stretch is None else damaged[60 + i - stretch.start]
        blocks.append(Block(x[None, :], RATE, ("one",), ("m/s2",), "source", i + 1, f"b{i}", start=1.7e9 + 10.0 * i))
    steps = Steps(SETTINGS)
    states, records = [steps.state], []
    for block in blocks:
        records.append(steps.take(block))
        states.append(steps.state)
    return blocks, states, records


def events_of(kind: str) -> list[dict[str, object]]:
    return [dict(event) for record in lived()[2] for event in record.events if event["kind"] == kind]


def closing() -> int:
    """Return the number of the block with which the first episode closes."""
    (event,) = events_of("final_stage_closed")
    assert isinstance(event["block"], int)
    return event["block"]


def test_the_episode_is_an_event_with_its_dates_and_marks_are_null_until_the_next_one() -> None:
    _, _, records = lived()
    (event,) = events_of("final_stage_closed")
    opened = events_of("final_stage")
    assert [event["t_fs_block"], event["t_fs_known_block"]] == [opened[0]["t_fs_block"], opened[0]["block"]]
    assert (event["t_fs_block"], event["quiet_since_block"], event["block"]) == (61, 73, 80)
    assert event["closed_s"] == 1.7e9 + 790.0
    assert "began with block 61 is over" in event_text(event)
    assert opened[0]["feature"] == "h_or"
    for record in records[79:90]:
        values = record.channels["one"]
        assert values["stage"] == "healthy"
        assert all(values.get(name) is None for name in ("t_fs", "t_fs_block", "t_fs_known", "t_fs_known_block"))
    assert records[78].channels["one"]["t_fs_block"] == 61
    assert records[-1].channels["one"]["t_fs_block"] == opened[1]["t_fs_block"] == 89


def test_what_was_forecast_is_void_and_the_tracker_begins_anew() -> None:
    _, states, records = lived()
    at = closing()
    assert {body["status"] for record in records[64 : at - 1] for body in record.forecasts} == {"no_crossing"}
    assert [body["status"] for body in records[at - 1].forecasts] == ["episode_closed"]
    values = records[at - 1].channels["one"]
    assert (values["edv_status"], values["tt_status"], values["v_eq"]) == ("episode_closed", ("episode_closed",), None)
    assert records[at].forecasts == ()
    assert records[at].channels["one"]["edv_status"] == "not_final_stage"
    before, after = (json.dumps(states[place].channels["one"].damage.to_dict()) for place in (at - 1, at))
    assert before != json.dumps(DamageState().to_dict()) == after
    # The second growth is tracked from its own t_fs on.
    again = states[-1].channels["one"].damage.forecast.fit
    first = states[at - 1].channels["one"].damage.forecast.fit
    assert again is not None
    assert first is not None
    assert again.points < first.points


def test_alarms_that_stood_on_the_episode_are_withdrawn_and_others_clear_by_themselves() -> None:
    withdrawn = events_of("alarm_withdrawn")
    assert [(event["rule"], event["block"]) for event in withdrawn] == [("volume", 80), ("latched", 80)]
    assert all(isinstance(event["since_block"], int) for event in withdrawn)
    assert "withdrawn" in event_text(withdrawn[0])
    cleared = [event["rule"] for event in events_of("alarm_cleared")]
    assert cleared == ["level"]
    alarms = lived()[1][closing()].alarms["one"]
    # What is latched waits for a person all the same.
    assert [alarms.level(rule, "alert").shown for rule in ("volume", "latched")] == [False, True]
    assert not alarms.level("latched", "alert").active


@pytest.mark.parametrize("cut", [30, 70, 76, 79, 80, 92])
def test_a_restart_changes_nothing(cut: int) -> None:
    blocks, states, records = lived()
    stored = json.loads(json.dumps(states[cut].to_stored()))
    steps = Steps(SETTINGS, stored, records[cut - 1])
    assert [steps.take(block).to_json() for block in blocks[cut:]] == [record.to_json() for record in records[cut:]]


@pytest.mark.parametrize("first", [0, 62, 79, 85])
def test_records_give_the_state_back_bit_for_bit(first: int) -> None:
    _, states, records = lived()
    assert retrace(states[first], records[first:], SETTINGS).state.to_stored() == states[-1].to_stored()


def test_levels_of_rms_follow_a_baseline_that_was_learned_anew() -> None:
    """An alarm of 1.3 times the baseline means that of the machine as it is now."""
    rng = np.random.default_rng(3)
    blocks = life(40, first_bad=1000)
    detect = replace(DETECT, learn_blocks=10, run_in_blocks=0)
    settings = SourceSettings("source", {"one": replace(ONE, detect=detect)}, RATE)
    steps = Steps(settings)
    kinds: list[str] = []
    for i in range(60):
        x = blocks[int(rng.integers(5, 40))] * (1.0 if i < 15 else 0.4)
        record = steps.take(Block(x[None, :], RATE, ("one",), ("m/s2",), "source", i + 1, f"b{i}", start=10.0 * i))
        kinds += [str(event["kind"]) for event in record.events]
    assert kinds.count("baseline_relearned") == 1
    learned: DetectState = steps.state.channels["one"].detect
    assert learned.baseline is not None
    assert steps.state.alarms["one"].rules["level"].baseline == (learned.baseline.ln_rms, learned.baseline.ln_rms_sd)


def test_the_verdict_on_the_bearing_is_a_hint_between_the_episodes() -> None:
    _, states, records = lived()
    at = closing()
    said = [weigh([state.machine], SETTINGS.bearings)["bearing"] for state in states]
    assert {record.channels["one"].get("fault") for record in records[64:70]} == {"outer"}
    assert (said[at - 1].fault, said[at - 1].basis) == ("outer", "verdict")
    assert {(found.fault, found.basis) for found in said[at : at + 8]} == {("outer", "hint")}
    assert (said[-1].fault, said[-1].basis) == ("outer", "verdict")
    bases = [(record.channels["one"].get("fault"), record.channels["one"].get("fault_basis")) for record in records]
    assert set(bases[: 60 + 1]) <= {(None, None), ("outer", "hint")}
    assert set(bases[64:70]) == {("outer", "verdict")}
