"""The picture of a mail: level and lines over time with their marks, and the latest envelope spectrum.

The daemon has it drawn by a child process (``monitor.report.mail_child``) when a mail goes out, as it does not load
matplotlib itself.
"""

from __future__ import annotations

import io
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from monitor.records.database import SharedConnection
from monitor.records.rollup import SeriesKey
from monitor.records.spectra import read_spectra
from monitor.records.trends import TrendTable, read_trends
from monitor.report.figures.drawing import (
    INK,
    ORANGE,
    PALETTE,
    SOFT,
    STYLE,
    VERMILION,
    draw_line,
    log_if_wide,
    time_axis,
    usual_step,
)
from monitor.words.features import FEATURES
from monitor.words.numbers import Clock, time_zone
from monitor.words.parts import PARTS
from monitor.words.statuses import LINE_NAMES, fault_words

_POINTS = 600
_WIDTH_IN, _HEIGHT_IN, _DPI = 7.2, 6.4, 100
_LINES = {part.name: (part.feature, PALETTE[part.mail_colour]) for part in PARTS}
_HARMONICS = 5
_LAST_LABEL = 0.97
"""Share of the axis beyond which a line has no room for its name."""
_SPAN = 5.6
"""Part of the spectrum that is shown, times the first line of the named part."""


@dataclass(frozen=True)
class Wanted:
    """What is drawn.

    Attributes:
        store: database file.
        title: one line above the picture.
        fault: the named part, or None.
        marks: times by label, s on the axis of the channel.
        levels: of RMS, by label, SI.
        block: the newest whose spectrum is shown, or None for the newest of all.
        zone: time zone in which times are written.
        until: end of what is shown, s on the axis of the channel, or None for all.
        absolute: whether accelerations are in m/s2.
    """

    store: Path
    source: str
    channel: str
    dated: bool
    title: str = ""
    fault: str | None = None
    marks: Mapping[str, float] | None = None
    levels: Mapping[str, float] | None = None
    block: int | None = None
    zone: str = "UTC"
    until: float | None = None
    absolute: bool = True

    @classmethod
    def of_json(cls, text: str) -> Self:
        """Return what :func:`json.dumps` made of the fields."""
        values = json.loads(text)
        return cls(**{**values, "store": Path(values["store"])})


def draw(wanted: Wanted) -> bytes:
    """Return a PNG of 720 by 640 pixels.

    Raises:
        ValueError: there is nothing to draw.
        StoreError: the store cannot be read.
    """
    with SharedConnection(wanted.store) as shared:
        key = SeriesKey(wanted.source, wanted.channel, wanted.dated)
        trends = read_trends(shared, key, None, wanted.until, _POINTS)
        before = None if wanted.block is None else wanted.block + 1
        rows = read_spectra(shared, wanted.channel, source=wanted.source, before=before, newest=1)
    if not trends.time.size:
        raise ValueError(f"channel {wanted.channel} has no records")
    with mpl.rc_context({**STYLE, "figure.facecolor": "white"}):
        figure = Figure(figsize=(_WIDTH_IN, _HEIGHT_IN), dpi=_DPI, layout="constrained")
        FigureCanvasAgg(figure)
        heights = [1.2, 1.0, 1.2][: 3 if rows else 2]
        panels = figure.subplots(len(heights), 1, gridspec_kw={"height_ratios": heights})
        panels[1].sharex(panels[0])
        _draw_trends(panels[0], panels[1], trends, wanted)
        if rows:
            _draw_spectrum(panels[2], rows[0], wanted)
        figure.suptitle(wanted.title, x=0.01, ha="left", fontsize=10.5, fontweight="bold")
        out = io.BytesIO()
        figure.savefig(out, format="png", metadata={"Software": "spallwatch"}, facecolor="white")
    return out.getvalue()


