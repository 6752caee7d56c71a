"""Meshes of tetrahedra by gmsh: geometry, sizes, names, determinism and refusals."""

from __future__ import annotations

import math
import signal
import sys
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from models.fe.extra import MissingExtraError, require_gmsh, require_skfem
from models.fe.meshes.tet_bodies import RaceSector, tet_ball, tet_race, tet_roller
from models.fe.meshes.tetrahedra import MeshingError, TetPatch, TetRule, estimated_nodes
from models.platform.process_signals import sigpipe_kept
from models.words.errors import WrongInputError

RADIUS, LENGTH, EDGE = 2.75e-3, 6e-3, 0.2e-3
ANGLE = math.pi / 11.0
INNER = RaceSector(9.65e-3, 7.5e-3, 5.5e-3, ANGLE)
OUTER = RaceSector(15.15e-3, 17.5e-3, 5.5e-3, ANGLE)
GROOVED = RaceSector(28.7e-3, 25e-3, 10e-3, math.pi / 10.0, 6.55e-3, 2.54e-3)
PATCH = TetPatch(0.25e-3, 2.8e-3, 0.5e-3)
RULE = TetRule(2.0e-3, growth=0.6)
EXACT = {
    "roller": 0.25 * math.pi * RADIUS**2 * LENGTH,
    "inner": 0.5 * ANGLE * (9.65e-3**2 - 7.5e-3**2) * 5.5e-3,
    "outer": 0.5 * ANGLE * (17.5e-3**2 - 15.15e-3**2) * 5.5e-3,
}


@pytest.fixture(scope="module", autouse=True)
def _gmsh():
    try:
        require_skfem()
        require_gmsh()
    except MissingExtraError as error:
        pytest.skip(str(error))


def _ignored_signals() -> str:
    """Return what the C library ignores: a library may change it behind the back of the interpreter."""
    return next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("SigIgn"))


def _volume(mesh) -> float:
    from skfem import Basis

    return float(np.sum(Basis(mesh, mesh.elem(), intorder=4).dx))


@pytest.mark.parametrize(("order", "within"), [(1, 0.05), (2, 1e-3)])
def test_volume(order, within):
    rule = TetRule(2.0e-3, growth=0.6, order=order)
    roller = tet_roller(RADIUS, LENGTH, 0.0, (PATCH, PATCH), rule)
    assert roller.t.shape[0] == 4
    assert roller.doflocs.shape[1] > 100
    assert _volume(roller) == pytest.approx(EXACT["roller"], rel=within)
    for name, sector in (("inner", INNER), ("outer", OUTER)):
        assert _volume(tet_race(sector, PATCH, rule)) == pytest.approx(EXACT[name], rel=within)


def test_boundaries_are_disjoint_complete_and_where_they_should_be():
    patch = TetPatch(0.4e-3, 2e-3, 0.8e-3)
    ball = tet_ball(6.35e-3, (patch, patch), RULE)
    race = tet_race(GROOVED, patch, RULE)
    assert set(ball.boundaries) == {"x0", "z0", "contact_inner", "contact_outer"}
    assert set(race.boundaries) == {"x0", "z0", "cut", "race", "bore", "side", "shoulder"}
    for mesh in (ball, race):
        named = np.sort(np.concatenate(list(mesh.boundaries.values())))
        assert np.array_equal(named, np.sort(mesh.boundary_facets()))
        for axis, name in ((0, "x0"), (2, "z0")):
            assert np.abs(mesh.doflocs[axis, _nodes(mesh, name)]).max() < 1e-12
    outer = ball.doflocs[:, _nodes(ball, "contact_outer")]
    assert np.hypot(np.hypot(outer[0], outer[2]), outer[1]) == pytest.approx(6.35e-3, rel=1e-9)
    groove = race.doflocs[:, _nodes(race, "race")]
    across = np.hypot(groove[0], groove[1]) - 28.7e-3 - 6.55e-3
    assert np.hypot(across, groove[2]) == pytest.approx(6.55e-3, rel=1e-9)
    assert np.any(np.all(np.abs(groove - np.array([[0.0], [28.7e-3], [0.0]])) < 1e-9, axis=0))


def _nodes(mesh, name):
    return mesh.dofs.get_facet_dofs(mesh.boundaries[name]).flatten()


