"""Figures over time: RMS, fault lines and the detection score over a whole life and over its final stage."""

from __future__ import annotations

import itertools
import math
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from monitor.health.schema import REJECTIONS
from monitor.report.figures.drawing import (
    BLOCK_AXIS,
    BLUE,
    GREEN,
    GREY,
    INK,
    ORANGE,
    PURPLE,
    SHADE,
    STYLE,
    VERMILION,
    Picture,
    TimeAxis,
    add_legend,
    draw_line,
    log_if_wide,
    new_figure,
    thin,
    time_axis,
    to_svg,
)
from monitor.report.figures.zoom import Line, Panel, zoom_data
from monitor.report.runs import Channel, Run
from monitor.report.verdict import Moment, Verdict
from monitor.words.numbers import Clock, figure
from monitor.words.statuses import FAULT_NAMES
from streams.block import STANDARD_GRAVITY

_SUMS = {"outer": "h_or", "inner": "h_ir", "ball": "h_ball", "cage": "h_cage"}
_SYMBOLS = {"outer": "H_or", "inner": "H_ir", "ball": "H_ball", "cage": "H_cage"}
_SUM_COLOURS = {"outer": PURPLE, "inner": BLUE, "ball": GREEN, "cage": ORANGE}
_LONG_LIFE = 2.5
"""A life so many times as long as its final stage gets a figure of the final stage alone."""
_DATA_BINS = 300


def axis_of(channel: Channel, clock: Clock) -> tuple[NDArray[np.float64], TimeAxis]:
    """Return positions and axis of the blocks: their times, or their numbers where the recording knows no times."""
    if channel.time.size and np.ptp(channel.time) == 0.0:
        return channel.sequence.astype(np.float64), BLOCK_AXIS
    return channel.time, time_axis(channel.time, clock)


def scale_of(channel: Channel) -> tuple[float, str]:
    """Return what a channel's accelerations are divided by to be shown, and their unit then."""
    return (STANDARD_GRAVITY, "g") if channel.has_level else (1.0, "sensor unit")


def baseline(channel: Channel, name: str) -> float:
    """Return the median of a variable over the learning window, NaN where nothing was learned."""
    values = channel.column(name)[channel.word("stage") == "learning"]
    values = values[np.isfinite(values)]
    return float(np.median(values)) if values.size > 1 else math.nan


def trends(run: Run, channel: Channel, verdict: Verdict, clock: Clock, numbers: itertools.count[int]) -> Picture | None:
    """Draw RMS, H_or (and the sum of the named part's lines) and the detection score over a life.

    Returns:
        The figure (thesis, Figs. 57 and 58), or None where fewer than two blocks have a value.
    """
    return _drawn(run, channel, verdict, clock, numbers, slice(None), "")


def final_stage(
    run: Run, channel: Channel, verdict: Verdict, clock: Clock, numbers: itertools.count[int]
) -> Picture | None:
    """Draw the same over the final stage alone.

    Returns:
        The figure (thesis, Fig. 60), or None where there is no final stage or it is most of the life anyway.
    """
    time = channel.time
    if verdict.t_fs is None or not math.isfinite(verdict.t_fs.time) or time.size < 2 or np.ptp(time) == 0.0:
        return None
    left = float(time[-1]) - verdict.t_fs.time
    if left <= 0.0 or np.ptp(time) < _LONG_LIFE * left:
        return None
    first = int(np.searchsorted(time, verdict.t_fs.time - 0.15 * left))
    return _drawn(run, channel, verdict, clock, numbers, slice(first, None), "The final stage")


