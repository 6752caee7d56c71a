"""Plane meshes of rings and hollow rollers with fine patches at several contacts, for ``benchmarks.fe_direct``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from models.fe.extra import require_skfem
from models.fe.meshes.sizing import growing_lines

if TYPE_CHECKING:
    from numpy.typing import NDArray


@dataclass(frozen=True)
class Fineness:
    """Elements over the half patch, half patch by the half width of the contact, and growth outwards."""

    columns: int = 5
    patch: float = 1.6
    growth: float = 1.5
    largest: float = 0.12


def annulus(angles: NDArray[np.float64], radii: NDArray[np.float64], *, closed: bool = False) -> Any:
    """Return a quadratic mesh between radii over angles from the y axis towards x; ``closed``: the last is the first.

    Boundaries: low and high (the first and last radius), x0 (the y axis, both ends of half a ring), y0.
    """
    skfem = require_skfem()
    columns = len(angles) - 1
    around = np.arange(columns + 1) % columns if closed else np.arange(columns + 1)
    count = columns if closed else columns + 1
    rows = len(radii)

    def number(i: NDArray[np.int64], j: NDArray[np.int64]) -> NDArray[np.int64]:
        return around[i] * rows + j

    i, j = (index.ravel() for index in np.meshgrid(np.arange(columns), np.arange(rows - 1), indexing="ij"))
    corners = np.stack((number(i, j), number(i + 1, j), number(i + 1, j + 1), number(i, j + 1)))
    grid = np.stack([a.ravel() for a in np.meshgrid(angles[:count], radii, indexing="ij")])
    linear = skfem.MeshQuad1(_polar(grid), corners)
    element = skfem.ElementQuad2()
    dofs = skfem.Dofs(linear, element)
    nodes = np.empty((2, dofs.N))
    local = np.asarray(element.doflocs)
    turn = angles[i] + np.multiply.outer(local[:, 0], angles[i + 1] - angles[i])
    radius = radii[j] + np.multiply.outer(local[:, 1], radii[j + 1] - radii[j])
    nodes[:, dofs.element_dofs] = _polar(np.stack((turn, radius)))
    mesh = skfem.MeshQuad2(nodes, linear.t)
    low, high = float(radii[0]), float(radii[-1])
    places: dict[str, Any] = {}
    facets = np.asarray(mesh.boundary_facets())
    ends = nodes[:, np.asarray(mesh.facets)[:, facets]]
    for name, chosen in (
        ("low", np.all(np.abs(np.hypot(*ends) - low) < 1e-7 * low, axis=0)),
        ("high", np.all(np.abs(np.hypot(*ends) - high) < 1e-7 * high, axis=0)),
        ("x0", np.all(np.abs(ends[0]) < 1e-9 * high, axis=0)),
        ("y0", np.all(np.abs(ends[1]) < 1e-9 * high, axis=0)),
    ):
        if np.any(chosen):
            places[name] = facets[chosen].astype(np.int32)
    return mesh.with_boundaries(places)


def _polar(place: NDArray[np.float64]) -> NDArray[np.float64]:
    angle, radius = place
    return np.stack((radius * np.sin(angle), radius * np.cos(angle)))


def lines_about(
    centres: NDArray[np.float64], begin: float, end: float, size: float, patch: float, fine: Fineness
) -> NDArray[np.float64]:
    """Return angles from begin to end with patches of a half width and a size of elements, rad, about centres."""
    cells = max(1, round(patch / size))
    half = np.linspace(0.0, patch, cells + 1)
    lines = [np.array([begin])] if centres[0] - begin > patch else []
    for k, centre in enumerate(centres):
        left = centre - half[::-1] if centre > begin else np.array([begin])
        right = centre + half[1:] if centre < end else np.zeros(0)
        if lines and left[0] - lines[-1][-1] > 1e-12:
            previous = float(lines[-1][-1])
            if k == 0:
                gap = left[0] - growing_lines(0.0, left[0] - previous, size, fine.growth, fine.largest)[::-1]
            else:
                middle = 0.5 * (previous + left[0])
                there = growing_lines(previous, middle, size, fine.growth, fine.largest)
                gap = np.concatenate((there, (previous + left[0] - there)[-2::-1]))
            lines.append(gap[1:-1])
        lines.extend((left, right))
    last = float(np.concatenate(lines)[-1])
    if end - last > 1e-12:
        lines.append(growing_lines(last, end, size, fine.growth, fine.largest)[1:])
    return np.concatenate(lines)


def depth_lines(race: float, back: float, size: float, fine: Fineness) -> NDArray[np.float64]:
    """Return radii, ascending, from a race with elements of a size growing towards the back, m."""
    depth = growing_lines(0.0, abs(back - race), size, fine.growth, fine.largest * race)
    return np.sort(race + np.sign(back - race) * depth)
