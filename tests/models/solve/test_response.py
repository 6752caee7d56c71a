from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from models.machine.scene import Defect, Scene
from models.solve.response import PASSBAND, Response
from models.solve.simulate import simulate
from models.solve.six_dof.kernels.parts import SUMS
from models.solve.six_dof.kernels.period import PeriodTrace
from models.solve.six_dof.kernels.settled import lines
from models.words.request import Sensor

SCENE = Scene(40.0, 4000.0, defect=Defect(math.radians(20.0), 20e-6))


@cache
def response() -> Response:
    return simulate(SCENE)


def made_of(coefficients: list[complex], bpfo: float = 100.0) -> Response:
    """Return a response with given Fourier coefficients of the casing."""
    c = np.array([coefficients, coefficients], dtype=complex)
    return replace(response(), bpfo=bpfo, coefficients=c)


@given(st.floats(900.0, 5e4), st.floats(0.001, 0.1), st.floats(-7.0, 7.0))
def test_acceleration_is_the_obvious_sum_of_cosines(rate: float, duration: float, phase: float) -> None:
    c = [0.3, 1.0 + 2.0j, -0.5j, 0.25, 1.5 - 1.0j]
    signal = made_of(c).acceleration(rate, duration, phase)
    t = np.arange(round(rate * duration)) / rate
    expected = np.zeros(len(t))
    for k in range(1, 5):
        if 100.0 * k <= PASSBAND * 0.5 * rate:
            expected += 2.0 * np.real(c[k] * np.exp(1j * k * (2.0 * np.pi * 100.0 * t + phase)))
    assert signal == pytest.approx(expected, abs=1e-9)


def test_nothing_above_the_passband_is_left() -> None:
    rate = 2560.0
    signal = response().acceleration(rate, 4.0)
    kept, amplitude = response().lines()
    inside = kept <= PASSBAND * 0.5 * rate
    assert np.sqrt(np.mean(signal**2)) == pytest.approx(math.sqrt(0.5 * np.sum(amplitude[inside] ** 2)), rel=1e-2)
    assert np.all(response().acceleration(100.0, 1.0) == 0.0)


def test_a_full_turn_of_the_phase_is_the_same_signal() -> None:
    one, other = (response().acceleration(25600.0, 0.05, phase) for phase in (0.3, 0.3 + 2.0 * math.pi))
    assert one == pytest.approx(other, abs=1e-8)


def test_the_phase_shifts_the_passages() -> None:
    rate = 400.0 * response().bpfo
    shifted = response().acceleration(rate, 3.0 / response().bpfo, phase=math.pi / 2.0)
    plain = response().acceleration(rate, 4.0 / response().bpfo)
    assert shifted == pytest.approx(plain[100 : 100 + len(shifted)], abs=1e-7)


def test_a_band_keeps_its_lines() -> None:
    signal = response().acceleration(51200.0, 2.0, band=(1000.0, 5000.0))
    assert np.sqrt(np.mean(signal**2)) == pytest.approx(response().rms_in_band(1000.0, 5000.0), rel=1e-3)


@pytest.mark.parametrize("sensor", ["mo", "mr"])
def test_lines_carry_the_power(sensor: Sensor) -> None:
    full = response().levels_of(sensor)[0]
    lines = simulate(SCENE, band=(0.0, 30e3))
    band = lines.rms_in_band(0.0, 30e3, sensor)
    assert band == pytest.approx(full, rel=2e-3)


def test_harmonics_are_the_first_six_lines() -> None:
    assert response().lines()[1][:6] == pytest.approx(response().harmonics)
    assert response().lines()[0][:2] == pytest.approx([response().bpfo, 2.0 * response().bpfo])


def test_there_is_no_steady_acceleration() -> None:
    assert abs(response().coefficients[0, 0]) < 1e-3 * response().rms


@pytest.mark.parametrize("band", [(5.0, 5.0), (-1.0, 5.0), (9.0, 5.0), (math.nan, 5.0)])
def test_bands_that_are_none_are_refused(band: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match="band"):
        response().rms_in_band(*band)
    with pytest.raises(ValueError, match="band"):
        simulate(SCENE, band=band)


