"""Figures of the final stage: V_eq as tracked, the law fitted to it, and the time to threshold as issued."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
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
    draw_rug,
    isolated,
    legend_above,
    new_figure,
    thin,
    time_axis,
    to_svg,
    unit_of,
)
from monitor.report.figures.trends import draw_marks, zoom_marks
from monitor.report.figures.zoom import Band, Line, Panel, zoom_data
from monitor.report.readings import VolumeScale, unscaled
from monitor.report.runs import Channel
from monitor.report.score.forecasts import running_time
from monitor.report.score.scoring import ALPHA
from monitor.report.verdict import ChannelContext, interval_name
from monitor.words.numbers import count, figure, volume
from monitor.words.statuses import TT_REFUSALS

Values = NDArray[np.float64]

_ENDS = ("lower", "upper")
_LAWS = (0.25, 0.5, 0.75, 1.0)
"""Shares of the issued fits after which the law is drawn."""
_CONE = f"±{100 * ALPHA:.0f} %"
_MAX_THRESHOLDS = 4
_SILENT = ("", "ok", "not_final_stage", "already_crossed")
"""Statuses that are no refusal of a forecast."""


def _final_part(channel: Channel) -> slice | None:
    """Return the rows from a little before the first V_eq to a little after the last, None without two values."""
    v_eq = channel.column("v_eq")
    rows = np.flatnonzero(np.isfinite(v_eq))
    if rows.size < 2 or channel.time[rows[-1]] <= channel.time[rows[0]]:
        return None
    lead = max(2, int(rows[-1] - rows[0]) // 12)
    return slice(max(0, int(rows[0]) - lead), min(v_eq.size, int(rows[-1]) + lead + 1))


def thresholds_of(channel: Channel) -> list[float]:
    """Return the thresholds of V_eq as last recorded, m2."""
    values = channel.numbers["v_th"]
    rows = np.flatnonzero(np.isfinite(values).any(axis=1))
    return [float(value) for value in values[rows[-1]] if math.isfinite(value)] if rows.size else []


@mpl.rc_context(STYLE)
def damaged_volume(context: ChannelContext) -> Picture | None:
    """Draw V_eq with its interval, its thresholds and, of a simulated rig, the truth (thesis, Figs. 62 and 64).

    None where fewer than two blocks have a value.
    """
    run, channel = context.run, context.channel
    part = _final_part(channel)
    if part is None:
        return None
    time, axis, scale = channel.time[part], time_axis(channel.time, context.clock), VolumeScale.of(run, channel)
    thresholds = [1e6 * threshold for threshold in thresholds_of(channel)] if scale.absolute else []
    made, (axes,) = new_figure(3.3)
    ends = [scale.scaled(channel.column(f"v_eq_{end}")[part]) for end in _ENDS]
    _draw_interval(axes, axis, time, ends, interval_name(run))
    found, truth = scale.scaled(channel.column("v_eq")[part]), 1e6 * channel.column("v_eq_true")[part]
    if not scale.absolute:
        truth = np.full_like(truth, np.nan)
    draw_line(axes, axis, time, found, color=BLUE, label="tracked")
    draw_line(axes, axis, time, truth, color=GREEN, linestyle="--", label="true")
    _draw_thresholds(axes, thresholds)
    draw_marks(axes, axis, context.verdict)
    axes.set_ylim(bottom=0.0)
    axes.set_ylabel(f"V_eq ({scale.unit})")
    axis.settle(axes, time[0], time[-1])
    legend_above(axes)
    unit = "mm2" if scale.absolute else "relative"
    data = {"time_s": time, f"v_eq_{unit}": found, "v_eq_true_mm2": truth, "thresholds_mm2": thresholds}
    data |= {f"v_eq_{end}_{unit}": values for end, values in zip(_ENDS, ends, strict=True)}
    label = f"Equivalent damaged volume of channel {channel.name} over the final stage."
    caption = _volume_caption(channel, part, truth, scale) + unscaled(run, channel)
    lines = [Line("tracked", BLUE, found), Line("true", GREEN, truth, "dashed")]
    levels = [("threshold", ORANGE, threshold) for threshold in thresholds]
    chart = Panel(axes, lines, [Band(interval_name(run), SKY, *ends)], levels)
    zoom = zoom_data(axis, time, [chart], marks=zoom_marks(context.verdict))
    return Picture("Damaged volume", to_svg(made, label, context.numbers), caption, _known(data), "damage", zoom)


def _draw_thresholds(axes: Axes, thresholds: Sequence[float]) -> None:
    for place, threshold in enumerate(thresholds):
        name = "threshold" if place == 0 else None
        axes.axhline(threshold, color=ORANGE, linewidth=1.1, linestyle="-.", label=name)


def _volume_caption(channel: Channel, part: slice, truth: Values, scale: VolumeScale) -> str:
    """Return the caption of V_eq; ``truth`` is in mm2."""
    values, thresholds = channel.column("v_eq")[part], thresholds_of(channel) if scale.absolute else []
    finite = values[np.isfinite(values)]
    first, last = (scale.write(float(value)) for value in (finite[0], finite[-1]))
    words = [f"V_eq from {first} to {last}, block by block as recorded."]
    if np.isfinite(channel.column("v_eq_lower")[part]).any():
        words.append("The band is the interval, the line its median.")
    if thresholds:
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
    part, rows = _final_part(channel), channel.fitted_rows()
    if part is None or t_fs is None or not math.isfinite(t_fs.time) or not rows.size:
        return None
    axis = time_axis(channel.time, context.clock)
    made, (axes,) = new_figure(3.3)
    points = np.isfinite(channel.column("v_eq"))
    time, v_eq = channel.time[points], 1e6 * channel.column("v_eq")[points]
    axes.plot(axis.position(time), v_eq, ".", color=GREY, label="V_eq")
    thresholds = [1e6 * threshold for threshold in thresholds_of(channel)]
    _draw_thresholds(axes, thresholds[:1])
    damage = running_time(channel)
    tau = damage - float(np.interp(t_fs.time, channel.time, damage))
    later = tau >= 0.0
    laws: list[dict[str, Any]] = []
    looks = ((SKY, ":"), (PURPLE, "--"), (BLUE, "-."), (INK, "-"))
    last_rows = dict.fromkeys(int(rows[max(0, math.ceil(share * rows.size) - 1)]) for share in _LAWS)
    for row, (colour, style) in zip(last_rows, looks[-len(last_rows) :], strict=True):
        a, b, c = channel.numbers["tt_coefficients"][row, :3]
        law = 1e6 * (a * tau**2 + b * tau + c)[later]
        name = f"law after block {channel.sequence[row]:,}"
        axes.plot(axis.position(channel.time[later]), law, color=colour, linestyle=style, label=name)
        laws.append({"block": int(channel.sequence[row]), "coefficients_si": [float(a), float(b), float(c)]})
    axes.set_ylim(0.0, 1.15 * max(float(v_eq.max()), *thresholds))
    axes.set_ylabel("V_eq (mm³/mm)")
    axis.settle(axes, channel.time[part][0], channel.time[part][-1])
    legend_above(axes)
    r2 = channel.column("r_squared")[rows[-1]]
    caption = (
        "V_eq = a τ² + b τ + c, τ the damage time since t_fs, refitted after each block; drawn as it stood at a "
        f"quarter, half, three quarters and the last of {rows.size:,} fits."
        + (f" R² of the last is {r2:.3f}." if math.isfinite(r2) else "")
    )
    label = f"V_eq of channel {channel.name} with the quadratic law fitted to it."
    data = {"time_s": time, "v_eq_mm2": v_eq, "laws": laws}
    svg = to_svg(made, label, context.numbers)
    return Picture("The fitted law", svg, caption + unscaled(context.run, channel), data, "law")


def forecasts(context: ChannelContext) -> list[Picture]:
    """Draw the forecasts of each threshold that has any (thesis, Figs. 66 and 67), of four thresholds at most."""
    part = _final_part(context.channel)
    if part is None:
        return []
    places = range(min(_MAX_THRESHOLDS, context.channel.numbers["tt"].shape[1]))
    drawn = [_forecast(context, part, place) for place in places]
    return [picture for picture in drawn if picture is not None]


def _truth_of(channel: Channel, part: slice, place: int) -> tuple[Values, str]:
    """Return the true time to a threshold (s) and its source: "true" (simulated rig), "tracked" or "" for none.

    "tracked": t_th - t, where the tracked V_eq crossed the threshold (thesis, Eq. 92).
    """
    truth = channel.column("tt_true", place)[part]
    if np.isfinite(truth).any():
        return truth, "true"
    damage, v_eq = running_time(channel)[part], channel.column("v_eq")[part]
    thresholds = thresholds_of(channel)
    above = np.flatnonzero(v_eq >= thresholds[place]) if place < len(thresholds) else np.array([])
    if not above.size:
        return np.full(damage.size, np.nan), ""
    left = damage[above[0]] - damage
    return np.where(left >= 0.0, left, np.nan), "tracked"


@mpl.rc_context(STYLE)
def _forecast(context: ChannelContext, part: slice, place: int) -> Picture | None:
    run, channel = context.run, context.channel
    tt = channel.column("tt", place)[part]
    if not np.isfinite(tt).any():
        return None
    time, axis = channel.time[part], time_axis(channel.time, context.clock)
    truth, kind = _truth_of(channel, part, place)
    ends = [channel.column(f"tt_{end}", place)[part] for end in _ENDS]
    top = _scale_top(tt, truth)
    unit, name = unit_of(top)
    cone = Band(_CONE, GREEN, (1 - ALPHA) * truth / unit, (1 + ALPHA) * truth / unit)
    issued = Band(interval_name(run), SKY, ends[0] / unit, ends[1] / unit)
    against = Line("true" if kind == "true" else "until the tracked V_eq crossed", GREEN, truth / unit, "dashed")
    made, (axes,) = new_figure(3.6)
    if kind:
        x = axis.position(time)
        axes.fill_between(x, cone.lower, cone.upper, color=GREEN, alpha=0.16, linewidth=0, label=_CONE)
        axes.plot(x, against.values, color=GREEN, linestyle="--", label=against.label)
    _draw_interval(axes, axis, time, (issued.lower, issued.upper), issued.label)
    _draw_issued(axes, axis, time, tt / unit, top / unit)
    statuses = channel.words["tt_status"][part, place]
    statuses = np.where((statuses == "uncalibrated") & np.isfinite(tt), "ok", statuses)
    refused = _draw_refusals(axes, axis, time, statuses)
    draw_marks(axes, axis, context.verdict)
    axes.set_ylim(0.0, top / unit)
    axes.set_ylabel(f"time to threshold ({name})")
    axis.settle(axes, time[0], time[-1])
    legend_above(axes)
    of = "".join(f" of {volume(threshold)}" for threshold in thresholds_of(channel)[place : place + 1])
    label = f"Time to the threshold{of} on channel {channel.name}, as issued."
    data = {"time_s": time, "tt_s": tt, "tt_lower_s": ends[0], "tt_upper_s": ends[1], "truth_s": truth, "truth": kind}
    caption = _forecast_caption(tt, truth, ends, kind, refused) + unscaled(run, channel)
    chart = Panel(axes, [against, Line("as issued", BLUE, tt / unit, "dots")], [cone, issued], top=top / unit)
    zoom = zoom_data(axis, time, [chart], marks=zoom_marks(context.verdict))
    svg = to_svg(made, label, context.numbers)
    return Picture(f"Time to the threshold{of}", svg, caption, _known(data), "forecast", zoom)


def _scale_top(tt: Values, truth: Values) -> float:
    """Return the end of the scale: of the truth, or of most of the forecasts, since early fits may be far off."""
    known = np.isfinite(truth)
    expected = truth[known & np.isfinite(tt)] if (known & np.isfinite(tt)).any() else truth[known]
    top = 2.0 * float(expected.max()) if expected.size else float(np.nanpercentile(tt, 90)) * 1.15
    return max(min(top, 1.08 * float(np.nanmax(tt))), 1.08 * float(expected.max()) if expected.size else 0.0) or 1.0


def _draw_interval(axes: Axes, axis: TimeAxis, time: Values, ends: Sequence[Values], name: str) -> None:
    """Draw an interval over time; a single one between two gaps is a bar."""
    lower, upper = ends
    if not np.isfinite(lower).any():
        return
    axes.fill_between(axis.position(time), lower, upper, color=SKY, alpha=0.3, linewidth=0, label=name)
    alone = isolated(lower)
    if alone.any():
        axes.vlines(axis.position(time[alone]), lower[alone], upper[alone], color=SKY, alpha=0.6, linewidth=1.5)


def _draw_issued(axes: Axes, axis: TimeAxis, time: Values, tt: Values, top: float) -> None:
    x, y = thin(time, np.where(tt <= top, tt, np.nan), 400)
    axes.plot(axis.position(x), y, ".", color=BLUE, markersize=4, label="as issued")
    above = tt > top
    if above.any():
        style: dict[str, Any] = {"markersize": 5, "markerfacecolor": "none", "markeredgecolor": BLUE}
        label = f"beyond the scale ({int(above.sum()):,} issued)"
        draw_rug(axes, axis, time[above], 0.97 * top, "^", 60, label=label, **style)


def _draw_refusals(axes: Axes, axis: TimeAxis, time: Values, statuses: NDArray[np.object_]) -> dict[str, int]:
    """Draw a stroke at the bottom for each block without a forecast; return their number by reason."""
    refused = ~np.isin(statuses.astype(str), _SILENT)
    if refused.any():
        label = f"no forecast ({int(refused.sum()):,})"
        style: dict[str, Any] = {"color": ORANGE, "markersize": 5, "transform": axes.get_xaxis_transform()}
        draw_rug(axes, axis, time[refused], 0.02, "|", 200, label=label, **style)
    names, numbers = np.unique(statuses[refused].astype(str), return_counts=True)
    return {str(name): int(number) for name, number in zip(names, numbers, strict=True)}


def _forecast_caption(tt: Values, truth: Values, ends: Sequence[Values], kind: str, refused: Mapping[str, int]) -> str:
    words = ["Every forecast stands where it was issued, with what was known then."]
    both = np.isfinite(tt) & np.isfinite(truth) & (truth > 0)
    if both.any():
        inside = np.abs(tt[both] - truth[both]) <= ALPHA * truth[both]
        against = (
            "the truth" if kind == "true" else "what the tracked V_eq did, which judges a forecast by its own values"
        )
        words.append(f"{inside.mean():.0%} of {both.sum():,} lie within 20 % of {against} (the cone).")
        covered = both & np.isfinite(ends[0]) & np.isfinite(ends[1])
        if covered.any():
            share = np.mean((ends[0][covered] <= truth[covered]) & (truth[covered] <= ends[1][covered]))
            words.append(f"The interval holds it {share:.0%} of the time.")
    for status, number in sorted(refused.items(), key=lambda item: -item[1]):
        words.append(f"{count(number, 'block')} without: {TT_REFUSALS.get(status, status)}.")
    return " ".join(words)


def _known(data: Mapping[str, Any]) -> dict[str, Any]:
    """Return data without columns that hold no value."""
    return {k: v for k, v in data.items() if not isinstance(v, np.ndarray) or np.isfinite(v).any()}
