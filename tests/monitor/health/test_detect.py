"""The onset detector: rate, persistence, run-in, latching, explicit state."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.health.detect import (
    DetectInput,
    DetectSettings,
    DetectState,
    exceedance_rate,
    step,
    threshold_for,
)
from tests.effort import effort_count

SETTINGS = DetectSettings()


def run(rms, prominence=None, peak=None, settings=SETTINGS, usable=None):
    state = DetectState()
    outputs = []
    for i, value in enumerate(rms):
        block = DetectInput(
            sequence=i + 1,
            time=10.0 * i,
            rms=float(value),
            prominence=1.0 if prominence is None else float(prominence[i]),
            peak=1.0 if peak is None else float(peak[i]),
            usable=True if usable is None else bool(usable[i]),
        )
        state, output = step(state, block, settings)
        outputs.append(output)
    return state, outputs


def healthy(n, rng, level=1.0, scatter=0.03):
    return level * np.exp(scatter * rng.standard_normal(n))


def test_threshold_has_the_stated_rate_by_simulation():
    rng = np.random.default_rng(1)
    excess = np.maximum(rng.standard_normal((2_000_000, 2)), 0.0)
    score = np.hypot(excess[:, 0], excess[:, 1])
    threshold = threshold_for(1.0)
    assert exceedance_rate(threshold) == pytest.approx(1e-3, rel=1e-9)
    assert np.mean(score > threshold) == pytest.approx(1e-3, rel=0.1)


@pytest.mark.parametrize("rate", [0.0, -1.0, 501.0, math.nan])
def test_threshold_refuses_impossible_rates(rate):
    with pytest.raises(ValueError, match="false_alarms_per_1000_blocks"):
        threshold_for(rate)


def test_a_step_is_dated_at_its_first_block_and_known_after_persistence():
    rng = np.random.default_rng(2)
    rms = healthy(300, rng)
    rms[250:] *= 3.0
    state, outputs = run(rms)
    assert state.t_fs is not None
    assert state.t_fs_known is not None
    assert (state.t_fs.sequence, state.t_fs_known.sequence) == (251, 255)
    assert state.t_fs.time == 2500.0
    assert [o.alarm for o in outputs].count(True) == 1
    assert state.stage == "final"


def test_a_slow_rise_began_before_it_was_known():
    rng = np.random.default_rng(3)
    rms = healthy(600, rng)
    rms[300:] *= np.linspace(1.0, 3.0, 300)
    state, _ = run(rms)
    assert state.t_fs is not None
    assert state.t_fs_known is not None
    assert 300 < state.t_fs.sequence < state.t_fs_known.sequence < 450


def test_both_features_moderate_alarm_where_neither_would_alone():
    rng = np.random.default_rng(4)
    rms, prominence = healthy(300, rng, scatter=0.01), healthy(300, rng, scatter=0.05)
    rms[250:] *= 1.32
    prominence[250:] *= 1.6
    assert run(rms, prominence)[0].t_fs is not None
    assert run(rms)[0].t_fs is None
    assert run(np.full(300, 1.0), prominence)[0].t_fs is None


def test_bursts_shorter_than_the_persistence_are_not_an_onset():
    rng = np.random.default_rng(5)
    rms = healthy(500, rng)
    for start in range(150, 480, 12):
        rms[start : start + SETTINGS.persist_blocks - 1] *= 10.0
    assert run(rms)[0].t_fs is None


def test_run_in_does_not_spoil_the_baseline():
    rng = np.random.default_rng(6)
    rms = healthy(600, rng)
    rms[:70] *= 1.6
    rms[400:] *= 1.6
    state, _ = run(rms)
    assert state.dropped > 0
    assert state.t_fs is not None
    assert 396 <= state.t_fs.sequence <= 402


def test_the_alarm_latches():
    rng = np.random.default_rng(7)
    rms = healthy(600, rng)
    rms[300:320] *= 4.0
    state, _ = run(rms)
    assert state.stage == "final"
    assert state.t_fs is not None
    assert state.t_fs.sequence == 301


def test_unusable_blocks_teach_nothing_and_alarm_nobody():
    rng = np.random.default_rng(8)
    rms = healthy(400, rng)
    usable = np.ones(400, bool)
    rms[200:230] = 50.0
    usable[200:230] = False
    assert run(rms, usable=usable)[0].t_fs is None


def test_end_of_life_needs_three_consecutive_blocks():
    peak = np.ones(50)
    peak[[10, 20, 21, 30]] = 500.0
    assert run(np.ones(50), peak=peak)[0].t_eol is None
    peak[40:43] = 20 * 9.80665
    state, outputs = run(np.ones(50), peak=peak)
    assert state.t_eol is not None
    assert state.t_eol.sequence == 41
    assert [i for i, o in enumerate(outputs) if o.end] == [42]
    assert state.stage == "end_of_life"


def test_an_unknown_unit_has_no_end_of_life():
    state = DetectState()
    for i in range(10):
        state, _ = step(state, DetectInput(i + 1, None, 1e9, None, None), SETTINGS)
    assert state.t_eol is None


def test_learning_by_time():
    settings = DetectSettings(learn_blocks=None, learn_time=1000.0, run_in_blocks=0)
    state, outputs = run(np.ones(150), settings=settings)
    assert state.baseline is not None
    assert next(i for i, o in enumerate(outputs) if o.stage == "healthy") == 100


@settings(max_examples=effort_count(quick=10, full=25))
@given(cut=st.integers(1, 399), seed=st.integers(0, 2**31))
def test_a_restart_from_json_changes_nothing(cut, seed):
    rng = np.random.default_rng(seed)
    rms = healthy(400, rng)
    rms[300:] *= np.linspace(1, 4, 100)
    whole, whole_outputs = run(rms)
    state = DetectState()
    outputs = []
    for i, value in enumerate(rms):
        if i == cut:
            state = DetectState.from_dict(json.loads(json.dumps(state.to_dict())))
        state, output = step(state, DetectInput(i + 1, 10.0 * i, float(value), 1.0, 1.0), SETTINGS)
        outputs.append(output)
    assert state == whole
    assert outputs == whole_outputs


@settings(max_examples=effort_count(quick=10, full=25))
@given(gain=st.floats(1e-6, 1e6), seed=st.integers(0, 2**31))
def test_the_unit_does_not_matter(gain, seed):
    rng = np.random.default_rng(seed)
    rms = healthy(300, rng)
    rms[200:] *= np.linspace(1, 3, 100)
    assert run(rms)[0].t_fs == run(gain * rms)[0].t_fs


def test_a_state_of_another_version_is_refused():
    with pytest.raises(ValueError, match="version 2"):
        DetectState.from_dict({**DetectState().to_dict(), "version": 2})
