"""Load zones under radial and axial load: closed forms, equilibrium of the smeared elements, limits."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from models.machine.bearing import Bearing, from_catalogue
from models.machine.load_distribution import (
    LoadZone,
    conforming,
    largest_element_load,
    load_integral,
    load_zones,
    working_angle,
    zone_integrals,
)

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
