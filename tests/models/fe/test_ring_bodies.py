"""Rings of finite elements against the theory of thin rings."""

import math
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from models.fe.bearings.ring_bodies import bore_load, ring_influence
from models.fe.bearings.rings import BoreLoad, RingInfluence
from models.fe.extra import has_extra
from models.fe.meshes.geometry import FeGeometry
from models.fe.meshes.sizing import MeshRule
from models.fe.solid.elastic import FeError

pytestmark = pytest.mark.skipif(not has_extra(), reason="scikit-fem is not installed")

RADIUS, THICKNESS, WIDTH, MODULUS = 49e-3, 2e-3, 4e-3, 210e9
BENDING, SECTION = MODULUS * WIDTH * THICKNESS**3 / 12.0, MODULUS * WIDTH * THICKNESS
RULE = MeshRule(patch=1.6, size=1.6, growth=3.0, along=1, end=1.0, coarse=3.0)
LOAD = 50.0


def thin() -> FeGeometry:
    return FeGeometry(
        designation="thin",
        element="roller",
        n_elements=11,
        rows=1,
        contact_angle=0.0,
        element_radius=4e-3,
        inner_race_radius=RADIUS + 0.5 * THICKNESS,
        outer_race_radius=RADIUS + 0.5 * THICKNESS + 8e-3,
        bore_radius=RADIUS - 0.5 * THICKNESS,
        outside_radius=RADIUS + 0.5 * THICKNESS + 12e-3,
        width=WIDTH,
        effective_length=3e-3,
        roller_length=3.4e-3,
        edge_radius=2e-4,
    )


def bent(angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """Inward displacement of a thin ring per newton, balanced by a pressure cos(angle): its harmonics but the first."""
    n = np.arange(2, 200)
    waves = np.cos(np.multiply.outer(angle, n)) / (n**2 - 1.0) ** 2
    return RADIUS**3 / (math.pi * BENDING) * np.sum(waves, axis=-1) + RADIUS / (2.0 * math.pi * SECTION)


def under_half_sine(angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """Inward displacement under 2 cos(angle) / (pi R) over half the bore, per newton."""
    n = np.arange(2, 200, 2)
    pressure = 4.0 / math.pi**2 * (-1.0) ** (n // 2 + 1) / (n**2 - 1.0)
    waves = np.cos(np.multiply.outer(angle, n)) * pressure / (n**2 - 1.0) ** 2
    return -(RADIUS**3) / BENDING * np.sum(waves, axis=-1) - 2.0 * RADIUS / (math.pi**2 * SECTION)


@cache
def balanced() -> RingInfluence:
    return ring_influence(thin(), "inner", LOAD, balanced=True, rule=RULE)


@cache
def under_pressure() -> BoreLoad:
    return bore_load(thin(), LOAD, rule=RULE)


def test_a_free_ring_bends_under_an_element_as_a_thin_ring_does():
    found = balanced()
    expected = bent(found.angle)
    assert found.angle[0] < 2.0 * math.pi / 11
    assert found.angle[-1] == math.pi
    np.testing.assert_allclose(found.race, expected, atol=0.015 * expected.max())
    assert found.support == "sinusoidal"


def test_freeing_the_bore_adds_the_bending_to_what_yields_under_the_element():
    # Held at its bore, the ring does not bend at all.
    assert balanced().own == pytest.approx(float(bent(np.zeros(1))[0]), rel=0.01)


def test_a_ring_bends_under_a_sinusoidal_pressure_as_a_thin_ring_does():
    found = under_pressure()
    expected = under_half_sine(found.angle)
    np.testing.assert_allclose(found.race, expected, atol=0.015 * np.abs(expected).max())
    assert found.bore_at_load == pytest.approx(-float(expected[0]), rel=0.015)


def test_the_bore_moves_with_the_race_of_a_thin_ring():
    found = under_pressure()
    expected = -bent(found.angle)
    np.testing.assert_allclose(found.bore_under_element, expected, atol=0.015 * np.abs(expected).max())


def test_the_race_moves_under_the_pressure_as_the_pressure_under_elements():
    # Reciprocity: what the pressure moves the race under an element, that element moves the bore under the pressure.
    found, angles = under_pressure(), np.linspace(0.0, 0.5 * math.pi, 200)
    line = found.bore_line(angles)
    weight = 2.0 / math.pi * np.cos(angles) * 2.0
    mean = float(np.trapezoid(weight * line, angles))
    assert mean == pytest.approx(float(found.race[0]), rel=0.02)


def test_a_held_ring_passes_hardly_anything_on():
    held = ring_influence(thin(), "inner", LOAD, rule=RULE)
    assert held.own == 0.0
    assert np.abs(held.race).max() < 1e-3 * balanced().own
    matrix = held.matrix(np.arange(11) * 2.0 * math.pi / 11)
    np.testing.assert_allclose(matrix, matrix.T)
    assert np.all(np.diag(matrix) == 0.0)


def test_what_is_no_support_is_refused():
    with pytest.raises(FeError, match="inner ring only"):
        ring_influence(thin(), "outer", balanced=True)
    with pytest.raises(FeError, match="extent"):
        bore_load(thin(), extent=4.0)
