from __future__ import annotations

import json
import math
from collections.abc import Iterable
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from monitor.health.rest.quadratic import (
    ForecastState,
    QuadraticFit,
    RunningFit,
    step,
)
from monitor.health.size import Remaining, TtStatus
from tests.oracles.quadratic_oracle import fit_quadratic
from tests.support.effort import effort_count

MM2 = 1e-6
THRESHOLD = 0.05 * MM2
Floats = NDArray[np.float64]


def run(
    times: Iterable[float], volumes: Iterable[float], thresholds: tuple[float, ...] = (THRESHOLD,)
) -> tuple[ForecastState, list[tuple[Remaining, ...]]]:
    state, issued = ForecastState(), []
    for t, v in zip(times, volumes, strict=True):
        state, results = step(state, float(t), float(v), thresholds=thresholds)
        issued.append(results)
    return state, issued


def running_fit(times: Floats, values: Floats) -> RunningFit:
    fit = RunningFit.start(float(times[0]), float(values[0]))
    for t, v in zip(times[1:], values[1:], strict=True):
        fit = fit.add(float(t), float(v))
    return fit


def exact_fit(times: Floats, values: Floats) -> tuple[float, float, float]:
    """The constrained least squares in rational numbers: normal equations, no rounding at all."""
    tau = [Fraction(float(t)) - Fraction(float(times[0])) for t in times]
    y = [Fraction(float(v)) - Fraction(float(values[0])) for v in values]
    s2, s3, s4 = (sum(x**k for x in tau) for k in (2, 3, 4))
    p1 = sum(x * w for x, w in zip(tau, y, strict=True))
    p2 = sum(x * x * w for x, w in zip(tau, y, strict=True))
    det = s4 * s2 - s3 * s3
    a, b = (p2 * s2 - p1 * s3) / det, (p1 * s4 - p2 * s3) / det
    residual = sum((w - a * x * x - b * x) ** 2 for x, w in zip(tau, y, strict=True))
    mean = sum(y, Fraction(0)) / len(y)
    scatter = sum((w - mean) ** 2 for w in y)
    return float(a), float(b), float(1 - residual / scatter)


@st.composite
def histories(draw: st.DrawFn) -> tuple[Floats, Floats]:
    """Growing and noisy volumes, at steps from a second to months, evenly or not, begun at any time."""
    n = draw(st.integers(4, 60))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    step_length = 10.0 ** draw(st.floats(0, 6.5))
    gaps = rng.uniform(0.1, 2, n) if draw(st.booleans()) else np.ones(n)
    times = draw(st.sampled_from([0.0, 3600.0, 1.7e9])) + step_length * np.cumsum(gaps)
    share = (times - times[0]) / (times[-1] - times[0])
    volumes = 2e-9 + 5e-8 * share ** draw(st.floats(0.5, 4)) * (1 + 0.1 * rng.standard_normal(n))
    return times, 10.0 ** draw(st.sampled_from([0, -9])) * np.abs(volumes)


def check_curve(fit: QuadraticFit | None, exact: tuple[float, float, float], span: float, size: float) -> None:
    assert fit is not None
    a, b, r_squared = exact
    assert abs(fit.a - a) * span**2 <= 1e-10 * size
    assert abs(fit.b - b) * span <= 1e-10 * size
    assert fit.r_squared == pytest.approx(r_squared, abs=1e-9)


@settings(max_examples=effort_count(quick=16, full=1500))
@given(histories())
def test_running_and_batch_fit_are_the_exact_one(history: tuple[Floats, Floats]) -> None:
    times, values = history
    exact = exact_fit(times, values)
    span, size = float(np.ptp(times)), float(np.abs(values).max())
    check_curve(running_fit(times, values).solve(), exact, span, size)
    check_curve(fit_quadratic(times, values), exact, span, size)


def test_ten_million_seconds_and_a_hundred_thousand_points_lose_nothing() -> None:
    count = effort_count(quick=5_000, full=100_000)
    times = 1.7e9 + np.linspace(0, 1e7, count)
    tau = times - times[0]
    values = 1e-12 + 3e-27 * tau**2 + 2e-21 * tau
    fit = running_fit(times, values).solve()
    assert fit is not None
    assert fit.a == pytest.approx(3e-27, rel=1e-8)
    assert fit.b == pytest.approx(2e-21, rel=1e-8)
    assert fit.r_squared == pytest.approx(1, abs=1e-12)


