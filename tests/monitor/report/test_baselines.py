from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.health.rest import quadratic as forecast
from monitor.report.score import baselines
from tests.oracles.score_oracle import line_ahead
from tests.support.effort import effort_count

LIVES = (100.0, 200.0, 400.0)


def test_the_constant_is_what_is_left_of_the_median_life() -> None:
    assert baselines.constant([0.0, 150.0, 250.0], LIVES).tolist() == [200.0, 50.0, 0.0]


def test_climatology_keeps_those_that_lasted_as_long() -> None:
    found = baselines.climatology(150.0, LIVES)
    assert found.values.tolist() == [50.0, 250.0]
    assert found.weights.tolist() == [0.5, 0.5]
    assert found.quantiles([0.5]).tolist() == [150.0]
    outlived = baselines.climatology(400.0, LIVES)
    assert (outlived.values.tolist(), outlived.weights.tolist()) == ([0.0], [1.0])


def test_the_elapsed_time_alone_weighs_lives_as_moments_drawn_from_each_meet_them() -> None:
    """Against many moments drawn evenly from each life, of which those near an elapsed time are kept."""
    rng = np.random.default_rng(3)
    moments = rng.random((3, 400_000)) * np.array(LIVES)[:, np.newaxis]
    near = np.abs(moments - 80.0) < 5.0
    met = near.sum(axis=1) / near.sum()
    found = baselines.elapsed_alone(80.0, LIVES)
    assert found.values.tolist() == [20.0, 120.0, 320.0]
    assert found.weights == pytest.approx(met, abs=0.005)


def test_doubling_gives_the_elapsed_time_as_the_median() -> None:
    """At a moment drawn evenly from a life T, the true remaining time lies below each quantile at its level."""
    levels = [0.1, 0.5, 0.9]
    assert baselines.doubling([0.0, 60.0], levels)[:, 1].tolist() == [0.0, 60.0]
    share = np.random.default_rng(1).random(100_000)
    below = (1.0 - share)[:, np.newaxis] <= baselines.doubling(share, levels)
    assert below.mean(axis=0) == pytest.approx(levels, abs=0.005)


def test_quantiles_of_several_forecasts() -> None:
    samples = [baselines.climatology(elapsed, LIVES) for elapsed in (0.0, 150.0)]
    found = baselines.quantiles_of(samples, [0.1, 0.5])
    assert found.tolist() == [samples[0].quantiles([0.1, 0.5]).tolist(), samples[1].quantiles([0.1, 0.5]).tolist()]
    assert baselines.quantiles_of([], [0.5]).shape == (0, 1)


@pytest.mark.parametrize("lives", [[], [0.0, 1.0], [math.nan], [math.inf]])
def test_lifetimes_that_are_none_are_refused(lives: list[float]) -> None:
    for function in (baselines.constant, baselines.climatology, baselines.elapsed_alone):
        with pytest.raises(ValueError, match="one or more positive times"):
            function(1.0, lives)


@given(st.lists(st.tuples(st.floats(0.5, 50.0), st.floats(0.0, 0.9)), min_size=1, max_size=12), st.floats(0.0, 1.7e9))
@settings(max_examples=effort_count(quick=20, full=2000))
def test_the_running_line_is_the_fit_to_what_was_known(pairs: list[tuple[float, float]], origin: float) -> None:
    t = origin + np.cumsum([step for step, _ in pairs])
    v = np.array([value for _, value in pairs])
    found = baselines.linear(t, v, 1.0)
    for i in range(len(pairs)):
        expected = line_ahead((t[: i + 1] - origin).tolist(), v[: i + 1].tolist(), 1.0)
        flat = not math.isfinite(expected) or expected > 1e6
        if not flat:
            assert found[i] == pytest.approx(expected, rel=1e-3, abs=1e-3)


def test_each_law_is_forecast_by_its_own_baseline() -> None:
    t = np.arange(1.0, 50.0)
    straight = 0.01 + 0.002 * t
    assert baselines.linear(t, straight, 0.2)[1:] == pytest.approx(95.0 - t[1:])
    grown = 0.001 * np.exp(t / 20.0)
    end = 20.0 * math.log(200.0)
    assert baselines.exponential(t, grown, 0.2)[1:] == pytest.approx(end - t[1:])
    bent = 0.001 * (1.0 + t + 0.1 * t**2)
    found = baselines.thesis(t, bent, 0.5)
    root = (-1.0 + math.sqrt(1.0 + 4.0 * 0.1 * 499.0)) / 0.2
    assert np.isnan(found[:2]).all()
    assert found[2:] == pytest.approx(root - t[2:], rel=1e-6)


@pytest.mark.parametrize("method", [baselines.linear, baselines.exponential, baselines.thesis])
def test_history_alone_has_no_hindsight(method: Callable[[Any, Any, float], Any]) -> None:
    """What was forecast up to a moment does not depend on what came after it."""
    rng = np.random.default_rng(8)
    t = np.cumsum(rng.uniform(1.0, 5.0, 60))
    v = np.abs(np.cumsum(rng.normal(0.01, 0.02, 60)))
    v[[5, 17]] = math.nan
    whole = method(t, v, 0.6)
    for cut in (1, 2, 3, 18, 40):
        assert np.array_equal(method(t[:cut], v[:cut], 0.6), whole[:cut], equal_nan=True)


def test_what_does_not_grow_has_no_answer_and_what_has_crossed_stays_so() -> None:
    t = np.arange(5.0)
    for method in (baselines.linear, baselines.exponential):
        assert np.isnan(method(t, np.full(5, 0.1), 0.2)).all()
        assert np.isnan(method(t, np.full(5, math.nan), 0.2)).all()
        assert np.isnan(method(t, np.array([0.5, 0.4, 0.3, 0.2, 0.1]), 0.6)).all()
        assert method(t, np.array([0.1, 0.3, 0.1, math.nan, 0.1]), 0.2)[1:].tolist() == [0.0] * 4
    assert np.isnan(baselines.exponential(t, np.array([0.0, -1.0, 0.0, 0.0, 0.1]), 0.2)).all()


def test_the_thesis_is_its_own_module() -> None:
    t, v = np.arange(0.0, 300.0, 30.0), 1e-9 * np.arange(1.0, 11.0) ** 1.5
    found = baselines.thesis(t, v, 0.05e-6)
    state = forecast.ForecastState()
    for i in range(10):
        state, results = forecast.step(state, float(t[i]), float(v[i]), thresholds=(0.05e-6,))
        assert found[i] == pytest.approx(results[0].tt, nan_ok=True)
