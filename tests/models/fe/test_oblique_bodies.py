"""Rings at full width, a contact at the contact angle, and the law of a ball: against geometry and Hertz."""

import math

import numpy as np
import pytest

from models.fe.bearings.oblique import oblique_geometry
from models.fe.bearings.oblique_bodies import (
    _gap,
    _slope,
    fitted_law,
    groove_height,
    largest_ball_load,
    oblique_contact,
    single_row,
)
from models.fe.bearings.oblique_mesh import axial_lines, contact_frame, oblique_ring_mesh, race_profile
from models.fe.bearings.self_aligning import row_influence
from models.fe.extra import has_extra
from models.fe.meshes.grid import FeMeshError
from models.fe.meshes.sizing import MeshRule, contact_grid
from models.fe.solid.elastic import FeError
from models.machine import hertz
from models.machine.bearing import catalogue_entry

GEOMETRY = oblique_geometry(catalogue_entry("1205 ETN9"))
COARSE = MeshRule(patch=1.25, size=1.25, growth=3.5, along=1, along_patch=1.25, coarse=2.0)
needs_extra = pytest.mark.skipif(not has_extra(), reason="needs the extra fe (scikit-fem)")


@needs_extra
@pytest.mark.parametrize("race", ["inner", "outer"])
def test_half_a_ring_has_its_volume_and_boundaries(race: str) -> None:
    profile = race_profile(GEOMETRY, race)  # type: ignore[arg-type]
    grid = contact_grid(single_row(GEOMETRY), race, 400.0, COARSE)  # type: ignore[arg-type]
    mesh = oblique_ring_mesh(GEOMETRY, race, grid, COARSE)  # type: ignore[arg-type]
    z = np.linspace(-7.5e-3, 7.5e-3, 20001)
    section = 0.5 * np.abs(profile.race(z) ** 2 - profile.back**2)
    exact = math.pi * float(np.sum(0.5 * (section[1:] + section[:-1]))) * (z[1] - z[0])
    points, weights = (np.array(part) for part in np.polynomial.legendre.leggauss(3))
    q = np.array(np.meshgrid(points, points, points)).reshape(3, -1)
    w = np.einsum("i,j,k->jik", weights, weights, weights).ravel() / 8.0
    volume = float(np.sum(mesh.mapping().detDF(0.5 * (q + 1.0)) @ w))
    assert volume == pytest.approx(exact, rel=5e-3)
    assert set(mesh.boundaries) == {"race", "x0", "side", "bore" if race == "inner" else "outside"}
    on_race = mesh.doflocs[:, mesh.facets[:, mesh.boundaries["race"]].ravel()]
    np.testing.assert_allclose(np.hypot(on_race[0], on_race[1]), profile.race(on_race[2]), rtol=1e-9)


def test_frame_of_the_contact_follows_element_and_row() -> None:
    profile = race_profile(GEOMETRY, "inner")
    for turn, mirrored in ((0.0, False), (0.7, True)):
        frame = contact_frame(profile, turn, mirrored=mirrored)
        np.testing.assert_allclose(frame.axes @ frame.axes.T, np.eye(3), atol=1e-15)
        # All normals pass through the centre of the sphere.
        np.testing.assert_allclose(frame.origin, GEOMETRY.inner_contact_distance * frame.axes[1], atol=1e-18)


def test_groove_height_lies_on_the_torus() -> None:
    profile = race_profile(GEOMETRY, "inner")
    frame = contact_frame(profile)
    x, z = np.array([0.0, 0.3e-3, 0.0, -0.5e-3]), np.array([0.0, 0.0, 1.2e-3, -1.0e-3])
    height = groove_height(profile, x, z)
    places = frame.origin[:, None] + frame.axes.T @ np.stack((x, height, z))
    np.testing.assert_allclose(np.hypot(places[0], places[1]), profile.race(places[2]), rtol=1e-12)
    assert abs(height[0]) < 1e-17
    assert height[1] == pytest.approx(-(0.3e-3**2) / (2 * GEOMETRY.inner_contact_distance), rel=1e-2)


