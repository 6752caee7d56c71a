"""k_c with its bound: it holds the values that full geometry gives, and answers for every bearing."""

from __future__ import annotations

from dataclasses import replace

import pytest

from models.machine.bearing import CatalogueEntry, catalogue, catalogue_entry
from models.machine.catalogue.series import GeometryOrigin, families
from models.machine.contact_estimates import estimate_stiffness
from models.machine.hertz import contact_stiffness

FULL = ("1205 ETN9", "6210", "NU 202 ECP")


def test_every_bearing_has_an_answer() -> None:
    """All entries; the bound spans a factor of 1.9 at most, and of 1.4 for rollers of a known length."""
    designations = [*catalogue(), *families()]
    assert len(designations) > 300
    for designation in designations:
        entry = catalogue_entry(designation)
        found = estimate_stiffness(entry)
        assert 0.0 < found.low <= found.value <= found.high, designation
        assert contact_stiffness(found.bearing) == found.value, designation
        assert bool(found.estimated) == (designation not in FULL), designation
        assert (found.low < found.value < found.high) == bool(found.estimated), designation
        widest = 1.9 if entry.bearing.effective_length is None else 1.4
        assert found.high / found.low < widest, designation


@pytest.mark.parametrize("designation", FULL)
def test_the_bound_holds_the_value_of_the_full_geometry(designation: str) -> None:
    bearing = catalogue()[designation]
    stripped = replace(
        bearing,
        outer_race_radius=None,
        inner_race_radius=None,
        inner_groove_radius=None,
        outer_groove_radius=None,
        effective_length=None,
    )
    found = estimate_stiffness(CatalogueEntry(stripped, {}, ((bearing.n_elements, 1.0),)))
    assert found.low <= contact_stiffness(bearing) <= found.high
    assert found.high / found.low < 2.0, "the bound says something"


def test_estimated_diameters_widen_the_bound() -> None:
    entry = catalogue_entry("6310")
    exact = replace(entry, origins={**entry.origins, "element_diameter": GeometryOrigin("measured")})
    wide, narrow = estimate_stiffness(entry), estimate_stiffness(exact)
    assert wide.value == narrow.value
    assert wide.low < narrow.low
    assert wide.high > narrow.high
    assert "element_diameter" not in narrow.estimated


def test_the_length_of_a_roller_comes_from_its_series() -> None:
    found = estimate_stiffness(catalogue_entry("22207"))
    assert "effective_length" in found.estimated
    assert found.bearing.effective_length == pytest.approx(8.5e-3, abs=0.2e-3)
    alone = estimate_stiffness(catalogue_entry("MFPT"))
    assert alone.bearing.effective_length == pytest.approx(1.2 * alone.bearing.element_diameter)
