"""Figure of the speeds of the shaft over a run: mean, least and highest of each block."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
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
from monitor.report.runs import Channel, Run
from monitor.report.tables import Column, Table
from monitor.words.numbers import Clock, count, figure
from monitor.words.statuses import DOMAINS, ROTATION_REFUSALS


@dataclass(frozen=True, eq=False)
class SpeedCourse:
    """The speeds of channels whose blocks have the same ones; Hz, shape (block,).

    Attributes:
        channels: names, joined.
        low, high: NaN where only the mean is known.
        status: ``rotation_status``, "" where there is no source of an angle.
        orders: whether the spectra are over orders.
    """

    channels: str
    channel: Channel
    mean: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    status: NDArray[np.object_]
    orders: NDArray[np.bool_]


def speed_courses(run: Run) -> list[SpeedCourse]:
    """Return the speeds of the channels of a run for whose blocks an angle was sought; equal ones once."""
    found: dict[bytes, SpeedCourse] = {}
    for channel in run.channels.values():
        status = channel.word("rotation_status")
        if not (status != "").any():
            continue
        mean, low, high = (channel.column(name) for name in ("speed", "speed_min", "speed_max"))
        key = b"".join(values.tobytes() for values in (channel.time, mean, low, high))
        orders = np.asarray(channel.word("domain") == "order", dtype=np.bool_)
        names = f"{found[key].channels}, {channel.name}" if key in found else channel.name
        found[key] = SpeedCourse(names, channel, mean, low, high, status, orders)
    return list(found.values())


def speed_words(run: Run) -> list[str]:
    """Return a sentence on the speeds and the spectra of each course."""
    return [_sentence(course) for course in speed_courses(run)]


def _sentence(course: SpeedCourse) -> str:
    sought = course.status != ""
    share = float(np.mean(course.orders[sought]))
    texts = [f"{course.channels}: {DOMAINS['order']} in {share:.0%} of {count(int(sought.sum()), 'block')}"]
    spans = (course.high - course.low)[np.isfinite(course.low)]
    if spans.size:
        middle = float(np.median(spans / course.mean[np.isfinite(course.low)]))
        least, highest = figure(float(np.nanmin(course.low))), figure(float(np.nanmax(course.high)))
        texts.append(
            f"speed from {least} to {highest} Hz; within a block by {100.0 * middle:.2g} % of its mean (median)"
        )
    return "; ".join(texts) + "."


def rotation_table(run: Run) -> Table | None:
    """Return blocks by status of the angle and domain of the spectra; None without a source of an angle."""
    rows: list[tuple[str, str, int, str, str]] = []
    for course in speed_courses(run):
        for status in dict.fromkeys(course.status.astype(str).tolist()):
            if not status:
                continue
            for orders in (True, False):
                places = np.flatnonzero((course.status == status) & (course.orders == orders))
                if places.size:
                    meaning = "the angle is known" if status == "ok" else ROTATION_REFUSALS.get(status, status)
                    domain = DOMAINS["order" if orders else "hertz"]
                    first = f"block {course.channel.sequence[places[0]]:,}"
                    rows.append((course.channels, status, int(places.size), f"{meaning}; {domain}", first))
    if not rows:
        return None
    columns = (
        Column("channels", "channels"),
        Column("status", "angle"),
        Column("blocks", "blocks", "1"),
        Column("meaning", "meaning"),
        Column("first", "first such block"),
    )
    return Table("rotation", "Angle of the shaft", columns, rows)


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
