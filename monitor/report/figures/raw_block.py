"""Figure of a block's samples: spectra of acceleration and velocity, before the onset and now, and the waveform."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from monitor.health.signal.spectra import BlockView
from monitor.health.signal.velocity import VELOCITY_BAND
from monitor.health.signal.waterfall import SpectrumRow
from monitor.report.figures.drawing import (
    BLUE,
    GREY,
    STYLE,
    WIDTH,
    Picture,
    add_legend,
    log_ticks,
    scale_of,
    thin,
    to_svg,
)
from monitor.report.figures.spectrum import FAULT_MARKS, dot_lines, shared_words
from monitor.report.verdict import ChannelContext
from monitor.words.numbers import figure
from monitor.words.parts import FAULTS
from monitor.words.statuses import LINE_NAMES, range_words

_COLUMNS = 500
_DECADES = 5.0
_LOWEST_VELOCITY_HZ = 2.0
_TURNS = 8.0
"""Turns of the shaft that the waveform shows."""

Curve = tuple[NDArray[np.float64], NDArray[np.float64]]


@mpl.rc_context(STYLE)
def raw_block(context: ChannelContext) -> Picture | None:
    """Draw the samples of the newest block with a view, and the spectra of the one before it; None without."""
    shown = [row for row in context.run.views.get(context.channel.name, ()) if row.view is not None]
    if not shown or shown[-1].view is None:
        return None
    row, view = shown[-1], shown[-1].view
    scale = scale_of(absolute=row.absolute)
    made = Figure(figsize=(WIDTH, 7.2 if row.absolute else 5.0), layout="constrained")
    panels = list(made.subplots(3 if row.absolute else 2, 1, squeeze=False)[:, 0])
    drawn: dict[str, Any] = {}
    pair = [(item, item.view) for item in shown[-2:] if item.view is not None]
    for item, seen in pair:
        x, y = _acceleration(seen)
        drawn |= _draw(panels[0], item, x, y / scale.si, newest=item is row, key=f"acceleration_{scale.suffix}")
    _finish(panels[0], f"acceleration ({scale.unit})")
    if row.absolute:
        for item, seen in pair:
            x, y = _velocity(seen)
            drawn |= _draw(panels[1], item, x, y, newest=item is row, key="velocity_mm_s")
        _mark(panels[1], row, context.verdict.fault)
        _finish(panels[1], "velocity, RMS (mm/s)")
    add_legend(panels[0], loc="upper right", ncols=2)
    time, samples = _beginning(row, view)
    panels[-1].plot(time, samples / scale.si, color=BLUE, linewidth=0.6)
    panels[-1].set_xlabel("time (s)")
    panels[-1].set_ylabel(f"acceleration ({scale.unit})")
    panels[-1].set_xlim(0.0, float(time[-1]) if time.size > 1 else 1.0)
    drawn |= {"time_s": time, f"waveform_{scale.suffix}": samples / scale.si}
    what = "acceleration, velocity and waveform" if row.absolute else "acceleration and waveform"
    label = f"Spectra and waveform of block {row.sequence:,} of channel {context.channel.name}: {what}."
    svg = to_svg(made, label, context.numbers)
    return Picture(f"Samples of block {row.sequence:,}: {what}", svg, _caption(row, view, shown), drawn, "raw")


def _acceleration(view: BlockView) -> Curve:
    """Return frequencies and the highest amplitude in each bin, m/s2."""
    spectra = view.spectra
    middle = (np.arange(spectra.highest.size, dtype=np.float64) + 0.5) * spectra.width
    return _upper(middle, np.asarray(spectra.highest, dtype=np.float64))


def _velocity(view: BlockView) -> Curve:
    """Return frequencies from 2 to 1000 Hz and the highest RMS of the velocity near each, mm/s."""
    spectra = view.spectra
    x = np.arange(spectra.amplitude.size, dtype=np.float64) * spectra.resolution
    there = (x >= _LOWEST_VELOCITY_HZ) & (x <= VELOCITY_BAND[1] * (1.0 + 1e-9))
    x, amplitude = x[there], np.asarray(spectra.amplitude[there], dtype=np.float64)
    return _upper(x, 1e3 * amplitude / (math.sqrt(2.0) * 2.0 * math.pi * x))


def _upper(x: NDArray[np.float64], y: NDArray[np.float64]) -> Curve:
    """Return the highest point of each column of the picture."""
    starts = (
        np.unique(np.linspace(0, x.size, _COLUMNS, endpoint=False).astype(np.intp)) if x.size else x.astype(np.intp)
    )
    ends = np.append(starts[1:], x.size)
    places = np.array([s + int(np.argmax(y[s:e])) for s, e in zip(starts, ends, strict=True)], dtype=np.intp)
    return x[places], y[places]


def _draw(
    axes: Axes,
    row: SpectrumRow,
    frequency: NDArray[np.float64],
    amplitude: NDArray[np.float64],
    *,
    newest: bool,
    key: str,
) -> dict[str, Any]:
    """Draw a spectrum; return what was drawn by the ends of its names."""
    y = np.where(amplitude > 0.0, amplitude, np.nan)
    axes.plot(
        frequency,
        y,
        color=BLUE if newest else GREY,
        linewidth=0.7,
        label=f"block {row.sequence:,}",
        zorder=2 + int(newest),
    )
    axes.set_xlim(0.0, float(frequency[-1]) if frequency.size else 1.0)
    block = f"block_{row.sequence}_"
    return {f"{block}{key.split('_', 1)[0]}_frequency_hz": frequency, f"{block}{key}": y}


def _finish(axes: Axes, label: str) -> None:
    axes.set_yscale("log")
    low, high = axes.get_ylim()
    axes.set_ylim(max(low, high * 10.0**-_DECADES), high)
    log_ticks(axes.yaxis, 8, decades=_DECADES)
    axes.set_ylabel(label)
    axes.set_xlabel("frequency (Hz)")


def _mark(axes: Axes, row: SpectrumRow, fault: str) -> None:
    """Mark the lines of the shaft and of the named part."""
    last = axes.get_xlim()[1]
    parts = [part for part in FAULTS if part in fault.split("|") and part in row.lines]
    families = [
        ("shaft", row.speed, GREY),
        *((LINE_NAMES[part], row.lines[part], FAULT_MARKS[part][0]) for part in parts),
    ]
    for name, first, colour in families:
        dot_lines(axes, first, last, colour, f"{name} {first:.1f} Hz", 0.8)
    add_legend(axes, loc="upper right", ncols=4)


def _beginning(row: SpectrumRow, view: BlockView) -> Curve:
    """Return the first turns of the waveform, s and m/s2."""
    most = max(64, int(_TURNS / row.speed * view.rate)) if row.speed > 0.0 else view.waveform.size
    samples = np.asarray(view.waveform[:most], dtype=np.float64)
    return thin(np.arange(samples.size) / view.rate, samples, _COLUMNS)


def _caption(row: SpectrumRow, view: BlockView, shown: Sequence[SpectrumRow]) -> str:
    texts = [
        f"Lines are {figure(view.spectra.resolution, 2)} Hz apart; drawn is the highest near each frequency, on "
        "logarithmic scales."
    ]
    if len(shown) > 1:
        texts.append(f"Grey: block {shown[-2].sequence:,}, before the onset.")
    if row.speed_range is not None and (words := range_words(*row.speed_range)).startswith("speed from"):
        texts.append(f"Over time, not over the angle of the shaft: with a {words}, its lines are smeared.")
    texts.append(shared_words(row.lines, view.spectra.resolution))
    texts.append(f"The waveform shows {_TURNS:g} turns of the shaft at most.")
    return " ".join(text for text in texts if text)
