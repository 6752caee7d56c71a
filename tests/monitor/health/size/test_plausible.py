"""Blocks that no life of a library can give get no V_eq, and sound lives keep theirs."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.health.size import DamageInput
from monitor.health.size.library.forecaster import LibrarySettings, LibraryState, step
from monitor.health.size.library.plausible import LAGS, MAX_GAP, Limits, Watch, step_score
from monitor.health.size.library.summaries import FIRST, RECENT, WHOLE, LevelHistory, summarise, summary_names
from tests.oracles.summaries_oracle import summarise_slowly
from tests.oracles.toy_lives import INTERVAL, THRESHOLD, toy_library, toy_life
from tests.support.effort import effort_count

LIVES = effort_count(quick=8, full=200)
Change = Callable[[list[DamageInput], np.random.Generator], list[DamageInput]]


def toy_blocks(number: int) -> list[DamageInput]:
    life = toy_life(number)
    rows = zip(life.t, life.rms, life.harmonics, life.load, life.speed, strict=True)
    return [DamageInput(float(t), float(r), tuple(map(float, h)), float(n), float(f)) for t, r, h, n, f in rows]


def loud(block: DamageInput, gain: float) -> DamageInput:
    return replace(block, rms=gain * block.rms, harmonics=tuple(gain * x for x in block.harmonics or ()))


def statuses(blocks: list[DamageInput], features: str = "rms+harmonics") -> list[str]:
    state, found = LibraryState(), []
    for block in blocks:
        state, damage, _ = step(state, block, toy_library(), LibrarySettings(features=features), thresholds=[THRESHOLD])
        found.append(str(damage.status))
    return found


def gain_changes(gain: float) -> Change:
    def change(blocks: list[DamageInput], rng: np.random.Generator) -> list[DamageInput]:
        half = len(blocks) // 2
        return blocks[:half] + [loud(block, gain) for block in blocks[half:]]

    return change


def noise(blocks: list[DamageInput], rng: np.random.Generator) -> list[DamageInput]:
    middle = blocks[len(blocks) // 2]
    return [
        replace(loud(middle, float(np.exp(rng.standard_normal()))), time=b.time, load=b.load, speed=b.speed)
        for b in blocks
    ]


def lost_lines(blocks: list[DamageInput], rng: np.random.Generator) -> list[DamageInput]:
    """The RMS of a damaged bearing with the lines of a sound one, as a fault of another part gives."""
    sound = blocks[0].harmonics or ()
    return [
        replace(b, harmonics=tuple(0.2 * x * math.exp(0.05 * rng.standard_normal()) for x in sound)) for b in blocks
    ]


@pytest.mark.parametrize("features", ["rms", "rms+harmonics"])
def test_few_sound_lives_are_ever_implausible(features: str) -> None:
    ever = [("implausible" in statuses(toy_blocks(4000 + n), features)) for n in range(2 * LIVES)]
    assert np.mean(ever) <= 0.05 + 2.0 / len(ever)


@pytest.mark.parametrize(
    ("change", "features"),
    [
        (gain_changes(3.0), "rms"),
        (gain_changes(3.0), "rms+harmonics"),
        (gain_changes(0.3), "rms"),
        (gain_changes(0.01), "rms+harmonics"),
        (noise, "rms"),
        (noise, "rms+harmonics"),
        (lost_lines, "rms+harmonics"),
    ],
)
def test_what_no_damage_gives_is_refused(change: Change, features: str) -> None:
    rng, flagged = np.random.default_rng(8), 0
    for number in range(5000, 5000 + LIVES):
        found = statuses(change(toy_blocks(number), rng), features)
        flagged += not {"ok"}.issuperset(found[len(found) // 2 : len(found) // 2 + 50])
    assert flagged >= 0.85 * LIVES


def test_a_gain_that_comes_back_leaves_no_trace() -> None:
    blocks = toy_blocks(2004)
    while_away = [loud(b, 4.0) if 30 <= i < 36 else b for i, b in enumerate(blocks)]
    found, sound = statuses(while_away), statuses(blocks)
    assert Counter(found[30:36]) == {"implausible": 6}
    assert found[36:] == sound[36:]


def test_a_gap_of_the_logging_ends_with_the_gap() -> None:
    blocks = toy_blocks(2004)
    late = [b if i < 30 else replace(b, time=b.time + 20 * 3600.0) for i, b in enumerate(blocks)]
    assert statuses(late)[30:] == statuses(blocks)[30:]


def test_an_older_state_goes_on() -> None:
    blocks, state = toy_blocks(2004), LibraryState()
    for block in blocks[:20]:
        state, _, _ = step(state, block, toy_library(), thresholds=[THRESHOLD])
    stored = json.loads(json.dumps(state.to_dict()))
    del stored["watch"]
    assert LibraryState.from_dict(stored | {"version": 1}) == state


@given(st.lists(st.floats(-5, 5), min_size=3, max_size=48), st.floats(-5, 5), st.floats(-3, 3))
def test_a_step_does_not_depend_on_the_unit(latest: list[float], level: float, shift: float) -> None:
    score = step_score(latest, level)
    moved = step_score([x + shift for x in latest], level + shift)
    assert score is not None
    assert moved == pytest.approx(score, abs=1e-9)


def test_longer_waits_allow_higher_rises_and_no_deeper_falls() -> None:
    limits = toy_library().fit_for("rms").limits
    assert isinstance(limits, Limits)
    assert list(limits.rise) == sorted(limits.rise)
    assert limits.largest_rise(0.3) == limits.rise[0]
    assert math.isinf(limits.largest_rise(LAGS[-1] + 1))
    assert not limits.holds_step(-1.01 * float(limits.fall[0]), 1000.0)


def test_refused_blocks_widen_the_limit_less_than_a_gap_does() -> None:
    watch = Watch(seen=0.0)
    for block in range(1, 100):
        watch = watch.see(block * INTERVAL, INTERVAL)
    assert watch.lag(99 * INTERVAL, INTERVAL) == MAX_GAP
    assert watch.closed == 0.0
    after = watch.see(199 * INTERVAL, INTERVAL)
    assert after.lag(199 * INTERVAL, INTERVAL) == 100.0
    assert after.closed == (100.0 - MAX_GAP) * INTERVAL
    assert after.use().lag(0.0, INTERVAL) == 0.0


SUMMARY_INTERVAL = 300.0


def read(times: np.ndarray, values: np.ndarray) -> LevelHistory:
    history = LevelHistory.empty(values.shape[1])
    for t, row in zip(times, values, strict=True):
        history = history.add(float(t), row)
    return history


@st.composite
def runs(draw: st.DrawFn, most: int = WHOLE) -> tuple[np.ndarray, np.ndarray]:
    count = draw(st.integers(1, most))
    random = np.random.default_rng(draw(st.integers(0, 2**31)))
    gaps = SUMMARY_INTERVAL * random.choice([0.0, 0.5, 1.0, 1.0, 1.0, 3.0], count)
    times = draw(st.sampled_from([0.0, 1e9])) + np.cumsum(gaps)
    return times, np.cumsum(random.normal(size=(count, 2)), axis=0)


@settings(max_examples=effort_count(quick=16, full=400))
@given(runs())
def test_summary_is_that_of_the_whole_history(run: tuple[np.ndarray, np.ndarray]) -> None:
    times, values = run
    fast = summarise(read(times, values), SUMMARY_INTERVAL)
    assert len(fast) == len(summary_names(("a", "b")))
    np.testing.assert_allclose(fast, summarise_slowly(times, values, SUMMARY_INTERVAL), rtol=1e-9, atol=1e-9)


@settings(max_examples=effort_count(quick=4, full=100))
@given(runs(), st.sampled_from([2.0**-7, 0.25, 8.0, 1024.0]))
def test_only_the_ratio_of_times_to_the_interval_counts(run: tuple[np.ndarray, np.ndarray], factor: float) -> None:
    times, values = run
    times = times - times[0]
    there = summarise(read(times, values), SUMMARY_INTERVAL)
    scaled = summarise(read(times * factor, values), SUMMARY_INTERVAL * factor)
    np.testing.assert_allclose(scaled, there, rtol=1e-9, atol=1e-9)


def test_memory_does_not_grow() -> None:
    random = np.random.default_rng(1)
    history = LevelHistory.empty(3)
    sizes = []
    for block in range(5000):
        history = history.add(10.0 * block, random.normal(size=3))
        if block in (200, 4999):
            sizes.append(len(json.dumps(history.to_dict())))
    assert len(history.recent) == RECENT
    assert len(history.first) == FIRST
    assert len(history.whole) <= WHOLE
    assert history.whole[0, 0] == 0.0
    assert sizes[1] < 1.2 * sizes[0]
    assert history.count == 5000
    assert np.all(np.isfinite(summarise(history, 10.0)))


def test_long_histories_keep_their_middle() -> None:
    times = 10.0 * np.arange(3000)
    values = np.stack((np.sin(times / 9000.0), times / 30000.0), axis=1)
    fast, slow = summarise(read(times, values), 10.0), summarise_slowly(times, values, 10.0)
    np.testing.assert_allclose(fast, slow, atol=0.02)


def test_times_may_repeat_but_not_go_back() -> None:
    history = LevelHistory.empty(1).add(5.0, np.zeros(1)).add(5.0, np.ones(1))
    assert history.elapsed == 0.0
    assert np.all(np.isfinite(summarise(history, 1.0)))
    for t in (4.9, math.nan, math.inf):
        with pytest.raises(ValueError, match=r"t must be finite and not before the latest point"):
            history.add(t, np.zeros(1))


def test_values_must_be_finite_and_of_the_right_number() -> None:
    for values in (np.array([math.nan]), np.zeros(2)):
        with pytest.raises(ValueError, match="values must be 1 finite numbers"):
            LevelHistory.empty(1).add(0.0, values)
