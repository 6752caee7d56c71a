"""Priors of a rig's parameters from the geometry of its bearing and its shaft, with source and uncertainty."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from models.identify.evidence import Prior
from models.machine.contact_estimates import STEEL_DENSITY, estimate_stiffness

if TYPE_CHECKING:
    from models.machine.bearing import CatalogueEntry

# Standard uncertainty of the logarithm: of Hertz' theory with the simplified coefficients against printed and exact
# values (2 to 7 %), and of the mass of a plain shaft, which has steps, nuts and a part beyond the other bearing that
# moves less.
_HERTZ, _SHAFT = 0.05, 0.25
# Rings fill so much of the space between their race and the bore or the outside; as a lower limit of what moves.
_RING = 0.8
_LIMIT = 0.1


def geometry_priors(entry: CatalogueEntry, shaft: tuple[float, float] | None = None) -> list[Prior]:
    """Return what geometry tells of a rig.

    k_c follows from Hertz (balls) or Palmgren (rollers) with the bound of what is not known of the contacts. The mass
    of a plain steel shaft and the inner ring is that of m_i. The rings alone are lower limits of m_i and m_o: a casing
    is not part of the bearing.

    Args:
        entry: the bearing; without its dimensions nothing is said of its rings.
        shaft: diameter and length of the shaft that belongs to this bearing, m: about half of that between bearings.

    Raises:
        ValueError: if a known radius of the bearing does not conform.
    """
    stiffness = estimate_stiffness(entry)
    formula = "Hertz" if entry.bearing.element == "ball" else "Palmgren"
    bound = 0.25 * math.log(stiffness.high / stiffness.low)
    words = f"{formula}, contacts of {entry.bearing.designation}"
    if stiffness.estimated:
        words += f", {', '.join(stiffness.estimated)} estimated"
    priors = [Prior("k_c", stiffness.value, math.hypot(_HERTZ, bound), words)]
    inner, outer = _ring_masses(entry)
    if outer is not None:
        priors.append(Prior("m_o", outer, _LIMIT, f"outer ring of {entry.bearing.designation}", at_least=True))
    if shaft is not None:
        diameter, length = shaft
        mass = STEEL_DENSITY * 0.25 * math.pi * diameter**2 * length + (inner or 0.0)
        words = f"steel shaft of {diameter * 1e3:g} mm x {length * 1e3:g} mm and inner ring"
        priors.append(Prior("m_i", mass, _SHAFT, words))
    elif inner is not None:
        priors.append(Prior("m_i", inner, _LIMIT, f"inner ring of {entry.bearing.designation}", at_least=True))
    return priors


def _ring_masses(entry: CatalogueEntry) -> tuple[float | None, float | None]:
    """Return the masses of inner and outer ring, kg, None where dimensions are not known."""
    if entry.dimensions is None:
        return None, None
    bore, outside, width = entry.dimensions
    bearing = entry.bearing
    reach = bearing.element_diameter * math.cos(bearing.contact_angle)
    inner_race, outer_race = bearing.pitch_diameter - reach, bearing.pitch_diameter + reach
    scale = _RING * STEEL_DENSITY * 0.25 * math.pi * width
    inner, outer = scale * (inner_race**2 - bore**2), scale * (outside**2 - outer_race**2)
    return (inner if inner > 0.0 else None), (outer if outer > 0.0 else None)
