"""Modes and accelerance of a rig at rest under a load."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from models.identify.evidence import accelerance, contact_coefficients, modes
from models.identify.space import bearing_directions
from models.machine.hertz import mean_bearing_stiffness
from models.machine.rig import Rig, natural_frequencies
from tests.models.identify.cases import BEARING

K_B = np.array(bearing_directions(BEARING, 2000.0, Rig.k_c, 0.0))


def test_stiffness_scales_with_load_and_contact() -> None:
    matrix = mean_bearing_stiffness(BEARING, 700.0, 4e9, points=16)
    across, along = bearing_directions(BEARING, 700.0, 4e9, 0.0)
    assert (along, across) == pytest.approx((matrix[0, 0], matrix[1, 1]), rel=1e-8)
    # Clearance leaves fewer elements to press across the load.
    assert bearing_directions(BEARING, 700.0, 4e9, 5e-6)[0] < 0.8 * across


def test_modes_without_damping_are_the_natural_frequencies() -> None:
    rig = replace(Rig(), c_i=0.0, c_r=0.0, alpha_c=0.0, beta_c=0.0)
    found = modes(rig, BEARING, K_B)
    assert np.sort(found.frequency.ravel()) == pytest.approx(natural_frequencies(rig, *K_B.tolist()), rel=1e-9)
    assert np.max(found.damping) < 1e-9


def test_damping_ratios_by_hand() -> None:
    # Rings that do not move against each other and no resonator to speak of: one mass on one damper.
    rig = replace(Rig(), m_r=1e-9, k_r=1e3, c_r=0.0, alpha_c=0.0, beta_c=0.0)
    stiff = np.array([1e14])
    found = modes(rig, BEARING, stiff)
    mass = rig.m_i + rig.m_o
    place = int(np.argmin(np.abs(found.frequency - math.sqrt(rig.k_i / mass) / (2.0 * math.pi))))
    assert found.frequency[0, place] == pytest.approx(math.sqrt(rig.k_i / mass) / (2.0 * math.pi), rel=1e-4)
    assert found.damping[0, place] == pytest.approx(rig.c_i / (2.0 * math.sqrt(rig.k_i * mass)), rel=1e-4)


def test_a_mode_that_does_not_oscillate() -> None:
    rig = replace(Rig(), c_i=1e7)
    found = modes(rig, BEARING, K_B[:1])
    assert found.damping.max() >= 1.0
    assert np.all(np.isfinite(found.frequency))


def test_damping_of_contacts_is_that_of_the_engine() -> None:
    # Eq. 39: beta_c k_c delta^(n - 1) of an element, where its stiffness is n k_c delta^(n - 1).
    rig = replace(Rig(), alpha_c=0.0)
    assert contact_coefficients(rig, BEARING, K_B) == pytest.approx(rig.beta_c / 1.5 * K_B)


def test_accelerance_of_a_rigid_body_and_at_its_resonance() -> None:
    rig = Rig()
    # Far above all modes the casing alone moves.
    high = accelerance(rig, BEARING, K_B, np.array([1e6]))
    assert np.abs(high[:, 0]) == pytest.approx(1.0 / rig.m_o, rel=1e-3)
    found = modes(rig, BEARING, K_B)
    at = np.abs(accelerance(rig, BEARING, K_B, found.frequency))
    beside = np.abs(accelerance(rig, BEARING, K_B, 1.05 * found.frequency))
    assert np.all(at[:, [0, 2]] > beside[:, [0, 2]])


def test_scale_does_not_show_in_modes_but_in_accelerance() -> None:
    scale, rig = 3.0, Rig()
    names = ("m_i", "m_o", "m_r", "k_i", "k_r", "c_i", "c_r", "m_b")
    other = replace(rig, **{name: scale * getattr(rig, name) for name in names}, k_c=scale**1.5 * rig.k_c)
    for load in (500.0, 2000.0):
        own, scaled = (np.array(bearing_directions(BEARING, load, each.k_c, 0.0)) for each in (rig, other))
        found, expected = modes(other, BEARING, scaled), modes(rig, BEARING, own)
        assert found.frequency == pytest.approx(expected.frequency, rel=1e-9)
        assert found.damping == pytest.approx(expected.damping, rel=1e-9)
        at = np.array([350.0, 3000.0])
        assert scale * accelerance(other, BEARING, scaled, at) == pytest.approx(accelerance(rig, BEARING, own, at))
