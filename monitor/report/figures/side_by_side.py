"""Figures of several runs: final stages side by side, and the thesis' first prognostic model."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from models.maps.data import OutsideMapError, RmsMap
from monitor.health.size.edv import rms_from_map, rms_history
from monitor.report.figures.drawing import (
    BLUE,
    GREEN,
    GREY,
    INK,
    ORANGE,
    PURPLE,
    STYLE,
    VERMILION,
    Picture,
    last_finite,
    legend_above,
    log_if_wide,
    new_figure,
    to_svg,
    unit_of,
)
from monitor.report.figures.map_path import kept_map
from monitor.report.options import Options
from monitor.report.summary import ChannelSummary, RunSummary
from monitor.report.tables import Column, Table
from monitor.words.numbers import count
from streams.types.block import STANDARD_GRAVITY

_NAMED = 8
"""Up to so many lines have names and styles of their own."""
_MAX_LINES = 100
_MAX_CONDITIONS = 6
_COLOURS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, INK)
_STYLES = ("-", "--", "-.", ":")


def _named(run: RunSummary, channel: ChannelSummary) -> str:
    return run.label if len(run.channels) == 1 else f"{run.label}: {channel.name}"


def _series(runs: Sequence[RunSummary], name: str) -> Iterator[tuple[str, Mapping[str, Any], ChannelSummary]]:
    for run in runs:
        for channel in run.channels:
            if name in channel.final:
                yield _named(run, channel), channel.final[name], channel


@mpl.rc_context(STYLE)
def side_by_side(
    runs: Sequence[RunSummary], name: str, label: str, heading: str, numbers: itertools.count[int]
) -> Picture | None:
    """Draw a quantity of all final stages over the time since t_fs (thesis, Figs. 60, 62 and 64)."""
    every = list(_series(runs, name))
    drawn = every[:_MAX_LINES]
    if len(drawn) < 2:
        return None
    unit, words = unit_of(max(max(series["time_s"]) for _, series, _ in drawn))
    made, (axes,) = new_figure(3.8)
    for (title, series, _), look in zip(drawn, _looks(len(drawn)), strict=True):
        axes.plot(np.array(series["time_s"]) / unit, series["value"], **look(title))
    if name == "v_eq_mm2":
        for place, threshold in enumerate(sorted({t for _, _, channel in drawn for t in channel.thresholds})):
            name_once = "threshold" if place == 0 else None
            axes.axhline(1e6 * threshold, color=GREY, linewidth=1.0, linestyle=(0, (6, 2)), label=name_once)
        axes.set_ylim(bottom=0.0)
    else:
        log_if_wide(axes, np.concatenate([np.array(series["value"]) for _, series, _ in drawn]))
    axes.set_xlabel(f"{words} from the start of the final stage")
    axes.set_ylabel(label)
    axes.set_xlim(left=0.0)
    legend_above(axes, columns=4)
    left = f" The {_MAX_LINES} worst of {len(every)} are drawn." if len(every) > _MAX_LINES else ""
    caption = f"{count(len(drawn), 'final stage')}, each from its own t_fs; standstill is left out.{left}"
    data = {"runs": [{"run": title, **series} for title, series, _ in drawn]}
    text = f"{heading}, {count(len(drawn), 'line')}."
    return Picture(heading, to_svg(made, text, numbers), caption, data, f"side_by_side_{name}")


def _looks(lines: int) -> Iterator[Callable[[str], dict[str, Any]]]:
    """Yield for each line a function from its name to its style: individual for a few, uniform for many."""
    for place in range(lines):
        if lines > _NAMED:
            yield lambda _: {"color": BLUE, "linewidth": 0.8, "alpha": 0.45}
        else:
            colour, style = _COLOURS[place % len(_COLOURS)], _STYLES[place % len(_STYLES)]
            yield lambda title, colour=colour, style=style: {"color": colour, "linestyle": style, "label": title}


@dataclass(frozen=True)
class _Condition:
    """The condition and the recorded RMS of a channel."""

    label: str
    load: float
    speed: float
    rms_end: float
    series: Mapping[str, Any]


_Histories = Mapping[tuple[str, str], tuple[list[float], NDArray[np.float64]]]
"""Times (s) and RMS (m/s2), by run of the condition and run of the defects."""


def other_conditions(
    runs: Sequence[RunSummary], options: Options, numbers: itertools.count[int]
) -> tuple[Picture, Table] | None:
    """Draw the RMS of each run's tracked defects under the conditions of others (thesis, Fig. 63 and Table 21).

    None where no map covers the condition of another run.
    """
    recorded = [
        _Condition(_named(run, channel), channel.load, channel.speed, channel.rms_end, channel.final.get("rms_g", {}))
        for run in runs
        for channel in run.channels
        if channel.load is not None and channel.speed is not None and channel.rms_end is not None
    ]
    sources = [(_named(run, channel), channel) for run in runs for channel in run.channels if channel.sizes]
    maps: dict[tuple[str, str], RmsMap | None] = {}
    histories: dict[tuple[str, str], tuple[list[float], NDArray[np.float64]]] = {}
    for label, channel in sources:
        key = (channel.map_hash, channel.fault)
        if key not in maps:
            maps[key] = options.map_for(channel.name) or kept_map(*key)
        rms_map = maps[key]
        others = [one for one in recorded if one.label != label][:_MAX_LINES]
        for one in others:
            values = _under(rms_map, channel, one)
            if values is not None:
                histories[one.label, label] = (channel.sizes["time_s"], values)
    asked = [one for one in recorded if any(target == one.label for target, _ in histories)]
    return (_draw_conditions(asked, histories, numbers), _rms_at_end(asked, histories)) if asked else None


def _under(rms_map: RmsMap | None, channel: ChannelSummary, one: _Condition) -> NDArray[np.float64] | None:
    """Return the RMS of a channel's sizes under another condition, None where the map does not cover it."""
    if rms_map is None:
        return None
    try:
        at = rms_from_map(rms_map, one.load, one.speed)
    except OutsideMapError:
        return None
    return rms_history(channel.sizes["dphi_d"], channel.sizes["h_d"], at)


