"""Sub-model of section 3.3: similarity, closed form, equilibrium; it needs the extra fe."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from models.fe.extra import has_extra
from models.fe.meshes.geometry import FeGeometry, Race, fe_geometry
from models.fe.meshes.sizing import MeshRule
from models.machine.bearing import catalogue_entry

if not has_extra():
    pytest.skip("extra fe (scikit-fem) is not installed", allow_module_level=True)

from models.fe.submodel.sector import SectorState, sector

RULE = MeshRule(patch=1.5, size=0.75, growth=3.0, along=2, end=1.0)
LENGTHS = (
    *("element_radius", "inner_race_radius", "outer_race_radius", "bore_radius", "outside_radius", "width"),
    *("effective_length", "roller_length", "edge_radius"),
)


@pytest.fixture(scope="module")
def geometry() -> FeGeometry:
    return fe_geometry(catalogue_entry("NU 202 ECP"))


@pytest.fixture(scope="module")
def loaded(geometry: FeGeometry) -> SectorState:
    return sector(geometry, 500.0, RULE)


def test_a_larger_bearing_under_the_same_stress_is_similar(geometry: FeGeometry, loaded: SectorState) -> None:
    twice = replace(geometry, **{name: 2.0 * float(getattr(geometry, name)) for name in LENGTHS})
    found = sector(twice, 2000.0, RULE)
    assert found.approach == pytest.approx(2.0 * loaded.approach, rel=1e-6)
    assert found.peak_pressure["inner"] == pytest.approx(loaded.peak_pressure["inner"], rel=1e-4)


def test_half_elements_meet_the_closed_form_of_a_cylinder(geometry: FeGeometry, loaded: SectorState) -> None:
    # Johnson, Contact Mechanics, Eq. 5.57 for one half; a finite length with free ends yields a few per cent less.
    assert geometry.effective_length is not None
    line = loaded.force / geometry.effective_length
    factor = line * (1.0 - geometry.poisson**2) / (math.pi * geometry.modulus)
    signs: dict[Race, float] = {"inner": 1.0, "outer": -1.0}
    for race, sign in signs.items():
        curvature = 1.0 / geometry.element_radius + sign / geometry.race_radius(race)
        width = math.sqrt(8.0 * line * (1.0 - geometry.poisson**2) / (math.pi * curvature * geometry.modulus))
        closed = factor * (2.0 * math.log(4.0 * geometry.element_radius / width) - 1.0)
        assert loaded.parts[race][0] == pytest.approx(closed, rel=0.08)


def test_the_stiffness_is_that_of_force_and_approach(loaded: SectorState) -> None:
    assert loaded.k_c == pytest.approx(loaded.force / loaded.approach ** (10.0 / 9.0))
    assert sum(sum(part) for part in loaded.parts.values()) == pytest.approx(loaded.approach)
    assert np.isfinite(loaded.seconds)