def _draw_trends(level: Axes, lines: Axes, trends: TrendTable, wanted: Wanted) -> None:
    clock = Clock(wanted.dated, time_zone(wanted.zone))
    axis = time_axis(trends.time, clock)
    absolute = FEATURES["rms"].of_si(absolute=wanted.absolute)
    unit = "g" if wanted.absolute else "sensor unit"
    rms = trends.high["rms"] * absolute
    draw_line(level, axis, trends.time, rms, color=INK, label="RMS")
    limits = {label: value * absolute for label, value in (wanted.levels or {}).items()}
    log_if_wide(level, rms, np.asarray(list(limits.values())))
    for label, value in limits.items():
        colour = VERMILION if label == "danger" else ORANGE
        level.axhline(value, color=colour, linewidth=1.0, linestyle="--")
        level.annotate(
            label, (1.0, value), xycoords=("axes fraction", "data"), ha="right", va="bottom", color=colour, fontsize=8.5
        )
    level.set_ylabel(f"RMS, {unit}")
    named = (wanted.fault or "").split("|")
    shown = [part for part in _LINES if part in named] or list(_LINES)
    for part in shown:
        name, colour = _LINES[part]
        draw_line(lines, axis, trends.time, trends.high[name] * absolute, color=colour, label=LINE_NAMES[part])
    log_if_wide(lines, *(trends.high[_LINES[part][0]] for part in shown))
    lines.set_ylabel(f"lines, {unit}")
    lines.legend(loc="upper left", ncols=4)
    for label, moment in (wanted.marks or {}).items():
        if math.isfinite(moment):
            _mark(level, lines, float(axis.position(moment)), label)
    axis.settle(lines, float(trends.time[0]), float(trends.time[-1]) + usual_step(trends.time))
    level.tick_params(labelbottom=False)


def _mark(level: Axes, lines: Axes, place: float, label: str) -> None:
    for axes in (level, lines):
        axes.axvline(place, color=SOFT, linewidth=1.0, linestyle=":")
    level.annotate(
        label, (place, 0.0), xycoords=("data", "axes fraction"), xytext=(3, 3), textcoords="offset points",
        ha="left", va="bottom", color=SOFT, fontsize=8.5,
    )  # fmt: skip


def _draw_spectrum(axes: Axes, row: Any, wanted: Wanted) -> None:
    factor = FEATURES["rms"].of_si(absolute=row.absolute)
    named = [part for part in (wanted.fault or "").split("|") if part in row.lines]
    first = max((row.lines[part] for part in named or row.lines), default=math.inf)
    amplitude = np.asarray(row.amplitude, dtype=np.float64) * factor
    keep = int(min(amplitude.size, _SPAN * first / row.resolution + 1)) if math.isfinite(first) else amplitude.size
    # Where the speed varied in the block, the spectrum is one over orders of the shaft.
    one = row.speed if row.domain == "order" else 1.0
    frequency = np.arange(keep) * row.resolution / one
    for part in named:
        colour = _LINES[part][1]
        for harmonic in range(1, _HARMONICS + 1):
            place = harmonic * row.lines[part] / one
            if place > _LAST_LABEL * frequency[-1]:
                break
            axes.axvline(place, color=colour, linewidth=0.9, linestyle="--", alpha=0.7)
            name = LINE_NAMES[part] if harmonic == 1 else f"{harmonic}×"
            axes.annotate(
                name, (place, 1.0), xycoords=("data", "axes fraction"), xytext=(2, -2), textcoords="offset points",
                ha="left", va="top", color=colour, fontsize=8.5,
            )  # fmt: skip
    # The line at zero is the mean of the envelope.
    axes.plot(frequency[1:], amplitude[1:keep], color=INK, linewidth=0.9)
    axes.set_xlim(0.0, float(frequency[-1]))
    axes.set_ylim(bottom=0.0)
    of = f", lines of the {fault_words('|'.join(named))}" if named else ""
    axes.set_title(f"Envelope spectrum of block {row.sequence}{of}", loc="left", fontsize=9.5)
    axes.set_xlabel("order of the shaft" if row.domain == "order" else "Hz")
    axes.set_ylabel("g" if row.absolute else "sensor unit")
