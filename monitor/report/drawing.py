"""Drawing for the page: thinning that keeps extremes, time axes, and inline SVG that stands by itself."""

from __future__ import annotations

import io
import itertools
import re
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib import dates
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from numpy.typing import NDArray

BLUE, VERMILION, GREEN, PURPLE, SKY, ORANGE, GREY = (
    *("#0072b2", "#d55e00", "#009e73", "#a3527f", "#56b4e9", "#b07a00", "#5f6670"),
)
"""Colours that are told apart by everybody (after Okabe and Ito), two of them darkened to be read on white."""

STYLE: Any = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans", "Helvetica", "Arial"],
    "font.size": 9.5,
    "axes.edgecolor": "#8a9099",
    "axes.labelcolor": "#22262b",
    "axes.linewidth": 0.8,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e3e6ea",
    "grid.linewidth": 0.7,
    "xtick.color": "#4a5058",
    "ytick.color": "#4a5058",
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "lines.linewidth": 1.3,
    "svg.fonttype": "none",
    "svg.hashsalt": "spallwatch",
}
"""Settings of matplotlib under which every figure is made, as a decorator: ``@mpl.rc_context(STYLE)``."""
WIDTH = 9.6
"""Width of every figure in inches: the page scales it."""


class TimeAxis(NamedTuple):
    """How seconds become positions on the horizontal axis.

    Attributes:
        dated: whether positions are dates rather than multiples of ``unit``.
        unit: seconds in one unit of the axis.
        label: of the axis.
        timed: whether it is an axis of time at all.
    """

    dated: bool
    unit: float
    label: str
    timed: bool = True

    def position(self, time: NDArray[np.float64] | float) -> Any:
        """Return positions of moments in seconds."""
        return np.asarray(time) / (86400.0 if self.dated else self.unit)

    def settle(self, axes: Axes) -> None:
        """Label an axis; dates are days since 1970, as matplotlib counts them."""
        if self.dated:
            locator = dates.AutoDateLocator(maxticks=9)
            axes.xaxis.set_major_locator(locator)
            axes.xaxis.set_major_formatter(dates.ConciseDateFormatter(locator))
        axes.set_xlabel(self.label)


BLOCK_AXIS = TimeAxis(False, 1.0, "block", timed=False)
"""The axis where a recording knows no times: numbers of blocks."""


def time_axis(time: NDArray[np.float64], *, dated: bool) -> TimeAxis:
    """Choose the axis for moments in seconds."""
    if dated:
        return TimeAxis(True, 86400.0, "UTC")
    span = float(np.ptp(time)) if time.size else 0.0
    for limit, unit, name in ((300.0, 1.0, "seconds"), (3 * 3600.0, 60.0, "minutes"), (96 * 3600.0, 3600.0, "hours")):
        if span <= limit:
            return TimeAxis(False, unit, f"{name} from the first block")
    return TimeAxis(False, 86400.0, "days from the first block")


def new_figure(height: float, panels: Sequence[float] = (1.0,)) -> tuple[Figure, list[Axes]]:
    """Return a figure of panels above each other that share the horizontal axis; ``panels`` are their heights."""
    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False, gridspec_kw={"height_ratios": panels})
    return figure, list(axes[:, 0])


def to_svg(figure: Figure, label: str, numbers: itertools.count[int]) -> str:
    """Return a figure as inline SVG: without a header, scaling with the page, its ids unique on the page.

    Args:
        figure: to be drawn.
        label: what it shows, for those who cannot see it.
        numbers: gives every figure of the page its own number.
    """
    buffer = io.StringIO()
    nothing = dict.fromkeys(("Creator", "Date", "Format", "Type"))
    FigureCanvasSVG(figure).print_svg(buffer, metadata=nothing)
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    prefix = f"f{next(numbers)}-"
    text = re.sub(r'\bid="', f'id="{prefix}', text)
    text = re.sub(r'(url\(#|href="#)', rf"\1{prefix}", text)
    escaped = label.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")
    return re.sub(r'<svg width="[^"]*" height="[^"]*"', f'<svg role="img" aria-label="{escaped}"', text, count=1)


def thin(x: NDArray[np.float64], y: NDArray[np.float64], bins: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Leave out points that nobody could see: of each of ``bins`` columns keep the least, the greatest and a break.

    Args:
        x: ascending positions.
        y: values, NaN where the line breaks.
        bins: columns of the picture.
    """
    if x.size <= 2 * bins or x[-1] <= x[0]:
        return x, y
    edges = np.searchsorted(x, np.linspace(x[0], x[-1], bins + 1)[1:-1])
    keep: list[int] = []
    for start, stop in itertools.pairwise([0, *edges.tolist(), x.size]):
        if start == stop:
            continue
        part = y[start:stop]
        finite = np.isfinite(part)
        places = {int(np.argmin(finite))} if not finite.all() else set()
        if finite.any():
            places |= {int(np.nanargmin(part)), int(np.nanargmax(part))}
        keep.extend(start + place for place in sorted(places))
    return x[keep], y[keep]


def with_breaks(time: NDArray[np.float64], y: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Put a NaN where blocks are missing, so that a gap is seen and not joined: three usual intervals or more."""
    steps = np.diff(time)
    usual = float(np.median(steps[steps > 0])) if np.any(steps > 0) else 0.0
    gaps = np.flatnonzero(steps > 3.0 * usual) + 1
    middles = 0.5 * (time[gaps - 1] + time[gaps])
    return np.insert(time, gaps, middles), np.insert(y, gaps, np.nan)


def draw_line(axes: Axes, axis: TimeAxis, time: NDArray[np.float64], y: NDArray[np.float64], **style: Any) -> None:
    """Draw values over time: gaps and missing values break the line, a value between two breaks is a dot."""
    if not np.isfinite(y).any():
        return
    bins = style.pop("bins", 600)
    x, values = thin(*with_breaks(time, y), bins)
    axes.plot(axis.position(x), values, **style)
    finite = np.concatenate([[False], np.isfinite(values), [False]])
    alone = finite[1:-1] & ~finite[:-2] & ~finite[2:]
    if alone.any():
        axes.plot(axis.position(x[alone]), values[alone], ".", color=style.get("color"), markersize=4)


def log_if_wide(axes: Axes, *columns: NDArray[np.float64]) -> None:
    """Make the vertical axis logarithmic where positive values span more than a factor of five, else begin at zero."""
    values = np.concatenate([column[np.isfinite(column)] for column in columns])
    if values.size and values.min() > 0 and values.max() > 5.0 * values.min():
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0), numticks=12))
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.yaxis.set_minor_formatter(NullFormatter())
    elif values.size:
        axes.set_ylim(min(0.0, float(values.min()) * 1.05), float(values.max()) * 1.08 or 1.0)


def add_legend(axes: Axes, **place: Any) -> None:
    """Add a legend where something has a name."""
    handles, _ = axes.get_legend_handles_labels()
    if handles:
        axes.legend(**place)