def test_a_band_beyond_the_lines_is_refused() -> None:
    with pytest.raises(ValueError, match="computed up to"):
        response().rms_in_band(0.0, 1e5)
    for end in (1e9, math.inf):
        with pytest.raises(ValueError, match="steps resolve up to"):
            simulate(SCENE, band=(0.0, end))
    with pytest.raises(ValueError, match="256 steps resolve up to"):
        simulate(SCENE, band=(0.0, 50e3), steps_per_period=256)


def test_the_end_of_the_band_asks_for_steps() -> None:
    found = simulate(SCENE, band=(0.0, 50e3), accuracy=0.5)
    assert len(found.lines()[0]) * found.bpfo >= 50e3
    fine = simulate(SCENE, band=(0.0, 50e3), steps_per_period=8192)
    assert found.rms == pytest.approx(fine.rms, rel=1e-3)


@pytest.mark.parametrize(("rate", "duration"), [(0.0, 1.0), (1e3, 0.0), (math.nan, 1.0), (1e3, math.inf)])
def test_impossible_rates_are_refused(rate: float, duration: float) -> None:
    with pytest.raises(ValueError, match="must be positive"):
        response().acceleration(rate, duration)


def test_rms_and_peak_in_a_band() -> None:
    limited, full = simulate(SCENE, band=(0.0, 9500.0), steps_per_period=512), simulate(SCENE, steps_per_period=512)
    assert limited.rms == pytest.approx(full.rms_in_band(0.0, 9500.0), rel=1e-9)
    assert limited.rms < full.rms
    signal = limited.acceleration(400e3, 2.0 / limited.bpfo, band=(0.0, 9500.0))
    assert limited.peak == pytest.approx(np.max(np.abs(signal)), rel=5e-3)


def two_segments(duration: float) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """Return times, trapezoid weights and first steps of two segments of different steps."""
    parts = [duration * np.linspace(0.0, 0.37, 900), duration * np.linspace(0.37, 1.0, 1201)]
    weights = []
    for part in parts:
        weight = np.full(len(part), (part[1] - part[0]) / duration)
        weight[[0, -1]] *= 0.5
        weights.append(weight)
    return np.concatenate(parts), np.concatenate(weights), np.array([0, 899, 2099])


def coefficients_of(
    wave: NDArray[np.float64], duration: float, count: int
) -> tuple[NDArray[np.complex128], NDArray[np.float64], NDArray[np.float64]]:
    """Return the kernel's Fourier coefficients, and the times and weights of the values."""
    time, weight, first = two_segments(duration)
    steps = int(first[-1])
    trace = PeriodTrace(
        *(wave, weight, np.zeros((steps, SUMS)), np.zeros(steps, dtype=np.bool_)),
        *(np.zeros(steps, dtype=np.int64), np.zeros(steps, dtype=np.int64)),
    )
    parts = lines(trace, time, first, count, 2)
    return parts[:, 0] + 1j * parts[:, 1], time, weight


def test_fourier_coefficients_on_an_uneven_grid() -> None:
    duration = 0.01
    angle = 2.0 * np.pi * two_segments(duration)[0] / duration
    wave = np.stack((3.0 * np.cos(5.0 * angle + 0.4), 1.0 + np.sin(2.0 * angle)), axis=-1)
    c = coefficients_of(wave, duration, 12)[0]
    assert c.shape == (2, 13)
    assert c[0, 5] == pytest.approx(1.5 * np.exp(0.4j), rel=1e-3)
    assert c[1, 0] == pytest.approx(1.0, rel=1e-3)
    assert c[1, 2] == pytest.approx(-0.5j, rel=1e-3)
    assert np.abs(np.delete(c[0], 5)).max() < 1e-3


def test_lines_by_rotation_are_the_sums_of_exponentials() -> None:
    duration = 0.01
    wave = np.random.default_rng(0).standard_normal((2101, 2))
    c, time, weight = coefficients_of(wave, duration, 200)
    k = np.arange(201)[:, None]
    assert c == pytest.approx(((weight * np.exp(-2j * np.pi * k * time / duration)) @ wave).T, abs=1e-12)
