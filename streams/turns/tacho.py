"""Times of the pulses in a channel: by a threshold with hysteresis, or from a counter; their direction.

The time of an edge is where the line between the samples on both sides of it meets the threshold. The threshold is half
way between the levels of the signal in each of up to 32 windows that hold three pulses or more, so that it follows a
drifting offset, and an amplitude that grows with the speed.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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
    two_levels = _has_two_levels(row)
    if not (called or two_levels):
        return None
    times = edge_times(row, rate or 1.0)
    intervals = np.diff(times)
    usual = float(np.median(intervals)) if intervals.size else 0.0
    enough = times.size >= _MIN_PULSES and usual > 0.0
    regular = enough and float(np.mean(np.abs(intervals - usual) <= _SAME * usual)) >= _REGULAR
    two = enough and two_levels
    samples = usual * (rate or 1.0)
    if (two and regular and samples >= _MIN_INTERVAL) or (called and (two or regular) and samples > 1.5):
        return TachoRow(int(times.size), 1.0 / usual)
    counts = bool(np.all(np.diff(row) > 0.0))
    return TachoRow() if called and not counts and not _is_speed(row) else None


def _has_two_levels(row: NDArray[np.floating]) -> bool:
    low, high = float(row.min()), float(row.max())
    band = _END * (high - low)
    below, above = np.count_nonzero(row <= low + band), np.count_nonzero(row >= high - band)
    return bool(below + above >= _AT_ENDS * row.size and min(below, above) > 0)


def _is_speed(row: NDArray[np.floating]) -> bool:
    """Return whether a row could be the speed over time: it is far from 0 and varies little."""
    values = row[np.isfinite(row)].astype(np.float64)
    return values.size > 0 and bool(abs(values.mean()) >= _TURNING and values.std() <= 0.3 * abs(values.mean()))


HYSTERESIS = 0.15
"""Half width of the dead band around the threshold, as a share of the distance between the levels."""
_WINDOWS = 32
_EMPTY = 0.4
"""A window whose levels are less apart than this share of those of its neighbours does not hold a pulse."""
_PULSES_A_WINDOW = 3
_STEADY = 0.2
"""Where the middle and the amplitude move by less than this share of the amplitude, one threshold serves."""
_WRAPS = (2.0**8, 2.0**16, 2.0**24, 2.0**32)


def edge_times(
    samples: NDArray[np.floating], rate: float, level: float | None = None, *, falling: bool = False
) -> NDArray[np.float64]:
    """Return the times of the pulses in a channel, s from its first sample, shape (pulse,), never falling.

    A channel that does not vary, or has a sample that is no number, has none.

    Args:
        samples: shape (sample,), any unit: pulses, or a count of pulses that only rises or only falls.
        rate: Hz.
        level: threshold in the unit of the samples; None: half way between the levels of the signal.
        falling: whether the falling edge of a pulse counts, and not the rising one.
    """
    row = np.ascontiguousarray(samples)
    if row.size < 2 or not (np.isfinite(row.min()) and np.isfinite(row.max())):
        return np.zeros(0)
    counted = _counted(row) if float(row.max()) - float(row.min()) > 1.0 else None
    if counted is not None:
        return (counted + 0.5) / rate
    if falling:
        row, level = -row, None if level is None else -level
    return _edges(row, level) / rate


def directions(times: NDArray[np.float64], second: NDArray[np.floating], rate: float) -> NDArray[np.bool_]:
    """Return which edges of the first track of a quadrature encoder turned the other way than most, shape (pulse,).

    Args:
        times: of the edges of the first track, s.
        second: shape (sample,), the second track: its level at the edges tells the direction.
        rate: Hz.
    """
    if times.size == 0 or second.size == 0:
        return np.zeros(times.size, dtype=bool)
    middle = 0.5 * (float(second.min()) + float(second.max()))
    high = np.interp(times * rate, np.arange(second.size), second) > middle
    return high if 2 * np.count_nonzero(high) < high.size else ~high


def _counted(row: NDArray[np.floating]) -> NDArray[np.float64] | None:
    """Return where a counter counts, in samples; None of a channel that is none.

    Several counts between two samples are spread evenly; of a counter that wraps, the limit is a power of 256.
    """
    ends = row[np.linspace(0, row.size - 1, 65).astype(np.intp)]
    steps = np.diff(ends.astype(np.float64))
    way = 1.0 if np.count_nonzero(steps > 0.0) >= np.count_nonzero(steps < 0.0) else -1.0
    if np.count_nonzero(way * steps < 0.0) > steps.size // 4 or not np.any(steps):
        return None
    change = way * np.diff(row.astype(np.float64))
    back = change < 0.0
    if np.any(back):
        span = float(row.max()) - float(row.min())
        wrap = next((limit for limit in _WRAPS if limit > span), None)
        if wrap is None or np.any(change[back] > -0.5 * wrap):
            return None
        change[back] += wrap
    if change.max() == change.sum() or np.any(change != np.rint(change)):
        return None
    at = np.flatnonzero(change)
    counts = change[at].astype(np.intp)
    if counts.size and counts.max() > 1:
        first = np.repeat(np.cumsum(counts) - counts, counts)
        place = np.arange(int(counts.sum())) - first
        return np.repeat(at, counts) + (place + 0.5) / np.repeat(counts, counts) - 0.5
    return at.astype(np.float64)


def _edges(row: NDArray[np.floating], level: float | None) -> NDArray[np.float64]:
    """Return where the row rises through its threshold, in samples, shape (pulse,)."""
    begins = np.linspace(0, row.size, min(_WINDOWS, row.size), endpoint=False).astype(np.intp)
    least = np.minimum.reduceat(row, begins).astype(np.float64)
    highest = np.maximum.reduceat(row, begins).astype(np.float64)
    while True:
        low, high = _without_single(least), _without_single(highest)
        if _each_holds_pulses(high - low):
            found = _through(row, 0.5 * (low + high), 0.5 * (high - low), level)
            if least.size == 1 or found.size >= _PULSES_A_WINDOW * least.size:
                return found
        least = np.minimum.reduceat(least, np.arange(0, least.size, 2))
        highest = np.maximum.reduceat(highest, np.arange(0, highest.size, 2))


def _each_holds_pulses(span: NDArray[np.float64]) -> bool:
    """Return whether no window has levels much less apart than those beside it; a single window always holds."""
    beside = np.maximum(np.concatenate((span[1:], span[-1:])), np.concatenate((span[:1], span[:-1])))
    return span.size == 1 or bool(np.all(span > 0.0) and np.all(span >= _EMPTY * beside))


def _through(
    row: NDArray[np.floating], middle: NDArray[np.float64], half: NDArray[np.float64], level: float | None
) -> NDArray[np.float64]:
    """Return where the row rises through its threshold, by the middle and the amplitude of windows, (window,) each."""
    usual = float(np.median(half))
    steady = float(np.ptp(middle)) <= _STEADY * usual and float(np.ptp(half)) <= _STEADY * usual
    if level is not None or steady:
        return _crossings(row, float(np.median(middle)) if level is None else level, 2.0 * HYSTERESIS * usual)
    offset, scale = _straight(middle, row), _straight(half, row, least=float(half.min()))
    return _crossings((row - offset) / scale, 0.0, 2.0 * HYSTERESIS)


def _straight(values: NDArray[np.float64], row: NDArray[np.floating], least: float = -np.inf) -> NDArray[np.floating]:
    """Return values of windows, (window,), at the samples of the row, (sample,): straight between their borders."""
    inside = 0.5 * (values[:-1] + values[1:])
    ends = 1.5 * values[[0, -1]] - 0.5 * values[[1, -2]]
    border = np.maximum(np.concatenate((ends[:1], inside, ends[1:])), least).astype(row.dtype)
    length = -(-row.size // values.size)
    ramp = (np.arange(length) / length).astype(row.dtype)
    return (border[:-1, np.newaxis] + np.diff(border)[:, np.newaxis] * ramp).reshape(-1)[: row.size]


def _without_single(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the median of each value and its neighbours, shape as given: what one window shows is left out.

    The ends lie on the line through the two values beside, or at these where they are the nearer to them.
    """
    if values.size < 4:
        return values
    inside = np.median(np.stack((values[:-2], values[1:-1], values[2:])), axis=0)
    ends = (np.median((values[i], inside[i], 2.0 * inside[i] - inside[j])) for i, j in ((0, 1), (-1, -2)))
    return np.concatenate(([next(ends)], inside, [next(ends)]))


