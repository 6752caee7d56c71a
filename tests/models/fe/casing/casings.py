"""Small casings that the tests share."""

from __future__ import annotations

import functools
import math

import numpy as np

from models.fe.casing.model import Casing
from models.fe.casing.shape import STEEL, CasingMeshRule, CasingShape, Foot, Material, Seat

LENGTH, HEIGHT, THICKNESS = 0.4, 0.3, 0.03
SIMPLY = {"x0": (1, 2), "x1": (1, 2), "y0": (0, 2), "y1": (0, 2)}
"""Hard simple supports of a plate: at an edge nothing moves along it or across the plate."""


@functools.cache
def plate(cells: int, thickness: float = THICKNESS, through: int = 1) -> Casing:
    """A simply supported plate with so many cells along x."""
    return Casing(CasingShape.plate(LENGTH, HEIGHT, thickness), STEEL, CasingMeshRule(LENGTH / cells, through), SIMPLY)


def box_shape(cover: float = 0.004, mass: float = 0.0, spider: str = "rigid") -> CasingShape:
    """A box on two feet with a seat in each end wall."""
    seats = tuple(
        Seat(f"seat{n}", wall, (0.1, 0.08), 0.04, 0.06, 0.02, cover, mass, spider)  # type: ignore[arg-type]
        for n, wall in enumerate(("z0", "z1"), 1)
    )
    feet = (Foot((0.0, 0.05), (0.0, 0.12)), Foot((0.15, 0.2), (0.0, 0.12)))
    return CasingShape.box((0.2, 0.16, 0.12), 0.01, seats, feet)


@functools.cache
def box(spider: str = "rigid", mass: float = 0.0) -> Casing:
    """The box, coarse."""
    return Casing(box_shape(mass=mass, spider=spider), STEEL, CasingMeshRule(0.1))


def mindlin(m: int, n: int, thickness: float = THICKNESS, material: Material = STEEL) -> float:
    """Natural frequency, Hz, of a plate on hard simple supports by Mindlin's theory, shear factor 5/6.

    The deflection is sin(m pi x / a) sin(n pi y / b), for which the equations of bending and shear are two by two
    (Mindlin, J. Applied Mechanics 18 (1951) 31).
    """
    square = (m * math.pi / LENGTH) ** 2 + (n * math.pi / HEIGHT) ** 2
    shear = 5.0 / 6.0 * 0.5 * material.modulus / (1.0 + material.poisson) * thickness
    bending = material.modulus * thickness**3 / 12.0 / (1.0 - material.poisson**2)
    mass, rotary = material.density * thickness, material.density * thickness**3 / 12.0
    root = math.sqrt(square)
    stiffness = np.array([[shear * square, -shear * root], [-shear * root, shear + bending * square]])
    values = np.linalg.eigvals(stiffness / np.array([[mass], [rotary]]))
    return math.sqrt(float(values.real.min())) / math.tau
