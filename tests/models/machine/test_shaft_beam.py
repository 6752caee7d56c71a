"""Shaft of beam elements: rigid motions, statics and frequencies in closed form, convergence, symmetry."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from models.machine.shaft_beam import (
    PER_NODE,
    TURN_X,
    TURN_Y,
    TURN_Z,
    Coupling,
    Disc,
    Shaft,
    X,
    Y,
    Z,
    add_disc,
    shaft_matrices,
    torsion_frequencies,
)
from models.words.numerics import generalised_eigenvalues

SHAFT = Shaft()


def of_plane(matrix: np.ndarray[Any, Any], shift: int, turn: int) -> np.ndarray[Any, Any]:
    places = [PER_NODE * node + place for node in range(len(matrix) // PER_NODE) for place in (shift, turn)]
    return matrix[np.ix_(places, places)]


def test_rigid_motions_bear_no_forces_and_have_the_shafts_mass() -> None:
    stiffness, mass = shaft_matrices(SHAFT)
    assert stiffness == pytest.approx(stiffness.T)
    assert mass == pytest.approx(mass.T)
    z = np.linspace(0.0, SHAFT.length, SHAFT.nodes)
    motions = np.zeros((6, SHAFT.nodes, PER_NODE))
    for place in (X, Y, Z, TURN_Z):
        motions[place, :, place] = 1.0
    motions[TURN_Y, :, X], motions[TURN_Y, :, TURN_Y] = z, 1.0
    motions[TURN_X, :, Y], motions[TURN_X, :, TURN_X] = -z, 1.0
    motions = motions.reshape(6, -1)
    assert np.abs(motions @ stiffness).max() < 1e-9 * np.abs(stiffness).max()
    inertia = np.diag(motions @ mass @ motions.T)
    whole = SHAFT.density * SHAFT.area * SHAFT.length
    across = whole * SHAFT.length**2 / 3.0 + SHAFT.density * SHAFT.second_moment * SHAFT.length
    polar = SHAFT.density * 2.0 * SHAFT.second_moment * SHAFT.length
    assert inertia == pytest.approx([whole, whole, whole, across, across, polar], rel=1e-12)
    # All eigenvalues of the mass are positive, six of the stiffness are zero.
    values = generalised_eigenvalues(stiffness, mass)
    assert np.sum(values < 1e-9 * values[-1]) == 6


@pytest.mark.parametrize(("shift", "turn"), [(X, TURN_Y), (Y, TURN_X)])
@pytest.mark.parametrize("elements", [1, 4])
def test_a_cantilever_bends_by_moment_and_shear(shift: int, turn: int, elements: int) -> None:
    """F L^3 / (3 E I) + F L / (k A G) at the end, slope of the section F L^2 / (2 E I): exact with any elements."""
    shaft = replace(SHAFT, elements=elements)
    stiffness = of_plane(shaft_matrices(shaft)[0], shift, turn)[2:, 2:]
    load = np.zeros(2 * elements)
    load[-2] = 100.0
    bent = np.linalg.solve(stiffness, load)
    bending = shaft.modulus * shaft.second_moment
    shear = shaft.shear_coefficient * shaft.area * shaft.shear_modulus
    assert bent[-2] == pytest.approx(100.0 * shaft.length**3 / (3.0 * bending) + 100.0 * shaft.length / shear)
    slope = 100.0 * shaft.length**2 / (2.0 * bending)
    assert bent[-1] == pytest.approx(slope if shift == X else -slope)


def timoshenko(shaft: Shaft, order: int) -> float:
    """Lower natural frequency of a simply supported beam by the frequency equation of Timoshenko, Hz."""
    wave = order * math.pi / shaft.length
    rho, bending = shaft.density, shaft.modulus * shaft.second_moment
    shear = shaft.shear_coefficient * shaft.area * shaft.shear_modulus
    # rho^2 I / (k G) w^4 - (rho A + rho I q^2 + rho E I A q^2 / (k A G)) w^2 + E I q^4 = 0
    a = rho**2 * shaft.second_moment * shaft.area / shear
    b = rho * shaft.area + wave**2 * (rho * shaft.second_moment + rho * shaft.area * bending / shear)
    c = bending * wave**4
    return math.sqrt((b - math.sqrt(b * b - 4.0 * a * c)) / (2.0 * a)) / (2.0 * math.pi)


def supported(elements: int) -> np.ndarray[Any, Any]:
    k, m = (of_plane(matrix, X, TURN_Y) for matrix in shaft_matrices(replace(SHAFT, elements=elements)))
    kept = [place for place in range(len(k)) if place not in (0, len(k) - 2)]
    return np.sqrt(generalised_eigenvalues(k[np.ix_(kept, kept)], m[np.ix_(kept, kept)])) / (2.0 * math.pi)


def test_frequencies_of_a_supported_shaft_are_timoshenkos() -> None:
    exact = [timoshenko(SHAFT, order) for order in (1, 2, 3)]
    errors = np.array([supported(elements)[:3] / exact - 1.0 for elements in (8, 16, 32)])
    assert np.all(errors > 0.0)
    assert np.all(errors[-1] < 1e-3)
    # The element's shapes are those of static loads: second order in rotary inertia and shear.
    order = np.log2(errors[:-1] / errors[1:])
    assert np.all(order > 1.8)
    euler = (
        math.pi
        / (2.0 * SHAFT.length**2)
        * math.sqrt(SHAFT.modulus * SHAFT.second_moment / (SHAFT.density * SHAFT.area))
    )
    assert exact[0] < euler


def test_torsion_of_a_free_shaft_converges_to_its_waves() -> None:
    speed = math.sqrt(SHAFT.shear_modulus / SHAFT.density)
    exact = speed / (2.0 * SHAFT.length) * np.array([1.0, 2.0])
    errors = np.array([torsion_frequencies(replace(SHAFT, elements=n))[1:3] / exact - 1.0 for n in (4, 8, 16)])
    assert np.log2(errors[:-1] / errors[1:]) == pytest.approx(np.full((2, 2), 2.0), abs=0.15)
    assert torsion_frequencies(SHAFT)[0] < 1e-3


def test_a_stiff_shaft_between_couplings_is_one_inertia() -> None:
    """Two equal free ends against each other: the middle stands still, w^2 = k / J."""
    stiff = replace(SHAFT, modulus=2e17)
    ends = tuple(Coupling(node, 1300.0, 2e-3) for node in (0, 4))
    disc = Disc(2, 1.0, 5e-3, 3e-3)
    middle = stiff.density * 2.0 * stiff.second_moment * stiff.length + disc.polar
    found = torsion_frequencies(stiff, (disc,), ends)
    apart = math.sqrt(1300.0 / 2e-3) / (2.0 * math.pi)
    together = math.sqrt(1300.0 * (1.0 / 2e-3 + 2.0 / middle)) / (2.0 * math.pi)
    assert found[1:3] == pytest.approx([apart, together], rel=1e-5)


def test_a_disc_has_its_mass_in_all_directions() -> None:
    mass = np.zeros((12, 12))
    add_disc(mass, Disc(1, 2.0, 3.0, 4.0))
    assert np.diag(mass) == pytest.approx([0.0] * 6 + [2.0, 2.0, 2.0, 4.0, 4.0, 3.0])


def test_shear_coefficient_of_a_rod_and_of_a_thin_tube() -> None:
    rod, tube = replace(SHAFT, inner_diameter=0.0), replace(SHAFT, inner_diameter=0.0399999)
    assert rod.shear_coefficient == pytest.approx(6.0 * 1.3 / (7.0 + 6.0 * 0.3))
    assert tube.shear_coefficient == pytest.approx(2.0 * 1.3 / (4.0 + 3.0 * 0.3), rel=1e-4)


@pytest.mark.parametrize(
    "change", [{"length": 0.0}, {"inner_diameter": 0.05}, {"elements": 0}, {"poisson": 0.6}, {"density": math.nan}]
)
def test_unusable_shafts_are_refused(change: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=next(iter(change))):
        replace(SHAFT, **change)


def test_a_part_must_sit_on_a_node() -> None:
    with pytest.raises(ValueError, match="nodes 0 to 4"):
        torsion_frequencies(SHAFT, couplings=(Coupling(5, 1.0, 1.0),))
