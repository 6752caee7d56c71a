"""Which of the kept envelope spectra show the onset best: one before it, one after."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from monitor.health.waterfall import SpectrumRow
from monitor.report.figures.spectrum import SpectrumView
from monitor.report.runs import Channel
from monitor.report.verdict import Verdict, named_fault
from monitor.words.numbers import Clock
from streams.block import STANDARD_GRAVITY


def views_of(rows: Sequence[SpectrumRow], channel: Channel, verdict: Verdict, clock: Clock) -> list[SpectrumView]:
    """Return a spectrum from before the onset and one from after; the latest alone where there was none; or nothing.

    Args:
        rows: in the order of their blocks.
        channel: whose they are.
        verdict: on it.
        clock: writes moments.
    """
    usable = [row for row in rows if row.amplitude.size > 1 and row.resolution > 0]
    if not usable:
        return []
    onset = verdict.t_fs.block if verdict.t_fs is not None else None
    if onset is None:
        return [view_of(usable[-1], clock)]
    before = [row for row in usable if row.sequence < onset]
    after = [row for row in usable if row.sequence >= onset]
    if not before or not after:
        return [view_of(usable[-1], clock)]
    return [view_of(_typical(before, channel), clock), view_of(_telling(after, channel, verdict), clock)]


def _typical(before: Sequence[SpectrumRow], channel: Channel) -> SpectrumRow:
    """Return the middle one of those after the learning window, or of all where there is none."""
    learning = channel.sequence[channel.word("stage") == "learning"]
    later = [row for row in before if not learning.size or row.sequence > learning[-1]]
    among = later or before
    return among[len(among) // 2]


def _telling(after: Sequence[SpectrumRow], channel: Channel, verdict: Verdict) -> SpectrumRow:
    """Return the one nearest to the block that named the part best, the latest where none was named."""
    row, fault = named_fault(channel)
    if row is None or not fault:
        return after[-1]
    blocks = np.array([item.sequence for item in after])
    return after[int(np.argmin(np.abs(blocks - int(channel.sequence[row]))))]


def view_of(row: SpectrumRow, clock: Clock) -> SpectrumView:
    """Return a kept spectrum as it is drawn."""
    scale = STANDARD_GRAVITY if row.absolute else 1.0
    when = "" if row.time is None else f", {clock.moment(row.time)}"
    return SpectrumView(
        frequency_hz=row.frequency,
        amplitude_g=np.asarray(row.amplitude, dtype=np.float64) / scale,
        fundamentals_hz=row.lines,
        label=f"block {row.sequence:,}{when}",
        speed_hz=row.speed,
        unit="g" if row.absolute else "sensor unit",
    )