def _crossings(row: NDArray[np.floating], level: float, band: float) -> NDArray[np.float64]:
    """Return where the row rises through a level, in samples: from below the band around it to above the band.

    Of several crossings within the band, the middle of the first and the last.
    """
    risen = _begins(row > level + band)
    fallen = _begins(row < level - band, first=True)
    armed = np.unique(np.searchsorted(risen, fallen))
    risen = risen[armed[armed < risen.size]]
    if risen.size == 0:
        return np.zeros(0)
    fallen = fallen[np.searchsorted(fallen, risen) - 1]
    up = _begins(row > level)
    first = up[np.searchsorted(up, fallen, side="right")]
    last = up[np.searchsorted(up, risen, side="right") - 1]
    return 0.5 * (_between(row, first, level) + _between(row, last, level))


def _begins(on: NDArray[np.bool_], *, first: bool = False) -> NDArray[np.intp]:
    """Return the samples at which a condition begins to hold; ``first``: also the first sample where it does."""
    found = np.flatnonzero(on[1:] & ~on[:-1]) + 1
    return np.concatenate(([0], found)) if first and on[0] else found


def _between(row: NDArray[np.floating], after: NDArray[np.intp], level: float) -> NDArray[np.float64]:
    """Return where the row meets the level between the samples ``after`` and those before them."""
    begin, end = row[after - 1].astype(np.float64), row[after].astype(np.float64)
    return after - 1 + (level - begin) / (end - begin)
