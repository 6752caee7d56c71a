"""Drawing for the page: thinning that keeps extremes, time axes, sparklines, and self-contained inline SVG."""

from __future__ import annotations

import io
import itertools
import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, tzinfo
from typing import Any, NamedTuple

import numpy as np
from markupsafe import Markup, escape
from matplotlib import dates
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator
from numpy.typing import NDArray

from monitor.words.numbers import Clock
from streams.types.block import STANDARD_GRAVITY

BLUE, VERMILION, GREEN, PURPLE, SKY, ORANGE, GREY = (
    *("#0072b2", "#d55e00", "#008a63", "#a3527f", "#56b4e9", "#b07a00", "#5f6670"),
)
"""Colours for all kinds of colour vision (after Okabe and Ito), three of them darkened for contrast on white."""
INK, SOFT, AXIS, GRID, SHADE, PAPER = "#22262b", "#4a5058", "#8a9099", "#e3e6ea", "#eef1f4", "#fefefe"
"""Neutral colours of text, ticks, axes, grid, shaded spans and the inside of markers."""
COLOUR_NAMES = {
    BLUE: "blue",
    VERMILION: "vermilion",
    GREEN: "green",
    PURPLE: "purple",
    SKY: "sky",
    ORANGE: "orange",
    GREY: "grey",
    INK: "ink",
    SOFT: "soft",
    AXIS: "axis",
    GRID: "grid",
    SHADE: "shade",
    PAPER: "paper",
}
"""Names of the colours in the style sheet of the page, which has a dark variant."""
PALETTE = {name: colour for colour, name in COLOUR_NAMES.items()}
_COLOURS = re.compile("|".join(COLOUR_NAMES))
_PLACES = re.compile(r'\b(?:d|x|y|transform|points)="[^"]*"')
_FRACTION = re.compile(r"(\.\d\d)\d+")

STYLE: Any = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans", "Helvetica", "Arial"],
    "font.size": 9.5,
    "text.color": INK,
    "figure.facecolor": "none",
    "axes.facecolor": "none",
    "savefig.facecolor": "none",
    "axes.edgecolor": AXIS,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.8,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": GRID,
    "grid.linewidth": 0.7,
    "xtick.color": SOFT,
    "ytick.color": SOFT,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "lines.linewidth": 1.3,
    "svg.fonttype": "none",
    "svg.hashsalt": "spallwatch",
}
"""Settings of matplotlib for every figure, as a decorator: ``@mpl.rc_context(STYLE)``."""
WIDTH = 9.6
"""Width of every figure in inches: the page scales it."""
GAP_STEPS = 3.0
"""A gap between blocks is a step of more than so many usual ones."""
_SPARK_WIDTH, _SPARK_HEIGHT, _SPARK_BINS = 120, 26, 60
_MIN_SPARK_SPAN = np.log(2.0)
"""Changes by less than a factor of two fill less than the height, so that noise looks small."""


@dataclass(frozen=True, eq=False)
class Picture:
    """A figure of the page.

    Attributes:
        data: what is drawn, as columns or single values, units at the end of names, for programs that read the page.
        name: by which a program finds it.
        zoom: see :func:`monitor.report.figures.zoom.zoom_data`; empty for a figure without zoom.
    """

    heading: str
    svg: str
    caption: str
    data: Mapping[str, Any] = field(default_factory=dict)
    name: str = ""
    zoom: Mapping[str, Any] = field(default_factory=dict)

    @property
    def json(self) -> str:
        """The data as JSON: six figures a number, null for NaN."""
        return json.dumps(_plain(self.data), allow_nan=False, separators=(",", ":"))


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float):
        return float(f"{value:.6g}" if abs(value) < 1e8 else f"{value:.3f}") if math.isfinite(value) else None
    return value


class TimeAxis(NamedTuple):
    """The horizontal axis: dates in ``zone`` or multiples of ``unit`` (s); ``timed`` is False for block numbers."""

    dated: bool
    unit: float
    label: str
    timed: bool = True
    zone: tzinfo = UTC

    def position(self, time: NDArray[np.float64] | float) -> Any:
        """Return positions of times (s)."""
        return np.asarray(time) / (86400.0 if self.dated else self.unit)

    def settle(self, axes: Axes, first: float, last: float) -> None:
        """Label an axis from the first to the last time (s); dates are days since 1970, as matplotlib counts them."""
        axes.set_xlim(float(self.position(first)), float(self.position(last)))
        if self.dated:
            locator = dates.AutoDateLocator(minticks=3, maxticks=9, tz=self.zone)
            axes.xaxis.set_major_locator(locator)
            axes.xaxis.set_major_formatter(dates.ConciseDateFormatter(locator, tz=self.zone))
        axes.set_xlabel(self.label)


