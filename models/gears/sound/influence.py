"""Matrices of the boundary integral equation: what panels radiate to points, over a rigid plane or in free space."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from models.gears.sound.panels import NEAR, Panels, StaticIntegrals, static_integrals

if TYPE_CHECKING:
    from numpy.typing import NDArray

_FAR_PAIRS = 100_000
"""Pairs of a point and a panel that are integrated at once: the arrays stay within a processor's cache."""
_QUARTER = 0.25 / np.pi


@dataclass(frozen=True, eq=False)
class NearPairs:
    """Pairs of a point and a near panel with their static integrals, which serve all wave numbers.

    Attributes:
        point, panel: (pairs,) places.
        static: integrals of 1 / r.
    """

    point: NDArray[np.int64]
    panel: NDArray[np.int64]
    static: StaticIntegrals


@dataclass(frozen=True, eq=False)
class Influence:
    """From panels, and their images where there is a plane, to points with a direction each.

    Attributes:
        x, normal_x: points and unit vectors there, (points, 3).
        sides: the panels, and their images.
        near: near pairs of each of the sides.
    """

    x: NDArray[np.float64]
    normal_x: NDArray[np.float64]
    sides: tuple[Panels, ...]
    near: tuple[NearPairs, ...]

    def matrices(self, wave_number: float, coupling: complex) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """Return both matrices at a wave number, 1/m, shape (points, panels) each.

        With c the coupling, the first is of dG/dn_y + c d2G/dn_x dn_y, the second of G + c dG/dn_x.
        """
        shape = len(self.x), len(self.sides[0].area)
        double, single = np.zeros(shape, np.complex128), np.zeros(shape, np.complex128)
        step = max(_FAR_PAIRS // shape[1], 1)
        for panels, near in zip(self.sides, self.near, strict=True):
            for first in range(0, shape[0], step):
                rows = slice(first, min(first + step, shape[0]))
                far = _far(self.x[rows], self.normal_x[rows], panels, wave_number, coupling)
                pairs = slice(*np.searchsorted(near.point, (rows.start, rows.stop)))
                places = near.point[pairs] - first, near.panel[pairs]
                for matrix, values in zip((double, single), far, strict=True):
                    values[places] = 0.0
                    matrix[rows] += values
            for matrix, values in zip((double, single), _near(self, panels, near, wave_number, coupling), strict=True):
                matrix[near.point, near.panel] += values
        return double, single


def influence(x: NDArray[np.float64], normal_x: NDArray[np.float64], panels: Panels, *, over_plane: bool) -> Influence:
    """Return the influence of panels on points, with the static integrals of near pairs.

    Args:
        x, normal_x: points and unit vectors there, (points, 3).
        panels: the panels.
        over_plane: whether the plane z = 0 is rigid, so that the panels have images.
    """
    sides = (panels, panels.mirrored()) if over_plane else (panels,)
    return Influence(x, normal_x, sides, tuple(_near_pairs(x, normal_x, side) for side in sides))


def _near_pairs(x: NDArray[np.float64], normal_x: NDArray[np.float64], panels: Panels) -> NearPairs:
    rows = [np.empty(0, np.int64)]
    columns = [np.empty(0, np.int64)]
    step = max(_FAR_PAIRS // len(panels.area), 1)
    for first in range(0, len(x), step):
        distance2 = np.sum((x[first : first + step, None] - panels.middle) ** 2, axis=2)
        row, column = np.nonzero(distance2 < (NEAR * panels.longest) ** 2)
        rows.append(row + first)
        columns.append(column)
    row, column = np.concatenate(rows), np.concatenate(columns)
    return NearPairs(
        row, column, static_integrals(x[row], normal_x[row], panels.corners[column], panels.normal[column])
    )


def _far(
    x: NDArray[np.float64], normal_x: NDArray[np.float64], panels: Panels, k: float, coupling: complex
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Return both matrices by the far rule, near pairs wrong."""
    double, single = np.zeros((2, len(x), len(panels.area)), np.complex128)
    points, weights = panels.points(near=False)
    middle = panels.middle.mean(axis=0)
    xm, facing = x - middle, normal_x @ panels.normal.T
    least = 1e-6 * float(panels.area.min())
    for y, weight in zip(np.moveaxis(points - middle, 1, 0), weights.T, strict=True):
        r2 = np.sum(xm**2, axis=1)[:, None] + np.sum(y**2, axis=1) - 2.0 * (xm @ y.T)
        np.maximum(r2, least, out=r2)
        along_y = xm @ panels.normal.T - np.sum(y * panels.normal, axis=1)
        along_x = np.sum(xm * normal_x, axis=1)[:, None] - normal_x @ y.T
        one, two = _kernels(r2, along_x, along_y, facing, k, coupling)
        double += one * weight
        single += two * weight
    return double, single


def _kernels(
    r2: NDArray[np.float64],
    along_x: NDArray[np.float64],
    along_y: NDArray[np.float64],
    facing: NDArray[np.float64],
    k: float,
    coupling: complex,
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Return dG/dn_y + c d2G/dn_x dn_y and G + c dG/dn_x."""
    r = np.sqrt(r2)
    wave = np.exp(-1j * k * r) * (_QUARTER / r)
    slope = (1.0 + 1j * k * r) / r2
    second = slope * facing + (k * k - 3.0 * slope) * (along_x * along_y / r2)
    return wave * (slope * along_y + coupling * second), wave * (1.0 - coupling * slope * along_x)


def _near(
    to: Influence, panels: Panels, near: NearPairs, k: float, coupling: complex
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Return the values of near pairs: static parts by the edges, the bounded rest by points."""
    static = near.static
    normal_x, normal_y = to.normal_x[near.point], panels.normal[near.panel]
    facing = np.sum(normal_x * normal_y, axis=1)
    double = static.double + coupling * (static.second + 0.5 * k * k * facing * static.single)
    single = static.single + coupling * static.adjoint
    points, weights = panels.points(near=True)
    for q in range(weights.shape[1]):
        between = to.x[near.point] - points[near.panel, q]
        r = np.sqrt(np.sum(between**2, axis=1))
        along_x, along_y = np.sum(between * normal_x, axis=1), np.sum(between * normal_y, axis=1)
        wave = np.exp(-1j * k * r)
        turned = (1.0 + 1j * k * r) * wave
        slope = (turned - 1.0) / r**3
        rest = (slope - 0.5 * k * k / r) * facing + (k * k * r**2 * wave - 3.0 * (turned - 1.0)) * (
            along_x * along_y / r**5
        )
        weight = weights[near.panel, q]
        double = double + weight * (slope * along_y + coupling * rest)
        single = single + weight * ((wave - 1.0) / r - coupling * slope * along_x)
    return _QUARTER * double, _QUARTER * single
