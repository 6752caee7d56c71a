"""Rows of a text that begin with a date and time of day, as loggers write them."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from streams.files.abscissa import abscissa_called
from streams.files.formats.head import MAX_HEAD_LINES, decoded, is_numbers, line_of
from streams.files.formats.numbers import first_line_of, is_number
from streams.files.statements import is_date
from streams.types.samples import ReaderError
from streams.types.stamps import CLOCK, DATE, ORDERS, Order, Stamp, read_stamp

_MAX_UNEVEN = 200_000
"""Rows whose stamps differ in width: they are read one by one."""
_MAX_PREFIX = 48
_DAY = 86400.0
_FIXED = re.compile(r"(\d\d):(\d\d):(\d\d)(?:[.,](\d{1,9}))?(?: ([AaPp])[Mm])?$")
_NUMBERED = re.compile(r"\"?\d{1,7}\"?\s*[;\t,](?!\s*\"?\d+\"?\s*[;\t,])")
"""A running number before the stamp of a row."""
_Times = tuple[NDArray[np.float64], Sequence[Order]]
"""Times of rows, s from the first one, and the orders of day, month and year by which they follow each other."""


@dataclass(frozen=True)
class StampedRows:
    """A text whose rows began with a stamp.

    Attributes:
        body: the rows without their stamps.
        head: the lines above them.
        times: of each row, s from the first one.
        start: date and time of the first row; None where rows have a time of day alone.
        columns: how many columns the stamp took: 2 where date and time of day were apart.
        separator: of columns, which need not be in what is left.
    """

    body: bytes
    head: list[str]
    times: NDArray[np.float64]
    start: Stamp | None
    columns: int
    separator: str


def split_stamps(body: bytes, name: str, zone: str) -> StampedRows | None:
    """Cut the stamps off the rows of a text; None where its rows do not begin with one.

    Args:
        body: text with LF or CRLF, as :func:`streams.files.formats.text.clean_text` gives it.
        zone: IANA name of the zone of stamps that name none.

    Raises:
        ReaderError: ``unreadable`` for a row without a stamp below those that have one.
    """
    found = _first_row(body, zone)
    if found is None:
        return None
    begin, head, separator, columns, numbered = found
    rows = body[begin:].rstrip(b"\r\n ").split(b"\n")
    sign = separator.encode()
    stamps: list[bytes] = []
    numbers: list[bytes] = []
    for row in rows:
        parts = row.split(sign, columns)
        if len(parts) <= columns:
            where = len(head) + len(numbers) + 1
            raise ReaderError("unreadable", f"{name}: line {where}: expected a date and numbers, found {row[:30]!r}")
        stamps.append(b" ".join(part.strip().strip(b'"') for part in parts[numbered:columns]))
        numbers.append(parts[columns])
    start = read_stamp(stamps[0].decode("latin-1"), zone)
    found = _even_times(stamps, zone)
    if found is None:
        found = _uneven_times(stamps, name, zone, len(head) + 1)
    times, orders = found
    size = _size_of_fractions(head, separator, columns)
    if size is not None and not np.any(times % 1.0):
        # A column of its own has the milliseconds of the stamps.
        both = [row.split(sign, 1) for row in numbers]
        with contextlib.suppress(ValueError, IndexError):
            times = times + [size * float(part.replace(b",", b".")) for part, _ in both]
            numbers, columns = [rest for _, rest in both], columns + 1
    end = b"\n" if body.endswith(b"\n") else b""
    start = start and start.only(orders)
    return StampedRows(b"\n".join(numbers) + end, head, times, start, columns, separator)


def _size_of_fractions(head: list[str], separator: str, columns: int) -> float | None:
    """Return the unit in s of the column behind the stamps, where its name is one of fractions of a second."""
    names = [part.strip().strip('"') for part in head[-1].split(separator)] if head else []
    if len(names) <= columns:
        return None
    axis = abscissa_called(names[columns], "")
    return axis.size if axis.size is not None and axis.size < 1.0 else None


def lines_above_stamps(body: bytes, zone: str) -> list[str] | None:
    """Return the lines above the first row that begins with a stamp, None where the first row of numbers has none.

    Arguments as of :func:`split_stamps`.
    """
    found = _first_row(body, zone)
    return None if found is None else found[1]


def _first_row(body: bytes, zone: str) -> tuple[int, list[str], str, int, int] | None:
    """Return where rows with stamps begin, the lines above, the separator, and the columns up to the end of a stamp.

    The last is how many of these have a running number: 0 or 1.
    """
    head: list[str] = []
    begin = 0
    while begin < len(body) and len(head) <= MAX_HEAD_LINES:
        line = first_line_of(body, begin)
        following = first_line_of(body, begin + len(line) + 1)
        text = line[: 4 * _MAX_PREFIX].decode("utf-8", "replace").strip()
        below = following.decode("utf-8", "replace").strip()
        for separator in ";\t, ":
            columns = _stamp_columns(text, separator, zone)
            if columns and _stamp_columns(below, separator, zone) == columns:
                return begin, head, separator, columns, int(_NUMBERED.match(text) is not None)
        if is_number(re.split(r"[;\t, ]", text, maxsplit=1)[0]):
            return None
        head.append(line_of(line))
        begin += len(line) + 1
    return None


def _stamp_columns(line: str, separator: str, zone: str) -> int:
    """Return how many columns of a line its stamp takes, with a running number before it; 0 where it has none.

    A number must stand behind it.
    """
    if separator != " " and _NUMBERED.match(line):
        behind = _stamp_columns(line.partition(separator)[2], separator, zone)
        return behind and behind + 1
    fields = [part.strip().strip('"') for part in line[: 4 * _MAX_PREFIX].split(separator)]
    if len(fields) >= 3 and is_date(fields[0]) and CLOCK.fullmatch(fields[1]):
        columns = 2
    elif len(fields) >= 2 and ":" in fields[0] and (CLOCK.fullmatch(fields[0]) or read_stamp(fields[0], zone)):
        columns = 1
    else:
        return 0
    return columns if is_number(fields[columns]) else 0


def is_row(line: bytes, zone: str) -> bool:
    """Return whether a line is one of numbers, alone or behind a stamp; ``zone`` is that of stamps."""
    text = decoded(line).strip()
    return is_numbers(text) or any(_stamp_columns(text, separator, zone) for separator in ";\t, ")


def _even_times(stamps: Sequence[bytes], zone: str) -> _Times | None:
    """Return the times of stamps of one width and one layout; None where they are not such."""
    first = stamps[0].decode("latin-1")
    clock = _FIXED.search(first)
    width = len(stamps[0])
    if clock is None or any(len(stamp) != width for stamp in stamps):
        return None
    signs = np.frombuffer(b"".join(stamps), np.uint8).reshape(len(stamps), width)
    digits = signs.astype(np.int64) - ord("0")
    seconds = np.zeros(len(stamps))
    for group, unit in ((1, 3600.0), (2, 60.0), (3, 1.0), (4, 1.0)):
        low, high = clock.span(group)
        if low < 0:
            continue
        part = digits[:, low:high]
        if (part < 0).any() or (part > 9).any():
            return None
        whole = part @ 10 ** np.arange(high - low - 1, -1, -1)
        seconds += whole * (unit * 10.0 ** (low - high) if group == 4 else unit)
        if group == 1 and clock[5]:
            late = np.frombuffer(b"".join(stamp[clock.start(5) : clock.end(5)].lower() for stamp in stamps), np.uint8)
            seconds += 3600.0 * (12.0 * (late == ord("p")) - 12.0 * (whole == 12))
        if group == 3 and (whole == 60).any():
            # Behind a leap second, the clock is one second behind the time that has passed.
            seconds[np.flatnonzero(whole == 60)[-1] + 1 :] += 1.0
    dates = [stamp[: clock.start()] for stamp in stamps]
    days = _days(dates, first[clock.start() :], zone)
    if days is None:
        return None
    return seconds - seconds[0] + days[0], days[1]


def _days(dates: Sequence[bytes], clock: str, zone: str) -> _Times | None:
    """Return the days of dates from the first one, in s; midnight is not crossed where there is no date."""
    if not dates[0].strip():
        return np.zeros(len(dates)), ORDERS
    places = {date: place for place, date in enumerate(dict.fromkeys(dates))}
    stamps = [read_stamp((date.decode("latin-1") + clock).strip(), zone) for date in places]
    if any(stamp is None for stamp in stamps):
        return None
    found = _without_jumps([stamp for stamp in stamps if stamp is not None])
    return found and (found[0][[places[date] for date in dates]], found[1])


def _without_jumps(stamps: Sequence[Stamp]) -> _Times | None:
    """Return the times of stamps by the order in which rows that follow each other have no jumps; None for no order."""
    spans: dict[Order, float] = {}
    times: dict[Order, NDArray[np.float64]] = {
        order: np.array([stamp.at(order) for stamp in stamps], float) for order in ORDERS
    }
    for order, row in times.items():
        if not np.isnan(row).any():
            spans[order] = float(np.ptp(row))
    if not spans:
        return None
    best = min(spans, key=spans.__getitem__)
    return times[best] - times[best][0], [order for order in spans if spans[order] < spans[best] + _DAY]


def _uneven_times(stamps: Sequence[bytes], name: str, zone: str, line: int) -> _Times:
    """Return the times of stamps one by one."""
    if len(stamps) > _MAX_UNEVEN:
        raise ReaderError("refused", f"{name}: {len(stamps)} stamps of different widths, {_MAX_UNEVEN} are allowed")
    read: list[Stamp] = []
    for index, raw in enumerate(stamps):
        text = raw.decode("latin-1")
        has_date = DATE.match(text) is not None or read_stamp(text, zone) is not None
        stamp = read_stamp(text if has_date else f"1970-01-02 {text}", zone)
        if stamp is None:
            raise ReaderError("unreadable", f"{name}: line {line + index}: expected a date, found {text[:30]!r}")
        read.append(stamp)
    found = _without_jumps(read)
    if found is None:
        raise ReaderError("unreadable", f"{name}: the dates of its rows have no common order of day, month and year")
    return found
