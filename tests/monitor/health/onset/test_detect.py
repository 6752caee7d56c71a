"""The onset detector: rate, persistence, run-in, episodes that close, end of life, explicit state."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.health.onset import (
    LINES,
    Baseline,
    DetectInput,
    DetectSettings,
    DetectState,
    Mark,
    exceedance_rate,
    step,
    threshold_for,
)
from monitor.health.onset.dependence import UNKNOWN
from monitor.health.onset.detector import one_of
from tests.support.effort import effort_count

SETTINGS = DetectSettings()
THESIS = DetectSettings(features=("rms", "h_or"))


def run(rms, lines=None, peak=None, settings=SETTINGS, usable=None, state=None):
    state = DetectState() if state is None else state
    outputs = []
    lines = {} if lines is None else lines
    for i, value in enumerate(rms):
        block = DetectInput(
            sequence=i + 1,
            time=10.0 * i,
            rms=float(value),
            prominence={"h_or": 1.0} | {name: float(values[i]) for name, values in lines.items()},
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
    lines = {"h_or": prominence}
    assert run(rms, lines)[0].t_fs is not None
    assert run(rms)[0].t_fs is None
    assert run(np.full(300, 1.0), lines)[0].t_fs is None


@pytest.mark.parametrize("part", LINES)
def test_lines_of_any_part_are_an_onset_unless_they_are_not_listened_to(part):
    rng = np.random.default_rng(14)
    lines = {name: healthy(300, rng, scatter=0.1) for name in LINES}
    lines[part][250:] *= 2.5
    state, outputs = run(np.ones(300), lines)
    assert state.t_fs is not None
    assert state.t_fs.sequence == 251
    assert next(output for output in outputs if output.alarm).leading == part
    assert (run(np.ones(300), lines, settings=THESIS)[0].t_fs is not None) == (part == "h_or")


def test_lines_that_are_not_shown_cost_nothing():
    """The threshold and the score of a channel are those of the features that it has."""
    rms = healthy(200, np.random.default_rng(15))
    lines = {"h_or": healthy(200, np.random.default_rng(16), scatter=0.1)}
    rms[150:] *= 1.3
    assert [o.score for o in run(rms, lines)[1]] == [o.score for o in run(rms, lines, settings=THESIS)[1]]
    bare = [step(DetectState(baseline=Baseline(0.0, 0.03)), DetectInput(1, 0.0, 1.2, {}, 1.0), SETTINGS)[1]]
    assert bare[0].threshold == threshold_for(1.0, 1) < threshold_for(1.0, 2)


@settings(max_examples=effort_count(quick=25, full=300))
@given(mixing=st.lists(st.floats(-1.0, 1.0), min_size=16, max_size=16), seed=st.integers(0, 2**31))
def test_the_rate_holds_however_the_lines_depend_on_each_other(mixing, seed):
    """At 50 in 1000, so that a sample shows it; of wholly dependent lines and of opposed ones too."""
    matrix = np.array(mixing).reshape(4, 4) + 1e-3 * np.eye(4)
    matrix /= np.linalg.norm(matrix, axis=1)[:, None]
    rng = np.random.default_rng(seed)
    highest = (rng.standard_normal((20_000, 4)) @ matrix.T).max(axis=1)
    counted = np.sqrt(np.maximum(np.square(np.maximum(highest, 0.0)) - 2.0 * math.log(4), 0.0))
    assert counted[0] == pytest.approx(one_of(float(highest[0]), 4))
    score = np.hypot(np.maximum(rng.standard_normal(20_000), 0.0), counted)
    assert np.mean(score > threshold_for(50.0)) < 0.05 + 4.0 * math.sqrt(0.05 / 20_000)


def test_one_of_several_is_never_more_likely_than_one_alone():
    def tail(x):
        return 0.5 * math.erfc(x / math.sqrt(2.0))

    for count in (2, 3, 4):
        for z in np.linspace(1.7, 12.0, 50).tolist():
            assert count * tail(z) <= tail(one_of(z, count)) * (1.0 + 1e-12)


@pytest.mark.parametrize("groups", range(1, 7))
def test_the_rate_of_more_features_is_the_mixture_of_chi_distributions(groups):
    rng = np.random.default_rng(groups)
    length = np.linalg.norm(np.maximum(rng.standard_normal((200_000, groups)), 0.0), axis=1)
    for level in (1.5, 2.5):
        rate = exceedance_rate(level, groups)
        assert np.mean(length > level) == pytest.approx(rate, abs=4.0 * math.sqrt(rate / 200_000))


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


def episode_of(*, length, quiet, close_blocks=50, after=0):
    """Return the state after a baseline, an episode and quiet blocks, then as long an episode again."""
    rms = np.ones(150 + length + quiet + after)
    rms[150 : 150 + length] = 4.0
    rms[150 + length + quiet :] = 4.0
    return run(rms, settings=DetectSettings(close_blocks=close_blocks))


def test_an_episode_that_returns_to_the_baseline_is_closed_and_kept_and_the_next_one_is_found():
    state, outputs = episode_of(length=20, quiet=60, after=10)
    (episode,) = state.episodes
    marks = (episode.began, episode.known, episode.quiet, episode.closed)
    assert [mark.sequence for mark in marks] == [151, 155, 171, 220]
    assert episode.closed.time == 2190.0
    assert [i + 1 for i, output in enumerate(outputs) if output.closed] == [220]
    assert outputs[218].stage == "final"
    assert outputs[219].stage == "healthy"
    assert state.t_fs is not None
    assert state.t_fs.sequence == 231
    assert state.stage == "final"


def test_an_episode_stays_open_while_it_is_not_quiet_for_long_enough():
    assert episode_of(length=20, quiet=49)[0].stage == "final"
    assert episode_of(length=20, quiet=49, after=1)[0].quiet == 0
    assert episode_of(length=20, quiet=11, close_blocks=10)[0].stage == "healthy"
    rms = np.ones(400)
    rms[150:] = np.where(np.arange(250) % 40 == 0, 4.0, 1.0)
    rms[150:156] = 4.0
    state, _ = run(rms)
    assert state.t_fs is not None
    assert state.t_fs.sequence == 151


@settings(max_examples=effort_count(quick=20, full=200))
@given(
    spans=st.lists(st.tuples(st.integers(5, 40), st.integers(10, 120)), min_size=1, max_size=5),
    cut=st.integers(131, 400),
)
def test_episodes_that_come_and_go(spans, cut):
    """Each that is quiet for long enough closes once; those closer together are one; a restart changes nothing."""
    level, expected, begun = [1.0] * 150, [], None
    for loud, quiet in spans:
        begun = len(level) + 1 if begun is None else begun
        level += [3.0] * loud + [1.0] * quiet
        if quiet >= SETTINGS.close_blocks:
            expected.append((begun, len(level) - quiet + SETTINGS.close_blocks))
            begun = None
    state, outputs = run(level)
    assert [(e.began.sequence, e.closed.sequence) for e in state.episodes] == expected
    assert (None if state.t_fs is None else state.t_fs.sequence) == begun
    assert sum(output.alarm for output in outputs) == len(expected) + (begun is not None)
    restarted = DetectState()
    for i, value in enumerate(level):
        if i == cut:
            restarted = DetectState.from_dict(json.loads(json.dumps(restarted.to_dict())))
        restarted, _ = step(restarted, DetectInput(i + 1, 10.0 * i, value, {"h_or": 1.0}, 1.0), SETTINGS)
    assert restarted == state


def test_a_baseline_that_the_machine_stays_well_below_is_learned_anew():
    """A run-in at twice the later level would hide damage that raises RMS by a half."""
    rng = np.random.default_rng(21)
    rms = healthy(700, rng)
    rms[:180] *= 2.0
    rms[600:] *= 1.6
    rms[200:600:40] *= 3.0
    state, outputs = run(rms)
    (at,) = [i + 1 for i, output in enumerate(outputs) if output.relearned]
    said = outputs[at - 1].relearned
    assert said is not None
    assert said.rms_before == pytest.approx(2.0, rel=0.05)
    assert said.rms_after == pytest.approx(1.0, rel=0.05)
    # The lower level has lasted as long as all before it.
    assert 358 <= at <= 363
    assert state.t_fs is not None
    assert state.t_fs.sequence == 601


@pytest.mark.parametrize(("low", "share"), [(0.85, 1.0), (0.5, 0.4)], ids=["not by much", "not for long"])
def test_a_baseline_is_kept_where_the_level_is_not_well_below_it_or_returns(low, share):
    rng = np.random.default_rng(22)
    rms = healthy(1000, rng)
    for start in range(200, 1000, 100):
        rms[start : start + round(100 * share)] *= low
    state, outputs = run(rms)
    assert not any(output.relearned for output in outputs)
    assert state.reference_rms == pytest.approx(1.0, rel=0.02)


def test_lines_that_an_earlier_version_did_not_learn_are_learned_while_healthy():
    old = DetectState.from_dict({**VERSION_1, "seen": 130})
    assert old.baseline == Baseline(0.0, 0.03, {"h_or": (0.0, 0.1)})
    rng = np.random.default_rng(23)
    lines = {name: healthy(300, rng, scatter=0.1) for name in LINES[:3]}
    lines["h_ir"][200:] *= 3.0
    state, _ = run(np.ones(300), lines, state=old)
    assert state.baseline is not None
    assert set(state.baseline.lines) == {"h_or", "h_ir", "h_ball"}
    assert state.baseline.lines["h_or"] == (0.0, 0.1)
    assert state.t_fs is not None
    assert state.t_fs.sequence == 201


def test_unusable_blocks_teach_nothing_and_alarm_nobody():
    rng = np.random.default_rng(8)
    rms = healthy(400, rng)
    usable = np.ones(400, bool)
    rms[200:230] = 50.0
    usable[200:230] = False
    assert run(rms, usable=usable)[0].t_fs is None


def ending(peaks, rms, settings=SETTINGS):
    """Return the state after 140 healthy blocks and then these, peaks as multiples of the limit."""
    peak = np.concatenate([np.ones(140), np.array(peaks) * 20 * 9.80665])
    return run(np.concatenate([np.ones(140), rms]), peak=peak, settings=settings)


def test_the_end_of_life_is_the_first_of_consecutive_high_peaks_in_the_final_stage():
    state, outputs = ending([0.3] * 10 + [1.0] * 2 + [0.3] + [1.0] * 5, np.full(18, 4.0))
    assert state.t_eol is not None
    assert state.t_eol.sequence == 154
    assert [i + 1 for i, output in enumerate(outputs) if output.end] == [156]
    assert state.stage == "end_of_life"


def test_high_peaks_without_a_final_stage_end_no_life():
    """Isolated spikes of an else healthy machine: RMS of their blocks is high too, but only of theirs."""
    state, outputs = ending(
        [1.0] * 3 + [0.1] * 20 + [1.0] * 3 + [0.1] * 20, [6.0] * 3 + [1.0] * 20 + [6.0] * 3 + [1] * 20
    )
    assert state.t_fs is None
    assert state.t_eol is None
    assert not any(output.end for output in outputs)


@pytest.mark.parametrize("level", [1.0, 1.6], ids=["back at the baseline", "still raised"])
def test_spikes_within_a_final_stage_end_no_life(level):
    state, _ = ending([0.1] * 20 + [1.0] * 3 + [0.1] * 10, [4.0] * 10 + [level] * 10 + [6.0] * 3 + [level] * 10)
    assert state.t_fs is not None
    assert state.t_eol is None


def test_a_sudden_end_is_known_with_its_onset_and_never_closes():
    state, outputs = ending([1.2] * 8 + [0.1] * 100, [6.0] * 8 + [1.0] * 100)
    assert state.t_fs == state.t_eol == Mark(141, 1400.0)
    assert [i + 1 for i, output in enumerate(outputs) if output.end] == [145]
    assert state.episodes == ()


def test_an_unknown_unit_has_no_end_of_life():
    state = DetectState()
    for i in range(10):
        state, _ = step(state, DetectInput(i + 1, None, 1e9, {}, None), SETTINGS)
    assert state.t_eol is None


def test_learning_by_time():
    settings = DetectSettings(learn_blocks=None, learn_time=1000.0, run_in_blocks=0)
    state, outputs = run(np.ones(150), settings=settings)
    assert state.baseline is not None
    assert next(i for i, o in enumerate(outputs) if o.stage == "healthy") == 100


@settings(max_examples=effort_count(quick=10, full=25))
@given(gain=st.floats(1e-6, 1e6), seed=st.integers(0, 2**31))
def test_the_unit_does_not_matter(gain, seed):
    rng = np.random.default_rng(seed)
    rms = healthy(300, rng)
    rms[200:] *= np.linspace(1, 3, 100)
    assert run(rms)[0].t_fs == run(gain * rms)[0].t_fs


VERSION_1 = {
    "version": 1,
    "seen": 300,
    "learned": [],
    "dropped": 0,
    "baseline": {"ln_rms": 0.0, "ln_rms_sd": 0.03, "ln_prominence": 0.0, "ln_prominence_sd": 0.1},
    "exceeding": 0,
    "elevated": None,
    "t_fs": None,
    "t_fs_known": None,
    "high_peaks": 0,
    "first_high_peak": None,
    "t_eol": None,
}
"""As the first releases wrote it."""


def test_a_state_of_version_1_goes_on():
    marks = {name: {"sequence": 200, "time": None} for name in ("elevated", "t_fs", "t_fs_known")}
    state = DetectState.from_dict({**VERSION_1, **marks})
    assert state.stage == "final"
    state, _ = run(np.ones(60), state=state)
    assert [episode.began.sequence for episode in state.episodes] == [200]
    assert state.stage == "healthy"
    learning = DetectState.from_dict({**VERSION_1, "baseline": None, "learned": [[0.0, 0.1, 0.2], [10.0, 0.1, None]]})
    assert learning.learned == ((0.0, 0.1, (0.2, None, None, None), UNKNOWN), (10.0, 0.1, (None,) * 4, UNKNOWN))
    without = {"ln_rms": 0.0, "ln_rms_sd": 0.1, "ln_prominence": 0.0, "ln_prominence_sd": 0.0}
    assert DetectState.from_dict({**VERSION_1, "baseline": without}).baseline == Baseline(0.0, 0.1)
