"""Modes of plates and boxes against closed forms, dense eigenvalues and their own order of convergence."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigh

from models.fe.casing import modes
from models.fe.casing import modes as lanczos
from models.fe.casing.model import Casing, Point
from models.fe.casing.modes import NoModesError, first_modes, modes_below
from models.fe.casing.shape import STEEL, CasingMeshRule, CasingShape
from models.fe.solid.elastic import FeError, NotConvergedError
from tests.models.fe.casing.casings import HEIGHT, LENGTH, SIMPLY, box, box_shape, mindlin, plate

pytest.importorskip("skfem", reason="needs the extra fe")


def test_a_plate_has_the_frequencies_of_mindlin() -> None:
    """Two cells through the thickness: one cannot follow the parabola of the shear stress."""
    expected = sorted(mindlin(m, n) for m in range(1, 4) for n in range(1, 4))[:3]
    error = first_modes(plate(8, through=2), 3).frequency / expected - 1.0
    assert (error > 0.0).all()
    assert (error < [0.003, 0.006, 0.011]).all()


def test_a_thin_plate_tends_to_kirchhoff() -> None:
    thickness = 0.002
    stiffness = STEEL.modulus * thickness**3 / 12.0 / (1.0 - STEEL.poisson**2)
    wave = (math.pi / LENGTH) ** 2 + (math.pi / HEIGHT) ** 2
    kirchhoff = wave * math.sqrt(stiffness / (STEEL.density * thickness)) / math.tau
    assert mindlin(1, 1, thickness) == pytest.approx(kirchhoff, rel=1e-3)


def test_frequencies_converge_with_the_fourth_power_of_the_cells() -> None:
    """Shear in the plane of a plate on hard supports, u = cos(pi x / a) sin(pi y / b) and so on, is known exactly.

    Quadratic displacements: errors of eigenvalues have twice the order of strains.
    """
    speed = math.sqrt(0.5 * STEEL.modulus / (1.0 + STEEL.poisson) / STEEL.density)
    exact = 0.5 * speed * math.hypot(1.0 / LENGTH, 1.0 / LENGTH)
    errors: list[float] = []
    for cells in (2, 4):
        square = CasingShape.plate(LENGTH, LENGTH, 0.1)
        found = first_modes(Casing(square, STEEL, CasingMeshRule(LENGTH / cells), SIMPLY), 12).frequency
        errors.append(float(np.abs(found / exact - 1.0).min()))
    assert math.log2(errors[0] / errors[1]) > 3.7
    assert errors[1] < 1e-3


def test_modes_are_those_of_dense_matrices() -> None:
    casing = plate(4)
    values, shapes = eigh(casing.stiffness.toarray(), casing.mass.toarray())
    found = first_modes(casing, 20)
    np.testing.assert_allclose((math.tau * found.frequency) ** 2, values[:20], rtol=1e-9)
    np.testing.assert_allclose(np.abs(shapes[:, :20].T @ casing.mass @ found.shapes), np.eye(20), atol=1e-5)
    np.testing.assert_allclose(found.shapes.T @ casing.mass @ found.shapes, np.eye(20), atol=1e-9)
    assert found.residual.max() < 1e-5


def test_modes_of_one_frequency_are_all_found() -> None:
    """A square plate has most of its modes twice."""
    square = CasingShape.plate(0.3, 0.3, 0.03)
    casing = Casing(square, STEEL, CasingMeshRule(0.1), dict.fromkeys(("x0", "x1", "y0", "y1"), (0, 1, 2)))
    values = eigh(casing.stiffness.toarray(), casing.mass.toarray(), eigvals_only=True)
    found = (math.tau * first_modes(casing, 12).frequency) ** 2
    np.testing.assert_allclose(found, values[:12], rtol=1e-8)
    assert found[1] == pytest.approx(found[2], rel=1e-8)


def test_modes_of_a_body_with_few_unknowns_are_all_found() -> None:
    casing = Casing(CasingShape.plate(0.1, 0.1, 0.05), STEEL, CasingMeshRule(0.1), {"x0": (0, 1, 2)})
    found = first_modes(casing, casing.unknowns)
    values = eigh(casing.stiffness.toarray(), casing.mass.toarray(), eigvals_only=True)
    assert len(found) == casing.unknowns == 54
    np.testing.assert_allclose((math.tau * found.frequency) ** 2, values, rtol=1e-7)


def test_all_modes_below_a_frequency_are_returned_and_none_above() -> None:
    casing = plate(4)
    every = first_modes(casing, 12).frequency
    between = 0.5 * float(every[6] + every[7])
    np.testing.assert_allclose(modes_below(casing, between).frequency, every[:7], rtol=1e-9)


def test_modes_are_refused_where_there_is_none_or_the_basis_is_full(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(NoModesError, match=r"no mode up to 10 Hz, the first is at \d+"):
        modes_below(plate(4), 10.0)
    monkeypatch.setattr(modes, "MAX_VECTORS", 24)
    with pytest.raises(NotConvergedError, match="modes found with 24 vectors, more are needed") as refused:
        modes_below(plate(4), 30000.0)
    # No casing that is too stiff to have modes.
    assert not isinstance(refused.value, NoModesError)


def test_a_mode_that_is_none_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lanczos, "_CONVERGED", 0.5)
    with pytest.raises(NotConvergedError, match=r"mode \d+ of the casing has a residual of"):
        first_modes(plate(4), 10)


def test_mass_on_a_seat_is_that_of_a_spring_and_a_mass() -> None:
    """With much mass on the seats the first modes are the static stiffness of the ports on that mass."""
    mass = 1e5
    casing = box(mass=mass)
    columns = list(casing.columns().values())
    flexibility = np.stack(columns, axis=1).T @ casing.solve(np.stack(columns, axis=1))
    expected = np.sqrt(1.0 / np.sort(np.linalg.eigvalsh(flexibility))[::-1] / mass) / math.tau
    np.testing.assert_allclose(first_modes(casing, 6).frequency, expected, rtol=1e-3)


def test_a_rigid_seat_moves_as_one_and_is_stiffer_than_a_soft_one() -> None:
    rigid, soft = box(), box("mean")
    moved = {}
    for name, casing in (("rigid", rigid), ("mean", soft)):
        column = casing.columns()["seat1.x"]
        q = casing.solve(column[:, None])[:, 0]
        moved[name] = float(column @ q)
        u = np.asarray(casing.transform @ q).reshape(-1, 3)
        reaction = np.asarray(casing.body.stiffness @ u.ravel()).reshape(-1, 3)
        below = casing.body.nodes[1] < 1e-12
        np.testing.assert_allclose(reaction[below].sum(axis=0), [-1.0, 0.0, 0.0], atol=1e-8)
        nodes = np.unique(casing.body.dofs.get_facet_dofs(casing.body.mesh.boundaries["seat1"]).flatten())
        arms = casing.body.nodes[:, nodes].T - np.array([0.1, 0.08, 0.017])
        # Displacement fitted by a translation and a turn.
        motions = np.concatenate([np.concatenate((np.eye(3), -_cross(arm)), axis=1) for arm in arms])
        left = np.linalg.lstsq(motions, u[nodes].ravel(), rcond=None)[1]
        assert (left.sum() < 1e-20 * float(np.sum(u[nodes] ** 2))) == (name == "rigid")
        # A force spread evenly moves the mean by what the rigid centre moves.
        assert float(u[nodes].mean(axis=0)[0]) == pytest.approx(moved[name], rel=0.2)
    assert moved["rigid"] < moved["mean"]


def _cross(arm: np.ndarray) -> np.ndarray:
    x, y, z = arm
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def test_points_and_seats_that_cannot_be_are_named() -> None:
    casing = box()
    with pytest.raises(ValueError, match=r"point 'acc' is 0\.\d+ m from the casing"):
        casing.columns([Point("acc", (1.0, 0.1, 0.1))])
    with pytest.raises(FeError, match="seat 'seat1' is rigid and cannot be held"):
        Casing(box_shape(), STEEL, CasingMeshRule(0.1), {"seat1": (0, 1, 2)})
    with pytest.raises(FeError, match="rigid motion"):
        Casing(replace(box_shape(), feet=()), STEEL, CasingMeshRule(0.1), {"y0": (1,)})
