"""Bands, weighting and levels: values of the standards, invariants, and the filters of an analyser as another way."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import butter, sosfilt

from models.gears.sound.levels import (
    POLES,
    Bands,
    a_weighting,
    bands_of_density,
    density_of_record,
    level_db,
    number_of,
    sum_db,
)

RATE = 12_800.0
A_TABLE = (-70.4, -63.4, -56.7, -50.5, -44.7, -39.4, -34.6, -30.2, -26.2, -22.5, -19.1, -16.1, -13.4, -10.9, -8.6, -6.6)
A_TABLE += (-4.8, -3.2, -1.9, -0.8, 0.0, 0.6, 1.0, 1.2, 1.3, 1.2, 1.0, 0.5, -0.1, -1.1, -2.5, -4.3, -6.6, -9.3)
"""IEC 61672-1, table 3: A from 10 Hz to 20 kHz."""


def bands_of_record(record: np.ndarray, bands: Bands, resolution: float, weighting=np.ones_like) -> np.ndarray:
    frequency, density = density_of_record(record, RATE, resolution)
    return bands_of_density(frequency, density * weighting(frequency), bands)


def bands_by_filters(record: np.ndarray, bands: Bands) -> np.ndarray:
    """Mean squares behind Butterworth band passes of order 12 (class 1 of IEC 61260) once they have settled.

    Their corners are moved inwards, so that the effective bandwidth is the band's.
    """
    found: list[float] = []
    for centre, width in zip(bands.centre, bands.upper - bands.lower, strict=True):
        half = 0.5 * width * math.sin(math.pi / 12.0) / (math.pi / 12.0)
        middle = math.hypot(centre, half)
        sections = butter(6, (middle - half, middle + half), "bandpass", fs=RATE, output="sos")
        found.append(float(np.mean(np.asarray(sosfilt(sections, record))[math.ceil(6.0 * RATE / width) :] ** 2)))
    return np.array(found)


def test_bands_of_the_thesis_reach_from_562_34_to_2818_38_hz():
    bands = Bands.between(630.0, 2500.0)
    assert bands.nominal == (630.0, 800.0, 1000.0, 1250.0, 1600.0, 2000.0, 2500.0)
    assert bands.edges[[0, -1]] == pytest.approx([562.34, 2818.38], abs=0.005)


def test_audible_bands_have_their_printed_names():
    nominal = Bands(-17, 13).nominal
    assert nominal[:6] == (20.0, 25.0, 31.5, 40.0, 50.0, 63.0)
    assert nominal[-3:] == (12_500.0, 16_000.0, 20_000.0)


@given(st.integers(-40, 20))
def test_an_edge_belongs_to_the_band_above_it(number):
    band = Bands(number, number)
    assert number_of(float(band.lower[0])) == number
    assert number_of(float(np.nextafter(band.lower[0], 0.0))) == number - 1
    assert number_of(float(band.centre[0])) == number


def test_a_density_keeps_its_integral_and_shares_a_cell_across_an_edge():
    f = np.arange(0.0, 6400.5, 7.0)
    bands = Bands(-8, 7)
    low, high = bands.edges[0], bands.edges[-1]
    found = bands_of_density(f, 1.0 + f, bands)
    assert found.sum() == pytest.approx((high - low) + 0.5 * (high**2 - low**2), rel=1e-4)


def test_a_weighting_is_that_of_the_table_and_exact_at_1_khz():
    assert np.round(10.0 * np.log10(a_weighting(Bands(-20, 13).centre)), 1) == pytest.approx(A_TABLE)
    assert a_weighting(1000.0) == pytest.approx(1.0, abs=1e-13)
    assert pytest.approx((20.598997, 107.65265, 737.86223, 12194.217), rel=1e-7) == POLES
    assert a_weighting(0.0) == 0.0


@pytest.mark.parametrize("number", [-10, 0, 4])
def test_a_tone_has_the_weighted_level_of_the_table(number):
    tone, bands = float(Bands(number, number).centre[0]), Bands(-11, 5)
    record = 20e-6 * math.sqrt(2.0) * 10.0**4.7 * np.sin(2.0 * np.pi * tone * np.arange(int(2 * RATE)) / RATE)
    found = level_db(bands_of_record(record, bands, 1.5, a_weighting))[number + 11]
    assert found == pytest.approx(94.0 + A_TABLE[number + 20], abs=0.06)


def test_levels_of_a_record_are_those_of_a_filter_bank():
    bands, rng = Bands(-6, 5), np.random.default_rng(7)
    spectrum = np.fft.rfft(rng.standard_normal(int(12 * RATE)))
    spectrum[1:] /= np.sqrt(np.arange(1, len(spectrum)))
    record = np.fft.irfft(spectrum)
    record /= np.std(record)
    found = level_db(bands_of_record(record, bands, 0.5))
    assert found == pytest.approx(level_db(bands_by_filters(record, bands)), abs=0.2)


def test_levels_add_up():
    assert sum_db([80.0, 80.0]) == pytest.approx(83.0103, abs=1e-4)
    assert sum_db([]) == -np.inf
    assert level_db(0.0) == -np.inf


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: Bands(3, 2), "last"),
        (lambda: Bands.between(-1.0, 20.0), "low"),
        (lambda: level_db(-1.0), "mean_square"),
        (lambda: level_db(float("nan")), "mean_square"),
        (lambda: bands_of_record(np.zeros(100), Bands(-10, 0), 1.0), "record has .* s, lines at .* need .* s"),
        (lambda: bands_of_record(np.zeros(100_000), Bands(-3, 9), 10.0), "band of 8000 Hz reaches up to 8912"),
    ],
)
def test_what_cannot_be_is_refused_by_name(call, said):
    with pytest.raises(ValueError, match=said):
        call()
