"""The wheels of a channel through the stages of a source: record, events, state, and what stays without gears."""

from __future__ import annotations

from dataclasses import replace

import pytest

from monitor.health.record import Record
from monitor.health.retrace import retrace
from monitor.health.state import SourceSettings, SourceState
from monitor.health.step import step
from tests.support.stage import CHANNEL, FIRST_BAD, HEALTHY, SETTINGS, block, life


def test_a_broken_tooth_is_named_in_the_record_and_by_an_event() -> None:
    state, records = life()
    values = [record.channels["one"] for record in records]
    assert {one["gear_fault"] for one in values[: FIRST_BAD + 1]} == {("none", "none")}
    assert values[-1]["gear_fault"] == ("none", "tooth")
    assert values[0]["gear_status"] == ("learning", "learning")
    assert values[-1]["gear_status"] == ("ok", "ok")
    assert values[-1]["gear_score"][1] > 1.0 > values[FIRST_BAD - 2]["gear_score"][1]
    assert values[-1]["fm4"][1] > 2.0 * values[0]["fm4"][1]
    assert values[-1]["na4"][1] > 10.0 * values[0]["na4"][1]
    named = [event for record in records for event in record.events if event["kind"] == "fault_changed"]
    assert [(event["block"], event["from"], event["to"]) for event in named] == [(FIRST_BAD + 2, None, "gear:wheel")]
    assert state.gears["one"].since == FIRST_BAD + 2


def test_a_block_that_is_no_baseline_leaves_the_wheels_alone() -> None:
    state, _ = life()
    late = replace(block(1, HEALTHY), name="late")
    after, output = step(state, late, SETTINGS)
    assert output.record.channels["one"]["gear_status"] == ("bad_block", "bad_block")
    assert output.record.channels["one"]["gear_fault"] == ("none", "tooth")
    assert after.gears == state.gears


def test_without_gears_state_and_record_are_as_before() -> None:
    plain = SourceSettings("s", {"one": replace(CHANNEL, gears=None)})
    state, output = step(SourceState.begin(plain), block(1, HEALTHY), plain)
    assert not any(name.startswith("gear") for name in (*state.to_stored(), *output.record.channels["one"]))
    geared, more = step(SourceState.begin(SETTINGS), block(1, HEALTHY), SETTINGS)
    kept = {name: value for name, value in more.record.channels["one"].items() if name in output.record.channels["one"]}
    assert kept == output.record.channels["one"]
    stored = {name: part for name, part in geared.to_stored().items() if name != "gears:s:one"}
    assert stored == state.to_stored()


def test_a_store_from_before_the_gears_begins_to_learn_them() -> None:
    state, _ = life()
    older = {name: part for name, part in state.to_stored().items() if not name.startswith("gears:")}
    assert SourceState.begin(SETTINGS, older).gears["one"].learned == {}


def test_a_named_wheel_asks_for_maintenance() -> None:
    state, records = life()
    assert state.alarms["one"].condition == "maintenance_required"
    healthy, _ = step(SourceState.begin(SETTINGS), block(1, HEALTHY), SETTINGS)
    assert healthy.alarms["one"].condition != "maintenance_required"
    assert records[0].channels["one"]["gear_fault"] == ("none", "none")


@pytest.mark.parametrize("first", [0, 5, FIRST_BAD])
def test_the_state_of_the_wheels_can_be_made_of_records(first: int) -> None:
    state, records = life()
    begun = SourceState.begin(SETTINGS)
    before = replace(begun, gears=retrace(begun, records[:first], SETTINGS).state.gears)
    found = retrace(before, (Record.from_json(record.to_json()) for record in records[first:]), SETTINGS).state
    assert found.gears == state.gears
    assert found.gears["one"].named == "wheel"
