"""Meshes of rollers, balls and rings: no element inside out, volumes, boundaries, sizes at the contact."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.fe.extra import has_extra
from models.fe.meshes.ball_mesh import ball_mesh
from models.fe.meshes.geometry import FeGeometry, fe_geometry
from models.fe.meshes.grid import FeMeshError, HexBlock, build, extrude, lattice, mesh_quality
from models.fe.meshes.ring_mesh import race_rise, ring_mesh
from models.fe.meshes.roller_mesh import roller_mesh
from models.fe.meshes.sizing import ContactGrid, MeshRule, chapter_rule, contact_grid, uniform_rule
from models.machine.bearing import catalogue_entry
from tests.support.effort import effort_count

pytestmark = pytest.mark.skipif(not has_extra(), reason="scikit-fem (extra fe) is not installed")

SMALL = MeshRule(patch=1.6, size=0.8, growth=2.5, along=3, coarse=3.0)
EXAMPLES = settings(max_examples=effort_count(quick=5, full=60), deadline=None)
ROLLER = fe_geometry(catalogue_entry("NU 202 ECP"))
BALL = fe_geometry(catalogue_entry("6210"))


def check_boundaries(mesh: Any) -> None:
    """Each facet of the surface belongs to one boundary."""
    named = np.sort(np.concatenate(list(mesh.boundaries.values())))
    assert np.array_equal(named, np.sort(mesh.boundary_facets()))


def contact_lines(mesh: Any, axis: int) -> np.ndarray:
    places = mesh.doflocs[axis, mesh.facets[:, mesh.boundaries["contact"]]].ravel()
    return np.unique(np.round(places, 10))


def roller_volume(geometry: FeGeometry) -> float:
    """Volume of an eighth."""
    edge, radius = geometry.edge_radius, geometry.element_radius
    inner = radius - edge
    rounded = inner**2 * edge + 2.0 * inner * edge**2 * math.pi / 4.0 + 2.0 / 3.0 * edge**3
    return 0.25 * math.pi * (radius**2 * 0.5 * (geometry.effective_length or 0.0) + rounded)


rollers = st.builds(
    lambda radius, slim, edge, length: replace(
        ROLLER,
        element_radius=radius,
        inner_race_radius=4.0 * radius,
        outer_race_radius=6.0 * radius,
        bore_radius=(4.0 - slim) * radius,
        outside_radius=(6.0 + slim) * radius,
        edge_radius=edge * radius,
        effective_length=length * radius,
        roller_length=(length + 2.0 * edge) * radius,
        width=(length + 2.0 * edge + 0.7) * radius,
    ),
    st.floats(2e-3, 20e-3),
    st.floats(0.3, 1.5),
    st.floats(0.02, 0.2),
    st.floats(1.0, 6.0),
)


@EXAMPLES
@given(rollers, st.floats(1e7, 3e9), st.sampled_from([1, 2]))
def test_rollers_of_any_size(geometry: FeGeometry, pressure: float, order: Any):
    """``pressure`` is force by projected area."""
    grid = contact_grid(geometry, "inner", pressure * geometry.element_radius**2 * 0.02, SMALL)
    mesh = roller_mesh(geometry, grid, SMALL, order)
    quality = mesh_quality(mesh)
    assert quality.least_jacobian > 0.2
    assert quality.volume == pytest.approx(roller_volume(geometry), rel=0.12 if order == 1 else 6e-3)
    check_boundaries(mesh)
    assert contact_lines(mesh, 0) == pytest.approx(grid.x, abs=1e-9)
    assert contact_lines(mesh, 2) == pytest.approx(grid.z, abs=1e-9)


@EXAMPLES
@given(rollers, st.sampled_from(["inner", "outer"]), st.floats(0.1, math.pi), st.sampled_from([1, 2]))
def test_plain_rings_of_any_size(geometry: FeGeometry, race: Any, angle: float, order: Any):
    grid = contact_grid(geometry, race, 1e8 * geometry.element_radius**2, SMALL)
    mesh = ring_mesh(geometry, race, grid, SMALL, order, angle=angle)
    quality = mesh_quality(mesh)
    radii = geometry.race_radius(race) ** 2 - geometry.back_radius(race) ** 2
    assert quality.least_jacobian > 0.2
    assert quality.volume == pytest.approx(0.25 * angle * geometry.width * abs(radii), rel=0.05 if order == 1 else 1e-3)
    check_boundaries(mesh)
    assert ("cut" in mesh.boundaries) == (angle < math.pi)
    assert contact_lines(mesh, 0) == pytest.approx(grid.x, abs=1e-9)
    assert contact_lines(mesh, 2) == pytest.approx(grid.z, abs=1e-9)


balls = st.builds(
    lambda radius, slim, inner, outer, shoulder: replace(
        BALL,
        element_radius=radius,
        inner_race_radius=3.0 * radius,
        outer_race_radius=5.0 * radius,
        bore_radius=(3.0 - slim) * radius,
        outside_radius=(5.0 + slim) * radius,
        inner_groove_radius=inner * radius,
        outer_groove_radius=outer * radius,
        shoulder_height=shoulder * radius,
        width=2.8 * radius,
    ),
    st.floats(2e-3, 20e-3),
    st.floats(0.3, 1.5),
    st.floats(1.02, 1.2),
    st.floats(1.02, 1.2),
    st.floats(0.2, 0.6),
)


@EXAMPLES
@given(balls, st.floats(1e6, 4e7), st.sampled_from([1, 2]))
def test_balls_of_any_size(geometry: FeGeometry, pressure: float, order: Any):
    """``pressure`` is force by the square of the ball's radius."""
    grid = contact_grid(geometry, "outer", pressure * geometry.element_radius**2, SMALL)
    mesh = ball_mesh(geometry, grid, SMALL, order)
    quality = mesh_quality(mesh)
    assert quality.least_jacobian > 0.3
    exact = math.pi / 6.0 * geometry.element_radius**3
    assert quality.volume == pytest.approx(exact, rel=0.08 if order == 1 else 1e-3)
    check_boundaries(mesh)
    assert contact_lines(mesh, 0) == pytest.approx(grid.x, abs=1e-9)
    assert contact_lines(mesh, 2) == pytest.approx(grid.z, abs=1e-9)