@mpl.rc_context(STYLE)
def _drawn(
    run: Run,
    channel: Channel,
    verdict: Verdict,
    clock: Clock,
    numbers: itertools.count[int],
    part: slice,
    heading: str,
) -> Picture | None:
    rms = channel.column("rms")[part]
    if np.sum(np.isfinite(rms)) < 2:
        return None
    everywhere, axis = axis_of(channel, clock)
    time = everywhere[part]
    score, threshold = channel.column("detect_score")[part], channel.column("detect_threshold")[part]
    scored = bool(np.isfinite(score).any())
    made, panels = new_figure(5.6 if scored else 4.2, (1.25, 1.25, 1.0) if scored else (1.0, 1.0))
    data = _levels(panels[0], panels[1], axis, time, channel, part, verdict)
    if scored:
        draw_line(panels[2], axis, time, score, color=GREY)
        draw_line(panels[2], axis, time, threshold, color=ORANGE, linestyle="-.", label="threshold of an alarm")
        log_if_wide(panels[2], score, threshold)
        panels[2].set_ylabel("score")
        add_legend(panels[2], loc="upper left")
        data["score"], data["score_threshold"] = score, _last(threshold)
    alarms = _alarms(run, channel)
    for axes in panels:
        _shade_learning(axes, axis, time, channel, part)
        if axis.timed:
            draw_marks(axes, axis, verdict)
            _draw_alarms(axes, axis, alarms, time)
    _mark_legend(panels[0], verdict, channel, part, alarms)
    _rug(panels[0], axis, time, channel, part)
    panels[-1].set_xlim(float(axis.position(time[0])), float(axis.position(time[-1])))
    axis.settle(panels[-1])
    where = "in the final stage" if heading else "over time"
    label = f"RMS, fault lines and detection score of channel {channel.name} {where}. {verdict.headline}."
    data |= {"t_fs_s": _time_of(verdict.t_fs), "t_eol_s": _time_of(verdict.t_eol), "alarms_s": [at for at, _ in alarms]}
    return Picture(
        heading or "Vibration",
        to_svg(made, label, numbers),
        _caption(channel, verdict, part, scored=scored),
        {"time_s" if axis.timed else "block": time, **data} if time.size <= 2 * _DATA_BINS else _thinned(time, data),
        "final_stage" if heading else "trends",
        _zoomed(axis, time, panels, data, channel, part, verdict, alarms),
    )


def _zoomed(
    axis: TimeAxis,
    time: NDArray[np.float64],
    panels: list[Axes],
    data: dict[str, Any],
    channel: Channel,
    part: slice,
    verdict: Verdict,
    alarms: list[tuple[float, str]],
) -> dict[str, Any]:
    scale, unit = scale_of(channel)
    suffix = "g" if unit == "g" else "sensor_unit"
    rms = [Line("RMS", BLUE, data[f"rms_{suffix}"])]
    rms.append(Line("moving mean that the tracker takes", INK, channel.column("rms_smoothed")[part] / scale))
    sums = [
        Line(_SYMBOLS[name], _SUM_COLOURS[name], data[key])
        for name in _SUMS
        if (key := f"{_SUMS[name]}_{suffix}") in data
    ]
    charts = [
        Panel(axes, lines, levels=[("learned", GREY, data.get(f"{name}_learned_{suffix}", math.nan))])
        for axes, lines, name in ((panels[0], rms, "rms"), (panels[1], sums, "h_or"))
    ]
    if len(panels) > 2:
        threshold = channel.column("detect_threshold")[part]
        score = [Line("score", GREY, data["score"]), Line("threshold of an alarm", ORANGE, threshold, "dashed")]
        charts.append(Panel(panels[2], score, height=0.8))
    ticks = [(name, colour, time[rows], False) for _, colour, name, rows in _rugs(channel, part)]
    for severity, colour in (("alert", ORANGE), ("danger", VERMILION)):
        at = np.array([at for at, said in alarms if said == severity and at >= time[0]])
        ticks.append((f"{severity} raised", colour, at, True))
    learning = time[channel.word("stage")[part] == "learning"]
    return zoom_data(
        axis,
        time,
        charts,
        marks=zoom_marks(verdict) if axis.timed else (),
        ticks=ticks if axis.timed else ticks[:-2],
        shade=(learning[0], learning[-1]) if learning.size > 1 else (),
    )


