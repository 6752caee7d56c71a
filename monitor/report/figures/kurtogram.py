"""The kurtogram: where a channel is impulsive, before the onset and at the latest kept block."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import PowerNorm
from matplotlib.image import AxesImage
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from monitor.health.signal.kurtogram import Kurtogram
from monitor.health.signal.waterfall import SpectrumRow
from monitor.report.figures.drawing import INK, PAPER, STYLE, VERMILION, Picture, new_figure, to_svg
from monitor.report.verdict import ChannelContext
from monitor.words.numbers import figure

_COLUMNS, _COLOURS = 192, 40
"""Of the image: a multiple of all numbers of bands of a level; and colours."""
_PALE = 0.45
"""Opacity of what noise may be."""
_LEAST_SCALE = 2.0
"""The colours reach at least this kurtosis, so that noise is not drawn as contrast."""


@mpl.rc_context(STYLE)
def kurtograms(context: ChannelContext) -> Picture | None:
    """Draw the kurtogram of the latest kept block below that of the last one before the onset.

    None where no kept spectrum has one.
    """
    shown = _shown(context)
    if not shown:
        return None
    high = max(_LEAST_SCALE, *(max(map(max, found.levels)) for _, found in shown))
    made, panels = new_figure(0.7 + 2.9 * len(shown), (1.0,) * len(shown))
    data: list[dict[str, Any]] = []
    image: AxesImage | None = None
    for axes, (row, found) in zip(panels, shown, strict=True):
        image = _draw(axes, row, found, high)
        data.append(_data(row, found))
    assert image is not None
    bar = made.colorbar(image, ax=panels, pad=0.01)
    bar.set_label("kurtosis of the envelope")
    panels[-1].set_xlabel("frequency (Hz)")
    pairs = [pair for axes in panels for pair in zip(*axes.get_legend_handles_labels(), strict=True)]
    handles = {label: handle for handle, label in pairs}
    place: Any = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "borderaxespad": 0.2}
    panels[0].legend(list(handles.values()), list(handles), ncols=2, **place)
    name = context.channel.name
    label = f"Kurtogram of channel {name}: kurtosis of the envelope by frequency and width of the band."
    svg = to_svg(made, label, context.numbers)
    return Picture("Kurtogram", svg, _caption(shown), {"kurtograms": data}, "kurtogram")


def _shown(context: ChannelContext) -> list[tuple[SpectrumRow, Kurtogram]]:
    """Return the last row before the onset and the latest one, of those with a kurtogram."""
    rows = context.run.spectra.get(context.channel.name, ())
    known = [(row, row.kurtogram) for row in rows if row.kurtogram is not None]
    if not known:
        return []
    onset = None if context.verdict.t_fs is None else context.verdict.t_fs.block
    before = [] if onset is None else [pair for pair in known if pair[0].sequence < onset][-1:]
    return [*(pair for pair in before if pair[0] is not known[-1][0]), known[-1]]


def _draw(axes: Axes, row: SpectrumRow, found: Kurtogram, high: float) -> AxesImage:
    """Draw one kurtogram: a row of cells for each width, the widest on top."""
    count, top = len(found.levels), found.nyquist
    image: NDArray[np.float64] = np.array([np.repeat(level, _COLUMNS // len(level)) for level in found.levels])
    limits = np.array([found.noise_limit(level) for level in range(count)])
    axes.grid(visible=False)
    shown = axes.imshow(
        np.clip(image, 0.0, high),
        origin="upper",
        aspect="auto",
        interpolation="none",
        alpha=np.where(image > limits[:, None], 1.0, _PALE),
        extent=(0.0, top, count - 0.5, -0.5),
        cmap=colormaps["viridis"].resampled(_COLOURS),
        norm=PowerNorm(0.5, 0.0, high),
    )
    low_edge, high_edge = row.band
    for edge, label in ((low_edge, "demodulated band"), (high_edge, None)):
        axes.axvline(edge, color=PAPER, linewidth=2.4)
        axes.axvline(edge, color=VERMILION, linewidth=1.4, linestyle="--", label=label)
    best = found.best()
    if best is not None:
        low, high_best = found.band(*best)
        place = (low, best[0] - 0.5)
        axes.add_patch(Rectangle(place, high_best - low, 1.0, fill=False, edgecolor=PAPER, linewidth=3.2))
        outline = {"fill": False, "edgecolor": INK, "linewidth": 1.6}
        axes.add_patch(Rectangle(place, high_best - low, 1.0, label="highest kurtosis", **outline))
    axes.set_yticks(range(count), [figure(top / len(level), 2) for level in found.levels], fontsize=8)
    axes.set_ylabel("width of the band (Hz)")
    axes.set_title(f"block {row.sequence:,}", loc="left", fontsize=9.5)
    return shown


def _data(row: SpectrumRow, found: Kurtogram) -> dict[str, Any]:
    best = found.best()
    return {
        "block": row.sequence,
        "nyquist_hz": found.nyquist,
        "kurtosis": found.levels,
        "demodulated_hz": row.band,
        "best_hz": None if best is None else found.band(*best),
    }


def _caption(shown: Sequence[tuple[SpectrumRow, Kurtogram]]) -> str:
    row, found = shown[-1]
    best = found.best()
    if best is None:
        highest = f"In block {row.sequence:,} no band is more impulsive than noise would be."
    else:
        low, high = found.band(*best)
        value = found.levels[best[0]][best[1]]
        highest = (
            f"In block {row.sequence:,} the highest, {figure(value, 2)}, stands at {figure(low, 3)} to "
            f"{figure(high, 3)} Hz; noise stays below {figure(found.noise_limit(best[0]), 2)} at this width."
        )
    seconds = 2.0 * shown[-1][1].samples / (2.0 * found.nyquist)
    return (
        "Each cell is a band: its place is the frequency, its row the width. Bright cells hold short bursts, as of a "
        f"damaged bearing, but also single knocks; pale ones may be noise. {highest} From {figure(seconds, 2)} s of "
        "a block (fast kurtogram, Antoni 2007)."
    )
