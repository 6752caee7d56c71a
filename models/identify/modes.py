"""Natural frequencies, damping ratios and accelerance of a rig at rest under a load (thesis, Eqs. 39, 59 and 60).

Each direction has three modes: shaft and rings on the shaft's stiffness, the rings against each other on the contacts,
and the casing against the resonator. The contacts enter with their mean stiffness over a ball passage, and with the
damping of Eq. 39 at rest, ``alpha_c m_b`` a pressed element and ``beta_c k_c delta^(n - 1)``, which is ``beta_c / n``
of their stiffness.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from models.machine.hertz import contact_exponent

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.machine.bearing import Bearing
    from models.machine.rig import Rig

MODES = 3
"""Modes of one direction."""


@dataclass(frozen=True, eq=False)
class Modes:
    """Modes of several directions or loads, ascending, shapes (directions, modes).

    Attributes:
        frequency: absolute value of the eigenvalue, Hz.
        damping: damping ratio; 1 or more where the mode does not oscillate.
    """

    frequency: NDArray[np.float64]
    damping: NDArray[np.float64]


def contact_coefficients(rig: Rig, bearing: Bearing, k_b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the damping of the contacts, N s/m, for a stiffness of the bearing, N/m, same shape.

    Half of the elements are taken as pressed, as without clearance; ``alpha_c`` has next to no effect.
    """
    pressed = 0.25 * bearing.n_elements * bearing.rows
    return rig.beta_c / contact_exponent(bearing) * k_b + rig.alpha_c * rig.m_b * pressed


def modes(rig: Rig, bearing: Bearing, k_b: NDArray[np.float64]) -> Modes:
    """Return the modes of a rig for stiffnesses of its bearing, N/m, shape (directions,)."""
    mass, damping, stiffness = _matrices(rig, bearing, k_b)
    state = np.zeros((len(k_b), 2 * MODES, 2 * MODES))
    state[:, :MODES, MODES:] = np.eye(MODES)
    state[:, MODES:, :MODES] = -stiffness / mass[:, None]
    state[:, MODES:, MODES:] = -damping / mass[:, None]
    found = [_pairs(values) for values in np.linalg.eigvals(state)]
    frequency, ratio = np.array([f for f, _ in found]), np.array([z for _, z in found])
    return Modes(frequency / (2.0 * math.pi), ratio)


def accelerance(
    rig: Rig, bearing: Bearing, k_b: NDArray[np.float64], frequency: NDArray[np.float64]
) -> NDArray[np.complex128]:
    """Return the acceleration of the casing for a force on it, m/s2 per N, shape (directions, frequencies).

    ``frequency`` in Hz, shape (frequencies,), or (directions, frequencies) where each direction has its own.
    """
    mass, damping, stiffness = _matrices(rig, bearing, k_b)
    omega = 2.0 * math.pi * np.broadcast_to(frequency, (len(k_b), np.shape(frequency)[-1]))[..., None, None]
    dynamic = stiffness[:, None] + 1j * omega * damping[:, None] - omega**2 * np.diag(mass)
    force = np.broadcast_to(np.array([[0.0], [1.0], [0.0]]), (*dynamic.shape[:-1], 1))
    response = np.linalg.solve(dynamic, force)[..., 1, 0]
    return -(omega[..., 0, 0] ** 2) * response


def _matrices(
    rig: Rig, bearing: Bearing, k_b: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the masses, shape (3,), and damping and stiffness, shape (directions, 3, 3): shaft, casing, resonator."""
    mass = np.array([rig.m_i, rig.m_o, rig.m_r])
    damping = _coupled(contact_coefficients(rig, bearing, k_b), rig.c_i, rig.c_r)
    return mass, damping, _coupled(k_b, rig.k_i, rig.k_r)


def _coupled(between: NDArray[np.float64], to_ground: float, to_resonator: float) -> NDArray[np.float64]:
    matrix = np.zeros((len(between), MODES, MODES))
    matrix[:, 0, 0], matrix[:, 1, 1], matrix[:, 2, 2] = between + to_ground, between + to_resonator, to_resonator
    matrix[:, 0, 1] = matrix[:, 1, 0] = -between
    matrix[:, 1, 2] = matrix[:, 2, 1] = -to_resonator
    return matrix


def _pairs(eigenvalues: NDArray[np.complex128]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return angular frequency and damping ratio of the pairs, ascending; real ones are paired in their order."""
    complex_ones = eigenvalues[eigenvalues.imag > 0.0]
    real_ones = np.sort(np.abs(eigenvalues[eigenvalues.imag == 0.0].real))
    first, second = real_ones[0::2], real_ones[1::2]
    overdamped = np.sqrt(first * second)
    omega = np.concatenate([np.abs(complex_ones), overdamped])
    ratio = np.concatenate(
        [-complex_ones.real / np.abs(complex_ones), 0.5 * (first + second) / np.maximum(overdamped, 1e-300)]
    )
    order = np.argsort(omega)
    return omega[order], ratio[order]
