"""Orbits of a shaft: the path of each of its points across the axis."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase
from matplotlib.ticker import MaxNLocator

from models.trajectories import Trajectories
from monitor.report.figures.drawing import AXIS, BLUE, GREY, VERMILION
from monitor.report.figures.sheet import Part
from monitor.words.numbers import figure
from monitor.words.sensors import PLACES

_MICROMETRES = 1e6
# Free space around an orbit, over its extent; largest clearance that is shown whole, over the extent.
_MARGIN, _WHOLE_CIRCLE = 0.08, 12.0
# Points of an orbit in the data of a page.
_DATA_POINTS = 1500


def orbit_part(speed: float, moved: Trajectories) -> Part:
    """Return the orbits of the points of a shaft that turns at ``speed``, Hz."""
    turns = moved.step * moved.place.shape[2] * speed

    def draw(made: FigureBase) -> None:
        panels = np.atleast_1d(made.subplots(1, len(moved.points)))
        for number, axes in enumerate(panels):
            draw_orbit(axes, moved, number, speed)
            axes.set_title(f"{moved.points[number].upper()}, {PLACES[moved.points[number]]}", loc="left", fontsize=9.5)
        panels[0].set_ylabel("along the load (µm)")

    travel = _MICROMETRES * moved.travel()
    named = zip(moved.points, travel, strict=True)
    words = "; ".join(f"{point.upper()} {figure(along)} x {figure(across)} µm" for point, (along, across) in named)
    caption = (
        f"{figure(turns, 2)} turns of the shaft, from the load (downwards) to the right; a dot for each turn. "
        f"Travel along and across the load: {words} (steps: {figure(100.0 * moved.error, 2)} % of the largest)."
    )
    if not all(math.isnan(free) for free in moved.clearance):
        caption += " Circle: the radial clearance, beyond which balls are pressed."
    every = max(1, moved.place.shape[2] // _DATA_POINTS)
    data: dict[str, Any] = {"clearance_um": [_MICROMETRES * free for free in moved.clearance]}
    for point, (along, across) in zip(moved.points, moved.place[:, :, ::every], strict=True):
        data |= {f"along_{point}_um": _MICROMETRES * along, f"across_{point}_um": _MICROMETRES * across}
    label = f"Orbits of {len(moved.points)} points of the shaft: {words}."
    return Part("Orbits", caption, label, 3.3, draw, data, "orbits")


def draw_orbit(axes: Axes, moved: Trajectories, number: int, speed: float) -> None:
    """Draw the orbit of a point, µm, with equal axes: the load points downwards, across it to the right."""
    along, across = _MICROMETRES * moved.place[number]
    free = _MICROMETRES * moved.clearance[number]
    axes.plot(across, along, color=BLUE, lw=0.6)
    turns = np.arange(0.0, moved.place.shape[2], 1.0 / (speed * moved.step)).astype(np.intp)
    axes.plot(across[turns], along[turns], ".", color=VERMILION, ms=4.0)
    reach = 0.5 * max(float(np.ptp(across)), float(np.ptp(along)), 1e-3)
    middle = np.array([0.5 * (across.max() + across.min()), 0.5 * (along.max() + along.min())])
    if 0.0 < free < _WHOLE_CIRCLE * reach:
        angle = np.linspace(0.0, 2.0 * math.pi, 361)
        axes.plot(free * np.cos(angle), free * np.sin(angle), color=GREY, lw=0.9, ls="--")
        low = np.minimum(middle - reach, -free)
        high = np.maximum(middle + reach, free)
        reach, middle = 0.5 * float(np.max(high - low)), 0.5 * (low + high)
        axes.plot(0.0, 0.0, "+", color=AXIS, ms=6)
    reach *= 1.0 + _MARGIN
    axes.set(
        xlim=(middle[0] - reach, middle[0] + reach),
        # Downwards, as the load.
        ylim=(middle[1] + reach, middle[1] - reach),
        xlabel="across it (µm)",
    )
    axes.set_aspect("equal", adjustable="box")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(5))
