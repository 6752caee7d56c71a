"""Bands, weighting and levels: values of the standards, invariants, and two independent ways to a band's level."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.gears.sound.filter_bank import SETTLING, bands_by_filters, filter_record
from models.gears.sound.levels import (
    AUDIBLE,
    POLES,
    Bands,
    bands_of_density,
    bands_of_lines,
    bands_of_record,
    level_db,
    line_mean_squares,
    mean_square_of,
    number_of,
    power_gain,
    sum_db,
    weigh_record,
    weighting_db,
)
from tests.support.levels import A_TABLE

RATE = 12_800.0
A_TABLE += (-4.8, -3.2, -1.9, -0.8, 0.0, 0.6, 1.0, 1.2, 1.3, 1.2, 1.0, 0.5, -0.1, -1.1, -2.5, -4.3, -6.6, -9.3)
"""IEC 61672-1, table 3: A from 10 Hz to 20 kHz."""
CLASS_1 = {0.0: (-0.3, 0.3), 0.125: (-0.3, 0.4), 0.25: (-0.3, 0.6), 0.375: (-0.3, 1.3), 0.5: (2.0, 5.0)}
CLASS_1 |= {1.0: (17.5, np.inf), 2.0: (42.0, np.inf), 3.0: (61.0, np.inf), 4.0: (70.0, np.inf)}
"""Attenuation in dB at powers of G, octave bands of class 1 (IEC 61260:1995, table 1)."""


def third_octave_place(power: float) -> float:
    """The frequency by the centre at which a third octave has the limits of an octave at G^power (its clause 4.4.2)."""
    g = 10.0**0.3
    return 1.0 + (g ** (1.0 / 6.0) - 1.0) / (g**0.5 - 1.0) * (g**power - 1.0)


def test_bands_of_the_thesis_reach_from_562_34_to_2818_38_hz():
    bands = Bands.between(630.0, 2500.0)
    assert bands.nominal == (630.0, 800.0, 1000.0, 1250.0, 1600.0, 2000.0, 2500.0)
    assert bands.edges[[0, -1]] == pytest.approx([562.34, 2818.38], abs=0.005)


def test_audible_bands_have_their_printed_names():
    assert AUDIBLE.nominal[:6] == (20.0, 25.0, 31.5, 40.0, 50.0, 63.0)
    assert AUDIBLE.nominal[-3:] == (12_500.0, 16_000.0, 20_000.0)


@given(st.integers(-40, 20))
def test_an_edge_belongs_to_the_band_above_it(number):
    band = Bands(number, number)
    assert number_of(float(band.lower[0])) == number
    assert number_of(float(np.nextafter(band.lower[0], 0.0))) == number - 1
    assert number_of(float(band.centre[0])) == number


@given(st.lists(st.floats(30.0, 10_000.0), min_size=1, max_size=20))
def test_lines_are_counted_once_each(frequency):
    found = bands_of_lines(frequency, np.ones(len(frequency)), AUDIBLE)
    assert found.sum() == len(frequency)


def test_a_density_keeps_its_integral_and_shares_a_cell_across_an_edge():
    f = np.arange(0.0, 6400.5, 7.0)
    density = 1.0 + f
    bands = Bands(-8, 7)
    found = bands_of_density(f, density, bands)
    low, high = bands.edges[0], bands.edges[-1]
    assert found.sum() == pytest.approx((high - low) + 0.5 * (high**2 - low**2), rel=1e-4)


def test_a_weighting_is_that_of_the_table_and_exact_at_1_khz():
    assert np.round(weighting_db(Bands(-20, 13).centre), 1) == pytest.approx(A_TABLE)
    assert weighting_db(1000.0) == pytest.approx(0.0, abs=1e-12)
    assert pytest.approx((20.598997, 107.65265, 737.86223, 12194.217), rel=1e-7) == POLES
    assert weighting_db(0.0) == -np.inf
    assert weighting_db([10.0**1.5, 10.0**3.9], "C") == pytest.approx([-3.0103, -3.0103], abs=2e-3)
    assert weighting_db(31.5, "Z") == 0.0


@pytest.mark.parametrize("number", [-10, 0, 4])
def test_a_tone_has_the_weighted_level_of_the_table_by_each_way(number):
    tone, bands = float(Bands(number, number).centre[0]), Bands(-11, 5)
    wanted = 94.0 + A_TABLE[number + 20]
    time = np.arange(int(2 * RATE)) / RATE
    record = np.sqrt(2.0 * mean_square_of(94.0)) * np.sin(2.0 * np.pi * tone * time)
    by_fft = level_db(bands_of_record(record, RATE, bands, weighting="A"))[number + 11]
    behind = level_db(np.mean(weigh_record(record, RATE)[int(RATE) :] ** 2))
    by_line = level_db(line_mean_squares(record.max()) * 10 ** (0.1 * weighting_db(tone)))
    assert [by_fft, behind, by_line] == pytest.approx([wanted] * 3, abs=0.05 + 1e-2)
    assert by_line == pytest.approx(94.0 + weighting_db(tone), abs=0.01)
    assert behind == pytest.approx(94.0 + weighting_db(tone), abs=0.01)


@pytest.mark.parametrize("shape", ["ideal", "filter"])
def test_levels_of_a_record_are_those_of_the_filter_bank(shape):
    bands, rng = Bands(-6, 5), np.random.default_rng(7)
    spectrum = np.fft.rfft(rng.standard_normal(int(12 * RATE)))
    spectrum[1:] /= np.sqrt(np.arange(1, len(spectrum)))
    record = np.fft.irfft(spectrum)
    time = np.arange(len(record)) / RATE
    record /= np.std(record)
    if shape == "filter":
        record += sum(np.sin(2.0 * np.pi * f * time) for f in 312.28 * np.arange(1, 5))
    by_fft = level_db(bands_of_record(record, RATE, bands, shape=shape))
    assert by_fft == pytest.approx(level_db(bands_by_filters(record, RATE, bands)), abs=0.2)


def test_a_tone_at_an_edge_is_shared_as_the_filters_do():
    bands, time = Bands(-4, 4), np.arange(int(8 * RATE)) / RATE
    record = np.sin(2.0 * np.pi * 1122.0 * time)
    by_filters = level_db(bands_by_filters(record, RATE, bands))
    shared = level_db(bands_of_record(record, RATE, bands, shape="filter"))
    assert shared[4:6] == pytest.approx(by_filters[4:6], abs=0.02)
    one_band = level_db(bands_of_lines([1122.0], [0.5], bands))
    assert one_band[4] - by_filters[4] > 2.5


def test_the_filters_keep_to_class_1_and_to_the_effective_bandwidth():
    bands, rate = Bands(0, 0), 51_200.0
    impulse = np.zeros(1 << 16)
    impulse[0] = 1.0
    digital = np.abs(np.fft.rfft(filter_record(impulse, rate, bands)[0])) ** 2
    f = np.fft.rfftfreq(len(impulse), 1.0 / rate)
    for power, (least, most) in CLASS_1.items():
        for place in (third_octave_place(power), 1.0 / third_octave_place(power)):
            edge = 1e-9 if power == 0.5 else 0.0
            analogue = power_gain(bands, 1000.0 * place, "filter")[0, 0]
            gains = analogue, np.interp(1000.0 * place, f, digital)
            assert all(least - edge <= -10.0 * np.log10(gain) <= most for gain in gains), (power, gains)
    width = float(bands.upper[0] - bands.lower[0])
    assert np.sum(digital) * (f[1] - f[0]) == pytest.approx(width, rel=3e-3)


def test_settling_leaves_a_hundredth_of_a_decibel():
    bands, rate = Bands(-3, -3), 8000.0
    width = float(bands.upper[0] - bands.lower[0])
    time = np.arange(int(3.0 * SETTLING / width * rate)) / rate
    for tone in (bands.lower[0], bands.centre[0], bands.upper[0]):
        found = bands_by_filters(np.sin(2.0 * np.pi * tone * time), rate, bands)
        steady = 0.5 * power_gain(bands, tone, "filter")[0]
        assert level_db(found) == pytest.approx(level_db(steady), abs=0.01)


def test_levels_add_up():
    assert sum_db([80.0, 80.0]) == pytest.approx(83.0103, abs=1e-4)
    assert sum_db([]) == -np.inf
    assert level_db(0.0) == -np.inf
    assert level_db(mean_square_of(71.3)) == pytest.approx(71.3)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: Bands(3, 2), "last"),
        (lambda: Bands.between(-1.0, 20.0), "low"),
        (lambda: level_db(-1.0), "mean_square"),
        (lambda: level_db(float("nan")), "mean_square"),
        (lambda: weighting_db(100.0, "B"), "weighting"),
        (lambda: power_gain(AUDIBLE, 1.0, "square"), "shape"),
        (lambda: bands_of_record(np.zeros(100), RATE, Bands(-10, 0)), "record has .* s, lines at .* need .* s"),
        (lambda: bands_of_record(np.zeros(100_000), RATE, Bands(-3, 9)), "band of 8000 Hz reaches up to 8912"),
        (lambda: bands_by_filters(np.zeros(100), RATE, Bands(-3, 0)), "at least .* s for the band of 500 Hz"),
        (lambda: bands_by_filters(np.zeros(99_999), RATE, Bands(0, 8)), "band of 6300 Hz .* needs a rate"),
    ],
)
def test_what_cannot_be_is_refused_by_name(call, said):
    with pytest.raises(ValueError, match=said):
        call()