def test_points_that_all_lie_far_from_the_first_are_fitted_as_well_as_in_batch() -> None:
    """After a long standstill of the tracker tau and tau^2 are all but parallel."""
    times = np.concatenate([[0.0], 1e7 + 300.0 * np.arange(40)])
    values = 1e-9 + 4e-22 * times**2 + 1e-10 * np.sin(np.arange(41))
    values[0] = 1e-9
    a, b, _ = exact_fit(times, values)
    fit = running_fit(times, values).solve()
    assert fit is not None
    assert fit.a == pytest.approx(a, rel=1e-8)
    assert fit.b == pytest.approx(b, rel=1e-8)


def test_the_fit_passes_through_the_first_point() -> None:
    fit = fit_quadratic([100, 400, 700, 1000], [2e-9, 1e-9, 9e-9, 12e-9])
    assert fit is not None
    assert fit.value_at(100) == 2e-9


def test_a_quadratic_history_is_forecast_exactly_from_its_third_point() -> None:
    times = 500 + 300.0 * np.arange(20)
    volumes = (0.002 + 1e-5 * (times - 500) / 60 + 3e-7 * ((times - 500) / 60) ** 2) * MM2
    true = 500 + 60 * (-1e-5 + math.sqrt(1e-10 + 4 * 3e-7 * 0.048)) / 6e-7
    _, issued = run(times, volumes)
    assert [r.status for (r,) in issued[:2]] == [TtStatus.TOO_FEW_POINTS] * 2
    for t, (result,) in zip(times[2:], issued[2:], strict=True):
        assert result.status is TtStatus.OK
        assert result.t_threshold == pytest.approx(true, rel=1e-6)
        assert result.tt == pytest.approx(true - t, rel=1e-6)


def test_the_crossing_is_interpolated_and_latched() -> None:
    times, volumes = [0, 60, 120, 180, 240], [0.01, 0.02, 0.03, 0.07, 0.02]
    state, issued = run(times, [v * MM2 for v in volumes])
    final = fit_quadratic([0, 60, 120, 150], [v * MM2 for v in (0.01, 0.02, 0.03, 0.05)])
    assert final is not None
    for (result,) in issued[3:]:
        assert result.status is TtStatus.ALREADY_CROSSED
        assert result.tt == 0.0
        assert result.t_threshold == pytest.approx(150)
        assert result.coefficients == pytest.approx((final.a, final.b, final.c))
        assert result.r_squared == pytest.approx(final.r_squared)
    assert state.fit is not None
    assert state.fit.points == 5


def test_a_first_point_above_the_threshold_has_crossed_without_a_fit() -> None:
    _, ((result,),) = run([10.0], [2 * THRESHOLD])
    assert result.status is TtStatus.ALREADY_CROSSED
    assert result.t_threshold == 10.0
    assert math.isnan(result.coefficients[0])


def test_a_threshold_asked_for_after_it_was_passed_has_crossed_at_an_unknown_time() -> None:
    state, _ = run([0, 60, 120, 180], [v * MM2 for v in (0.01, 0.02, 0.04, 0.03)])
    state, (result,) = step(state, 240, 0.03 * MM2, thresholds=[0.035 * MM2])
    assert result.status is TtStatus.ALREADY_CROSSED
    assert math.isnan(result.t_threshold)
    assert ForecastState.from_dict(json.loads(json.dumps(state.to_dict()))) == state


@pytest.mark.parametrize(
    ("volumes", "status"),
    [
        ([0.01, 0.01, 0.01, 0.01], TtStatus.NO_CROSSING),
        ([0.01, 0.02, 0.026, 0.028], TtStatus.CONCAVE),
        ([0.04, 0.03, 0.018, 0.003], TtStatus.CONCAVE),
        ([0.01, 0.04, 0.0499, 0.0499], TtStatus.CROSSING_IN_PAST),
        ([0.01, 0.0228, 0.0352, 0.0472], TtStatus.OK),
        ([0.01, 0.02, 0.03, 0.041], TtStatus.OK),
        ([0.01, 0.01, 0.01, 0.0100001], TtStatus.OK),
    ],
)
def test_what_the_curve_does_is_a_status(volumes: list[float], status: TtStatus) -> None:
    _, issued = run([0, 60, 120, 180], [v * MM2 for v in volumes])
    (result,) = issued[-1]
    assert result.status is status
    assert math.isnan(result.tt) == (status is not TtStatus.OK)


