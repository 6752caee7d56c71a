"""Figures of envelope spectra: one, one before and one after the onset, and the lines that records hold."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from monitor.health.schema import FAULTS
from monitor.report.figures.drawing import (
    BLUE,
    GREEN,
    GREY,
    INK,
    PAPER,
    PURPLE,
    STYLE,
    VERMILION,
    Picture,
    add_legend,
    new_figure,
    thin,
    to_svg,
)
from monitor.report.figures.trends import scale_of
from monitor.report.runs import Channel
from monitor.words.numbers import figure
from monitor.words.statuses import FAULT_NAMES

FAULT_MARKS = {"outer": (VERMILION, "o"), "inner": (BLUE, "s"), "ball": (GREEN, "^"), "cage": (PURPLE, "D")}
"""Colour and marker of the lines of each part."""
ORDERS = 5
"""Orders of the fault lines that are shown, as many as H_or has (thesis, Eq. 96)."""
_SEARCH = 0.02
"""How far a line may stand from its kinematic frequency: slip and nominal speeds are up to 2 % off."""
_SIDE_ORDERS = 3
_OWN_SCALES = 20.0
"""Two spectra whose highest points differ by more are drawn each on a scale of its own."""
_POINTS = 700


class SpectrumView(NamedTuple):
    """An envelope spectrum to be drawn.

    Attributes:
        frequency_hz: ascending, Hz.
        amplitude_g: amplitude of the envelope, g.
        fundamentals_hz: kinematic frequency of each family of fault lines, Hz.
        label: which block it is of, for people.
        speed_hz: rotation frequency of the shaft, Hz, NaN where unknown.
        unit: of the amplitude.
    """

    frequency_hz: NDArray[np.float64]
    amplitude_g: NDArray[np.float64]
    fundamentals_hz: Mapping[str, float]
    label: str = ""
    speed_hz: float = math.nan
    unit: str = "g"


def spectrum(view: SpectrumView, channel: str, fault: str, numbers: itertools.count[int]) -> Picture | None:
    """Draw an envelope spectrum with the lines of the four parts, of which the highest point near each is marked.

    Args:
        view: the spectrum.
        channel: its name.
        fault: the part named, "" where none is.
        numbers: of figures.

    Returns:
        The figure, or None where the spectrum has fewer than two points.
    """
    if len(view.frequency_hz) < 2:
        return None
    heading = f"Envelope spectrum{f', {view.label}' if view.label else ''}"
    return _pictured([view], heading, channel, fault, numbers)


def before_and_after(
    views: Sequence[SpectrumView], channel: str, fault: str, numbers: itertools.count[int]
) -> Picture | None:
    """Draw a spectrum of the healthy bearing above one of the damaged bearing (thesis, Fig. 59)."""
    if len(views) != 2 or any(len(view.frequency_hz) < 2 for view in views):
        return None
    return _pictured(views, "Envelope spectra before and after the onset", channel, fault, numbers)


@mpl.rc_context(STYLE)
def _pictured(
    views: Sequence[SpectrumView], heading: str, channel: str, fault: str, numbers: itertools.count[int]
) -> Picture:
    made, panels = new_figure(3.3 if len(views) == 1 else 5.4, (1.0,) * len(views))
    tops, data = [], []
    for axes, view in zip(panels, views, strict=True):
        top, drawn = _draw(axes, view, fault)
        tops.append(top)
        data.append(drawn)
        if len(views) > 1:
            axes.set_title(view.label, loc="left", fontsize=9.5)
    alike = max(tops) <= _OWN_SCALES * min(tops)
    for axes, top in zip(panels, tops, strict=True):
        axes.set_ylim(0.0, 1.15 * (max(tops) if alike else top) or 1.0)
    add_legend(panels[-1], loc="upper right", ncols=4, handletextpad=0.3, columnspacing=1.2)
    panels[-1].set_xlabel("frequency (Hz)")
    shown = f"{len(views)} envelope spectra" if len(views) > 1 else "Envelope spectrum"
    label = f"{shown} of channel {channel} with the fault lines of the bearing."
    return Picture(
        heading, to_svg(made, label, numbers), _caption(views, tops, fault, alike), {"spectra": data}, "envelope"
    )


def _draw(axes: Axes, view: SpectrumView, fault: str) -> tuple[float, dict[str, Any]]:
    """Draw one spectrum into a panel; return its highest point and what was drawn."""
    frequency, amplitude = np.asarray(view.frequency_hz, float), np.asarray(view.amplitude_g, float)
    # Five orders of the passages; the mean and slow drift below the cage's line are no lines.
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
            found[part] = _fault_lines(axes, frequency, amplitude, part, view, last, named)
    axes.set_xlim(0.0, last)
    axes.set_ylabel(f"envelope ({view.unit})")
    top = float(amplitude[shown].max()) if shown.any() else 1.0
    suffix = "g" if view.unit == "g" else "sensor_unit"
    return top or 1.0, {"label": view.label, "frequency_hz": x, f"amplitude_{suffix}": y, "lines_hz": found}


def _fault_lines(
    axes: Axes,
    frequency: NDArray[np.float64],
    amplitude: NDArray[np.float64],
    part: str,
    view: SpectrumView,
    last: float,
    named: Sequence[str],
) -> list[float]:
    """Mark the highest points near the lines of a part; those of parts that are not named are lines only."""
    colour, marker = FAULT_MARKS[part]
    fundamental = view.fundamentals_hz[part]
    meant = not named or part in named
    found: list[tuple[float, float]] = []
    for order in range(1, ORDERS + 1):
        nominal = order * fundamental
        if nominal > last:
            break
        axes.axvline(nominal, color=colour, linewidth=0.8, linestyle=(0, (2, 3)), alpha=0.9 if meant else 0.4)
        place = _highest(frequency, amplitude, nominal)
        if place is not None:
            found.append((float(frequency[place]), float(amplitude[place])))
    label = f"{FAULT_NAMES[part]} {fundamental:.1f} Hz"
    if found and meant:
        x, y = zip(*found, strict=True)
        axes.plot(x, y, marker, color=colour, markersize=5, markerfacecolor=PAPER, label=label)
        for order, (at, height) in enumerate(found, start=1):
            if named:
                axes.annotate(
                    f"{order}×", (at, height), (0, 5), textcoords="offset points", fontsize=7.5, ha="center", color=INK
                )
        if named:
            _sidebands(axes, frequency, amplitude, part, view, found[:_SIDE_ORDERS])
    elif found:
        axes.plot([], [], color=colour, linewidth=0.8, linestyle=(0, (2, 3)), label=label)
    return [at for at, _ in found]


def _sidebands(
    axes: Axes,
    frequency: NDArray[np.float64],
    amplitude: NDArray[np.float64],
    part: str,
    view: SpectrumView,
    lines: Sequence[tuple[float, float]],
) -> None:
    """Mark the sidebands that a rotating part makes: the shaft's around the inner race, the cage's around the ball."""
    distance = {"inner": view.speed_hz, "ball": view.fundamentals_hz.get("cage", math.nan)}.get(part, math.nan)
    if not math.isfinite(distance) or distance < 3.0 * (frequency[1] - frequency[0]):
        return
    places = [_highest(frequency, amplitude, at + side * distance) for at, _ in lines for side in (-1, 1)]
    rows = [place for place in places if place is not None]
    colour, _ = FAULT_MARKS[part]
    axes.plot(
        frequency[rows], amplitude[rows], "|", color=colour, markersize=8, label=f"its sidebands, ±{distance:.1f} Hz"
    )


def _highest(frequency: NDArray[np.float64], amplitude: NDArray[np.float64], nominal: float) -> int | None:
    near = np.flatnonzero(np.abs(frequency - nominal) <= max(_SEARCH * nominal, frequency[1] - frequency[0]))
    return int(near[np.argmax(amplitude[near])]) if near.size else None


def _caption(views: Sequence[SpectrumView], tops: Sequence[float], fault: str, alike: bool) -> str:
    words = []
    if len(views) == 2:
        words.append(
            f"The highest point grows from {figure(tops[0])} to {figure(tops[1])} {views[0].unit}."
            if tops[1] >= tops[0]
            else f"The highest point is {figure(tops[0])} {views[0].unit} before and {figure(tops[1])} after."
        )
        words.append("Both have the same scale." if alike else "Each has a scale of its own.")
    words.append(
        f"Dotted: {ORDERS} orders of the kinematic frequency of each part; the marker is the highest point within 2 % "
        "of it."
    )
    if not fault:
        words.append(
            "A marker alone names nothing: a part is named only where its lines stand clear of noise and others."
        )
    return " ".join(words)


@mpl.rc_context(STYLE)
def recorded_lines(channel: Channel, row: int, numbers: itertools.count[int]) -> Picture | None:
    """Draw the fault lines that a record holds, each over the noise floor under it, where no spectrum is at hand."""
    amplitude = channel.numbers["envelope_amplitude"][row][:20]
    floor = np.resize(channel.numbers["envelope_floor"][row], 20)
    if amplitude.size < 20 or not np.isfinite(amplitude).any():
        return None
    scale, unit = scale_of(channel)
    made, (axes,) = new_figure(2.9)
    labels = []
    for place, fault in enumerate(FAULTS):
        x = np.arange(ORDERS) + 6.0 * place
        colour, _ = FAULT_MARKS[fault]
        rows = slice(ORDERS * place, ORDERS * (place + 1))
        axes.bar(x, np.nan_to_num(amplitude[rows] / scale), width=0.72, color=colour, alpha=0.85)
        axes.hlines(floor[rows] / scale, x - 0.42, x + 0.42, color=INK, linewidth=1.4)
        labels.append((6.0 * place + 2.0, FAULT_NAMES[fault]))
    axes.set_xticks([x for x, _ in labels], [f"{text}, 1 to 5" for _, text in labels])
    axes.grid(visible=False, axis="x")
    axes.set_ylabel(f"envelope ({unit})")
    block = f"block {channel.sequence[row]:,}"
    label = f"Lines of the envelope spectrum of {block}, with the noise floor as a black bar."
    suffix = "g" if unit == "g" else "sensor_unit"
    return Picture(
        f"Fault lines of the envelope spectrum, {block}",
        to_svg(made, label, numbers),
        "Bars: the first five lines of each part. Dark strokes: the noise floor under each. Empty: not resolved.",
        {f"amplitude_{suffix}": amplitude / scale, f"floor_{suffix}": floor / scale, "parts": list(FAULTS)},
        "lines",
    )
