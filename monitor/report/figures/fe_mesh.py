"""Drawings of meshes of finite elements: what a plane of symmetry and a surface show."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection

from monitor.report.figures.drawing import GREY, INK

_AXIS_NAMES = ("x, mm", "y, mm", "z, mm")


def draw_boundary(
    axes: Axes,
    mesh: Any,
    name: str,
    shown: tuple[int, int],
    reach: float | None = None,
    *,
    fill: str = "#f4f4f4",
) -> None:
    """Draw the facets of a boundary of a mesh, projected on two axes, mm.

    Args:
        axes: to draw on.
        mesh: of scikit-fem, with named boundaries, m.
        name: of the boundary: "z0" is the section across the shaft, "x0" that along it.
        shown: which coordinates go across and up.
        reach: half the size of what is shown about the contact, m; all of it if None.
        fill: colour of the elements.
    """
    corners = 1e3 * mesh.doflocs[:, mesh.facets[:, mesh.boundaries[name]]]
    outlines = corners[list(shown)].transpose(2, 1, 0)
    axes.add_collection(PolyCollection(list(outlines), facecolors=fill, edgecolors=INK, linewidths=0.4))
    axes.set_aspect("equal")
    axes.set_xlabel(_AXIS_NAMES[shown[0]])
    axes.set_ylabel(_AXIS_NAMES[shown[1]])
    axes.tick_params(colors=GREY)
    if reach is None:
        axes.autoscale_view()
        return
    contact = 1e3 * mesh.doflocs[:, mesh.facets[:, mesh.boundaries["contact"]]].reshape(3, -1)
    at = contact[:, np.argmin(contact[0] ** 2 + contact[2] ** 2)]
    across, up = at[list(shown)]
    axes.set_xlim(across - 1e3 * reach, across + 1e3 * reach)
    axes.set_ylim(up - 1e3 * reach, up + 1e3 * reach)
