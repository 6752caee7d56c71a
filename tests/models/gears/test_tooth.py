"""Compliance of teeth against slow sums, closed forms, fracture mechanics and plane finite elements."""

from __future__ import annotations

import math

import numpy as np
import pytest

from models.gears.teeth.geometry import GearPair, ToothedWheel
from models.gears.teeth.rack import BasicRack, ToothProfile
from models.gears.teeth.stiffness import iso_stiffness
from models.gears.teeth.tooth import (
    StiffnessMethod,
    beam_compliance,
    crack_compliance,
    critical_section,
    foundation_compliance,
    loaded_point,
    sainsot_factors,
    shared_compliance,
    tooth_compliance,
    wind_up,
)

WHEEL = ToothedWheel(30, 20e-3, 15e-3)
TOOTH = ToothProfile(30, 3e-3, math.radians(20.0), 0.0, 0.0, BasicRack())
ROLLS = np.linspace(TOOTH.roll(TOOTH.form_radius) + 0.02, TOOTH.roll(TOOTH.tip_radius), 5)


def test_the_beam_is_the_sum_over_thin_sections():
    dense = np.concatenate(
        [
            TOOTH.fillet(np.linspace(0.0, 1.0, 4000)),
            TOOTH.flank(np.linspace(TOOTH.roll(TOOTH.form_radius), 1.2, 40000)),
        ],
        axis=1,
    )
    for k, roll in enumerate(ROLLS):
        load = loaded_point(TOOTH, roll)
        x = np.linspace(dense[0, 0], float(load.x), 20001)
        middle = 0.5 * (x[1:] + x[:-1])
        y = np.interp(middle, *dense)
        arm = math.cos(load.angle) * (load.x - middle) - math.sin(load.angle) * load.y
        parts = (
            arm**2 * 12.0 / (2.0 * y) ** 3 / 206e9,
            1.2 * math.cos(load.angle) ** 2 / (2.0 * y) * 2.6 / 206e9,
            math.sin(load.angle) ** 2 / (2.0 * y) / 206e9,
        )
        sums = [float(np.sum(part * np.diff(x))) for part in parts]
        np.testing.assert_allclose(beam_compliance(TOOTH, WHEEL, ROLLS, "stress")[:, k], sums, rtol=2e-4)


def test_wind_up_is_the_shear_of_the_ring():
    radius = np.linspace(15e-3, TOOTH.root_radius, 20001)
    middle = 0.5 * (radius[1:] + radius[:-1])
    # Shear stress T / (2 pi r^2) turns each ring by its strain over its radius.
    turn = np.sum(TOOTH.base_radius / (math.tau * middle**3) * np.diff(radius)) * 2.6 / 206e9
    assert wind_up(TOOTH, WHEEL) == pytest.approx(TOOTH.base_radius * turn, rel=1e-6)


def test_the_fits_of_the_body_have_their_published_peaks():
    """Chaari et al. print the largest L* and P* of the fits' range as 6.94 and 13.47."""
    factors = [sainsot_factors(t, h) for t in np.linspace(0.01, 0.12, 60) for h in np.linspace(1.4, 7.0, 60)]
    largest = np.max(factors, axis=0)
    assert largest[0] == pytest.approx(6.94, rel=0.005)
    assert largest[2] == pytest.approx(13.47, rel=0.005)


# Compliance times E of the tooth with its body (at 5 places of the path of contact) and of the next one, by
# ``benchmarks.gears.plane_teeth`` with 150,000 unknowns: teeth, hub radius, mate, values.
ELEMENTS = [
    (30, 15e-3, 60, (4.611, 5.252, 6.553, 9.211, 15.176), 2.713),
    (60, 25e-3, 30, (5.408, 6.250, 7.743, 10.498, 16.053), 3.964),
    (20, 10e-3, 100, (5.154, 5.456, 6.545, 9.133, 15.492), 2.442),
]


@pytest.mark.parametrize(("teeth", "hub", "mate", "expected", "neighbour"), ELEMENTS)
def test_a_tooth_with_its_body_agrees_with_finite_elements(teeth, hub, mate, expected, neighbour):
    gears = GearPair(ToothedWheel(teeth, 20e-3, hub), ToothedWheel(mate, 20e-3, 25e-3), 3e-3)
    tooth, wheel = gears.profiles[0], gears.driver
    begin, end = gears.contact_path
    rolls = np.linspace(begin, end, 5) / tooth.base_radius
    found = [
        206e9 * tooth_compliance(tooth, wheel, rolls, StiffnessMethod(foundation=kind, shared_body=False))
        for kind in ("sainsot", "weber")
    ]
    # The two ways stand on both sides of the finite elements.
    assert np.all((found[0] > expected) & (found[0] < 1.09 * np.array(expected)))
    assert np.all((found[1] < expected) & (found[1] > 0.79 * np.array(expected)))
    assert 206e9 * shared_compliance(tooth, wheel, "stress") == pytest.approx(neighbour, rel=0.05)


