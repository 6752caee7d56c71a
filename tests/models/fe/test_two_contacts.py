"""The sub-model of section 3.3 in tetrahedra: equilibrium, symmetry of its two contacts, and what does not matter."""

from __future__ import annotations

import math

import numpy as np
import pytest

from models.fe.extra import MissingExtraError, require_gmsh, require_skfem
from models.fe.meshes.geometry import fe_geometry
from models.fe.meshes.tet_bodies import RaceSector, tet_race, tet_roller
from models.fe.meshes.tetrahedra import MeshingError, TetPatch, TetRule
from models.fe.solid.condense import ContactCells
from models.fe.solid.elastic import ElasticBody
from models.fe.submodel.tet_sector import tet_sector
from models.fe.submodel.two_contacts import GappedCells, TwoContacts, bore_pressure, bore_reader, nearest_node
from models.machine.bearing import catalogue_entry

MODULUS, POISSON = 210e9, 0.3
RADIUS, HALF_LENGTH = 2.75e-3, 2.8e-3
INNER = RaceSector(9.65e-3, 7.5e-3, 5.5e-3, math.pi / 11.0)
OUTER = RaceSector(15.15e-3, 17.5e-3, 5.5e-3, math.pi / 11.0)
LOAD = 3706.0


@pytest.fixture(scope="module")
def meshes():
    try:
        require_skfem()
        require_gmsh()
    except MissingExtraError as error:
        pytest.skip(str(error))
    patch = TetPatch(0.25e-3, HALF_LENGTH, 0.4e-3)
    rule = TetRule(1.8e-3, growth=0.5)
    roller = tet_roller(RADIUS, 6e-3, 0.2e-3, (patch, patch), rule)
    return roller, tet_race(INNER, patch, rule), tet_race(OUTER, patch, rule)


def _cells(curvature: float) -> GappedCells:
    x = np.linspace(0.0, 0.24e-3, 9)
    cells = ContactCells.grid(x, np.array([0.0, 1.0e-3, 2.0e-3, 2.5e-3, 2.8e-3]))
    gap = curvature * (cells.x1**3 - cells.x0**3) / (6.0 * (cells.x1 - cells.x0))
    return GappedCells(cells, gap)


def _model(meshes, pins=((0.0, 0.0, 0.0), (0.0, 7.5e-3, 0.0)), **options) -> TwoContacts:
    roller, inner, outer = meshes
    planes = {"x0": (0,), "z0": (2,)}
    element, sector = (
        ElasticBody(mesh, MODULUS, POISSON, planes | {nearest_node(mesh.doflocs, place): (1,)})
        for mesh, place in zip((roller, inner), pins, strict=True)
    )
    fixed = ElasticBody(outer, MODULUS, POISSON, planes | {"outside": (0, 1, 2)})
    contacts = (_cells(1.0 / RADIUS + 1.0 / 9.65e-3), _cells(1.0 / RADIUS - 1.0 / 15.15e-3))
    return TwoContacts(element, sector, fixed, contacts, **options)


@pytest.fixture(scope="module")
def model(meshes):
    return _model(meshes)


def test_force_is_carried_by_both_contacts_and_k_c_is_near_the_analytic_one(model):
    state = model.solve(LOAD)
    assert state.converged
    for contact in (state.inner, state.outer):
        assert contact.force == pytest.approx(0.25 * LOAD, rel=1e-8)
    # Palmgren's 172549 N/mm^(10/9); a few hundred nodes are too stiff.
    assert state.contact_stiffness(10.0 / 9.0) == pytest.approx(172549.0 * 1e3 ** (10.0 / 9.0), rel=0.3)

    # The outer contact is closer, hence wider.
    assert np.count_nonzero(state.outer.active) >= np.count_nonzero(state.inner.active)


def test_contact_stiffens_with_the_load(model):
    loads = (37.0, 370.0, 3706.0)
    approaches = [model.solve(load).approach for load in loads]
    exponents = np.diff(np.log(loads)) / np.diff(np.log(approaches))
    assert np.all(exponents > 1.0)
    assert np.all(exponents < 1.4)


def test_nodes_at_which_bodies_are_held_do_not_matter(meshes, model):
    elsewhere = _model(meshes, pins=((0.0, -1.2e-3, 3e-3), (2e-3, 9e-3, 5e-3)))
    assert elsewhere.solve(LOAD).approach == pytest.approx(model.solve(LOAD).approach, rel=1e-9)


def test_pressure_that_falls_to_zero_at_the_cut_bends_the_sector_more(meshes, model):
    narrow = _model(meshes, spread="sector").solve(LOAD)
    assert narrow.converged
    assert 1.0 < narrow.approach / model.solve(LOAD).approach < 1.05


def test_loads_of_the_bore_add_up_and_its_reader_is_a_mean(meshes):
    inner = ElasticBody(
        meshes[1], MODULUS, POISSON, {"x0": (0,), "z0": (2,), nearest_node(meshes[1].doflocs, (0.0, 7.5e-3, 0.0)): (1,)}
    )
    loads = bore_pressure(inner).reshape(-1, 3)
    assert loads.sum(axis=0)[1:] == pytest.approx([1.0, 0.0], abs=1e-6)
    # cos(t) over 0 to a: sideways sin^2(a) / 2 over upwards (a + sin(a) cos(a)) / 2.
    a = INNER.angle
    assert loads[:, 0].sum() == pytest.approx(math.sin(a) ** 2 / (a + math.sin(a) * math.cos(a)), rel=1e-4)
    reader = bore_reader(inner).reshape(-1, 3)
    assert reader.sum(axis=0) == pytest.approx([0.0, 1.0, 0.0])
    read = np.flatnonzero(reader[:, 1])
    assert np.abs(inner.nodes[0, read]).max() < 1e-12
    assert inner.nodes[1, read] == pytest.approx(7.5e-3)


def test_ball_bearing_from_its_geometry_is_near_the_analytic_one():
    ball = fe_geometry(catalogue_entry("6210"))
    patch = TetPatch(0.7e-3, 4e-3, 0.6e-3)
    sector = tet_sector(ball, {"inner": patch, "outer": patch}, TetRule(4e-3, growth=0.5))
    state = sector.condensed(10052.0).solve(10052.0)
    assert state.converged
    assert sector.unknowns < 3 * sector.nodes < 9000
    # Eq. 17, N/mm^1.5; so coarse a mesh is some percent too stiff.
    assert state.contact_stiffness(1.5) == pytest.approx(426124.0 * 1e3**1.5, rel=0.08)


@pytest.mark.parametrize(
    ("geometry", "match"),
    [
        (lambda: fe_geometry(catalogue_entry("1205 ETN9")), "of one row without a contact angle"),
        (
            lambda: fe_geometry(catalogue_entry("NU 202 ECP"), profile="crowned", crown_radius=1.0),
            "straight rollers, not crowned",
        ),
    ],
)
def test_bearings_that_have_no_tetrahedra_are_refused(geometry, match):
    patch = TetPatch(0.2e-3, 2e-3, 0.6e-3)
    with pytest.raises(MeshingError, match=match):
        tet_sector(geometry(), {"inner": patch, "outer": patch}, TetRule(4e-3))
