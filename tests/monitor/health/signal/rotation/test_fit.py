"""The angle from numbered pulses, against shafts whose angle is known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline
from scipy.ndimage import rank_filter

from monitor.health.signal.rotation.fit import GAIN_SD, rotation_of, rotation_of_speed
from monitor.health.signal.rotation.intervals import running_median, solved, spline_slopes
from monitor.health.signal.rotation.repair import repaired
from monitor.health.signal.rotation.rotation import Rotation
from tests.monitor.health.signal.rotation.shafts import Angle, even, hunting, marks, run_up, with_faults
from tests.support.effort import effort_count

SECONDS = 5.0
TIME = np.linspace(0.0, SECONDS, 5001)
SHAFTS = {"up": run_up(10.0, 40.0, SECONDS), "down": run_up(40.0, 10.0, SECONDS), "hunting": hunting(25.0, 0.2, 0.5)}


def found_of(times: np.ndarray, per_revolution: int) -> Rotation:
    train = repaired(times, SECONDS, per_revolution).train
    assert train is not None
    return rotation_of(train, SECONDS)


def errors(found: Rotation, angle: Angle) -> np.ndarray:
    """Return the error of the angle over the block, revolutions, without its mean."""
    away = found.turns_at(TIME) - angle(TIME)
    return away - away.mean()


@given(speed=st.floats(2.0, 300.0), per_revolution=st.sampled_from([1, 2, 7, 60]), first=st.floats(0.0, 0.99))
@settings(max_examples=effort_count(quick=20, full=500))
def test_a_shaft_at_one_speed(speed: float, per_revolution: int, first: float) -> None:
    found = found_of(marks(even(speed), SECONDS, per_revolution, first=first).times, per_revolution)
    assert found.mean_speed == pytest.approx(speed, rel=1e-9)
    assert found.speed_range == pytest.approx((speed, speed), rel=1e-6)
    assert np.max(np.abs(errors(found, even(speed)))) < 1e-6


@pytest.mark.parametrize("shaft", SHAFTS)
@pytest.mark.parametrize("per_revolution", [1, 3, 8, 256])
def test_a_shaft_of_varying_speed(shaft: str, per_revolution: int) -> None:
    found = found_of(marks(SHAFTS[shaft], SECONDS, per_revolution).times, per_revolution)
    assert np.max(np.abs(errors(found, SHAFTS[shaft]))) < (1e-3 if per_revolution == 1 else 1e-4)
    begin, end = (SHAFTS[shaft](np.array([0.0, SECONDS]))).tolist()
    assert found.mean_speed == pytest.approx((end - begin) / SECONDS, rel=1e-5)


@pytest.mark.parametrize("shaft", SHAFTS)
@pytest.mark.parametrize("per_revolution", [1, 8, 60])
def test_jitter_is_told(shaft: str, per_revolution: int) -> None:
    rng = np.random.default_rng(per_revolution)
    times = with_faults(marks(SHAFTS[shaft], SECONDS, per_revolution).times, rng, jitter=6e-4 / per_revolution)
    found = found_of(times[(times >= 0.0) & (times < SECONDS)], per_revolution)
    rms = float(np.sqrt(np.mean(np.square(errors(found, SHAFTS[shaft])))))
    assert 0.4 < rms / found.turns_sd < 2.0


@given(shift=st.floats(1e-4, 0.9))
@settings(max_examples=effort_count(quick=10, full=200))
def test_a_shift_of_time_shifts_the_angle(shift: float) -> None:
    times = marks(SHAFTS["up"], SECONDS, 1).times
    found = found_of(times, 1)
    later = times[times >= shift] - shift
    train = repaired(later, SECONDS - shift, 1).train
    assert train is not None
    moved = rotation_of(train, SECONDS - shift)
    inside = np.linspace(later[0], SECONDS - shift, 200)
    away = moved.turns_at(inside) - found.turns_at(inside + shift)
    assert np.ptp(away) < 1e-4


@given(lost=st.integers(0, 124))
@settings(max_examples=effort_count(quick=15, full=400))
def test_a_lost_pulse_moves_the_angle_little(lost: int) -> None:
    times = marks(SHAFTS["up"], SECONDS, 1).times
    found = found_of(np.delete(times, min(lost, times.size - 1)), 1)
    assert np.max(np.abs(errors(found, SHAFTS["up"]))) < 2e-3


def test_the_errors_of_marks_are_taken_off() -> None:
    angle, rng = SHAFTS["hunting"], np.random.default_rng(3)
    error = 2e-3 * np.sin(2.0 * np.pi * np.arange(64) / 64) + 2e-4 * rng.standard_normal(64)
    true = marks(angle, SECONDS, 64)
    numbers = true.numbers % 64
    slope = (angle(true.times + 1e-5) - angle(true.times - 1e-5)) / 2e-5
    train = repaired(true.times - error[numbers] / slope, SECONDS, 64).train
    assert train is not None
    # A mark that stands ahead passes earlier.
    plain, corrected = rotation_of(train, SECONDS), rotation_of(train, SECONDS, error=-error)
    assert np.std(errors(plain, angle)) > 5e-4
    assert np.std(errors(corrected, angle)) < 1e-4


def test_a_shaft_behind_a_gear() -> None:
    train = repaired(marks(even(25.0), SECONDS, 1).times, SECONDS, 1).train
    assert train is not None
    assert rotation_of(train, SECONDS, ratio=3.2).mean_speed == pytest.approx(80.0, rel=1e-9)


def test_a_speed_over_time() -> None:
    rate = 2000.0
    time = np.arange(round(SECONDS * rate)) / rate
    speed = 25.0 * (1.0 + 0.2 * np.sin(2.0 * np.pi * 0.5 * time))
    found, status = rotation_of_speed(speed.astype(np.float32), rate)
    assert status == "ok"
    assert found is not None
    assert np.max(np.abs(errors(found, SHAFTS["hunting"]))) < 1e-4
    assert found.speed_sd == pytest.approx(GAIN_SD, rel=0.1)
    noisy, _ = rotation_of_speed(speed + np.random.default_rng(0).standard_normal(speed.size), rate)
    assert noisy is not None
    assert 0.2 < np.std(errors(noisy, SHAFTS["hunting"])) / noisy.turns_sd < 3.0


def test_a_speed_over_time_that_gives_no_angle() -> None:
    up = np.linspace(0.0, 10.0, 1000)
    assert rotation_of_speed(up[:20], 100.0) == (None, "too_few")
    assert rotation_of_speed(np.where(up > 5.0, np.nan, up), 100.0) == (None, "irregular")
    assert rotation_of_speed(up, 100.0) == (None, "stopped")
    assert rotation_of_speed(0.0 * up, 100.0) == (None, "stopped")
    assert rotation_of_speed(up - 5.0, 100.0) == (None, "reversed")


@pytest.mark.parametrize("points", [4, 5, 60])
def test_slopes_are_those_of_the_spline_of_scipy(points: int) -> None:
    rng = np.random.default_rng(points)
    x, y = np.cumsum(rng.uniform(0.5, 1.5, points)), rng.standard_normal(points)
    assert np.allclose(spline_slopes(x, y), CubicSpline(x, y)(x, 1), rtol=1e-9, atol=1e-12)


def test_a_banded_system_is_solved() -> None:
    rng = np.random.default_rng(1)
    bands = np.stack((np.r_[0.0, rng.uniform(-1.0, 1.0, 7)], np.full(8, 3.0)))
    full = np.diag(bands[1]) + np.diag(bands[0, 1:], 1) + np.diag(bands[0, 1:], -1)
    right = rng.standard_normal(8)
    assert np.allclose(full @ solved(bands, right), right)


@pytest.mark.parametrize(("size", "above"), [(1, 0), (3, 0), (9, 0), (9, 2)])
def test_medians_are_those_of_scipy(size: int, above: int) -> None:
    values = np.random.default_rng(2).standard_normal(40)
    expected = rank_filter(values, rank=size // 2 + above, size=size, mode="reflect")
    assert np.array_equal(running_median(values, size, above), expected)
