from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.special import ellipe, ellipk

from models.machine.bearing import from_catalogue
from models.machine.hertz import (
    bearing_stiffness,
    contact_forces,
    contact_patches,
    contact_shape,
    contact_stiffness,
    element_angles,
    in_series,
    l10h_life,
    line_contact_half_width,
    mean_bearing_stiffness,
    point_contact_semi_axes,
    point_contact_stiffness,
    relative_radii,
    static_equilibrium,
)

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


@given(st.floats(1e-3, 1e-2), st.floats(1.0001, 1000.0))
def test_elliptic_method_is_the_exact_one(r_x: float, ratio: float) -> None:
    exact = point_contact_stiffness(r_x, ratio * r_x, method="elliptic")
    assert exact == pytest.approx(elliptic_stiffness(r_x, ratio * r_x), rel=1e-7)


@given(st.one_of(st.floats(1.0, 1e4), st.floats(0.0, 1e-6).map(lambda x: 1.0 + x)))
@example(1.0)
@example(math.nextafter(1.0, 2.0))
def test_ellipticity_solves_its_equation(ratio: float) -> None:
    shape = contact_shape(ratio, "elliptic")
    m = 1.0 - shape.kappa**-2
    assert shape.eps == pytest.approx(float(ellipe(m)), rel=1e-12)
    assert shape.xi == pytest.approx(float(ellipk(m)), rel=1e-12)
    # Written so that it holds for a circle too, where both differences vanish.
    assert shape.kappa**2 * shape.eps - shape.xi == pytest.approx(ratio * (shape.xi - shape.eps), rel=1e-7, abs=1e-7)


def test_a_ball_on_a_plane_is_the_circle_of_hertz() -> None:
    radius, force, modulus = 5e-3, 100.0, 210e9 / 0.91 / 2.0
    major, minor = point_contact_semi_axes(radius, radius, force, method="elliptic")
    assert (major, minor) == pytest.approx([(0.75 * force * radius / modulus) ** (1.0 / 3.0)] * 2, rel=1e-12)
    stiffness = point_contact_stiffness(radius, radius, method="elliptic")
    assert stiffness == pytest.approx(4.0 / 3.0 * modulus * math.sqrt(radius), rel=1e-12)


@pytest.mark.parametrize("ratio", [0.9, math.nan, math.inf])
def test_impossible_ratios_of_radii_are_refused(ratio: float) -> None:
    with pytest.raises(ValueError, match="1 at least"):
        contact_shape(ratio)


@given(st.floats(1e-3, 1e-2), st.floats(1.0, 100.0), st.floats(1.0, 1e4))
def test_contact_areas_agree_with_the_stiffness(r_x: float, ratio: float, force: float) -> None:
    """Hertz: the approach is 3 F K / (pi a E') with the longer semi-axis a."""
    major, minor = point_contact_semi_axes(r_x, ratio * r_x, force, method="elliptic")
    shape = contact_shape(ratio, "elliptic")
    approach = 3.0 * force * shape.xi / (math.pi * major * (210e9 / 0.91))
    stiffness = point_contact_stiffness(r_x, ratio * r_x, method="elliptic")
    assert stiffness * approach**1.5 == pytest.approx(force, rel=1e-7)
    assert major >= minor * (1.0 - 1e-12)


def test_pressure_of_a_line_contact_carries_the_force() -> None:
    # p_max = E' b / (4 R) is Hertz' slope of the gap; its half ellipse over the width gives the force.
    radius, length, force, modulus = 2e-3, 5e-3, 300.0, 210e9 / 0.91
    half_width = line_contact_half_width(radius, length, force)
    pressure = modulus * half_width / (4.0 * radius)
    assert 0.5 * math.pi * half_width * pressure * length == pytest.approx(force, rel=1e-12)


def test_patches_of_balls_and_rollers() -> None:
    inner, outer = contact_patches(BEARING, 100.0)
    for patch, radii in zip((inner, outer), relative_radii(BEARING), strict=True):
        assert patch == point_contact_semi_axes(*radii, 100.0)
    roller_inner, roller_outer = contact_patches(from_catalogue("NU 202 ECP"), 100.0)
    assert roller_inner[0] == roller_outer[0] == pytest.approx(2.8e-3)
    assert roller_outer[1] > roller_inner[1]
    with pytest.raises(ValueError, match=r"22207.*effective_length"):
        contact_patches(from_catalogue("22207"), 100.0)


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


def test_small_loads_beside_large_clearances_settle() -> None:
    angles = element_angles(BEARING, 0.05)
    for load in (1e-9, 1e-6, 1e-3):
        u = static_equilibrium(angles, load, K_C, clearance=1e-3)
        force, _ = contact_forces(u, angles, K_C, 1e-3, 1.5)
        assert force == pytest.approx([load, 0.0], abs=1e-3 * load)


def test_each_element_may_have_its_own_clearance() -> None:
    angles = element_angles(BEARING)
    gaps = np.where(np.abs(angles) < 0.1, 1e-3, 2e-6)
    u = static_equilibrium(angles, 1000.0, K_C, clearance=gaps)
    kept = angles[gaps < 1e-3]
    assert u == pytest.approx(static_equilibrium(kept, 1000.0, K_C, clearance=2e-6), rel=1e-6, abs=1e-12)
    with pytest.raises(ValueError, match="clearance must be finite and not negative"):
        static_equilibrium(angles, 1000.0, K_C, clearance=-gaps)


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


def test_life_of_rollers_falls_faster_with_load() -> None:
    assert l10h_life(1e4, 5e3, 10.0) == pytest.approx(1e5 * 2.0**3)
    assert l10h_life(1e4, 5e3, 10.0, "roller") == pytest.approx(1e5 * 2.0 ** (10.0 / 3.0))
    with pytest.raises(ValueError, match="load must be positive"):
        l10h_life(1e4, 0.0, 10.0)
