"""Figures of envelope spectra: before and after the onset, and the lines in the records."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from monitor.health.signal.settings import shared_lines
from monitor.health.signal.waterfall import SpectrumRow
from monitor.report.figures.drawing import (
    GREY,
    INK,
    PALETTE,
    PAPER,
    STYLE,
    Picture,
    add_legend,
    new_figure,
    scale_of,
    thin,
    to_svg,
)
from monitor.report.readings import named_fault
from monitor.report.runs import Channel
from monitor.report.verdict import ChannelContext
from monitor.words.numbers import Clock, figure
from monitor.words.parts import FAULTS, PARTS
from monitor.words.statuses import FAULT_NAMES, LINE_NAMES, range_words


def shared_words(lines: Mapping[str, float], resolution: float) -> str:
    """Return which lines of the parts stand on one peak, "" for none."""
    groups = [
        " = ".join(f"{order} × {LINE_NAMES[family]}" for family, order in group)
        for group in shared_lines(lines, resolution)
    ]
    return f"One peak each, which counts for neither part alone: {'; '.join(groups)}." if groups else ""


FAULT_MARKS = {part.name: (PALETTE[part.colour], part.marker) for part in PARTS}
"""Colour and marker of the lines of each part."""
ORDERS = 5
"""Orders of the fault lines that are shown, as in H_or (thesis, Eq. 96)."""
_SEARCH = 0.02
"""Relative half-width of the search around a kinematic frequency: slip and nominal speeds are up to 2 % off."""
_SIDE_ORDERS = 3
_MAX_COMMON_SCALE_RATIO = 20.0
"""Two spectra whose highest points differ by more have separate scales."""
_POINTS = 700


def mark_parts(
    axes: Axes, lines: Mapping[str, float], last: float, height: float, *, orders: int = ORDERS, ruled: bool = True
) -> None:
    """Mark at one height the first lines of each part up to the end of the axis; ``ruled``: with lines down"""
    for part, line in lines.items():
        colour, marker = FAULT_MARKS[part]
        at = [order * line for order in range(1, orders + 1) if order * line <= last]
        axes.plot(at, [height] * len(at), marker, color=colour, markersize=5, label=FAULT_NAMES[part], clip_on=False)
        for place in at if ruled else ():
            axes.axvline(place, color=colour, linewidth=0.5, alpha=0.5)


def dot_lines(axes: Axes, first: float, last: float, colour: str, label: str, alpha: float) -> None:
    """Draw the first lines of a family dotted, up to the end of the axis, and name them in the legend."""
    style: dict[str, Any] = {"color": colour, "linewidth": 0.8, "linestyle": (0, (2, 3))}
    for order in range(1, ORDERS + 1):
        if 0.0 < order * first <= last:
            axes.axvline(order * first, alpha=alpha, **style)
    axes.plot([], [], label=label, **style)


class SpectrumView(NamedTuple):
    """An envelope spectrum of a block: ascending frequencies, and amplitudes in ``unit``.

    Attributes:
        fundamentals_hz: kinematic frequency of each part.
        speed_hz: rotation frequency of the shaft, NaN if unknown.
        domain: "order" where the block was warped to that speed: the spectrum is drawn over orders of the shaft.
    """

    frequency_hz: NDArray[np.float64]
    amplitude_g: NDArray[np.float64]
    fundamentals_hz: Mapping[str, float]
    label: str = ""
    speed_hz: float = math.nan
    unit: str = "g"
    domain: str = "hertz"

    def words(self, frequency: float) -> str:
        """Return a place on the axis."""
        return f"order {frequency:.3g}" if self.domain == "order" else f"{frequency:.1f} Hz"


AXES = {"hertz": "frequency (Hz)", "order": "order of the shaft"}
"""Label of the axis by domain."""


def over_orders(view: SpectrumView) -> SpectrumView:
    """Return a spectrum with all frequencies over the speed, which then is 1."""
    speed = view.speed_hz
    return view._replace(
        frequency_hz=np.asarray(view.frequency_hz, float) / speed,
        fundamentals_hz={part: line / speed for part, line in view.fundamentals_hz.items()},
        speed_hz=1.0,
        domain="order",
    )


@mpl.rc_context(STYLE)
def spectra(views: Sequence[SpectrumView], channel: str, fault: str, numbers: itertools.count[int]) -> Picture | None:
    """Draw an envelope spectrum, or one of the healthy bearing above one of the damaged (thesis, Fig. 59).

    Each has the lines of all parts and the highest point near each; ``fault`` is the damaged part, "" for none. None
    where one has fewer than two points.
    """
    if any(len(view.frequency_hz) < 2 for view in views):
        return None
    heading = f"Envelope spectrum{f', {views[0].label}' if views[0].label else ''}"
    if len(views) > 1:
        heading = "Envelope spectra before and after the onset"
    # The second figure of a pair lines up with the first over orders alone.
    if any(view.domain == "order" for view in views) and all(view.speed_hz > 0.0 for view in views):
        views = [over_orders(view) for view in views]
    made, panels = new_figure(3.3 if len(views) == 1 else 5.4, (1.0,) * len(views))
    tops, data = [], []
    for axes, view in zip(panels, views, strict=True):
        top, drawn = _draw(axes, view, fault)
        tops.append(top)
        data.append(drawn)
        if len(views) > 1:
            axes.set_title(view.label, loc="left", fontsize=9.5)
    alike = max(tops) <= _MAX_COMMON_SCALE_RATIO * min(tops)
    for axes, top in zip(panels, tops, strict=True):
        axes.set_ylim(0.0, 1.15 * (max(tops) if alike else top) or 1.0)
    add_legend(panels[-1], loc="upper right", ncols=4, handletextpad=0.3, columnspacing=1.2)
    panels[-1].set_xlabel(AXES[views[-1].domain])
    shown = f"{len(views)} envelope spectra" if len(views) > 1 else "Envelope spectrum"
    label = f"{shown} of channel {channel} with the fault lines of the bearing."
    svg = to_svg(made, label, numbers)
    last = views[-1]
    spacing = float(last.frequency_hz[1] - last.frequency_hz[0])
    caption = f"{_caption(views, tops, fault, alike)} {shared_words(last.fundamentals_hz, spacing)}".rstrip()
    return Picture(heading, svg, caption, {"spectra": data}, "envelope")


def _draw(axes: Axes, view: SpectrumView, fault: str) -> tuple[float, dict[str, Any]]:
    """Draw one spectrum into a panel; return its highest point and what was drawn."""
    frequency, amplitude = np.asarray(view.frequency_hz, float), np.asarray(view.amplitude_g, float)
    view = view._replace(frequency_hz=frequency, amplitude_g=amplitude)
    # The mean and slow drift below the cage's line are left out.
    orders = ORDERS + 0.3
    last = min(float(frequency[-1]), orders * max(view.fundamentals_hz.values(), default=float(frequency[-1])))
    first = 0.5 * min(view.fundamentals_hz.values(), default=0.0)
    shown = (frequency >= first) & (frequency <= last)
    x, y = thin(frequency[shown], amplitude[shown], _POINTS)
    axes.plot(x, y, color=GREY, linewidth=0.8)
    named = [part for part in fault.split("|") if part]
    found: dict[str, Any] = {}
    for part in FAULTS:
        if part in view.fundamentals_hz:
            found[part] = _fault_lines(axes, view, part, last, named)
    axes.set_xlim(0.0, last)
    axes.set_ylabel(f"envelope ({view.unit})")
    top = float(amplitude[shown].max()) if shown.any() else 1.0
    suffix = "g" if view.unit == "g" else "sensor_unit"
    return top or 1.0, {
        "label": view.label,
        "order" if view.domain == "order" else "frequency_hz": x,
        f"amplitude_{suffix}": y,
        "lines_order" if view.domain == "order" else "lines_hz": found,
    }


def _fault_lines(axes: Axes, view: SpectrumView, part: str, last: float, named: Sequence[str]) -> list[float]:
    """Draw the lines of a part and mark the highest point near each, unless another part is named; return these."""
    colour, marker = FAULT_MARKS[part]
    fundamental = view.fundamentals_hz[part]
    meant = not named or part in named
    found: list[tuple[float, float]] = []
    for order in range(1, ORDERS + 1):
        nominal = order * fundamental
        if nominal > last:
            break
        axes.axvline(nominal, color=colour, linewidth=0.8, linestyle=(0, (2, 3)), alpha=0.9 if meant else 0.4)
        place = _highest(view, nominal)
        if place is not None:
            found.append((float(view.frequency_hz[place]), float(view.amplitude_g[place])))
    label = f"{FAULT_NAMES[part]} {view.words(fundamental)}"
    if found and meant:
        x, y = zip(*found, strict=True)
        axes.plot(x, y, marker, color=colour, markersize=5, markerfacecolor=PAPER, label=label)
        for order, (at, height) in enumerate(found, start=1):
            if named:
                axes.annotate(
                    f"{order}×", (at, height), (0, 5), textcoords="offset points", fontsize=7.5, ha="center", color=INK
                )
        if named:
            _sidebands(axes, view, part, found[:_SIDE_ORDERS])
    elif found:
        axes.plot([], [], color=colour, linewidth=0.8, linestyle=(0, (2, 3)), label=label)
    return [at for at, _ in found]


def _sidebands(axes: Axes, view: SpectrumView, part: str, lines: Sequence[tuple[float, float]]) -> None:
    """Mark the sidebands at the shaft's frequency around inner race lines, at the cage's around ball lines."""
    distance = {"inner": view.speed_hz, "ball": view.fundamentals_hz.get("cage", math.nan)}.get(part, math.nan)
    frequency, amplitude = view.frequency_hz, view.amplitude_g
    if not math.isfinite(distance) or distance < 3.0 * (frequency[1] - frequency[0]):
        return
    places = [_highest(view, at + side * distance) for at, _ in lines for side in (-1, 1)]
    rows = [place for place in places if place is not None]
    colour, _ = FAULT_MARKS[part]
    axes.plot(
        frequency[rows],
        amplitude[rows],
        "|",
        color=colour,
        markersize=8,
        label=f"its sidebands, ±{view.words(distance)}",
    )


def _highest(view: SpectrumView, nominal: float) -> int | None:
    frequency = view.frequency_hz
    near = np.flatnonzero(np.abs(frequency - nominal) <= max(_SEARCH * nominal, frequency[1] - frequency[0]))
    return int(near[np.argmax(view.amplitude_g[near])]) if near.size else None


def _caption(views: Sequence[SpectrumView], tops: Sequence[float], fault: str, alike: bool) -> str:
    words = []
    if len(views) == 2:
        words.append(
            f"The highest point grows from {figure(tops[0])} to {figure(tops[1])} {views[0].unit}."
            if tops[1] >= tops[0]
            else f"The highest point is {figure(tops[0])} {views[0].unit} before and {figure(tops[1])} after."
        )
        words.append("Both have the same scale." if alike else "Each has a scale of its own.")
    if views[-1].domain == "order":
        words.append("The speed varies within a block: the envelope is taken over the angle of the shaft.")
    words.append(
        f"Dotted: {ORDERS} harmonics of the kinematic frequency of each part; the marker is the highest point within "
        "2 % of it."
    )
    if not fault:
        words.append(
            "A marker alone names nothing: a part is named only where its lines stand clear of noise and others."
        )
    return " ".join(words)


@mpl.rc_context(STYLE)
def recorded_lines(channel: Channel, row: int, numbers: itertools.count[int]) -> Picture | None:
    """Draw the fault lines of a record with the noise floor under each; None where it has none."""
    amplitude = channel.numbers["envelope_amplitude"][row][:20]
    floor = np.resize(channel.numbers["envelope_floor"][row], 20)
    if amplitude.size < 20 or not np.isfinite(amplitude).any():
        return None
    scale = scale_of(absolute=channel.has_level)
    made, (axes,) = new_figure(2.9)
    labels = []
    for place, fault in enumerate(FAULTS):
        x = np.arange(ORDERS) + 6.0 * place
        colour, _ = FAULT_MARKS[fault]
        rows = slice(ORDERS * place, ORDERS * (place + 1))
        axes.bar(x, np.nan_to_num(amplitude[rows] / scale.si), width=0.72, color=colour, alpha=0.85)
        axes.hlines(floor[rows] / scale.si, x - 0.42, x + 0.42, color=INK, linewidth=1.4)
        labels.append((6.0 * place + 2.0, FAULT_NAMES[fault]))
    axes.set_xticks([x for x, _ in labels], [f"{text}, 1 to 5" for _, text in labels])
    axes.grid(visible=False, axis="x")
    axes.set_ylabel(f"envelope ({scale.unit})")
    block = f"block {channel.sequence[row]:,}"
    label = f"Lines of the envelope spectrum of {block}, with the noise floor as a black bar."
    caption = "Bars: the first five lines of each part. Dark strokes: the noise floor under each. Empty: not resolved."
    data = {f"amplitude_{scale.suffix}": amplitude / scale.si, f"floor_{scale.suffix}": floor / scale.si}
    svg = to_svg(made, label, numbers)
    return Picture(
        f"Fault lines of the envelope spectrum, {block}", svg, caption, {**data, "parts": list(FAULTS)}, "lines"
    )


def envelope(context: ChannelContext) -> list[Picture]:
    """Draw the spectra of the store and that of the caller; without any, the lines in the records."""
    channel, numbers = context.channel, context.numbers
    pair = views_of(context)
    shown = [pair] if len(pair) == 2 or (pair and context.view is None) else []
    shown += [] if context.view is None else [[context.view]]
    drawn = [spectra(views, channel.name, context.verdict.fault, numbers) for views in shown]
    row, _ = named_fault(channel)
    if not any(drawn) and row is not None:
        drawn.append(recorded_lines(channel, row, numbers))
    return [picture for picture in drawn if picture is not None]


def views_of(context: ChannelContext) -> list[SpectrumView]:
    """Return a kept spectrum from before the onset and one from after; the latest alone without an onset; or none."""
    channel, t_fs = context.channel, context.verdict.t_fs
    rows = context.run.spectra.get(channel.name, ())
    usable = [row for row in rows if row.amplitude.size > 1 and row.resolution > 0]
    if not usable:
        return []
    onset = math.inf if t_fs is None or t_fs.block is None else t_fs.block
    before = [row for row in usable if row.sequence < onset]
    after = [row for row in usable if row.sequence >= onset]
    shown = (_healthy_row(before, channel), _damaged_row(after, channel)) if before and after else usable[-1:]
    return [_view_of(row, context.clock) for row in shown]


def _healthy_row(before: Sequence[SpectrumRow], channel: Channel) -> SpectrumRow:
    """Return the middle one of those after the learning window, or of all if there is none."""
    learning = channel.sequence[channel.word("stage") == "learning"]
    later = [row for row in before if not learning.size or row.sequence > learning[-1]]
    among = later or before
    return among[len(among) // 2]


def _damaged_row(after: Sequence[SpectrumRow], channel: Channel) -> SpectrumRow:
    """Return the one nearest to the block with the best verdict on the part, the latest without a verdict."""
    row, fault = named_fault(channel)
    if row is None or not fault:
        return after[-1]
    blocks = np.array([item.sequence for item in after])
    return after[int(np.argmin(np.abs(blocks - int(channel.sequence[row]))))]


def _view_of(row: SpectrumRow, clock: Clock) -> SpectrumView:
    scale = scale_of(absolute=row.absolute)
    when = "" if row.time is None else f", {clock.moment(row.time)}"
    if row.domain == "order" and row.speed_range is not None:
        when += f", {range_words(*row.speed_range)}"
    return SpectrumView(
        frequency_hz=row.frequency,
        amplitude_g=np.asarray(row.amplitude, dtype=np.float64) / scale.si,
        fundamentals_hz=row.lines,
        label=f"block {row.sequence:,}{when}",
        speed_hz=row.speed,
        unit=scale.unit,
        domain=row.domain,
    )
