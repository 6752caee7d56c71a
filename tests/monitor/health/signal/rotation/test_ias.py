"""The spectrum of the angular speed: closed forms, noise by jitter and clock, what is refused."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BSpline

from monitor.health.signal.rotation.ias import (
    HIGHEST_BINS,
    IasSpectrum,
    clock_noise,
    ias_lines,
    ias_spectrum,
    ias_view,
    interval_error,
    study,
    view_of,
)
from monitor.health.signal.rotation.intervals import (
    MIN_TURNS,
    PulseTrain,
    TooFewPulsesError,
    UnevenPulsesError,
    intervals,
    slow_course,
)
from monitor.health.signal.rotation.rotation import TachoSettings
from tests.monitor.health.signal.rotation.wheels import MARKS, eccentric, thinned, wheel

TURNS, SPEED = 100, 40.0
RAD_S = 2.0 * math.pi * SPEED
FAMILIES = {"outer": 4.63, "inner": 6.37, "ball": 5.9, "cage": 0.42}


def spectrum(train: PulseTrain, **how: Any) -> IasSpectrum:
    return ias_spectrum(intervals(train), **how)


def line(found: IasSpectrum, order: float) -> float:
    """Return the amplitude of a line wherever it stands between bins."""
    near = round(order / found.resolution) + np.arange(-2, 3)
    return math.sqrt(float(np.sum(np.square(found.amplitude[near]))) / 1.5)


@given(
    order=st.integers(20, MARKS * TURNS // 4).map(lambda k: k / TURNS),
    share=st.floats(1e-6, 1e-3),
    phase=st.floats(0.0, 6.28),
    speed=st.floats(1.0, 300.0),
)
@settings(max_examples=20)
def test_a_line_on_a_bin_has_its_amplitude(order: float, share: float, phase: float, speed: float) -> None:
    found = spectrum(wheel(TURNS, speed=speed, lines=[(order, share, phase)]))
    assert found.resolution == pytest.approx(1.0 / TURNS)
    assert found.mean_speed == pytest.approx(speed, rel=1e-4)
    tolerance = 2e-2 if order < 1.0 else 1e-3
    assert found.amplitude[round(order * TURNS)] == pytest.approx(2 * math.pi * speed * share, rel=tolerance)


@given(longer=st.floats(1e-3, 1e3), later=st.floats(-1e3, 1e3), first=st.integers(-(10**6), 10**6))
@settings(max_examples=10)
def test_units_and_beginnings_of_time_and_count_do_not_matter(longer: float, later: float, first: int) -> None:
    train = wheel(20, marks=16, lines=[(2.5, 1e-3, 0.0)], jitter=1e-7)
    found, other = spectrum(train), spectrum(PulseTrain(longer * (train.times + later), train.numbers + first, 16))
    np.testing.assert_allclose(other.amplitude * longer, found.amplitude, rtol=1e-3, atol=1e-6 * RAD_S)
    assert other.mean_speed * longer == pytest.approx(found.mean_speed, rel=1e-9)


@pytest.mark.parametrize("share", [1e-4, 1e-2])
def test_a_sinusoidal_change_of_the_speed_reads_its_amplitude(share: float) -> None:
    """The speed itself is a sine over the angle; times come from the integral of 1/speed."""
    order, fine = 4.63, 64
    angle = (np.arange(TURNS * MARKS * fine) + 0.5) / (MARKS * fine)
    slowness = 1.0 / (SPEED * (1.0 + share * np.sin(2.0 * np.pi * order * angle)))
    time = np.concatenate(([0.0], np.cumsum(slowness)[fine - 1 :: fine])) / (MARKS * fine)
    found = spectrum(PulseTrain(time, np.arange(time.size, dtype=np.int64), MARKS))
    assert line(found, order) == pytest.approx(share * RAD_S, rel=max(1e-3, share * share))


def test_amplitudes_are_those_of_the_marked_shaft_and_orders_those_of_the_bearing() -> None:
    train = wheel(TURNS, lines=[(4.0, 1e-3, 0.0)])
    found = spectrum(train, ratio=2.5)
    assert found.orders[np.argmax(found.amplitude)] == pytest.approx(1.6)
    assert found.amplitude.max() == pytest.approx(1e-3 * RAD_S, rel=1e-3)


def test_a_run_up_and_a_hunting_speed_do_not_leak() -> None:
    plain = [(4.63, 1e-4, 0.5)]
    still = spectrum(wheel(TURNS, lines=plain))
    ramp = spectrum(wheel(TURNS, speed=20.0, slope=5.0, lines=plain))
    hunting = spectrum(wheel(TURNS, lines=[*plain, (0.04, 0.1, 0.0)]))
    assert line(hunting, 4.63) == pytest.approx(line(still, 4.63), rel=0.02)
    for found, most in ((ramp, 1e-8), (hunting, 1e-5)):
        quiet = found.amplitude[(found.orders > 0.3) & (np.abs(found.orders - 4.63) > 0.2)]
        assert quiet.max() < most * 2.0 * math.pi * found.mean_speed


def test_the_slow_course_leaves_lines_and_takes_what_is_slow() -> None:
    turns = np.arange(TURNS * 16) / 16
    for order, left in ((0.03, 1e-3), (0.05, 1e-2), (0.39, 1.0), (1.0, 1.0), (4.63, 1.0)):
        rest = np.sin(2.0 * np.pi * order * turns)
        rest -= slow_course(rest, 4 * 16)
        rms = math.sqrt(2.0 * float(np.mean(np.square(rest[8 * 16 : -8 * 16]))))
        assert rms == pytest.approx(left, abs=1.5e-2) if left == 1.0 else rms < left


@given(size=st.integers(4, 300), cell=st.integers(4, 80), power=st.integers(0, 3))
@settings(max_examples=40)
def test_a_cubic_is_its_own_slow_course(size: int, cell: int, power: int) -> None:
    values = np.linspace(-1.0, 1.0, size) ** power
    np.testing.assert_allclose(slow_course(values, cell), values, atol=1e-9)


@pytest.mark.parametrize(("size", "cell"), [(400, 40), (395, 40), (50, 64)])
def test_the_slow_course_is_the_least_squares_spline(size: int, cell: int) -> None:
    values = np.random.default_rng(size).normal(size=size)
    cells = max(1, size // cell)
    steps = -(-size // cells)
    knots = np.arange(-3, cells + 4) * float(steps)
    design = BSpline.design_matrix(np.arange(size) + 0.5, knots, 3).toarray()
    oracle = design @ np.linalg.lstsq(design, values, rcond=None)[0]
    np.testing.assert_allclose(slow_course(values, cell), oracle, atol=1e-9)


@pytest.mark.parametrize(("values", "cell"), [(np.zeros(3), 8), (np.zeros((4, 4)), 8), (np.zeros(9), 3)])
def test_a_slow_course_needs_four_values(values: np.ndarray, cell: int) -> None:
    with pytest.raises(ValueError, match="from 4 on"):
        slow_course(values, cell)


def test_jitter_reads_what_is_stated() -> None:
    found = spectrum(wheel(TURNS, jitter=1e-7))
    assert found.timing_noise == pytest.approx(1e-7, rel=0.05)
    for order in (5.0, 20.0, 80.0):
        near = found.amplitude[np.abs(found.orders - order) < 2.0]
        assert math.sqrt(float(np.mean(np.square(near)))) == pytest.approx(found.noise(order, 1e-7), rel=0.15)


def test_a_clock_is_jitter_of_its_ticks() -> None:
    """A speed that hunts a little spreads the rounding over all orders; ticks a turn are never whole."""
    clock = 3.7e6
    train = wheel(TURNS, lines=[(0.03, 3e-3, 0.0), (0.071, 2e-3, 1.0)], clock=clock)
    found = spectrum(train)
    near = found.amplitude[np.abs(found.orders - 20.0) < 4.0]
    expected = found.noise(20.0, clock_noise(clock))
    assert math.sqrt(float(np.mean(np.square(near)))) == pytest.approx(expected, rel=0.15)
    speeds = 1.0 / np.diff(train.times)
    exact = 1.0 / np.diff(wheel(TURNS, lines=[(0.03, 3e-3, 0.0), (0.071, 2e-3, 1.0)]).times)
    assert float(np.std(speeds / exact)) == pytest.approx(interval_error(clock, MARKS, SPEED), rel=0.1)
    assert np.abs(speeds / exact - 1.0).max() <= 1.01 * MARKS * SPEED * (1.0 + 5e-3) / clock


def test_an_error_of_the_marks_stays_on_multiples_of_the_wheel() -> None:
    found = spectrum(wheel(TURNS, error=eccentric(0.1), lines=[(4.63, 1e-5, 0.0)]))
    assert line(found, 1.0) == pytest.approx(RAD_S * 2.0 * math.pi * math.sqrt(2.0) * 0.1 / 360.0, rel=0.1)
    assert line(found, 4.63) == pytest.approx(1e-5 * RAD_S, rel=5e-3)
    apart = np.abs(found.orders - np.rint(found.orders)) * TURNS
    elsewhere = (apart > 1.5) & (np.abs(found.orders - 4.63) > 0.1) & (found.orders > 0.4)
    assert found.amplitude[elsewhere].max() < 2e-5 * found.amplitude.max()


def test_an_error_that_is_known_is_taken_out() -> None:
    error = eccentric(0.1)
    train = wheel(TURNS, error=np.roll(error, -30))
    plain, mended = (ias_spectrum(intervals(train, off)) for off in (None, np.roll(error, -30)))
    assert line(mended, 1.0) < 2e-3 * line(plain, 1.0)


def test_missing_pulses_that_are_counted_leave_the_lines() -> None:
    train = wheel(TURNS, lines=[(k * 4.63, 1e-4, k) for k in range(1, 6)], jitter=1e-8)
    found = spectrum(thinned(train, 0.01))
    assert found.filled == pytest.approx(0.02, rel=0.2)
    assert line(found, 4.63) == pytest.approx(1e-4 * RAD_S, rel=0.02)
    assert ias_lines(found, FAMILIES)["outer"].detected


def test_lines_of_a_family_are_found_and_noise_is_not() -> None:
    noise = spectrum(wheel(TURNS, jitter=1e-6))
    assert not any(lines.detected for lines in ias_lines(noise, FAMILIES).values())
    least = noise.noise(4.63 * 1.01, 1e-6) / RAD_S
    train = wheel(TURNS, lines=[(k * 4.63 * 0.99, 6.0 * k * least, k) for k in range(1, 6)], jitter=1e-6)
    lines = ias_lines(spectrum(train), FAMILIES)
    assert lines["outer"].detected
    assert lines["outer"].fundamental == pytest.approx(4.63 * 0.99, rel=1e-3)
    assert lines["outer"].amplitude[0] == pytest.approx(6.0 * least * RAD_S, rel=0.3)
    assert not lines["inner"].detected


def test_what_turns_with_the_wheel_is_no_line_of_a_bearing() -> None:
    """Three passages a turn cannot be told from an error of the marks, however high."""
    train = wheel(TURNS, error=eccentric(0.5), lines=[(3.0 * k, 1e-2, k) for k in range(1, 6)], jitter=1e-8)
    assert not any(lines.detected for lines in ias_lines(spectrum(train), {**FAMILIES, "outer": 3.0}).values())


@pytest.mark.parametrize("train", [wheel(MIN_TURNS - 1), wheel(200, marks=1)], ids=["turns", "marks"])
def test_too_few_turns_or_marks_are_refused(train: PulseTrain) -> None:
    with pytest.raises(TooFewPulsesError, match=f"got {train.per_revolution} marks"):
        intervals(train)


def test_few_marks_have_no_spectrum() -> None:
    with pytest.raises(TooFewPulsesError, match="16 marks a turn or more, got 4"):
        spectrum(wheel(200, marks=4))


def test_a_shaft_that_stands_still_in_between_is_refused() -> None:
    train = wheel(TURNS)
    times = train.times + np.where(train.numbers > 30 * MARKS, 600.0, 0.0)
    with pytest.raises(UnevenPulsesError, match="no steady turning"):
        intervals(PulseTrain(times, train.numbers, MARKS))


def test_a_view_has_all_low_lines_and_the_highest_of_the_others() -> None:
    found = spectrum(wheel(TURNS, marks=1000, lines=[(4.63, 1e-3, 0.0), (320.0, 1e-4, 0.0)]))
    view = ias_view(found)
    assert view.resolution == found.resolution
    assert view.amplitude.size == 100 * TURNS + 1
    assert view.highest.size <= HIGHEST_BINS
    assert view.highest[int(320.0 / view.width)] == pytest.approx(1e-4 * RAD_S, rel=1e-3)


def test_a_block_without_a_spectrum_has_no_view() -> None:
    train = wheel(TURNS, lines=[(4.63, 1e-3, 0.0)])
    view = view_of(train, 2.0)
    assert view is not None
    assert np.argmax(view.amplitude) * view.resolution == pytest.approx(4.63 / 2.0, abs=view.resolution)
    stopped = PulseTrain(train.times + np.where(train.numbers > 30 * MARKS, 600.0, 0.0), train.numbers, MARKS)
    for other in (wheel(MIN_TURNS - 1), wheel(200, marks=4), stopped):
        assert view_of(other, 1.0) is None


@pytest.mark.parametrize(
    ("times", "numbers", "marks", "message"),
    [
        ([0.0, 1.0], [0, 0], 8, "rise"),
        ([1.0, 0.0], [0, 1], 8, "rise"),
        ([0.0], [0], 8, "from 2 on"),
        ([0.0, 1.0], [0.0, 1.0], 8, "whole"),
        ([0.0, 1.0], [0, 1], 0, "1 or more"),
    ],
)
def test_a_train_that_does_not_rise_is_refused(
    times: list[float], numbers: list[Any], marks: int, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        PulseTrain(np.array(times), np.array(numbers), marks)


LINES = [(k * 4.63, 1e-4 * k, float(k)) for k in range(1, 6)]
WHEEL = TachoSettings(per_revolution=MARKS)
TRAIN = wheel(100, lines=LINES, error=eccentric(0.05), jitter=1e-8)


def test_pulses_that_are_missing_or_too_many_are_counted() -> None:
    times = np.delete(TRAIN.times, [700, 9000, 20000])
    times = np.sort(np.append(times, TRAIN.times[5000] + 3e-5))
    found = study(times + 12.5, WHEEL)
    assert (found.missing, found.extra) == (3, 1)
    assert found.lines({"outer": 4.6})["outer"].detected
    assert found.wheel.rms * 360.0 == pytest.approx(0.05, rel=0.02)
    assert not found.removed


def test_what_repeats_each_turn_is_taken_out_where_asked() -> None:
    plain, without = study(TRAIN.times, WHEEL), study(TRAIN.times, WHEEL, remove_wheel=True)
    assert without.removed
    at = without.spectrum.turns
    assert without.spectrum.amplitude[at] < 0.01 * plain.spectrum.amplitude[at]
    line = round(4.63 / plain.spectrum.resolution)
    assert without.spectrum.amplitude[line] == pytest.approx(plain.spectrum.amplitude[line], rel=1e-3)


def test_nothing_is_taken_out_where_nothing_repeats() -> None:
    assert not study(wheel(100, jitter=1e-6).times, WHEEL, remove_wheel=True).removed


def test_a_wheel_with_a_gap_is_counted_from_it() -> None:
    train = wheel(60, marks=60, lines=[(1.5, 1e-3, 0.0)], start=0)
    teeth = train.numbers % 60 < 58
    found = study(train.times[teeth], TachoSettings(per_revolution=60, missing_teeth=2))
    assert found.train.indexed
    assert found.missing == 0
    spectrum = found.spectrum
    assert spectrum.amplitude[round(1.5 / spectrum.resolution)] == pytest.approx(2 * np.pi * 40.0 * 1e-3, rel=0.05)


@pytest.mark.parametrize(
    ("times", "message"),
    [
        (np.zeros(1), "1 pulses"),
        (np.sort(np.random.default_rng(0).uniform(0.0, 1.0, 5000)), "do not follow one speed"),
        (wheel(3).times, "got 256 marks over 3"),
    ],
    ids=["one", "at random", "three turns"],
)
def test_pulses_without_a_speed_are_refused(times: np.ndarray, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        study(times, WHEEL)
