"""k_c with its bound: it holds the values that full geometry gives, and answers for every bearing.

Line contacts: Palmgren, Houpert and Lundberg against formulas of others that share nothing with them.

Tripp's and Kowalsky's approaches are those of the theory of elasticity for cylinders of infinite length (Table 1 of
Teutsch and Sauer, 2004); the case of Houpert's own comparison is that of Fig. 3 there.
"""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from models.machine.bearing import Bearing, CatalogueEntry, catalogue, catalogue_entry
from models.machine.catalogue.series import GeometryOrigin, families
from models.machine.contact_estimates import (
    LINE_CONTACTS,
    LineContact,
    estimate_stiffness,
    line_contact_approaches,
    line_contact_stiffness,
)
from models.machine.hertz import ROLLER_EXPONENT, contact_stiffness

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


COMPLIANCE = (1.0 - 0.3**2) / 210e9
CASE = Bearing(
    designation="case of Houpert",
    n_elements=9,
    element_diameter=20e-3,
    pitch_diameter=60e-3,
    element="roller",
    inner_race_radius=20e-3,
    outer_race_radius=40e-3,
    effective_length=30e-3,
)
BACKING = 6e-3
FORCES = (300.0, 3e3, 1e4)


def half_width(bearing: Bearing, curvature: float, force: float) -> float:
    assert bearing.effective_length is not None
    return math.sqrt(8.0 * COMPLIANCE * force / (math.pi * curvature * bearing.effective_length))


def cylinders(bearing: Bearing, force: float, factor: float, inner: float, outer: float) -> tuple[float, float]:
    """Return approaches with ln(factor * radius / b) less a constant of either body."""
    r_b, r_i, r_o = 0.5 * bearing.element_diameter, bearing.inner_race_radius, bearing.outer_race_radius
    assert r_i is not None
    assert r_o is not None
    assert bearing.effective_length is not None
    scale = 2.0 * force / (math.pi * bearing.effective_length) * COMPLIANCE
    b_i, b_o = half_width(bearing, 1.0 / r_b + 1.0 / r_i, force), half_width(bearing, 1.0 / r_b - 1.0 / r_o, force)
    return (
        scale * (math.log(factor * r_b / b_i) + math.log(factor * r_i / b_i) - 2.0 * inner),
        scale * (math.log(factor * r_b / b_o) - inner + math.log(0.5 * factor * BACKING / b_o) - outer),
    )


def tripp(bearing: Bearing, force: float) -> tuple[float, float]:
    return cylinders(bearing, force, 4.0, 0.5, 0.3 / 1.4)


def kowalsky(bearing: Bearing, force: float) -> tuple[float, float]:
    return cylinders(bearing, force, 2.0, -0.407, -0.407)


@pytest.mark.parametrize("force", FORCES)
def test_houpert_follows_the_theory_that_it_is_fitted_to(force: float) -> None:
    """Within 3 % at the inner race; at the outer one it departs under high loads, as the comparison there shows."""
    inner, outer = line_contact_approaches(CASE, force, "houpert", backing=BACKING)
    for theory in (tripp, kowalsky):
        assert inner == pytest.approx(theory(CASE, force)[0], rel=0.055)
        assert outer == pytest.approx(theory(CASE, force)[1], rel=0.09)
    assert inner == pytest.approx(tripp(CASE, force)[0], rel=0.03)


@pytest.mark.parametrize("force", FORCES)
def test_palmgren_follows_it_at_the_inner_race_and_is_softer_at_the_outer_one(force: float) -> None:
    inner, outer = line_contact_approaches(CASE, force)
    theory = tripp(CASE, force)
    assert inner == pytest.approx(theory[0], rel=0.09)
    assert 1.15 < outer / theory[1] < 1.35


@pytest.mark.parametrize("force", FORCES)
def test_a_crowned_roller_yields_more(force: float) -> None:
    """Lundberg's formula as Harris writes it, ln(pi E' L^2 / (Q (1 -+ D/d_m))), has another constant."""
    found = line_contact_approaches(CASE, force, "lundberg")
    assert sum(found) > 1.03 * sum(line_contact_approaches(CASE, force))
    ratio, length = 1.0 / 3.0, 30e-3
    scale = 2.0 * force / (math.pi * length) * COMPLIANCE
    harris = [scale * math.log(math.pi * length**2 / (COMPLIANCE * force * (1.0 + s * ratio))) for s in (-1.0, 1.0)]
    assert list(found) == pytest.approx(harris, rel=0.14)


@pytest.mark.parametrize("formula", LINE_CONTACTS)
def test_k_c_has_the_approach_of_its_formula(formula: LineContact) -> None:
    bearing = catalogue()["NU 202 ECP"]
    for force in (50.0, 2e3):
        k_c = line_contact_stiffness(bearing, force, formula)
        approach = sum(line_contact_approaches(bearing, force, formula))
        assert k_c * approach**ROLLER_EXPONENT == pytest.approx(force, rel=1e-12)
    palmgren = line_contact_stiffness(bearing, 100.0)
    assert palmgren == pytest.approx(contact_stiffness(bearing), rel=1e-12)


@pytest.mark.parametrize(("formula", "low", "high"), [("houpert", 0.86, 1.10), ("lundberg", 0.84, 0.99)])
def test_formulas_differ_by_this_much_over_the_catalogue(formula: LineContact, low: float, high: float) -> None:
    """The figures of docs/evidence/catalogue.md: loads of 0.5 to 20 kN."""
    ratios: list[float] = []
    for designation in ("NU 202 ECP", "22207", "NU205", "30205", "ZA-2115"):
        entry = catalogue_entry(designation)
        palmgren = estimate_stiffness(entry)
        assert palmgren.force is None
        for load in (500.0, 2e3, 2e4):
            found = estimate_stiffness(entry, formula, load)
            assert found.low <= found.value <= found.high
            assert ("backing" in found.estimated) == (formula == "houpert")
            assert found.force is not None
            ratios.append(found.value / palmgren.value)
    assert low < min(ratios) < 1.0
    assert 0.96 < max(ratios) < high


def test_a_formula_that_needs_a_load_says_so() -> None:
    with pytest.raises(ValueError, match="22207 after houpert needs a load"):
        estimate_stiffness(catalogue_entry("22207"), "houpert")
    with pytest.raises(ValueError, match="force must be positive"):
        line_contact_approaches(CASE, 0.0, "houpert")
    with pytest.raises(ValueError, match=r"22207.*effective_length"):
        line_contact_approaches(catalogue()["22207"], 100.0, "houpert")
    balls = estimate_stiffness(catalogue_entry("6205"), "houpert")
    assert balls == estimate_stiffness(catalogue_entry("6205"))