@EXAMPLES
@given(balls, st.sampled_from(["inner", "outer"]), st.floats(0.15, math.pi), st.sampled_from([1, 2]))
def test_grooved_rings_of_any_size(geometry: FeGeometry, race: Any, angle: float, order: Any):
    grid = contact_grid(geometry, race, 4e6 * geometry.element_radius**2, SMALL)
    mesh = ring_mesh(geometry, race, grid, SMALL, order, angle=angle)
    quality = mesh_quality(mesh)
    z = np.linspace(0.0, 0.5 * geometry.width, 4001)
    surface = geometry.race_radius(race) + (1.0 if race == "inner" else -1.0) * race_rise(geometry, race)(z)
    area = np.trapezoid(0.5 * np.abs(surface**2 - geometry.back_radius(race) ** 2), z)
    assert quality.least_jacobian > 0.05
    assert quality.volume == pytest.approx(angle * area, rel=0.06 if order == 1 else 2e-3)
    check_boundaries(mesh)
    assert contact_lines(mesh, 0) == pytest.approx(grid.x, abs=1e-9)
    assert contact_lines(mesh, 2) == pytest.approx(grid.z, abs=1e-9)


@pytest.mark.parametrize("geometry", [ROLLER, BALL], ids=["roller", "ball"])
def test_elements_of_one_size(geometry: FeGeometry):
    size = 0.2 * geometry.element_radius
    rule = uniform_rule(geometry, "inner", 2e3, size)
    grid = contact_grid(geometry, "inner", 2e3, rule)
    assert np.diff(grid.x) == pytest.approx(size)
    element = (roller_mesh if geometry.element == "roller" else ball_mesh)(geometry, grid, rule)
    ring = ring_mesh(geometry, "inner", grid, rule, angle=0.3)
    for mesh in (element, ring):
        edges = mesh.doflocs[:, mesh.edges[0]] - mesh.doflocs[:, mesh.edges[1]]
        # Twice the size where columns below a shoulder are longer than those below the groove.
        assert np.linalg.norm(edges, axis=0).max() < 2.0 * size
        check_boundaries(mesh)
    assert mesh_quality(element).least_jacobian > 0.3


def test_the_rounded_edge_has_cells_of_its_own():
    rule = replace(SMALL, over=2)
    grid = contact_grid(ROLLER, "inner", 3e3, rule)
    assert grid.z.size == SMALL.along + 3
    assert ROLLER.drop(grid.z[-1:])[0] == pytest.approx(
        1.5 * grid.half_width**2 * (1 / 2.75e-3 + 1 / 9.65e-3), rel=0.05
    )
    for mesh in (roller_mesh(ROLLER, grid, rule), ring_mesh(ROLLER, "inner", grid, rule)):
        assert contact_lines(mesh, 0) == pytest.approx(grid.x, abs=1e-10)
        assert contact_lines(mesh, 2) == pytest.approx(grid.z, abs=1e-10)
        check_boundaries(mesh)
    mesh = roller_mesh(ROLLER, grid, rule)
    nodes = mesh.doflocs[:, mesh.facets[:, mesh.boundaries["contact"]]]
    assert np.hypot(nodes[0], nodes[1]) == pytest.approx(ROLLER.element_radius - ROLLER.drop(nodes[2]), abs=1e-12)


