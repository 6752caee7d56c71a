from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from models.fe.meshes.geometry import FeGeometryError, fe_geometry
from models.fe.meshes.sizing import MeshRule, contact_grid, groove_reach, half_sizes
from models.machine.bearing import Bearing, CatalogueEntry, catalogue_entry
from models.machine.hertz import contact_patches
from models.words.errors import WrongInputError


def test_the_bearings_of_the_chapter():
    roller = fe_geometry(catalogue_entry("NU 202 ECP"))
    assert (roller.bore_radius, roller.outside_radius, roller.width) == pytest.approx((7.5e-3, 17.5e-3, 11e-3))
    assert roller.roller_length == pytest.approx(6e-3)
    assert roller.edge_radius == pytest.approx(0.2e-3)
    ball = fe_geometry(catalogue_entry("6210"))
    assert (ball.bore_radius, ball.outside_radius, ball.width) == pytest.approx((25e-3, 45e-3, 20e-3))
    assert groove_reach(ball, "inner") == pytest.approx(5.18e-3, rel=1e-2)
    assert not ball.spherical_outer
    assert fe_geometry(catalogue_entry("1205 ETN9")).spherical_outer


def test_a_series_has_its_races_from_the_pitch():
    found = fe_geometry(catalogue_entry("NU 204"))
    assert found.outer_race_radius - found.inner_race_radius == pytest.approx(2.0 * found.element_radius)


def test_what_is_unknown_is_named():
    with pytest.raises(FeGeometryError, match="6203: inner_groove_radius is unknown"):
        fe_geometry(catalogue_entry("6203"))
    with pytest.raises(FeGeometryError, match="dimensions"):
        fe_geometry(catalogue_entry("MFPT"))
    with pytest.raises(FeGeometryError, match="inner_race_radius is unknown"):
        fe_geometry(catalogue_entry("22207"))
    tapered = Bearing("taper", 17, 8e-3, 50e-3, contact_angle=0.2, element="roller", effective_length=9e-3)
    with pytest.raises(FeGeometryError, match=r"contact_angle .* tapered"):
        fe_geometry(CatalogueEntry(tapered, {}, ((17, 1.0),), dimensions=(30e-3, 72e-3, 19e-3)))


def test_contradictions_are_named():
    roller, ball = fe_geometry(catalogue_entry("NU 202 ECP")), fe_geometry(catalogue_entry("6210"))
    for wrong, name in (
        ({"bore_radius": 9.7e-3}, "bore_radius"),
        ({"effective_length": 6.1e-3}, "effective_length"),
        ({"roller_length": 12e-3}, "effective_length"),
        ({"edge_radius": 0.1e-3}, "roller_length"),
        ({"profile": "crowned"}, "crown_radius"),
        ({"poisson": 0.5}, "poisson"),
    ):
        with pytest.raises(FeGeometryError, match=name):
            replace(roller, **wrong)
    for wrong, name in (
        ({"shoulder_height": 7e-3}, "shoulder_height"),
        ({"outer_groove_radius": 6e-3}, "outer_groove"),
    ):
        with pytest.raises(FeGeometryError, match=name):
            replace(ball, **wrong)


def test_profiles_of_rollers():
    roller = fe_geometry(catalogue_entry("NU 202 ECP"))
    z = np.array([-2.8e-3, 0.0, 2.8e-3, 2.9e-3, 3.0e-3, 3.1e-3])
    rounded = 0.2e-3 - math.sqrt(0.03) * 1e-3
    assert roller.drop(z)[:5] == pytest.approx([0.0, 0.0, 0.0, rounded, 0.2e-3], abs=1e-12)
    assert roller.drop(z)[5] == math.inf
    crowned = replace(roller, profile="crowned", crown_radius=1.0)
    assert crowned.drop(np.array([2e-3])) == pytest.approx(2e-6)
    logarithmic = replace(roller, profile="logarithmic")
    # ISO 16281: at half the half length, 0.00035 * 5.5 mm * ln(1 / (1 - 0.25)).
    assert logarithmic.drop(np.array([1.4e-3])) == pytest.approx(0.00035 * 5.5e-3 * math.log(4.0 / 3.0))
    ball = fe_geometry(catalogue_entry("6210"))
    with pytest.raises(FeGeometryError, match="effective_length"):
        ball.drop(z)


@pytest.mark.parametrize("designation", ["NU 202 ECP", "6210"])
def test_half_sizes_are_those_of_the_statics(designation: str):
    entry = catalogue_entry(designation)
    geometry = fe_geometry(entry)
    for race, patch in zip(("inner", "outer"), contact_patches(entry.bearing, 500.0), strict=True):
        assert half_sizes(geometry, race, 500.0) == pytest.approx(patch)


def test_the_chapters_sizes():
    """Thesis, sections 3.3.2 and 3.3.3; b_i of the ball is misprinted there."""
    roller, ball = fe_geometry(catalogue_entry("NU 202 ECP")), fe_geometry(catalogue_entry("6210"))
    assert half_sizes(roller, "inner", 3706.0)[1] == pytest.approx(0.127e-3, rel=0.02)
    assert half_sizes(roller, "outer", 3706.0)[1] == pytest.approx(0.159e-3, rel=0.02)
    assert half_sizes(ball, "outer", 219.0) == pytest.approx((0.994e-3, 0.116e-3), rel=0.01)


def test_a_contact_that_does_not_fit_is_refused():
    ball = fe_geometry(catalogue_entry("6210"))
    with pytest.raises(WrongInputError, match="shoulder"):
        contact_grid(ball, "inner", 60e3)
    with pytest.raises(WrongInputError, match="half patch"):
        contact_grid(ball, "inner", 1e3, MeshRule(patch=20.0))
    with pytest.raises(WrongInputError, match="force"):
        contact_grid(ball, "inner", 0.0)
    wrong: dict[str, Any]
    for wrong in ({"size": 2.0}, {"growth": 1.0}, {"along": 0}, {"end": 2.0}, {"patch": 0.0}):
        with pytest.raises(WrongInputError, match="mesh rule: "):
            MeshRule(**wrong)


def test_the_cells_cover_the_grid_once():
    grid = contact_grid(fe_geometry(catalogue_entry("6210")), "outer", 1e3)
    x0, x1, z0, z1 = grid.cells()
    assert np.sum((x1 - x0) * (z1 - z0)) == pytest.approx(grid.x[-1] * grid.z[-1])
    assert np.diff(grid.x)[: grid.columns] == pytest.approx(0.4 * grid.half_width)
    assert grid.z[-1] == pytest.approx(1.3 * grid.half_length)
