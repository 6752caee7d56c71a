from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from models.fe.bearings.element import common_slopes, element_slopes, race_slopes
from models.fe.extra import has_extra
from models.fe.meshes.ball_mesh import ball_mesh
from models.fe.meshes.geometry import FeGeometry, Race, fe_geometry
from models.fe.meshes.ring_mesh import ring_mesh
from models.fe.meshes.roller_mesh import roller_mesh
from models.fe.meshes.sizing import MeshRule, contact_grid
from models.machine.bearing import catalogue_entry

BALL, ROLLER = fe_geometry(catalogue_entry("6210")), fe_geometry(catalogue_entry("NU 202 ECP"))
SMALL = MeshRule(patch=1.6, size=0.4, growth=2.5, along=6, coarse=3.0)
X, Z = np.array([0.0, 1e-4, -3e-4, 2e-4]), np.array([0.0, 2e-3, 1e-3, -1.5e-3])


@pytest.mark.skipif(not has_extra(), reason="scikit-fem (extra fe) is not installed")
@pytest.mark.parametrize("race", ["inner", "outer"])
@pytest.mark.parametrize("geometry", [BALL, ROLLER], ids=["ball", "roller"])
def test_slopes_are_those_of_the_meshes(geometry: FeGeometry, race: Any):
    grid = contact_grid(geometry, race, 3e3, SMALL)
    make = ball_mesh if geometry.element == "ball" else roller_mesh
    for mesh, slopes in (
        (make(geometry, grid, SMALL), lambda x, z: element_slopes(geometry, x, z)),
        (ring_mesh(geometry, race, grid, SMALL), lambda x, z: race_slopes(geometry, race, x, z)),
    ):
        corners = mesh.doflocs[:, mesh.facets[:, mesh.boundaries["contact"]]]
        # The slope over both diagonals of a facet is that in its middle, to second order.
        first, second = corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]
        middle = corners.mean(axis=1)
        along, across = slopes(middle[0], middle[2])
        for step in (first, second):
            assert along * step[0] + across * step[2] == pytest.approx(step[1], abs=0.02 * np.abs(step).max())


@pytest.mark.parametrize("geometry", [BALL, ROLLER], ids=["ball", "roller"])
def test_both_bodies_touch_in_one_surface(geometry: FeGeometry):
    """Its slope lies between both surfaces'; the inner race's frame is the element's upside down."""
    cases: list[tuple[Race, float]] = [("inner", -1.0), ("outer", 1.0)]
    for race, sense in cases:
        of_element, of_ring = common_slopes(geometry, race)
        element, ring = of_element(X, Z), of_ring(X, Z)
        for axis in (0, 1):
            assert ring[axis] == pytest.approx(sense * element[axis])
            own, other = element_slopes(geometry, X, Z)[axis], sense * race_slopes(geometry, race, X, Z)[axis]
            assert np.all((element[axis] - own) * (element[axis] - other) <= 1e-12)


def test_slopes_near_the_contact_are_place_by_radius():
    """Outer race: (-x / R_o - x / R_w) / 2 and (-z / r_go - z / R_w) / 2; inner: +x / R_i, -z / r_gi."""
    x, z = np.array([1e-6]), np.array([1e-6])
    radius = BALL.element_radius
    outer, inner = common_slopes(BALL, "outer")[0](x, z), common_slopes(BALL, "inner")[0](x, z)
    assert outer[0] / x == pytest.approx(-0.5 * (1.0 / BALL.outer_race_radius + 1.0 / radius))
    assert outer[1] / z == pytest.approx(-0.5 * (1.0 / 6.55e-3 + 1.0 / radius))
    assert inner[0] / x == pytest.approx(0.5 * (1.0 / BALL.inner_race_radius - 1.0 / radius))
    assert inner[1] / z == pytest.approx(-0.5 * (1.0 / 6.55e-3 + 1.0 / radius))
