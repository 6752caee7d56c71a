"""The contract of every health stage: pure, a frozen state, and the same outputs after the state went through JSON.

Stages are found, not listed: each function ``step`` of a module of ``monitor.health`` whose state can be stored. A new
stage needs an entry in TAKE.
"""

from __future__ import annotations

import copy
import importlib
import json
import pkgutil
from collections.abc import Callable, Iterator
from dataclasses import FrozenInstanceError, fields
from functools import cache
from typing import Any

import numpy as np
import pytest

import monitor.health
from monitor.health import alarms, channel, tracker
from monitor.health import onset as detect
from monitor.health.gears import naming as gears
from monitor.health.name import machine
from monitor.health.rest import quadratic as forecast
from monitor.health.rest import trend
from monitor.health.rest.learned import forecaster as learned
from monitor.health.rest.learned.fit import fit_runs
from monitor.health.signal import waterfall
from monitor.health.size import DamageInput, edv
from monitor.health.size.filter import particle_filter
from monitor.health.size.library import forecaster
from tests.oracles.toy_lives import RADIUS, THRESHOLD, toy_library
from tests.support.alarms import RULE, block
from tests.support.effort import effort_count
from tests.support.naming import PAIR, RULES, blocks
from tests.support.pipeline import base, checked, life
from tests.support.tracking import LOAD, METHODS, SPEED, growing, plain_map, settings_of

COUNT = 36
MIDDLE = 25
TIMES, RMS, LINES = growing(COUNT)
MAP = plain_map()
DETECT = detect.DetectSettings(learn_blocks=10, run_in_blocks=3, persist_blocks=3)
Take = Callable[[Any, int], tuple[Any, Any]]
"""From a state and the number of a block, from zero on, to the next state and the output."""


def found_stages() -> Iterator[tuple[str, Callable[..., Any]]]:
    for module in pkgutil.walk_packages(monitor.health.__path__, "monitor.health."):
        step = getattr(importlib.import_module(module.name), "step", None)
        if step is not None and step.__module__ == module.name and hasattr(state_of(step), "to_dict"):
            yield module.name.removeprefix("monitor.health."), step


def state_of(step: Callable[..., Any]) -> type[Any]:
    return getattr(importlib.import_module(step.__module__), step.__annotations__["state"])


@cache
def samples() -> list[Any]:
    return life(COUNT, first_bad=28)


def take_channel(state: Any, i: int) -> tuple[Any, Any]:
    settings = base(detect=DETECT)
    return channel.step(state, checked(i, samples()[i], state, settings), settings)


def take_detect(state: Any, i: int) -> tuple[Any, Any]:
    level = 1.0 + 0.01 * (i % 3) + (3.0 if i > MIDDLE else 0.0)
    return detect.step(
        state, detect.DetectInput(i + 1, 10.0 * i, level, {"h_or": 2.0 * level, "h_ir": 1.5}, 9.0 * level), DETECT
    )


def take_damage(state: Any, i: int) -> tuple[Any, Any]:
    reading = DamageInput(TIMES[i], RMS[i], tuple(LINES[i]), LOAD, SPEED)
    state, *outputs = tracker.step(state, reading, tracker.DamageGate(), settings_of(METHODS[1], MAP, toy_library(40)))
    return state, outputs


def take_filter(state: Any, i: int) -> tuple[Any, Any]:
    settings = particle_filter.FilterSettings(part_radius=RADIUS, particles=100)
    heard = DamageInput(TIMES[i], RMS[i], tuple(LINES[i]))
    return particle_filter.step(state, heard, map_slice=MAP.wide(), settings=settings)


def take_learned(state: Any, i: int) -> tuple[Any, Any]:
    given, model = DamageInput(TIMES[i], RMS[i]), fit_runs(())
    return learned.step(state, given, model, baseline=RMS[0], final_stage=i > 3)


def take_trend(state: Any, i: int) -> tuple[Any, Any]:
    given = trend.TrendInput(i + 1, TIMES[i], RMS[i], baseline=(0.0, 0.1), elevated=i > 3, final=i > 6)
    return trend.step(state, given, alarms.AlarmSettings((RULE,)))


def take_library(state: Any, i: int) -> tuple[Any, Any]:
    given = DamageInput(TIMES[i], RMS[i], tuple(LINES[i]), LOAD, SPEED)
    state, *outputs = forecaster.step(state, given, toy_library(40), thresholds=(THRESHOLD,))
    return state, outputs