def test_plane_strain_is_stiffer_and_the_shared_part_is_taken_off():
    whole = tooth_compliance(TOOTH, WHEEL, ROLLS, StiffnessMethod(shared_body=False))
    own = tooth_compliance(TOOTH, WHEEL, ROLLS, StiffnessMethod())
    np.testing.assert_allclose(whole - own, shared_compliance(TOOTH, WHEEL, "stress"))
    bodies = [
        foundation_compliance(TOOTH, WHEEL, ROLLS, plane=plane, foundation="sainsot") for plane in ("strain", "stress")
    ]
    np.testing.assert_allclose(bodies[0] / bodies[1], 0.91)


# Compliance times E that cracks straight across add, by ``benchmarks.gears.plane_teeth``: teeth, depth, at two rolls.
CRACKS = [(20, 0.5e-3, 0.2699, 0.7039), (20, 2e-3, 2.405, 7.633), (30, 1e-3, 0.5848, 1.820), (30, 3e-3, 3.751, 14.87)]


@pytest.mark.parametrize(("teeth", "depth", "at_pitch", "at_tip"), CRACKS)
def test_a_crack_adds_what_finite_elements_say(teeth, depth, at_pitch, at_tip):
    tooth = ToothProfile(teeth, 3e-3, math.radians(20.0), 0.0, 0.0, BasicRack())
    rolls = np.array([tooth.roll(tooth.reference_radius), tooth.roll(tooth.tip_radius) - 0.02])
    added = 206e9 * crack_compliance(tooth, ToothedWheel(teeth, 20e-3, 10e-3), rolls, depth, math.pi / 2.0, "stress")
    np.testing.assert_allclose(added, (at_pitch, at_tip), rtol=0.16)


def test_no_crack_adds_nothing_and_deeper_ones_add_more():
    depths = np.linspace(0.0, 3.5e-3, 30)
    added = np.array([crack_compliance(TOOTH, WHEEL, ROLLS, depth, math.pi / 2.0, "stress") for depth in depths])
    assert not added[0].any()
    assert np.all(np.diff(added[:, -3:], axis=0) > 0.0)
    assert np.all(added >= 0.0)


def test_the_critical_section_is_where_the_fillet_is_inclined_by_30_degrees():
    x, y = critical_section(TOOTH)
    fillet = np.array(TOOTH.fillet(np.linspace(0.0, 1.0, 20001)))
    k = int(np.argmin(np.hypot(fillet[0] - x, fillet[1] - y)))
    dx, dy = fillet[:, k + 1] - fillet[:, k - 1]
    assert math.degrees(math.atan2(-dy, dx)) == pytest.approx(30.0, abs=0.2)


def test_a_crack_through_the_tooth_is_refused():
    with pytest.raises(ValueError, match=r"crack depth must be from 0 to 5\.\d+ mm, got 6 mm"):
        crack_compliance(TOOTH, WHEEL, ROLLS, 6e-3, math.pi / 2.0, "stress")


def test_iso_gives_its_own_round_figures_for_ordinary_gears():
    """The standard's method C says c' = 14 and c_gamma = 20 N/(mm um) for average spur gears."""
    iso = iso_stiffness(GearPair(ToothedWheel(25, 20e-3, 10e-3), ToothedWheel(60, 20e-3, 20e-3), 3e-3))
    assert iso.single / 1e9 == pytest.approx(14.0, rel=0.05)
    assert iso.mesh / 1e9 == pytest.approx(20.0, rel=0.05)
    assert iso.valid


def test_iso_is_not_valid_for_small_loads_and_wheels_with_the_larger_shift():
    gears = GearPair(ToothedWheel(25, 20e-3, 10e-3), ToothedWheel(60, 20e-3, 20e-3), 3e-3)
    light = iso_stiffness(gears, 100.0)
    assert not light.valid
    assert light.single == pytest.approx(iso_stiffness(gears).single * 0.05**0.25)
    shifted = GearPair(ToothedWheel(25, 20e-3, 10e-3), ToothedWheel(60, 20e-3, 20e-3, 0.3), 3e-3)
    assert not iso_stiffness(shifted, 4000.0).valid
