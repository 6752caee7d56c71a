"""The angle of the shaft over a block: inverse, ends, refusals."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from monitor.health.signal.rotation.rotation import Rotation, constant


def ramp(begin: float, end: float, duration: float, knots: int) -> Rotation:
    time = np.linspace(0.0, duration, knots)
    speed = begin + (end - begin) * time / duration
    return Rotation(time, begin * time + 0.5 * (end - begin) * time**2 / duration, speed, duration)


@given(st.floats(1.0, 50.0), st.floats(1.0, 50.0), st.floats(0.5, 60.0), st.integers(2, 40))
def test_time_at_is_the_inverse_of_turns_at(begin: float, end: float, duration: float, knots: int) -> None:
    rotation = ramp(begin, end, duration, knots)
    time = np.linspace(-0.1 * duration, 1.1 * duration, 97)
    np.testing.assert_allclose(rotation.time_at(rotation.turns_at(time)), time, rtol=0, atol=1e-9 * duration)


def test_a_ramp_between_two_knots_is_exact() -> None:
    rotation = ramp(10.0, 40.0, 5.0, 2)
    time = np.linspace(0.0, 5.0, 11)
    np.testing.assert_allclose(rotation.turns_at(time), 10.0 * time + 3.0 * time**2, rtol=1e-13)
    np.testing.assert_allclose(rotation.speed_at(time), 10.0 + 6.0 * time, rtol=1e-13)
    assert rotation.mean_speed == pytest.approx(25.0)
    assert rotation.speed_range == pytest.approx((10.0, 40.0))
    assert rotation.acceleration == pytest.approx(6.0)


def test_hunting_is_steep_though_the_speed_ends_where_it_began() -> None:
    time = np.linspace(0.0, 5.0, 201)
    angle = 2.0 * np.pi * 0.4 * time
    rotation = Rotation(time, 20.0 * time - 2.0 / (0.8 * np.pi) * np.cos(angle), 20.0 + 2.0 * np.sin(angle), 5.0)
    assert rotation.acceleration == pytest.approx(0.0, abs=1e-6)
    assert rotation.steepest == pytest.approx(2.0 * 0.8 * np.pi, rel=0.03)
    assert ramp(10.0, 40.0, 5.0, 9).steepest == pytest.approx(6.0)


def test_beyond_the_knots_the_speed_stays() -> None:
    rotation = constant(30.0, 2.0)
    np.testing.assert_allclose(rotation.turns_at([-1.0, 3.0]), [-30.0, 90.0])


@pytest.mark.parametrize(
    ("turns", "speed", "message"),
    [
        ([0.0, 1.0], [1.0, 0.0], "positive"),
        ([0.0, -1.0], [1.0, 1.0], "must rise"),
        ([0.0, 1.0], [9.0, 9.0], "turns back"),
        ([0.0], [1.0], "one shape"),
    ],
)
def test_a_shaft_that_stops_or_turns_back_is_refused(turns: list[float], speed: list[float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Rotation(np.array([0.0, 1.0]), np.array(turns), np.array(speed), 1.0)
