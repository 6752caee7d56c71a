from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.report.score import metrics
from tests.oracles.crps import crps_from_sample
from tests.oracles.score_oracle import (
    convergence_by_steps,
    crps_by_steps,
    crps_of_pairs,
    distribution,
    horizon_by_looking,
)
from tests.support.effort import effort_count

TIMES = st.floats(0.0, 1e4)
LEVELS = (0.1, 0.25, 0.5, 0.75, 0.9)
ROWS = st.lists(TIMES, min_size=5, max_size=5).map(sorted)
POINT = (0.5,)


def test_relative_accuracy_is_one_where_exact_and_undefined_after_the_end() -> None:
    found = metrics.relative_accuracy([100.0, 150.0, 300.0, math.nan, 5.0], [100.0, 100.0, 100.0, 100.0, 0.0])
    assert found[:3].tolist() == [1.0, 0.5, -1.0]
    assert np.isnan(found[3:]).all()


def test_cumulative_relative_accuracy_does_not_depend_on_where_the_clock_begins() -> None:
    """Scored on absolute times the same forecasts would get 0.99 and more."""
    moments = np.arange(0.0, 500.0, 50.0)
    for origin in (0.0, 1e6, 1.7e9):
        t = origin + moments
        true = origin + 500.0 - t
        assert metrics.cumulative_relative_accuracy(true * 1.2, true) == pytest.approx(0.8, abs=1e-6)
    assert metrics.cumulative_relative_accuracy([100.0, 0.0, math.nan], [100.0, 100.0, 100.0]) == 0.5
    assert math.isnan(metrics.cumulative_relative_accuracy([math.nan], [1.0]))


@given(ROWS, TIMES, TIMES)
@settings(max_examples=effort_count(quick=20, full=2000))
def test_probability_within_is_a_difference_of_the_distribution(row: list[float], one: float, other: float) -> None:
    low, high = sorted((one, other))
    found = metrics.probability_within(LEVELS, [row], low, high)[0]
    below = distribution(LEVELS, row, math.nextafter(low, -math.inf))
    assert found == pytest.approx(distribution(LEVELS, row, high) - below, abs=1e-6)


def test_a_point_forecast_is_inside_or_outside_a_band() -> None:
    found = metrics.probability_within(POINT, [[10.0], [11.0], [12.1], [math.nan]], 10.0, 12.0)
    assert found[:3].tolist() == [1.0, 1.0, 0.0]
    assert math.isnan(found[3])


@given(ROWS, TIMES)
@settings(max_examples=effort_count(quick=5, full=200))
def test_crps_from_quantiles_is_the_integral_of_its_definition(row: list[float], true: float) -> None:
    found = metrics.crps_from_quantiles(LEVELS, [row], [true])[0]
    assert found == pytest.approx(crps_by_steps(LEVELS, row, true), rel=1e-3, abs=1e-3)


@given(TIMES, TIMES)
def test_crps_of_a_point_is_its_absolute_error(r: float, true: float) -> None:
    assert metrics.crps_from_quantiles(POINT, [[r]], [true])[0] == pytest.approx(abs(r - true), rel=1e-12)
    assert crps_from_sample([r], true) == pytest.approx(abs(r - true), rel=1e-12)


@given(st.lists(st.tuples(TIMES, st.floats(0.01, 5.0)), min_size=1, max_size=8), TIMES)
@settings(max_examples=effort_count(quick=20, full=2000))
def test_crps_from_a_sample_is_the_double_sum(pairs: list[tuple[float, float]], true: float) -> None:
    sample, weights = [x for x, _ in pairs], [w for _, w in pairs]
    found = crps_from_sample(sample, true, weights)
    assert float(found) == pytest.approx(crps_of_pairs(sample, weights, true), rel=1e-9, abs=1e-8)


def test_many_quantiles_and_a_large_sample_of_the_same_distribution_agree() -> None:
    rng = np.random.default_rng(5)
    sample = rng.exponential(100.0, (3, 20_000))
    levels = np.arange(0.5, 400.0) / 400.0
    quantiles = np.quantile(sample, levels, axis=1).T
    true = np.array([0.0, 80.0, 400.0])
    from_sample = crps_from_sample(sample, true)
    assert metrics.crps_from_quantiles(levels, quantiles, true) == pytest.approx(from_sample, rel=0.01)
    # Exponential with mean m: CRPS = y + 2 m exp(-y / m) - 3 m / 2.
    expected = true + 200.0 * np.exp(-true / 100.0) - 150.0
    assert from_sample == pytest.approx(expected, rel=0.03)


def test_alpha_lambda_judges_the_forecast_that_stood_at_the_share_of_the_stage() -> None:
    t = np.array([1000.0, 1040.0, 1060.0])
    right_then = [[100.0], [60.0], [0.0]]
    found = metrics.alpha_lambda(t, 1100.0, POINT, right_then)
    assert (found.t, found.mass, found.passed) == (1040.0, 1.0, True)
    later = metrics.alpha_lambda(t, 1100.0, POINT, right_then, lam=0.7)
    assert (later.t, later.mass, later.passed) == (1060.0, 0.0, False)
    unanswered = metrics.alpha_lambda(t, 1100.0, POINT, [[100.0], [math.nan], [40.0]])
    assert (unanswered.mass, unanswered.passed) == (0.0, False)
    assert metrics.alpha_lambda([], 1100.0, POINT, np.zeros((0, 1))).passed is None
    assert metrics.alpha_lambda([1200.0], 1100.0, POINT, [[1.0]]).passed is None