@mpl.rc_context(STYLE)
def _draw_conditions(asked: Sequence[_Condition], histories: _Histories, numbers: itertools.count[int]) -> Picture:
    shown = asked[:_MAX_CONDITIONS]
    made, panels = new_figure(0.8 + 2.1 * len(shown), (1.0,) * len(shown))
    longest = max(max(time) for time, _ in histories.values())
    unit, words = unit_of(max([longest, *(max(one.series["time_s"]) for one in shown if one.series)]))
    data = [_panel(axes, one, histories, unit) for axes, one in zip(panels, shown, strict=True)]
    panels[-1].set_xlabel(f"{words} from the start of the final stage")
    panels[-1].set_xlim(left=0.0)
    caption = (
        "Dots: as recorded. Lines: the defects that were tracked on other runs, looked up in the RMS map under the "
        "load and speed of this one. They end when those runs ended: the model says how loud, not when."
    )
    left = len(asked) - len(shown)
    caption += f" {count(left, 'more run')} in the table below." if left else ""
    text = "RMS as recorded and by the first prognostic model, one panel a run."
    heading = "The first prognostic model: defects of other runs under this condition"
    return Picture(heading, to_svg(made, text, numbers), caption, {"panels": data}, "other_conditions")


def _panel(axes: Axes, one: _Condition, histories: _Histories, unit: float) -> dict[str, Any]:
    found: dict[str, Any] = {"run": one.label, "load_newton": one.load, "speed_hz": one.speed, "numerical": []}
    if one.series:
        axes.plot(np.array(one.series["time_s"]) / unit, one.series["value"], ".", color=GREY, label="recorded")
        found["recorded"] = one.series
    mine = [(source, pair) for (target, source), pair in histories.items() if target == one.label]
    for (source, (time, values)), look in zip(mine, _looks(len(mine)), strict=True):
        axes.plot(np.array(time) / unit, values / STANDARD_GRAVITY, **look(f"defects of {source}"))
        found["numerical"].append({"run": source, "time_s": time, "rms_g": values / STANDARD_GRAVITY})
    under = f"{one.label}: {one.load:,.0f} N, {one.speed:g} Hz"
    axes.annotate(under, (1.0, 0.04), xycoords="axes fraction", ha="right", fontsize=9)
    axes.set_ylabel("RMS (g)")
    axes.set_ylim(bottom=0.0)
    legend_above(axes, columns=4)
    return found


def _rms_at_end(asked: Sequence[_Condition], histories: _Histories) -> Table:
    """Return the RMS at the end as recorded and from the map for the defects of other runs (thesis, Table 21)."""
    sources = list(dict.fromkeys(source for _, source in histories))
    numerical = {key: last_finite(values) for key, (_, values) in histories.items()}
    rows = [
        (one.label, one.load, one.speed, one.rms_end, *(numerical.get((one.label, source)) for source in sources))
        for one in asked
    ]
    levels = {"recorded": "recorded"}
    levels |= {f"defects_of_{place}": f"defects of {source}" for place, source in enumerate(sources, start=1)}
    columns = (
        Column("run", "run"),
        Column("load", "load (N)", "N", "newton"),
        Column("speed", "speed (Hz)", "Hz", "hz"),
        *(Column(key, f"{text} (g)", "m s-2", "g", 1.0 / STANDARD_GRAVITY) for key, text in levels.items()),
    )
    note = (
        "RMS at the end of the final stage. Numerical: the last sizes that were tracked on one run, looked up in the "
        "RMS map under the condition of another (the thesis' first prognostic model, Table 21); how loud, not when."
    )
    return Table("rms_at_end", "RMS at the end, recorded and by the first prognostic model", columns, rows, note)