def test_the_chapters_rule():
    """Table 8, third row: one element of 1.5 a over the half patch, four layers on half the roller."""
    rule = chapter_rule(ROLLER, "outer", 3706.0, 0.5)
    grid = contact_grid(ROLLER, "outer", 3706.0, rule)
    assert (grid.columns, grid.z.size) == (1, 5)
    assert grid.x[1] == pytest.approx(1.5 * grid.half_width)
    mesh = roller_mesh(ROLLER, grid, rule)
    edges = mesh.doflocs[:2, mesh.edges[0]] - mesh.doflocs[:2, mesh.edges[1]]
    assert np.linalg.norm(edges, axis=0).max() < 2.0 * rule.max_size


def test_a_spherical_race_lies_on_its_sphere():
    geometry = fe_geometry(catalogue_entry("1205 ETN9"))
    grid = contact_grid(geometry, "outer", 200.0, SMALL)
    mesh = ring_mesh(geometry, "outer", grid, SMALL, angle=0.5)
    nodes = mesh.doflocs[:, mesh.facets[:, np.concatenate([mesh.boundaries["contact"], mesh.boundaries["race"]])]]
    assert np.sqrt(np.sum(nodes**2, axis=0)) == pytest.approx(geometry.outer_race_radius, rel=1e-9)
    assert "shoulder" not in mesh.boundaries
    check_boundaries(mesh)


@pytest.mark.parametrize(("race", "force"), [("inner", 219.0), ("outer", 10052.0)])
def test_the_default_rule_on_the_ball_bearing(race: Any, force: float):
    grid = contact_grid(BALL, race, force)
    assert np.diff(grid.x)[0] == pytest.approx(0.4 * grid.half_width)
    assert 10_000 < 3 * mesh_quality(ball_mesh(BALL, grid)).nodes < 26_000
    assert 20_000 < 3 * mesh_quality(ring_mesh(BALL, race, grid)).nodes < 42_000


@pytest.mark.parametrize(("race", "force"), [("inner", 37.0), ("outer", 3706.0)])
def test_the_default_rule_has_the_unknowns_that_it_states(race: Any, force: float):
    grid = contact_grid(ROLLER, race, force)
    assert np.diff(grid.x)[0] == pytest.approx(0.4 * grid.half_width)
    assert 10_000 < 3 * mesh_quality(roller_mesh(ROLLER, grid)).nodes < 20_000
    assert 20_000 < 3 * mesh_quality(ring_mesh(ROLLER, race, grid)).nodes < 40_000


def test_full_width_is_twice_half():
    grid = contact_grid(ROLLER, "inner", 1e3, SMALL)
    for make in (
        lambda half: roller_mesh(ROLLER, grid, SMALL, half=half),
        lambda half: ring_mesh(ROLLER, "inner", grid, SMALL, half=half),
        lambda half: ball_mesh(BALL, contact_grid(BALL, "inner", 1e3, SMALL), SMALL, half=half),
    ):
        whole, half = make(False), make(True)
        assert mesh_quality(whole).volume == pytest.approx(2.0 * mesh_quality(half).volume, rel=1e-12)
        assert "z0" not in whole.boundaries
        check_boundaries(whole)


def test_a_patch_that_the_ring_cannot_hold_is_refused():
    thin = replace(ROLLER, bore_radius=9.6e-3)
    grid = contact_grid(thin, "inner", 1e3, SMALL)
    with pytest.raises(FeMeshError, match="the body holds"):
        ring_mesh(thin, "inner", grid, SMALL)
    with pytest.raises(FeMeshError, match="angle"):
        ring_mesh(ROLLER, "inner", grid, SMALL, angle=4.0)


def test_elements_inside_out_and_facets_without_name_are_refused():
    lines = np.linspace(0.0, 1.0, 3)
    corners = extrude(lattice(lines, lines), lines)
    with pytest.raises(FeMeshError, match="inside out"):
        build([HexBlock(corners, lambda p: np.array([p[0] * (1.0 - 1.5 * p[1]), p[1], p[2]]))], {})
    with pytest.raises(FeMeshError, match="belong to no boundary"):
        build([HexBlock(corners, lambda p: p)], {}, 1)
    with pytest.raises(FeMeshError, match="order"):
        build([HexBlock(corners, lambda p: p)], {}, 3)  # pyright: ignore[reportArgumentType]


def test_a_mirrored_block_is_turned_round():
    lines = np.linspace(0.0, 1.0, 3)
    corners = extrude(lattice(lines, lines), lines)
    everywhere = {"all": lambda p: np.ones(p.shape[2], dtype=np.bool_)}
    mesh = build([HexBlock(corners, lambda p: np.array([p[1], p[0], p[2]]))], everywhere)
    assert mesh_quality(mesh).volume == pytest.approx(1.0)


def test_grids_are_shared():
    """Both bodies of a contact have facets with the borders of the cells."""
    grid: ContactGrid = contact_grid(ROLLER, "outer", 1e3)
    element, ring = roller_mesh(ROLLER, grid), ring_mesh(ROLLER, "outer", grid)
    assert contact_lines(element, 0) == pytest.approx(contact_lines(ring, 0), abs=1e-12)
    assert len(element.boundaries["contact"]) == len(ring.boundaries["contact"]) == grid.cells()[0].size
