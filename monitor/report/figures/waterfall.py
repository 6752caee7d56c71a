"""Figures of the kept spectra of a channel: all of them over its life, and kurtograms before the onset and now."""

from __future__ import annotations

import base64
import math
from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, PowerNorm
from matplotlib.image import AxesImage
from matplotlib.patches import Rectangle
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator
from numpy.typing import NDArray

from monitor.health.signal.kurtogram import Kurtogram
from monitor.health.signal.waterfall import SpectrumRow
from monitor.records.spectra import binned, in_orders
from monitor.report.figures.drawing import (
    GAP_STEPS,
    INK,
    PAPER,
    STYLE,
    VERMILION,
    Picture,
    new_figure,
    plain_number,
    scale_of,
    time_axis,
    to_svg,
    usual_step,
)
from monitor.report.figures.spectrum import AXES, FAULT_MARKS, ORDERS
from monitor.report.figures.trends import draw_marks
from monitor.report.verdict import ChannelContext
from monitor.words.numbers import count, figure
from monitor.words.parts import FAULTS
from monitor.words.statuses import FAULT_NAMES

_BINS, _COLUMNS, _COLOURS = 220, 360, 40
"""Bins of frequency, times, and colours."""
_MIN_ROWS = 4


@mpl.rc_context(STYLE)
def waterfall(context: ChannelContext) -> Picture | None:
    """Draw the kept envelope spectra of a channel over its life.

    Over orders of the shaft where its speed varies. None where fewer than four have a time, or where all are zero.
    """
    rows = context.run.spectra.get(context.channel.name, ())
    dated = [row for row in rows if row.time is not None and row.resolution > 0 and row.amplitude.size > 1]
    if len(dated) < _MIN_ROWS or dated[-1].time == dated[0].time:
        return None
    time = np.array([row.time for row in dated], dtype=np.float64)
    domain = "order" if in_orders(dated) else "hertz"
    speed = dated[-1].speed if domain == "order" else 1.0
    lines = {part: line / speed for part, line in dated[-1].lines.items()}
    highest = (ORDERS + 0.5) * max((lines[part] for part in FAULTS if part in lines), default=math.inf)
    frequency, amplitude = binned(dated, _BINS, None if math.isinf(highest) else highest, orders=domain == "order")
    scale = scale_of(absolute=all(row.absolute for row in dated))
    amplitude = amplitude / scale.si
    # The mean and slow drift below the cage's line are left out.
    amplitude[:, frequency < 0.5 * min(lines.values(), default=0.0)] = np.nan
    low, high = _ends(amplitude)
    if not high > 0.0:
        return None
    axis = time_axis(time, context.clock)
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
    bar = made.colorbar(shown, ax=axes, pad=0.01, ticks=LogLocator(subs=(1.0, 3.0)), format=FuncFormatter(plain_number))
    bar.ax.yaxis.set_minor_locator(NullLocator())
    bar.set_label(f"envelope ({scale.unit})")
    draw_marks(axes, axis, context.verdict)
    named = _mark_orders(axes, lines, context.verdict.fault, top)
    axes.set_ylabel(AXES[domain])
    axis.settle(axes, *edges)
    name, headline = context.channel.name, context.verdict.headline
    label = f"Envelope spectra of channel {name} over its life, {len(dated)} of them. {headline}."
    caption = _caption(dated, float(frequency[1] - frequency[0]), domain, named)
    data = {
        "time_s": time,
        "block": [row.sequence for row in dated],
        "order" if domain == "order" else "frequency_hz": frequency,
        "unit": scale.unit,
        "low": low,
        "high": high,
        "codes_base64": base64.b64encode(_codes(amplitude, low, high)).decode("ascii"),
    }
    return Picture("Envelope spectra over life", to_svg(made, label, context.numbers), caption, data, "waterfall")


