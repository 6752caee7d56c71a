"""Time to the alarm level: its level, its statuses, robustness, state, scale."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import t as student_t

from monitor.health.alarms import AlarmSettings, Level, Rule
from monitor.health.rest import growth
from monitor.health.rest.growth import AHEAD, SHAPES, STOPS, crossing, segments
from monitor.health.rest.learned.history import MAX_BINS, StageHistory
from monitor.health.rest.trend import (
    DEFAULT_FACTOR,
    MIN_BLOCKS,
    TimeToAlarm,
    TrendInput,
    TrendState,
    TtaStatus,
    crossing_of,
    step,
)
from monitor.health.size import RemainingSettings

BASELINE = (math.log(0.5), 0.05)
NO_RULES = AlarmSettings()
LEVELS = AlarmSettings((Rule("rms", "rms", alert=Level(value=1.0), danger=Level(factor=4.0)),))


def ratios(count: int, end: float = 3.0, power: float = 2.0, seed: int = 1) -> list[float]:
    """Return RMS over the baseline of a growth from 1.3 to ``end`` with 3 % of noise."""
    rng, share = np.random.default_rng(seed), np.arange(count) / count
    return np.exp(math.log(1.3) + math.log(end / 1.3) * share**power + 0.03 * rng.standard_normal(count)).tolist()


def blocks(levels: Sequence[float], interval: float = 60.0) -> list[TrendInput]:
    """Return the blocks of a final stage with these levels over the baseline; known from the fifth."""
    return [
        TrendInput(i + 1, interval * i, 0.5 * level, baseline=BASELINE, elevated=True, final=i >= 4)
        for i, level in enumerate(levels)
    ]


def taken(
    given: Sequence[TrendInput], alarms: AlarmSettings = NO_RULES, chosen: RemainingSettings | None = None
) -> tuple[TrendState, TimeToAlarm]:
    """Return the state and the answer after the last of some blocks."""
    state, found = TrendState(), TimeToAlarm(TtaStatus.LEARNING)
    for block in given:
        state, found = step(state, block, alarms, chosen)
    return state, found


@pytest.mark.parametrize("power", [1.0, 2.0, 3.0])
def test_a_steady_growth_is_met_in_time(power: float) -> None:
    levels = ratios(400, end=6.0, power=power)
    reached = next(i for i, level in enumerate(levels) if level >= DEFAULT_FACTOR)
    now = round(0.75 * reached)
    _, found = taken(blocks(levels[:now]))
    left = 60.0 * (reached - now)
    assert found.status is TtaStatus.OK
    assert found.tta_lower < left < found.tta_upper
    assert found.tta == pytest.approx(left, rel=0.5)
    assert found.level == pytest.approx(2.0)
    assert found.source == "default"


def test_the_level_is_the_alert_then_the_danger() -> None:
    levels = [*ratios(40, 1.7), *ratios(60, 2.4)]
    _, early = taken(blocks(levels[:30]), LEVELS)
    assert (early.level, early.source) == (1.0, "alert")
    state, late = taken(blocks([*levels, 2.1, 2.1, 2.1]), LEVELS)
    assert state.alert.active
    assert (late.level, late.source) == (pytest.approx(2.0), "danger")
    _, over = taken(blocks([*levels, 4.2, 4.2, 4.2]), LEVELS)
    assert (over.status, over.tta, over.tta_upper, over.source) == (TtaStatus.REACHED, 0.0, 0.0, "danger")


def test_it_is_reached_as_the_alarm_is_raised_and_left_as_it_is_cleared() -> None:
    levels = ratios(40, 2.0)
    assert taken(blocks([*levels, 4.5, 4.5]))[1].status is not TtaStatus.REACHED
    assert taken(blocks([*levels, 4.5, 4.5, 4.5]))[1].status is TtaStatus.REACHED
    assert taken(blocks([*levels, 4.5, 4.5, 4.5, *[3.9] * 5]))[1].status is TtaStatus.REACHED
    assert taken(blocks([*levels, 4.5, 4.5, 4.5, *[3.0] * 3]))[1].status is not TtaStatus.REACHED


def test_a_level_that_stands_still_has_no_trend() -> None:
    rng = np.random.default_rng(3)
    _, found = taken(blocks((2.0 * np.exp(0.03 * rng.standard_normal(100))).tolist()))
    assert found.status is TtaStatus.NO_TREND
    assert math.isnan(found.tta)
    assert math.isnan(found.tta_upper)
    assert found.p_no_growth > 0.5
    _, growing = taken(blocks(ratios(100)))
    assert growing.status is TtaStatus.OK
    assert growing.p_no_growth < 0.05
    _, falling = taken(blocks(ratios(100)[::-1]))
    assert falling.status is TtaStatus.NO_TREND


def test_each_claim_is_withheld_without_its_grounds() -> None:
    given = blocks(ratios(40))
    assert taken(given)[1].status is TtaStatus.OK
    last = given[-1]
    for status, block in {
        TtaStatus.NOT_FINAL_STAGE: replace(last, final=False),
        TtaStatus.BAD_BLOCK: replace(last, usable=False),
        TtaStatus.EPISODE_CLOSED: replace(last, closed=True),
    }.items():
        found = taken([*given[:-1], block])[1]
        assert found.status is status
        assert math.isnan(found.tta)
        assert math.isnan(found.tta_upper)
    assert taken([replace(block, baseline=None, final=False, elevated=False) for block in given])[1].status is (
        TtaStatus.LEARNING
    )
    assert taken(given[: MIN_BLOCKS - 1])[1].status is TtaStatus.TOO_FEW_POINTS
    assert taken(given[:MIN_BLOCKS])[1].status is not TtaStatus.TOO_FEW_POINTS
    assert taken([replace(block, time=0.0) for block in given])[1].status is TtaStatus.TOO_FEW_POINTS
    assert taken(given, chosen=RemainingSettings(horizon=60.0))[1].status is TtaStatus.BEYOND_HORIZON
    at_speed = AlarmSettings((Rule("rms", "rms", alert=Level(factor=4.0), speed=(20.0, 30.0)),))
    assert taken([*given[:-1], replace(last, speed=35.0)], at_speed)[1].status is TtaStatus.NO_LEVEL
    assert taken([replace(block, speed=25.0) for block in given], at_speed)[1].status is TtaStatus.OK


def test_a_bad_block_and_one_of_other_conditions_leave_the_state() -> None:
    state, _ = taken(blocks(ratios(50)))
    block = blocks(ratios(51))[-1]
    for bad in (replace(block, usable=False), replace(block, rms=math.nan), replace(block, rms=0.0)):
        assert step(state, bad, NO_RULES)[0] == state


def test_a_closed_episode_is_forgotten() -> None:
    state, _ = taken(blocks(ratios(50)))
    closed, _ = step(state, replace(blocks(ratios(51))[-1], closed=True), NO_RULES)
    assert closed.history is None
    again, found = step(closed, replace(blocks(ratios(52))[-1], final=False, elevated=False), NO_RULES)
    assert again.history is None
    assert found.status is TtaStatus.NOT_FINAL_STAGE


@settings(max_examples=12)
@given(st.integers(30, 79), st.floats(0.05, 50.0))
def test_one_spike_does_not_move_it(place: int, height: float) -> None:
    levels = ratios(80)
    _, without = taken(blocks(levels))
    levels[place] *= height
    _, found = taken(blocks(levels))
    assert found.status is TtaStatus.OK
    assert found.tta == pytest.approx(without.tta, rel=0.35)
    assert found.tta_upper == pytest.approx(without.tta_upper, rel=0.5)


@settings(max_examples=8)
@given(st.floats(0.01, 1e4), st.floats(1e-6, 1e6))
def test_unit_and_block_interval_scale_it(interval: float, unit: float) -> None:
    levels = ratios(60)
    _, found = taken(blocks(levels))
    scaled = [
        replace(block, rms=block.rms * unit, baseline=(BASELINE[0] + math.log(unit), BASELINE[1]))
        for block in blocks(levels, interval)
    ]
    _, other = taken(scaled)
    assert other.status is found.status
    assert other.tta / interval == pytest.approx(found.tta / 60.0, rel=1e-6)
    assert other.tta_upper / interval == pytest.approx(found.tta_upper / 60.0, rel=1e-6)
    assert other.level / unit == pytest.approx(found.level)


def test_the_state_is_bounded() -> None:
    state, _ = taken(blocks(ratios(600)))
    assert state.history is not None
    assert len(state.history.bins) < MAX_BINS
    assert len(json.dumps(state.to_dict())) < 6000


def test_times_and_settings_are_checked() -> None:
    state, _ = taken(blocks(ratios(10)))
    with pytest.raises(ValueError, match="time must be finite and may not go back, got 0 after 540"):
        step(state, blocks([1.0])[0], NO_RULES)
    with pytest.raises(ValueError, match="interval must lie between 0 and 1, got 1"):
        RemainingSettings(interval=1.0)
    with pytest.raises(ValueError, match="horizon must be positive, got 0"):
        RemainingSettings(horizon=0.0)


@given(st.lists(st.floats(0.2, 8.0), min_size=MIN_BLOCKS, max_size=100), st.floats(0.5, 10.0))
def test_the_probability_rises_and_is_one(levels: list[float], factor: float) -> None:
    history = StageHistory.begin(0.0)
    for i, level in enumerate(levels):
        history = history.add(float(i), math.log(level))
    found = crossing_of(history, (0.0, 0.05), factor)
    assert np.all(np.diff(found.reached) >= 0.0)
    assert np.all((found.reached >= found.by_trend) & (found.by_trend >= 0.0) & (found.reached <= 1.0))
    assert 0.0 <= found.p_no_growth <= 1.0
    ends = [found.quantile(level) for level in (0.1, 0.5, 0.9)]
    assert 0.0 < ends[0] <= ends[1] <= ends[2]
    # A level further up is not reached sooner.
    assert crossing_of(history, (0.0, 0.05), 1.5 * factor).quantile(0.5) >= ends[1]


def test_the_model_agrees_with_a_slow_one() -> None:
    times, levels = np.array([0.1, 0.3, 0.5, 0.7, 0.9]), np.array([0.3, 0.35, 0.5, 0.6, 0.9])
    many = np.full(5, 10.0)
    found = crossing(times, levels, many, 0.95, 0.4, 0.05)
    u, y = [0.0, *times.tolist(), 1.0], [0.0, *levels.tolist(), 0.95]
    errors = [growth.JUMP**2, *(0.05**2 / 10.0 for _ in times), 0.05**2 / 3.0]
    weights, answers = [], []
    for start, power in (*SHAPES, *((stop, 0.0) for stop in STOPS)):

        def phi(at: float, start: float = start, power: float = power) -> float:
            if power == 0.0:
                return min(at, start)
            return max(at - start, 0.0) ** power / (power * (1.0 - start) ** (power - 1.0))

        known = told = squares = 0.0
        for i in range(6):
            v = u[i + 1] - u[i] + (errors[i] + errors[i + 1]) / growth.WALK**2
            x, d = phi(u[i + 1]) - phi(u[i]), y[i + 1] - y[i]
            known, told, squares = known + x * x / v, told + x * d / v, squares + d * d / v
        freedom = growth.FREEDOM + 6
        squares += growth.FREEDOM * growth.WALK**2
        certainty = (squares - told**2 / known) / freedom / growth.RATE_SD**2
        rate = (certainty * growth.RATE + told) / (certainty + known)
        spread = (squares + certainty * growth.RATE**2 - (certainty + known) * rate**2) / freedom
        weights.append(math.sqrt(certainty / (certainty + known)) * spread ** (-0.5 * freedom))
        grown = np.array([phi(1.0 + ahead) - phi(1.0) for ahead in AHEAD])
        sd = np.sqrt(
            spread * (grown**2 / (certainty + known) + AHEAD * growth.WALK_AHEAD + errors[-1] / growth.WALK**2)
        )
        answers.append(student_t.cdf((rate * grown - 0.4) / sd, freedom))
    slow = np.maximum.accumulate(np.array(weights) / sum(weights) @ np.array(answers))
    assert found.by_trend == pytest.approx(slow, abs=0.005)


def test_segments_keep_the_mean_and_are_finer_towards_now() -> None:
    times, levels = np.linspace(0.01, 1.0, 60), np.arange(60.0)
    at, level, many = segments(times, levels, np.ones(60))
    assert many.sum() == 60
    assert many @ level == pytest.approx(levels.sum())
    assert many @ at == pytest.approx(times.sum())
    assert many[-1] < many[0]
    assert len(segments(times[:1], levels[:1], np.ones(1))[0]) == 1