def take_waterfall(state: Any, i: int) -> tuple[Any, Any]:
    state, *outputs = waterfall.step(state, 60.0 * i, waterfall.WaterfallSettings(rows=4))
    return state, outputs


@cache
def wheels() -> list[gears.GearsInput]:
    damaged = blocks(2, pinion={"fm4": 3.0, "m6a": 9.0})
    return [next(given) for given in [blocks(1)] * MIDDLE + [damaged] * (COUNT - MIDDLE)]


def take_machine(state: Any, i: int) -> tuple[Any, Any]:
    heard = {
        "x": machine.BlockEvidence(fault=(None, "inner|ball")[i % 2], depth=0.3, final=i > MIDDLE),
        "y": machine.BlockEvidence(),
    }
    return machine.step(state, heard, {"bearing": ("x", "y")})


TAKE: dict[str, Take] = {
    "alarms.rules": lambda state, i: alarms.step(state, block(i + 1, float(i)), alarms.AlarmSettings((RULE,))),
    "channel": take_channel,
    "size.filter.particle_filter": take_filter,
    "rest.learned.forecaster": take_learned,
    "size.library.forecaster": take_library,
    "size.edv": lambda state, i: edv.step(state, RMS[i], map_slice=MAP.narrow()),
    "rest.quadratic": lambda state, i: forecast.step(
        state, TIMES[i], THRESHOLD * (0.1 + (i / COUNT) ** 2), thresholds=(THRESHOLD,)
    ),
    "tracker": take_damage,
    "onset.detector": take_detect,
    "gears.naming": lambda state, i: gears.step(state, wheels()[i], PAIR, RULES),
    "name.machine": take_machine,
    "rest.trend": take_trend,
    "signal.waterfall": take_waterfall,
}
STAGES = dict(found_stages())
each_stage = pytest.mark.parametrize("name", sorted(STAGES))


def text_of(value: Any) -> str:
    """Return all of a state or an output; of an array, the bytes of all numbers."""
    with np.printoptions(override_repr=lambda array: f"array({array.dtype}, {array.shape}, {array.tobytes()!r})"):
        return repr(value)


@cache
def taken(name: str) -> tuple[tuple[Any, ...], tuple[str, ...]]:
    """Return the states before each block, the last one behind them, and the outputs."""
    states, outputs = [state_of(STAGES[name])()], []
    for i in range(COUNT):
        state, output = TAKE[name](states[-1], i)
        states.append(state)
        outputs.append(text_of(output))
    return tuple(states), tuple(outputs)


def test_all_stages_are_found_and_have_blocks() -> None:
    assert set(STAGES) == set(TAKE)


@each_stage
def test_the_same_block_gives_the_same_and_leaves_the_state(name: str) -> None:
    states, outputs = taken(name)
    for i in range(0, COUNT, effort_count(quick=5, full=1)):
        before = text_of(states[i])
        after, output = TAKE[name](copy.deepcopy(states[i]), i)
        assert text_of(output) == outputs[i]
        assert json.dumps(after.to_dict()) == json.dumps(states[i + 1].to_dict())
        assert text_of(states[i]) == before
    assert json.dumps(states[0].to_dict()) != json.dumps(states[-1].to_dict())


@each_stage
def test_a_state_is_frozen(name: str) -> None:
    state = taken(name)[0][MIDDLE]
    for field in fields(state):
        with pytest.raises(FrozenInstanceError):
            setattr(state, field.name, None)


@each_stage
@pytest.mark.parametrize("at", [0, 5, MIDDLE, COUNT - 1])
def test_a_state_goes_through_json_and_on(name: str, at: int) -> None:
    states, outputs = taken(name)
    stored = json.dumps(states[at].to_dict(), allow_nan=False)
    state = type(states[at]).from_dict(json.loads(stored))
    assert json.dumps(state.to_dict()) == stored
    for i in range(at, min(COUNT, at + effort_count(quick=6, full=COUNT))):
        state, output = TAKE[name](state, i)
        assert text_of(output) == outputs[i]


@each_stage
def test_a_state_of_an_unknown_layout_is_refused(name: str) -> None:
    stored = taken(name)[0][MIDDLE].to_dict()
    if "version" not in stored:
        pytest.skip("its layout is versioned by the state that holds it")
    with pytest.raises(ValueError, match=rf" state: version {stored['version']} expected, got 999"):
        type(taken(name)[0][MIDDLE]).from_dict(stored | {"version": 999})
