"""Figures of the damaged volume: as tracked with its interval and the truth, and with the law fitted to it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from monitor.report.figures.drawing import (
    BLUE,
    GREEN,
    GREY,
    INK,
    ORANGE,
    PURPLE,
    SKY,
    STYLE,
    Picture,
    TimeAxis,
    draw_line,
    legend_above,
    new_figure,
    time_axis,
    to_svg,
)
from monitor.report.figures.trends import draw_marks, zoom_marks
from monitor.report.figures.zoom import Band, Line, Panel, zoom_data
from monitor.report.runs import Channel
from monitor.report.score.issued import running_time
from monitor.report.verdict import ChannelContext, interval_name, unscaled
from monitor.words.numbers import Clock, figure, volume

ENDS = ("lower", "upper")
_LAWS = (0.25, 0.5, 0.75, 1.0)
"""Shares of the issued fits after which the law is drawn."""


def final_part(channel: Channel) -> slice | None:
    """Return the rows from a little before the first V_eq to a little after the last, None without two values."""
    v_eq = channel.column("v_eq")
    rows = np.flatnonzero(np.isfinite(v_eq))
    if rows.size < 2 or channel.time[rows[-1]] <= channel.time[rows[0]]:
        return None
    lead = max(2, int(rows[-1] - rows[0]) // 12)
    return slice(max(0, int(rows[0]) - lead), min(v_eq.size, int(rows[-1]) + lead + 1))


def part_axis(channel: Channel, part: slice, clock: Clock) -> TimeAxis:
    """Return the axis of a part of a life; undated, it has the unit of the whole life."""
    return time_axis(channel.time if not clock.dated else channel.time[part], clock)


@mpl.rc_context(STYLE)
def damaged_volume(context: ChannelContext) -> Picture | None:
    """Draw V_eq with its interval, its thresholds and, of a simulated rig, the truth (thesis, Figs. 62 and 64).

    None where fewer than two blocks have a value.
    """
    run, channel = context.run, context.channel
    part = final_part(channel)
    if part is None:
        return None
    time, axis = channel.time[part], part_axis(channel, part, context.clock)
    thresholds = thresholds_of(channel)
    made, (axes,) = new_figure(3.3)
    ends = [1e6 * channel.column(f"v_eq_{end}")[part] for end in ENDS]
    draw_interval(axes, axis, time, ends, interval_name(run))
    found, truth = 1e6 * channel.column("v_eq")[part], 1e6 * channel.column("v_eq_true")[part]
    draw_line(axes, axis, time, found, color=BLUE, label="tracked")
    if np.isfinite(truth).any():
        draw_line(axes, axis, time, truth, color=GREEN, linestyle="--", label="true")
    for place, threshold in enumerate(thresholds):
        name = "threshold" if place == 0 else None
        axes.axhline(1e6 * threshold, color=ORANGE, linewidth=1.1, linestyle="-.", label=name)
    draw_marks(axes, axis, context.verdict)
    axes.set_ylim(bottom=0.0)
    axes.set_ylabel("V_eq (mm³/mm)")
    axes.set_xlim(float(axis.position(time[0])), float(axis.position(time[-1])))
    axis.settle(axes)
    legend_above(axes)
    data = {"time_s": time, "v_eq_mm2": found, "v_eq_true_mm2": truth, "thresholds_mm2": [1e6 * t for t in thresholds]}
    data |= {f"v_eq_{end}_mm2": values for end, values in zip(ENDS, ends, strict=True)}
    label = f"Equivalent damaged volume of channel {channel.name} over the final stage."
    caption = _volume_caption(channel, part, thresholds, truth) + unscaled(run)
    lines = [Line("tracked", BLUE, found), Line("true", GREEN, truth, "dashed")]
    levels = [("threshold", ORANGE, 1e6 * threshold) for threshold in thresholds]
    chart = Panel(axes, lines, [Band(interval_name(run), SKY, *ends)], levels)
    zoom = zoom_data(axis, time, [chart], marks=zoom_marks(context.verdict))
    return Picture("Damaged volume", to_svg(made, label, context.numbers), caption, known_columns(data), "damage", zoom)


def _volume_caption(channel: Channel, part: slice, thresholds: Sequence[float], truth: NDArray[np.float64]) -> str:
    values = channel.column("v_eq")[part]
    finite = values[np.isfinite(values)]
    words = [f"V_eq from {volume(float(finite[0]))} to {volume(float(finite[-1]))}, block by block as recorded."]
    if np.isfinite(channel.column("v_eq_lower")[part]).any():
        words.append("The band is the interval, the line its median.")
    if len(thresholds):
        crossed = finite[-1] >= thresholds[0]
        words.append(f"The threshold of {volume(thresholds[0])} is {'reached' if crossed else 'not reached'}.")
    both = np.isfinite(truth) & np.isfinite(values) & (truth > 0)
    if both.any():
        ratio = float(np.exp(np.median(np.log(np.maximum(1e6 * values[both], 1e-9) / truth[both]))))
        words.append(f"Its median ratio to the truth is {figure(ratio, 2)}.")
    return " ".join(words)


@mpl.rc_context(STYLE)
def fitted_law(context: ChannelContext) -> Picture | None:
    """Draw V_eq with the quadratic law of the thesis' forecast as fitted at four moments (thesis, Fig. 65).

    None where no law was fitted.
    """
    channel, t_fs = context.channel, context.verdict.t_fs
    part = final_part(channel)
    if part is None or t_fs is None or not math.isfinite(t_fs.time):
        return None
    coefficients = channel.numbers["tt_coefficients"][:, :3]
    issued = np.flatnonzero(np.isfinite(coefficients).all(axis=1)) if coefficients.shape[1] == 3 else np.array([])
    if not issued.size:
        return None
    axis = part_axis(channel, part, context.clock)
    damage = running_time(channel)
    onset = float(np.interp(t_fs.time, channel.time, damage))
    made, (axes,) = new_figure(3.3)
    points = np.isfinite(channel.column("v_eq"))
    axes.plot(axis.position(channel.time[points]), 1e6 * channel.column("v_eq")[points], ".", color=GREY, label="V_eq")
    thresholds = thresholds_of(channel)
    if len(thresholds):
        axes.axhline(1e6 * thresholds[0], color=ORANGE, linewidth=1.1, linestyle="-.", label="threshold")
    data: dict[str, Any] = {
        "time_s": channel.time[points],
        "v_eq_mm2": 1e6 * channel.column("v_eq")[points],
        "laws": [],
    }
    colours, styles = (SKY, PURPLE, BLUE, INK), (":", "--", "-.", "-")
    last_places = dict.fromkeys(int(issued[max(0, math.ceil(share * issued.size) - 1)]) for share in _LAWS)
    for row, colour, style in zip(last_places, colours[-len(last_places) :], styles[-len(last_places) :], strict=True):
        a, b, c = coefficients[row]
        tau = damage - onset
        later = np.flatnonzero(tau >= 0.0)
        law = np.where(tau >= 0, a * tau**2 + b * tau + c, np.nan)
        name = f"law after block {channel.sequence[row]:,}"
        axes.plot(axis.position(channel.time[later]), 1e6 * law[later], color=colour, linestyle=style, label=name)
        data["laws"].append({"block": int(channel.sequence[row]), "coefficients_si": [float(a), float(b), float(c)]})
    top = 1e6 * max(float(np.nanmax(channel.column("v_eq"))), *(thresholds or (0.0,)))
    axes.set_ylim(0.0, 1.15 * top)
    axes.set_xlim(float(axis.position(channel.time[part][0])), float(axis.position(channel.time[part][-1])))
    axes.set_ylabel("V_eq (mm³/mm)")
    axis.settle(axes)
    legend_above(axes)
    r2 = channel.numbers["r_squared"][issued[-1], 0]
    caption = (
        "V_eq = a τ² + b τ + c, τ the damage time since t_fs, refitted after each block; drawn as it stood at a "
        f"quarter, half, three quarters and the last of {issued.size:,} fits."
        + (f" R² of the last is {r2:.3f}." if math.isfinite(r2) else "")
    )
    label = f"V_eq of channel {channel.name} with the quadratic law fitted to it."
    svg = to_svg(made, label, context.numbers)
    return Picture("The fitted law", svg, caption + unscaled(context.run), data, "law")


def thresholds_of(channel: Channel) -> list[float]:
    """Return the thresholds of V_eq as last recorded, m2."""
    values = channel.numbers["v_th"]
    rows = np.flatnonzero(np.isfinite(values).any(axis=1))
    return [float(value) for value in values[rows[-1]] if math.isfinite(value)] if rows.size else []


def draw_interval(
    axes: Axes, axis: TimeAxis, time: NDArray[np.float64], ends: Sequence[NDArray[np.float64]], name: str
) -> None:
    """Draw an interval over time; a single one between two gaps is a bar."""
    lower, upper = ends
    if not np.isfinite(lower).any():
        return
    axes.fill_between(axis.position(time), lower, upper, color=SKY, alpha=0.3, linewidth=0, label=name)
    there = np.concatenate([[False], np.isfinite(lower), [False]])
    alone = there[1:-1] & ~there[:-2] & ~there[2:]
    if alone.any():
        axes.vlines(axis.position(time[alone]), lower[alone], upper[alone], color=SKY, alpha=0.6, linewidth=1.5)


def known_columns(data: dict[str, Any]) -> dict[str, Any]:
    """Return data without columns that hold no value."""
    return {k: v for k, v in data.items() if not isinstance(v, np.ndarray) or np.isfinite(v).any()}
