"""A shaft of Timoshenko beam elements: stiffness and consistent mass, discs, couplings, natural frequencies.

Source: Thibault et al. 2022, section II.1 (four elements, a disc in the middle, elastic couplings at both ends).
Elements after Przemieniecki, Theory of Matrix Structural Analysis, with shear by Cowper's coefficient of a hollow
circle. Each node has x, y, z, and the turns about x, y and z, with z along the shaft; SI units. Nothing is damped, and
gyroscopic moments are left out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from models.words.checks import check_numbers, check_whole
from models.words.numerics import generalised_eigenvalues

if TYPE_CHECKING:
    from numpy.typing import NDArray

X, Y, Z, TURN_X, TURN_Y, TURN_Z = range(6)
"""Places of the coordinates of a node."""
PER_NODE = 6


@dataclass(frozen=True)
class Shaft:
    """A hollow shaft of even section.

    Attributes:
        length, outer_diameter, inner_diameter: m.
        elements: number of equal elements.
        modulus, poisson, density: Pa, 1 and kg/m3.
    """

    length: float = 0.4
    outer_diameter: float = 0.04
    inner_diameter: float = 0.03
    elements: int = 4
    modulus: float = 200e9
    poisson: float = 0.3
    density: float = 7800.0

    def __post_init__(self) -> None:
        """Raise a ValueError that names the field of an unusable value."""
        check_numbers(self, "shaft.", "positive", "length", "outer_diameter", "modulus", "density")
        check_numbers(self, "shaft.", "not negative", "inner_diameter", "poisson")
        check_whole(self.elements, "shaft.elements", 1)
        if self.inner_diameter >= self.outer_diameter:
            raise ValueError(f"shaft.inner_diameter must be less than the outer one, got {self.inner_diameter!r} m")
        if self.poisson > 0.5:
            raise ValueError(f"shaft.poisson must not exceed 0.5, got {self.poisson!r}")

    @property
    def nodes(self) -> int:
        """Number of nodes."""
        return self.elements + 1

    @property
    def area(self) -> float:
        """Cross-section, m2."""
        return 0.25 * math.pi * (self.outer_diameter**2 - self.inner_diameter**2)

    @property
    def second_moment(self) -> float:
        """I of the cross-section, m4; the polar one is twice that."""
        return math.pi / 64.0 * (self.outer_diameter**4 - self.inner_diameter**4)

    @property
    def shear_modulus(self) -> float:
        """G, Pa."""
        return 0.5 * self.modulus / (1.0 + self.poisson)

    @property
    def shear_coefficient(self) -> float:
        """Share of the cross-section that carries shear (Cowper 1966)."""
        m2, nu = (self.inner_diameter / self.outer_diameter) ** 2, self.poisson
        whole = (1.0 + m2) ** 2
        return 6.0 * (1.0 + nu) * whole / ((7.0 + 6.0 * nu) * whole + (20.0 + 12.0 * nu) * m2)


@dataclass(frozen=True)
class Disc:
    """A rigid disc at a node: mass, kg, moments of inertia about the shaft and across it, kg m2."""

    node: int
    mass: float
    polar: float
    across: float


@dataclass(frozen=True)
class Coupling:
    """A torsional spring, N m/rad, from a node to a free inertia, kg m2, outside the shaft."""

    node: int
    stiffness: float
    inertia: float


def shaft_matrices(shaft: Shaft) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return stiffness and consistent mass of a free shaft, (6 nodes, 6 nodes) each, node after node."""
    size = PER_NODE * shaft.nodes
    stiffness, mass = np.zeros((size, size)), np.zeros((size, size))
    k, m = element_matrices(shaft)
    for element in range(shaft.elements):
        both = slice(PER_NODE * element, PER_NODE * (element + 2))
        stiffness[both, both] += k
        mass[both, both] += m
    return stiffness, mass