def zoom_marks(verdict: Verdict) -> list[tuple[str, str, float, str]]:
    """Return the vertical lines of :func:`draw_marks` as :func:`monitor.report.figures.zoom.zoom_data` takes them."""
    return [(name, colour, mark.time, style) for mark, colour, style, name in _moments(verdict)]


def _levels(
    upper: Axes, lower: Axes, axis: TimeAxis, time: NDArray[np.float64], channel: Channel, part: slice, verdict: Verdict
) -> dict[str, Any]:
    """Draw RMS and the sums of lines with what was learned of them; return what was drawn."""
    scale, unit = scale_of(channel)
    suffix = "g" if unit == "g" else "sensor_unit"
    named = [part_ for part_ in verdict.fault.split("|") if part_ and part_ != "outer"]
    rms, smoothed = channel.column("rms")[part] / scale, channel.column("rms_smoothed")[part] / scale
    draw_line(upper, axis, time, rms, color=BLUE)
    if np.isfinite(smoothed).any():
        draw_line(upper, axis, time, smoothed, color=INK, linewidth=0.9, label="moving mean that the tracker takes")
    data: dict[str, Any] = {f"rms_{suffix}": rms}
    shown = [rms]
    for name in ("outer", *named):
        values = channel.column(_SUMS[name])[part] / scale
        data[f"{_SUMS[name]}_{suffix}"] = values
        style = {"label": f"{_SYMBOLS[name]}, {FAULT_NAMES[name]}"} if named else {}
        if any(np.array_equal(values, other, equal_nan=True) for other in shown[1:]):
            continue  # Lines that the resolution does not tell apart are one line.
        pale = 0.45 if named and name == "outer" else 1.0
        draw_line(lower, axis, time, values, color=_SUM_COLOURS[name], alpha=pale, **style)
        shown.append(values)
    for axes, name in ((upper, "rms"), (lower, "h_or")):
        learned = baseline(channel, name) / scale
        if math.isfinite(learned):
            axes.axhline(learned, color=GREY, linewidth=0.9, linestyle=(0, (6, 3)))
            data[f"{name}_learned_{suffix}"] = learned
    log_if_wide(upper, shown[0])
    log_if_wide(lower, *shown[1:])
    upper.set_ylabel(f"RMS ({unit})")
    lower.set_ylabel(f"{'H' if named else 'H_or'} ({unit})")
    for axes in (upper, lower):
        add_legend(axes, loc="upper left", ncols=3)
    return data


def _caption(channel: Channel, verdict: Verdict, part: slice, *, scored: bool) -> str:
    rms = channel.column("rms")[part]
    finite = rms[np.isfinite(rms)]
    scale, unit = scale_of(channel)
    words = [f"RMS from {figure(finite.min() / scale)} to {figure(finite.max() / scale)} {unit}."]
    if math.isfinite(baseline(channel, "rms")):
        words.append("Dashed: the median of the learning window (shaded where it is in sight).")
    if verdict.t_fs is not None:
        words.append("Orange: where the final stage began, dotted where this was known.")
    if scored:
        words.append("The score says how far RMS and H_or together stand above what was learned.")
    words.append("Lines break where blocks are missing or were rejected.")
    return " ".join(words)


def _thinned(time: NDArray[np.float64], data: dict[str, Any]) -> dict[str, Any]:
    """Leave of each long column the extremes of ``_DATA_BINS`` bins, with the times of its own."""
    found: dict[str, Any] = {}
    for name, values in data.items():
        if isinstance(values, np.ndarray) and values.size == time.size:
            x, y = thin(time, values, _DATA_BINS)
            found[name] = {"time_s": x, "value": y}
        else:
            found[name] = values
    return found


def _last(values: NDArray[np.float64]) -> float:
    finite = values[np.isfinite(values)]
    return float(finite[-1]) if finite.size else math.nan


