from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from monitor.health.signal.comb import line_spectrum
from monitor.health.signal.lines import fault_lines, noise_threshold
from reference import features as oracle
from tests.support.effort import effort_count

CASES = effort_count(quick=25, full=500)


def comb(n: int, f: float, amplitudes: tuple[float, ...], noise: float = 0.0, seed: int = 0) -> NDArray[np.float64]:
    """Spectrum of ``n`` samples with lines at multiples of ``f`` cycles in all, at random phases, and white noise."""
    rng = np.random.default_rng(seed)
    t = np.arange(n) / n
    x = noise * rng.standard_normal(n)
    for k, a in enumerate(amplitudes):
        x += a * np.cos(2.0 * np.pi * ((k + 1) * f * t + rng.uniform()))
    return oracle.hann_spectrum(x)


def average_spectra(amplitudes: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Root of the mean power of several spectra."""
    return np.sqrt(np.mean(np.square(amplitudes), axis=0))


@given(f=st.floats(9.0, 190.0), off=st.floats(-0.019, 0.019), seed=st.integers(0, 1000))
@settings(max_examples=CASES)
def test_amplitudes_are_right_wherever_the_lines_stand(f: float, off: float, seed: int) -> None:
    depths = (1.0, 0.7, 0.5, 0.8, 0.3)
    lines = fault_lines(line_spectrum(comb(2048, f * (1.0 + off), depths, seed=seed), 0.2), 0.2 * f)
    # Below twenty bins the skirts of neighbouring lines reach into each other's five bins.
    np.testing.assert_allclose(lines.amplitude, depths, rtol=0.04 if f > 20.0 else 0.10)
    assert lines.total == pytest.approx(sum(depths), rel=0.02)
    assert lines.resolved.all()
    assert lines.detected
    # A fifth of a bin at the fifth line.
    assert lines.speed_factor == pytest.approx(1.0 + off, abs=0.25 / (5.0 * f))


@given(f=st.floats(30.0, 190.0), off=st.floats(-0.019, 0.019), h=st.integers(1, 5), seed=st.integers(0, 1000))
@settings(max_examples=CASES)
def test_a_single_line_is_right_too(f: float, off: float, h: int, seed: int) -> None:
    amplitudes = tuple(2.5 * (k == h) for k in range(1, 6))
    lines = fault_lines(line_spectrum(comb(2048, f * (1.0 + off), amplitudes, seed=seed), 1.0), f)
    assert lines.amplitude[h - 1] == pytest.approx(2.5, rel=0.04)


@given(f=st.floats(20.0, 190.0), off=st.floats(-0.018, 0.018), seed=st.integers(0, 1000))
@settings(max_examples=max(5, CASES // 5))
def test_the_search_finds_what_a_very_fine_grid_finds(f: float, off: float, seed: int) -> None:
    spectrum = comb(2048, f * (1.0 + off), (1.0, 0.7, 0.5, 0.8, 0.3), noise=0.3, seed=seed)
    found = fault_lines(line_spectrum(spectrum, 1.0), f).speed_factor
    # The oracle sums whole bins and so knows the place of the highest line to a bin or so.
    assert found == pytest.approx(oracle.best_factor(spectrum, 1.0, f, 0.02), abs=1.0 / (5.0 * f))
    assert found == pytest.approx(1.0 + off, abs=0.3 / (5.0 * f))


@given(st.floats(1e-12, 1e12))
@settings(max_examples=CASES)
def test_amplitudes_scale_and_snr_does_not(factor: float) -> None:
    spectrum = comb(2048, 57.3, (1.0, 0.7, 0.5), noise=0.5)
    plain, scaled = (
        fault_lines(line_spectrum(spectrum, 1.0), 57.0),
        fault_lines(line_spectrum(factor * spectrum, 1.0), 57.0),
    )
    np.testing.assert_allclose(scaled.amplitude, factor * plain.amplitude, rtol=1e-6)
    np.testing.assert_allclose(scaled.floor, factor * plain.floor, rtol=1e-6)
    np.testing.assert_allclose(scaled.snr, plain.snr, rtol=1e-6)
    assert scaled.speed_factor == plain.speed_factor


def test_the_floor_is_what_noise_reads_and_its_snr_is_about_one() -> None:
    n, count = 4096, effort_count(quick=150, full=2000)
    runs = [
        fault_lines(line_spectrum(comb(n, 1.0, (), 1.0, seed), 1.0), 97.8, speed_factor=1.0) for seed in range(count)
    ]
    # White noise of unit variance has 4/n of power in each bin, times 1.5 for the window; five bins over 1.5.
    expected = math.sqrt(5.0 * 4.0 / n)
    assert np.median([r.floor for r in runs]) == pytest.approx(expected, rel=0.02)
    assert np.sqrt(np.mean(np.square([r.snr for r in runs]))) == pytest.approx(1.0, abs=0.05)


def test_a_strong_line_leaves_the_floor_alone() -> None:
    quiet = fault_lines(line_spectrum(comb(4096, 97.8, (), 1.0), 1.0, speed=100.0), 97.8, speed_factor=1.0)
    loud = fault_lines(
        line_spectrum(comb(4096, 97.8, (9.0, 9.0, 9.0, 9.0, 9.0), 1.0), 1.0, speed=100.0), 97.8, speed_factor=1.0
    )
    np.testing.assert_allclose(loud.floor, quiet.floor, rtol=0.15)
    np.testing.assert_allclose(loud.snr, loud.amplitude / loud.floor, rtol=1e-12)


@pytest.mark.parametrize(
    ("n", "spacing", "n_averages"), [(8000, 500.0, 1), (4000, 97.8, 1), (500, 15.4, 1), (500, 15.4, 8), (256, 6.3, 1)]
)
def test_noise_is_detected_as_rarely_as_stated(n: int, spacing: float, n_averages: int) -> None:
    rate, count = 0.01, effort_count(quick=300, full=4000)
    alarms = 0
    for seed in range(count):
        spectra = [comb(n, 1.0, (), 1.0, 1_000_003 * j + seed) for j in range(n_averages)]
        lines = fault_lines(
            line_spectrum(average_spectra(spectra), 1.0, n_averages=n_averages), spacing, false_alarm=rate
        )
        alarms += lines.detected
    # Four standard deviations above a rate of 1 %.
    assert alarms <= rate * count + 4.0 * math.sqrt(rate * count)


def test_averaging_finds_lines_that_one_record_hides() -> None:
    spectra = [comb(500, 15.4, (0.22, 0.18, 0.15), 1.0, seed) for seed in range(32)]
    single = fault_lines(line_spectrum(spectra[0], 10.0), 154.0)
    together = fault_lines(line_spectrum(average_spectra(spectra), 10.0, n_averages=32), 154.0)
    assert not single.detected
    assert together.detected
    assert together.threshold < single.threshold


def test_what_the_spectrum_cannot_show_is_not_resolved() -> None:
    spectrum = comb(400, 30.0, (1.0, 1.0, 1.0, 1.0, 1.0), 0.01)
    cut = fault_lines(line_spectrum(spectrum[:100], 1.0), 30.0)
    np.testing.assert_array_equal(cut.resolved, [True, True, True, False, False])
    np.testing.assert_allclose(cut.amplitude, [1.0, 1.0, 1.0, 0.0, 0.0], rtol=0.04)
    assert not cut.floor[3:].any()
    assert not cut.snr[3:].any()
    assert cut.detected
    for fundamental in (3.9, 250.0):
        none = fault_lines(line_spectrum(spectrum, 1.0), fundamental)
        assert not none.resolved.any()
        assert not none.detected
        assert none.total == none.score == 0.0
        assert none.speed_factor == 1.0


@pytest.mark.parametrize("spacing", [4.3, 5.0, 6.7, 8.0, 9.1])
def test_close_harmonics_are_measured_with_fewer_bins(spacing: float) -> None:
    lines = fault_lines(line_spectrum(comb(512, spacing, (1.0, 1.0, 1.0, 1.0, 1.0), 1e-3), 1.0), spacing)
    assert lines.resolved.all()
    # Neighbours four bins away leak: a tenth is what is left of the 4 %.
    np.testing.assert_allclose(lines.amplitude, 1.0, rtol=0.10)


def test_a_line_outside_the_range_is_at_the_edge_at_most() -> None:
    spectrum = comb(4096, 100.0 * 1.0225, (1.0, 1.0, 1.0, 1.0, 1.0), 0.01)
    assert fault_lines(line_spectrum(spectrum, 1.0), 100.0).at_edge
    assert not fault_lines(line_spectrum(spectrum, 1.0), 101.0).at_edge


def test_a_given_factor_is_taken_without_a_search() -> None:
    spectrum = comb(4096, 101.0, (1.0, 1.0, 1.0, 1.0, 1.0), 0.01)
    given_factor = fault_lines(line_spectrum(spectrum, 1.0), 100.0, speed_factor=1.01)
    assert given_factor.speed_factor == 1.01
    np.testing.assert_allclose(given_factor.amplitude, 1.0, rtol=0.04)
    assert given_factor.threshold < fault_lines(line_spectrum(spectrum, 1.0), 100.0).threshold


@pytest.mark.parametrize("value", [0.0, 1.0])
def test_flat_spectra_are_not_detected(value: float) -> None:
    lines = fault_lines(line_spectrum(np.full(2000, value), 1.0), 97.8)
    assert not lines.detected
    assert np.isfinite(lines.snr).all()


def test_the_threshold_falls_with_averages_and_rises_with_trials() -> None:
    base = noise_threshold(5, 2, 1, 200.0, 20.0, 1e-4)
    assert noise_threshold(5, 2, 10, 200.0, 20.0, 1e-4) < base
    assert noise_threshold(5, 2, 1, 200.0, 40.0, 1e-4) > base
    assert noise_threshold(5, 2, 1, 20.0, 20.0, 1e-4) > base
    assert noise_threshold(5, 2, 1, 200.0, 20.0, 1e-3) < base


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"fundamental": -1.0}, "fundamental"),
        ({"fundamental": math.nan}, "fundamental"),
        ({"n_harmonics": 0}, "n_harmonics"),
        ({"search": 0.5}, "search"),
        ({"false_alarm": 0.0}, "false_alarm"),
        ({"speed_factor": 2.0}, "speed_factor"),
    ],
)
def test_wrong_arguments_are_refused_by_name(change: dict[str, Any], message: str) -> None:
    spectrum = line_spectrum(np.ones(500), 1.0)
    with pytest.raises(ValueError, match=message):
        fault_lines(spectrum, change.pop("fundamental", 30.0), **change)


@pytest.mark.parametrize(
    ("amplitude", "resolution", "n_averages", "message"),
    [
        (np.ones(500), 0.0, 1, "resolution"),
        (np.ones(500), 1.0, 0, "n_averages"),
        (np.zeros((2, 2)), 1.0, 1, "shape"),
    ],
)
def test_impossible_spectra_are_refused(
    amplitude: NDArray[np.float64], resolution: float, n_averages: int, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        line_spectrum(amplitude, resolution, n_averages=n_averages)
