"""Trends of a channel for the page: every record where they are few, else extremes over stretches of time."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from monitor.records.packing import entries_of, numbers_of
from monitor.service.web.columns import FEATURES
from monitor.service.web.reading import StoreReader

_QUERY = """
SELECT axis_time, layout, row FROM blocks JOIN records ON block = id
WHERE source = ? AND (day IS NOT NULL) = ? AND axis_time >= ? AND axis_time <= ? AND time_status <> 'unknown'
ORDER BY axis_time
"""


@dataclass(frozen=True)
class Trend:
    """Values over time.

    Attributes:
        resolution: s, or None where each row is a record.
        time: (n,), s.
        low, high: by feature, (n,), SI; NaN where there is none.
    """

    resolution: float | None
    time: NDArray[np.float64]
    low: dict[str, NDArray[np.float64]] = field(default_factory=dict)
    high: dict[str, NDArray[np.float64]] = field(default_factory=dict)


def read_trend(
    store: StoreReader, source: str, channel: str, *, dated: bool, span: tuple[float, float], points: int
) -> Trend:
    """Return at most about ``points`` rows over a span of time."""
    rows = store.rows(_QUERY, source, dated, *span)
    time = np.array([row[0] for row in rows], dtype=float)
    values = np.full((len(rows), len(FEATURES)), np.nan)
    layouts = dict(store.rows("SELECT id, layout FROM layouts"))
    places = {number: _places(layout, channel) for number, layout in layouts.items()}
    for index, (_, layout, row) in enumerate(rows):
        columns, at = places[layout]
        if columns:
            values[index, columns] = numbers_of(row)[at]
    if time.size <= points:
        parts = dict(zip(FEATURES, values.T, strict=True))
        return Trend(None, time, parts, parts)
    width = (span_of(time)[1] - span_of(time)[0]) / points
    bucket = np.minimum(((time - time[0]) / width).astype(int), points - 1)
    starts = np.flatnonzero(np.diff(bucket, prepend=-1))
    low = np.fmin.reduceat(values, starts, axis=0)
    high = np.fmax.reduceat(values, starts, axis=0)
    return Trend(
        width,
        time[0] + bucket[starts] * width,
        dict(zip(FEATURES, low.T, strict=True)),
        dict(zip(FEATURES, high.T, strict=True)),
    )


def span_of(time: NDArray[np.float64]) -> tuple[float, float]:
    """Return first and last of ascending times."""
    return float(time[0]), float(time[-1])


def _places(layout: str, channel: str) -> tuple[list[int], list[int]]:
    """Return which features a layout has of a channel, and where in the row."""
    found = [
        (FEATURES.index(entry.variable), entry.start)
        for entry in entries_of(layout)
        if entry.channel == channel and entry.variable in FEATURES and entry.shape is not None
    ]
    return [feature for feature, _ in found], [place for _, place in found]
