"""Load zones under radial and axial load: closed forms, equilibrium of the smeared elements, limits."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.machine.bearing import Bearing, from_catalogue
from models.machine.hertz import (
    bearing_stiffness,
    contact_forces,
    element_angles,
    mean_bearing_stiffness,
    static_equilibrium,
)
from models.machine.load_distribution import (
    LoadZone,
    conforming,
    elements_in_zone,
    largest_element_load,
    load_distribution,
    load_integral,
    load_zone,
    load_zones,
    ring_approach,
    stiffness_against_load,
    stiffness_over_passage,
    working_angle,
    zone_integrals,
)
from models.machine.scene import Defect
from tests.support.effort import effort_count

BEARING = from_catalogue("1205 ETN9")
ROLLER = from_catalogue("NU 202 ECP")
K_C = 5927e6
clearances = st.one_of(st.just(0.0), st.floats(-7.0, -4.0).map(lambda x: 10.0**x))


@given(st.floats(0.001, 0.5), st.sampled_from([1.5, 10.0 / 9.0]))
def test_load_integral_is_the_mean_over_the_ring(extent: float, exponent: float) -> None:
    count = effort_count(quick=100_000, full=400_000)
    psi = (np.arange(count) + 0.5) * (2.0 * math.pi / count) - math.pi
    share = np.maximum(1.0 - (1.0 - np.cos(psi)) / (2.0 * extent), 0.0) ** exponent * np.cos(psi)
    assert load_integral(extent, exponent) == pytest.approx(float(np.mean(share)), rel=1e-6)


@pytest.mark.parametrize("extent", [0.0, -0.1, 0.6, math.nan])
def test_load_integral_refuses_what_no_ring_has(extent: float) -> None:
    with pytest.raises(ValueError, match="load factor"):
        load_integral(extent, 1.5)


@given(st.floats(0.0, 5.0), clearances)
def test_smeared_elements_carry_the_load(log_load: float, clearance: float) -> None:
    load = 10.0**log_load
    approach = ring_approach(BEARING, load, K_C, clearance)
    count = effort_count(quick=50_000, full=200_000)
    psi = (np.arange(count) + 0.5) * (2.0 * math.pi / count) - math.pi
    delta = np.maximum(approach * np.cos(psi) - clearance, 0.0)
    assert 24 * float(np.mean(K_C * delta**1.5 * np.cos(psi))) == pytest.approx(load, rel=1e-4)
    largest = largest_element_load(BEARING, load, K_C, clearance)
    assert largest == pytest.approx(K_C * (approach - clearance) ** 1.5, rel=1e-12)


def test_many_elements_are_as_good_as_smeared_ones() -> None:
    # 24 staggered balls without clearance: sum and integral agree to a fraction of a percent.
    found = load_distribution(BEARING, 2000.0, K_C)
    assert found.loads.max() == pytest.approx(largest_element_load(BEARING, 2000.0, K_C), rel=1e-3)
    assert found.displacement[0] == pytest.approx(ring_approach(BEARING, 2000.0, K_C), rel=1e-3)


@pytest.mark.parametrize(("load", "clearance"), [(0.0, 0.0), (math.nan, 0.0), (1.0, -1e-6), (1.0, math.inf)])
def test_impossible_loads_are_refused(load: float, clearance: float) -> None:
    with pytest.raises(ValueError, match="must be finite and"):
        ring_approach(BEARING, load, K_C, clearance)


def test_load_zone() -> None:
    assert load_zone(1e-5) == pytest.approx(math.pi)
    assert load_zone(2e-5, 1e-5) == pytest.approx(2.0 * math.pi / 3.0)
    assert load_zone(1e-5, 1e-5) == 0.0
    assert [elements_in_zone(ROLLER, math.radians(x)) for x in (10.0, 66.0, 138.0)] == [1, 2, 3]


@given(st.floats(0.0, 4.5), clearances, st.floats(-7.0, 7.0))
def test_element_loads_balance(log_load: float, clearance: float, turn: float) -> None:
    load = 10.0**log_load
    for bearing in (BEARING, ROLLER):
        found = load_distribution(bearing, load, K_C, clearance=clearance, cage_angle=turn)
        assert np.all(np.abs(found.angles) <= math.pi * (1.0 + 1e-12))
        assert np.all(found.loads >= 0.0)
        assert float(found.loads @ np.cos(found.angles)) == pytest.approx(load, rel=1e-6)
        assert float(found.loads @ np.sin(found.angles)) == pytest.approx(0.0, abs=1e-6 * load)


def test_healthy_passage_is_the_stiffness_of_each_angle() -> None:
    found = stiffness_over_passage(BEARING, 1000.0, K_C, points=24)
    for turn, matrix in zip(found.cage_angle, found.matrix, strict=True):
        expected = bearing_stiffness(BEARING, 1000.0, K_C, cage_angle=float(turn))
        assert matrix == pytest.approx(expected, rel=1e-9, abs=1.0)
    # The stiffness across has a kink wherever a ball gains contact, so 24 points leave some of a mean over 64.
    assert found.mean == pytest.approx(mean_bearing_stiffness(BEARING, 1000.0, K_C), rel=3e-3, abs=1e3)
    # The rows are staggered by half a spacing, so the passage repeats after that.
    assert found.matrix[:12] == pytest.approx(found.matrix[12:], rel=1e-6, abs=1e3)


def test_a_ball_over_a_deep_defect_is_missing() -> None:
    defect = Defect(math.radians(8.0), 1e-3)
    found = stiffness_over_passage(BEARING, 1000.0, K_C, defect=defect, points=12)
    angles = element_angles(BEARING)[1:]
    u = static_equilibrium(angles, 1000.0, K_C)
    delta = np.maximum(u[0] * np.cos(angles) + u[1] * np.sin(angles), 0.0)
    k_yy = float(np.sum(1.5 * K_C * np.sqrt(delta) * np.cos(angles) ** 2))
    assert found.matrix[0, 0, 0] == pytest.approx(k_yy, rel=1e-6)
    assert found.swing[0] > 0.1
    assert found.largest_coupling > 0.0


def test_a_defect_without_depth_or_out_of_the_load_changes_nothing() -> None:
    healthy = stiffness_over_passage(BEARING, 1000.0, K_C, points=12).matrix
    for defect in (Defect(0.1, 0.0), Defect(0.0, 1e-5), Defect(0.1, 1e-4, position=math.pi)):
        damaged = stiffness_over_passage(BEARING, 1000.0, K_C, defect=defect, points=12).matrix
        assert damaged == pytest.approx(healthy, rel=1e-9, abs=1.0)


def test_both_rows_damaged_lose_twice() -> None:
    one = stiffness_over_passage(BEARING, 1000.0, K_C, defect=Defect(0.3, 5e-6), points=24)
    both = stiffness_over_passage(BEARING, 1000.0, K_C, defect=Defect(0.3, 5e-6, rows=2), points=24)
    assert both.mean[0, 0] < one.mean[0, 0]
    assert both.matrix[:12] == pytest.approx(both.matrix[12:], rel=1e-6, abs=1e3)


def test_a_roller_in_a_deep_pit_carries_nothing() -> None:
    passage = stiffness_over_passage(ROLLER, 1000.0, 3.7e8, defect=Defect(0.1, 1e-3), points=12)
    angles = element_angles(ROLLER)
    others = angles[np.abs(angles) > 0.1]
    assert len(others) == ROLLER.n_elements - 1
    u = static_equilibrium(others, 1000.0, 3.7e8, exponent=10.0 / 9.0)
    assert passage.matrix[0] == pytest.approx(contact_forces(u, others, 3.7e8, 0.0, 10.0 / 9.0)[1], rel=1e-6, abs=1e3)
    healthy = stiffness_over_passage(ROLLER, 1000.0, 3.7e8, points=12)
    assert passage.matrix[6] == pytest.approx(healthy.matrix[6], rel=1e-6, abs=1e3)


def test_defects_that_a_bearing_cannot_have_are_refused() -> None:
    for wrong in (Defect(0.1, 1e-5, rows=3), Defect(0.1, 1e-5, rows=2, first_row=1)):
        with pytest.raises(ValueError, match="has 2 rows"):
            stiffness_over_passage(BEARING, 1000.0, K_C, defect=wrong)
    with pytest.raises(ValueError, match=r"defect\.part must be 'outer'"):
        stiffness_over_passage(BEARING, 1000.0, K_C, defect=Defect(0.1, 1e-5, part="inner"))


def test_the_second_row_passes_half_a_spacing_later() -> None:
    first = stiffness_over_passage(BEARING, 1000.0, K_C, defect=Defect(0.3, 5e-6), points=24)
    second = stiffness_over_passage(BEARING, 1000.0, K_C, defect=Defect(0.3, 5e-6, first_row=1), points=24)
    assert np.roll(second.matrix, 12, axis=0) == pytest.approx(first.matrix, rel=1e-6, abs=1e3)


def test_stiffness_along_the_load_is_the_slope_of_load_and_displacement() -> None:
    """Eq. 28: k = dF / d delta, here by central differences; k_yy alone where the arrangement is symmetric."""
    angles = element_angles(ROLLER)
    step = 1e-4

    def displacement(load: float) -> float:
        return float(static_equilibrium(angles, load, 3.7e8, clearance=5e-6, exponent=10.0 / 9.0)[0])

    for load in (100.0, 1000.0):
        slope = 2.0 * step * load / (displacement(load * (1.0 + step)) - displacement(load * (1.0 - step)))
        k_yy = bearing_stiffness(ROLLER, load, 3.7e8, clearance=5e-6)[0, 0]
        assert k_yy == pytest.approx(slope, rel=1e-5)


def test_stiffness_against_load() -> None:
    loads = [250.0, 1000.0, 4000.0]
    displacement, stiffness = stiffness_against_load(BEARING, loads, K_C)
    # Without clearance the law is exact: delta ~ F^(2/3), k ~ F^(1/3).
    assert displacement[1:] / displacement[:-1] == pytest.approx([4.0 ** (2.0 / 3.0)] * 2, rel=1e-6)
    assert stiffness[1:, 0, 0] / stiffness[:-1, 0, 0] == pytest.approx([4.0 ** (1.0 / 3.0)] * 2, rel=1e-6)
    assert stiffness[1] == pytest.approx(mean_bearing_stiffness(BEARING, 1000.0, K_C), rel=1e-9, abs=1e3)
    _, loose = stiffness_against_load(BEARING, loads, K_C, clearance=1e-5)
    assert np.all(loose[:, 1, 1] < stiffness[:, 1, 1])


BALL = Bearing("thrust", 12, 8e-3, 40e-3, contact_angle=math.radians(25.0))
DOUBLE = replace(BALL, rows=2, contact_angle=math.radians(12.0))
DEEP = conforming(from_catalogue("6205"))
RING = np.linspace(-np.pi, np.pi, 20001)[:-1]


def carried(bearing: Bearing, zones: tuple[LoadZone, ...], angle: float) -> tuple[float, float]:
    """Radial and axial load that smeared elements carry; the second row pushes the other way."""
    radial = axial = 0.0
    for sign, zone in zip((1.0, -1.0), zones, strict=False):
        load = zone.load(RING)
        radial += bearing.n_elements * math.cos(angle) * float(np.mean(load * np.cos(RING)))
        axial += sign * bearing.n_elements * math.sin(angle) * float(np.mean(load))
    return radial, axial


def test_integrals_in_closed_form() -> None:
    """At eps = 1 the share of balls is cos^3(psi / 2); at 1/2 both are quotients of gamma functions."""
    assert zone_integrals(1.0, 1.5) == pytest.approx((0.8 / math.pi, 4.0 / (3.0 * math.pi)), rel=1e-9)
    axial = math.gamma(1.25) / math.gamma(1.75) / (2.0 * math.sqrt(math.pi))
    radial = math.gamma(1.75) / math.gamma(2.25) / (2.0 * math.sqrt(math.pi))
    assert zone_integrals(0.5, 1.5) == pytest.approx((radial, axial), rel=1e-9)
    assert zone_integrals(0.3, 1.5)[0] == pytest.approx(load_integral(0.3, 1.5), rel=1e-9)
    assert zone_integrals(math.inf, 1.5) == (0.0, 1.0)
    radial, axial = zone_integrals(9e4, 1.5)
    assert (radial, axial) == pytest.approx((0.0, 1.0), abs=1e-5)
    with pytest.raises(ValueError, match="load factor"):
        zone_integrals(0.0, 1.5)


def test_without_axial_load_or_clearance_half_the_ring_is_loaded() -> None:
    (zone,) = load_zones(DEEP, 1000.0)
    assert zone.factor == 0.5
    assert zone.largest == pytest.approx(1000.0 / (9 * load_integral(0.5, 1.5)))
    assert zone.load(np.array([0.0, 0.5 * np.pi, np.pi])) == pytest.approx([zone.largest, 0.0, 0.0], abs=1e-9)


def test_clearance_narrows_the_zone() -> None:
    k_c = 5e9
    tight, loose = load_zones(DEEP, 1000.0, k_c=k_c)[0], load_zones(DEEP, 1000.0, clearance=20e-6, k_c=k_c)[0]
    assert 0.0 < loose.factor < tight.factor
    assert loose.largest == pytest.approx(largest_element_load(DEEP, 1000.0, k_c, 20e-6), rel=1e-9)
    assert load_zones(DEEP, 1000.0, clearance=20e-6)[0].factor == pytest.approx(loose.factor, rel=0.5)


@pytest.mark.parametrize("axial", [600.0, 1500.0, 8000.0, 1e6])
def test_a_row_balances_both_loads(axial: float) -> None:
    zones = load_zones(BALL, 1000.0, -axial)
    assert carried(BALL, zones, BALL.contact_angle) == pytest.approx((1000.0, axial), rel=1e-6)
    assert zones[0].factor > 0.5


def test_a_light_axial_load_changes_nothing() -> None:
    """Below 1.2 F_r tan a the row of an angular-contact bearing would lose its zone: it is kept as without one."""
    assert load_zones(BALL, 1000.0, 300.0) == load_zones(BALL, 1000.0)
    limit = 1000.0 * math.tan(BALL.contact_angle) * zone_integrals(0.5, 1.5)[1] / zone_integrals(0.5, 1.5)[0]
    assert load_zones(BALL, 1000.0, limit * 1.001)[0].factor == pytest.approx(0.5, abs=1e-2)


@pytest.mark.parametrize("axial", [-3000.0, -500.0, -20.0, 20.0, 200.0, 250.0, 1000.0, 1e5])
def test_two_rows_balance_both_loads(axial: float) -> None:
    zones = load_zones(DOUBLE, 1000.0, axial)
    assert carried(DOUBLE, zones, DOUBLE.contact_angle) == pytest.approx((1000.0, axial), rel=1e-6)
    first, second = (zone.factor for zone in zones)
    assert (first > second) == (axial > 0.0)
    if min(first, second) > 0.0:
        assert first + second == pytest.approx(1.0)


def test_axial_load_alone_loads_all_elements_alike() -> None:
    angle = BALL.contact_angle
    (zone,) = load_zones(BALL, 0.0, -2000.0)
    assert zone.load(RING) == pytest.approx(2000.0 / (12 * math.sin(angle)))
    first, second = load_zones(DOUBLE, 0.0, -2000.0)
    assert (first.largest, second.factor) == (0.0, math.inf)
    assert np.all(first.load(RING) == 0.0)
    assert load_zones(BALL, 0.0) == (LoadZone(0.5, 0.0, 1.5),)


def test_a_deep_groove_finds_its_angle_under_the_axial_load() -> None:
    k_c = 5e9
    angle = working_angle(DEEP, 500.0, k_c)
    assert DEEP.inner_groove_radius is not None
    distance = 2.0 * DEEP.inner_groove_radius - DEEP.element_diameter
    approach = distance * (1.0 / math.cos(angle) - 1.0)
    assert 9 * k_c * approach**1.5 * math.sin(angle) == pytest.approx(500.0, rel=1e-9)
    assert working_angle(DEEP, 2000.0, k_c) > angle
    assert working_angle(DEEP, 0.0, k_c) == 0.0
    zones = load_zones(DEEP, 1000.0, 500.0, k_c=k_c)
    assert carried(DEEP, zones, angle) == pytest.approx((1000.0, 500.0), rel=1e-6)


def test_a_given_factor_is_taken_for_all_rows() -> None:
    zones = load_zones(DOUBLE, 1000.0, 500.0, factor=0.3)
    assert [zone.factor for zone in zones] == [0.3, 0.3]
    assert carried(DOUBLE, zones, DOUBLE.contact_angle)[0] == pytest.approx(1000.0, rel=1e-6)


@pytest.mark.parametrize(
    ("bearing", "load", "word"),
    [
        (replace(DEEP, element="roller", effective_length=8e-3), 1000.0, "rollers without a contact angle"),
        (replace(DEEP, rows=2), 1000.0, "several rows without a contact angle"),
        (replace(BALL, rows=3, inner_groove_radius=4.2e-3, outer_groove_radius=4.2e-3), 1000.0, "3 rows"),
        (replace(BALL, rows=3), 0.0, "3 rows"),
        (from_catalogue("6205"), 1000.0, "inner_race_radius, which is unknown"),
    ],
)
def test_what_cannot_carry_it_is_refused(bearing: Bearing, load: float, word: str) -> None:
    given = bearing if word.endswith("unknown") else conforming(bearing)
    with pytest.raises(ValueError, match=word):
        load_zones(given, load, 100.0)
