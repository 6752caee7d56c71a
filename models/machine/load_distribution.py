"""How the elements of a bearing share a radial load, and how stiff the bearing is while they roll, healthy or damaged.

Two descriptions: the sum over the elements at their places (Eqs. 19-25 and 61), and the integral that smears them over
the ring (Eqs. 13, 26, 27, 30 and 31), as catalogues and the thesis do. SI units; angles from the load direction.

How a radial and an axial load share out over smeared elements: load factor and largest load of every row.

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

from models.machine.hertz import (
    contact_exponent,
    contact_forces,
    contact_stiffness,
    element_angles,
    known_length,
    static_equilibrium,
)
from models.path.contour import inner_radius
from models.path.defect import ball_path, race_radius, wrap
from models.words.numerics import find_root, integrate

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from models.machine.bearing import Bearing
    from models.machine.scene import Defect


@dataclass(frozen=True, eq=False)
class LoadDistribution:
    """The loads of all elements at one cage angle, N, row after row, and their angles within -pi and pi, rad.

    The displacement is that of the inner against the outer ring, m, shape (2,): along the load, across it.
    """

    angles: NDArray[np.float64]
    loads: NDArray[np.float64]
    displacement: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class StiffnessPassage:
    """The stiffness of a bearing while its cage turns by one spacing of the elements of a row.

    Attributes:
        cage_angle: cage angles, rad, shape (points,).
        matrix: stiffness at each, N/m, shape (points, 2, 2); [:, 0, 0] is k_yy of the thesis (along the load),
            [:, 1, 1] its k_xx (across), [:, 0, 1] its k_xy.
    """

    cage_angle: NDArray[np.float64]
    matrix: NDArray[np.float64]

    @property
    def mean(self) -> NDArray[np.float64]:
        """Mean over the passage, N/m, shape (2, 2)."""
        return np.mean(self.matrix, axis=0)

    @property
    def swing(self) -> NDArray[np.float64]:
        """Largest less smallest value of both diagonal terms, divided by their mean, shape (2,): along, across."""
        diagonal = np.diagonal(self.matrix, axis1=1, axis2=2)
        return np.ptp(diagonal, axis=0) / np.mean(diagonal, axis=0)

    @property
    def largest_coupling(self) -> float:
        """Largest absolute value of the cross term, N/m."""
        return float(np.abs(self.matrix[:, 0, 1]).max())


def load_integral(extent: float, exponent: float) -> float:
    """Return J_r, the share of the load that the smeared elements carry (Eqs. 13 and 31; Sjoevall's integral).

    J_r = 1/(2 pi) * integral over the loaded zone of (1 - (1 - cos psi) / (2 extent))**exponent cos psi.

    ``extent`` is the load factor (1 - h/delta_r) / 2: 0.5 without clearance, less with it.

    Raises:
        ValueError: if the extent is not within (0, 0.5].
    """
    if not 0.0 < extent <= 0.5:
        raise ValueError(f"load factor must lie above 0 and not above 0.5, got {extent!r}")
    edge = math.acos(max(-1.0, 1.0 - 2.0 * extent))

    def density(psi: float) -> float:
        return max(0.0, 1.0 - (1.0 - math.cos(psi)) / (2.0 * extent)) ** exponent * math.cos(psi)

    return integrate(density, 0.0, edge, rtol=1e-10) / math.pi


def ring_approach(bearing: Bearing, load: float, k_c: float, clearance: float = 0.0) -> float:
    """Return the radial displacement delta_r of the ring on smeared elements, m (Eq. 31, solved).

    Raises:
        ValueError: if the load is not positive, or the clearance negative.
    """
    if not (math.isfinite(load) and load > 0.0):
        raise ValueError(f"load must be finite and positive, got {load!r}")
    if not (math.isfinite(clearance) and clearance >= 0.0):
        raise ValueError(f"clearance must be finite and not negative, got {clearance!r}")
    n = contact_exponent(bearing)
    elements = bearing.n_elements * bearing.rows
    tight = (load / (elements * k_c * load_integral(0.5, n))) ** (1.0 / n)
    if clearance == 0.0:
        return tight

    def missing(squeeze: float) -> float:
        extent = 0.5 * squeeze / (squeeze + clearance)
        return elements * k_c * squeeze**n * load_integral(extent, n) / load - 1.0

    # With clearance fewer elements carry the load, so they are squeezed more.
    high = 2.0 * tight
    while missing(high) < 0.0:
        high *= 2.0
    return clearance + find_root(missing, tight, high, xtol=1e-18, rtol=1e-13)


def load_zone(approach: float, clearance: float = 0.0) -> float:
    """Return the extent of the loaded zone, rad (Eq. 26), zero where the rings do not touch the elements."""
    if approach <= clearance:
        return 0.0
    return 2.0 * math.acos(clearance / approach)


def largest_element_load(bearing: Bearing, load: float, k_c: float, clearance: float = 0.0) -> float:
    """Return Q_max of the smeared elements, N (Eq. 30; Eq. 13 without clearance)."""
    return k_c * (ring_approach(bearing, load, k_c, clearance) - clearance) ** contact_exponent(bearing)


def elements_in_zone(bearing: Bearing, zone: float) -> int:
    """Return how many elements of a row the loaded zone holds from the load direction to one side (Table 12).

    One element stands in the load direction and is counted, so that the whole zone holds twice the number less one.
    """
    return 1 + math.floor(0.5 * zone / (2.0 * math.pi / bearing.n_elements))


def load_distribution(
    bearing: Bearing, load: float, k_c: float, *, clearance: float = 0.0, cage_angle: float = 0.0
) -> LoadDistribution:
    """Return the load of every element at one cage angle (Eqs. 20, 23 and 24).

    Raises:
        ValueError: if load or clearance is negative or not finite.
    """
    angles, exponent = element_angles(bearing, cage_angle), contact_exponent(bearing)
    u = static_equilibrium(angles, load, k_c, clearance=clearance, exponent=exponent)
    delta = np.maximum(u[0] * np.cos(angles) + u[1] * np.sin(angles) - clearance, 0.0)
    return LoadDistribution(wrap(angles), k_c * delta**exponent, u)


def stiffness_over_passage(
    bearing: Bearing, load: float, k_c: float, *, clearance: float = 0.0, defect: Defect | None = None, points: int = 96
) -> StiffnessPassage:
    """Return the stiffness while one element of a row follows the other (Eq. 61; Figs. 36 and 37).

    An element over a defect sinks by d(phi), by which its contact loosens: the clearance there is h + d.

    The defect is one of the outer race; ``points`` cage angles lie evenly over one spacing of a row.

    Raises:
        ValueError: if load or clearance is negative, or the defect does not fit the bearing.
    """
    if defect is not None:
        _check_defect(bearing, defect)
    path, exponent = ball_path(bearing, defect), contact_exponent(bearing)
    cage_angle = 2.0 * math.pi / bearing.n_elements * np.arange(points) / points
    matrix = np.empty((points, 2, 2))
    for i, turn in enumerate(cage_angle):
        angles = element_angles(bearing, float(turn))
        gaps = np.full(len(angles), clearance)
        if path is not None and defect is not None:
            first = defect.first_row * bearing.n_elements
            damaged = slice(first, first + defect.rows * bearing.n_elements)
            gaps[damaged] += path(wrap(angles[damaged]))[0]
        u = static_equilibrium(angles, load, k_c, clearance=gaps, exponent=exponent)
        matrix[i] = contact_forces(u, angles, k_c, gaps, exponent)[1]
    return StiffnessPassage(cage_angle, matrix)


def _check_defect(bearing: Bearing, defect: Defect) -> None:
    if defect.part != "outer":
        raise ValueError(f"defect.part must be 'outer', which stands still, got {defect.part!r}")
    if not (defect.first_row >= 0 and 1 <= defect.rows <= bearing.rows - defect.first_row):
        raise ValueError(
            f"{bearing.designation} has {bearing.rows} rows, got defect.rows {defect.rows!r} "
            f"from defect.first_row {defect.first_row!r}"
        )


def stiffness_against_load(
    bearing: Bearing, loads: Sequence[float], k_c: float, *, clearance: float = 0.0, points: int = 64
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return displacement along the load, m, shape (loads,), and stiffness, N/m, shape (loads, 2, 2), of several loads.

    Both are means over a passage of the elements. For one cage angle k_yy is the slope dF/d delta of Eqs. 28 and 29
    where the elements stand symmetrically about the load.
    """
    spacing = 2.0 * math.pi / (bearing.n_elements * bearing.rows)
    exponent = contact_exponent(bearing)
    displacement, stiffness = np.zeros(len(loads)), np.zeros((len(loads), 2, 2))
    for i, load in enumerate(loads):
        for k in range(points):
            angles = element_angles(bearing, spacing * k / points)
            u = static_equilibrium(angles, load, k_c, clearance=clearance, exponent=exponent)
            displacement[i] += u[0] / points
            stiffness[i] += contact_forces(u, angles, k_c, clearance, exponent)[1] / points
    return displacement, stiffness


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
