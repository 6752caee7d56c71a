"""Figures of the time to threshold: every forecast when it was issued, beside the true time."""

from __future__ import annotations

from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from monitor.report.figures.damage import ENDS, draw_interval, final_part, known_columns, part_axis, thresholds_of
from monitor.report.figures.drawing import (
    BLUE,
    GREEN,
    ORANGE,
    SKY,
    STYLE,
    Picture,
    TimeAxis,
    legend_above,
    new_figure,
    thin,
    to_svg,
    unit_of,
)
from monitor.report.figures.trends import draw_marks, zoom_marks
from monitor.report.figures.zoom import Band, Line, Panel, zoom_data
from monitor.report.runs import Channel
from monitor.report.score.issued import running_time
from monitor.report.verdict import ChannelContext, interval_name, unscaled
from monitor.words.numbers import count, volume
from monitor.words.statuses import TT_REFUSALS

ALPHA = 0.2
"""Half-width of the cone as a share of the true time left (Saxena et al., IJPHM 1(1), 2010)."""
_MAX_THRESHOLDS = 4
_SILENT = ("", "ok", "not_final_stage", "already_crossed")


def forecasts(context: ChannelContext) -> list[Picture]:
    """Draw the forecasts of each threshold that has any (thesis, Figs. 66 and 67), of four thresholds at most."""
    part = final_part(context.channel)
    if part is None:
        return []
    places = range(min(_MAX_THRESHOLDS, context.channel.numbers["tt"].shape[1]))
    drawn = [_forecast(context, part, place) for place in places]
    return [picture for picture in drawn if picture is not None]


def truth_of(channel: Channel, part: slice, place: int) -> tuple[NDArray[np.float64], str]:
    """Return the true time to a threshold (s) and its source: "true" (simulated rig), "tracked" or "" for none.

    "tracked": t_th - t, where the tracked V_eq crossed the threshold (thesis, Eq. 92).
    """
    truth = channel.column("tt_true", place)[part]
    if np.isfinite(truth).any():
        return truth, "true"
    thresholds = thresholds_of(channel)
    nothing = np.full(channel.time[part].size, np.nan)
    if place >= len(thresholds):
        return nothing, ""
    damage, v_eq = running_time(channel)[part], channel.column("v_eq")[part]
    above = np.flatnonzero(v_eq >= thresholds[place])
    if not above.size:
        return nothing, ""
    left = damage[above[0]] - damage
    return np.where(left >= 0.0, left, np.nan), "tracked"


@mpl.rc_context(STYLE)
def _forecast(context: ChannelContext, part: slice, place: int) -> Picture | None:
    run, channel = context.run, context.channel
    tt = channel.column("tt", place)[part]
    if not np.isfinite(tt).any():
        return None
    time, axis = channel.time[part], part_axis(channel, part, context.clock)
    truth, kind = truth_of(channel, part, place)
    known = np.isfinite(truth)
    expected = truth[known & np.isfinite(tt)] if (known & np.isfinite(tt)).any() else truth[known]
    # Early fits may be far off; the scale is that of the truth, or of most of the forecasts.
    top = 2.0 * float(expected.max()) if expected.size else float(np.nanpercentile(tt, 90)) * 1.15
    top = max(min(top, 1.08 * float(np.nanmax(tt))), 1.08 * float(expected.max()) if expected.size else 0.0) or 1.0
    unit, name = unit_of(top)
    made, (axes,) = new_figure(3.6)
    if kind:
        _cone(axes, axis, time, truth / unit, kind)
    ends = [channel.column(f"tt_{end}", place)[part] for end in ENDS]
    draw_interval(axes, axis, time, [values / unit for values in ends], interval_name(run))
    _points(axes, axis, time, tt, top, unit)
    refused = _refusals(axes, axis, time, channel.words["tt_status"][part, place])
    draw_marks(axes, axis, context.verdict)
    axes.set_ylim(0.0, top / unit)
    axes.set_xlim(float(axis.position(time[0])), float(axis.position(time[-1])))
    axes.set_ylabel(f"time to threshold ({name})")
    axis.settle(axes)
    legend_above(axes)
    thresholds = thresholds_of(channel)
    of = f" of {volume(thresholds[place])}" if place < len(thresholds) else ""
    label = f"Time to the threshold{of} on channel {channel.name}, as issued."
    data = {"time_s": time, "tt_s": tt, "tt_lower_s": ends[0], "tt_upper_s": ends[1], "truth_s": truth, "truth": kind}
    caption = _caption(tt, truth, ends, kind, refused) + unscaled(run)
    cone = Band("±20 %", GREEN, (1 - ALPHA) * truth / unit, (1 + ALPHA) * truth / unit)
    issued = Band(interval_name(run), SKY, ends[0] / unit, ends[1] / unit)
    against = Line("true" if kind == "true" else "until the tracked V_eq crossed", GREEN, truth / unit, "dashed")
    chart = Panel(axes, [against, Line("as issued", BLUE, tt / unit, "dots")], [cone, issued], top=top / unit)
    zoom = zoom_data(axis, time, [chart], marks=zoom_marks(context.verdict))
    return Picture(
        f"Time to the threshold{of}",
        to_svg(made, label, context.numbers),
        caption,
        known_columns(data),
        "forecast",
        zoom,
    )


def _cone(axes: Axes, axis: TimeAxis, time: NDArray[np.float64], truth: NDArray[np.float64], kind: str) -> None:
    x = axis.position(time)
    axes.fill_between(x, (1 - ALPHA) * truth, (1 + ALPHA) * truth, color=GREEN, alpha=0.16, linewidth=0, label="±20 %")
    label = "true" if kind == "true" else "until the tracked V_eq crossed"
    axes.plot(x, truth, color=GREEN, linestyle="--", label=label)


def _points(
    axes: Axes, axis: TimeAxis, time: NDArray[np.float64], tt: NDArray[np.float64], top: float, unit: float
) -> None:
    x, y = thin(time, np.where(tt <= top, tt, np.nan) / unit, 400)
    axes.plot(axis.position(x), y, ".", color=BLUE, markersize=4, label="as issued")
    above = np.flatnonzero(tt > top)
    if above.size:
        x, _ = thin(time[above], tt[above], 60)
        style: dict[str, Any] = {"markersize": 5, "markerfacecolor": "none", "markeredgecolor": BLUE}
        label = f"beyond the scale ({above.size:,} issued)"
        axes.plot(axis.position(x), np.full(x.size, 0.97 * top / unit), "^", label=label, **style)


def _refusals(axes: Axes, axis: TimeAxis, time: NDArray[np.float64], statuses: NDArray[np.object_]) -> dict[str, int]:
    """Draw a stroke at the bottom for each block without a forecast; return their number by reason."""
    refused = ~np.isin(statuses.astype(str), _SILENT)
    if refused.any():
        x, _ = thin(time[refused], np.zeros(int(refused.sum())), 200)
        axes.plot(
            axis.position(x),
            np.full(x.size, 0.02),
            "|",
            color=ORANGE,
            markersize=5,
            transform=axes.get_xaxis_transform(),
            label=f"no forecast ({int(refused.sum()):,})",
        )
    names, numbers = np.unique(statuses[refused].astype(str), return_counts=True)
    return {str(name): int(number) for name, number in zip(names, numbers, strict=True)}


def _caption(
    tt: NDArray[np.float64],
    truth: NDArray[np.float64],
    ends: list[NDArray[np.float64]],
    kind: str,
    refused: dict[str, int],
) -> str:
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
