"""Dates and times as loggers write them, in headers and in names of files; the order of day and month."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta, timezone, tzinfo
from functools import lru_cache
from typing import Literal, get_args
from zoneinfo import ZoneInfo

import numpy as np

Order = Literal["day_first", "month_first"]
ORDERS: tuple[Order, ...] = get_args(Order)

_MAX_TEXT = 64
_WITH_MONTH_NAME = (
    *("%d-%b-%y %H:%M:%S", "%d-%b-%Y %H:%M:%S", "%d %b %Y %H:%M:%S", "%b %d, %Y %H:%M:%S"),
    *("%a %b %d %H:%M:%S %Y", "%d %B %Y %H:%M:%S"),
)
_DATE = r"(?P<a>\d{1,4})(?P<sep>[-/.])\s?(?P<b>\d{1,2})(?P=sep)\s?(?P<c>\d{4}|\d{1,2})"
_CLOCK = (
    r"(?P<H>\d{1,2})[:.h](?P<M>\d{2})(?:[:.](?P<S>\d{2})(?:[.,:](?P<f>\d{1,9}))?)?"
    r"\s*(?P<half>[AaPp]\.?\s?[Mm]\.?)?(?:\s*Uhr)?"
)
_ZONE = r"\s*(?P<zone>Z|UTC|GMT|[+-]\d{2}:?\d{2})?"
_WRITTEN = re.compile(rf"{_DATE}(?:\s*[T,;_\s]\s*|-){_CLOCK}{_ZONE}")
DATE = re.compile(_DATE)
"""A date in numbers alone."""
CLOCK = re.compile(_CLOCK + _ZONE)
"""A time of day alone."""

_CLOCK_IN_NAME = (
    r"(?P<H>\d\d)(?:(?P<t>[-_.:h])(?P<M>\d\d)(?:[-_.:m](?P<S>\d\d)(?:[-_.,](?P<f>\d{6}|\d{3}))?)?"
    r"|(?P<M2>\d\d)(?P<S2>\d\d)(?:[-_.,]?(?P<f2>\d{6}|\d{3}))?)"
    r"(?:[-_ ]?(?P<half>[AaPp][Mm]))?(?P<zone>Z|\+\d\d:?\d\d)?(?!\d)"
)
_IN_NAMES = tuple(
    re.compile(rf"(?<!\d){date}{_CLOCK_IN_NAME}")
    for date in (
        # 2024-01-31T23-59-59, 2024.01.31.23.59.59, 20240131_235959, 20240131235959
        r"(?P<a>(?:19|20)\d\d)(?P<sep>[-_.]?)(?P<b>\d\d)(?P=sep)(?P<c>\d\d)[-_. T/]*",
        # 31.01.2024 23.59.59, 01-31-2024_11-59-59 PM
        r"(?P<a>\d\d?)(?P<sep>[-_.])(?P<b>\d\d?)(?P=sep)(?P<c>(?:19|20)\d\d)[-_. T/]+",
    )
)
"""The usual dates in names of files."""

_DIRECTIVES = {
    "Y": r"\d{4}",
    "y": r"\d\d",
    "j": r"\d{3}",
    "f": r"\d{1,6}",
    "p": r"[AaPp][Mm]",
    "%": "%",
    **dict.fromkeys("mdHIMS", r"\d\d?"),
    "b": r"[^\W\d_]{3,4}",
    "B": r"[^\W\d_]+",
    "z": r"(?:Z|[+-]\d\d:?\d\d)",
}


@dataclass(frozen=True)
class Stamp:
    """A date and time as written, with its readings in s since 1970 UTC.

    Attributes:
        day_first, month_first: by the order of day and month, None where the text cannot be read so. Where the text
            leaves no choice (ISO, a name of a month, dots, which stand for day first) both are the same.
        open: whether the order of day and month is not stated by the way of writing.
    """

    text: str
    day_first: float | None
    month_first: float | None
    open: bool = False

    @property
    def fixed(self) -> float | None:
        """The time where the order of day and month does not matter, or None."""
        return self.day_first if self.day_first == self.month_first else None

    @property
    def orders(self) -> tuple[Order, ...]:
        """The orders in which the text can be read."""
        return tuple(order for order in ORDERS if self.at(order) is not None)

    def at(self, order: Order) -> float | None:
        """Return the time by an order of day and month, or None."""
        return self.day_first if order == "day_first" else self.month_first


def utc_text(seconds: float) -> str:
    """Return seconds since 1970 UTC in ISO 8601, to the millisecond."""
    try:
        moment = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(milliseconds=round(1e3 * seconds))
    except (OverflowError, ValueError):
        return f"{seconds:g} s since 1970 UTC"
    return moment.isoformat(timespec="milliseconds" if moment.microsecond else "seconds").replace("+00:00", "Z")


def read_stamp(value: object, zone: str) -> Stamp | None:
    """Return a stamp of a header, as ISO 8601, in numbers or with a name of a month; None where it is none.

    ``zone`` is the IANA name of the zone of a stamp that names none.
    """
    if isinstance(value, np.datetime64):
        seconds = float((value - np.datetime64(0, "s")) / np.timedelta64(1, "s"))
        return _fixed(str(value), seconds if math.isfinite(seconds) else None)
    if isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool):
        # Smaller numbers are seconds from something else.
        return _fixed(str(value), float(value) if 1e8 < value < 1e11 else None)
    if isinstance(value, datetime):
        return _fixed(str(value), _seconds(value, zone))
    if not isinstance(value, str):
        return None
    text = value.strip()[:_MAX_TEXT]
    try:
        return _fixed(text, _seconds(datetime.fromisoformat(text), zone))
    except ValueError:
        pass
    match = _WRITTEN.fullmatch(text)
    if match is not None:
        return _in_numbers(text, match, zone)
    for pattern in _WITH_MONTH_NAME:
        try:
            return _fixed(text, _seconds(datetime.strptime(text, pattern), zone))
        except ValueError:
            continue
    return None


def _fixed(text: str, seconds: float | None) -> Stamp | None:
    return None if seconds is None else Stamp(text, seconds, seconds)


def _seconds(moment: datetime, zone: str | tzinfo) -> float | None:
    try:
        inside = ZoneInfo(zone) if isinstance(zone, str) else zone
        return (moment if moment.tzinfo else moment.replace(tzinfo=inside)).timestamp()
    except (OverflowError, ValueError, OSError):
        return None


def _in_numbers(text: str, match: re.Match[str], zone: str) -> Stamp | None:
    """Return the stamp of a date in numbers, None where it has no valid reading."""
    parts = match.groupdict()
    a, b, c, separator = parts["a"], parts["b"], parts["c"], parts["sep"]
    if len(a) == 4:
        return _fixed(text, _at(int(a), b, c, parts, zone)) if len(c) <= 2 else None
    if len(a) > 2 or len(c) == 1 or (len(c) == 2 and separator == "-"):
        # 24-03-04 may begin with the year, too.
        return None
    year = int(c) if len(c) == 4 else int(c) + (2000 if int(c) < 70 else 1900)
    day_first, month_first = _at(year, b, a, parts, zone), _at(year, a, b, parts, zone)
    if separator == "." and day_first is not None:
        return _fixed(text, day_first)
    if day_first is None and month_first is None:
        return None
    return Stamp(text, day_first, month_first, open=True)


def _at(year: int, month: str, day: str, parts: Mapping[str, str | None], zone: str) -> float | None:
    hour, half = int(parts["H"] or 0), (parts.get("half") or "")[:1].lower()
    minute, second = (int(parts.get(key) or parts.get(f"{key}2") or 0) for key in "MS")
    if half and not 1 <= hour <= 12:
        return None
    if half:
        hour = hour % 12 + (12 if half == "p" else 0)
    fraction = parts.get("f") or parts.get("f2") or ""
    try:
        moment = datetime(year, int(month), int(day), hour, minute, second, int(f"{fraction:0<6}"[:6]))
        return _seconds(moment, _offset(parts.get("zone")) or zone)
    except ValueError:
        return None


def _offset(text: str | None) -> tzinfo | None:
    if not text:
        return None
    if text in ("Z", "UTC", "GMT"):
        return UTC
    digits = text.replace(":", "")
    minutes = 60 * int(digits[1:3]) + int(digits[3:5])
    return timezone(timedelta(minutes=-minutes if text[0] == "-" else minutes))


def stamp_in_name(path: str, zone: str, pattern: str | None = None) -> Stamp | None:
    """Return the date and time in the name of a file, or in the name with its folder; None without one.

    ``pattern`` is that of :func:`datetime.strptime` for a part of the path; None: one of the usual dates. A name with
    two different dates has none.
    """
    name = path.rpartition("/")[2]
    folder = path.rpartition("/")[0].rpartition("/")[2]
    for text in (name, f"{folder}/{name}" if pattern is None else path):
        found = _found_usual(text, zone) if pattern is None else _found_by(text, zone, pattern)
        if found:
            first = found[0]
            return (
                first
                if all((s.day_first, s.month_first) == (first.day_first, first.month_first) for s in found)
                else None
            )
    return None


def _found_usual(text: str, zone: str) -> list[Stamp]:
    matches = (match for pattern in _IN_NAMES for match in pattern.finditer(text))
    return [stamp for match in matches if (stamp := _in_numbers(match[0], match, zone)) is not None]


def _found_by(text: str, zone: str, pattern: str) -> list[Stamp]:
    found: list[Stamp] = []
    for match in compiled(pattern).finditer(text):
        try:
            moment = datetime.strptime(match[0], pattern)
        except ValueError:
            continue
        stamp = _fixed(match[0], _seconds(moment, zone))
        found += [] if stamp is None else [stamp]
    return found


@lru_cache(maxsize=16)
def compiled(pattern: str) -> re.Pattern[str]:
    """Return the expression that finds a strptime pattern in a text.

    Raises:
        ValueError: it has another directive than those known, or no year, month and day.
    """
    parts = re.split(r"%(.)", pattern)
    names = parts[1::2]
    unknown = [name for name in names if name not in _DIRECTIVES]
    if unknown or (pattern.endswith("%") and not pattern.endswith("%%")):
        known = " ".join(f"%{name}" for name in _DIRECTIVES)
        raise ValueError(f"{pattern!r}: %{''.join(unknown[:1])} is not known; expected {known}")
    has_day = "j" in names or ("d" in names and {"m", "b", "B"} & set(names))
    if not (has_day and {"Y", "y"} & set(names)):
        raise ValueError(f"{pattern!r}: expected year, month and day, such as %Y%m%d_%H%M%S")
    if any(names.count(name) > 1 for name in names if name != "%"):
        raise ValueError(f"{pattern!r}: a directive is given twice")
    body = "".join(re.escape(part) if index % 2 == 0 else _DIRECTIVES[part] for index, part in enumerate(parts))
    return re.compile(rf"(?<!\d){body}(?!\d)")


def evidence(stamps: Iterable[tuple[str, Stamp]]) -> dict[Order, str]:
    """Return the orders of day and month that stamps decide, each with the path and text of the first that does."""
    found: dict[Order, str] = {}
    for path, stamp in stamps:
        if stamp.open and len(stamp.orders) == 1:
            found.setdefault(stamp.orders[0], f"{path} ({stamp.text!r})")
    return found