def test_alpha_lambda_of_a_distribution_is_the_mass_in_the_band() -> None:
    row = [[0.0, 80.0, 100.0, 120.0, 300.0]]
    found = metrics.alpha_lambda([0.0], 100.0, LEVELS, row, lam=0.0, beta=0.51)
    assert found.mass == pytest.approx(0.5)
    assert found.passed is False
    assert metrics.alpha_lambda([0.0], 100.0, LEVELS, row, lam=0.0, beta=0.5).passed


def test_the_horizon_must_persist() -> None:
    t = [0.0, 20.0, 40.0, 60.0, 80.0]
    in_and_out = [[100.0], [80.0], [0.0], [40.0], [20.0]]
    assert metrics.prognostic_horizon(t, 100.0, POINT, in_and_out) == 40.0
    assert metrics.prognostic_horizon(t, 100.0, POINT, [[100.0], [80.0], [60.0], [40.0], [math.nan]]) == 0.0
    assert metrics.prognostic_horizon(t, 100.0, POINT, [[5.0]] * 5) == 20.0
    assert math.isnan(metrics.prognostic_horizon([100.0], 100.0, POINT, [[0.0]]))


@given(st.lists(st.floats(0.0, 200.0), min_size=1, max_size=9), st.floats(0.0, 1e9))
@settings(max_examples=effort_count(quick=20, full=2000))
def test_the_horizon_is_the_first_that_holds(predicted: list[float], origin: float) -> None:
    t = np.linspace(0.0, 90.0, len(predicted))
    good = [abs(r - (100.0 - moment)) <= 20.0 for r, moment in zip(predicted, t.tolist(), strict=True)]
    if any(abs(abs(r - (100.0 - m)) - 20.0) < 1e-4 for r, m in zip(predicted, t.tolist(), strict=True)):
        return  # on the edge of the band rounding decides
    found = metrics.prognostic_horizon(t + origin, 100.0 + origin, POINT, np.array(predicted)[:, np.newaxis])
    assert found == pytest.approx(horizon_by_looking(t.tolist(), good, 100.0), abs=1e-5)


@given(st.lists(st.floats(0.0, 300.0), min_size=1, max_size=6))
@settings(max_examples=effort_count(quick=10, full=300))
def test_convergence_is_the_distance_of_the_centroid(error: list[float]) -> None:
    t = np.linspace(50.0, 90.0, len(error)).tolist()
    found = metrics.convergence(t, error, 100.0)
    assert found == pytest.approx(convergence_by_steps(t, error, 100.0), rel=1e-3, abs=1e-2)


def test_an_error_that_vanishes_early_converges_faster() -> None:
    t = np.linspace(0.0, 90.0, 10)
    early = metrics.convergence(t, np.exp(-t / 10.0), 100.0)
    late = metrics.convergence(t, np.exp(-t / 50.0), 100.0)
    assert early < late
    assert math.isnan(metrics.convergence([100.0], [1.0], 100.0))
    # A missing answer leaves the one before it standing.
    assert metrics.convergence([0.0, 10.0], [4.0, math.nan], 100.0) == metrics.convergence([0.0], [4.0], 100.0)


def test_coverage_and_width_leave_out_what_was_not_given() -> None:
    lower, upper = [0.0, 10.0, math.nan, 5.0], [10.0, 20.0, math.nan, 6.0]
    assert metrics.coverage(lower, upper, [5.0, 25.0, 1.0, 6.0]) == pytest.approx(2.0 / 3.0)
    assert metrics.mean_width(lower, upper) == pytest.approx(7.0)
    assert math.isnan(metrics.coverage([math.nan], [math.nan], [1.0]))
    assert math.isnan(metrics.mean_width([math.nan], [math.nan]))


def test_onset_is_late_early_or_never() -> None:
    assert metrics.onset_delay(130.0, 100.0) == 30.0
    assert math.isnan(metrics.onset_delay(90.0, 100.0))
    assert math.isnan(metrics.onset_delay(math.nan, 100.0))
    assert metrics.false_alarms_per_1000([10.0, 99.0, 100.0], 400, 100.0) == 5.0
    assert math.isnan(metrics.false_alarms_per_1000([], 0, 100.0))


def test_a_mean_over_runs_counts_runs() -> None:
    found = metrics.mean_over_runs([1.0, 3.0, math.nan, 2.0])
    assert (found.mean, found.runs) == (2.0, 3)
    assert found.standard_error == pytest.approx(1.0 / math.sqrt(3.0))
    alone = metrics.mean_over_runs([4.0])
    assert (alone.mean, alone.runs) == (4.0, 1)
    assert math.isnan(alone.standard_error)
    assert math.isnan(metrics.mean_over_runs([]).mean)


@pytest.mark.parametrize(
    ("levels", "quantiles", "message"),
    [
        ((0.5, 0.1), [[1.0, 2.0]], "levels must rise"),
        ((0.0,), [[1.0]], "levels must rise"),
        ((0.1, 0.9), [[1.0]], r"shape \(n, 2\)"),
        ((0.1, 0.9), [[2.0, 1.0]], "must not fall"),
    ],
)
def test_what_is_no_forecast_is_refused(levels: tuple[float, ...], quantiles: list[list[float]], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        metrics.crps_from_quantiles(levels, quantiles, [1.0])


def test_weights_that_are_none_are_refused() -> None:
    with pytest.raises(ValueError, match="must not be negative"):
        crps_from_sample([1.0, 2.0], 1.0, [1.0, -1.0])
