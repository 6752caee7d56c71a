"""Figure of the spectral coherence of the samples that are kept of a block."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from monitor.health.kept_coherence import kept_coherence
from monitor.health.waterfall import SpectrumRow
from monitor.report.figures.cyclic import cyclic_sheet
from monitor.report.figures.drawing import Picture
from monitor.report.verdict import ChannelContext
from monitor.words.numbers import figure


def block_coherence(rows: Sequence[SpectrumRow], context: ChannelContext) -> Picture | None:
    """Draw the coherence of the last of some blocks with a view, where its speed varied; None otherwise."""
    shown = [row for row in rows if row.view is not None]
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
