"""Uncertainty of the fault frequencies: against finite differences, and the alternatives of a count."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.machine.bearing import (
    KNOWN,
    Bearing,
    CatalogueEntry,
    catalogue,
    catalogue_entry,
    from_catalogue,
    kinematics,
    kinematics_uncertainty,
    with_count,
)
from models.machine.catalogue.series import GeometryOrigin, geometry

REQUIRED = ("1205 ETN9", "6203", "6205", "6206", "6210", "6305", "NU 202 ECP", "22207", "PRONOSTIA", "MFPT", "ZA-2115")


@pytest.mark.parametrize("designation", REQUIRED)
def test_the_catalogue_has_it_with_its_source(designation: str) -> None:
    assert len(from_catalogue(designation).source) > 10


def test_an_unknown_designation_lists_the_known_ones() -> None:
    with pytest.raises(KeyError, match=r"9999.*1205 ETN9"):
        from_catalogue("9999")


def test_geometry_of_the_catalogue_is_possible() -> None:
    for bearing in catalogue().values():
        r_b, r_p = 0.5 * bearing.element_diameter, 0.5 * bearing.pitch_diameter
        assert 2.0 * r_p * math.sin(math.pi / bearing.n_elements) > 2.0 * r_b, "elements overlap"
        if bearing.outer_race_radius is not None and bearing.inner_race_radius is not None:
            room = bearing.outer_race_radius - bearing.inner_race_radius
            assert room == pytest.approx(2.0 * r_b, rel=0.13), bearing.designation


# Multiples of the shaft frequency as the sources of the recordings print them.
@pytest.mark.parametrize(
    ("designation", "ftf", "bpfo", "bpfi", "twice_bsf"),
    [
        ("6205", 0.3983, 3.585, 5.415, 4.714),
        ("6203", 0.3817, 3.053, 4.947, 3.987),
        ("PRONOSTIA", 0.4316, 5.611, 7.389, 7.178),
        ("ZA-2115", 14.8 / 33.333, 236.4 / 33.333, 296.9 / 33.333, 279.8 / 33.333),
        ("MFPT", 10.14 / 25.0, 81.125 / 25.0, 118.875 / 25.0, 2.0 * 63.91 / 25.0),
    ],
)
def test_multiples_of_the_shaft(designation: str, ftf: float, bpfo: float, bpfi: float, twice_bsf: float) -> None:
    k = kinematics(from_catalogue(designation), 1.0)
    assert (k.ftf, k.bpfo, k.bpfi, 2.0 * k.bsf) == pytest.approx((ftf, bpfo, bpfi, twice_bsf), rel=2e-3)


@given(
    st.integers(5, 30),
    st.floats(1e-3, 2e-2),
    st.floats(4.0, 12.0),
    st.floats(0.0, 0.7),
    st.floats(0.1, 1e3),
    st.sampled_from(["inner", "outer"]),
)
def test_identities_of_pure_rolling(
    n: int, diameter: float, ratio: float, angle: float, speed: float, ring: str
) -> None:
    bearing = Bearing("x", n, diameter, ratio * diameter, angle, rotating_ring="inner" if ring == "inner" else "outer")
    k = kinematics(bearing, speed)
    assert k.bpfo + k.bpfi == pytest.approx(n * speed)
    still, turning = (k.ftf, speed - k.ftf) if ring == "inner" else (speed - k.ftf, k.ftf)
    assert k.bpfo == pytest.approx(n * still)
    assert k.bpfi == pytest.approx(n * turning)


@pytest.mark.parametrize("speed", [0.0, -1.0, math.nan, math.inf])
def test_a_speed_that_is_none_is_refused(speed: float) -> None:
    with pytest.raises(ValueError, match="speed must be positive"):
        kinematics(from_catalogue("6205"), speed)


BEARING = Bearing("x", 12, 7.1e-3, 38.5e-3, math.radians(25.0))
RATES = ("bpfo", "bpfi", "ftf", "bsf")


def test_measured_and_tabled_entries_are_taken_as_exact() -> None:
    for designation in catalogue():
        found = kinematics_uncertainty(catalogue_entry(designation))
        assert (found == KNOWN) == (designation != "22207"), designation


@pytest.mark.parametrize("ring", ["inner", "outer"])
@pytest.mark.parametrize(
    ("name", "spread", "moved"),
    [
        ("element_diameter", 0.02, {"element_diameter": 7.1e-3 * (1.0 + 1e-5)}),
        ("pitch_diameter", 0.005, {"pitch_diameter": 38.5e-3 * (1.0 + 1e-5)}),
        ("contact_angle", 0.03, {"contact_angle": math.radians(25.0) + 1e-5}),
    ],
)
def test_spreads_follow_the_derivatives(ring: str, name: str, spread: float, moved: dict[str, float]) -> None:
    bearing = replace(BEARING, rotating_ring="inner" if ring == "inner" else "outer")
    entry = CatalogueEntry(bearing, {name: GeometryOrigin("estimated", spread)}, ((12, 1.0),))
    found = kinematics_uncertainty(entry)
    here, there = kinematics(bearing, 1.0), kinematics(replace(bearing, **moved), 1.0)
    for rate in RATES:
        slope = (getattr(there, rate) / getattr(here, rate) - 1.0) / 1e-5
        assert getattr(found, rate) == pytest.approx(abs(slope) * spread, rel=1e-3), rate


def test_another_number_is_another_place_and_no_spread() -> None:
    entry = CatalogueEntry(BEARING, {}, ((12, 0.8), (11, 0.12), (13, 0.07), (14, 0.01)))
    found = kinematics_uncertainty(entry)
    assert (found.bpfo, found.bpfi, found.bsf) == (0.0, 0.0, 0.0)
    assert not found.known
    assert len(found.bpfo_places) == 2, "what is less likely than 2 % is left out"
    fewer = with_count(BEARING, 11)
    assert fewer.element_diameter > BEARING.element_diameter
    assert found.bpfo_places[0] == pytest.approx(kinematics(fewer, 7.0).bpfo / kinematics(BEARING, 7.0).bpfo)
    assert found.bpfi_places[1] > 1.0 > found.bpfi_places[0]


# 6305 of JTEKT has eight balls, that of Ceruti (2021) seven: its frequencies are at the place of the other number.
def test_the_other_maker_stands_at_another_place() -> None:
    found = geometry("6305")
    bearing = Bearing("6305", found.n_elements, found.element_diameter, found.pitch_diameter)
    uncertainty = kinematics_uncertainty(CatalogueEntry(bearing, found.origins, found.counts))
    other = kinematics(catalogue()["6305"], 1.0)
    mine = kinematics(bearing, 1.0)
    assert any(abs(mine.bpfo * place / other.bpfo - 1.0) < 2.0 * uncertainty.bpfo for place in uncertainty.bpfo_places)
