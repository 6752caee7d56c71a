"""Equilibrium of a ring on elements: against the radial statics, with mutual influence, and when it is withheld."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.fe.bearings.balance import PowerLaw, condensed, settle
from models.machine.hertz import contact_forces, static_equilibrium

LAW = PowerLaw(1e10, 1.5)


def radial(angles: np.ndarray) -> np.ndarray:
    return np.column_stack((np.cos(angles), np.sin(angles)))


@settings(deadline=None, max_examples=15)
@given(
    load=st.floats(1.0, 2e4),
    clearance=st.floats(0.0, 2e-5),
    turn=st.floats(0.0, 0.6),
    exponent=st.sampled_from([10 / 9, 1.5]),
)
def test_radial_bearing_equals_the_analytic_statics(
    load: float, clearance: float, turn: float, exponent: float
) -> None:
    angles = np.asarray(turn + 2.0 * math.pi / 10 * np.arange(10), dtype=np.float64)
    found = settle(radial(angles), PowerLaw(1e10, exponent), np.array([load, 0.0]), clearance=clearance)
    u = static_equilibrium(angles, load, 1e10, clearance=clearance, exponent=exponent)
    stiffness = contact_forces(u, angles, 1e10, clearance, exponent)[1]
    np.testing.assert_allclose(found.displacement, u, rtol=1e-6, atol=1e-6 * np.abs(u).max())
    np.testing.assert_allclose(found.stiffness, stiffness, rtol=1e-5, atol=1e-5 * stiffness.max())


@pytest.mark.parametrize("strength", [0.0, 0.2, 1.0])
def test_stiffness_is_the_derivative_of_the_load_with_mutual_influence(strength: float) -> None:
    angles = 0.2 + 2.0 * math.pi / 8 * np.arange(8)
    normals = np.column_stack((radial(angles) * 0.98, np.where(np.arange(8) % 2, 0.2, -0.2)))
    influence = strength * 1e-9 * np.cos(angles[:, None] - angles[None, :])
    np.fill_diagonal(influence, 0.0)
    load = np.array([1500.0, 30.0, 20.0])
    found = settle(normals, LAW, load, influence=influence)
    np.testing.assert_allclose(normals.T @ found.forces, load, atol=1e-6)
    np.testing.assert_allclose(found.approach, normals @ found.displacement - influence @ found.forces, atol=1e-15)
    for i in range(3):
        step = np.zeros(3)
        step[i] = 1.0
        moved = [settle(normals, LAW, load + s * step, influence=influence).displacement for s in (1.0, -1.0)]
        np.testing.assert_allclose(found.stiffness @ (moved[0] - moved[1]) / 2.0, step, atol=1e-5)


def test_influence_that_takes_load_off_softens_the_ring() -> None:
    angles = 2.0 * math.pi / 10 * np.arange(10)
    load, near = np.array([1000.0, 0.0]), np.abs(np.subtract.outer(np.arange(10), np.arange(10))) % 8 == 1
    stiffness = [
        settle(radial(angles), LAW, load, influence=share * 2e-9 * near).stiffness[0, 0] for share in (-1.0, 0.0, 1.0)
    ]
    assert stiffness[0] > stiffness[1] > stiffness[2]


def test_free_coordinate_follows_without_load() -> None:
    matrix = np.array([[5.0, 1.0, 2.0], [1.0, 4.0, 0.5], [2.0, 0.5, 3.0]])
    inverse = np.linalg.inv(matrix)
    np.testing.assert_allclose(condensed(matrix, 2), np.linalg.inv(inverse[:2, :2]))
    with pytest.raises(ValueError, match="coordinate 2 has no stiffness"):
        condensed(np.diag([1.0, 1.0, 0.0]), 2)


def test_no_equilibrium_is_an_error() -> None:
    one = np.array([[1.0, 0.0]])
    with pytest.raises(RuntimeError, match="none lies in its direction"):
        settle(one, LAW, np.array([-10.0, 0.0]))
    with pytest.raises(RuntimeError, match="no equilibrium found"):
        settle(one, LAW, np.array([10.0, 10.0]))
    with pytest.raises(ValueError, match="influence must be symmetric"):
        settle(np.eye(2), LAW, np.array([1.0, 0.0]), influence=np.array([[0.0, 1e-9], [0.0, 0.0]]))
    with pytest.raises(ValueError, match="expected a load"):
        settle(np.eye(2), LAW, np.zeros(3))
    with pytest.raises(ValueError, match="clearance must be finite"):
        settle(np.eye(2), LAW, np.array([1.0, 0.0]), clearance=math.nan)
    assert not settle(np.eye(2), LAW, np.zeros(2)).forces.any()
