"""Data quality: accepted and rejected blocks, gaps, speed and load."""

from __future__ import annotations

import itertools
import math
import re
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from monitor.health.schema import FLAGS, REJECTIONS
from monitor.report.figures.drawing import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    STYLE,
    VERMILION,
    Picture,
    TimeAxis,
    add_legend,
    draw_line,
    draw_rug,
    gaps_in,
    new_figure,
    time_axis,
    to_svg,
)
from monitor.report.runs import Channel, Run
from monitor.report.tables import Column, Table, time_column
from monitor.words.numbers import Clock, count, duration, figure
from monitor.words.statuses import STATUS_MEANINGS

_MAX_GAPS = 50
_FOLDERS = re.compile(r"(?<![\w.])/(?:[^\s/:'\"<>]+/)+")
_LEVELS = (("accepted", GREEN), ("flagged", ORANGE), ("rejected", VERMILION))
_CONDITIONS = (("speed", "Hz", BLUE), ("load", "N", PURPLE))


def without_folders(text: str) -> str:
    """Reduce every absolute path in a text to its last part; folders of a machine are private."""
    return _FOLDERS.sub("", text)


def offered(run: Run, pending: int) -> str:
    """Return the sum of the ledger as a sentence: offered = accepted + rejected + pending."""
    rejected = sum(number for status, number in run.counts.items() if status in REJECTIONS)
    total = sum(run.counts.values())
    return (
        f"{count(total + pending, 'block')} offered = {total - rejected:,} accepted + {rejected:,} rejected + "
        f"{pending:,} pending."
    )


def statuses(run: Run) -> Table:
    """Return the table of blocks by status, with the first block of each."""
    order = {status: place for place, status in enumerate(("ok", *FLAGS, *REJECTIONS))}
    rows = []
    for status, number in sorted(run.counts.items(), key=lambda item: order[item[0]]):
        outcome = "rejected" if status in REJECTIONS else ("accepted" if status == "ok" else "accepted, flagged")
        example = ""
        places = np.flatnonzero(run.ledger["status"] == status)
        if places.size and status != "ok":
            place = places[0]
            name, reason = run.ledger["name"][place], run.ledger["reason"][place]
            example = without_folders(f"{run.ledger['sequence'][place]:,}: {name}{f': {reason}' if reason else ''}")
        rows.append((status, int(number), outcome, STATUS_MEANINGS[status], example))
    columns = (
        Column("status", "status"),
        Column("blocks", "blocks", "1"),
        Column("outcome", "outcome"),
        Column("meaning", "meaning"),
        Column("example", "first such block"),
    )
    return Table("blocks", "Blocks by status", columns, rows)


def gaps_of(run: Run) -> list[tuple[float, float, float]]:
    """Return start, end and length (s) of each gap between blocks of one source, the longest first."""
    found: list[tuple[float, float, float]] = []
    sources = run.ledger["source"].astype(str)
    for source in np.unique(sources):
        time = np.sort(run.time[(sources == source) & np.isfinite(run.time)])
        found.extend(
            (float(time[place]), float(time[place + 1]), float(time[place + 1] - time[place]))
            for place in gaps_in(time)
        )
    return sorted(found, key=lambda gap: -gap[2])


def gaps(run: Run, clock: Clock) -> Table | None:
    """Return the table of the longest gaps, None without any."""
    found = gaps_of(run)
    if not found:
        return None
    columns = (
        time_column("from", "last block before", clock),
        time_column("to", "first block after", clock),
        Column("length", "length", "s", "s", words=duration),
    )
    left = f" The longest {_MAX_GAPS} of {len(found):,}." if len(found) > _MAX_GAPS else ""
    note = f"{count(len(found), 'gap')}, {duration(sum(gap[2] for gap in found))} in all.{left}"
    return Table("gaps", "Gaps", columns, found[:_MAX_GAPS], note)


