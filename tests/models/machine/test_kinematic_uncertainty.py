"""Uncertainty of the fault frequencies: against finite differences, and the alternatives of a count."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from models.machine.bearing import (
    KNOWN,
    Bearing,
    CatalogueEntry,
    catalogue,
    catalogue_entry,
    kinematics,
    kinematics_uncertainty,
    with_count,
)
from models.machine.catalogue.series import GeometryOrigin, geometry

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
