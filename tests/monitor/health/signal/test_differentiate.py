"""The acceleration of a sensor of velocity, against motions whose derivative is known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.health.signal.differentiate import acceleration_of
from tests.support.effort import effort_count
from tests.support.moving import KnownMotion, chirp, rung, tone

LIMIT = 2000.0
LENGTHS = st.sampled_from([2560, 9973, 25600, 25601, 32768])
"""A power of two, a prime, and what loggers write."""


def errors(motion: KnownMotion, rate: float, limit: float = LIMIT) -> tuple[float, float]:
    """Return the RMS of the error, and the largest beside a few periods of the limit at the ends, over RMS and peak."""
    a = motion.acceleration
    error = acceleration_of(motion.velocity, rate, limit) - a
    ends = math.ceil(20.0 * rate / limit)
    inside = error[ends:-ends]
    return float(np.std(error) / np.std(a)), float(np.max(np.abs(inside)) / np.max(np.abs(a)))


@settings(max_examples=effort_count(quick=30, full=200), deadline=None)
@given(
    n=LENGTHS,
    rate=st.sampled_from([6400.0, 25600.0, 51200.0]),
    hertz=st.floats(12.0, 1800.0),
    phase=st.floats(0.0, 6.28),
)
def test_tones_of_any_length_phase_and_rate_are_differentiated(n: int, rate: float, hertz: float, phase: float) -> None:
    whole, inside = errors(tone(np.arange(n) / rate, hertz, 5e-3, phase), rate)
    # At each end a period of the limit is uncertain.
    assert whole < 0.8 / math.sqrt(LIMIT * n / rate)
    assert inside < 0.02


@pytest.mark.parametrize("n", [25600, 25601, 128000])
def test_chirps_and_a_resonance_that_impacts_excite_are_differentiated(n: int) -> None:
    t = np.arange(n) / 25600.0
    for motion in (chirp(t, 50.0, 1900.0, 1e-3), rung(t, 107.3, 1200.0, 1e-3) + tone(t, 29.3, 5e-3)):
        whole, inside = errors(motion, 25600.0)
        assert whole < 7e-3
        assert inside < 1e-3


def test_a_slow_motion_whose_ends_differ_makes_no_impact_there() -> None:
    """Its jump of 10 mm/s, differentiated as it stands, would be one of 80 m/s2."""
    t = np.arange(25600) / 25600.0
    found = acceleration_of(tone(t, 1.25, 5e-3, 0.0).velocity + tone(t, 0.25, 5e-3, 0.0).velocity, 25600.0, LIMIT)
    assert np.max(np.abs(found)) < 0.06


@settings(max_examples=effort_count(quick=10, full=50), deadline=None)
@given(hertz=st.floats(1.11 * LIMIT, 12000.0))
def test_nothing_is_left_of_what_lies_above_the_limit(hertz: float) -> None:
    t = np.arange(25600) / 25600.0
    motion = tone(t, hertz, 1e-3)
    found = acceleration_of(motion.velocity, 25600.0, LIMIT)[256:-256]
    assert np.std(found) < 1e-3 * np.std(motion.acceleration)


def test_a_limit_above_half_of_the_rate_keeps_all() -> None:
    t = np.arange(25600) / 25600.0
    assert errors(tone(t, 10000.0, 1e-3), 25600.0, 20000.0)[1] < 0.03


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_precision_and_shape_are_kept_and_samples_untouched(dtype: type) -> None:
    t = np.arange(12801) / 25600.0
    velocity = tone(t, 30.0, 5e-3).velocity.astype(dtype)
    before = velocity.copy()
    found = acceleration_of(velocity, 25600.0, LIMIT)
    assert (found.dtype, found.shape) == (velocity.dtype, velocity.shape)
    assert np.array_equal(velocity, before)
    assert found is not acceleration_of(velocity, 25600.0, LIMIT)
    assert np.std(found - tone(t, 30.0, 5e-3).acceleration) < 2e-3 * np.std(found)
