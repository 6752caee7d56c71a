"""What a figure over time holds for those who zoom into it: the blocks themselves, thinned where nobody could see them.

The page carries it as JSON beside the static picture; where scripts are on, ``templates/zoom.js`` draws charts of it.
"""

from __future__ import annotations

import base64
import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from monitor.report.figures.drawing import TimeAxis, colour_name, places_kept, with_breaks

Column = NDArray[np.float64]
BINS = 600
"""Columns of a picture; of each the extremes of every line are kept, so that nothing that stands out is lost."""
_VENDOR = "web/static/vendor"


@dataclass(frozen=True, eq=False)
class Line:
    """A line of a chart: its name, its colour as in the picture, its values, and "line", "dashed" or "dots"."""

    label: str
    colour: str
    values: Column
    kind: str = "line"


@dataclass(frozen=True, eq=False)
class Band:
    """A filled span of a chart."""

    label: str
    colour: str
    lower: Column
    upper: Column


@dataclass(frozen=True, eq=False)
class Panel:
    """A chart.

    Attributes:
        axes: of the picture, which say how the vertical axis is called and scaled.
        lines: of it, in the order in which they are drawn.
        bands: below the lines.
        levels: name, colour and value of horizontal lines.
        top: the highest value that the axis may show, NaN for any.
        height: relative to the others.
    """

    axes: Axes
    lines: Sequence[Line]
    bands: Sequence[Band] = ()
    levels: Sequence[tuple[str, str, float]] = ()
    top: float = math.nan
    height: float = 1.0


def zoom_data(
    axis: TimeAxis,
    time: Column,
    panels: Sequence[Panel],
    *,
    marks: Sequence[tuple[str, str, float, str]] = (),
    ticks: Sequence[tuple[str, str, Column, bool]] = (),
    shade: Sequence[float] = (),
    bins: int = BINS,
) -> dict[str, Any]:
    """Return charts as plain values for the page.

    All columns share one horizontal axis: a block is kept where any line has an extreme of its bin, and all its values
    with it, so that nothing between two blocks is made up.

    Args:
        axis: of the picture.
        time: ascending, s (or numbers of blocks).
        panels: from top to bottom.
        marks: name, colour, moment and matplotlib's line style of vertical lines.
        ticks: name, colour and moments of what is marked at the foot of the first chart, or at its top where true.
        shade: ends of a span with a background, or nothing.
        bins: see :data:`BINS`.

    Returns:
        What ``zoom.js`` reads: ``start`` and ``steps`` in seconds, ``panels``, ``marks``, ``ticks``, ``shade``.
    """
    columns: list[Column] = []

    def take(values: Column) -> int:
        for place, other in enumerate(columns):
            if np.array_equal(other, values, equal_nan=True):
                return place
        columns.append(values)
        return len(columns) - 1

    charts = [_chart(panel, take) for panel in panels]
    broken = [with_breaks(time, values)[1] for values in columns]
    x, _ = with_breaks(time, time)
    ends = np.array([0, x.size - 1])
    keep = np.unique(np.concatenate([ends, *(places_kept(x, values, bins) for values in broken)]))
    seconds = np.round(x[keep] - x[0], 3)
    return {
        "start": round(float(x[0]), 3),
        "steps": [_short(step) for step in np.round(np.diff(seconds), 3).tolist()],
        "columns": [[_brief(value) for value in values[keep].tolist()] for values in broken],
        "panels": charts,
        "dated": axis.dated,
        "unit": axis.unit,
        "label": axis.label,
        "zone": str(axis.zone),
        "marks": [
            {"label": name, "colour": colour_name(colour), "at": round(at, 3), "style": style}
            for name, colour, at, style in marks
            if math.isfinite(at)
        ],
        "ticks": [
            {
                "label": name,
                "colour": colour_name(colour),
                "at": np.round(at[_some(at)], 3).tolist(),
                "all": int(at.size),
                "top": top,
            }
            for name, colour, at, top in ticks
            if at.size
        ],
        "shade": [round(float(end), 3) for end in shade],
    }


def _chart(panel: Panel, take: Any) -> dict[str, Any]:
    lines, seen = [], set()
    for line in panel.lines:
        if np.isfinite(line.values).any() and (place := take(line.values)) not in seen:
            seen.add(place)
            lines.append({"label": line.label, "colour": colour_name(line.colour), "kind": line.kind, "column": place})
    return {
        "label": panel.axes.get_ylabel(),
        "log": panel.axes.get_yscale() == "log",
        "height": panel.height,
        "top": _brief(panel.top),
        "lines": lines,
        "bands": [
            {"label": band.label, "colour": colour_name(band.colour), "columns": [take(band.lower), take(band.upper)]}
            for band in panel.bands
            if np.isfinite(band.lower).any()
        ],
        "levels": [
            {"label": name, "colour": colour_name(colour), "value": _brief(value)}
            for name, colour, value in panel.levels
            if math.isfinite(value)
        ],
    }


def _some(at: Column, most: int = 500) -> NDArray[np.intp]:
    """Return which of many marks to draw, spread over all of them."""
    return np.unique(np.linspace(0, at.size - 1, min(at.size, most)).round().astype(np.intp))


def _brief(value: float) -> float | int | None:
    """Return a value to four figures, which is finer than any screen; None where there is none."""
    return _short(float(f"{value:.4g}")) if math.isfinite(value) else None


def _short(value: float) -> float | int:
    return int(value) if value == int(value) else value


def zoom_json(data: Mapping[str, Any]) -> str:
    """Return charts as JSON that may stand in a page: no name in it can end its element."""
    text = json.dumps(data, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def zoom_script() -> str:
    """Return the script that draws the charts, with the library that it draws them with and that one's licence."""
    vendor = resources.files("monitor").joinpath(_VENDOR)
    licence = vendor.joinpath("uPlot.LICENSE").read_text(encoding="utf-8").strip()
    library = vendor.joinpath("uPlot.iife.min.js").read_text(encoding="utf-8").strip()
    ours = resources.files("monitor.report").joinpath("templates/zoom.js").read_text(encoding="utf-8").strip()
    return f"/*\n{licence}\n*/\n{library}\n{ours}\n"


def zoom_style() -> str:
    """Return the style sheet of the library and of the charts."""
    library = resources.files("monitor").joinpath(f"{_VENDOR}/uPlot.min.css").read_text(encoding="utf-8")
    return library + resources.files("monitor.report").joinpath("templates/zoom.css").read_text(encoding="utf-8")


def policy_hash(script: str) -> str:
    """Return by what a Content-Security-Policy allows this script and no other."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()}'"
