"""Columns and rows of times and running numbers: what their names and numbers say of rate and start."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from streams.files.judge import Start
from streams.files.keys import UNIT_IN_NAME
from streams.files.statements import StatedNumber, nice_rate, plain_key
from streams.types import large
from streams.types.large import contiguous, elementwise, forget_pages, is_any
from streams.types.samples import ReaderError
from streams.types.stamps import Stamp, epoch_seconds, utc_text

_WORDS = ("time", "times", "timestamp", "timestamps", "t", "zeit", "zeitstempel", "zeitpunkt", "tempo", "temps",
          "tiempo", "tijd", "xvalue", "elapsed", "elapsedtime", "relativetime", "reltime", "timeoffset", "sampletime",
          "epoch", "epochtime", "unix", "unixtime", "unixtimestamp", "posixtime", "utctime", "timeutc")  # fmt: skip
_ENDS = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds", "sekunden", "ins"), 1.0),
    **dict.fromkeys(("ms", "msec", "millis", "milliseconds", "millisekunden", "inms"), 1e-3),
    **dict.fromkeys(("us", "usec", "micros", "microseconds", "mikrosekunden", "inus"), 1e-6),
    **dict.fromkeys(("ns", "nsec", "nanos", "nanoseconds", "inns"), 1e-9),
    **dict.fromkeys(("min", "minutes"), 60.0),
}
UNITS_OF_TIME = {**_ENDS, "µs": 1e-6, "μs": 1e-6}
"""Units of time as they are written, in s."""
_ALONE = ("millis", "micros", "nanos", "milliseconds", "microseconds", "nanoseconds", "seconds")
_NAMES = dict.fromkeys(_WORDS) | {word + end: size for word in _WORDS for end, size in _ENDS.items()}
_NAMES |= {word: _ENDS[word] for word in _ALONE}
_INDICES = frozenset(("index", "idx", "i", "nr", "no", "n", "lfdnr", "sample", "samples", "sampleno", "samplenr", "row",
                      "samplenumber", "samplenum", "sampleindex", "sampleid", "count", "counter", "number", "nummer",
                      "point", "punkt", "seq", "sequence", "line", "zeile", "record", ""))  # fmt: skip
_MOST_UNCERTAIN, _MIN_FITTED = 5e-5, 256
"""Relative uncertainty from which times state no rate; times from which their slope is fitted."""
_LEAST_RATE = 50.0
"""Hz, least rate of vibration of bearings: times without a unit that give less are in another one."""


@dataclass(frozen=True)
class TimeColumn:
    """What a column of times is counted in: s of one of its units, None where nothing states that."""

    title: str
    size: float | None


def time_column(title: str, unit: str | None = None) -> TimeColumn | None:
    """Return what a title says of a column of times, None where it is not one of times.

    ``unit`` is that of the column where it stands apart; it may also stand in the title, as ``Time (us)`` or
    ``epoch_ms``.
    """
    match = UNIT_IN_NAME.match(title)
    words = plain_key(match[1] if match is not None else title)
    if words not in _NAMES:
        return None
    written = unit or (match[2] if match is not None else "")
    size = UNITS_OF_TIME.get(written.strip("[]() ").lower(), _NAMES[words])
    if written and size is None and written.strip().lower() not in ("", "-", "unix", "utc", "epoch"):
        # ``t [degC]`` is a temperature.
        return None
    return TimeColumn(title, size)


def is_index(title: str, values: NDArray[np.floating]) -> bool:
    """Return whether a column is a running number: it is named so or not at all, and counts by ones."""
    count = len(values)
    named = plain_key(re.sub(r"[\[(].*", "", title)) in _INDICES or title.startswith("column_")
    if not named or count < 8 or values[-1] - values[0] != count - 1:
        return False
    return not is_any(lambda part: np.diff(part) != 1.0, contiguous(values, np.float64))


def is_even(values: NDArray[np.floating]) -> bool:
    """Return whether numbers rise by one step, as times do and vibration never does, within their rounding."""
    count = len(values)
    if count < 8 or not math.isfinite(float(values[-1]) - float(values[0])):
        return False
    step = (float(values[-1]) - float(values[0])) / (count - 1)
    if step <= 0.0 or float(values[1]) <= float(values[0]):
        return False
    ideal = float(values[0]) + step * np.arange(count)
    return bool(np.max(np.abs(values - ideal)) <= 0.51 * step)


def column_statements(
    column: TimeColumn, times: NDArray[np.floating], where: str
) -> tuple[list[StatedNumber], list[Start]]:
    """Return what a column of times states of rate and start.

    Times since 1970 are told by their size; other times without a unit are in s, or in ms or us where s would give a
    rate below 50 Hz: that is open then.

    Raises:
        ReaderError: ``nan``, ``wrong_rate`` where the times do not increase evenly.
    """
    place = f"the times in {column.title!r}" if column.title else "the times"
    first = float(times[0]) if len(times) else 0.0
    by_size = epoch_seconds(first)
    size = column.size or (by_size / first if by_size is not None else 1.0)
    absolute = by_size if column.size is None else _since_1970(first * column.size)
    measured = _measured(_scaled(times, size), where)
    starts: list[Start] = []
    if absolute is not None:
        stamp = Stamp(utc_text(absolute), absolute, absolute, resolution=1e-3)
        starts.append(Start(place, stamp, of_rows=True))
    if measured is None:
        return [], starts
    rate, uncertainty = measured
    if uncertainty < _MOST_UNCERTAIN:
        rate, uncertainty = nice_rate(rate, uncertainty + 1e-12), 0.0
    written = f"{first:.10g}, {float(times[1]):.10g}, ..."
    if rate >= _LEAST_RATE or (column.size is not None and by_size is None):
        return [StatedNumber(place, written, (rate,), uncertainty * rate, is_exact=uncertainty == 0.0)], starts
    others = {1.0, 1e-3, 1e-6} if by_size is None else {1.0, 1e-3, 1e-6, by_size / first}
    return [StatedNumber(place, written, (rate, *(rate * size / other for other in sorted(others - {size}))))], []


def _since_1970(seconds: float) -> float | None:
    return seconds if 1e8 < seconds < 1e11 else None


def _scaled(times: NDArray[np.floating], size: float) -> NDArray[np.floating]:
    return times if size == 1.0 else elementwise(lambda part: part * size, times)


def rate_of_times(times: NDArray[np.floating], where: str) -> float | None:
    """Return the rate in Hz that a column of times in s states.

    None where there are less than two times, or their rounding leaves it uncertain by more than 5e-5 of it.

    Raises:
        ReaderError: as :func:`_measured`.
    """
    found = _measured(times, where)
    return None if found is None or found[1] >= _MOST_UNCERTAIN else nice_rate(found[0], found[1] + 1e-12)


def _measured(times: NDArray[np.floating], where: str) -> tuple[float, float] | None:
    """Return the rate of times in s, in Hz, and its relative uncertainty by their rounding; None for less than two.

    Raises:
        ReaderError: ``nan`` for a time that is no number, ``wrong_rate`` where the times do not increase evenly.
    """
    if len(times) < 2:
        return None
    values = contiguous(times, np.float64)
    if is_any(lambda part: ~np.isfinite(part), values):
        raise ReaderError("nan", f"{where}: a time is not a number")
    span = values[-1] - values[0]
    step = span / (len(values) - 1)
    if not (step > 0.0 and math.isfinite(step)):
        raise ReaderError("wrong_rate", f"{where}: the times do not increase")
    deviation, largest, unit, longest, shortest = _spread_of_times(values, step)
    if longest > max(1.5 * step, 1.01 * unit) or shortest < 0.0:
        raise ReaderError("wrong_rate", f"{where}: the times are not evenly spaced; the longest step is {longest:g} s")
    rounding = max(deviation, float(np.spacing(largest)))
    uncertainty = 2.0 * rounding / span
    if uncertainty >= _MOST_UNCERTAIN and len(values) >= _MIN_FITTED:
        # The ends alone are too coarse; the slope of all of them is finer by the root of their number.
        step, uncertainty = _slope(values), 8.0 * rounding / (span * math.sqrt(len(values)))
    return 1.0 / step, uncertainty


def _slope(times: NDArray[np.float64]) -> float:
    """Return the step in s of times by least squares."""
    place = np.arange(len(times)) - 0.5 * (len(times) - 1)
    return float(place @ (times - times[0]) / (place @ place))


def _spread_of_times(times: NDArray[np.float64], step: float) -> tuple[float, float, float, float, float]:
    """Return of times that should have one step: the largest deviation from that and the largest amount, then of the
    steps the least above 0, the largest and the least; all in s, computed piece by piece.
    """
    deviation = largest = 0.0
    unit, longest, shortest = math.inf, -math.inf, math.inf
    count = max(2, large.PIECE_BYTES // times.dtype.itemsize)
    for begin in range(0, len(times) - 1, count - 1):
        part = times[begin : begin + count]
        ideal = times[0] + step * np.arange(begin, begin + len(part))
        deviation = max(deviation, float(np.max(np.abs(part - ideal))))
        largest = max(largest, float(np.max(np.abs(part))))
        steps = np.diff(part)
        # Times written more coarsely than the sampling interval repeat themselves, then jump by one unit.
        unit = min(unit, float(np.min(steps[steps > 0.0], initial=math.inf)))
        longest, shortest = max(longest, float(np.max(steps))), min(shortest, float(np.min(steps)))
        forget_pages(times)
    return deviation, largest, unit, longest, shortest
