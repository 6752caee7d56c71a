"""Contact stiffness k_c where the geometry that it needs is not known, with its bound.

Rules: races at the pitch radius less and plus the element's radius times the cosine of the contact angle; grooves of
0.52 of the ball diameter, between 0.51 and 0.54, the same at both races (ISO 76 rates up to 0.52 inside and 0.53
outside; printed ones are 0.514, 0.516 and 0.54 in bearings.toml and by Ceruti);
the outer race of a two-row ball bearing a sphere (self-aligning); a roller as long as in its series within 20 %, else
1.2 times as long as its diameter, between 0.8 and 1.6. Line contacts follow Palmgren, or another formula of
``models.machine.line_contact`` under the load of the most loaded roller; for Houpert's, the housing is as thick as the
outer ring, between none and three times as thick.

Line contacts of steel rollers after Palmgren, Houpert and Lundberg; Palmgren is used where no other is named.

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
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, get_args

from models.machine.bearing import Bearing, CatalogueEntry
from models.machine.hertz import (
    EFFECTIVE_MODULUS,
    PALMGREN,
    ROLLER_EXPONENT,
    contact_stiffness,
    known_length,
    line_contact_half_width,
)
from models.machine.load_distribution import largest_element_load

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


_CONFORMITY = (0.51, 0.52, 0.54)
_ROLLER_PROPORTION = (0.8, 1.2, 1.6)
_LENGTH_RANGE = 0.2
_DEVIATIONS = 2.0
# Thickness behind the outer race over that of ring and an equally thick housing.
_BACKING_RANGE = (0.5, 2.0)
# Density of bearing steel, kg/m3.
STEEL_DENSITY = 7810.0


@dataclass(frozen=True)
class StiffnessEstimate:
    """k_c and its bound, N/m^1.5 (balls) or N/m^(10/9) (rollers).

    Attributes:
        low, high: the bound: every estimated value moved over its range, two standard deviations for those that have
            one, and the effects added in quadrature; those of both grooves are added up, as one maker chooses both.
        bearing: the bearing with the estimated values in the place of unknown ones.
        estimated: names of the fields that are estimates; "backing" is the thickness behind the outer race.
        force: on the element for which the value holds, N, or None where it holds for any.
    """

    value: float
    low: float
    high: float
    bearing: Bearing
    estimated: tuple[str, ...]
    force: float | None = None


def element_mass(bearing: Bearing) -> float:
    """Return the mass of one rolling element of steel, kg; a roller needs its length."""
    if bearing.element == "ball":
        return STEEL_DENSITY * math.pi / 6.0 * bearing.element_diameter**3
    if bearing.effective_length is None:
        raise ValueError(f"the rollers of {bearing.designation} have no effective_length")
    return STEEL_DENSITY * math.pi / 4.0 * bearing.element_diameter**2 * bearing.effective_length


def estimate_stiffness(
    entry: CatalogueEntry, line_contact: LineContact = "palmgren", load: float | None = None
) -> StiffnessEstimate:
    """Return k_c of one element between both rings, unknown values of its geometry estimated, and its bound.

    Known values that are estimates widen the bound.

    Args:
        line_contact: formula of the contact of rollers; balls have none.
        load: radial load of the bearing, N, under which a formula other than Palmgren's is taken.

    Raises:
        ValueError: if a known radius does not conform; if there is no positive load for a formula that needs one.
    """
    bearing, origins = entry.bearing, entry.origins
    ranges = _unknown_ranges(bearing)
    if "effective_length" in ranges and entry.series_length is not None:
        length = entry.series_length
        ranges["effective_length"] = ((1.0 - _LENGTH_RANGE) * length, length, (1.0 + _LENGTH_RANGE) * length)
    filled = replace(bearing, **{name: values[1] for name, values in ranges.items()})
    law = _law(entry, filled, line_contact, load)
    value = law(filled)
    estimated = list(ranges)
    moved = {name: (values[0], values[2]) for name, values in ranges.items()}
    for name in ("element_diameter", "effective_length"):
        origin = origins.get(name)
        known = getattr(bearing, name)
        if origin is not None and origin.kind == "estimated" and known is not None:
            reach = _DEVIATIONS * origin.spread
            moved[name] = (known * (1.0 - reach), known * (1.0 + reach))
            estimated.append(name)
    lower = upper = 0.0
    grooves = [0.0, 0.0]
    for name, ends in moved.items():
        effects = [math.log(law(_moved(bearing, filled, name, end)) / value) for end in ends]
        down, up = min(*effects, 0.0), max(*effects, 0.0)
        if name.endswith("groove_radius"):
            grooves = [grooves[0] + down, grooves[1] + up]
        else:
            lower, upper = math.hypot(lower, down), math.hypot(upper, up)
    lower, upper = math.hypot(lower, grooves[0]), math.hypot(upper, grooves[1])
    if law.backing is not None:
        estimated.append("backing")
        effects = [math.log(replace(law, backing=share * law.backing)(filled) / value) for share in _BACKING_RANGE]
        lower, upper = math.hypot(lower, min(effects)), math.hypot(upper, max(effects))
    low, high = value * math.exp(-lower), value * math.exp(upper)
    return StiffnessEstimate(value, low, high, filled, tuple(estimated), law.force)


@dataclass(frozen=True)
class _Law:
    """k_c of a bearing whose geometry is known: Hertz, Palmgren, or a formula under a force with what it needs."""

    formula: LineContact
    force: float | None
    backing: float | None

    def __call__(self, bearing: Bearing) -> float:
        if self.force is None:
            return contact_stiffness(bearing)
        return line_contact_stiffness(bearing, self.force, self.formula, backing=self.backing)


def _law(entry: CatalogueEntry, filled: Bearing, formula: LineContact, load: float | None) -> _Law:
    if filled.element == "ball" or formula == "palmgren":
        return _Law(formula, None, None)
    if load is None:
        raise ValueError(f"the contact stiffness of {filled.designation} after {formula} needs a load")
    # Without clearance the share of the most loaded roller does not depend on k_c.
    force = largest_element_load(filled, load, 1.0)
    if formula != "houpert":
        return _Law(formula, force, None)
    ring = RING_SHARE * filled.element_diameter
    if entry.dimensions is not None and filled.outer_race_radius is not None:
        ring = max(0.5 * entry.dimensions[1] - filled.outer_race_radius, 0.1 * ring)
    return _Law(formula, force, 2.0 * ring)


def _unknown_ranges(bearing: Bearing) -> dict[str, tuple[float, float, float]]:
    """Return least, likeliest and largest value of each unknown length that k_c needs, m."""
    radius = 0.5 * bearing.element_diameter * math.cos(bearing.contact_angle)
    inner, outer = 0.5 * bearing.pitch_diameter - radius, 0.5 * bearing.pitch_diameter + radius
    # Races lie where the elements touch them, within one per cent of the pitch radius.
    ranges: dict[str, tuple[float, float, float]] = {
        "inner_race_radius": (0.99 * inner, inner, 1.01 * inner),
        "outer_race_radius": (0.99 * outer, outer, 1.01 * outer),
    }
    if bearing.element == "ball":
        low, usual, high = (share * bearing.element_diameter for share in _CONFORMITY)
        ranges["inner_groove_radius"] = ranges["outer_groove_radius"] = (low, usual, high)
        if bearing.rows == 2:
            race = bearing.outer_race_radius or outer
            ranges["outer_groove_radius"] = (0.99 * race, race, 1.01 * race)
    else:
        low, usual, high = (share * bearing.element_diameter for share in _ROLLER_PROPORTION)
        ranges["effective_length"] = (low, usual, high)
    return {name: values for name, values in ranges.items() if getattr(bearing, name) is None}


def _moved(bearing: Bearing, filled: Bearing, name: str, value: float) -> Bearing:
    """Return the filled bearing with one field at another value; another diameter moves what follows from it."""
    if name != "element_diameter":
        return replace(filled, **{name: value})
    moved = replace(bearing, element_diameter=value, effective_length=filled.effective_length)
    return replace(moved, **{key: ends[1] for key, ends in _unknown_ranges(moved).items()})
