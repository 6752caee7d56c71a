"""Data of figures over time for charts that can be zoomed.

The page carries them as JSON beside the static picture; ``templates/zoom.js`` draws the charts where scripts are on.
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

from monitor.report.figures.drawing import COLOUR_NAMES, TimeAxis, places_kept, with_breaks

Column = NDArray[np.float64]
BINS = 600
"""Columns of a picture; of each the extremes of every line are kept."""
_MAX_TICKS = 500


@dataclass(frozen=True, eq=False)
class Line:
    """A line of a chart; ``kind`` is "line", "dashed" or "dots"."""

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
    """A chart with bands below its lines.

    Attributes:
        axes: of the picture, for label and scale of the vertical axis.
        levels: name, colour and value of horizontal lines.
        top: upper limit of the vertical axis, NaN for none.
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
    """Return the plain values that ``zoom.js`` reads.

    All columns share one horizontal axis: a block is kept, with all its values, where any line has an extreme of its
    bin.

    Args:
        axis: of the picture.
        time: ascending, s or block numbers.
        panels: from the top.
        marks: name, colour, time and matplotlib's line style of vertical lines.
        ticks: name, colour and times of marks at the foot (False) or the top (True) of the first chart.
        shade: ends of a shaded span, empty for none.
        bins: see :data:`BINS`.
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
            {"label": name, "colour": COLOUR_NAMES[colour], "at": round(at, 3), "style": style}
            for name, colour, at, style in marks
            if math.isfinite(at)
        ],
        "ticks": [_ticks(*item) for item in ticks if item[2].size],
        "shade": [round(float(end), 3) for end in shade],
    }


def _chart(panel: Panel, take: Any) -> dict[str, Any]:
    lines, seen = [], set()
    for line in panel.lines:
        if np.isfinite(line.values).any() and (place := take(line.values)) not in seen:
            seen.add(place)
            lines.append({"label": line.label, "colour": COLOUR_NAMES[line.colour], "kind": line.kind, "column": place})
    return {
        "label": panel.axes.get_ylabel(),
        "log": panel.axes.get_yscale() == "log",
        "height": panel.height,
        "top": _brief(panel.top),
        "lines": lines,
        "bands": [
            {"label": band.label, "colour": COLOUR_NAMES[band.colour], "columns": [take(band.lower), take(band.upper)]}
            for band in panel.bands
            if np.isfinite(band.lower).any()
        ],
        "levels": [
            {"label": name, "colour": COLOUR_NAMES[colour], "value": _brief(value)}
            for name, colour, value in panel.levels
            if math.isfinite(value)
        ],
    }


def _ticks(name: str, colour: str, at: Column, top: bool) -> dict[str, Any]:
    shown = np.unique(np.linspace(0, at.size - 1, min(at.size, _MAX_TICKS)).round().astype(np.intp))
    times = np.round(at[shown], 3).tolist()
    return {"label": name, "colour": COLOUR_NAMES[colour], "at": times, "all": int(at.size), "top": top}


def _brief(value: float) -> float | int | None:
    """Return a value to four figures, None for NaN."""
    return _short(float(f"{value:.4g}")) if math.isfinite(value) else None


def _short(value: float) -> float | int:
    return int(value) if value == int(value) else value


def zoom_json(data: Mapping[str, Any]) -> str:
    """Return charts as JSON that is safe inside a script element."""
    text = json.dumps(data, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def zoom_script() -> str:
    """Return the script that draws the charts, with its library and the library's licence."""
    licence, library = (_file(f"web/static/vendor/uPlot.{name}").strip() for name in ("LICENSE", "iife.min.js"))
    return f"/*\n{licence}\n*/\n{library}\n{_file('report/templates/zoom.js').strip()}\n"


def zoom_style() -> str:
    """Return the style sheet of the library and of the charts."""
    return _file("web/static/vendor/uPlot.min.css") + _file("report/templates/zoom.css")


def _file(path: str) -> str:
    return resources.files("monitor").joinpath(path).read_text(encoding="utf-8")


def policy_hash(script: str) -> str:
    """Return the source of a Content-Security-Policy that allows this script only."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()}'"
