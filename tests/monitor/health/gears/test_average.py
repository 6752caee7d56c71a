"""Average of a wheel and angle of the mesh, against projections, and when each is withheld."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from monitor.health.gears.angle import angle_of_mesh
from monitor.health.gears.average import MIN_TURNS, wheel_average
from monitor.health.gears.indicators import beside_mesh, gear_indicators, shared_orders
from monitor.health.signal.rotation.rotation import Rotation, constant
from tests.monitor.health.gears.signals import RATE, Meshing, pair
from tests.oracles.gear_average_oracle import indicators, projected_lines

PAIR = pair()


def rotation_of(turns: np.ndarray, turns_sd: float = 0.0) -> Rotation:
    """Return the true angle of a signal at knots."""
    time = np.arange(turns.size) / RATE
    knots = np.unique(np.r_[0 : turns.size : 640, turns.size - 1])
    slope = np.gradient(turns, time)[knots]
    return Rotation(time[knots], turns[knots], slope, turns.size / RATE, "tacho", turns_sd)


@pytest.mark.parametrize("name", ["pinion", "wheel"])
def test_an_average_is_the_projection_on_the_angle(name: str) -> None:
    samples, turns = Meshing(noise=0.0, impact=("wheel", 0.5), wander=5e-3).of(PAIR, 1)
    wheel = PAIR.by_name[name]
    average, status = wheel_average(samples, RATE, rotation_of(turns), wheel.turns, (wheel.teeth,))
    assert status == "ok"
    assert average is not None
    slow = projected_lines(samples, turns * wheel.turns, average.turns, average.lines.size - 1)
    np.testing.assert_allclose(average.lines, slow, atol=3e-3)
    assert abs(average.lines[wheel.teeth]) == pytest.approx(1.0, abs=0.03)


def test_noise_is_told_of_every_line() -> None:
    rng = np.random.default_rng(5)
    samples = rng.normal(size=51200)
    average, _ = wheel_average(samples, RATE, constant(29.7, 4.0), 1.0, (23,))
    assert average is not None
    expected = 4.0 / samples.size
    assert average.noise[1:].mean() == pytest.approx(expected, rel=0.05)
    assert np.square(np.abs(average.lines[1:])).mean() == pytest.approx(expected, rel=0.25)


@given(st.integers(0, 10**6), st.sampled_from([7, 12, 23]), st.booleans())
def test_indicators_are_their_definitions(seed: int, teeth: int, sharing: bool) -> None:
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(12, 640)) + rng.normal(size=640)
    average, _ = wheel_average(rows.ravel(), 640.0, constant(1.0, 12.0), 1.0, (teeth,))
    assert average is not None
    shared = shared_orders(1.0, average.lines.size, [2.0] if sharing else [])
    found = gear_indicators(average, (teeth,), shared)
    others = tuple(range(0, average.lines.size, 2)) if sharing else ()
    slow = indicators(average.lines, teeth, average.per_turn, others)
    assert {name: getattr(found, name) for name in slow} == pytest.approx(slow, rel=1e-9)
    assert found.na4(found.variance) == pytest.approx(slow["unlike"])


def test_orders_of_other_wheels_are_known() -> None:
    assert np.flatnonzero(shared_orders(1.0, 100, [23.0 / 71.0])).tolist() == [0, 23, 46, 69, 92]
    assert np.flatnonzero(shared_orders(0.5, 8, [1.0])).tolist() == [0, 2, 4, 6]
    assert np.flatnonzero(beside_mesh(30, (10,), 1)).tolist() == [9, 11, 19, 21, 29]


def test_the_angle_of_the_mesh_follows_a_wandering_speed() -> None:
    samples, turns = Meshing(wander=1e-3).of(PAIR, 3)
    found = angle_of_mesh(samples, RATE, 29.4, 0.02, PAIR)
    assert found is not None
    time = np.linspace(0.3, 3.7, 50)
    error = found.turns_at(time) - np.interp(time, np.arange(turns.size) / RATE, turns)
    assert 23 * float(np.std(error)) < 0.02
    assert found.source == "phase"


def test_the_angle_is_withheld_without_a_mesh_and_in_short_blocks() -> None:
    noise = np.random.default_rng(1).normal(size=51200)
    assert angle_of_mesh(noise, RATE, 29.7, 0.02, PAIR) is None
    samples, _ = replace(Meshing(), duration=1.0).of(PAIR, 3)
    assert angle_of_mesh(samples, RATE, 29.7, 0.02, PAIR) is None
    far, _ = Meshing().of(PAIR, 3)
    assert angle_of_mesh(far, RATE, 33.0, 0.02, PAIR) is None


def test_an_average_is_withheld() -> None:
    samples, turns = Meshing().of(PAIR, 2)
    known = rotation_of(turns)
    assert wheel_average(samples, RATE, None, 1.0, (23,)) == (None, "no_angle")
    assert wheel_average(samples, RATE, rotation_of(turns, 0.01), 1.0, (23,)) == (None, "no_angle")
    assert wheel_average(samples, RATE, known, (MIN_TURNS - 0.1) / known.turned, (71,)) == (None, "too_short")
    assert wheel_average(samples, RATE, known, 1.0, (400,)) == (None, "above_band")
    ramp = Rotation(np.array([0.0, 4.0]), np.array([0.0, 100.0]), np.array([10.0, 40.0]), 4.0)
    assert wheel_average(samples, RATE, ramp, 1.0, (23,)) == (None, "no_angle")
