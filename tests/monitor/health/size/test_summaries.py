"""Bounded histories and their summaries, against the whole history."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.health.size.library.summaries import FIRST, RECENT, WHOLE, LevelHistory, summarise, summary_names
from tests.oracles.summaries_oracle import summarise_slowly
from tests.support.effort import effort_count

INTERVAL = 300.0


def read(times: np.ndarray, values: np.ndarray) -> LevelHistory:
    history = LevelHistory.empty(values.shape[1])
    for t, row in zip(times, values, strict=True):
        history = history.add(float(t), row)
    return history


@st.composite
def runs(draw: st.DrawFn, most: int = WHOLE) -> tuple[np.ndarray, np.ndarray]:
    count = draw(st.integers(1, most))
    random = np.random.default_rng(draw(st.integers(0, 2**31)))
    gaps = INTERVAL * random.choice([0.0, 0.5, 1.0, 1.0, 1.0, 3.0], count)
    times = draw(st.sampled_from([0.0, 1e9])) + np.cumsum(gaps)
    return times, np.cumsum(random.normal(size=(count, 2)), axis=0)


@settings(max_examples=effort_count(quick=16, full=400))
@given(runs())
def test_summary_is_that_of_the_whole_history(run: tuple[np.ndarray, np.ndarray]) -> None:
    times, values = run
    fast = summarise(read(times, values), INTERVAL)
    assert len(fast) == len(summary_names(("a", "b")))
    np.testing.assert_allclose(fast, summarise_slowly(times, values, INTERVAL), rtol=1e-9, atol=1e-9)


@settings(max_examples=effort_count(quick=4, full=100))
@given(runs(), st.sampled_from([2.0**-7, 0.25, 8.0, 1024.0]))
def test_only_the_ratio_of_times_to_the_interval_counts(run: tuple[np.ndarray, np.ndarray], factor: float) -> None:
    times, values = run
    times = times - times[0]
    there = summarise(read(times, values), INTERVAL)
    scaled = summarise(read(times * factor, values), INTERVAL * factor)
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


def test_state_survives_json() -> None:
    random = np.random.default_rng(2)
    history = LevelHistory.empty(2)
    assert LevelHistory.from_dict(json.loads(json.dumps(history.to_dict()))) == history
    for block in range(100):
        history = history.add(60.0 * block, random.normal(size=2))
        stored = LevelHistory.from_dict(json.loads(json.dumps(history.to_dict())))
        assert stored == history
        history = stored


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