BLOCK_AXIS = TimeAxis(False, 1.0, "block", timed=False)
"""The axis of a recording without times: block numbers."""


class Scale(NamedTuple):
    """The unit of accelerations in figures: its value in SI, its text, and the ending of data names."""

    si: float
    unit: str
    suffix: str


def scale_of(*, absolute: bool) -> Scale:
    """Return the scale of accelerations; ``absolute``: whether they are in m/s2 rather than in an unknown unit."""
    return Scale(STANDARD_GRAVITY, "g", "g") if absolute else Scale(1.0, "sensor unit", "sensor_unit")


def unit_of(span: float) -> tuple[float, str]:
    """Return a suitable unit for a span of time (s): its length in seconds, and its name."""
    for limit, unit, name in ((300.0, 1.0, "seconds"), (3 * 3600.0, 60.0, "minutes"), (96 * 3600.0, 3600.0, "hours")):
        if span <= limit:
            return unit, name
    return 86400.0, "days"


def time_axis(time: NDArray[np.float64], clock: Clock) -> TimeAxis:
    """Return the axis for times (s)."""
    if clock.dated:
        return TimeAxis(True, 86400.0, clock.label, zone=clock.zone)
    unit, name = unit_of(float(np.ptp(time)) if time.size else 0.0)
    return TimeAxis(False, unit, f"{name} from the first block")


def new_figure(height: float, panels: Sequence[float] = (1.0,)) -> tuple[Figure, list[Axes]]:
    """Return a figure of panels above each other that share the horizontal axis; ``panels`` are their heights."""
    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False, gridspec_kw={"height_ratios": panels})
    return figure, list(axes[:, 0])


def to_svg(figure: Figure, label: str, numbers: itertools.count[int]) -> str:
    """Return a figure as inline SVG: without a header, scaling with the page.

    Colours become variables of the page's style sheet with the colour as fallback. ``label`` is the alternative text;
    ``numbers`` makes ids unique on the page.
    """
    buffer = io.StringIO()
    nothing = dict.fromkeys(("Creator", "Date", "Format", "Type"))
    FigureCanvasSVG(figure).print_svg(buffer, metadata=nothing)
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    prefix = f"f{next(numbers)}-"
    text = re.sub(r'\bid="', f'id="{prefix}', text.replace("xlink:href", "href"))
    text = re.sub(r'(url\(#|href="#)', rf"\1{prefix}", text)
    text = _COLOURS.sub(lambda match: f"var(--{COLOUR_NAMES[match[0]]},{match[0]})", text)
    # Fonts and strokes are styled by the page; hundredths of a point are invisible.
    text = re.sub(r"; font-family: [^;\"]*", "", text)
    text = re.sub(r"<style type=.text/css.>.*?</style>", "", text, flags=re.DOTALL)
    text = _PLACES.sub(lambda match: _FRACTION.sub(r"\1", match[0]), text)
    escaped = label.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")
    box = re.search(r'viewBox="[^"]*"', text)
    head = f'<svg role="img" aria-label="{escaped}" {box[0] if box else ""}>'
    return head + text[text.index(">") + 1 :]