def _time_of(mark: Moment | None) -> float:
    return math.nan if mark is None else mark.time


def _alarms(run: Run, channel: Channel) -> list[tuple[float, str]]:
    """Return moment and severity of each alarm raised on a channel."""
    found = []
    places = {int(number): at for number, at in zip(channel.sequence, channel.time, strict=True)}
    for event in run.events:
        if event.get("kind") == "alarm_raised" and event.get("channel") == channel.name:
            at = places.get(int(event.get("block", -1)))
            if at is not None:
                found.append((float(at), str(event.get("severity", "alert"))))
    return found


def _draw_alarms(axes: Axes, axis: TimeAxis, alarms: list[tuple[float, str]], time: NDArray[np.float64]) -> None:
    for severity, colour in (("alert", ORANGE), ("danger", VERMILION)):
        x = [axis.position(at) for at, said in alarms if said == severity and at >= time[0]]
        axes.plot(x, [0.97] * len(x), "v", color=colour, markersize=5, transform=axes.get_xaxis_transform())


def _shade_learning(axes: Axes, axis: TimeAxis, time: NDArray[np.float64], channel: Channel, part: slice) -> None:
    rows = np.flatnonzero(channel.word("stage")[part] == "learning")
    if rows.size > 1:
        edges = axis.position(time[rows[[0, -1]]])
        axes.axvspan(float(edges[0]), float(edges[1]), color=SHADE, linewidth=0, zorder=0)


def draw_marks(axes: Axes, axis: TimeAxis, verdict: Verdict) -> None:
    """Draw t_fs, the moment at which it was known, and the end of life as vertical lines."""
    for mark, colour, style, _ in _moments(verdict):
        axes.axvline(float(axis.position(mark.time)), color=colour, linestyle=style, linewidth=1.2)


def _moments(verdict: Verdict) -> list[tuple[Moment, str, str, str]]:
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


def _mark_legend(axes: Axes, verdict: Verdict, channel: Channel, part: slice, alarms: list[tuple[float, str]]) -> None:
    """Name the lines and the rug in one legend above the panel."""
    named = list(zip(*axes.get_legend_handles_labels(), strict=True))
    handles = [handle for handle, _ in named]
    for mark, colour, style, name in _moments(verdict):
        block = "" if mark.block is None else f" (block {mark.block:,})"
        handles += axes.plot([], [], color=colour, linestyle=style, linewidth=1.2, label=f"{name}{block}")
    for marker, colour, name, rows in _rugs(channel, part):
        handles += axes.plot([], [], marker, color=colour, markersize=5, label=f"{name} ({rows.size:,})")
    for severity, colour in (("alert", ORANGE), ("danger", VERMILION)):
        raised = sum(said == severity for _, said in alarms)
        if raised:
            handles += axes.plot([], [], "v", color=colour, markersize=5, label=f"{severity} raised ({raised})")
    if handles:
        axes.legend(handles=handles, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4, borderaxespad=0.2)


def _rugs(channel: Channel, part: slice) -> list[tuple[str, str, str, NDArray[np.intp]]]:
    """Return marker, colour, name and rows of the blocks that were rejected and of those that were flagged."""
    status = channel.status[part]
    rejected = np.isin(status.astype(str), REJECTIONS)
    flagged = (status != "ok") & ~rejected
    return [
        (marker, colour, name, np.flatnonzero(rows))
        for marker, colour, name, rows in (("x", VERMILION, "rejected", rejected), ("|", ORANGE, "flagged", flagged))
        if rows.any()
    ]


def _rug(axes: Axes, axis: TimeAxis, time: NDArray[np.float64], channel: Channel, part: slice) -> None:
    for marker, colour, _, rows in _rugs(channel, part):
        x, _ = thin(time[rows], np.zeros(rows.size), 300)
        y = np.full(x.size, 0.03)
        axes.plot(axis.position(x), y, marker, color=colour, markersize=5, transform=axes.get_xaxis_transform())
