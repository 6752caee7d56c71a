from __future__ import annotations

from dataclasses import asdict

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.health.signal.indicators import TimeIndicators, time_indicators
from reference import features as oracle
from tests.support.effort import effort_count

CASES = effort_count(quick=15, full=300)
RATIOS = ("kurtosis", "skewness", "crest_factor", "shape_factor", "impulse_factor", "clearance_factor")
LEVELS = ("mean", "rms", "peak", "peak_half_range")


@given(
    n=st.integers(2, 40_000),
    kind=st.sampled_from(["float32", "float64"]),
    offset=st.floats(-10.0, 10.0),
    power=st.integers(1, 3),
    seed=st.integers(0, 1000),
)
@settings(max_examples=CASES)
def test_indicators_are_those_of_exact_sums(n: int, kind: str, offset: float, power: int, seed: int) -> None:
    x = (np.random.default_rng(seed).standard_normal(n) ** power + offset).astype(kind)
    found, expected = asdict(time_indicators(x)), oracle.indicators(x)
    tolerance = 2e-5 if kind == "float32" else 1e-9
    for name, value in expected.items():
        # Two samples have a skewness of exactly 0; with so few, float32 rounds what is left.
        assert found[name] == pytest.approx(value, rel=tolerance, abs=tolerance * max(1.0, abs(offset))), name


@given(st.integers(-90, 90), st.sampled_from(["float32", "float64"]))
@settings(max_examples=CASES)
def test_ratios_know_no_scale(exponent: int, kind: str) -> None:
    x = np.random.default_rng(1).standard_normal(1000).astype(kind)
    plain, scaled = asdict(time_indicators(x)), asdict(time_indicators(x * np.asarray(2.0**exponent, kind)))
    for name in RATIOS:
        assert scaled[name] == plain[name], name
    for name in LEVELS:
        assert scaled[name] == plain[name] * 2.0**exponent, name


@pytest.mark.parametrize("kind", ["int16", "int32", "uint8"])
def test_whole_numbers_are_taken(kind: str) -> None:
    x = np.random.default_rng(1).integers(0, 100, 5000).astype(kind)
    found, expected = asdict(time_indicators(x)), oracle.indicators(x.astype(float))
    for name, value in expected.items():
        assert found[name] == pytest.approx(value, rel=1e-9), name


def test_known_values() -> None:
    t = np.arange(100_000) / 1000.0
    sine = time_indicators(3.0 * np.sin(2.0 * np.pi * t))
    assert sine.rms == pytest.approx(3.0 / np.sqrt(2.0))
    assert sine.kurtosis == pytest.approx(1.5)
    assert sine.crest_factor == pytest.approx(np.sqrt(2.0))
    assert sine.shape_factor == pytest.approx(np.pi / np.sqrt(8.0), rel=1e-5)
    lopsided = time_indicators(np.array([-1.0, 3.0, 0.0, 0.0]))
    assert (lopsided.peak, lopsided.peak_half_range, lopsided.mean) == (3.0, 2.0, 0.5)
    assert not lopsided.flat


@pytest.mark.parametrize("value", [0.0, 5.0, -0.1, 1e-35])
def test_a_flat_block_has_zeros_and_says_so(value: float) -> None:
    found = time_indicators(np.full(100, value))
    assert found == TimeIndicators(value, 0.0, abs(value), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, flat=True)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -2e30])
def test_samples_that_are_no_numbers_are_refused(bad: float) -> None:
    with pytest.raises(ValueError, match="samples must be finite"):
        time_indicators(np.array([1.0, bad, 2.0]))


@pytest.mark.parametrize("shape", [(0,), (2, 3)])
def test_another_shape_is_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="shape"):
        time_indicators(np.zeros(shape))
