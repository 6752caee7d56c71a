"""Verdicts: what is rejected, what is kept with a flag, and what each flag keeps out of."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.health.signal.quality import (
    OrderState,
    SpeedLimits,
    Verdict,
    check_order,
    check_rate,
    check_samples,
    check_speed,
    rejected,
    with_flags,
)
from streams.dates.observed import TimeObservation
from tests.support.effort import effort_count

RNG = np.random.default_rng(0)
NOISE = RNG.standard_normal(12800).astype(np.float32)


def sine(n=12800, amplitude=10.0):
    return (amplitude * np.sin(0.05 * np.arange(n)) + 0.1 * RNG.standard_normal(n)).astype(np.float32)


@pytest.mark.parametrize(
    ("samples", "status"),
    [
        (np.empty(0, np.float32), "empty"),
        (NOISE[:8000], "short"),
        (np.where(np.arange(12800) == 77, np.nan, NOISE), "nan"),
        (np.where(np.arange(12800) == 77, -np.inf, NOISE), "nan"),
        (np.where(np.arange(12800) == 77, 1e12, NOISE), "out_of_range"),
        (np.full(12800, 3.0, np.float32), "flat"),
        (np.zeros(12800, np.float32), "flat"),
        (np.where(np.arange(12800) > 9000, 0.25, NOISE), "flat"),
        (NOISE * 1e-3, "stopped"),
        (np.clip(sine(), -8, 8), "clipped"),
        (sine(), "ok"),
        (NOISE, "ok"),
    ],
)
def test_verdict(samples, status):
    assert check_samples(samples, expected=12800).status == status


def test_known_range_clips_and_refuses():
    assert check_samples(np.clip(20 * NOISE, -50, 50), signal_range=50.0).status == "clipped"
    assert check_samples(20 * NOISE, signal_range=50.0).status == "out_of_range"
    assert check_samples(NOISE, signal_range=50.0).status == "ok"


def test_a_coarsely_quantised_small_signal_is_not_clipped():
    assert check_samples(np.round(NOISE * 1.5) / 1.5, absolute=True).status == "ok"


def test_stopped_is_relative_once_a_baseline_is_there():
    assert check_samples(0.02 * NOISE, reference_rms=1.0, absolute=False).status == "stopped"
    assert check_samples(0.2 * NOISE, reference_rms=1.0, absolute=False).status == "ok"
    assert check_samples(1e-4 * NOISE, absolute=False).status == "ok"


def test_flags_gate_what_comes_after():
    ok, stopped, clipped = (check_samples(x) for x in (NOISE, 1e-3 * NOISE, np.clip(sine(), -8, 8)))
    assert ok.for_tracker
    assert not stopped.for_baseline
    assert clipped.for_baseline
    assert not clipped.for_tracker
    late = with_flags(ok, ("late",))
    assert late.accepted
    assert not late.for_baseline
    assert with_flags(ok, ("gap",)).for_tracker


@pytest.mark.parametrize(
    ("speed", "acceleration", "outside"),
    [
        ((20.0, 30.0), 1.0, False),
        ((20.0, 30.0), None, False),
        ((19.9, 30.0), 0.0, True),
        ((20.0, 30.1), 0.0, True),
        ((25.0, 25.0), -2.1, True),
        (None, None, True),
    ],
)
def test_a_block_beyond_the_speeds_is_flagged(speed, acceleration, outside):
    limits = SpeedLimits(20.0, 30.0, 2.0)
    flags = check_speed(speed, acceleration, limits)
    assert flags == (("outside_speed",) if outside else ())
    assert check_speed(speed, acceleration, SpeedLimits()) == ()
    verdict = with_flags(Verdict(), flags)
    assert verdict.accepted
    assert verdict.for_baseline is verdict.for_tracker is not outside


def test_a_rejected_channel_takes_no_flags():
    verdict = rejected("nan", "why")
    assert with_flags(verdict, ("gap",)) is verdict
    with pytest.raises(ValueError, match="unknown rejection"):
        rejected("gap", "")


@pytest.mark.parametrize("rate", [0.0, -1.0, float("nan"), float("inf"), 25500.0])
def test_rate(rate):
    assert check_rate(rate, 25600.0).status == "wrong_rate"
    assert check_rate(25600.01, 25600.0).accepted


def orders(items, dated=False):
    state, flags = OrderState(), []
    for sequence, time in items:
        state, found, _ = check_order(state, sequence, TimeObservation(time, dated=dated))
        flags.append(found)
    return flags


def test_order_flags():
    assert orders([(1, 0.0), (2, 10.0), (3, 20.0)]) == [(), (), ()]
    assert orders([(1, 0.0), (2, 10.0), (4, 30.0)])[-1] == ("gap",)
    assert orders([(1, 0.0), (2, 10.0), (3, 60.0)])[-1] == ("gap",)
    assert orders([(1, 0.0), (2, 10.0), (3, 5.0)])[-1] == ("clock",)
    assert orders([(1, 0.0), (3, 10.0), (2, 5.0)])[-1] == ("late",)
    assert orders([(1, 1e9), (2, 12.0)], dated=True)[-1] == ("clock",)


def test_a_clock_from_the_future_is_flagged_live():
    state, *_ = check_order(OrderState(), 1, TimeObservation(1e9), now=1e9)
    assert check_order(state, 2, TimeObservation(2e9), now=1e9 + 5)[1] == ("clock",)


def test_order_state_survives_json():
    state, *_ = check_order(OrderState(), 1, TimeObservation(0.1, dated=False))
    assert OrderState.from_dict(state.to_dict()) == state
    with pytest.raises(ValueError, match="order state: version 2 expected, got 9"):
        OrderState.from_dict({**state.to_dict(), "version": 9})


def test_a_state_of_version_1_is_read():
    state = OrderState.from_dict({"version": 1, "sequence": 3, "time": 1e9, "interval": 10.0})
    assert (state.version, state.sequence, state.clock.time, state.clock.interval) == (2, 3, 1e9, 10.0)
    assert check_order(state, 4, TimeObservation(1e9 + 10.0))[1] == ()
    assert check_order(state, 4, TimeObservation(1e9 + 26.0))[1] == ("gap",)


@settings(max_examples=effort_count(quick=20, full=50))
@given(st.lists(st.floats(-1e4, 1e4, width=32), min_size=1, max_size=300), st.booleans())
def test_every_block_gets_a_verdict_without_warnings(values, absolute):
    verdict = check_samples(np.asarray(values, np.float32), absolute=absolute)
    assert verdict.status
    assert verdict.accepted or verdict.reason
