"""Drawings of meshes: one outline a facet, curved where the geometry is."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure

from models.fe.extra import has_extra
from models.fe.meshes.geometry import fe_geometry
from models.fe.meshes.grid import Order
from models.fe.meshes.roller_mesh import roller_mesh
from models.fe.meshes.sizing import MeshRule, contact_grid
from models.machine.bearing import catalogue_entry
from monitor.fe.figure_mesh import draw_boundary

pytestmark = pytest.mark.skipif(not has_extra(), reason="scikit-fem (extra fe) is not installed")
ROLLER = fe_geometry(catalogue_entry("NU 202 ECP"))
SMALL = MeshRule(patch=1.6, size=0.8, growth=2.5, along=1)


@pytest.mark.parametrize("order", [1, 2])
def test_what_is_drawn_is_round_where_the_mesh_is(order: Order):
    grid = contact_grid(ROLLER, "inner", 3e3, SMALL)
    mesh = roller_mesh(ROLLER, grid, SMALL, order)
    axes = Figure().subplots()
    draw_boundary(axes, mesh, "z0", (0, 1))
    outlines = [np.asarray(path.vertices) for path in axes.collections[0].get_paths()]
    assert len(outlines) == len(mesh.boundaries["z0"])
    drawn = sum(abs(0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)) for x, y in (one.T for one in outlines))
    missing = 1.0 - drawn / (0.25 * np.pi * 2.75**2)
    assert 0.01 < missing < 0.1 if order == 1 else abs(missing) < 2e-3
    draw_boundary(axes, mesh, "z0", (0, 1), 2e-4)
    assert axes.get_ylim() == pytest.approx((2.55, 2.75), abs=0.03)
