"""Gears beside a bearing: their lines are removed, and what may be a wheel is no part of the bearing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from models.machine.bearing import kinematics
from monitor.health.gears.lines import Wheels
from monitor.health.gears.settings import GearPairing, GearSettings, GearWheel, gear_interference
from monitor.health.name.naming import name_fault
from monitor.health.signal.comb import FaultLines
from monitor.health.signal.features import BlockFeatures, FeatureSettings, block_features, fundamentals
from monitor.health.signal.interference import (
    MIN_SPACING_BINS,
    Comb,
    Interference,
    all_combs,
    remove_lines,
    wheel_turns,
)
from reference.signals import bearing_lines, impacts

RATE, BAND, SPEED = 25600.0, (1000.0, 9000.0), 30.0
BEARING, LINES = bearing_lines("6205", SPEED)


def train(driver: int, driven: int) -> GearSettings:
    wheels = (GearWheel("pinion", driver, 1.0), GearWheel("wheel", driven, driver / driven))
    return GearSettings(wheels, (GearPairing("pinion", "wheel"),))


def features(x: NDArray[np.float64], interference: tuple[Interference, ...]) -> BlockFeatures:
    settings = FeatureSettings(RATE, (BAND,), fundamentals(LINES), speed=SPEED)
    settings = replace(settings, interference=all_combs(interference, SPEED))
    return block_features(x.astype(np.float32), RATE, settings)


def mesh(n: int, level: float) -> NDArray[np.float64]:
    """Return 23 teeth that mesh with 71, the heights swelling with both wheels, shape (n,)."""
    turned = 1.012 * SPEED * np.arange(n) / RATE
    height = (1.0 + 0.6 * np.cos(2 * np.pi * turned)) * (1.0 + 0.6 * np.cos(2 * np.pi * 23 / 71 * turned + 1.0))
    return level * height * sum(np.cos(2 * np.pi * 23 * k * turned + k * k) for k in range(1, 15))


def depths(found: BlockFeatures) -> float:
    return found.families[0]["outer"].depth


def test_sidebands_of_both_wheels_are_removed_at_a_speed_that_is_stated_wrongly() -> None:
    x = impacts(np.random.default_rng(0), "outer", LINES, duration=2.0)
    y = x + mesh(x.size, 2.0)
    one = (Interference(orders=(23.0,), sidebands=3, tolerance=0.02),)
    both = gear_interference(train(23, 71), 0.02)
    alone, covered, half, freed = (depths(features(*case)) for case in ((x, ()), (y, ()), (y, one), (y, both)))
    assert covered < 0.2 * alone
    assert half < 0.7 * alone
    assert freed > 0.7 * alone
    assert np.array_equal(features(x, ()).envelopes[0].amplitude, features(x, both).envelopes[0].amplitude)


def test_each_mesh_order_once_with_all_wheels_that_turn_otherwise() -> None:
    a, b, d = GearWheel("a", 20, 1.0), GearWheel("b", 40, 0.5), GearWheel("d", 10, 0.5)
    gears = GearSettings((a, b, d, GearWheel("e", 30, 1 / 6)), (GearPairing("a", "b"), GearPairing("d", "e")))
    first, second = gear_interference(gears)
    assert (first.orders, first.spacing, first.beside) == ((20.0,), 1.0, (0.5,))
    assert (second.orders, second.spacing, second.beside) == ((5.0,), 0.5, (1 / 6,))
    assert wheel_turns((first, second)) == (1.0, 0.5, 1 / 6)
    assert wheel_turns((Interference((23.0,), sidebands=2, spacing=0.4),)) == ()


@given(st.floats(10.0, 900.0), st.floats(0.5, 60.0), st.floats(0.05, 200.0), st.integers(0, 5), st.floats(0.02, 2.0))
def test_sides_are_resolved_and_alike_on_both_sides(
    fundamental: float, spacing: float, other: float, count: int, resolution: float
) -> None:
    sides, least = Comb(fundamental, None, count, spacing, 0.01, True, (other,)).sides(resolution)
    assert 0.0 in sides
    assert np.allclose(sides, -sides[::-1])
    assert np.abs(sides).max() <= 0.5 * fundamental
    assert least >= min(fundamental, MIN_SPACING_BINS * resolution) * (1.0 - 1e-9)


def family(fundamental: float) -> FaultLines:
    x = impacts(np.random.default_rng(0), "outer", LINES, duration=0.5)
    return replace(features(x, ()).families[0]["outer"], fundamental=fundamental)


@pytest.mark.parametrize(
    ("order", "turns", "explained"),
    [
        (3.12, 3.12, True),
        (0.4, 0.6, True),
        (0.96, 0.32, True),
        (3.58, 3.12, False),
        (0.4, 0.62, False),
        (3.0, 1.0, False),
    ],
)
def test_a_family_on_the_lines_of_a_wheel_is_the_wheels(order: float, turns: float, explained: bool) -> None:
    found = family(order * SPEED)
    assert Wheels((1.0, turns), SPEED, 0.001, 0.02).explain(found, 0.2) == explained


def test_at_a_stated_speed_a_family_is_withheld_as_far_as_that_may_be_off() -> None:
    found = family(3.08 * SPEED)
    assert Wheels((3.12,), SPEED, None, 0.02).explain(found, 0.2)
    assert not Wheels((3.12,), SPEED, None, 0.005).explain(found, 0.2)
    assert not Wheels((3.12,), SPEED, 0.001, 0.02).explain(found, 0.2)


def test_a_cage_is_named_beside_gears_only_where_its_lines_are_far_apart() -> None:
    cage = {"cage": family(0.4 * SPEED), "outer": family(3.58 * SPEED)}
    wheels = Wheels((1.0, 0.71), SPEED, 0.001, 0.02)
    assert list(wheels.leave(cage, 1.0)) == ["outer"]
    assert list(wheels.leave(cage, 0.1)) == ["cage", "outer"]


def test_the_part_is_named_unless_a_wheel_turns_as_often_as_it_is_hit() -> None:
    x = impacts(np.random.default_rng(0), "outer", LINES, duration=2.0)
    found = features(x, ())
    lines = kinematics(BEARING, SPEED)
    order = found.families[0]["outer"].fundamental / SPEED
    for turns, fault in (((), "outer"), ((1.0, 0.32), "outer"), ((1.0, order), None)):
        wheels = Wheels(turns, SPEED, 0.001, 0.02)
        assert name_fault(found.sought[0], lines, found.families[0], verified=True, wheels=wheels).fault == fault


def test_the_mesh_shows_the_speed_where_it_is_loud() -> None:
    x = np.random.default_rng(2).standard_normal(51_200)
    both = gear_interference(train(23, 71), 0.02)
    assert features(x + mesh(x.size, 1.0), both).envelopes[0].mesh_factor == pytest.approx(1.012, abs=3e-4)
    assert features(x, both).envelopes[0].mesh_factor is None


def test_a_loud_mesh_is_removed_although_its_sidebands_leave_no_room_between_them() -> None:
    # 19 and 25 teeth at 3 Hz for 8 s: lines of both wheels are 6 bins apart, and closer.
    n, speed = round(8 * RATE), 3.0
    turned = speed * np.arange(n) / RATE
    height = (1.0 + 0.7 * np.cos(2 * np.pi * turned)) * (1.0 + 0.7 * np.cos(2 * np.pi * 19 / 25 * turned))
    rng = np.random.default_rng(3)
    x = 2.0 * height * sum(np.cos(2 * np.pi * 19 * k * turned + k * k) for k in range(5, 60)) + rng.standard_normal(n)
    combs = all_combs(gear_interference(train(19, 25)), speed)
    before = np.fft.rfft(x)
    after = before.copy()
    remove_lines(after, RATE / n, combs, *BAND)
    inside = slice(round(BAND[0] * 8), round(BAND[1] * 8))
    assert np.sum(np.abs(after[inside]) ** 2) < 0.5 * np.sum(np.abs(before[inside]) ** 2)
    quiet = np.fft.rfft(rng.standard_normal(n))
    kept = quiet.copy()
    remove_lines(kept, RATE / n, combs, *BAND)
    assert np.array_equal(kept, quiet)
