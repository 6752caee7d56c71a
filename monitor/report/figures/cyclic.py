"""Spectral coherence of a block: over frequency and cyclic frequency, and averaged over a band."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import PowerNorm
from matplotlib.figure import FigureBase

from monitor.health.signal.cyclic import FALSE_ALARM, HARMONICS, CyclicCoherence, kept_coherence, lines_of
from monitor.health.signal.rotation.rotation import Rotation
from monitor.report.figures.drawing import GREY, INK, Picture, legend_above, places_kept
from monitor.report.figures.sheet import Part, Sheet
from monitor.report.figures.spectrum import mark_parts
from monitor.report.verdict import ChannelContext
from monitor.words.numbers import figure
from monitor.words.statuses import FAULT_NAMES


def block_coherence(context: ChannelContext) -> Picture | None:
    """Draw the coherence of the newest block with a view, where its speed varied; None otherwise."""
    shown = [row for row in context.run.views.get(context.channel.name, ()) if row.view is not None]
    if not shown or shown[-1].view is None or shown[-1].domain != "order":
        return None
    row, view = shown[-1], shown[-1].view
    try:
        found = kept_coherence(row)
    except ValueError:
        return None
    orders = {part: line / row.speed for part, line in row.lines.items()}
    part = cyclic_sheet(found, orders, (), "").parts[0]
    picture = part.picture(context.numbers)
    text = f"{picture.caption} From the {figure(view.waveform.size / view.rate, 2)} s that are kept of the block."
    return replace(picture, heading=f"Spectral coherence of block {row.sequence:,}", caption=text)


_COLUMNS, _ROWS, _COLOURS = 480, 120, 40
_POINTS = 1500
_LEAST_SCALE = 0.1
"""The colours reach at least this coherence, so that noise is not drawn as contrast."""


def cyclic_sheet(
    found: CyclicCoherence, orders: Mapping[str, float], facts: Sequence[tuple[str, str]], title: str
) -> Sheet:
    """Return the report of the coherence of a recording.

    Args:
        found: the coherence.
        orders: first line of each part of the bearing, in the unit of the cyclic frequencies.
        facts: labels and texts about the recording.
    """
    unit = "events per revolution" if found.domain == "order" else "Hz"
    above = [FAULT_NAMES[part] for part, line in lines_of(found, orders).items() if line.stands_out]
    lead = f"Parts of the bearing whose first line stands above the limit of noise: {', '.join(above) or 'none'}."
    return Sheet(title, lead, [_map_part(found, orders, unit), _enhanced_part(found, orders, unit)], list(facts))


def rotation_facts(rotation: Rotation) -> list[tuple[str, str]]:
    """Return labels and texts about the angle of a shaft."""
    low, high = rotation.speed_range
    speed = f"{figure(low)} to {figure(high)} Hz" if high > low else f"{figure(high, 4)} Hz"
    facts = [("Speed", speed), ("Turns", figure(rotation.turned, 4))]
    if rotation.source == "phase":
        facts.append(("Error of the angle", f"{figure(rotation.turns_sd, 2)} turns, from the vibration"))
    return facts


def _map_part(found: CyclicCoherence, lines: Mapping[str, float], unit: str) -> Part:
    # Of cells that are drawn as one, the highest: a line is one cell wide.
    wide, high_cells = -(-found.cyclic.size // _COLUMNS), -(-found.frequency.size // _ROWS)
    across = np.maximum.reduceat(found.coherence, np.arange(0, found.cyclic.size, wide), axis=1)
    cells = np.maximum.reduceat(across, np.arange(0, found.frequency.size, high_cells), axis=0)
    step, spacing = (float(each[1] - each[0]) for each in (found.cyclic, found.frequency))
    left, bottom = float(found.cyclic[0]) - 0.5 * step, -0.5e-3 * spacing
    right = left + cells.shape[1] * wide * step
    top = bottom + 1e-3 * cells.shape[0] * high_cells * spacing

    def draw(made: FigureBase) -> None:
        axes = made.subplots(1, 1)
        high = max(_LEAST_SCALE, float(np.quantile(cells, 0.999)))
        image = axes.imshow(
            cells,
            origin="lower",
            aspect="auto",
            extent=(left, right, bottom, top),
            cmap=colormaps["viridis"].resampled(_COLOURS),
            norm=PowerNorm(0.5, 0.0, high, clip=True),
            interpolation="nearest",
        )
        last, highest = float(found.cyclic[-1]), 1e-3 * float(found.frequency[-1])
        axes.set(ylabel="frequency (kHz)", xlabel=unit, xlim=(0.0, last), ylim=(0.0, highest))
        axes.grid(visible=False)
        ticks = [float(f"{share * high:.1g}") for share in (0.0, 0.06, 0.25, 0.5, 1.0)]
        made.colorbar(image, ax=axes, pad=0.01, ticks=ticks).set_label("squared coherence")
        mark_parts(axes, lines, last, highest, orders=HARMONICS)
        if lines:
            legend_above(axes)

    caption = (
        "Where a frequency recurs with a cyclic frequency. Impacts of a fault stand as columns of spots at its lines, "
        "at the frequencies that they ring; marks are the first four lines of each part."
    )
    return Part("Spectral coherence", caption, "Map of the spectral coherence.", 3.6, draw, name="coherence")


def _enhanced_part(found: CyclicCoherence, lines: Mapping[str, float], unit: str) -> Part:
    kept = places_kept(found.cyclic, found.enhanced, _POINTS)
    cyclic, enhanced = found.cyclic[kept], found.enhanced[kept]

    def draw(made: FigureBase) -> None:
        axes = made.subplots(1, 1)
        axes.plot(cyclic, enhanced, color=GREY, lw=0.8)
        axes.axhline(found.limit, color=INK, lw=0.7, ls="--")
        top = 1.1 * max(float(enhanced.max()), found.limit)
        axes.set(xlabel=unit, ylabel="mean coherence", xlim=(0.0, float(cyclic[-1])), ylim=(0.0, top))
        mark_parts(axes, lines, float(cyclic[-1]), top, orders=HARMONICS)

    low, high = found.band
    caption = (
        f"Mean over {figure(1e-3 * low)} to {figure(1e-3 * high)} kHz. Dashed: what stationary noise exceeds anywhere "
        f"in {100.0 * FALSE_ALARM:g} % of blocks."
    )
    data = {"cyclic": cyclic, "enhanced": enhanced}
    return Part("Enhanced envelope spectrum", caption, "Mean coherence.", 2.3, draw, data, "enhanced")
