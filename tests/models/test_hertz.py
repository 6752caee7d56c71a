from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.special import ellipe, ellipk

from models.bearing import from_catalogue
from models.hertz import (
    bearing_stiffness,
    contact_damping,
    contact_forces,
    contact_stiffness,
    element_angles,
    in_series,
    l10h_life,
    mean_bearing_stiffness,
    natural_frequencies,
    point_contact_stiffness,
    static_equilibrium,
)
from models.scene import Rig

BEARING = from_catalogue("1205 ETN9")
K_C = 5927e6


def elliptic_stiffness(r_x: float, r_y: float, modulus: float = 210e9 / 0.91) -> float:
    """Return the exact Hertzian stiffness by solving for the ellipticity: slow and obvious."""

    def integrals(kappa: float) -> tuple[float, float]:
        m = 1.0 - 1.0 / kappa**2
        return float(ellipe(m)), float(ellipk(m))

    low, high = 1.0 + 1e-6, 1e4
    for _ in range(200):
        kappa = math.sqrt(low * high)
        e, k = integrals(kappa)
        ratio = (e * kappa**2 - k) / (k - e)
        low, high = (kappa, high) if ratio < r_y / r_x else (low, kappa)
    kappa = low
    e, k = integrals(kappa)
    r_eq = r_x * r_y / (r_x + r_y)
    return math.pi * kappa * modulus * math.sqrt(e * r_eq / (4.5 * k**3))


@given(st.floats(1e-3, 1e-2), st.floats(1.05, 100.0))
def test_simplified_integrals_follow_the_elliptic_ones(r_x: float, ratio: float) -> None:
    assert point_contact_stiffness(r_x, ratio * r_x) == pytest.approx(elliptic_stiffness(r_x, ratio * r_x), rel=0.08)


def test_order_of_the_radii_does_not_matter() -> None:
    assert point_contact_stiffness(3e-3, 9e-3) == point_contact_stiffness(9e-3, 3e-3)


@given(st.floats(1e8, 1e12), st.floats(1e8, 1e12), st.sampled_from([1.5, 10.0 / 9.0]), st.floats(1.0, 1e4))
def test_two_contacts_in_series_add_their_approaches(k_1: float, k_2: float, n: float, force: float) -> None:
    approach = (force / k_1) ** (1.0 / n) + (force / k_2) ** (1.0 / n)
    assert in_series(k_1, k_2, n) * approach**n == pytest.approx(force, rel=1e-9)


def test_a_missing_radius_is_named() -> None:
    with pytest.raises(ValueError, match=r"6205.*inner_race_radius"):
        contact_stiffness(from_catalogue("6205"))
    with pytest.raises(ValueError, match=r"22207.*effective_length"):
        contact_stiffness(from_catalogue("22207"))
    with pytest.raises(ValueError, match=r"inner_groove_radius.*must exceed the ball radius"):
        contact_stiffness(replace(BEARING, inner_groove_radius=3e-3))


@given(
    st.integers(3, 24),
    st.floats(-3.0, 5.0),
    st.one_of(st.just(0.0), st.floats(-7.0, -3.0).map(lambda x: 10.0**x)),
    st.floats(0.0, 6.3),
    st.sampled_from([1.5, 10.0 / 9.0]),
)
def test_equilibrium_carries_the_load(count: int, log_load: float, clearance: float, turn: float, n: float) -> None:
    load = 10.0**log_load
    angles = turn + 2.0 * math.pi / count * np.arange(float(count))
    u = static_equilibrium(angles, load, K_C, clearance=clearance, exponent=n)
    force, jacobian = contact_forces(u, angles, K_C, clearance, n)
    assert force == pytest.approx([load, 0.0], abs=1e-6 * load)
    assert np.linalg.eigvalsh(jacobian).min() >= -1e-6 * np.trace(jacobian)


def test_equilibrium_is_the_least_energy() -> None:
    angles = element_angles(BEARING, 0.1)

    def energy(u: np.ndarray) -> float:
        delta = np.maximum(u[0] * np.cos(angles) + u[1] * np.sin(angles) - 5.0, 0.0)
        return float(K_C * 1e-9 * np.sum(delta**2.5) / 2.5 - 2000.0 * u[0])

    best = minimize(energy, [20.0, 0.0], method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-12}).x * 1e-6
    assert static_equilibrium(angles, 2000.0, K_C, clearance=5e-6) == pytest.approx(best, abs=1e-11)