def test_a_curve_that_bends_down_but_reaches_the_threshold_is_read_at_its_first_root() -> None:
    _, issued = run([0, 60, 120, 180], [v * MM2 for v in (0.01, 0.0228, 0.0352, 0.0472)])
    (result,) = issued[-1]
    a, b, c = result.coefficients
    assert a < 0
    assert result.t_threshold == pytest.approx(min(np.roots([a, b, c - THRESHOLD])), rel=1e-9)


def test_beyond_the_horizon_the_value_is_given_with_its_status() -> None:
    state = ForecastState()
    result = None
    for t, v in ((0, 0.01), (60, 0.011), (120, 0.012)):
        state, (result,) = step(state, 14_000.0 * t, v * MM2, thresholds=[THRESHOLD])
    assert result is not None
    assert result.status is TtStatus.BEYOND_HORIZON
    assert result.tt == pytest.approx(14_000.0 * (40 * 60 - 120))


def test_blocks_without_a_volume_leave_the_fit_and_let_the_clock_run() -> None:
    state, issued = run([0, 60, 120], [v * MM2 for v in (0.01, 0.02, 0.031)])
    after, (result,) = step(state, 180, math.nan, thresholds=[THRESHOLD])
    assert after == state
    assert result.coefficients == issued[-1][0].coefficients
    assert result.tt == pytest.approx(issued[-1][0].tt - 60)
    _, (late,) = step(state, 1e4, math.nan, thresholds=[THRESHOLD])
    assert late.status is TtStatus.CROSSING_IN_PAST


def test_before_any_point_there_are_too_few() -> None:
    state, (result,) = step(ForecastState(), 0, math.nan, thresholds=[THRESHOLD])
    assert state == ForecastState()
    assert result.status is TtStatus.TOO_FEW_POINTS


def test_outside_the_final_stage_nothing_is_taken_in() -> None:
    state, results = step(ForecastState(), 5, THRESHOLD, thresholds=[THRESHOLD, 1e-7], final_stage=False)
    assert state == ForecastState()
    assert [r.status for r in results] == [TtStatus.NOT_FINAL_STAGE] * 2


def test_repeated_times_alone_determine_nothing() -> None:
    _, issued = run([0, 60, 60, 60], [v * MM2 for v in (0.01, 0.02, 0.03, 0.025)])
    assert issued[-1][0].status is TtStatus.TOO_FEW_POINTS
    assert fit_quadratic([0, 60, 60, 60], [1, 2, 3, 2.5]) is None


@settings(max_examples=effort_count(quick=16, full=800))
@given(
    st.floats(-1e-3, 1e-3),
    st.floats(-1, 1),
    st.floats(0, 10),
    st.floats(1e-3, 10),
)
def test_first_crossing_is_the_smallest_positive_root(a: float, b: float, c: float, gap: float) -> None:
    crossing = QuadraticFit(0.0, a, b, c, 1.0).first_crossing(c + gap)
    gap = (c + gap) - c
    if crossing is None:
        peak = c + gap if a >= 0 else c - b * b / (4 * a) if b > 0 else c
        assert (a >= 0 and b <= 0) or peak <= (c + gap) * (1 + 1e-12)
        return
    assert crossing > 0
    if crossing < 1e100:
        size = abs(a) * crossing**2 + abs(b) * crossing + gap
        assert abs(a * crossing**2 + b * crossing - gap) <= 1e-12 * size
        assert a >= 0 or crossing <= -b / (2 * a) * (1 + 1e-12)


@pytest.mark.parametrize(
    ("t", "v", "thresholds", "message"),
    [
        (-1.0, 1e-9, [1e-8], "t must"),
        (math.nan, 1e-9, [1e-8], "t must"),
        (1.0, -1e-9, [1e-8], "v_eq must"),
        (1.0, math.inf, [1e-8], "v_eq must"),
        (1.0, 1e-9, [], "thresholds must"),
        (1.0, 1e-9, [0.0], "thresholds must"),
    ],
)
def test_impossible_inputs_are_refused(t: float, v: float, thresholds: list[float], message: str) -> None:
    state, _ = run([0.0], [1e-9])
    with pytest.raises(ValueError, match=message):
        step(state, t, v, thresholds=thresholds)


def test_impossible_histories_are_refused() -> None:
    with pytest.raises(ValueError, match="one shape"):
        fit_quadratic([1, 2], [1])
    with pytest.raises(ValueError, match="finite"):
        fit_quadratic([1, 2, 3], [1, math.nan, 2])
    with pytest.raises(ValueError, match="version"):
        ForecastState.from_dict({"version": 0})
