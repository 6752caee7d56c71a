"""Figures over time: RMS, fault lines and the detection score over a whole life and over its final stage."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Patch
from numpy.typing import NDArray

from monitor.health.schema import REJECTIONS
from monitor.report.figures.drawing import (
    BLOCK_AXIS,
    BLUE,
    GREY,
    INK,
    ORANGE,
    PALETTE,
    SHADE,
    STYLE,
    VERMILION,
    Picture,
    TimeAxis,
    add_legend,
    draw_line,
    draw_rug,
    last_finite,
    log_if_wide,
    new_figure,
    scale_of,
    thin,
    time_axis,
    to_svg,
)
from monitor.report.figures.zoom import Line, Panel, zoom_data
from monitor.report.readings import LifeMoment
from monitor.report.verdict import ChannelContext, ChannelVerdict
from monitor.words.features import FEATURES
from monitor.words.numbers import figure
from monitor.words.parts import PARTS
from monitor.words.statuses import FAULT_NAMES

_SUMS = {part.name: (part.feature, PALETTE[part.trend_colour]) for part in PARTS}
"""Feature and colour of the sum of lines of each part."""
_ALARM_COLOURS = {"alert": ORANGE, "danger": VERMILION}
_SMOOTHED = "moving mean that the tracker takes"
_MIN_LIFE_PER_FINAL_STAGE = 2.5
"""A figure of the final stage alone needs a life at least so many times as long."""
_DATA_BINS = 300
_CLOSED_ALPHA = 0.12


@dataclass(frozen=True, eq=False)
class _TrendSpan:
    """The part of a channel's life that a figure shows; ``time`` are positions on ``axis`` in seconds or blocks."""

    context: ChannelContext
    part: slice
    axis: TimeAxis
    time: NDArray[np.float64]
    alarms: list[tuple[float, str]]

    def column(self, name: str) -> NDArray[np.float64]:
        return self.context.channel.column(name)[self.part]

    @property
    def learning(self) -> NDArray[np.intp]:
        return np.flatnonzero(self.context.channel.word("stage")[self.part] == "learning")

    def rugs(self) -> list[tuple[str, str, str, NDArray[np.intp]]]:
        """Return marker, colour, name and rows of the rejected and of the flagged blocks."""
        status = self.context.channel.status[self.part]
        rejected = np.isin(status.astype(str), REJECTIONS)
        flagged = (status != "ok") & ~rejected
        kinds = (("x", VERMILION, "rejected", rejected), ("|", ORANGE, "flagged", flagged))
        return [(marker, colour, name, np.flatnonzero(rows)) for marker, colour, name, rows in kinds if rows.any()]


def trends(context: ChannelContext) -> Picture | None:
    """Draw RMS, H_or, the sum of the named part's lines and the score over a life (thesis, Figs. 57 and 58).

    None where fewer than two blocks have a value.
    """
    return _drawn(context, slice(None), "")


def final_stage(context: ChannelContext) -> Picture | None:
    """Draw the same over the final stage alone (thesis, Fig. 60).

    None where there is no final stage, or where it is most of the life.
    """
    time, t_fs = context.channel.time, context.verdict.t_fs
    if t_fs is None or not math.isfinite(t_fs.time) or time.size < 2 or np.ptp(time) == 0.0:
        return None
    left = float(time[-1]) - t_fs.time
    if left <= 0.0 or np.ptp(time) < _MIN_LIFE_PER_FINAL_STAGE * left:
        return None
    first = int(np.searchsorted(time, t_fs.time - 0.15 * left))
    return _drawn(context, slice(first, None), "The final stage")


@mpl.rc_context(STYLE)
def _drawn(context: ChannelContext, part: slice, heading: str) -> Picture | None:
    channel, verdict = context.channel, context.verdict
    if np.sum(np.isfinite(channel.column("rms")[part])) < 2:
        return None
    if np.ptp(channel.time) == 0.0:
        time, axis = channel.sequence.astype(np.float64)[part], BLOCK_AXIS
    else:
        time, axis = channel.time[part], time_axis(channel.time, context.clock)
    span = _TrendSpan(context, part, axis, time, _alarms(context))
    score, threshold = span.column("detect_score"), span.column("detect_threshold")
    scored = bool(np.isfinite(score).any())
    made, panels = new_figure(5.6 if scored else 4.2, (1.25, 1.25, 1.0) if scored else (1.0, 1.0))
    data = _levels(panels[0], panels[1], span)
    if scored:
        draw_line(panels[2], axis, time, score, color=GREY)
        draw_line(panels[2], axis, time, threshold, color=ORANGE, linestyle="-.", label="threshold of an alarm")
        log_if_wide(panels[2], score, threshold)
        panels[2].set_ylabel("score")
        add_legend(panels[2], loc="upper left")
        data["score"], data["score_threshold"] = score, last_finite(threshold)
    for axes in panels:
        _shade_learning(axes, span)
        if axis.timed:
            draw_marks(axes, axis, verdict)
            _draw_alarms(axes, span)
    _mark_legend(panels[0], span)
    _draw_rugs(panels[0], span)
    axis.settle(panels[-1], time[0], time[-1])
    where = "in the final stage" if heading else "over time"
    label = f"RMS, fault lines and detection score of channel {channel.name} {where}. {verdict.headline}."
    data |= {"t_fs_s": _time_of(verdict.t_fs), "t_eol_s": _time_of(verdict.t_eol)}
    data["alarms_s"] = [at for at, _ in span.alarms]
    zoom = _zoomed(span, panels, data)
    data = {"time_s" if axis.timed else "block": time, **data} if time.size <= 2 * _DATA_BINS else _thinned(time, data)
    svg, name = to_svg(made, label, context.numbers), "final_stage" if heading else "trends"
    return Picture(heading or "Vibration", svg, _caption(span, scored=scored), data, name, zoom)