def element_matrices(shaft: Shaft) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return stiffness and consistent mass of one element, (12, 12) each."""
    h, second = shaft.length / shaft.elements, shaft.second_moment
    stiffness, mass = np.zeros((12, 12)), np.zeros((12, 12))
    rod_k, rod_m = np.array([[1.0, -1.0], [-1.0, 1.0]]) / h, np.array([[2.0, 1.0], [1.0, 2.0]]) * h / 6.0
    for place, elastic, inert in (
        (Z, shaft.modulus * shaft.area, shaft.density * shaft.area),
        (TURN_Z, shaft.shear_modulus * 2.0 * second, shaft.density * 2.0 * second),
    ):
        ends = np.ix_([place, PER_NODE + place], [place, PER_NODE + place])
        stiffness[ends] += elastic * rod_k
        mass[ends] += inert * rod_m
    k, m = _bending(shaft, h)
    # A positive turn about y bends towards x, one about x towards -y.
    for shift, turn, sign in ((X, TURN_Y, 1.0), (Y, TURN_X, -1.0)):
        places = [shift, turn, PER_NODE + shift, PER_NODE + turn]
        signs = np.array([1.0, sign, 1.0, sign])
        stiffness[np.ix_(places, places)] += k * np.outer(signs, signs)
        mass[np.ix_(places, places)] += m * np.outer(signs, signs)
    return stiffness, mass


def _bending(shaft: Shaft, h: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return stiffness and mass of bending in one plane, of (shift, slope) at both ends, (4, 4) each.

    The mass is that of the element's own static shapes under shift and rotary inertia, integrated exactly.
    """
    bending = shaft.modulus * shaft.second_moment
    shear = shaft.shear_coefficient * shaft.area * shaft.shear_modulus
    phi = 12.0 * bending / (shear * h**2)
    stiffness = (
        bending
        / ((1.0 + phi) * h**3)
        * np.array(
            [
                [12.0, 6.0 * h, -12.0, 6.0 * h],
                [6.0 * h, (4.0 + phi) * h**2, -6.0 * h, (2.0 - phi) * h**2],
                [-12.0, -6.0 * h, 12.0, -6.0 * h],
                [6.0 * h, (2.0 - phi) * h**2, -6.0 * h, (4.0 + phi) * h**2],
            ]
        )
    )
    # Four Gauss points are exact for squares of cubics.
    points, weights = np.polynomial.legendre.leggauss(4)
    mass = np.zeros((4, 4))
    for point, weight in zip(0.5 * (points + 1.0), 0.5 * h * weights, strict=True):
        shift, slope = _shapes(float(point), h, phi)
        mass += (
            float(weight)
            * shaft.density
            * (shaft.area * np.outer(shift, shift) + shaft.second_moment * np.outer(slope, slope))
        )
    return stiffness, mass


def _shapes(s: float, h: float, phi: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return shift and slope of the section at s of 0 to 1 by those of both ends, (4,) each."""
    shift = np.array(
        [
            1.0 + phi - phi * s - 3.0 * s**2 + 2.0 * s**3,
            h * ((1.0 + 0.5 * phi) * s - (2.0 + 0.5 * phi) * s**2 + s**3),
            phi * s + 3.0 * s**2 - 2.0 * s**3,
            h * (-0.5 * phi * s - (1.0 - 0.5 * phi) * s**2 + s**3),
        ]
    )
    slope = np.array(
        [
            6.0 * (s**2 - s) / h,
            1.0 + phi - (4.0 + phi) * s + 3.0 * s**2,
            6.0 * (s - s**2) / h,
            -(2.0 - phi) * s + 3.0 * s**2,
        ]
    )
    return shift / (1.0 + phi), slope / (1.0 + phi)


def add_disc(mass: NDArray[np.float64], disc: Disc) -> None:
    """Add a disc to the mass matrix of a shaft, in place."""
    for place, value in (
        (X, disc.mass),
        (Y, disc.mass),
        (Z, disc.mass),
        (TURN_X, disc.across),
        (TURN_Y, disc.across),
        (TURN_Z, disc.polar),
    ):
        mass[PER_NODE * disc.node + place, PER_NODE * disc.node + place] += value


def torsion_frequencies(
    shaft: Shaft, discs: tuple[Disc, ...] = (), couplings: tuple[Coupling, ...] = ()
) -> NDArray[np.float64]:
    """Return the natural frequencies of torsion, Hz, ascending, of a shaft that is free to turn; the first is 0.

    Raises:
        ValueError: if a node is not one of the shaft.
    """
    for part in (*discs, *couplings):
        if not 0 <= part.node < shaft.nodes:
            raise ValueError(f"the shaft has nodes 0 to {shaft.nodes - 1}, got {part.node!r}")
    k, m = shaft_matrices(shaft)
    for disc in discs:
        add_disc(m, disc)
    size = shaft.nodes + len(couplings)
    stiffness, mass = np.zeros((size, size)), np.zeros((size, size))
    stiffness[: shaft.nodes, : shaft.nodes] = k[TURN_Z::PER_NODE, TURN_Z::PER_NODE]
    mass[: shaft.nodes, : shaft.nodes] = m[TURN_Z::PER_NODE, TURN_Z::PER_NODE]
    for place, coupling in enumerate(couplings, shaft.nodes):
        ends = np.ix_([coupling.node, place], [coupling.node, place])
        stiffness[ends] += coupling.stiffness * np.array([[1.0, -1.0], [-1.0, 1.0]])
        mass[place, place] = coupling.inertia
    squares = generalised_eigenvalues(stiffness, mass)
    # The turning as a whole is zero but for rounding.
    return np.sqrt(np.maximum(squares, 0.0)) / (2.0 * math.pi)
