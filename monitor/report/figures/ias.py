"""Figure of the spectrum of the angular speed: lines of a part in the rotation of the shaft itself."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray

from monitor.health.schema import FAULTS
from monitor.health.spectrum.block_view import RawSpectra
from monitor.health.waterfall import SpectrumRow
from monitor.report.figures.drawing import BLUE, GREY, STYLE, Picture, add_legend, new_figure, thin, to_svg
from monitor.report.figures.spectrum import FAULT_MARKS, ORDERS
from monitor.report.verdict import ChannelContext
from monitor.words.numbers import figure
from monitor.words.statuses import LINE_NAMES

_POINTS = 900
_LOWEST = 0.5
"""Events per revolution below which the spectrum is that of the mean speed's own change."""
_MIN_ORDERS = 12.0


@mpl.rc_context(STYLE)
def ias_picture(rows: Sequence[SpectrumRow], context: ChannelContext) -> Picture | None:
    """Draw the spectrum of the angular speed of the last of some blocks over that of the first; None without any."""
    shown = [(row, row.view.ias) for row in rows if row.view is not None and row.view.ias is not None]
    if not shown:
        return None
    row, latest = shown[-1]
    orders = {part: line / row.speed for part, line in row.lines.items()}
    end = latest.width * latest.highest.size
    last = min(end, max(_MIN_ORDERS, (ORDERS + 0.5) * max(orders.values(), default=0.0)))
    made, (axes,) = new_figure(3.1)
    data: dict[str, Any] = {}
    top, quiet = 0.0, np.inf
    for number, (one, found) in enumerate(shown):
        x, y = _curve(found, last)
        newest = number == len(shown) - 1
        axes.plot(
            x, y, color=BLUE if newest else GREY, linewidth=0.8, label=f"block {one.sequence:,}", zorder=2 + newest
        )
        data[f"block_{one.sequence}"] = {"order": x, "amplitude_rad_s": y}
        top = max(top, float(y.max(initial=0.0)))
        quiet = min(quiet, float(np.median(y)) if y.size else np.inf)
    named = [part for part in FAULTS if part in context.verdict.fault.split("|") and part in orders]
    for part in named:
        colour, _ = FAULT_MARKS[part]
        for harmonic in range(1, min(ORDERS, int(last / orders[part])) + 1):
            axes.axvline(harmonic * orders[part], color=colour, linewidth=0.8, linestyle=(0, (2, 3)), alpha=0.9)
        label = f"{LINE_NAMES[part]} {orders[part]:.3g}"
        axes.plot([], [], color=colour, linewidth=0.8, linestyle=(0, (2, 3)), label=label)
    axes.set_xlim(0.0, last)
    if 0.0 < quiet < top:
        # Errors of the marks stand a thousand times above the lines of a bearing.
        axes.set_yscale("log")
        axes.set_ylim(0.1 * quiet, 8.0 * top)
    else:
        axes.set_ylim(0.0, 1.15 * top or 1.0)
    axes.set_xlabel("events per revolution of the shaft")
    axes.set_ylabel("angular speed (rad/s)")
    add_legend(axes, loc="upper right", ncols=4)
    label = f"Spectrum of the angular speed of block {row.sequence:,}, from the times between pulses."
    return Picture("Angular speed", to_svg(made, label, context.numbers), _caption(shown), data, "ias")


def _curve(found: RawSpectra, last: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    order = np.arange(found.amplitude.size, dtype=np.float64) * found.resolution
    there = (order >= _LOWEST) & (order <= last)
    return thin(order[there], np.asarray(found.amplitude[there], dtype=np.float64), _POINTS)


def _caption(shown: Sequence[tuple[SpectrumRow, RawSpectra]]) -> str:
    row, found = shown[-1]
    text = (
        f"From the times between the pulses of block {row.sequence:,}; lines are {figure(found.resolution, 2)} events "
        "per revolution apart. A part that is struck once a passage brakes the shaft in that rhythm."
    )
    return f"{text} Grey: block {shown[0][0].sequence:,}, before the onset." if len(shown) > 1 else text