def _zoomed(span: _TrendSpan, panels: list[Axes], data: dict[str, Any]) -> dict[str, Any]:
    scale = scale_of(absolute=span.context.channel.has_level)
    smoothed = span.column("rms_smoothed") / scale.si
    rms = [Line("RMS", BLUE, data[f"rms_{scale.suffix}"]), Line(_SMOOTHED, INK, smoothed)]
    sums = [
        Line(FEATURES[name].symbol, colour, data[key])
        for name, colour in _SUMS.values()
        if (key := f"{name}_{scale.suffix}") in data
    ]
    charts = [
        Panel(axes, lines, levels=[("learned", GREY, data.get(f"{name}_learned_{scale.suffix}", math.nan))])
        for axes, lines, name in ((panels[0], rms, "rms"), (panels[1], sums, "h_or"))
    ]
    if len(panels) > 2:
        threshold = Line("threshold of an alarm", ORANGE, span.column("detect_threshold"), "dashed")
        score = [Line("score", GREY, data["score"]), threshold]
        charts.append(Panel(panels[2], score, height=0.8))
    ticks = [(name, colour, span.time[rows], False) for _, colour, name, rows in span.rugs()]
    if span.axis.timed:
        for severity, colour in _ALARM_COLOURS.items():
            ticks.append((f"{severity} raised", colour, np.array(_shown_alarms(span, severity)), True))
    learning = span.time[span.learning]
    return zoom_data(
        span.axis,
        span.time,
        charts,
        marks=zoom_marks(span.context.verdict) if span.axis.timed else (),
        ticks=ticks,
        shade=(learning[0], learning[-1]) if learning.size > 1 else (),
    )


def zoom_marks(verdict: ChannelVerdict) -> list[tuple[str, str, float, str]]:
    """Return the vertical lines of :func:`draw_marks` as :func:`monitor.report.figures.zoom.zoom_data` takes them."""
    return [(name, colour, mark.time, style) for mark, colour, style, name in _moments(verdict)]


def _levels(upper: Axes, lower: Axes, span: _TrendSpan) -> dict[str, Any]:
    """Draw RMS and the sums of lines with their baselines; return what was drawn."""
    channel, axis, time = span.context.channel, span.axis, span.time
    scale = scale_of(absolute=channel.has_level)
    named = [part for part in span.context.verdict.fault.split("|") if part and part != "outer"]
    rms, smoothed = span.column("rms") / scale.si, span.column("rms_smoothed") / scale.si
    draw_line(upper, axis, time, rms, color=BLUE)
    draw_line(upper, axis, time, smoothed, color=INK, linewidth=0.9, label=_SMOOTHED)
    data: dict[str, Any] = {f"rms_{scale.suffix}": rms}
    shown = [rms]
    for part in ("outer", *named):
        name, colour = _SUMS[part]
        values = span.column(name) / scale.si
        data[f"{name}_{scale.suffix}"] = values
        style = {"label": f"{FEATURES[name].symbol}, {FAULT_NAMES[part]}"} if named else {}
        if any(np.array_equal(values, other, equal_nan=True) for other in shown[1:]):
            continue  # Families that the resolution cannot separate are one line.
        pale = 0.45 if named and part == "outer" else 1.0
        draw_line(lower, axis, time, values, color=colour, alpha=pale, **style)
        shown.append(values)
    for axes, name in ((upper, "rms"), (lower, "h_or")):
        learned = channel.baseline(name) / scale.si
        if math.isfinite(learned):
            axes.axhline(learned, color=GREY, linewidth=0.9, linestyle=(0, (6, 3)))
            data[f"{name}_learned_{scale.suffix}"] = learned
    log_if_wide(upper, shown[0])
    log_if_wide(lower, *shown[1:])
    upper.set_ylabel(f"RMS ({scale.unit})")
    lower.set_ylabel(f"{'H' if named else 'H_or'} ({scale.unit})")
    for axes in (upper, lower):
        add_legend(axes, loc="upper left", ncols=3)
    return data


