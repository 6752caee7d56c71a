"""An RMS map as a picture, one panel a load and speed."""

from __future__ import annotations

import math
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PatchCollection
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from models.rms_map import RmsMap
from streams.block import STANDARD_GRAVITY

_MOST_PANELS = 12
_V_EQ_MM2 = {0.005: 0.6, 0.02: 0.45, 0.05: 0.3, 0.1: 0.12}
"""Volumes whose hyperbolas are drawn, mm3 per mm of width, and the share of the panel's height where each is named."""


def draw_map(rms_map: RmsMap, path: Path) -> None:
    """Draw RMS in g over extent and depth, with lines of equal volume; PNG or SVG by the name's ending.

    Maps of more than twelve conditions show the first twelve and say so.

    Raises:
        OSError: the file cannot be written.
    """
    conditions = [(i, j) for i in range(len(rms_map.load)) for j in range(len(rms_map.speed))]
    shown = conditions[:_MOST_PANELS]
    columns = min(2, len(shown))
    rows = math.ceil(len(shown) / columns)
    figure = Figure(figsize=(6.2 * columns, 4.2 * rows), layout="constrained")
    FigureCanvasAgg(figure)
    rms = rms_map.rms / STANDARD_GRAVITY
    highest = float(np.nanmax(rms))
    extent, depth = np.degrees(rms_map.dphi_d), rms_map.h_d * 1e6
    panels = figure.subplots(rows, columns, squeeze=False)
    mesh = None
    for axes, (i, j) in zip(panels.flat, shown, strict=False):
        mesh = axes.pcolormesh(extent, depth, rms[i, j], shading="gouraud", cmap="viridis", vmin=0.0, vmax=highest)
        _volumes(axes, rms_map, extent, depth)
        _falls(axes, rms_map.falling("h_d")[i, j], extent, depth)
        axes.set(
            title=f"{rms_map.load[i]:g} N, {rms_map.speed[j]:g} Hz",
            xlabel="extent of the defect [deg]",
            ylabel="depth of the defect [µm]",
            xlim=(extent[0], extent[-1]),
            ylim=(depth[0], depth[-1]),
        )
    for axes in panels.flat[len(shown) :]:
        axes.set_visible(False)
    if mesh is not None:
        figure.colorbar(mesh, ax=panels, label="RMS of the casing [g]", shrink=0.9)
    figure.suptitle(_caption(rms_map, len(conditions) - len(shown)), fontsize=8)
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "spallwatch"}):
        figure.savefig(path, dpi=130, metadata={"Date": None} if path.suffix.lower() == ".svg" else None)


def _volumes(axes: Axes, rms_map: RmsMap, extent: np.ndarray, depth: np.ndarray) -> None:
    """Draw V_eq = r_o dphi_d h_d for a few volumes (Eq. 90)."""
    span = np.linspace(max(extent[0], 0.05), extent[-1], 400)
    for volume, height in _V_EQ_MM2.items():
        h = volume * 1e-6 / (rms_map.outer_race_radius * np.radians(span)) * 1e6
        inside = (h >= depth[0]) & (h <= depth[-1])
        if np.count_nonzero(inside) < 2:
            continue
        axes.plot(span[inside], h[inside], color="white", lw=0.9, ls="--")
        # Each label at a height of its own, so that labels of neighbouring lines stand apart.
        place = np.flatnonzero(inside & (h >= min(float(h[inside][0]), depth[0] + height * (depth[-1] - depth[0]))))[-1]
        right = bool(span[place] > 0.7 * extent[-1])
        axes.annotate(
            f"{volume:g} mm³/mm",
            (span[place], h[place]),
            xytext=(-4, 4) if right else (4, 2),
            textcoords="offset points",
            color="white",
            fontsize=7,
            ha="right" if right else "left",
            va="bottom",
        )


def _falls(axes: Axes, falling: np.ndarray, extent: np.ndarray, depth: np.ndarray) -> None:
    """Make pale the steps of depth along which the RMS falls, so that a level does not tell one depth."""
    edges = np.concatenate(([extent[0]], 0.5 * (extent[1:] + extent[:-1]), [extent[-1]]))
    boxes = [
        Rectangle((edges[d], depth[h]), edges[d + 1] - edges[d], depth[h + 1] - depth[h])
        for h, d in np.argwhere(falling).tolist()
    ]
    axes.add_collection(PatchCollection(boxes, facecolor=(1.0, 1.0, 1.0, 0.35), edgecolor="none"))


def _caption(rms_map: RmsMap, left_out: int) -> str:
    plan = rms_map.plan
    band = "full bandwidth" if plan.rms_band is None else f"{plan.rms_band[0]:g} to {plan.rms_band[1]:g} Hz"
    floors = "" if plan.floors == 1 else f", mean of {plan.floors}"
    more = "" if left_out == 0 else f"; {left_out} more conditions not shown"
    calibrated = "calibrated" if plan.rig.calibrated else "parameters not calibrated on this machine"
    slip = "" if plan.slip is None else f", slip up to {math.degrees(plan.slip.phi_slip):.2g} deg"
    return (
        f"{plan.bearing.designation}, {plan.floor.kind} floor{floors}{slip}, RMS in {band}{more}\n"
        f"{calibrated}; pale: RMS falls with depth; dashed: equal volume"
    )
