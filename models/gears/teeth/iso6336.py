"""Tooth stiffness by ISO 6336-1, method B: an approximation for steel gears, against which the models are held.

c' is the largest stiffness of a single pair, c_gamma the mean stiffness of the mesh, both for a face of unit width and
in the transverse section along the line of action. Valid for 100 N/mm and more of specific load; below it the standard
lets both fall with the fourth root.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from models.words.checks import check_positive

if TYPE_CHECKING:
    from models.gears.teeth.geometry import GearPair

# N/(mm um) to N/m per m of face.
_UNIT = 1e9
_LIMIT_LOAD = 100e3
_STEEL = 206e9
# Theory against measurement, c' over c'_th.
_MEASURED = 0.8


@dataclass(frozen=True)
class IsoStiffness:
    """Stiffness a unit of face width, N/m^2.

    Attributes:
        single: c'.
        mesh: c_gamma_alpha, the mean of the mesh.
        valid: whether the standard's ranges of profile shift and of load are kept.
    """

    single: float
    mesh: float
    valid: bool


def iso_stiffness(pair: GearPair, tangential_force: float | None = None) -> IsoStiffness:
    """Return c' and c_gamma_alpha of solid wheels with the pair's rack and modulus.

    Args:
        pair: the gears; the smaller wheel counts as the standard's first.
        tangential_force: F_t K_A at the reference circle, N; None for a load within the standard's range.

    Raises:
        ValueError: where the force is not positive.
    """
    first, second = sorted(pair.wheels, key=lambda wheel: wheel.teeth)
    helix = math.cos(pair.base_helix_angle) ** 2 * math.cos(pair.helix_angle)
    z1, z2 = first.teeth / helix, second.teeth / helix
    x1, x2 = first.profile_shift, second.profile_shift
    compliance = (0.04723 + 0.15551 / z1 + 0.25791 / z2 - 0.00635 * x1 - 0.11654 * x1 / z1) + (
        -0.00193 * x2 - 0.24188 * x2 / z2 + 0.00529 * x1**2 + 0.00182 * x2**2
    )
    rack = (1.0 + 0.5 * (1.2 - pair.rack.dedendum)) * (1.0 - 0.02 * (20.0 - math.degrees(pair.pressure_angle)))
    moduli = 2.0 * first.modulus * second.modulus / (first.modulus + second.modulus)
    single = _UNIT * _MEASURED * rack * math.cos(pair.helix_angle) * moduli / _STEEL / compliance
    valid = x1 >= x2 and -0.5 <= x1 + x2 <= 2.0
    if tangential_force is not None:
        check_positive(tangential_force=tangential_force)
        load = tangential_force / pair.face_width
        single *= min(load / _LIMIT_LOAD, 1.0) ** 0.25
        valid = valid and load >= _LIMIT_LOAD
    return IsoStiffness(single, single * (0.75 * pair.transverse_contact_ratio + 0.25), valid)
