"""Modes of the linearised rig: natural frequencies, the stiffness that gives one of them, and damping coefficients."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from models.numerics import generalised_eigenvalues

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.scene import Rig


def natural_frequencies(rig: Rig, k_xx: float, k_yy: float) -> NDArray[np.float64]:
    """Return the six natural frequencies of the undamped linearised rig, Hz, ascending (Eqs. 59 and 60).

    Args:
        k_xx: bearing stiffness across the load, N/m.
        k_yy: bearing stiffness along the load, N/m.
    """
    mass = np.diag([rig.m_i, rig.m_o, rig.m_r])
    values: list[NDArray[np.float64]] = []
    for k_b in (k_xx, k_yy):
        stiffness = np.array(
            [[k_b + rig.k_i, -k_b, 0.0], [-k_b, k_b + rig.k_r, -rig.k_r], [0.0, -rig.k_r, rig.k_r]], dtype=float
        )
        values.append(generalised_eigenvalues(stiffness, mass))
    return np.sort(np.sqrt(np.maximum(np.concatenate(values), 0.0))) / (2.0 * math.pi)


def resonator_stiffness(rig: Rig, k_b: float, frequency: float) -> float:
    """Return the k_r that gives the rig a natural frequency, N/m (Eq. 62).

    Source: Eqs. 62-65. Eq. 63 as printed misses k_b m_i in its bracket, which is Lambda of Eq. 65.

    Args:
        rig: masses and k_i; its own k_r is not used.
        k_b: bearing stiffness in the direction of the mode, N/m.
        frequency: the natural frequency, Hz.
    """
    lam = (2.0 * math.pi * frequency) ** 2
    constant = lam**2 * rig.m_i * rig.m_o - lam * (rig.k_i * rig.m_o + k_b * rig.m_i + k_b * rig.m_o) + rig.k_i * k_b
    return lam * rig.m_r * constant / (lam * rig.m_r * (lam * rig.m_i - rig.k_i - k_b) + constant)


def stiffness_damping(zeta: float, frequency: float, stiffness: float) -> float:
    """Return the damping coefficient beta k, N s/m, that gives a damping ratio at a frequency in Hz (Eqs. 75, 76)."""
    return zeta * stiffness / (math.pi * frequency)


def contact_damping(zeta_1: float, zeta_2: float, f_1: float, f_2: float) -> tuple[float, float]:
    """Return alpha_c (1/s) and beta_c (s) that give two damping ratios at two frequencies (Eqs. 70, 73 and 74).

    ``zeta_1`` and ``zeta_2`` are the damping ratios at ``f_1`` < ``f_2``, Hz.

    Raises:
        ValueError: if the frequencies are not positive and ascending.
    """
    if not 0.0 < f_1 < f_2:
        raise ValueError(f"frequencies must be positive and ascending, got {f_1!r} and {f_2!r} Hz")
    omega_1, omega_2 = 2.0 * math.pi * f_1, 2.0 * math.pi * f_2
    span = omega_2**2 - omega_1**2
    beta_c = 2.0 * (omega_2 * zeta_2 - omega_1 * zeta_1) / span
    alpha_c = 2.0 * omega_1 * omega_2 * (omega_2 * zeta_1 - omega_1 * zeta_2) / span
    return alpha_c, beta_c
