"""Figure of the speeds of the shaft over a run: mean, least and highest of each block."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from monitor.report.figures.drawing import (
    BLUE,
    GREY,
    ORANGE,
    STYLE,
    VERMILION,
    Picture,
    TimeAxis,
    draw_line,
    draw_rug,
    legend_above,
    new_figure,
    time_axis,
    to_svg,
)
from monitor.report.figures.zoom import Band, Line, Panel, zoom_data
from monitor.report.runs import Run
from monitor.report.speed import SpeedCourse, speed_courses, speed_words
from monitor.words.numbers import Clock

_COLOURS = (BLUE, ORANGE, GREY)
_BINS = 400
_MEAN, _RANGE, _LEVEL = "mean of the block", "from least to highest", "RMS / expected"


@mpl.rc_context(STYLE)
def speed_picture(run: Run, clock: Clock, numbers: itertools.count[int]) -> Picture | None:
    """Draw the speeds over time, and RMS over the expected one where that was learned.

    None where no angle was found in two blocks.
    """
    courses = [course for course in speed_courses(run) if np.isfinite(course.low).sum() > 1]
    courses = [course for course in courses if np.ptp(course.channel.time) > 0.0]
    if not courses:
        return None
    axis = time_axis(np.concatenate([course.channel.time for course in courses]), clock)
    levelled = [course for course in courses if np.isfinite(course.channel.column("level_rms")).any()]
    made, panels = new_figure(4.4 if levelled else 2.9, (1.5, 1.0) if levelled else (1.0,))
    _draw_speeds(panels[0], axis, courses)
    data: dict[str, Any] = {course.channels: _data(course) for course in courses}
    for course, colour in zip(levelled, itertools.cycle(_COLOURS), strict=False):
        draw_line(panels[1], axis, course.channel.time, course.channel.column("level_rms"), color=colour)
        panels[1].set_ylabel(_LEVEL)
    if levelled:
        panels[1].axhline(1.0, color=GREY, linewidth=0.9, linestyle=(0, (6, 3)))
    times = np.concatenate([course.channel.time for course in courses])
    axis.settle(panels[-1], float(times.min()), float(times.max()))
    caption = "Least, mean and highest speed of the shaft in each block. " + " ".join(speed_words(run))
    if levelled:
        caption += " Below: RMS over what its learned dependence on speed and load gives."
    zoom = _zoomed(courses[0], axis, panels) if len(courses) == 1 else {}
    label = f"Speed of the shaft of machine {run.machine} over time."
    return Picture("Speed of the shaft", to_svg(made, label, numbers), caption, data, "speed", zoom)


def _draw_speeds(axes: Axes, axis: TimeAxis, courses: Sequence[SpeedCourse]) -> None:
    for course, colour in zip(courses, itertools.cycle(_COLOURS), strict=False):
        name = f", {course.channels}" if len(courses) > 1 else ""
        x, low, high = _extremes(course.channel.time, course.low, course.high)
        style: dict[str, Any] = {"color": colour, "alpha": 0.25, "linewidth": 0.0}
        axes.fill_between(np.asarray(axis.position(x)), low, high, label=f"{_RANGE}{name}", **style)
        draw_line(axes, axis, course.channel.time, course.mean, color=colour, linewidth=1.0, label=f"{_MEAN}{name}")
        refused = np.flatnonzero((course.status != "") & (course.status != "ok"))
        if refused.size:
            where: dict[str, Any] = {"transform": axes.get_xaxis_transform(), "markersize": 5}
            name = f"no angle ({refused.size:,})"
            draw_rug(axes, axis, course.channel.time[refused], 0.04, "x", 300, color=VERMILION, label=name, **where)
    low = min(float(np.nanmin(course.low)) for course in courses)
    high = max(float(np.nanmax(course.high)) for course in courses)
    room = max(0.12 * (high - low), 0.02 * high)
    axes.set_ylim(low - room, high + room)
    axes.set_ylabel("speed (Hz)")
    legend_above(axes)


def _extremes(time: NDArray[np.float64], low: NDArray[np.float64], high: NDArray[np.float64]) -> Sequence[Any]:
    """Return the least and the highest value of each of many columns, with their times."""
    if time.size <= _BINS:
        return time, low, high
    starts = np.unique(np.linspace(0, time.size, _BINS, endpoint=False).astype(np.intp))
    return time[starts], np.fmin.reduceat(low, starts), np.fmax.reduceat(high, starts)


def _data(course: SpeedCourse) -> dict[str, Any]:
    time, low, high = _extremes(course.channel.time, course.low, course.high)
    _, least, most = _extremes(course.channel.time, course.mean, course.mean)
    return {"time_s": time, "speed_min_hz": low, "speed_max_hz": high, "mean_least_hz": least, "mean_highest_hz": most}


def _zoomed(course: SpeedCourse, axis: TimeAxis, panels: Sequence[Axes]) -> dict[str, Any]:
    band = Band(_RANGE, BLUE, course.low, course.high)
    charts = [Panel(panels[0], [Line(_MEAN, BLUE, course.mean)], [band])]
    if len(panels) > 1:
        level = Line(_LEVEL, BLUE, course.channel.column("level_rms"))
        charts.append(Panel(panels[1], [level], levels=[("as learned", GREY, 1.0)]))
    return zoom_data(axis, course.channel.time, charts)