def thin(x: NDArray[np.float64], y: NDArray[np.float64], bins: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Reduce a line to what is visible: of each of ``bins`` columns the minimum, the maximum and a break.

    ``x`` is ascending; ``y`` is NaN where the line breaks.
    """
    keep = places_kept(x, y, bins)
    return x[keep], y[keep]


def places_kept(x: NDArray[np.float64], y: NDArray[np.float64], bins: int) -> NDArray[np.intp]:
    """Return the indices of the points that :func:`thin` keeps."""
    if x.size <= 2 * bins or x[-1] <= x[0]:
        return np.arange(x.size)
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
    return np.array(keep, dtype=np.intp)


def usual_step(time: NDArray[np.float64]) -> float:
    """Return the median of the positive steps between ascending times, zero without any."""
    steps = np.diff(time)
    return float(np.median(steps[steps > 0])) if np.any(steps > 0) else 0.0


def gaps_in(time: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return the places before a step of more than ``GAP_STEPS`` usual ones."""
    return np.flatnonzero(np.diff(time) > GAP_STEPS * usual_step(time))


def with_breaks(time: NDArray[np.float64], y: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Insert a NaN in each gap, so that a line breaks there."""
    gaps = gaps_in(time) + 1
    middles = 0.5 * (time[gaps - 1] + time[gaps])
    return np.insert(time, gaps, middles), np.insert(y, gaps, np.nan)


def draw_line(axes: Axes, axis: TimeAxis, time: NDArray[np.float64], y: NDArray[np.float64], **style: Any) -> None:
    """Draw values over time; gaps and NaN break the line, a value between two breaks is a dot."""
    if not np.isfinite(y).any():
        return
    bins = style.pop("bins", 600)
    x, values = thin(*with_breaks(time, y), bins)
    axes.plot(axis.position(x), values, **style)
    alone = isolated(values)
    if alone.any():
        axes.plot(axis.position(x[alone]), values[alone], ".", color=style.get("color"), markersize=4)


def last_finite(values: NDArray[np.float64]) -> float:
    """Return the last finite value, NaN without any."""
    finite = values[np.isfinite(values)]
    return float(finite[-1]) if finite.size else math.nan


def isolated(values: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Tell which values are finite between two that are not."""
    finite = np.concatenate([[False], np.isfinite(values), [False]])
    return finite[1:-1] & ~finite[:-2] & ~finite[2:]


def draw_rug(
    axes: Axes, axis: TimeAxis, time: NDArray[np.float64], height: float, marker: str, bins: int, **style: Any
) -> None:
    """Draw a marker at each of ascending times, thinned to ``bins`` columns, at one height."""
    x, _ = thin(time, np.zeros(time.size), bins)
    axes.plot(axis.position(x), np.full(x.size, height), marker, **style)


def log_if_wide(axes: Axes, *columns: NDArray[np.float64]) -> None:
    """Make the vertical axis logarithmic if positive values span more than a factor of five, else let it begin at 0."""
    values = np.concatenate([column[np.isfinite(column)] for column in columns])
    if values.size and values.min() > 0 and values.max() > 5.0 * values.min():
        axes.set_yscale("log")
        log_ticks(axes.yaxis, 12)
    elif values.size:
        axes.set_ylim(min(0.0, float(values.min()) * 1.05), float(values.max()) * 1.08 or 1.0)


def log_ticks(axis: Axis, most: int | None = None, *, decades: float = 0.0) -> None:
    """Mark ones, twos and fives of a logarithmic axis, ``most`` of them (None: as many as fit), as plain numbers.

    Over so many ``decades`` that ones, twos and fives were more than ``most``, ones alone are marked.
    """
    crowded = most is not None and 3.0 * decades > most
    axis.set_major_locator(LogLocator(subs=(1.0,) if crowded else (1.0, 2.0, 5.0), numticks=most))
    axis.set_major_formatter(FuncFormatter(plain_number))
    # Minor ticks are slow to draw.
    axis.set_minor_locator(NullLocator())


def plain_number(value: float, _: int | None = None) -> str:
    """Return the text of a tick without an exponent."""
    return f"{value:g}"


def add_legend(axes: Axes, **place: Any) -> None:
    """Add a legend if anything is labelled."""
    handles, _ = axes.get_legend_handles_labels()
    if handles:
        axes.legend(**place)


def legend_above(axes: Axes, columns: int = 6) -> None:
    """Add a legend above a panel."""
    add_legend(axes, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=columns, borderaxespad=0.2, handlelength=1.6)


def sparkline(time: NDArray[np.float64], values: NDArray[np.float64], label: str) -> Markup:
    """Return positive values on a logarithmic scale as inline SVG for a table; empty with fewer than two values."""
    known = np.isfinite(time) & np.isfinite(values) & (values > 0)
    if known.sum() < 2 or np.ptp(time[known]) == 0.0:
        return Markup("")
    x, y = thin(time[known], np.log(values[known]), _SPARK_BINS)
    span = max(float(np.ptp(y)), _MIN_SPARK_SPAN)
    across = (x - x[0]) / (x[-1] - x[0]) * (_SPARK_WIDTH - 4) + 2
    down = (_SPARK_HEIGHT - 4) * (1.0 - (y - y.min()) / span) + 2
    points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(across, down, strict=True))
    # Colours for PDF, where style sheets do not reach into SVG.
    return Markup(
        f'<svg class="spark" viewBox="0 0 {_SPARK_WIDTH} {_SPARK_HEIGHT}" role="img" aria-label="{escape(label)}">'
        f'<polyline points="{points}" fill="none" stroke="{BLUE}" stroke-width="1.2"/>'
        f'<circle fill="{BLUE}" cx="{across[-1]:.1f}" cy="{down[-1]:.1f}" r="2"/></svg>'
    )