def _caption(rows: Sequence[SpectrumRow], width: float, domain: str, named: str) -> str:
    unit = "of an order" if domain == "order" else "Hz"
    texts = [
        f"{count(len(rows), 'kept spectrum').replace('spectrums', 'spectra')}; the colour is the highest amplitude in "
        f"bins of {figure(width, 2)} {unit}, on a logarithmic scale. A line that stays is a horizontal stripe; what is "
        "blank has no spectrum."
    ]
    if domain == "order":
        speeds = [row.speed for row in rows]
        texts.append(
            f"Mean speeds are {figure(min(speeds))} to {figure(max(speeds))} Hz: each spectrum is drawn over its "
            "frequency over its own speed, so that lines of shaft and bearing stay where they are."
        )
    if named:
        texts.append(f"Marks on the left: harmonics of the {named}.")
    return " ".join(texts)


def _ends(amplitude: NDArray[Any]) -> tuple[float, float]:
    """Return the ends of the colour scale: the 20th percentile, but four decades at most, and the maximum."""
    positive = amplitude[amplitude > 0]
    if not positive.size:
        return 0.0, 0.0
    low, high = float(np.percentile(positive, 20.0)), float(positive.max())
    return max(min(low, 0.5 * high), 1e-4 * high), high


def _on_grid(time: NDArray[np.float64], amplitude: NDArray[Any]) -> tuple[NDArray[Any], tuple[float, float]]:
    """Return the nearest spectrum at each of evenly spaced times, NaN in gaps, and the ends of the image (s)."""
    usual = usual_step(time)
    columns = int(np.clip(round(np.ptp(time) / usual), 2, _COLUMNS))
    half = 0.5 * usual
    edges = (float(time[0]) - half, float(time[-1]) + half)
    at = edges[0] + (np.arange(columns) + 0.5) * (edges[1] - edges[0]) / columns
    after = np.clip(np.searchsorted(time, at), 1, time.size - 1)
    nearest = np.where(at - time[after - 1] <= time[after] - at, after - 1, after)
    grid = amplitude[nearest].copy()
    width = (edges[1] - edges[0]) / columns
    grid[np.abs(time[nearest] - at) > 0.5 * GAP_STEPS * max(usual, width)] = np.nan
    return grid, edges


def _mark_orders(axes: Axes, lines: Mapping[str, float], fault: str, top: float) -> str:
    """Mark the orders of the named part on the left edge; return its name for the caption, "" for none."""
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


def _codes(amplitude: NDArray[Any], low: float, high: float) -> bytes:
    """Return amplitudes as one byte each: 0 for NaN, 1 to 255 even in the logarithm."""
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.log(np.clip(amplitude, low, high) / low) / math.log(high / low)
    return np.where(np.isfinite(amplitude), 1 + np.round(254 * np.nan_to_num(share)), 0).astype(np.uint8).tobytes()


_CELLS = 192
"""Columns of the image: a multiple of all numbers of bands of a level."""
_PALE = 0.45
"""Opacity of what noise may be."""
_LEAST_SCALE = 2.0
"""The colours reach at least this kurtosis, so that noise is not drawn as contrast."""


@mpl.rc_context(STYLE)
def kurtograms(context: ChannelContext) -> Picture | None:
    """Draw the kurtogram of the latest kept block below that of the last one before the onset.

    None where no kept spectrum has one.
    """
    shown = _shown(context)
    if not shown:
        return None
    high = max(_LEAST_SCALE, *(max(map(max, found.levels)) for _, found in shown))
    made, panels = new_figure(0.7 + 2.9 * len(shown), (1.0,) * len(shown))
    data: list[dict[str, Any]] = []
    image: AxesImage | None = None
    for axes, (row, found) in zip(panels, shown, strict=True):
        image = _draw(axes, row, found, high)
        data.append(_data(row, found))
    assert image is not None
    bar = made.colorbar(image, ax=panels, pad=0.01)
    bar.set_label("kurtosis of the envelope")
    panels[-1].set_xlabel("frequency (Hz)")
    pairs = [pair for axes in panels for pair in zip(*axes.get_legend_handles_labels(), strict=True)]
    handles = {label: handle for handle, label in pairs}
    place: Any = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "borderaxespad": 0.2}
    panels[0].legend(list(handles.values()), list(handles), ncols=2, **place)
    name = context.channel.name
    label = f"Kurtogram of channel {name}: kurtosis of the envelope by frequency and width of the band."
    svg = to_svg(made, label, context.numbers)
    return Picture("Kurtogram", svg, _kurtogram_caption(shown), {"kurtograms": data}, "kurtogram")


