from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.health.signal.velocity import velocity_of
from tests.support.effort import effort_count
from tests.support.pipeline import base, life, record_of, run
from tests.support.velocity_signals import SECONDS, coloured, signals, tone, velocity


@pytest.mark.parametrize("seconds", SECONDS)
def test_analytic_signals_are_read_to_half_a_percent(seconds: float) -> None:
    for name, x, true in signals(seconds):
        found = velocity(x)
        assert found.status == "ok"
        if name.startswith("edge: tone of 10 Hz +") or not name.startswith("edge"):
            assert found.rms == pytest.approx(true, rel=5e-3), name
        else:
            # A line on an edge is counted in part.
            assert found.rms == pytest.approx(0.91 * true, rel=0.02), name


@given(
    st.floats(12.0, 990.0),
    st.floats(1e-5, 1e-1),
    st.floats(0.0, 2.0 * math.pi),
    st.floats(-1e3, 1e3),
    st.floats(1.0, 3.0),
)
@settings(max_examples=effort_count(quick=15, full=500), deadline=None)
def test_a_tone_anywhere_is_read_whatever_its_phase_and_offset(
    hertz: float, rms: float, phase: float, offset: float, seconds: float
) -> None:
    assert velocity(tone(seconds, hertz, rms, phase) + offset * rms).rms == pytest.approx(rms, rel=6e-3)


@pytest.mark.parametrize("exponent", [-60, 0, 60])
def test_very_large_and_small_samples_scale(exponent: int) -> None:
    scale = 2.0**exponent
    assert velocity(tone(1.0, 40.0, 1e-3) * scale).rms == pytest.approx(1e-3 * scale, rel=5e-3)


def test_the_continuous_part_is_that_of_the_noise() -> None:
    expected = math.sqrt(1e-4 * (1 / 10.0 - 1 / 1000.0)) / (2.0 * math.pi)
    noise = velocity(coloured(5.0, 0.0, 1))
    assert noise.floor == pytest.approx(expected, rel=0.25)
    beside = velocity(coloured(5.0, 0.0, 1) + tone(5.0, 25.0, 4e-3))
    assert beside.floor == pytest.approx(expected, rel=0.25)
    assert beside.rms == pytest.approx(math.hypot(4e-3, expected), rel=0.02)


def test_noise_that_rises_towards_low_frequencies_is_refused() -> None:
    step = np.where(np.arange(128_000) < 50_000, 0.0, 5.0)
    for x in (coloured(5.0, 2.0, 1), coloured(5.0, 1.0, 1), coloured(5.0, 0.0, 1) + step):
        found = velocity(x)
        assert (found.status, found.rms, found.floor) == ("low_frequency_noise", None, None)
    # The same beside vibration that is larger.
    assert velocity(coloured(5.0, 1.0, 1) + tone(5.0, 25.0, 4e-3)).status == "ok"


@pytest.mark.parametrize(("samples", "rate", "status"), [(25_599, 25_600.0, "short"), (10_000, 2500.0, "low_rate")])
def test_blocks_that_hold_too_little_are_refused(samples: int, rate: float, status: str) -> None:
    spectrum = np.ones(samples // 2 + 1, dtype=np.complex64)
    found = velocity_of(spectrum, samples, rate)
    assert (found.status, found.rms) == (status, None)


def test_without_the_unit_of_the_sensor_there_is_no_velocity() -> None:
    for absolute in (True, False):
        state, outputs = run(life(1), base(unit="g" if absolute else "unknown"))
        values = record_of(0, state, outputs[0]).channels["one"]
        assert (values["velocity_rms"] is not None) == (absolute and values["velocity_status"] == "ok")
        assert values["velocity_status"] == ("short" if absolute else "no_absolute_level")
