from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.machine.rig import Rig, contact_damping, natural_frequencies, resonator_stiffness, stiffness_damping


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


@given(st.floats(0.1, 5.0), st.floats(5e7, 3e8), st.floats(4500.0, 9500.0))
def test_resonator_stiffness_puts_the_frequency_where_it_is_asked(m_r: float, k_b: float, frequency: float) -> None:
    rig = Rig(m_r=m_r)
    k_r = resonator_stiffness(rig, k_b, frequency)
    assert natural_frequencies(replace(rig, k_r=k_r), k_b, k_b)[5] == pytest.approx(frequency, rel=1e-6)


def test_damping_of_a_spring_has_the_ratio_asked() -> None:
    # Of a mass on a spring, c = 2 zeta sqrt(k m).
    stiffness, mass = 3e8, 2.0
    frequency = math.sqrt(stiffness / mass) / (2.0 * math.pi)
    assert stiffness_damping(0.05, frequency, stiffness) == pytest.approx(0.1 * math.sqrt(stiffness * mass), rel=1e-12)