def test_jacobian_is_the_derivative_of_the_force() -> None:
    angles = element_angles(BEARING)
    u = np.array([12e-6, -3e-6])
    _, jacobian = contact_forces(u, angles, K_C, 2e-6, 1.5)
    h = 1e-11
    for k in range(2):
        step = np.zeros(2)
        step[k] = h
        plus, _ = contact_forces(u + step, angles, K_C, 2e-6, 1.5)
        minus, _ = contact_forces(u - step, angles, K_C, 2e-6, 1.5)
        assert jacobian[:, k] == pytest.approx((plus - minus) / (2.0 * h), rel=1e-4, abs=1e3)


@pytest.mark.parametrize(("load", "clearance"), [(-1.0, 0.0), (math.nan, 0.0), (1.0, -1e-6), (math.inf, 0.0)])
def test_impossible_loads_and_clearances_are_refused(load: float, clearance: float) -> None:
    with pytest.raises(ValueError, match="must be finite and not negative"):
        static_equilibrium(element_angles(BEARING), load, K_C, clearance=clearance)


def test_no_load_no_displacement() -> None:
    assert static_equilibrium(element_angles(BEARING), 0.0, K_C, clearance=1e-5).tolist() == [0.0, 0.0]


def test_clearance_softens_the_bearing() -> None:
    tight = mean_bearing_stiffness(BEARING, 1000.0, K_C)
    loose = mean_bearing_stiffness(BEARING, 1000.0, K_C, clearance=2e-5)
    assert loose[1, 1] < tight[1, 1]


def test_stiffness_repeats_with_half_a_spacing_of_two_rows() -> None:
    spacing = 2.0 * math.pi / 24
    a, b = (bearing_stiffness(BEARING, 2000.0, K_C, cage_angle=x) for x in (0.03, 0.03 + spacing))
    assert a == pytest.approx(b, rel=1e-9, abs=1.0)


def test_natural_frequencies_ascend_and_solve_the_eigenproblem() -> None:
    rig = Rig()
    f = natural_frequencies(rig, 1.3e8, 1.9e8)
    assert len(f) == 6
    assert np.all(np.diff(f) > 0.0)
    lam = (2.0 * math.pi * f) ** 2
    for value in lam:
        determinants = []
        for k_b in (1.3e8, 1.9e8):
            k = np.array([[k_b + rig.k_i, -k_b, 0], [-k_b, k_b + rig.k_r, -rig.k_r], [0, -rig.k_r, rig.k_r]])
            m = np.diag([rig.m_i, rig.m_o, rig.m_r])
            scale = np.linalg.norm(k) ** 3
            determinants.append(abs(np.linalg.det(k - value * m)) / scale)
        assert min(determinants) < 1e-10


@given(st.floats(0.01, 0.3), st.floats(0.01, 0.3), st.floats(10.0, 1e3), st.floats(1.1, 20.0))
def test_damping_coefficients_return_their_ratios(z_1: float, z_2: float, f_1: float, ratio: float) -> None:
    alpha, beta = contact_damping(z_1, z_2, f_1, ratio * f_1)
    for zeta, f in ((z_1, f_1), (z_2, ratio * f_1)):
        omega = 2.0 * math.pi * f
        assert 0.5 * (alpha / omega + beta * omega) == pytest.approx(zeta, rel=1e-9)


def test_damping_frequencies_must_ascend() -> None:
    with pytest.raises(ValueError, match="ascending"):
        contact_damping(0.1, 0.1, 500.0, 400.0)


def test_life_of_rollers_falls_faster_with_load() -> None:
    assert l10h_life(1e4, 5e3, 10.0) == pytest.approx(1e5 * 2.0**3)
    assert l10h_life(1e4, 5e3, 10.0, "roller") == pytest.approx(1e5 * 2.0 ** (10.0 / 3.0))
    with pytest.raises(ValueError, match="load must be positive"):
        l10h_life(1e4, 0.0, 10.0)
