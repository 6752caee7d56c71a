"""The head of a text of numbers, and rows that begin with a date and time of day, as loggers write them."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from streams.files.axes import AXES
from streams.files.formats.numbers import first_line_of, is_number
from streams.files.keys import KEYS, OTHER_UNITS, UNIT_IN_NAME, UNIT_KEYS
from streams.files.statements import (
    Facts,
    add_fact,
    is_date,
    is_of_vibration,
    known_unit,
    plain_key,
    time_statements,
)
from streams.files.time_column import time_column
from streams.types.samples import ReaderError, Samples
from streams.types.stamps import CLOCK, DATE, Stamp, read_stamp

MAX_HEAD_LINES = 200
_MAX_SNIFFED_CHARACTERS = 1 << 16
_SECONDS = ("s", "sec", "second", "seconds", "ms", "us", "µs", "ns")
_FACT = re.compile(r"\s*[#%\"]*\s*([A-Za-z][^:=;\t,]{0,60}?)\s*[:=;\t,]\s*(.*?)[\"\s;,]*$")
_CLOCK_IN_VALUE = re.compile(r"\d:\d\d,\d+$|\d,\s*\d{1,2}:\d\d")
_UNIT_BEHIND = re.compile(r"^(.*?)(?:\s+in\s+|\s*/\s*)(\S.*?)\s*$")
"""A name with its unit as in ``Zeit/s`` and ``Beschleunigung in m/s²``."""


def decoded(line: bytes) -> str:
    """Return a line of UTF-8 or, where it is none, of Windows-1252."""
    try:
        return line.decode("utf-8")
    except UnicodeDecodeError:
        return line.decode("cp1252", "replace")


@dataclass
class Head:
    """What stands above the numbers.

    Attributes:
        facts: what is stated of all columns, ``of_columns`` of each, none where that is not so.
        names, units: of the columns, by a line of each.
        lines: how many there are.
        title: the line of names.
        decimal: decimal sign of the numbers below.
        size_of_times: unit of a column of times, s, where the format defines it.
        separators: of columns that are possible there, a blank for any run of them.
        promised: number of rows that are stated to follow at least, 0 where none is.
    """

    facts: dict[str, object] = field(default_factory=dict)
    names: tuple[str, ...] | None = None
    units: tuple[str | None, ...] | None = None
    lines: int = 0
    title: str = ""
    of_columns: tuple[Facts, ...] = ()
    decimal: str = "."
    size_of_times: float | None = None
    separators: str = ";\t, "
    promised: int = 0


def cut_head(body: bytes, name: str) -> tuple[bytes, list[str]]:
    """Cut the text before its first line of numbers."""
    skipped: list[str] = []
    begin = 0
    while begin < len(body) and len(skipped) <= MAX_HEAD_LINES:
        line = first_line_of(body, begin)
        if _is_numbers(decoded(line).strip()):
            return (body[begin:] if begin else body), skipped
        skipped.append(_line_of(line))
        begin += len(line) + 1
    if any(skipped):
        first = next(line for line in skipped if line)
        shown = re.sub(r"[^ -~]", "?", first[:30])
        status = "empty" if len(skipped) <= 3 and begin >= len(body) else "unreadable"
        raise ReaderError(status, f"{name}: line 1: expected a number or a header above numbers, found {shown!r}")
    raise ReaderError("empty", f"{name}: no line of numbers")


def _line_of(line: bytes) -> str:
    """Return a line without the blanks around it; a tab before it stands behind a name that is empty."""
    return decoded(line).rstrip().lstrip(" ")


def _is_numbers(line: str) -> bool:
    filled = [field for field in _fields(line[:_MAX_SNIFFED_CHARACTERS]) if field]
    return bool(filled) and is_number(filled[0]) and sum(map(is_number, filled)) * 2 >= len(filled)


def _fields(line: str) -> list[str]:
    separator = next((c for c in ";\t" if c in line), None)
    if separator is None:
        separator = "," if "," in line else None
    return [part.strip().strip('"') for part in line.split(separator)]


def head_of(lines: list[str]) -> Head:
    """Return what the lines above the numbers state."""
    head = Head(lines=len(lines))
    kept = [line for line in lines if line.strip()]
    titles = [line for line in kept[-2:] if not line.startswith(("#", "%", "***"))]
    both = [_fields(line) for line in titles]
    if len(both) == 2 and len(both[1]) == 1 and not re.search(r"[;\t,]", titles[0]):
        # One column, whose name may hold blanks.
        both[0] = [titles[0].strip().strip('"')]
    if (
        len(both) == 2
        and len(both[0]) == len(both[1])
        and _are_units(both[1])
        and not (_is_fact(titles[0]) or _is_axis(both[1]))
    ):
        head.names = tuple(both[0])
        head.units = tuple(known_unit(unit) for unit in both[1])
        kept = kept[:-2]
    elif titles and titles[-1] == kept[-1] and not _is_fact(titles[-1]):
        head.names, head.title = tuple(_fields(titles[-1])), titles[-1]
        kept = kept[:-1]
    for line in itertools.chain.from_iterable(map(_pairs, kept)):
        match = _FACT.match(line)
        if match is not None:
            text = match[2].strip('"')
            whole = is_number(text.split(" ")[0]) or _CLOCK_IN_VALUE.search(text)
            value = text if whole else _value_of(text, is_axis=plain_key(match[1]) in AXES)
            add_fact(head.facts, plain_key(match[1]), value.strip().strip('"'), f"{match[1].strip()} (again)")
    return head


def _pairs(line: str) -> list[str]:
    """Return a line as lines of one key each, where keys and values take turns in its fields."""
    fields = _fields(line)
    keys = [plain_key(field) for field in fields[::2]]
    both = len(fields) >= 4 and len(fields) % 2 == 0 and all(key in KEYS for key in keys)
    return [f"{key}\t{value}" for key, value in zip(fields[::2], fields[1::2], strict=True)] if both else [line]


def _value_of(text: str, *, is_axis: bool) -> str:
    """Return the value of a key: its first field, with the next one where that is the unit of a number or an axis."""
    separator = next((sign for sign in ";\t," if sign in text), ",")
    fields = [part.strip().strip('"') for part in text.split(separator)]
    if is_axis:
        return " ".join(fields)
    has_unit = len(fields) > 1 and is_number(fields[0]) and re.fullmatch(r"[^\d\W][^\s;,]{0,11}", fields[1])
    return f"{fields[0]} {fields[1]}" if has_unit else fields[0]


def titles_with_blanks(line: str, width: int) -> tuple[str, ...] | None:
    """Return names that hold blanks, such as ``acc [g]``, of a line without separators; None where they do not fit."""
    if width == 1:
        return None if any(separator in line for separator in ";\t,") else (line.strip().strip('"'),)
    names = re.findall(r"\S+(?:\s+[\[(][^\])]*[\])])?", line)
    return tuple(name.strip('"') for name in names) if len(names) == width else None


def _are_units(fields: list[str]) -> bool:
    bare = [part.strip("[]() ") for part in fields]
    known = any(is_of_vibration(known_unit(part)) for part in bare) or bare[0].lower() in _SECONDS
    return known and all(len(part) <= 12 for part in bare)


def _is_axis(fields: list[str]) -> bool:
    return plain_key(fields[0]) in AXES


def _is_fact(line: str) -> bool:
    """Return whether a line is metadata: one value, and a known key or a number."""
    match = _FACT.match(line)
    if match is None:
        return False
    key, value = plain_key(match[1]), match[2].strip('" ')
    dated = bool(time_statements({key: value}, "UTC")) or is_date(value)
    is_known = key in AXES or (key in UNIT_KEYS and is_of_vibration(known_unit(value)))
    return ":" in line or "=" in line or dated or is_number(value.split(" ")[0]) or is_known


def names_and_units(samples: Samples, head: Head) -> tuple[tuple[str, ...], tuple[str, ...], list[StatedUnits]]:
    """Return titles, names and stated units of the columns; a title is its name, or names the unit behind it."""
    if head.names is None:
        return samples.names, samples.names, [[] for _ in samples.names]
    names: list[str] = []
    units: list[StatedUnits] = []
    for index, title in enumerate(head.names):
        match = UNIT_IN_NAME.match(title) or _UNIT_BEHIND.match(title)
        unit = known_unit(match[2]) if match is not None else None
        below = None if head.units is None else head.units[index]
        own: StatedUnits = [] if below is None else [(f"the line of units, {title!r},", below)]
        if match is not None and unit is not None and (is_of_vibration(unit) or time_column(match[1], unit)):
            title = match[1].strip() or title
            own.append((f"the name {head.names[index]!r}", unit))
        elif unit is not None and unit.lower() in OTHER_UNITS:
            own.append((f"the name {head.names[index]!r}", unit))
        names.append(title)
        units.append(own)
    # A configuration may name a column with its unit, as it stands in the file, or without.
    return tuple(head.names), tuple(names), units


StatedUnits = list[tuple[str, str]]
"""Units of a column, each with its place."""
_MAX_UNEVEN = 200_000
"""Rows whose stamps differ in width: they are read one by one."""
_MAX_PREFIX = 48
_DAY = 86400.0
_FIXED = re.compile(r"(\d\d):(\d\d):(\d\d)(?:[.,](\d{1,9}))?$")
_HALF = re.compile(r"[AaPp]\.?\s?[Mm]")


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
    begin, head, separator, columns = found
    rows = body[begin:].rstrip(b"\r\n ").split(b"\n")
    sign = separator.encode()
    stamps: list[bytes] = []
    numbers: list[bytes] = []
    for row in rows:
        parts = row.split(sign, columns)
        if len(parts) <= columns:
            where = len(head) + len(numbers) + 1
            raise ReaderError("unreadable", f"{name}: line {where}: expected a date and numbers, found {row[:30]!r}")
        stamps.append(b" ".join(part.strip().strip(b'"') for part in parts[:columns]))
        numbers.append(parts[columns])
    first = stamps[0].decode("latin-1")
    times = _even_times(stamps, zone) if not _HALF.search(first) else None
    if times is None:
        times = _uneven_times(stamps, name, zone, len(head) + 1)
    end = b"\n" if body.endswith(b"\n") else b""
    return StampedRows(b"\n".join(numbers) + end, head, times, read_stamp(first, zone), columns, separator)


def lines_above_stamps(body: bytes, zone: str) -> list[str] | None:
    """Return the lines above the first row that begins with a stamp, None where the first row of numbers has none.

    Arguments as of :func:`split_stamps`.
    """
    found = _first_row(body, zone)
    return None if found is None else found[1]


def _first_row(body: bytes, zone: str) -> tuple[int, list[str], str, int] | None:
    """Return where rows with stamps begin, the lines above, the separator, and the columns of a stamp."""
    head: list[str] = []
    begin = 0
    while begin < len(body) and len(head) <= MAX_HEAD_LINES:
        line = first_line_of(body, begin)
        following = first_line_of(body, begin + len(line) + 1)
        text = line[: 4 * _MAX_PREFIX].decode("utf-8", "replace").strip()
        if is_number(re.split(r"[;\t, ]", text, maxsplit=1)[0]):
            return None
        for separator in ";\t, ":
            columns = _stamp_columns(text, separator, zone)
            if columns and _stamp_columns(following.decode("utf-8", "replace").strip(), separator, zone) == columns:
                return begin, head, separator, columns
        head.append(_line_of(line))
        begin += len(line) + 1
    return None


def _stamp_columns(line: str, separator: str, zone: str) -> int:
    """Return how many columns of a line are its stamp, 0 where it has none or no number behind it."""
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
    return _is_numbers(text) or any(_stamp_columns(text, separator, zone) for separator in ";\t, ")


def _even_times(stamps: Sequence[bytes], zone: str) -> NDArray[np.float64] | None:
    """Return the times of stamps of one width and one layout, s from the first; None where they are not such."""
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
        if group == 3 and (whole == 60).any():
            # Behind a leap second, the clock is one second behind the time that has passed.
            seconds[np.flatnonzero(whole == 60)[-1] + 1 :] += 1.0
    dates = [stamp[: clock.start()] for stamp in stamps]
    days = _days(dates, first[clock.start() :], zone)
    if days is None:
        return None
    return seconds - seconds[0] + days


def _days(dates: Sequence[bytes], clock: str, zone: str) -> NDArray[np.float64] | None:
    """Return the days of dates from the first one, in s; midnight is not crossed where there is no date."""
    known: dict[bytes, float] = {}
    if not dates[0].strip():
        return np.zeros(len(dates))
    first = read_stamp((dates[0].decode("latin-1") + clock).strip(), zone)
    for date in dict.fromkeys(dates):
        stamp = read_stamp((date.decode("latin-1") + clock).strip(), zone)
        if first is None or stamp is None:
            return None
        steps = [
            after - before
            for after, before in ((stamp.day_first, first.day_first), (stamp.month_first, first.month_first))
            if after is not None and before is not None
        ]
        if not steps:
            return None
        known[date] = min(steps, key=abs)
    return np.array([known[date] for date in dates])


def _uneven_times(stamps: Sequence[bytes], name: str, zone: str, line: int) -> NDArray[np.float64]:
    """Return the times of stamps one by one, s from the first."""
    if len(stamps) > _MAX_UNEVEN:
        raise ReaderError("refused", f"{name}: {len(stamps)} stamps of different widths, {_MAX_UNEVEN} are allowed")
    times = np.full((2, len(stamps)), np.nan)
    for index, raw in enumerate(stamps):
        text = raw.decode("latin-1")
        has_date = DATE.match(text) is not None or read_stamp(text, zone) is not None
        stamp = read_stamp(text if has_date else f"1970-01-02 {text}", zone)
        if stamp is None:
            raise ReaderError("unreadable", f"{name}: line {line + index}: expected a date, found {text[:30]!r}")
        times[:, index] = [np.nan if time is None else time for time in (stamp.day_first, stamp.month_first)]
    # Of two orders of day and month, that of consecutive rows is the one without jumps.
    spans = [float("inf") if np.isnan(row).any() else float(np.ptp(row)) for row in times]
    return times[int(np.argmin(spans))] - times[int(np.argmin(spans)), 0]
