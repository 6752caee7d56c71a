"""Shares of tooth pairs against bisection, and what relief and faults of the teeth do to the mesh."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.gears.teeth.contacts import Springs, share_force
from models.gears.teeth.faults import Eccentricity, PitchError, Pitting, ProfileError, ToothCrack, ToothSpall
from models.gears.teeth.geometry import GearPair, TipRelief, ToothedWheel
from models.gears.teeth.stiffness import loaded_mesh, mesh_stiffness
from models.gears.teeth.tooth import StiffnessMethod
from tests.support.effort import effort_count

FORCE = 4000.0
WHEELS = ToothedWheel(20, 20e-3, 10e-3), ToothedWheel(31, 20e-3, 15e-3)
PAIR = GearPair(*WHEELS, 3e-3)
RELIEF = TipRelief(15e-6, 2.5e-3)
RELIEVED = GearPair(
    ToothedWheel(20, 20e-3, 10e-3, tip_relief=RELIEF), ToothedWheel(31, 20e-3, 15e-3, tip_relief=RELIEF), 3e-3
)
HELICAL = GearPair(*WHEELS, 3e-3, helix_angle=math.radians(15.0))


def bisected(springs: Springs, force: float) -> float:
    """Return the approach of one position, by bisection of both levels."""
    constant = 4.0 * (1.0 - 0.3**2) / 206e9 / math.pi
    stiffness = springs.width[0] / constant

    def pair(p: int, approach: float) -> float:
        low, high = -1.0, approach
        for _ in range(80):
            middle = 0.5 * (low + high)
            pressed = float((stiffness[p] * np.maximum(middle - springs.gap[0, p], 0.0)).sum())
            low, high = (middle, high) if middle + springs.teeth[0, p] * pressed < approach else (low, middle)
        return float((stiffness[p] * np.maximum(0.5 * (low + high) - springs.gap[0, p], 0.0)).sum())

    low, high = -1e-3, 1e-2
    for _ in range(60):
        middle = 0.5 * (low + high)
        total = sum(pair(p, middle) for p in range(springs.gap.shape[1]))
        low, high = (middle, high) if total < force else (low, middle)
    return 0.5 * (low + high)


@settings(max_examples=effort_count(quick=8, full=100), deadline=None)
@given(seed=st.integers(0, 10**6), pairs=st.integers(1, 3), slices=st.integers(1, 4))
def test_the_shares_are_those_of_bisection(seed, pairs, slices):
    rng = np.random.default_rng(seed)
    shape = (1, pairs, slices)
    springs = Springs(
        gap=rng.uniform(-20e-6, 40e-6, shape),
        width=rng.uniform(1e-3, 1e-2, shape) * (rng.random(shape) < 0.8) + 1e-4,
        teeth=rng.uniform(1e-9, 5e-9, shape[:2]),
        depths=np.full((2, *shape), 2e-3),
        radius=np.full(shape, 1e-2),
        factor=1.0,
    )
    found = share_force(springs, WHEELS, 2000.0, "linear")
    assert found.approach[0] == pytest.approx(bisected(springs, 2000.0), rel=1e-6, abs=1e-10)
    assert found.forces.sum() == pytest.approx(2000.0)


@pytest.mark.parametrize("pair", [PAIR, RELIEVED, HELICAL], ids=["spur", "relieved", "helical"])
def test_the_pairs_carry_the_force_and_both_levels_have_one_deflection(pair):
    secant, tangent = (
        loaded_mesh(pair, FORCE, samples=16, method=StiffnessMethod(level=lv)) for lv in ("secant", "tangent")
    )
    np.testing.assert_allclose(secant.forces.sum(axis=1), FORCE)
    np.testing.assert_allclose(secant.error + FORCE / secant.stiffness, secant.loaded_error, rtol=1e-9)
    np.testing.assert_allclose(tangent.error + FORCE / tangent.stiffness, secant.loaded_error, rtol=1e-9)
    more, less = (loaded_mesh(pair, FORCE * f, samples=16).loaded_error for f in (1.001, 0.999))
    np.testing.assert_allclose(0.002 * FORCE / (more - less), tangent.stiffness, rtol=2e-3)


def test_without_relief_and_with_a_linear_contact_the_mesh_is_linear():
    method = StiffnessMethod(contact="linear")
    meshes = [loaded_mesh(PAIR, force, samples=32, method=method) for force in (10.0, 1e4)]
    np.testing.assert_allclose(meshes[0].stiffness, meshes[1].stiffness, rtol=1e-9)
    assert not meshes[1].error.any()


def test_two_pairs_share_for_the_fraction_of_the_contact_ratio():
    forces = loaded_mesh(PAIR, FORCE, samples=200).forces
    double = np.mean(forces[:, 1] > 0.0)
    assert double == pytest.approx(PAIR.transverse_contact_ratio - 1.0, abs=0.01)
    single = forces[:, 1] == 0.0
    stiffness = loaded_mesh(PAIR, FORCE, samples=200).stiffness
    assert stiffness[single].max() < stiffness[~single].min()


def test_relief_takes_the_load_from_teeth_that_enter_and_smooths_the_transmission_error():
    plain, relieved = (loaded_mesh(pair, FORCE, samples=128) for pair in (PAIR, RELIEVED))
    assert np.max(np.abs(np.diff(relieved.loaded_error))) < 0.5 * np.max(np.abs(np.diff(plain.loaded_error)))
    assert relieved.forces[0, 0] < 0.1 * FORCE < plain.forces[0, 0]


def test_a_helical_mesh_varies_less_and_its_slices_converge():
    assert np.ptp(loaded_mesh(HELICAL, FORCE, samples=16).stiffness) < 0.8 * np.ptp(loaded_mesh(PAIR, FORCE).stiffness)
    means = [loaded_mesh(HELICAL, FORCE, samples=16, method=StiffnessMethod(slices=n)).stiffness for n in (12, 24, 48)]
    changes = [float(np.max(np.abs(a - b))) for a, b in zip(means[1:], means, strict=False)]
    assert changes[1] < 0.6 * changes[0]
    assert changes[1] < 1e-3 * means[2].mean()


@pytest.mark.parametrize("side", ["driver", "driven"])
def test_a_crack_is_met_by_its_own_tooth_and_grows_with_its_depth(side):
    teeth = getattr(PAIR, side).teeth
    losses = []
    for depth in (0.5e-3, 1e-3, 2e-3):
        faults: dict[str, Any] = {f"{side}_faults": [ToothCrack(3, depth)]}
        mesh = mesh_stiffness(PAIR, FORCE, samples=32, **faults)
        loss = getattr(mesh, f"{side}_loss").reshape(teeth, 32)
        assert np.all(np.delete(loss, [3, 4], axis=0) == 0.0)
        assert loss.min() >= 0.0
        losses.append(loss.max())
    assert losses[0] < losses[1] < losses[2] < mesh.base.max()


def test_a_crack_over_part_of_the_face_takes_less():
    whole, half = (
        mesh_stiffness(PAIR, FORCE, samples=16, driver_faults=[ToothCrack(0, 2e-3, extent=extent)]).driver_loss
        for extent in (None, 10e-3)
    )
    assert whole is not None
    assert half is not None
    assert 0.0 < half.max() < 0.75 * whole.max()


def test_teeth_that_all_stand_back_move_the_wheel_and_change_nothing_else():
    mesh = mesh_stiffness(PAIR, FORCE, samples=16, driven_faults=[PitchError((5e-6,) * 31)])
    assert mesh.driven_loss is None or np.max(np.abs(mesh.driven_loss)) < 1e-6 * mesh.mean
    assert mesh.driven_error is not None
    np.testing.assert_allclose(mesh.driven_error, 5e-6, rtol=1e-9)


@pytest.mark.parametrize("contact", ["linear", "weber"])
def test_both_levels_have_one_deflection_with_pitch_errors_too(contact):
    faults = [PitchError.of_tooth(20, 4, 8e-6), ToothCrack(9, 1e-3)]
    turns = np.arange(20 * 16) / (20 * 16)
    deflections = []
    for level in ("secant", "tangent"):
        method = StiffnessMethod(level=level, contact=contact)
        k, e = mesh_stiffness(PAIR, FORCE, samples=16, method=method, driver_faults=faults).at(turns, 0.0)
        deflections.append(e + FORCE / k)
    np.testing.assert_allclose(*deflections, rtol=1e-9)


def test_a_tooth_that_is_gone_leaves_the_load_to_its_neighbours():
    """Where it would be alone, it is met only after the missing amount; where another carries, that one is alone."""
    mesh = mesh_stiffness(PAIR, FORCE, samples=64, driver_faults=[PitchError.of_tooth(20, 4, 1e-3)])
    assert mesh.driver_error is not None
    assert mesh.driver_error.max() == pytest.approx(1e-3)
    assert mesh.driver_loss is not None
    forces = loaded_mesh(PAIR, FORCE, samples=64).forces
    double = forces[:, 1] > 0.0
    loss = mesh.driver_loss.reshape(20, 64)
    assert np.all(loss[4][double] > 0.1 * mesh.mean)
    assert np.all(np.abs(loss[4][~double]) < 1e-6 * mesh.mean)


def test_a_spall_is_felt_while_the_contact_is_on_it():
    length = 1e-3
    mesh = mesh_stiffness(PAIR, FORCE, samples=64, driver_faults=[ToothSpall(2, length, 10e-3, 100e-6)])
    assert mesh.driver_loss is not None
    loss = mesh.driver_loss.reshape(20, 64)
    begin, _ = PAIR.contact_path
    tooth = PAIR.profiles[0]
    path = begin + PAIR.base_pitch * np.arange(64) / 64
    inside = np.abs(np.hypot(tooth.base_radius, path) - tooth.reference_radius) <= 0.5 * length
    assert inside.any()
    np.testing.assert_array_equal(loss[2] > 1e-4 * mesh.mean, inside)


def test_pits_take_contact_only():
    mesh = mesh_stiffness(PAIR, FORCE, samples=32, driver_faults=[Pitting(2, 0.4, 2e-3)])
    assert mesh.driver_loss is not None
    assert 0.0 < mesh.driver_loss.max() < 0.2 * mesh.mean


def test_an_eccentric_wheel_comes_and_goes_once_a_turn():
    mesh = mesh_stiffness(PAIR, FORCE, samples=8, driven_faults=[Eccentricity(30e-6, phase=1.0)])
    assert mesh.driven_error is not None
    lines = 2.0 * np.fft.rfft(mesh.driven_error) / mesh.driven_error.size
    assert lines[1] == pytest.approx(30e-6 * np.exp(-1.0j))
    assert np.max(np.abs(np.delete(lines, 1))) < 1e-15


def test_a_crowned_flank_is_met_in_its_middle_first():
    mesh = mesh_stiffness(PAIR, 50.0, samples=64, driver_faults=[ProfileError(crown=10e-6)])
    assert mesh.driver_error is not None
    assert 0.0 <= mesh.driver_error.min() < 0.5e-6
    assert mesh.driver_error.reshape(20, 64)[7].max() > 2e-6


def test_pitch_errors_that_are_drawn_close_after_a_turn():
    error = PitchError.drawn(20, 5e-6, seed=3)
    single = np.diff(error.positions, append=error.positions[0])
    assert sum(single) == pytest.approx(0.0, abs=1e-18)
    assert np.mean(error.positions) == pytest.approx(0.0, abs=1e-18)
    assert error == PitchError.drawn(20, 5e-6, seed=3)


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        (ToothCrack(20, 1e-3), "crack tooth must be from 0 to 19, got 20"),
        (ToothCrack(0, 9e-3), "crack depth must be from 0 to"),
        (ToothSpall(0, 1e-3, 5e-3, 1e-5, radius=10e-3), "spall radius must be on the flank"),
        (ToothSpall(0, 1e-3, 5e-3, 1e-5, place=40e-3), "spall place must be on the face of 20 mm, got 40 mm"),
        (PitchError((0.0, 1e-6)), "pitch error positions must be 20, one a tooth, got 2"),
    ],
)
def test_a_fault_that_does_not_fit_its_wheel_is_refused_by_its_field(fault, message):
    with pytest.raises(ValueError, match=message):
        mesh_stiffness(PAIR, FORCE, samples=8, driver_faults=[fault])


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: ToothCrack(0, -1e-3), "crack depth must be finite and not negative"),
        (lambda: ToothCrack(0, 1e-3, angle=2.0), "crack angle must be at most 90 deg"),
        (lambda: ToothSpall(0, 1e-3, 0.0, 1e-5), "spall width must be positive"),
        (lambda: Pitting(0, 1.0, 1e-3), "pitting share must be below 1"),
        (lambda: PitchError((math.nan,)), "pitch error positions must be finite"),
        (lambda: mesh_stiffness(PAIR, 0.0, samples=8), "force must be positive"),
    ],
)
def test_what_cannot_be_is_refused_by_its_field(build, message):
    with pytest.raises(ValueError, match=message):
        build()
