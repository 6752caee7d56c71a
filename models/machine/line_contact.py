"""Line contacts of steel rollers after Palmgren, Houpert and Lundberg; Palmgren is used where no other is named.

The approach of one contact under a force Q over the effective length L, with E' as in ``models.machine.hertz`` and the
half width b of Eq. 4:

* Palmgren (1959): 3.84e-5 Q^0.9 / L^0.8 (mm, N), in the thesis and here 8.06e4 L^(8/9) delta^(10/9). Measured on
  rollers without a crown between plates; knows no radii.
* Houpert (2001): (Q d_m^0.074 / (0.2723 E' L))^(1/1.074) at the inner race and
  (Q (t / (1 + D/d_m))^0.078 / (0.27835 E' L))^(1/1.078) at the outer one, with the thickness t of ring and housing
  behind it, beyond which nothing yields. Fitted to Tripp's analytic approach of cylinders without a crown.
* Lundberg (1939): 4 Q / (pi L E') (1.8864 + ln(L / (2 b))). For rollers with the crown that makes the pressure even
  along them, which yield more.

Houpert (Part I, J. Tribology 123) and Lundberg as printed in Table 1 of Teutsch and Sauer, J. Tribology 126 (2004). The
exponents of these two are not 10/9: they are used as the k_c of the law with 10/9 that has their approach under a
stated force.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Literal, get_args

from models.machine.hertz import EFFECTIVE_MODULUS, PALMGREN, ROLLER_EXPONENT, known_length, line_contact_half_width

if TYPE_CHECKING:
    from models.machine.bearing import Bearing

LineContact = Literal["palmgren", "houpert", "lundberg"]
LINE_CONTACTS: tuple[LineContact, ...] = get_args(LineContact)

# Outer ring of the catalogue's roller bearings over the diameter of a roller; the housing is taken as thick again.
RING_SHARE = 0.45
BACKING_SHARE = 2.0 * RING_SHARE


def line_contact_approaches(
    bearing: Bearing, force: float, formula: LineContact = "palmgren", *, backing: float | None = None
) -> tuple[float, float]:
    """Return how far one roller under a force, N, approaches the inner and the outer race, m.

    Args:
        backing: thickness of outer ring and housing behind the race for Houpert's formula, m; by default 0.9 of the
            roller's diameter.

    Raises:
        ValueError: if a dimension that the formula needs is unknown, which is named, or the force is not positive.
    """
    if not (math.isfinite(force) and force > 0.0):
        raise ValueError(f"force must be positive and finite, got {force!r}")
    length = known_length(bearing, "effective_length")
    if formula == "palmgren":
        approach = (force / (PALMGREN * length ** (8.0 / 9.0))) ** (1.0 / ROLLER_EXPONENT)
        return approach, approach
    depth = force / (EFFECTIVE_MODULUS * length)
    if formula == "houpert":
        d, d_m = bearing.element_diameter, bearing.pitch_diameter
        t = BACKING_SHARE * d if backing is None else backing
        inner = (depth / 0.2723 * d_m**0.074) ** (1.0 / 1.074)
        return inner, (depth / 0.27835 * (t / (1.0 + d / d_m)) ** 0.078) ** (1.0 / 1.078)
    r_b = 0.5 * bearing.element_diameter
    curvatures = (
        1.0 / r_b + 1.0 / known_length(bearing, "inner_race_radius"),
        1.0 / r_b - 1.0 / known_length(bearing, "outer_race_radius"),
    )
    inner, outer = (
        4.0 / math.pi * depth * (1.8864 + math.log(length / (2.0 * line_contact_half_width(1.0 / c, length, force))))
        for c in curvatures
    )
    return inner, outer


def line_contact_stiffness(
    bearing: Bearing, force: float, formula: LineContact = "palmgren", *, backing: float | None = None
) -> float:
    """Return k_c, N/m^(10/9), with which a roller between both rings has the approach of a formula under a force, N.

    Arguments and errors as in ``line_contact_approaches``. Palmgren's k_c does not depend on the force.
    """
    return force / sum(line_contact_approaches(bearing, force, formula, backing=backing)) ** ROLLER_EXPONENT
