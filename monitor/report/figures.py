"""The figures of one channel: trends, envelope spectrum, damaged volume and time to threshold."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from monitor.records.schema import FAULTS, REJECTIONS
from monitor.report.drawing import (
    BLOCK_AXIS,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    SKY,
    STYLE,
    VERMILION,
    TimeAxis,
    add_legend,
    draw_line,
    log_if_wide,
    new_figure,
    thin,
    time_axis,
    to_svg,
)
from monitor.report.reading import Channel
from monitor.report.verdict import Moment, Verdict
from monitor.report.wording import FAULT_NAMES
from streams.block import STANDARD_GRAVITY

_FAULT_MARKS = {"outer": (VERMILION, "o"), "inner": (BLUE, "s"), "ball": (GREEN, "^"), "cage": (PURPLE, "D")}
_ENDS = ("lower", "upper")
_SEARCH = 0.02
"""How far a line may stand from its kinematic frequency: slip and nominal speeds are up to 2 % off."""


class SpectrumView(NamedTuple):
    """An envelope spectrum to be drawn.

    Attributes:
        frequency_hz: ascending, Hz.
        amplitude_g: amplitude of the envelope, g.
        fundamentals_hz: kinematic frequency of each family of fault lines, Hz.
        label: which block it is of, for people.
    """

    frequency_hz: NDArray[np.float64]
    amplitude_g: NDArray[np.float64]
    fundamentals_hz: Mapping[str, float]
    label: str = ""


@mpl.rc_context(STYLE)
def trends(channel: Channel, verdict: Verdict, *, dated: bool, numbers: itertools.count[int]) -> str | None:
    """Draw RMS, H_or and the detection score over time.

    Returns:
        SVG, or None where fewer than two blocks have a value.
    """
    rms, h_or = channel.column("rms"), channel.column("h_or")
    score, threshold = channel.column("detect_score"), channel.column("detect_threshold")
    if np.sum(np.isfinite(rms)) < 2:
        return None
    time, axis = _axis(channel, dated=dated)
    scored = bool(np.isfinite(score).any())
    figure, panels = new_figure(5.6 if scored else 4.2, (1.25, 1.25, 1.0) if scored else (1.0, 1.0))
    unit, scale = ("g", STANDARD_GRAVITY) if channel.has_level else ("sensor unit", 1.0)
    for axes, values, name, colour in ((panels[0], rms, "RMS", BLUE), (panels[1], h_or, "H_or", PURPLE)):
        draw_line(axes, axis, time, values / scale, color=colour)
        log_if_wide(axes, values / scale)
        axes.set_ylabel(f"{name} ({unit})")
    if scored:
        draw_line(panels[2], axis, time, score, color=GREY)
        draw_line(panels[2], axis, time, threshold, color=ORANGE, linestyle="-.", label="threshold")
        log_if_wide(panels[2], score, threshold)
        panels[2].set_ylabel("score")
        add_legend(panels[2], loc="upper left")
    for axes in panels:
        _shade_learning(axes, axis, time, channel)
        if axis.timed:
            _marks(axes, axis, verdict)
    _mark_legend(panels[0], verdict, channel)
    _rug(panels[0], axis, time, channel)
    axis.settle(panels[-1])
    label = f"RMS, H_or and detection score of channel {channel.name} over time. {verdict.headline}."
    return to_svg(figure, label, numbers)


@mpl.rc_context(STYLE)
def spectrum(view: SpectrumView, channel: str, numbers: itertools.count[int]) -> str | None:
    """Draw an envelope spectrum with the lines of the four parts, of which the highest point near each is marked.

    Returns:
        SVG, or None where the spectrum has fewer than two points.
    """
    if len(view.frequency_hz) < 2:
        return None
    figure, (axes,) = new_figure(3.3)
    frequency, amplitude = np.asarray(view.frequency_hz, float), np.asarray(view.amplitude_g, float)
    # Five orders of the passages; the mean and slow drift below the cage's line are no lines.
    last = min(float(frequency[-1]), 5.3 * max(view.fundamentals_hz.values(), default=float(frequency[-1])))
    first = 0.5 * min(view.fundamentals_hz.values(), default=0.0)
    shown = (frequency >= first) & (frequency <= last)
    x, y = thin(frequency[shown], amplitude[shown], 700)
    axes.plot(x, y, color=GREY, linewidth=0.8)
    for fault in FAULTS:
        if fault in view.fundamentals_hz:
            _fault_lines(axes, frequency, amplitude, fault, view.fundamentals_hz[fault], last)
    axes.set_xlim(0.0, last)
    top = float(amplitude[shown].max()) if shown.any() else 1.0
    axes.set_ylim(0.0, 1.12 * top or 1.0)
    axes.set_xlabel("frequency (Hz)")
    axes.set_ylabel("envelope (g)")
    add_legend(axes, loc="upper right", ncols=4, handletextpad=0.3, columnspacing=1.2)
    return to_svg(figure, f"Envelope spectrum of channel {channel} with the fault lines of the bearing.", numbers)


@mpl.rc_context(STYLE)
def recorded_lines(channel: Channel, row: int, numbers: itertools.count[int]) -> str | None:
    """Draw the fault lines that a record holds, each over the noise floor under it, where no spectrum is at hand."""
    amplitude = channel.numbers["envelope_amplitude"][row][:20]
    floor = np.resize(channel.numbers["envelope_floor"][row], 20)
    if amplitude.size < 20 or not np.isfinite(amplitude).any():
        return None
    scale = STANDARD_GRAVITY if channel.has_level else 1.0
    figure, (axes,) = new_figure(2.9)
    labels = []
    for place, fault in enumerate(FAULTS):
        x = np.arange(5) + 6.0 * place
        colour, _ = _FAULT_MARKS[fault]
        axes.bar(x, np.nan_to_num(amplitude[5 * place : 5 * place + 5] / scale), width=0.72, color=colour, alpha=0.85)
        axes.hlines(floor[5 * place : 5 * place + 5] / scale, x - 0.42, x + 0.42, color="black", linewidth=1.4)
        labels.append((6.0 * place + 2.0, FAULT_NAMES[fault]))
    axes.set_xticks([x for x, _ in labels], [f"{text}, 1 to 5" for _, text in labels])
    axes.grid(visible=False, axis="x")
    axes.set_ylabel(f"envelope ({'g' if channel.has_level else 'sensor unit'})")
    label = f"Lines of the envelope spectrum of block {channel.sequence[row]}, with the noise floor as a black bar."
    return to_svg(figure, label, numbers)


@mpl.rc_context(STYLE)
def damage(
    channel: Channel, verdict: Verdict, *, dated: bool, numbers: itertools.count[int], interval: str = "interval"
) -> str | None:
    """Draw V_eq and the forecasts of the time to threshold, as issued, with the truth where the records carry it.

    Args:
        channel: what it said.
        verdict: on it.
        dated: whether times are UTC.
        numbers: of the figures of the page.
        interval: what the bands are called.

    Returns:
        SVG, or None where fewer than two moments have a V_eq.
    """
    v_eq = channel.column("v_eq")
    rows = np.flatnonzero(np.isfinite(v_eq))
    if rows.size < 2 or np.ptp(channel.time[rows]) == 0.0:
        return None
    # A little of what was before the first value, so that the beginning is seen.
    lead = max(2, (rows[-1] - rows[0]) // 12)
    part = slice(max(0, rows[0] - lead), min(v_eq.size, rows[-1] + lead + 1))
    time = channel.time[part]
    axis = time_axis(channel.time, dated=dated)
    tt = channel.numbers["tt"][part, 0]
    forecast = bool(np.isfinite(tt).any())
    figure, panels = new_figure(5.2 if forecast else 3.0, (1.0, 1.0) if forecast else (1.0,))
    threshold = _threshold(channel)
    _draw_volume(panels[0], axis, channel, part, threshold, interval)
    if forecast:
        _draw_forecast(panels[1], axis, channel, part, threshold, interval)
    for axes in panels:
        _marks(axes, axis, verdict)
        axes.set_xlim(axis.position(float(time[0])), axis.position(float(time[-1])))
    axis.settle(panels[-1])
    label = f"Equivalent damaged volume and time to threshold of channel {channel.name}."
    return to_svg(figure, label, numbers)


def _draw_volume(axes: Axes, axis: TimeAxis, channel: Channel, part: slice, threshold: float, interval: str) -> None:
    time = channel.time[part]
    _draw_band(axes, axis, time, [1e6 * channel.column(f"v_eq_{end}")[part] for end in _ENDS], interval)
    draw_line(axes, axis, time, 1e6 * channel.column("v_eq")[part], color=BLUE, label="tracked")
    truth = 1e6 * channel.column("v_eq_true")[part]
    if np.isfinite(truth).any():
        draw_line(axes, axis, time, truth, color=GREEN, linestyle="--", label="true")
    if math.isfinite(threshold):
        axes.axhline(1e6 * threshold, color=ORANGE, linewidth=1.1, linestyle="-.", label="threshold")
    axes.set_ylim(bottom=0.0)
    axes.set_ylabel("V_eq (mm³/mm)")
    add_legend(axes, loc="upper left", ncols=4)


def _draw_band(
    axes: Axes, axis: TimeAxis, time: NDArray[np.float64], ends: Sequence[NDArray[np.float64]], name: str
) -> None:
    """Draw an interval; one that stands between two gaps is a bar, as a band of no width is not seen."""
    lower, upper = ends
    if not np.isfinite(lower).any():
        return
    axes.fill_between(axis.position(time), lower, upper, color=SKY, alpha=0.3, linewidth=0, label=name)
    there = np.concatenate([[False], np.isfinite(lower), [False]])
    alone = there[1:-1] & ~there[:-2] & ~there[2:]
    if alone.any():
        axes.vlines(axis.position(time[alone]), lower[alone], upper[alone], color=SKY, alpha=0.6, linewidth=1.5)


def _draw_forecast(axes: Axes, axis: TimeAxis, channel: Channel, part: slice, threshold: float, interval: str) -> None:
    time = channel.time[part]
    tt = channel.numbers["tt"][part, 0]
    truth = channel.numbers["tt_true"][part, 0]
    name = "true"
    if not np.isfinite(truth).any():
        truth, name = _crossing_line(channel, part, threshold), "t_th − t, with t_th where the tracked V_eq crossed"
    expected = truth[np.isfinite(truth)]
    # Early fits may point anywhere; the scale is that of the truth, or of the bulk of what was issued.
    top = 2.0 * float(expected.max()) if expected.size else float(np.nanpercentile(tt, 90)) * 1.15
    top = max(min(top, 1.08 * float(np.nanmax(tt))), 1.08 * float(expected.max()) if expected.size else 0.0) or 1.0
    unit, label = _unit_for(top)
    _draw_band(axes, axis, time, [channel.numbers[f"tt_{end}"][part, 0] / unit for end in _ENDS], interval)
    x, y = thin(time, np.where(tt <= top, tt, np.nan) / unit, 400)
    axes.plot(axis.position(x), y, ".", color=BLUE, markersize=4, label="as issued")
    above = np.flatnonzero(tt > top)
    if above.size:
        x, _ = thin(time[above], tt[above], 60)
        axes.plot(
            axis.position(x),
            np.full(x.size, 0.97 * top / unit),
            linestyle="none",
            marker="^",
            markersize=5,
            markerfacecolor="none",
            markeredgecolor=BLUE,
            label=f"beyond the scale ({above.size} issued)",
        )
    if expected.size:
        axes.plot(axis.position(time), truth / unit, color=GREEN, linestyle="--", label=name)
    axes.set_ylim(0.0, top / unit)
    axes.set_ylabel(f"TT ({label})")
    add_legend(axes, loc="upper right", ncols=2)


def _crossing_line(channel: Channel, part: slice, threshold: float) -> NDArray[np.float64]:
    """Return t_th - t where the tracked V_eq itself crossed the threshold, NaN elsewhere (thesis, Eq. 92)."""
    time, v_eq = channel.time[part], channel.column("v_eq")[part]
    above = np.flatnonzero(v_eq >= threshold)
    if not above.size:
        return np.full(time.size, np.nan)
    line = time[above[0]] - time
    return np.where(line >= 0.0, line, np.nan)


def _threshold(channel: Channel) -> float:
    values = channel.numbers["v_th"][:, 0]
    finite = values[np.isfinite(values)]
    return float(finite[-1]) if finite.size else math.nan


def _unit_for(seconds: float) -> tuple[float, str]:
    for limit, unit, name in ((300.0, 1.0, "seconds"), (3 * 3600.0, 60.0, "minutes"), (96 * 3600.0, 3600.0, "hours")):
        if seconds <= limit:
            return unit, name
    return 86400.0, "days"


def _fault_lines(
    axes: Axes,
    frequency: NDArray[np.float64],
    amplitude: NDArray[np.float64],
    fault: str,
    fundamental: float,
    last: float,
) -> None:
    colour, marker = _FAULT_MARKS[fault]
    found: list[tuple[float, float]] = []
    for order in range(1, 6):
        nominal = order * fundamental
        if nominal > last:
            break
        axes.axvline(nominal, color=colour, linewidth=0.8, linestyle=(0, (2, 3)), alpha=0.8)
        near = np.flatnonzero(np.abs(frequency - nominal) <= max(_SEARCH * nominal, frequency[1] - frequency[0]))
        if near.size:
            best = near[np.argmax(amplitude[near])]
            found.append((float(frequency[best]), float(amplitude[best])))
    if found:
        label = f"{FAULT_NAMES[fault]} {fundamental:.1f} Hz"
        x, y = zip(*found, strict=True)
        axes.plot(x, y, marker, color=colour, markersize=5, markerfacecolor="white", label=label)


def _axis(channel: Channel, *, dated: bool) -> tuple[NDArray[np.float64], TimeAxis]:
    """Return positions and axis of the blocks: their times, or their numbers where the recording knows no times."""
    if channel.time.size and np.ptp(channel.time) == 0.0:
        return channel.sequence.astype(np.float64), BLOCK_AXIS
    return channel.time, time_axis(channel.time, dated=dated)


def _shade_learning(axes: Axes, axis: TimeAxis, time: NDArray[np.float64], channel: Channel) -> None:
    rows = np.flatnonzero(channel.word("stage") == "learning")
    if rows.size > 1:
        edges = axis.position(time[rows[[0, -1]]])
        axes.axvspan(float(edges[0]), float(edges[1]), color="#eef1f4", linewidth=0, zorder=0, label="learning window")


def _marks(axes: Axes, axis: TimeAxis, verdict: Verdict) -> None:
    for mark, colour, style in _moments(verdict):
        axes.axvline(float(axis.position(mark.time)), color=colour, linestyle=style, linewidth=1.2)


def _moments(verdict: Verdict) -> list[tuple[Moment, str, str]]:
    marks = (
        (verdict.t_fs, VERMILION, "-"),
        (verdict.t_fs_known, VERMILION, ":"),
        (verdict.t_eol, "#22262b", "-"),
    )
    return [(mark, colour, style) for mark, colour, style in marks if mark is not None and math.isfinite(mark.time)]


def _mark_legend(axes: Axes, verdict: Verdict, channel: Channel) -> None:
    """Name the lines and the rug of the panel in one legend above it."""
    for mark, colour, style, name in (
        (verdict.t_fs, VERMILION, "-", "final stage began"),
        (verdict.t_fs_known, VERMILION, ":", "known"),
        (verdict.t_eol, "#22262b", "-", "end of life"),
    ):
        if mark is not None:
            block = "" if mark.block is None else f" (block {mark.block})"
            axes.plot([], [], color=colour, linestyle=style, linewidth=1.2, label=f"{name}{block}")
    for marker, colour, name, statuses in _rugs(channel):
        axes.plot([], [], marker, color=colour, linestyle="none", markersize=5, label=f"{name} ({statuses.size})")
    add_legend(axes, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, borderaxespad=0.2, handlelength=1.6)


def _rugs(channel: Channel) -> list[tuple[str, str, str, NDArray[np.intp]]]:
    """Return marker, colour, name and rows of the blocks that were rejected and of those that were flagged."""
    rejected = np.isin(channel.status.astype(str), REJECTIONS)
    flagged = (channel.status != "ok") & ~rejected
    return [
        (marker, colour, name, np.flatnonzero(rows))
        for marker, colour, name, rows in (("x", VERMILION, "rejected", rejected), ("|", ORANGE, "flagged", flagged))
        if rows.any()
    ]


def _rug(axes: Axes, axis: TimeAxis, time: NDArray[np.float64], channel: Channel) -> None:
    for marker, colour, _, rows in _rugs(channel):
        x, _ = thin(time[rows], np.zeros(rows.size), 300)
        axes.plot(
            axis.position(x),
            np.full(x.size, 0.03),
            marker,
            color=colour,
            linestyle="none",
            markersize=5,
            transform=axes.get_xaxis_transform(),
        )
