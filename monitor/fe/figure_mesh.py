"""Drawings of meshes of finite elements: what a plane of symmetry and a surface show."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from numpy.typing import NDArray

from monitor.report.figures.drawing import INK, SHADE

_AXIS_NAMES = ("x, mm", "y, mm", "z, mm")
_POINTS_OF_EDGE = 6
_MARGIN = 0.06


def draw_boundary(
    axes: Axes, mesh: Any, name: str, shown: tuple[int, int], reach: float | None = None, *, fill: str = SHADE
) -> None:
    """Draw the facets of a boundary of a mesh, projected on two axes, mm.

    Args:
        axes: to draw on.
        mesh: hexahedra of scikit-fem with named boundaries, m; edges of quadratic ones are drawn curved.
        name: of the boundary: "z0" is the section across the shaft, "x0" that along it.
        shown: which coordinates go across and up.
        reach: how far about the contact is shown, m; all of it if None.
        fill: colour of the elements.
    """
    outlines = 1e3 * _outlines(mesh, np.asarray(mesh.facets)[:, mesh.boundaries[name]])[list(shown)]
    axes.add_collection(PolyCollection(list(outlines.T), facecolors=fill, edgecolors=INK, linewidths=0.4))
    axes.set_aspect("equal")
    axes.grid(visible=False)
    axes.set_xlabel(_AXIS_NAMES[shown[0]])
    axes.set_ylabel(_AXIS_NAMES[shown[1]])
    low, high = outlines.min(axis=(1, 2)), outlines.max(axis=(1, 2))
    if reach is not None:
        contact = 1e3 * mesh.doflocs[:, mesh.facets[:, mesh.boundaries["contact"]]].reshape(3, -1)
        at = contact[:, np.argmin(contact[0] ** 2 + contact[2] ** 2)][list(shown)]
        low, high = np.maximum(low, at - 1e3 * reach), np.minimum(high, at + 1e3 * reach)
    margin = _MARGIN * float(np.max(high - low))
    axes.set_xlim(low[0] - margin, high[0] + margin)
    axes.set_ylim(low[1] - margin, high[1] + margin)


def _outlines(mesh: Any, facets: NDArray[np.int32]) -> NDArray[np.float64]:
    """Return the outlines of facets, given by their four vertices (4, n), shape (3, points, n), m."""
    ends = np.stack((facets, np.roll(facets, -1, axis=0)))
    first, last = mesh.doflocs[:, ends[0]], mesh.doflocs[:, ends[1]]
    middle = 0.5 * (first + last)
    if mesh.doflocs.shape[1] > mesh.nvertices:
        pairs = np.sort(np.asarray(mesh.edges), axis=0).astype(np.int64)
        keys = pairs[0] * mesh.nvertices + pairs[1]
        order = np.argsort(keys)
        wanted = np.sort(ends, axis=0).astype(np.int64)
        found = order[np.searchsorted(keys[order], wanted[0] * mesh.nvertices + wanted[1])]
        middle = mesh.doflocs[:, np.asarray(mesh.dofs.edge_dofs)[0, found]]
    t = np.arange(_POINTS_OF_EDGE)[:, None] / _POINTS_OF_EDGE
    shares = ((1.0 - t) * (1.0 - 2.0 * t), 4.0 * t * (1.0 - t), t * (2.0 * t - 1.0))
    points = [share * place[:, :, None] for share, place in zip(shares, (first, middle, last), strict=True)]
    return np.sum(points, axis=0).reshape(3, -1, facets.shape[1])
