"""Which row of a file is a tacho: by its samples, and by its title in English, German and Italian."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from streams.turns.tacho import edge_times

_NAMES = re.compile(
    r"tacho|key[ _-]?phas|trigger|\bindex\b|encoder|\bpulses?\b|once[ _-]?per[ _-]?(?:rev|turn)"
    r"|1[ _-]?p(?:er[ _-]?)?rev|drehgeber|inkremental|impulse?\b|nullimpuls|phasengeber|lichtschranke"
    r"|reflexmarke|zahnrad|impulsi|giri\b|fonica|tachimetro|riferimento",
    re.IGNORECASE,
)
_PER_TIME = re.compile(r"rpm|1/min|min-1|u/min|upm|\bhz\b|giri/min", re.IGNORECASE)
_MIN_PULSES = 4
_AT_ENDS, _END = 0.95, 0.15
"""Share of the samples of two levels, each within this share of the range."""
_REGULAR, _SAME = 0.8, 0.3
"""Share of the intervals between pulses that agree with the median, to this part of it."""
_MIN_INTERVAL = 4
"""Least number of samples between the pulses of a row that is not called a tacho."""
_TURNING = 10.0
"""Least mean of a row that is called after a tacho and measures the speed, rpm."""


@dataclass(frozen=True)
class TachoRow:
    """The pulses of a row: their number, and how many come in a second, by the median interval; 0 where none do."""

    pulses: int = 0
    per_second: float = 0.0


def is_called_tacho(title: str) -> bool:
    """Return whether the title of a row is that of a tacho, and states no speed."""
    return _NAMES.search(title) is not None and _PER_TIME.search(title) is None


def tacho_row(row: NDArray[np.floating], title: str, rate: float | None) -> TachoRow | None:
    """Return the pulses of a row that is a tacho, None of any other.

    One of two levels and regular pulses is, whatever its title; one called so needs either of them, or no pulses at all
    where it cannot be a speed or a count.

    Args:
        row: shape (sample,).
        title: of the row, with its unit.
        rate: Hz, None where it is not known; then the pulses come per sample.
    """
    called = is_called_tacho(title)
    times = edge_times(row, rate or 1.0)
    intervals = np.diff(times)
    usual = float(np.median(intervals)) if intervals.size else 0.0
    enough = times.size >= _MIN_PULSES and usual > 0.0
    regular = enough and float(np.mean(np.abs(intervals - usual) <= _SAME * usual)) >= _REGULAR
    two = enough and _has_two_levels(row)
    samples = usual * (rate or 1.0)
    if (two and regular and samples >= _MIN_INTERVAL) or (called and (two or regular) and samples > 1.5):
        return TachoRow(int(times.size), 1.0 / usual)
    counts = bool(np.all(np.diff(row) > 0.0))
    return TachoRow() if called and not counts and not _is_speed(row) else None


def _has_two_levels(row: NDArray[np.floating]) -> bool:
    low, high = float(row.min()), float(row.max())
    band = _END * (high - low)
    below, above = float(np.mean(row <= low + band)), float(np.mean(row >= high - band))
    return below + above >= _AT_ENDS and min(below, above) > 0.0


def _is_speed(row: NDArray[np.floating]) -> bool:
    """Return whether a row could be the speed over time: it is far from 0 and varies little."""
    values = row[np.isfinite(row)].astype(np.float64)
    return values.size > 0 and bool(abs(values.mean()) >= _TURNING and values.std() <= 0.3 * abs(values.mean()))
