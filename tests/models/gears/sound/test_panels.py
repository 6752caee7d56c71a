"""Static integrals over a panel against points on ever smaller parts of it, and sums over closed surfaces."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.gears.sound.panels import Panels, static_integrals
from models.gears.sound.shapes import box, sphere

TRIANGLE = np.array([(0.0, 0.0, 0.0), (1.0, 0.1, 0.0), (0.3, 0.9, 0.0), (0.3, 0.9, 0.0)])
QUADRANGLE = np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.2, 0.8, 0.0), (-0.1, 0.7, 0.0)])
coordinates = st.floats(-1.5, 1.5)


def turned(values: np.ndarray) -> np.ndarray:
    turn, _ = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))
    return values @ (turn * np.sign(np.linalg.det(turn))).T


def parts(corners: np.ndarray, times: int) -> np.ndarray:
    """Triangles of a panel, each split into four so many times."""
    triangles = corners[[(0, 1, 2), (0, 2, 3)]]
    for _ in range(times):
        a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
        d, e, f = (a + b) / 2, (b + c) / 2, (c + a) / 2
        split = [(a, d, f), (d, b, e), (f, e, c), (d, e, f)]
        triangles = np.concatenate([np.stack(corner, axis=1) for corner in split])
    return triangles


def slow(x: np.ndarray, along: np.ndarray, corners: np.ndarray) -> list[float]:
    """The four integrals by the middles of 131,072 parts."""
    triangles = parts(corners, 8)
    cross = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    area = 0.5 * np.linalg.norm(cross, axis=1)
    normal = Panels(corners[None]).normal[0]
    between = x - triangles.mean(axis=1)
    r = np.linalg.norm(between, axis=1)
    up, out = between @ normal, between @ along
    kernels = 1.0 / r, up / r**3, -out / r**3, along @ normal / r**3 - 3.0 * up * out / r**5
    return [float(np.sum(area * kernel)) for kernel in kernels]


@pytest.mark.parametrize("corners", [TRIANGLE, QUADRANGLE], ids=["triangle", "quadrangle"])
@pytest.mark.parametrize("place", [(0.4, 0.4, 0.3), (1.5, -0.3, -0.1), (2.0, 3.0, 0.0), (-1.0, 0.0, 0.2)])
def test_integrals_are_those_of_many_points(corners, place):
    x, along = turned(np.array(place)), np.array([0.6, -0.48, 0.64])
    panel = Panels(turned(corners)[None])
    found = static_integrals(x[None], along[None], panel.corners, panel.normal)
    values = [float(value[0]) for value in (found.single, found.double, found.adjoint, found.second)]
    assert values == pytest.approx(slow(x, along, turned(corners)), rel=3e-4, abs=1e-9)


def test_the_finite_part_at_the_middle_of_a_square_is_known():
    square = Panels(np.array([[(-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, 0.0), (-1.0, 1.0, 0.0)]]))
    found = static_integrals(np.zeros((1, 3)), square.normal, square.corners, square.normal)
    assert found.second == pytest.approx(-4.0 * np.sqrt(2.0))
    assert found.single == pytest.approx(8.0 * np.arcsinh(1.0))
    assert found.double == 0.0


BODIES = {"box": box((1.0, 0.8, 0.6), (2, 3, 1), (0.0, 0.0, -0.3)).panels, "sphere": sphere(0.7, 2).panels}


@given(st.tuples(coordinates, coordinates, coordinates), st.sampled_from(sorted(BODIES)))
def test_a_closed_surface_has_a_whole_solid_angle_and_no_second_derivative_of_it(place, name):
    panels = BODIES[name]
    x = np.tile(place, (len(panels.area), 1))
    near = np.min(np.abs(np.sum((x - panels.middle) * panels.normal, axis=1)))
    found = static_integrals(x, np.tile((0.6, 0.0, 0.8), (len(x), 1)), panels.corners, panels.normal)
    if near > 1e-3:
        angle = found.double.sum() / (-4.0 * np.pi)
        assert angle == pytest.approx(round(angle), abs=1e-9)
        assert found.second.sum() == pytest.approx(0.0, abs=1e-6)


def test_images_are_mirrored_with_their_normals():
    for panels in BODIES.values():
        image = panels.mirrored()
        assert image.normal == pytest.approx(panels.normal * (1.0, 1.0, -1.0))
        assert image.middle == pytest.approx(panels.middle * (1.0, 1.0, -1.0))
        assert np.array_equal(image.triangles, panels.triangles)


@pytest.mark.parametrize("near", [True, False])
def test_rules_have_the_moments_of_the_panels(near):
    for corners in (TRIANGLE, QUADRANGLE):
        panel = Panels(corners[None])
        points, weights = panel.points(near=near)
        assert weights.sum() == pytest.approx(panel.area[0])
        assert np.einsum("pq,pqx->x", weights, points) / panel.area == pytest.approx(panel.middle[0])