def _shown(context: ChannelContext) -> list[tuple[SpectrumRow, Kurtogram]]:
    """Return the last row before the onset and the latest one, of those with a kurtogram."""
    rows = context.run.spectra.get(context.channel.name, ())
    known = [(row, row.kurtogram) for row in rows if row.kurtogram is not None]
    if not known:
        return []
    onset = None if context.verdict.t_fs is None else context.verdict.t_fs.block
    before = [] if onset is None else [pair for pair in known if pair[0].sequence < onset][-1:]
    return [*(pair for pair in before if pair[0] is not known[-1][0]), known[-1]]


def _draw(axes: Axes, row: SpectrumRow, found: Kurtogram, high: float) -> AxesImage:
    """Draw one kurtogram: a row of cells for each width, the widest on top."""
    count, top = len(found.levels), found.nyquist
    image: NDArray[np.float64] = np.array([np.repeat(level, _CELLS // len(level)) for level in found.levels])
    limits = np.array([found.noise_limit(level) for level in range(count)])
    axes.grid(visible=False)
    shown = axes.imshow(
        np.clip(image, 0.0, high),
        origin="upper",
        aspect="auto",
        interpolation="none",
        alpha=np.where(image > limits[:, None], 1.0, _PALE),
        extent=(0.0, top, count - 0.5, -0.5),
        cmap=colormaps["viridis"].resampled(_COLOURS),
        norm=PowerNorm(0.5, 0.0, high),
    )
    low_edge, high_edge = row.band
    for edge, label in ((low_edge, "demodulated band"), (high_edge, None)):
        axes.axvline(edge, color=PAPER, linewidth=2.4)
        axes.axvline(edge, color=VERMILION, linewidth=1.4, linestyle="--", label=label)
    best = found.best()
    if best is not None:
        low, high_best = found.band(*best)
        place = (low, best[0] - 0.5)
        axes.add_patch(Rectangle(place, high_best - low, 1.0, fill=False, edgecolor=PAPER, linewidth=3.2))
        outline = {"fill": False, "edgecolor": INK, "linewidth": 1.6}
        axes.add_patch(Rectangle(place, high_best - low, 1.0, label="highest kurtosis", **outline))
    axes.set_yticks(range(count), [figure(top / len(level), 2) for level in found.levels], fontsize=8)
    axes.set_ylabel("width of the band (Hz)")
    axes.set_title(f"block {row.sequence:,}", loc="left", fontsize=9.5)
    return shown


def _data(row: SpectrumRow, found: Kurtogram) -> dict[str, Any]:
    best = found.best()
    return {
        "block": row.sequence,
        "nyquist_hz": found.nyquist,
        "kurtosis": found.levels,
        "demodulated_hz": row.band,
        "best_hz": None if best is None else found.band(*best),
    }


def _kurtogram_caption(shown: Sequence[tuple[SpectrumRow, Kurtogram]]) -> str:
    row, found = shown[-1]
    best = found.best()
    if best is None:
        highest = f"In block {row.sequence:,} no band is more impulsive than noise would be."
    else:
        low, high = found.band(*best)
        value = found.levels[best[0]][best[1]]
        highest = (
            f"In block {row.sequence:,} the highest, {figure(value, 2)}, stands at {figure(low, 3)} to "
            f"{figure(high, 3)} Hz; noise stays below {figure(found.noise_limit(best[0]), 2)} at this width."
        )
    seconds = 2.0 * shown[-1][1].samples / (2.0 * found.nyquist)
    return (
        "Each cell is a band: its place is the frequency, its row the width. Bright cells hold short bursts, as of a "
        f"damaged bearing, but also single knocks; pale ones may be noise. {highest} From {figure(seconds, 2)} s of "
        "a block (fast kurtogram, Antoni 2007)."
    )
