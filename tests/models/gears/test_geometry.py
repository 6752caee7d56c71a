"""Geometry of gears against closed forms, against cutting by the rack point by point, and refusals by name."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from models.gears.teeth.geometry import GearPair, TipRelief, ToothedWheel, inverse_involute
from models.gears.teeth.rack import BasicRack, ToothProfile, involute

ANGLE = math.radians(20.0)


def pair(z1: int = 20, z2: int = 40, x1: float = 0.0, x2: float = 0.0, **options: Any) -> GearPair:
    driver, driven = (ToothedWheel(z, 20e-3, 0.25 * z * 2e-3, x) for z, x in ((z1, x1), (z2, x2)))
    return GearPair(driver, driven, 2e-3, **options)


def test_standard_gears_have_their_textbook_dimensions():
    gears = pair(19, 48)
    first, second = gears.profiles
    assert gears.distance == pytest.approx(67e-3)
    assert first.tip_radius == pytest.approx(21e-3)
    assert second.root_radius == pytest.approx(45.5e-3)
    assert gears.base_radii[0] == pytest.approx(19e-3 * math.cos(ANGLE))
    # Contact ratio of standard gears by its textbook formula (roll angles of the tips).
    tips = [math.tan(math.acos(z * math.cos(ANGLE) / (z + 2))) for z in (19, 48)]
    ratio = sum(z * (tip - math.tan(ANGLE)) for z, tip in zip((19, 48), tips, strict=True)) / math.tau
    assert gears.transverse_contact_ratio == pytest.approx(ratio)
    assert gears.backlash == 0.0


@given(st.floats(1e-9, 3.0))
def test_the_inverse_of_the_involute(value):
    assert float(involute(inverse_involute(value))) == pytest.approx(value, rel=1e-9)


@settings(max_examples=25, deadline=None)
@given(z=st.integers(18, 120), x=st.floats(0.0, 0.5), beta=st.floats(0.0, 0.6), radius=st.floats(0.05, 0.38))
def test_fillet_and_flank_meet_with_one_tangent(z, x, beta, radius):
    tooth = ToothProfile(z, 2e-3, ANGLE, beta, x, BasicRack(fillet_radius=radius))
    assume(tooth.undercut_margin > 1e-5)
    roll, step = tooth.roll(tooth.form_radius), 1e-5
    np.testing.assert_allclose(tooth.fillet(1.0), tooth.flank(roll), rtol=1e-9)
    directions = [
        np.subtract(curve(at), curve(at - step)) if curve == tooth.fillet else np.subtract(curve(at + step), curve(at))
        for curve, at in ((tooth.fillet, 1.0), (tooth.flank, roll))
    ]
    first, second = (vector / np.hypot(*vector) for vector in directions)
    np.testing.assert_allclose(first, second, atol=5e-3)
    assert np.hypot(*tooth.fillet(0.0)) == pytest.approx(tooth.root_radius)


def test_the_tooth_is_what_the_rack_leaves():
    """Cut the wheel at many positions of the rack: the half thickness left at a radius is the least of all."""
    tooth = ToothProfile(24, 1.0, ANGLE, 0.0, 0.2, BasicRack())
    radii = np.linspace(tooth.root_radius + 0.05, tooth.tip_radius - 0.02, 15)
    share = np.linspace(0.0, 1.0, 400)
    gamma = share * (math.pi / 2.0 - ANGLE)
    rho, depth = 0.38, 1.25
    across = math.pi / 4.0 + depth * math.tan(ANGLE) + rho * (1.0 - math.sin(ANGLE)) / math.cos(ANGLE)
    arc = across - rho * np.sin(gamma), -depth + rho * (1.0 - np.cos(gamma)) + 0.2
    height = np.linspace(arc[1][-1], 2.5, 800)
    edge = np.concatenate([arc[0], math.pi / 4.0 - (height - 0.2) * math.tan(ANGLE)]), np.concatenate([arc[1], height])
    least = np.full(radii.shape, math.inf)
    for rolled in np.linspace(-8.0, 8.0, 1200):
        turn = -rolled / tooth.reference_radius
        x, y = tooth.reference_radius + edge[1], edge[0] + rolled
        radius, angle = np.hypot(x, y), np.arctan2(y, x) + turn
        order = np.argsort(radius)
        least = np.minimum(least, np.interp(radii, radius[order], angle[order], left=math.inf, right=math.inf))
    lower = np.linspace(0.0, 1.0, 2000)
    curve = np.concatenate(
        [tooth.fillet(lower), tooth.flank(np.linspace(tooth.roll(tooth.form_radius), 1.0, 2000))], axis=1
    )
    expected = np.interp(radii, np.hypot(*curve), np.arctan2(curve[1], curve[0]))
    np.testing.assert_allclose(least, expected, atol=2e-4)


def test_a_larger_centre_distance_gives_the_backlash_of_its_opened_angle():
    free = pair(x1=0.3, x2=-0.1).distance
    gears = pair(x1=0.3, x2=-0.1, centre_distance=free + 0.1e-3)
    # For a small change the backlash along the line of action is 2 da sin(alpha_w).
    assert gears.backlash == pytest.approx(2.0 * 0.1e-3 * math.sin(gears.working_angle), rel=0.01)


def test_helical_gears_overlap():
    gears = pair(helix_angle=math.radians(15.0))
    assert gears.overlap_ratio == pytest.approx(20e-3 * math.sin(math.radians(15.0)) / (math.pi * 2e-3))
    assert gears.distance == pytest.approx(60e-3 / math.cos(math.radians(15.0)))
    begin, end = gears.contact_path
    assert gears.transverse_contact_ratio == pytest.approx((end - begin) / gears.base_pitch)


def test_what_the_fits_of_the_body_cover_is_said():
    assert GearPair(ToothedWheel(30, 20e-3, 10e-3), ToothedWheel(100, 20e-3, 75e-3), 2e-3).valid_foundation == (
        True,
        False,
    )
    assert pair(20, 40).valid_foundation == (False, True)


def test_relief_is_full_at_the_tip_and_ends_after_its_length():
    below = np.array([0.0, 0.5e-3, 1e-3, 2e-3])
    np.testing.assert_allclose(TipRelief(20e-6, 1e-3).removed(below), [20e-6, 10e-6, 0.0, 0.0])
    np.testing.assert_allclose(TipRelief(20e-6, 1e-3, "parabolic").removed(below), [20e-6, 5e-6, 0.0, 0.0])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"z1": 12}, r"driver profile_shift must be at least 0\.2\d+ for 12 teeth"),
        ({"z2": 10}, "driven profile_shift must be at least"),
        ({"x1": 1.5, "x2": 0.5}, "driver profile_shift must leave a tip"),
        ({"centre_distance": 59.9e-3}, "centre_distance must be at least 60 mm"),
        ({"centre_distance": 63.5e-3}, "centre_distance and truncation leave a contact ratio of 0"),
        ({"pressure_angle": 0.9}, "pressure_angle must be below 45 deg"),
        ({"helix_angle": -0.1}, "helix_angle must be finite and not negative"),
        ({"rack": BasicRack(fillet_radius=0.6)}, "rack fillet_radius must be at most"),
        ({"module": 0.0}, "module must be positive"),
    ],
)
def test_what_cannot_be_made_is_refused_by_its_field(options, message):
    given: dict[str, Any] = {"module": 2e-3, **options}
    driver, driven = (
        ToothedWheel(given.pop(f"z{i}", z), 20e-3, 4e-3, given.pop(f"x{i}", 0.0)) for i, z in ((1, 20), (2, 40))
    )
    with pytest.raises(ValueError, match=message):
        GearPair(driver, driven, **given)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"hub_radius": 18e-3}, "driver hub_radius must be below the root radius, 17.5 mm, got 18 mm"),
        (
            {"truncation": -0.6e-3},
            "driver truncation must leave the tip clear of the driven's root",
        ),
        ({"truncation": 4.2e-3}, "driver truncation must leave some involute"),
    ],
)
def test_a_wheel_that_cannot_mesh_is_refused_by_its_field(fields, message):
    driver = ToothedWheel(**{"teeth": 20, "face_width": 20e-3, "hub_radius": 5e-3, **fields})
    with pytest.raises(ValueError, match=message):
        GearPair(driver, ToothedWheel(40, 20e-3, 10e-3), 2e-3)


def test_interference_of_the_mating_tip_is_refused():
    rack = BasicRack(addendum=1.2)
    with pytest.raises(ValueError, match="interference, the mating tip reaches"):
        GearPair(ToothedWheel(20, 20e-3, 5e-3), ToothedWheel(120, 20e-3, 20e-3), 2e-3, rack=rack)
