"""The wheels of a channel through the stages of a source: record, events, state, and what stays without gears."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from monitor.health.condition import ConditionSettings
from monitor.health.detect import DetectSettings
from monitor.health.gears.naming import MIN_LEARNED
from monitor.health.record import Record
from monitor.health.retrace import retrace
from monitor.health.state import SourceSettings, SourceState, Stored
from monitor.health.step import step
from streams.block import Block
from tests.monitor.health.gears.signals import RATE, Meshing, pair
from tests.monitor.health.test_pipeline import base

GEARS = pair(19, 29)
DETECT = DetectSettings(learn_blocks=10, run_in_blocks=0, persist_blocks=3, close_blocks=5)
CHANNEL = base(
    gears=GEARS, detect=DETECT, bands=((2000.0, 5000.0),), condition=ConditionSettings(speed=30.0), average_blocks=1
)
SETTINGS = SourceSettings("s", {"one": CHANNEL})
HEALTHY = Meshing(duration=1.2)
FIRST_BAD = MIN_LEARNED + 3


def block(sequence: int, meshing: Meshing) -> Block:
    """Return one block in m/s2."""
    samples = meshing.of(GEARS, sequence)[0].astype(np.float32)[None]
    return Block(samples, RATE, ("one",), ("m/s2",), "s", sequence, f"b{sequence}", elapsed=10.0 * sequence)


@cache
def life() -> tuple[SourceState, tuple[Record, ...]]:
    """Return the state and the records of a machine whose wheel breaks a tooth; stored and read again in the middle."""
    state, records = SourceState.begin(SETTINGS), list[Record]()
    for sequence in range(1, FIRST_BAD + 4):
        broken = replace(HEALTHY, impact=("wheel", 3.0))
        state, output = step(state, block(sequence, broken if sequence >= FIRST_BAD else HEALTHY), SETTINGS)
        records.append(output.record)
        if sequence == FIRST_BAD:
            stored: Stored = json.loads(json.dumps(state.to_stored()))
            state = SourceState.begin(SETTINGS, stored)
    return state, tuple(records)


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