def _caption(span: _TrendSpan, *, scored: bool) -> str:
    channel, rms = span.context.channel, span.column("rms")
    finite = rms[np.isfinite(rms)]
    scale = scale_of(absolute=channel.has_level)
    words = [f"RMS from {figure(finite.min() / scale.si)} to {figure(finite.max() / scale.si)} {scale.unit}."]
    if math.isfinite(channel.baseline("rms")):
        words.append("Dashed: the median of the learning window (shaded where it is in sight).")
    if span.context.verdict.t_fs is not None:
        words.append("Orange: where the final stage began, dotted where this was known.")
    if scored:
        words.append("The score says how far RMS and the highest fault lines together stand above what was learned.")
    words.append("Lines break where blocks are missing or were rejected.")
    return " ".join(words)


def _thinned(time: NDArray[np.float64], data: dict[str, Any]) -> dict[str, Any]:
    """Reduce each long column to the extremes of ``_DATA_BINS`` bins, with their times."""
    found = dict(data)
    for name, values in data.items():
        if isinstance(values, np.ndarray) and values.size == time.size:
            x, y = thin(time, values, _DATA_BINS)
            found[name] = {"time_s": x, "value": y}
    return found


def _time_of(mark: LifeMoment | None) -> float:
    return math.nan if mark is None else mark.time


def _alarms(context: ChannelContext) -> list[tuple[float, str]]:
    """Return time and severity of each alarm raised on a channel."""
    channel = context.channel
    times = {int(number): float(at) for number, at in zip(channel.sequence, channel.time, strict=True)}
    raised = [
        (times.get(int(event.get("block", -1))), str(event.get("severity", "alert")))
        for event in context.run.events
        if event.get("kind") == "alarm_raised" and event.get("channel") == channel.name
    ]
    return [(at, severity) for at, severity in raised if at is not None]


def _shown_alarms(span: _TrendSpan, severity: str) -> list[float]:
    return [at for at, known in span.alarms if known == severity and at >= span.time[0]]


def _draw_alarms(axes: Axes, span: _TrendSpan) -> None:
    for severity, colour in _ALARM_COLOURS.items():
        x = [span.axis.position(at) for at in _shown_alarms(span, severity)]
        axes.plot(x, [0.97] * len(x), "v", color=colour, markersize=5, transform=axes.get_xaxis_transform())


def _shade_learning(axes: Axes, span: _TrendSpan) -> None:
    rows = span.learning
    if rows.size > 1:
        edges = span.axis.position(span.time[rows[[0, -1]]])
        axes.axvspan(float(edges[0]), float(edges[1]), color=SHADE, linewidth=0, zorder=0)


def draw_marks(axes: Axes, axis: TimeAxis, verdict: ChannelVerdict) -> None:
    """Draw t_fs, the moment at which it was known, and the end of life as vertical lines; shade what closed again."""
    for began, last in verdict.closed:
        if math.isfinite(began.time) and math.isfinite(last.time):
            edges = (float(axis.position(mark.time)) for mark in (began, last))
            axes.axvspan(*edges, color=VERMILION, alpha=_CLOSED_ALPHA, linewidth=0, zorder=0)
    for mark, colour, style, _ in _moments(verdict):
        axes.axvline(float(axis.position(mark.time)), color=colour, linestyle=style, linewidth=1.2)


def _moments(verdict: ChannelVerdict) -> list[tuple[LifeMoment, str, str, str]]:
    marks = (
        (verdict.t_fs, VERMILION, "-", "final stage began"),
        (verdict.t_fs_known, VERMILION, ":", "known"),
        (verdict.t_eol, INK, "-", "end of life"),
    )
    return [
        (mark, colour, style, name)
        for mark, colour, style, name in marks
        if mark is not None and math.isfinite(mark.time)
    ]


def _mark_legend(axes: Axes, span: _TrendSpan) -> None:
    """Name lines, marks and rugs in one legend above the panel."""
    handles, _ = axes.get_legend_handles_labels()
    for mark, colour, style, name in _moments(span.context.verdict):
        block = "" if mark.block is None else f" (block {mark.block:,})"
        handles += axes.plot([], [], color=colour, linestyle=style, linewidth=1.2, label=f"{name}{block}")
    if closed := span.context.verdict.closed:
        name = f"final stage that closed again ({len(closed)})"
        handles += [Patch(color=VERMILION, alpha=_CLOSED_ALPHA, linewidth=0, label=name)]
    for marker, colour, name, rows in span.rugs():
        handles += axes.plot([], [], marker, color=colour, markersize=5, label=f"{name} ({rows.size:,})")
    for severity, colour in _ALARM_COLOURS.items():
        raised = sum(known == severity for _, known in span.alarms)
        if raised:
            handles += axes.plot([], [], "v", color=colour, markersize=5, label=f"{severity} raised ({raised})")
    if handles:
        axes.legend(handles=handles, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4, borderaxespad=0.2)


def _draw_rugs(axes: Axes, span: _TrendSpan) -> None:
    style: dict[str, Any] = {"markersize": 5, "transform": axes.get_xaxis_transform()}
    for marker, colour, _, rows in span.rugs():
        draw_rug(axes, span.axis, span.time[rows], 0.03, marker, 300, color=colour, **style)
