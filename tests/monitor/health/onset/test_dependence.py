"""Levels less their learned dependence on speed and load: what is learned, what is withheld, what the detector does."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.health.onset import DetectInput, DetectSettings, DetectState, step
from monitor.health.onset.dependence import (
    MAX_ERROR,
    Dependence,
    condition_of,
    learn_dependence,
    varying,
    widens,
)
from tests.support.effort import effort_count

BY_SPEED = DetectSettings(levels_by="speed")
NONE = DetectSettings(levels_by="none")
AUTO = DetectSettings()


def law(speed, load=4000.0):
    """Return ln RMS of a machine: a power of speed and load, and a resonance that a line crosses at 27 Hz."""
    return 2.0 * np.log(speed / 25.0) + 0.5 * np.log(load / 4000.0) + 0.3 * np.exp(-0.5 * ((speed - 27.0) / 1.5) ** 2)


def hunting(rng, n, width, load_steps=False):
    """Return speeds (Hz) that wander within a share of 25 Hz, and loads, shape (n,)."""
    wander = np.convolve(rng.standard_normal(n + 40), np.ones(20) / math.sqrt(20.0), "same")[:n]
    speed = 25.0 * (1.0 + width * np.tanh(wander))
    load = 4000.0 * np.where(load_steps & ((np.arange(n) // 37) % 2 == 0), 0.6, 1.0)
    return speed, load


def blocks(rng, speed, load, grown=None, first=1):
    levels = law(speed, load) + 0.03 * rng.standard_normal(speed.size)
    if grown is not None:
        levels = levels + grown
    lines = np.exp(0.1 * rng.standard_normal(speed.size))
    return [
        DetectInput(i + first, 10.0 * i, math.exp(level), {"h_or": line}, None, speed=float(v), load=float(f))
        for i, (level, line, v, f) in enumerate(zip(levels, lines, speed, load, strict=True))
    ]


def run(given, settings, state=None):
    state, outputs = state or DetectState(), []
    for block in given:
        state, output = step(state, block, settings)
        outputs.append(output)
    return state, outputs


@pytest.mark.parametrize(("load_steps", "by"), [(False, ("speed",)), (True, ("speed", "load"))])
def test_hunting_is_no_onset_where_levels_are_relative(load_steps, by):
    rng = np.random.default_rng(1)
    given = blocks(rng, *hunting(rng, 600, 0.2, load_steps))
    state, outputs = run(given, AUTO)
    assert state.stage == "healthy"
    assert state.baseline is not None
    assert state.baseline.by["rms"].by == by
    assert state.outside < 80
    levels = [output.level for output in outputs if output.level is not None]
    assert np.std(np.log(levels)) < 0.05
    # The same blocks as they are: the machine at its higher speeds is taken for a damaged one, or a wide baseline.
    bare, raw = run(given, NONE)
    assert bare.baseline is not None
    assert bare.episodes or bare.t_fs or bare.baseline.ln_rms_sd > 3.0 * state.baseline.ln_rms_sd
    assert all(output.level is None for output in raw)


def test_growth_under_hunting_is_an_onset():
    rng = np.random.default_rng(2)
    speed, load = hunting(rng, 500, 0.2)
    grown = np.where(np.arange(500) < 400, 0.0, 0.7)
    state, _ = run(blocks(rng, speed, load, grown), AUTO)
    assert state.t_fs is not None
    assert state.t_fs.sequence >= 395
    assert state.t_fs_known is not None
    assert state.t_fs_known.sequence <= 415


@pytest.mark.parametrize("settings", [AUTO, NONE])
def test_at_one_speed_nothing_depends(settings):
    rng = np.random.default_rng(3)
    given = blocks(rng, np.full(200, 25.0), np.full(200, 4000.0))
    state, outputs = run(given, settings)
    bare, expected = run([replace(block, speed=None, load=None) for block in given], settings)
    assert state.baseline is not None
    assert replace(state.baseline, steady={}) == bare.baseline
    assert not state.baseline.by
    assert outputs == expected


def test_levels_that_do_not_follow_the_speed_are_taken_as_they_are():
    rng = np.random.default_rng(4)
    speed, load = hunting(rng, 150, 0.1)
    given = [replace(block, rms=float(np.exp(0.03 * rng.standard_normal()))) for block in blocks(rng, speed, load)]
    state, _ = run(given, AUTO)
    assert state.baseline is not None
    assert not state.baseline.by


def test_a_speed_that_was_not_learned_is_withheld_and_counted():
    rng = np.random.default_rng(5)
    state, _ = run(blocks(rng, *hunting(rng, 300, 0.1)), AUTO)
    fast = blocks(rng, np.full(60, 33.0), np.full(60, 4000.0), first=301)
    after, outputs = run(fast, AUTO, state)
    held = [output for output in outputs if output.outside]
    assert after.outside == state.outside + len(held)
    assert 10 <= len(held) <= 25
    assert outputs[: len(held)] == held
    assert all(output.score is None and output.level is None for output in held)
    assert all(output.score is not None for output in outputs[len(held) :])
    assert after.stage == "healthy"
    first, _ = run(fast[:5], AUTO, state)
    assert replace(first, outside=state.outside, seen=state.seen, held=state.held) == state
    unknown, outputs = run([replace(fast[0], speed=None)], AUTO, state)
    assert outputs[0].outside
    assert unknown.held == state.held
    _, outputs = run(blocks(rng, np.full(5, 25.0), np.full(5, 4000.0), first=361), AUTO, after)
    assert all(output.score is not None for output in outputs)


@pytest.mark.parametrize(("speed", "load"), [(30.0, 4000.0), (25.0, 2400.0)])
def test_a_duty_that_comes_after_learning_is_learned_and_no_onset(speed, load):
    rng = np.random.default_rng(12)
    given = blocks(rng, np.full(150, 25.0), np.full(150, 4000.0))
    given += blocks(rng, np.full(100, speed), np.full(100, load), first=151)
    given += blocks(rng, np.full(50, 25.0), np.full(50, 4000.0), first=251)
    state, outputs = run(given, AUTO)
    assert state.stage == "healthy"
    assert not state.episodes
    assert 0 < state.outside <= 0.2 * 100
    assert [output.outside for output in outputs].index(True) == 150
    assert state.baseline is not None
    assert state.baseline.by["rms"].by == (("speed",) if speed != 25.0 else ("load",))
    # The rest of what is told of the new duty is as sharp as of the old one.
    grown = blocks(rng, np.full(20, speed), np.full(20, load), np.full(20, 0.8), first=301)
    assert run(grown, AUTO, state)[0].t_fs_known is not None


def test_damage_at_a_known_duty_stops_the_learning_of_others():
    rng = np.random.default_rng(13)
    given = blocks(rng, np.full(150, 25.0), np.full(150, 4000.0))
    given += blocks(rng, np.full(3, 25.0), np.full(3, 4000.0), np.full(3, 0.8), first=151)
    state, _ = run(given + blocks(rng, np.full(60, 30.0), np.full(60, 4000.0), first=154), AUTO)
    assert state.outside == 60
    assert not state.held
    assert state.exceeding == 3
    knock = [replace(given[150], rms=20.0), *blocks(rng, np.full(60, 30.0), np.full(60, 4000.0), first=152)]
    state, _ = run(given[:150] + knock, AUTO)
    assert state.outside < 25


def test_an_asked_dependence_of_a_constant_speed_withholds_other_speeds():
    rng = np.random.default_rng(6)
    state, _ = run(blocks(rng, np.full(150, 25.0), np.full(150, 4000.0)), BY_SPEED)
    for speed, outside in ((25.1, False), (27.0, True), (20.0, True)):
        _, outputs = run(blocks(rng, np.full(1, speed), np.full(1, 4000.0), first=151), BY_SPEED, state)
        assert outputs[0].outside is outside


def test_a_gap_between_two_duties_is_not_predicted():
    rng = np.random.default_rng(7)
    speed = np.where(rng.uniform(size=100) < 0.5, 20.0, 30.0) * (1.0 + 0.002 * rng.standard_normal(100))
    conditions = [condition_of(float(v), None, None) for v in speed]
    found = learn_dependence(list(law(speed) + 0.03 * rng.standard_normal(100)), conditions, ("speed",), always=False)
    assert found is not None
    for v in (20.0, 30.0):
        at = found.at(condition_of(v, None, None))
        assert at is not None
        assert at[1] < 0.5 * MAX_ERROR
    assert found.at(condition_of(24.5, None, None)) is None


def test_learning_lasts_while_new_speeds_come():
    rng = np.random.default_rng(8)
    speed = np.concatenate((np.full(40, 20.0), np.linspace(20.0, 30.0, 160), 20.0 + 10.0 * rng.uniform(size=200)))
    given = blocks(rng, speed, np.full(400, 4000.0))
    stages = [output.stage for output in run(given, AUTO)[1]]
    assert 200 < stages.index("healthy") <= AUTO.run_in_blocks + 3 * 100
    steady = blocks(rng, np.full(400, 25.0), np.full(400, 4000.0))
    assert [output.stage for output in run(steady, AUTO)[1]].index("healthy") == AUTO.run_in_blocks + 100 - 1


def test_a_state_with_a_dependence_goes_through_json():
    rng = np.random.default_rng(9)
    given = blocks(rng, *hunting(rng, 300, 0.15, True))
    state, _ = run(given[:220], AUTO)
    assert state.baseline is not None
    assert state.baseline.by
    restored = DetectState.from_dict(json.loads(json.dumps(state.to_dict())))
    assert restored == state
    assert run(given[220:], AUTO, restored) == run(given[220:], AUTO, state)
    learning, _ = run(given[:60], AUTO)
    assert DetectState.from_dict(json.loads(json.dumps(learning.to_dict()))) == learning


def test_a_state_of_version_2_goes_on():
    rng = np.random.default_rng(10)
    given = blocks(rng, np.full(200, 25.0), np.full(200, 4000.0))
    learning, _ = run(given[:60], AUTO)
    old = json.loads(json.dumps(learning.to_dict()))
    old["learned"] = [point[:3] for point in old["learned"]]
    del old["outside"]
    state, _ = run(given[60:], AUTO, DetectState.from_dict({**old, "version": 2}))
    whole, _ = run(given, AUTO)
    assert whole.baseline is not None
    assert state == replace(whole, baseline=replace(whole.baseline, steady={}), kept=())


def test_a_block_of_varying_speed_is_the_mean_of_its_terms():
    rng = np.random.default_rng(11)
    n, width = 150, 0.15
    centre = 25.0 * (1.0 + 0.1 * rng.uniform(-1.0, 1.0, n))
    within = centre[:, None] * (1.0 + width * np.linspace(-1.0, 1.0, 201)) * rng.choice((1.0,), 1)
    levels = 0.5 * np.log(np.mean((within / 25.0) ** 6, axis=1)) + 0.01 * rng.standard_normal(n)
    spans = [(float(row[0]), float(row[-1])) for row in within]
    conditions = [condition_of(float(c), span, None) for c, span in zip(centre, spans, strict=True)]
    found = learn_dependence(list(levels), conditions, ("speed",), always=False)
    assert found is not None
    ends = [found.at(condition_of(v, (v * (1 - width), v * (1 + width)), None)) for v in (23.0, 27.0)]
    assert ends[0] is not None
    assert ends[1] is not None
    assert ends[1][0] - ends[0][0] == pytest.approx(3.0 * math.log(27.0 / 23.0), abs=0.03)


def test_conditions_that_count():
    steady = [condition_of(25.0, None, 4000.0)] * 50
    assert varying(steady, "auto") == ()
    assert varying(steady, "speed_and_load") == ("speed", "load")
    assert varying([condition_of(25.0, None, None)] * 50, "load") == ()
    loaded = [condition_of(25.0, None, 4000.0 + 500.0 * (i % 2)) for i in range(50)]
    assert varying(loaded, "auto") == ("load",)
    assert not widens(loaded, ("load",))
    assert widens([condition_of(20.0 + 0.1 * i, None, None) for i in range(60)], ("speed",))
    assert not widens(steady, ())


@settings(max_examples=effort_count(quick=8, full=100))
@given(st.integers(0, 10**6), st.floats(-4.0, 4.0), st.floats(0.03, 0.4), st.floats(1e-3, 1e3))
def test_the_unit_of_the_level_does_not_matter(seed, power, width, unit):
    rng = np.random.default_rng(seed)
    speed = 25.0 * np.exp(width * rng.uniform(-0.5, 0.5, 100))
    levels = power * np.log(speed) + 0.05 * rng.standard_normal(100)
    conditions = [condition_of(float(v), None, None) for v in speed]
    one = learn_dependence(list(levels), conditions, ("speed",), always=True)
    other = learn_dependence(list(levels + math.log(unit)), conditions, ("speed",), always=True)
    assert one is not None
    assert other is not None
    for condition in conditions[:10]:
        first, second = one.at(condition), other.at(condition)
        assert (first is None) is (second is None)
        if first is not None and second is not None:
            assert second == pytest.approx(first, rel=1e-6, abs=1e-9)
    assert Dependence.from_dict(json.loads(json.dumps(one.__dict__))) == one
