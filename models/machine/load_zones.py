"""How a radial and an axial load share out over smeared elements: load factor and largest load of every row.

An element at an angle psi from the load carries Q_max (1 - (1 - cos psi) / (2 eps))**n (Sassi, Badri and Thomas 2007,
Eq. 5). The load factor eps is 0.5 without clearance or axial load, less with clearance, more with an axial load, and
infinite where that acts alone. The axial load is carried at a working contact angle: the nominal one, or that under the
axial load where there is none. SI units and radians.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from models.machine.hertz import contact_exponent, contact_stiffness, known_length
from models.machine.load_distribution import ring_approach
from models.path.contour import inner_radius
from models.path.defect import race_radius
from models.words.numerics import find_root, integrate

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.machine.bearing import Bearing

GROOVE_RATIO = 0.52
"""Groove radius over ball diameter where a bearing's own is unknown: common in deep-groove bearings."""
_LARGEST_FACTOR = 1e5
_TOO_MANY_ROWS = "axial_load: {} has {} rows; how more than two share it is not described"


@dataclass(frozen=True)
class LoadZone:
    """How the elements of one row share its load.

    Attributes:
        factor: eps; 0 where the row is unloaded, infinite where all elements carry the same.
        largest: Q_max, N.
        exponent: n of the contact law.
    """

    factor: float
    largest: float
    exponent: float

    def load(self, psi: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the load of an element at angles from the load direction, N (Eq. 5)."""
        if self.factor == 0.0 or self.largest == 0.0:
            return np.zeros_like(psi)
        inside = 1.0 - (1.0 - np.cos(psi)) / (2.0 * self.factor)
        return self.largest * np.maximum(inside, 0.0) ** self.exponent


def zone_integrals(factor: float, exponent: float) -> tuple[float, float]:
    """Return J_r and J_a of any positive load factor: the mean over the ring of load / Q_max times cos psi, and of it.

    Raises:
        ValueError: if the factor is not positive.
    """
    if not factor > 0.0:
        raise ValueError(f"load factor must be positive, got {factor!r}")
    if math.isinf(factor):
        return 0.0, 1.0
    edge = math.acos(max(-1.0, 1.0 - 2.0 * factor))

    def share(psi: float) -> float:
        return max(0.0, 1.0 - (1.0 - math.cos(psi)) / (2.0 * factor)) ** exponent

    # Where the whole ring is loaded, the load across the radial one is taken off, of which cos psi leaves nothing.
    level = share(0.5 * math.pi) if factor >= 1.0 else 0.0
    radial = integrate(lambda psi: (share(psi) - level) * math.cos(psi), 0.0, edge, rtol=1e-9) / math.pi
    return radial, integrate(share, 0.0, edge, rtol=1e-9) / math.pi


def conforming(bearing: Bearing, groove_ratio: float = GROOVE_RATIO) -> Bearing:
    """Return a bearing of which no radius is unknown: races from pitch and element, grooves from their ratio."""
    groove = groove_ratio * bearing.element_diameter
    return replace(
        bearing,
        inner_race_radius=inner_radius(bearing),
        outer_race_radius=race_radius(bearing),
        inner_groove_radius=groove if bearing.inner_groove_radius is None else bearing.inner_groove_radius,
        outer_groove_radius=groove if bearing.outer_groove_radius is None else bearing.outer_groove_radius,
    )


def working_angle(bearing: Bearing, axial_load: float, k_c: float) -> float:
    """Return the contact angle with which balls carry an axial load, rad: the nominal one, or that which it makes.

    A deep-groove bearing has none until its grooves shift along the axis: |F_a| = Z K (A (1 / cos a - 1))**1.5 sin a
    with A the distance of the centres of the grooves' curvature (Harris, for a centric axial load).

    Raises:
        ValueError: if the elements cannot carry an axial load, or a groove radius is unknown.
    """
    if bearing.contact_angle > 0.0 or axial_load == 0.0:
        return bearing.contact_angle
    if bearing.element != "ball":
        raise ValueError(f"axial_load: {bearing.designation} has rollers without a contact angle, which carry none")
    if bearing.rows > 1:
        raise ValueError(f"axial_load: {bearing.designation} has several rows without a contact angle")
    grooves = known_length(bearing, "inner_groove_radius") + known_length(bearing, "outer_groove_radius")
    distance = grooves - bearing.element_diameter
    most = bearing.n_elements * k_c

    def missing(angle: float) -> float:
        stretch = distance * (1.0 / math.cos(angle) - 1.0)
        return most * stretch**1.5 * math.sin(angle) / abs(axial_load) - 1.0

    return find_root(missing, 0.0, 0.5 * math.pi - 1e-6, rtol=1e-12)


def load_zones(
    bearing: Bearing,
    load: float,
    axial_load: float = 0.0,
    *,
    clearance: float = 0.0,
    k_c: float | None = None,
    factor: float | None = None,
) -> tuple[LoadZone, ...]:
    """Return the load zone of every row.

    A light axial load is carried beside the radial one and changes nothing; a heavier one widens the zone of a single
    row, and shifts load from the second row to the first of two, or back if it is negative.

    Args:
        k_c: contact stiffness of an element, N/m^n, which clearance and an angle that the axial load makes need; by
            default that of the geometry.
        factor: eps of all rows, instead of the one that follows.

    Raises:
        ValueError: if the bearing cannot carry the axial load, or a radius that is needed is unknown.
    """
    n = contact_exponent(bearing)
    if load == 0.0 and axial_load == 0.0:
        return (LoadZone(0.5, 0.0, n),) * bearing.rows
    stiffness = 0.0
    if clearance > 0.0 or (axial_load != 0.0 and bearing.contact_angle == 0.0):
        stiffness = contact_stiffness(bearing) if k_c is None else k_c
    angle = working_angle(bearing, axial_load, stiffness)
    if load == 0.0:
        return _axial_only(bearing, axial_load, angle, n)
    base = factor if factor is not None else _factor_of_clearance(bearing, load, stiffness, clearance)
    ratio = axial_load / (load * math.tan(angle)) if axial_load != 0.0 and factor is None else 0.0
    if bearing.rows == 2 and ratio != 0.0:
        return _two_rows(bearing, load, angle, base, ratio, n)
    if bearing.rows > 1:
        if ratio != 0.0:
            raise ValueError(_TOO_MANY_ROWS.format(bearing.designation, bearing.rows))
        return (LoadZone(base, load / _shared(bearing, angle, zone_integrals(base, n)[0]), n),) * bearing.rows
    single = _widened(base, abs(ratio), n)
    return (LoadZone(single, load / _shared(bearing, angle, zone_integrals(single, n)[0]), n),)


def _shared(bearing: Bearing, angle: float, integral: float) -> float:
    return bearing.n_elements * bearing.rows * math.cos(angle) * integral


def _factor_of_clearance(bearing: Bearing, load: float, k_c: float, clearance: float) -> float:
    if clearance == 0.0:
        return 0.5
    return 0.5 * (1.0 - clearance / ring_approach(bearing, load, k_c, clearance))


def _axial_only(bearing: Bearing, axial_load: float, angle: float, n: float) -> tuple[LoadZone, ...]:
    if bearing.rows > 2:
        raise ValueError(_TOO_MANY_ROWS.format(bearing.designation, bearing.rows))
    loaded = LoadZone(math.inf, abs(axial_load) / (bearing.n_elements * math.sin(angle)), n)
    if bearing.rows == 1:
        return (loaded,)
    idle = LoadZone(0.0, 0.0, n)
    return (loaded, idle) if axial_load > 0.0 else (idle, loaded)


def _widened(base: float, ratio: float, n: float) -> float:
    """Return the factor with which a row carries F_a / (F_r tan a) = J_a / J_r, at least ``base``."""

    def missing(factor: float) -> float:
        radial, axial = zone_integrals(factor, n)
        return axial / radial - ratio

    if ratio == 0.0 or missing(base) >= 0.0:
        return base
    high = 2.0 * base
    while missing(high) < 0.0 and high < _LARGEST_FACTOR:
        high *= 2.0
    return high if high >= _LARGEST_FACTOR else find_root(missing, base, high, rtol=1e-10)


def _two_rows(
    bearing: Bearing, load: float, angle: float, base: float, ratio: float, n: float
) -> tuple[LoadZone, LoadZone]:
    """Return the zones of two rows, whose factors add up to twice that without an axial load while both are loaded."""

    def parts(first: float) -> tuple[float, float, float, float]:
        """Return the second factor, its largest load over the first's, and what both rows carry radially, axially."""
        second = max(0.0, 2.0 * base - first)
        share = (second / first) ** n
        radial, axial = zone_integrals(first, n)
        if second > 0.0:
            others = zone_integrals(second, n)
            radial, axial = radial + share * others[0], axial - share * others[1]
        return second, share, radial, axial

    def missing(first: float) -> float:
        _, _, radial, axial = parts(first)
        return axial / radial - abs(ratio)

    high = 2.0 * base
    while missing(high) < 0.0 and high < _LARGEST_FACTOR:
        high *= 2.0
    first = high if high >= _LARGEST_FACTOR else find_root(missing, base, high, rtol=1e-10)
    second, share, radial, _ = parts(first)
    largest = load / (bearing.n_elements * math.cos(angle) * radial)
    pair = (LoadZone(first, largest, n), LoadZone(second, share * largest, n))
    return pair if ratio > 0.0 else (pair[1], pair[0])
