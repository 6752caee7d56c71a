"""The envelope spectra of a whole life in one picture: time to the right as everywhere, frequency upwards."""

from __future__ import annotations

import base64
import itertools
import math
from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator
from numpy.typing import NDArray

from monitor.health.schema import FAULTS
from monitor.health.waterfall import SpectrumRow
from monitor.records.spectra import binned
from monitor.report.figures.drawing import STYLE, Picture, new_figure, time_axis, to_svg
from monitor.report.figures.spectrum import FAULT_MARKS, ORDERS
from monitor.report.figures.trends import draw_marks
from monitor.report.verdict import Verdict
from monitor.words.numbers import Clock, count, figure
from monitor.words.statuses import FAULT_NAMES
from streams.block import STANDARD_GRAVITY

_BINS, _COLUMNS, _COLOURS = 220, 360, 40
_LEAST_ROWS = 4
_GAP = 3.0
"""Spectra further apart than so many usual distances have nothing drawn between them."""


@mpl.rc_context(STYLE)
def waterfall(
    rows: Sequence[SpectrumRow], channel: str, verdict: Verdict, clock: Clock, numbers: itertools.count[int]
) -> Picture | None:
    """Draw the kept envelope spectra of a channel over its life.

    Args:
        rows: in the order of their blocks.
        channel: its name.
        verdict: on it; the lines of the part that it names are pointed at.
        clock: writes moments.
        numbers: of figures.

    Returns:
        The figure, or None where fewer than four spectra have a time or nothing is in them.
    """
    dated = [row for row in rows if row.time is not None and row.resolution > 0 and row.amplitude.size > 1]
    if len(dated) < _LEAST_ROWS or dated[-1].time == dated[0].time:
        return None
    time = np.array([row.time for row in dated], dtype=np.float64)
    lines = dated[-1].lines
    highest = (ORDERS + 0.5) * max((lines[part] for part in FAULTS if part in lines), default=math.inf)
    frequency, amplitude = binned(dated, _BINS, None if math.isinf(highest) else highest)
    absolute = all(row.absolute for row in dated)
    amplitude = amplitude / (STANDARD_GRAVITY if absolute else 1.0)
    # The mean and slow drift below the cage's line are no lines.
    amplitude[:, frequency < 0.5 * min(lines.values(), default=0.0)] = np.nan
    low, high = _ends(amplitude)
    if not high > 0.0:
        return None
    unit = "g" if absolute else "sensor unit"
    axis = time_axis(time, clock)
    made, (axes,) = new_figure(3.9)
    axes.grid(visible=False)
    image, edges = _on_grid(time, amplitude)
    top = float(frequency[-1] + frequency[1] - frequency[0])
    shown = axes.imshow(
        np.clip(image.T, low, None),
        origin="lower",
        aspect="auto",
        interpolation="none",
        extent=(float(axis.position(edges[0])), float(axis.position(edges[1])), 0.0, top),
        cmap=colormaps["viridis"].resampled(_COLOURS),
        norm=LogNorm(low, high),
    )
    bar = made.colorbar(shown, ax=axes, pad=0.01, ticks=LogLocator(subs=(1.0, 3.0)), format=FuncFormatter(_plain))
    bar.ax.yaxis.set_minor_locator(NullLocator())
    bar.set_label(f"envelope ({unit})")
    draw_marks(axes, axis, verdict)
    named = _point_at_lines(axes, lines, verdict.fault, top)
    axes.set_xlim(float(axis.position(edges[0])), float(axis.position(edges[1])))
    axes.set_ylabel("frequency (Hz)")
    axis.settle(axes)
    label = f"Envelope spectra of channel {channel} over its life, {len(dated)} of them. {verdict.headline}."
    caption = (
        f"{count(len(dated), 'kept spectrum').replace('spectrums', 'spectra')}; the colour is the highest amplitude in "
        f"bins of {figure(float(frequency[1] - frequency[0]), 2)} Hz, on a logarithmic scale. A line that stays is a "
        "horizontal stripe; what is blank has no spectrum."
        + (f" Marks on the left: orders of the {named}." if named else "")
    )
    data = _data(time, frequency, amplitude, (low, high), unit, [row.sequence for row in dated])
    return Picture("Envelope spectra over life", to_svg(made, label, numbers), caption, data, "waterfall")


def _ends(amplitude: NDArray[Any]) -> tuple[float, float]:
    """Return the ends of the colour scale: from where most noise lies, four decades at most, to the highest line."""
    positive = amplitude[amplitude > 0]
    if not positive.size:
        return 0.0, 0.0
    low, high = float(np.percentile(positive, 20.0)), float(positive.max())
    return max(min(low, 0.5 * high), 1e-4 * high), high


def _plain(value: float, _: int | None = None) -> str:
    return f"{value:g}"


def _on_grid(time: NDArray[np.float64], amplitude: NDArray[Any]) -> tuple[NDArray[Any], tuple[float, float]]:
    """Return the spectra on even steps of time, each step with the nearest spectrum, NaN in gaps, and its ends."""
    steps = np.diff(time)
    usual = float(np.median(steps[steps > 0]))
    columns = int(np.clip(round(np.ptp(time) / usual), 2, _COLUMNS))
    half = 0.5 * usual
    edges = (float(time[0]) - half, float(time[-1]) + half)
    at = edges[0] + (np.arange(columns) + 0.5) * (edges[1] - edges[0]) / columns
    after = np.clip(np.searchsorted(time, at), 1, time.size - 1)
    nearest = np.where(at - time[after - 1] <= time[after] - at, after - 1, after)
    grid = amplitude[nearest].copy()
    width = (edges[1] - edges[0]) / columns
    grid[np.abs(time[nearest] - at) > 0.5 * _GAP * max(usual, width)] = np.nan
    return grid, edges


def _point_at_lines(axes: Axes, lines: Any, fault: str, top: float) -> str:
    """Mark the orders of the named part on the left edge; return what they are called, "" where none is named."""
    named = [part for part in fault.split("|") if part in lines]
    for place, part in enumerate(named):
        colour, _ = FAULT_MARKS[part]
        for order in range(1, ORDERS + 1):
            at = order * lines[part]
            if at < top:
                axes.annotate(
                    f"{order}×",
                    (0.0, at),
                    (4 + 22 * place, 0),
                    xycoords=("axes fraction", "data"),
                    textcoords="offset points",
                    fontsize=8,
                    color="white",
                    va="center",
                    bbox={"facecolor": colour, "edgecolor": "none", "boxstyle": "round,pad=0.15"},
                )
    return " and of the ".join(FAULT_NAMES[part] for part in named)


def _data(
    time: NDArray[np.float64],
    frequency: NDArray[np.float64],
    amplitude: NDArray[Any],
    ends: tuple[float, float],
    unit: str,
    blocks: list[int],
) -> dict[str, Any]:
    """Return what is drawn: amplitudes as one byte each, 0 for none, 1 to 255 even in the logarithm."""
    low, high = ends
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.log(np.clip(amplitude, low, high) / low) / math.log(high / low)
    codes = np.where(np.isfinite(amplitude), 1 + np.round(254 * np.nan_to_num(share)), 0).astype(np.uint8)
    return {
        "time_s": time,
        "block": blocks,
        "frequency_hz": frequency,
        "unit": unit,
        "low": low,
        "high": high,
        "codes_base64": base64.b64encode(codes.tobytes()).decode("ascii"),
    }