@needs_extra
def test_coarse_contact_is_near_hertz_and_its_ring_passes_little_on() -> None:
    contact = oblique_contact(GEOMETRY, "inner", 400.0, COARSE)
    state = contact.press(400.0)
    assert state.converged
    assert state.force == pytest.approx(100.0)
    approach = (400.0 / hertz.point_contact_stiffness(*GEOMETRY.relative_radii[0], "elliptic")) ** (2 / 3)
    assert state.approach == pytest.approx(approach, rel=0.15)
    assert contact.asymmetry(state) < 1e-2
    influence = row_influence(GEOMETRY, contact, contact)
    assert 0.0 < np.abs(influence.same).max() < 1e-2 * state.approach / 400.0
    np.testing.assert_allclose(influence.other, influence.other[::-1])


def test_law_of_a_ball_is_recovered_and_its_noise_reported() -> None:
    loads = np.array([7.0, 15.0, 30.0, 60.0, 120.0, 240.0])
    exact = 3.2e-7 * loads ** (2 / 3) - 1.4e-9 * loads
    fit = fitted_law(loads, exact)
    assert (fit.hertz, fit.depth) == pytest.approx((3.2e-7, 1.4e-9), rel=1e-9)
    assert fit.residual < 1e-12
    noisy = fitted_law(loads, exact * (1 + 0.01 * np.array([1, -1, 1, -1, 1, -1])))
    assert 0.005 < noisy.residual < 0.015
    force, tangent = noisy.law().force(np.array([1e-9, 5e-6]))
    # Hertz's exponent holds down to nothing, whatever the noise.
    assert tangent[0] * 1e-9 / force[0] == pytest.approx(1.5, abs=5e-3)
    assert noisy.law().mesh_error == noisy.residual
    with pytest.raises(FeError, match="expected 3 loads at least"):
        fitted_law(np.array([1.0, 2.0]), np.array([1e-6, 2e-6]))


@pytest.mark.parametrize("race", ["inner", "outer"])
def test_slopes_are_those_of_the_mean_surface(race: str) -> None:
    x, z, step = np.array([0.1e-3, 0.3e-3]), np.array([0.5e-3, -0.8e-3]), 1e-7
    profile, r_b = race_profile(GEOMETRY, race), GEOMETRY.ball_radius  # type: ignore[arg-type]
    sign = 1.0 if race == "inner" else -1.0

    def surface(x: np.ndarray, z: np.ndarray) -> np.ndarray:
        ball = r_b - np.sqrt(r_b**2 - x**2 - z**2)
        return sign * (ball - 0.5 * _gap(GEOMETRY, profile, race, x, z))  # type: ignore[arg-type]

    found = _slope(GEOMETRY, race)(x, z)  # type: ignore[arg-type]
    across = (surface(x + step, z) - surface(x - step, z)) / (2 * step)
    along = (surface(x, z + step) - surface(x, z - step)) / (2 * step)
    # The torus turns its slope along rolling by the contact angle: a second-order part.
    np.testing.assert_allclose(found[0], across, atol=0.02 * 0.3e-3 / r_b)
    np.testing.assert_allclose(found[1], along, atol=0.02 * 0.8e-3 / r_b)
    on_ball = _slope(GEOMETRY, race, ball=True)(x, z)  # type: ignore[arg-type]
    np.testing.assert_allclose(np.array(on_ball), -sign * np.array(found))


def test_a_patch_ends_within_the_groove_or_is_refused() -> None:
    limit = largest_ball_load(GEOMETRY, COARSE)
    profile, row = race_profile(GEOMETRY, "inner"), single_row(GEOMETRY)
    lines = axial_lines(profile, contact_grid(row, "inner", 0.99 * limit, COARSE), COARSE)
    edges = np.array(profile.edges())
    assert np.all(np.abs(lines[:, None] - edges).min(axis=0) < 1e-12)
    with pytest.raises(FeMeshError, match="reaches over the edge of its groove"):
        axial_lines(profile, contact_grid(row, "inner", 1.4 * limit, COARSE), COARSE)
    # The static rating of 3.3 kN presses a ball with five times its share.
    assert limit > 5.0 * 3300.0 / 24.0
