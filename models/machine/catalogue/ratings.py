"""Basic load ratings of rolling bearings from their internal geometry (ISO 76 and ISO 281).

A maker prints the ratings and not the geometry. Two ratings of one bearing nearly determine the number and the size of
its elements, so the series of the catalogue are derived from them, and every derived row is checked against them.
Lengths in mm, forces in N: the units in which both standards state their factors.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np

from models.machine.catalogue.designation import BALLS, Family
from models.machine.hertz import point_contact_semi_axes

_CONTACT_STRESS_MPA = {"deep_groove": 4200.0, "angular_contact": 4200.0, "self_aligning": 4600.0}
"""Greatest contact stress at the static rating of ball bearings (ISO 76, 4.2)."""
_BALL_FACTOR = 38.19
"""Leading factor of f_c of ball bearings; gives the table of ISO 281 within 0.3 % for gamma of 0.05 to 0.4."""
_SELF_ALIGNING_FACTOR = 1.0 / 0.95
"""ISO/TR 1281-1 reduces f_c of groove bearings by 0.95, that of self-aligning ones not."""
_ROLLER_FACTOR = 207.9 * 0.83
_RATING_FACTOR = {
    "deep_groove": 1.3,
    "angular_contact": 1.3,
    "self_aligning": 1.3,
    "cylindrical": 1.1,
    "tapered": 1.1,
    "spherical": 1.15,
}
"""b_m of contemporary materials (ISO 281, tables 1 and 5)."""


@dataclass(frozen=True)
class Internal:
    """What the ratings depend on: counts, lengths in mm, contact angle in rad."""

    family: Family
    n_elements: int
    element_diameter: float
    pitch_diameter: float
    rows: int = 1
    contact_angle: float = 0.0
    effective_length: float = 0.0

    @property
    def gamma(self) -> float:
        """D_w cos(alpha) / D_pw."""
        return self.element_diameter * math.cos(self.contact_angle) / self.pitch_diameter


def static_rating(bearing: Internal) -> float:
    """Return C_0r, N (ISO 76: 5.2 for balls, 7.1 for rollers)."""
    elements = bearing.rows * bearing.n_elements * bearing.element_diameter * math.cos(bearing.contact_angle)
    if bearing.family in BALLS:
        return static_factor(bearing.gamma, bearing.family) * elements * bearing.element_diameter
    return 44.0 * (1.0 - bearing.gamma) * elements * bearing.effective_length


def dynamic_rating(bearing: Internal) -> float:
    """Return C_r, N (ISO 281: 5.1 for balls, 7.1 for rollers)."""
    cosine, gamma = math.cos(bearing.contact_angle), bearing.gamma
    factor = _RATING_FACTOR[bearing.family]
    if bearing.family in BALLS:
        size = bearing.element_diameter
        power = size**1.8 if size <= 25.4 else 3.647 * size**1.4
        return (
            factor
            * _ball_factor(gamma, bearing.family)
            * (bearing.rows * cosine) ** 0.7
            * bearing.n_elements ** (2.0 / 3.0)
            * power
        )
    return (
        factor
        * _roller_factor(gamma)
        * (bearing.rows * bearing.effective_length * cosine) ** (7.0 / 9.0)
        * bearing.n_elements**0.75
        * bearing.element_diameter ** (29.0 / 27.0)
    )


def static_factor(gamma: float, family: Family) -> float:
    """Return f_0 of ISO 76, table 1, for balls, interpolated between exact values (relative error below 1e-4).

    Raises:
        ValueError: if gamma lies outside 0.01 to 0.45.
    """
    if not 0.01 <= gamma <= 0.45:
        raise ValueError(f"f_0 is tabled for gamma from 0.01 to 0.45, got {gamma!r}")
    places, values = _static_factors(family)
    return float(np.interp(gamma, places, values))


@cache
def _static_factors(family: Family) -> tuple[tuple[float, ...], tuple[float, ...]]:
    places = tuple(float(place) for place in np.linspace(0.01, 0.45, 89))
    return places, tuple(_exact_static_factor(place, family) for place in places)


def _exact_static_factor(gamma: float, family: Family) -> float:
    """Return f_0: a fifth of the force per squared diameter at which the worse race reaches the limiting stress.

    Conformities of ISO 76: 0.52 and 0.53 of grooves; 0.53 inside, and a sphere outside, of self-aligning bearings.
    """
    radius, pitch = 0.5, 0.5 / gamma
    inner, outer = pitch - radius, pitch + radius
    grooves = (0.53, outer) if family == "self_aligning" else (0.52, 0.53)
    forces: list[float] = []
    for race, groove in zip((inner, -outer), grooves, strict=True):
        rolling, across = 1.0 / (1.0 / radius + 1.0 / race), 1.0 / (1.0 / radius - 1.0 / groove)
        unit = 1e-3
        major, minor = point_contact_semi_axes(rolling * unit, across * unit, 1.0, "elliptic")
        # Stress grows with the cube root of the force; ISO 76 takes 207 GPa, hertz.py 210 GPa.
        stress = 1.5 / (math.pi * major * minor) * (207.0 / 210.0) ** (2.0 / 3.0)
        forces.append((_CONTACT_STRESS_MPA[family] * 1e6 / stress) ** 3)
    return min(forces) / 5.0


def _ball_factor(gamma: float, family: Family) -> float:
    """Return f_c of balls (ISO 281, table 2; Lundberg and Palmgren)."""
    shape = ((1.0 - gamma) / (1.0 + gamma)) ** 1.72
    inner, factor, ratio = 0.52, _BALL_FACTOR, 1.0
    if family == "self_aligning":
        inner, outer = 0.53, 0.5 * (1.0 + 1.0 / gamma)
        factor *= _SELF_ALIGNING_FACTOR
        ratio = inner * (2.0 * outer - 1.0) / (outer * (2.0 * inner - 1.0))
    return (
        factor
        * (1.0 + (1.04 * shape * ratio**0.41) ** (10.0 / 3.0)) ** -0.3
        * gamma**0.3
        * (1.0 - gamma) ** 1.39
        / (1.0 + gamma) ** (1.0 / 3.0)
        * (2.0 * inner / (2.0 * inner - 1.0)) ** 0.41
    )


def _roller_factor(gamma: float) -> float:
    """Return f_c of rollers (ISO 281, table 7; Lundberg and Palmgren)."""
    shape = ((1.0 - gamma) / (1.0 + gamma)) ** (143.0 / 108.0)
    return (
        _ROLLER_FACTOR
        * (1.0 + (1.04 * shape) ** 4.5) ** (-2.0 / 9.0)
        * gamma ** (2.0 / 9.0)
        * (1.0 - gamma) ** (29.0 / 27.0)
        / (1.0 + gamma) ** 0.25
    )