def test_size_is_that_of_the_patch_on_it_and_grows_off_it():
    patch = TetPatch(0.2e-3, 1.0e-3, 0.15e-3)
    mesh = tet_race(INNER, patch, TetRule(1.5e-3, growth=0.5, order=1))
    corners = mesh.p[:, mesh.facets[:, mesh.boundaries["race"]]]
    x, z = corners[0].mean(axis=0), corners[2].mean(axis=0)
    longest = np.max(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=0), axis=0)
    inside = (x < patch.half_x) & (z < patch.half_z)
    assert np.median(longest[inside]) == pytest.approx(patch.size, rel=0.35)
    away = np.hypot(np.maximum(x - patch.half_x, 0.0), np.maximum(z - patch.half_z, 0.0))
    assert np.all(longest <= 2.0 * (patch.size + 0.5 * away))
    assert np.median(longest[away > 2e-3]) > 4.0 * patch.size


def test_same_input_gives_the_same_mesh_silently_and_without_signals(capfd):
    before, ignored = signal.getsignal(signal.SIGINT), _ignored_signals()
    first, second = (tet_roller(RADIUS, LENGTH, EDGE, (PATCH, PATCH), RULE) for _ in range(2))
    assert np.array_equal(first.doflocs, second.doflocs)
    assert np.array_equal(first.t, second.t)
    assert signal.getsignal(signal.SIGINT) is before
    assert _ignored_signals() == ignored
    assert capfd.readouterr() == ("", "")
    assert not require_gmsh().isInitialized()


def test_edges_are_straight_where_a_curve_would_turn_a_tetrahedron():
    # The rounding of 0.2 mm is meshed with edges of 1 mm: some middles leave the surface, no Jacobian changes sign.
    patch = TetPatch(0.25e-3, 2.8e-3, 0.15e-3)
    mesh = tet_roller(RADIUS, LENGTH, EDGE, (patch, patch), TetRule(1.07e-3, growth=0.5))
    jacobian = mesh.mapping().detDF(np.array(mesh.elem.doflocs).T)
    assert np.all(jacobian.min(axis=1) * jacobian.max(axis=1) > 0.0)


def test_estimate_is_within_a_third():
    rule = TetRule(1.5e-3, growth=0.3)
    patch = TetPatch(0.25e-3, 2.8e-3, 0.2e-3)
    mesh = tet_race(OUTER, patch, rule)
    assert estimated_nodes(EXACT["outer"], (patch,), rule) == pytest.approx(mesh.doflocs.shape[1], rel=0.35)


def test_too_many_nodes_are_refused_before_meshing():
    rule = TetRule(1.0e-3, max_nodes=500)
    with pytest.raises(WrongInputError, match=r"inner race: about \d+ nodes of tetrahedra, more than the bound of 500"):
        tet_race(INNER, PATCH, rule)
    assert not require_gmsh().isInitialized()


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: tet_ball(-1.0, (PATCH, PATCH), RULE), "radius: expected a positive number, got -1.0"),
        (lambda: tet_roller(RADIUS, LENGTH, 3e-3, (PATCH, PATCH), RULE), "edge_radius"),
        (lambda: tet_race(INNER, TetPatch(1e-4, 1e-3, math.nan), RULE), "size: expected a positive number, got nan"),
        (lambda: tet_race(INNER, PATCH, TetRule(0.0)), "global_size: expected a positive number"),
        (lambda: tet_race(INNER, PATCH, TetRule(1e-3, order=cast("Any", 3))), "order: expected 1 or 2, got 3"),
        (lambda: tet_race(RaceSector(9e-3, 9e-3, 5e-3, 0.3), PATCH, RULE), "back_radius off the race"),
        (lambda: tet_race(RaceSector(9e-3, 7e-3, 2e-3, 0.3, 6e-3, 3e-3), PATCH, RULE), "rim of the groove inside"),
    ],
)
def test_wrong_dimensions_are_named(make, match):
    with pytest.raises(WrongInputError, match=match):
        make()


def test_gmsh_that_cannot_be_imported_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "gmsh", None)
    with pytest.raises(MissingExtraError, match=r"spallwatch\[fe\]"):
        tet_ball(6.35e-3, (PATCH, PATCH), RULE)


def test_gmsh_in_use_is_not_ended():
    gmsh = require_gmsh()
    with sigpipe_kept():
        gmsh.initialize([], readConfigFiles=False, interruptible=False)
    try:
        with pytest.raises(MeshingError, match="gmsh is in use by this process"):
            tet_ball(6.35e-3, (PATCH, PATCH), RULE)
        assert gmsh.isInitialized()
    finally:
        gmsh.finalize()


def test_failure_of_gmsh_is_said_and_gmsh_ended(monkeypatch):
    gmsh = require_gmsh()

    def fail(_dimension):
        raise RuntimeError("no elements in volume 1")

    monkeypatch.setattr(gmsh.model.mesh, "generate", fail)
    with pytest.raises(MeshingError, match="inner race: gmsh cannot mesh it: no elements in volume 1"):
        tet_race(INNER, PATCH, RULE)
    assert not gmsh.isInitialized()