@mpl.rc_context(STYLE)
def timeline(run: Run, clock: Clock, numbers: itertools.count[int]) -> Picture | None:
    """Draw accepted, flagged and rejected blocks over time, with speed and load; None without two known times."""
    known = np.isfinite(run.time)
    time = run.time[known]
    if time.size < 2 or np.ptp(time) == 0.0:
        return None
    status = run.ledger["status"][known].astype(str)
    axis = time_axis(time, clock)
    conditions = [
        condition
        for condition in _CONDITIONS
        if any(channel.last_row(condition[0]) is not None for channel in run.channels.values())
    ]
    made, panels = new_figure(1.5 + 1.15 * len(conditions), (0.8,) + (1.0,) * len(conditions))
    blocks = _draw_blocks(panels[0], axis, time, status)
    data: dict[str, Any] = {"time_s": time if time.size <= 2000 else None, **blocks}
    for axes, (name, unit, colour) in zip(panels[1:], conditions, strict=True):
        data[name] = _draw_condition(axes, axis, run, name, unit, colour)
    axis.settle(panels[-1], float(time.min()), float(time.max()))
    label = f"Blocks of machine {run.machine} over time: accepted, flagged, rejected; speed and load."
    longest = gaps_of(run)[:1]
    caption = "Each stroke is a block."
    caption += f" The longest gap lasts {duration(longest[0][2])}." if longest else " No gaps."
    return Picture("Blocks and operating condition", to_svg(made, label, numbers), caption, data, "quality")


def _draw_blocks(axes: Axes, axis: TimeAxis, time: NDArray[np.float64], status: NDArray[np.str_]) -> dict[str, int]:
    """Draw a stroke for each block; return their numbers by level."""
    rejected = np.isin(status, REJECTIONS)
    kinds = (status == "ok", (status != "ok") & ~rejected, rejected)
    numbers: dict[str, int] = {}
    for place, (rows, (name, colour)) in enumerate(zip(kinds, _LEVELS, strict=True)):
        draw_rug(axes, axis, np.sort(time[rows]), 2.0 - place, "|", 900, color=colour, markersize=9, label=name)
        numbers[name] = int(rows.sum())
    axes.set_yticks([2.0, 1.0, 0.0], [f"{name} ({number:,})" for name, number in numbers.items()])
    axes.set_ylim(-0.6, 2.6)
    axes.grid(visible=False, axis="y")
    return numbers


def _draw_condition(axes: Axes, axis: TimeAxis, run: Run, name: str, unit: str, colour: str) -> dict[str, Any]:
    """Draw speed or load of all channels, those with equal values as one line; return their ranges."""
    lines: dict[bytes, list[Channel]] = {}
    for channel in run.channels.values():
        if channel.last_row(name) is not None:
            lines.setdefault(channel.column(name).tobytes(), []).append(channel)
    found: dict[str, Any] = {}
    for channels, shade in zip(lines.values(), itertools.cycle((colour, GREY, ORANGE, GREEN)), strict=False):
        values, label = channels[0].column(name), ", ".join(channel.name for channel in channels)
        draw_line(axes, axis, channels[0].time, values, color=shade, label=label)
        found[label] = _range(values[np.isfinite(values)])
    axes.set_ylabel(f"{name} ({unit})")
    low, high = min(item[0] for item in found.values()), max(item[2] for item in found.values())
    margin = max(0.6 * (high - low), 0.05 * abs(high), 1e-9)
    axes.set_ylim(low - margin, high + margin)
    if len(lines) > 1:
        add_legend(axes, loc="upper left", ncols=3)
    return found


def _range(values: NDArray[np.float64]) -> list[float]:
    """Return minimum, median and maximum."""
    return [float(values.min()), float(np.median(values)), float(values.max())]


def condition_words(run: Run) -> list[str]:
    """Return a sentence on speed and load of each channel."""
    found = []
    for channel in run.channels.values():
        parts = []
        for name, unit, _ in _CONDITIONS:
            values = channel.column(name)
            values = values[np.isfinite(values)]
            if not values.size:
                continue
            low, middle, high = _range(values)
            sources = [str(word) for word in np.unique(channel.word(f"{name}_source").astype(str)) if word]
            same = math.isclose(low, high, rel_tol=1e-3)
            spread = "" if same else f" ({figure(low)} to {figure(high)})"
            parts.append(f"{name} {figure(middle)} {unit}{spread}{f', {chr(47).join(sources)}' if sources else ''}")
        if parts:
            found.append(f"{channel.name}: {'; '.join(parts)}.")
    return list(dict.fromkeys(found))
