"""Levels relative to speed and load after the detector: alarms, time to them, records, maps over a block's speeds."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from monitor.health.alarms import AlarmInput, AlarmSettings, AlarmState, Level, Rule
from monitor.health.alarms import step as alarms_step
from monitor.health.onset import DetectSettings
from monitor.health.record import Record
from monitor.health.rest.trend import TrendInput, TrendState, TtaStatus
from monitor.health.rest.trend import step as trend_step
from monitor.health.retrace import retrace
from monitor.health.signal.condition import ConditionSettings
from monitor.health.size import DamageInput, EdvStatus
from monitor.health.size.level_set import LevelMap, map_of_block, speeds_of
from monitor.health.state import ChannelSettings, SourceSettings, SourceState
from monitor.health.tracker import DamageState
from reference.signals import bearing_lines
from reference.steps import Steps
from streams.types.block import Block

RATE, SAMPLES, COUNT = 25600.0, 4096, 90
RELATIVE = Rule("relative", "rms", alert=Level(deviations=6.0), on_delay=2)
ABSOLUTE = Rule("absolute", "rms", alert=Level(value=2.0), on_delay=1)
SETTINGS = SourceSettings(
    "source",
    {
        "one": ChannelSettings(
            "one",
            bearing_lines("PRONOSTIA", 25.0)[0],
            bands=((500.0, 6000.0),),
            condition=ConditionSettings(speed=25.0, load=4000.0),
            detect=DetectSettings(learn_blocks=40, run_in_blocks=2, features=("rms",)),
            alarms=AlarmSettings((RELATIVE, ABSOLUTE)),
        )
    },
    RATE,
)


def block_at(sequence: int, speed: float, grown: float = 1.0) -> Block:
    rng = np.random.default_rng(sequence)
    samples = (grown * (speed / 25.0) ** 2 * rng.standard_normal((1, SAMPLES))).astype(np.float32)
    name = f"b{sequence}"
    return Block(
        samples, RATE, ("one",), ("m/s2",), "source", sequence, name, start=1.7e9 + 10.0 * sequence, speed=speed
    )


def lived() -> tuple[list[SourceState], list[Record]]:
    """Learn while the speed hunts by 20 %; then a speed that was not learned, then damage at the lowest one."""
    steps = Steps(SETTINGS)
    states, records = [steps.state], []
    for number in range(1, COUNT + 1):
        speed = 25.0 * (1.0 + 0.2 * math.sin(1.7 * number))
        speed = 40.0 if 70 <= number < 75 else speed if number < 80 else 20.5
        records.append(steps.take(block_at(number, speed, 2.0 if number >= 80 else 1.0)))
        states.append(steps.state)
    return states, records


def test_a_machine_that_hunts_is_judged_at_its_own_speed() -> None:
    states, records = lived()
    values = [record.channels["one"] for record in records]
    events = [(event["kind"], event.get("rule"), record.sequence) for record in records for event in record.events]
    assert [one["level_status"] for one in values if one.get("level_status")] == ["ok"] * 27 + [
        "outside_conditions"
    ] * 5 + ["ok"] * 16
    assert all(one["level_rms"] == pytest.approx(1.0, abs=0.15) for one in values[45:69])
    assert all(one.get("level_rms") is None and one.get("detect_score") is None for one in values[69:74])
    assert values[80]["level_rms"] == pytest.approx(2.0, rel=0.15)
    # RMS of the damaged machine is no higher than that of the healthy one at its highest speed.
    assert values[80]["rms"] < max(one["rms"] for one in values[:69])
    assert [(kind, n) for kind, _, n in events if kind == "final_stage"] == [("final_stage", 84)]
    assert ("alarm_raised", "relative", 81) in events
    assert values[84]["rms_baseline"] == pytest.approx((20.5 / 25.0) ** 2, rel=0.1)
    # A level in m/s2 is one at any speed.
    assert [n for kind, rule, n in events if (kind, rule) == ("alarm_raised", "absolute")] == [70]
    found = retrace(states[20], records[20:], SETTINGS)
    assert found.state.to_stored() == states[-1].to_stored()


def test_levels_from_the_baseline_take_the_value_at_the_reference_condition() -> None:
    rule = Rule("both", "rms", alert=Level(factor=2.0), danger=Level(value=10.0), on_delay=1, off_delay=1)
    state = AlarmState()
    baselines = {"rms": (0.0, 0.05)}

    def raised(value: float, at_reference: float | None) -> list[tuple[str, str, float | None]]:
        nonlocal state
        values, at = {"rms": value}, {"rms": at_reference}
        block = AlarmInput(1, True, False, values=values, baselines=baselines, at_reference=at)
        state, output = alarms_step(state, block, AlarmSettings((rule,)))
        return [(change.severity, change.kind, change.value) for change in output.changes]

    assert raised(5.0, 1.0) == []
    assert raised(5.0, 2.5) == [("alert", "raised", 2.5)]
    assert raised(0.1, None) == []
    assert raised(12.0, None) == [("danger", "raised", 12.0)]


def test_outside_there_is_no_time_to_the_level() -> None:
    block = TrendInput(1, 0.0, 1.0, baseline=(0.0, 0.05), outside=True)
    state, found = trend_step(TrendState(), block, AlarmSettings())
    assert found.status is TtaStatus.NO_LEVEL
    assert state == TrendState()


def map_at(load: float | None, speed: float | None) -> tuple[LevelMap | None, EdvStatus | None]:
    """The map of a level that grows with the square of the speed, from 20 to 30 Hz."""
    if speed is None or not 20.0 <= speed <= 30.0:
        return None, EdvStatus.OUTSIDE_CONDITIONS
    extents, depths = np.array([0.0, 0.1]), np.array([0.0, 1e-5])
    return LevelMap(extents, depths, speed**2 * np.array([[1.0, 1.0], [1.0, 2.0]]), 0.03), None


@given(st.floats(20.0, 25.0), st.floats(0.0, 5.0))
def test_a_map_over_speeds_is_the_mean_of_squares(low: float, width: float) -> None:
    speed, high = low + 0.5 * width, low + width
    block = DamageInput(0.0, 1.0, load=4000.0, speed=speed, speed_range=(low, high))
    found, refused = map_of_block(map_at, block)
    assert refused is None
    assert found is not None
    exact = math.sqrt(np.mean(np.linspace(low, high, 20001) ** 4)) if speeds_of(block) else speed**2
    assert found.rms[0, 0] == pytest.approx(exact, rel=1e-5)
    assert found.rms[1, 1] == pytest.approx(2.0 * exact, rel=1e-5)


def test_a_block_that_leaves_the_map_for_a_while_is_outside() -> None:
    block = DamageInput(0.0, 1.0, load=4000.0, speed=25.0, speed_range=(19.0, 31.0))
    assert map_of_block(map_at, block) == (None, EdvStatus.OUTSIDE_CONDITIONS)
    assert map_of_block(map_at, replace(block, speed_range=(24.95, 25.05)))[0] is not None


def test_pending_blocks_of_this_and_of_an_older_state_are_read() -> None:
    block = DamageInput(1.0, 2.0, (1.0, 0.5), 4000.0, 25.0, speed_range=(24.0, 26.0), reference_rms=1.5)
    state = DamageState(pending=(block, DamageInput(2.0, 2.0)))
    stored = json.loads(json.dumps(state.to_dict()))
    assert DamageState.from_dict(stored).pending == state.pending
    stored["pending"] = [kept[:5] for kept in stored["pending"]]
    older = DamageState.from_dict(stored).pending
    assert older[0] == replace(block, speed_range=None, reference_rms=None)
