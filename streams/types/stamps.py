"""Dates and times as loggers write them, in headers and in names of files; the order of day, month and year."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta, timezone, tzinfo
from functools import lru_cache
from typing import Literal, get_args
from zoneinfo import ZoneInfo

import numpy as np

from streams.types.spellings import ZONE_HOURS, in_signs

Order = Literal["day_first", "month_first", "year_first"]
ORDERS: tuple[Order, ...] = get_args(Order)

_MAX_TEXT = 64
_WITH_MONTH_NAME = (
    *("%d-%b-%y %H:%M:%S", "%d-%b-%Y %H:%M:%S", "%d %b %Y %H:%M:%S", "%b %d, %Y %H:%M:%S"),
    *("%a %b %d %H:%M:%S %Y", "%d %B %Y %H:%M:%S", "%d-%b-%Y %H:%M:%S.%f", "%d %b %Y %H:%M:%S.%f"),
    "%d-%b-%y %H:%M:%S.%f",
    *("%d-%b-%Y %H:%M:%S%z", "%d %b %Y %H:%M:%S%z", "%b %d, %Y %I:%M:%S %p", "%d-%b-%Y %I:%M:%S %p"),
)
_DATE = r"(?P<a>\d{1,4})(?P<sep>[-/.])\s?(?P<b>\d{1,2})(?P=sep)\s?(?P<c>\d{4}|\d{1,2})"
_CLOCK = (
    r"(?P<H>\d{1,2})[:.h](?P<M>\d{2})(?:[:.](?P<S>\d{2})(?:[.,:](?P<f>\d{1,9})\d{0,9})?)?"
    r"\s*(?P<half>[AaPp]\.?\s?[Mm]\.?)?(?:\s*Uhr)?"
)
_ZONE = r"\s*(?P<zone>Z|UTC|GMT|[+-]\d{2}:?\d{2})?"
_WRITTEN = re.compile(rf"{_DATE}(?:\s*[T,;_\s]\s*|-){_CLOCK}{_ZONE}")
DATE = re.compile(_DATE)
"""A date in numbers alone."""
CLOCK = re.compile(_CLOCK + _ZONE)
"""A time of day alone."""

_LEAP_SECOND = re.compile(r"(?<!\d)(\d\d:?59:?)60(?!\d)")
_SINCE_1970 = re.compile(r"\d{10}(?:\.\d+)?|\d{13}(?:\.\d+)?|\d{16}|\d{19}")
"""s, ms, us or ns since 1970; dates without separators have 8, 12 or 14 digits."""

_SINCE_1970_IN_NAME = re.compile(r"(?<!\d)1\d{9}(?:\d{3})?(?!\d)")
"""s or ms since 1970 of the years 2001 to 2033."""

_CLOCK_IN_NAME = (
    r"(?P<H>\d\d)(?:(?P<t>[-_.:h])(?P<M>\d\d)(?:[-_.:m](?P<S>\d\d)(?:[-_.,](?P<f>\d{6}|\d{3}))?)?"
    r"|(?P<M2>\d\d)(?P<S2>\d\d)(?:[-_.,]?(?P<f2>\d{6}|\d{3}))?)"
    r"(?:[-_ ]?(?P<half>[AaPp][Mm]))?(?P<zone>Z|\+\d\d[:_-]?\d\d|[_ ]?(?:UTC|GMT|CES?T|MES?Z)(?![A-Za-z]))?(?!\d)"
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
_IN_FOLDERS = tuple(
    re.compile(rf"(?<!\d){date}(?!\d)")
    for date in (
        # 2024/11/04, data_2024-11-04, 20241104
        r"(?P<a>(?:19|20)\d\d)(?P<sep>[-_./]?)(?P<b>\d\d)(?P=sep)(?P<c>\d\d)",
        r"(?P<a>\d\d?)(?P<sep>[-_.])(?P<b>\d\d?)(?P=sep)(?P<c>(?:19|20)\d\d)",
    )
)
"""Dates in the names of folders, or in folders one below the other."""
_CLOCK_BELOW = re.compile(
    r"(?<!\d)(?:"
    r"(?P<H>\d\d)(?P<t>[-_.:h/])(?P<M>\d\d)(?:(?:(?P=t)|[m.])(?P<S>\d\d)(?:[-_.,](?P<f>\d{6}|\d{3}))?)?"
    r"|(?P<H3>\d\d)/?(?P<M2>\d\d)(?P<S2>\d\d)(?:[-_.,]?(?P<f2>\d{6}|\d{3}))?"
    r")(?:[-_ ]?(?P<half>[AaPp][Mm])(?![A-Za-z]))?(?P<zone>Z)?(?!\d)"
)
"""A time of day below folders of a date; the hour may be a folder."""
_DATE_FOLDERS = re.compile(
    r"(?:(?:19|20)\d\d(?:/(?:0[1-9]|1[0-2])(?:/(?:0[1-9]|[12]\d|3[01])(?:/[0-2]\d(?:/[0-5]\d)?)?)?)?"
    r"|(?:(?:19|20)\d\d[-_.]?\d\d[-_.]?\d\d|\d\d?[-_.]\d\d?[-_.](?:19|20)\d\d)(?:[-_. T]?[\d\-_.:hZ]*)(?:/\d\d){0,2})"
)
"""Folders that hold nothing but a date: year to minute, one below the other, or a date as the name."""
_MAX_DATE_FOLDERS = 5

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
        day_first, month_first, year_first: by the order of day and month behind or before them the year, None where the
            text cannot be read so. Where the text leaves no choice (ISO, a name of a month, dots, which stand for day
            first) the first two are the same.
        open: whether the order is not stated by the way of writing.
        local: whether the zone is that of the reader, because the text states none.
        skipped: whether a reading is a local time that does not exist, in the hour left out in spring.
        resolution: s, of the last digit that is written.
    """

    text: str
    day_first: float | None
    month_first: float | None
    year_first: float | None = None
    open: bool = False
    local: bool = False
    skipped: bool = False
    resolution: float = 1.0

    def later(self, seconds: float) -> Stamp:
        """Return the stamp of a moment so many seconds later."""
        return replace(self, **{order: (self.at(order) or 0.0) + seconds for order in self.orders})

    def only(self, orders: Iterable[Order]) -> Stamp:
        """Return the stamp by some orders alone, fixed where one reading is left; as it is where none is."""
        kept = {time for order in orders if (time := self.at(order)) is not None}
        if len(kept) == 1 < len(self.readings):
            return replace(self, day_first=(time := kept.pop()), month_first=time, year_first=None, open=False)
        return replace(self, **{order: None for order in self.orders if self.at(order) not in kept}) if kept else self

    @property
    def fixed(self) -> float | None:
        """The time where the order does not matter, or None."""
        is_same = self.day_first == self.month_first and self.year_first in (None, self.day_first)
        return self.day_first if is_same else None

    @property
    def readings(self) -> tuple[float, ...]:
        """The times that the text may mean, each once."""
        return tuple(dict.fromkeys(time for order in self.orders if (time := self.at(order)) is not None))

    @property
    def ways(self) -> str:
        """The readings in words."""
        return " or ".join(f"{utc_text(self.at(order) or 0.0)} ({order.replace('_', ' ')})" for order in self.orders)

    @property
    def orders(self) -> tuple[Order, ...]:
        """The orders in which the text can be read."""
        return tuple(order for order in ORDERS if self.at(order) is not None)

    def at(self, order: Order) -> float | None:
        """Return the time by an order, or None."""
        return {"day_first": self.day_first, "month_first": self.month_first, "year_first": self.year_first}[order]


def utc_text(seconds: float) -> str:
    """Return seconds since 1970 UTC in ISO 8601, to the millisecond."""
    try:
        moment = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(milliseconds=round(1e3 * seconds))
    except (OverflowError, ValueError):
        return f"{seconds:g} s since 1970 UTC"
    return moment.isoformat(timespec="milliseconds" if moment.microsecond else "seconds").replace("+00:00", "Z")


def read_stamp(value: object, zone: str) -> Stamp | None:
    """Return a stamp of a header, as ISO 8601, in numbers or with a name of a month; None where it is none.

    The second 60 of a leap second is the first of the next minute. ``zone`` is the IANA name of the zone of a stamp
    that names none.
    """
    if isinstance(value, np.datetime64):
        seconds = float((value - np.datetime64(0, "s")) / np.timedelta64(1, "s"))
        return _stamp_utc(str(value), seconds if math.isfinite(seconds) else None)
    if isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool):
        return _stamp_utc(str(value), epoch_seconds(value))
    if isinstance(value, datetime):
        return _stamp(str(value), value, zone)
    if not isinstance(value, str):
        return None
    text = in_signs(value.strip()[:_MAX_TEXT])
    if _SINCE_1970.fullmatch(text):
        return _stamp_utc(text, epoch_seconds(float(text)))
    plain, leap = _LEAP_SECOND.subn(r"\g<1>59", text)
    try:
        return _stamp(text, datetime.fromisoformat(plain), zone, leap)
    except ValueError:
        pass
    match = _WRITTEN.fullmatch(text)
    if match is not None:
        return _in_numbers(text, match.groupdict(), zone)
    for pattern in _WITH_MONTH_NAME:
        try:
            return _stamp(text, datetime.strptime(plain, pattern), zone, leap)
        except ValueError:
            continue
    return None


def epoch_seconds(number: float | np.integer | np.floating) -> float | None:
    """Return a time since 1970 UTC in s, given in s, ms, us or ns, which its size tells apart; None for another number.

    Smaller numbers are counted from something else.
    """
    # Seconds since 1904, as those of LabVIEW, would be of the years 2064 and after.
    size = next((size for size in (1.0, 1e3, 1e6, 1e9) if 1e8 * size < number < 2.97e9 * size), None)
    return None if size is None else float(number) / size


def resolution_of(seconds: float) -> float:
    """Return the resolution of a time that comes as a number, s: a whole one is stated to the second."""
    return 1.0 if seconds == math.floor(seconds) else 1e-3


def repeated_by(seconds: float, zone: str) -> float:
    """Return how much later a local time occurs again, s; 0 where it occurs once.

    ``seconds`` is the first of the two, since 1970 UTC, in the zone of an IANA name.
    """
    if zone == "UTC":
        return 0.0
    try:
        first = datetime.fromtimestamp(seconds, ZoneInfo(zone)).replace(fold=0)
        return max(first.replace(fold=1).timestamp() - first.timestamp(), 0.0)
    except (OverflowError, ValueError, OSError):
        return 0.0


def _stamp_utc(text: str, seconds: float | None) -> Stamp | None:
    return None if seconds is None else Stamp(text, seconds, seconds, resolution=resolution_of(seconds))


def _stamp(text: str, moment: datetime, zone: str, leap: int = 0) -> Stamp | None:
    """Return the stamp of a moment that is ``leap`` seconds later than written; None beyond all calendars."""
    seconds = _seconds(moment, zone)
    if seconds is None:
        return None
    local = moment.tzinfo is None
    return Stamp(
        text,
        seconds + leap,
        seconds + leap,
        local=local,
        skipped=local and _is_skipped(moment, seconds, zone),
        resolution=_resolution_in(text),
    )


def _is_skipped(moment: datetime, seconds: float, zone: str | tzinfo) -> bool:
    """Return whether a local time, read as so many seconds since 1970 UTC, does not exist."""
    if zone == "UTC":
        return False
    inside = ZoneInfo(zone) if isinstance(zone, str) else zone
    return datetime.fromtimestamp(seconds, inside).replace(tzinfo=None, fold=0) != moment.replace(tzinfo=None, fold=0)


def _resolution_in(text: str) -> float:
    """Return the resolution of a time as written, s."""
    match = CLOCK.search(text)
    if match is None:
        return 1.0 if re.search(r"T\d{6}", text) else 86400.0
    return _resolution(match.groupdict())


def _resolution(parts: Mapping[str, str | None]) -> float:
    fraction = parts.get("f") or parts.get("f2")
    if fraction:
        return 10.0 ** -len(fraction)
    has_seconds = parts.get("S") is not None or parts.get("S2") is not None
    return 1.0 if has_seconds else 60.0 if parts.get("M") is not None else 86400.0


def _seconds(moment: datetime, zone: str | tzinfo) -> float | None:
    try:
        inside = ZoneInfo(zone) if isinstance(zone, str) else zone
        return (moment if moment.tzinfo else moment.replace(tzinfo=inside)).timestamp()
    except (OverflowError, ValueError, OSError):
        return None


def _in_numbers(text: str, parts: Mapping[str, str | None], zone: str) -> Stamp | None:
    """Return the stamp of a date in numbers, by the groups of its expression; None where it has no valid reading."""
    a, b, c, separator = [parts[key] or "" for key in ("a", "b", "c", "sep")]
    day_first = month_first = year_first = None
    if len(a) == 4:
        day_first = month_first = _at(int(a), b, c, parts, zone) if len(c) <= 2 else None
    elif len(a) <= 2:
        if len(c) > 1:
            day_first, month_first = _at(_year(c), b, a, parts, zone), _at(_year(c), a, b, parts, zone)
        if separator == "." and day_first is not None:
            month_first = day_first
        elif len(a) == 2 and len(c) <= 2:
            year_first = _at(_year(a), b, c, parts, zone)
    readings = (day_first, month_first, year_first)
    known = [reading for reading in readings if reading is not None]
    if not known:
        return None
    return Stamp(
        text,
        *[None if reading is None else reading[0] for reading in readings],
        open=len(a) != 4 and not (separator == "." and day_first is not None),
        local=not parts.get("zone"),
        skipped=any(skipped for _, skipped in known),
        resolution=_resolution(parts),
    )


def _year(digits: str) -> int:
    return int(digits) if len(digits) == 4 else int(digits) + (2000 if int(digits) < 70 else 1900)


def _at(year: int, month: str, day: str, parts: Mapping[str, str | None], zone: str) -> tuple[float, bool] | None:
    """Return s since 1970 UTC of a reading, and whether it is a local time that does not exist; None for no reading."""
    hour, half = int(parts["H"] or parts.get("H3") or 0), (parts.get("half") or "")[:1].lower()
    minute, second = [int(parts.get(key) or parts.get(f"{key}2") or 0) for key in "MS"]
    if half and not 1 <= hour <= 12:
        return None
    if half:
        hour = hour % 12 + (12 if half == "p" else 0)
    leap = int(second == 60 and minute == 59)
    fraction = parts.get("f") or parts.get("f2") or ""
    try:
        moment = datetime(year, int(month), int(day), hour, minute, second - leap, int(f"{fraction:0<6}"[:6]))
    except ValueError:
        return None
    own = _offset(parts.get("zone"))
    seconds = _seconds(moment, own or zone)
    return None if seconds is None else (seconds + leap, own is None and _is_skipped(moment, seconds, zone))


def _offset(text: str | None) -> tzinfo | None:
    if not text:
        return None
    word = text.strip("_ ")
    if word in ZONE_HOURS:
        return timezone(timedelta(hours=ZONE_HOURS[word]))
    digits = re.sub("[:_-]", "", text[1:]).rjust(5)
    minutes = 60 * int(digits[1:3]) + int(digits[3:5])
    return timezone(timedelta(minutes=-minutes if text[0] == "-" else minutes))


def stamp_in_name(path: str, zone: str, pattern: str | None = None) -> Stamp | None:
    """Return the date and time in the name of a file, or in the name with its folders; None without one.

    ``pattern`` is that of :func:`datetime.strptime` for a part of the path; None: one of the usual dates, or a time of
    day below folders of a date. A name with two different dates, or times of day, has none.
    """
    folders, _, name = path.rpartition("/")
    if pattern is None:
        ways = (
            lambda: _found_usual(name, zone),
            lambda: _found_usual(f"{folders.rpartition('/')[2]}/{name}", zone),
            lambda: _found_below(folders, name, zone),
        )
    else:
        ways = (lambda: _found_by(name, zone, pattern), lambda: _found_by(path, zone, pattern))
    for way in ways:
        found = way()
        if found:
            is_one = len(found) == 1 or len({tuple(map(stamp.at, ORDERS)) for stamp in found}) == 1
            return found[0] if is_one else None
    return None


def date_folders(path: str) -> str:
    """Return the last folders of a path, as many as hold nothing but a date or its beginning; "" where none does.

    Below ``.../2026/03`` that is 2026/03; a folder of another name states no date of what stands below it.
    """
    names = path.strip("/").split("/")
    for count in range(min(_MAX_DATE_FOLDERS, len(names)), 0, -1):
        folders = "/".join(names[-count:])
        if _DATE_FOLDERS.fullmatch(folders):
            return folders
    return ""


def day_in_folders(path: str, zone: str) -> Stamp | None:
    """Return the day that the folders right above a file state, as its first moment; None without a whole date."""
    folders = date_folders(path.rpartition("/")[0])
    matches = [match for pattern in _IN_FOLDERS if (match := pattern.search(folders)) is not None]
    return _in_numbers(matches[0][0], {**dict.fromkeys("HMSf"), **matches[0].groupdict()}, zone) if matches else None


def _found_usual(text: str, zone: str) -> list[Stamp]:
    matches = (match for pattern in _IN_NAMES for match in pattern.finditer(text))
    found = [stamp for match in matches if (stamp := _in_numbers(match[0], match.groupdict(), zone)) is not None]
    counted = () if found else _SINCE_1970_IN_NAME.findall(text)
    return found or [stamp for digits in counted if (stamp := read_stamp(digits, zone)) is not None]


def _found_below(folders: str, name: str, zone: str) -> list[Stamp]:
    """Return the times of day in a name and the folders below the last date of a path, on that date."""
    dates = [match for pattern in _IN_FOLDERS for match in pattern.finditer(folders)]
    if not dates:
        return []
    date = max(dates, key=lambda match: match.end())
    rest = f"{folders}/{name}"[date.end() :]
    parts = date.groupdict()

    def stamps(begin: int, allowed: Callable[[re.Match[str]], bool]) -> list[Stamp]:
        found = (
            _in_numbers(f"{date[0]}{rest[: clock.end()]}", {**clock.groupdict(), **parts}, zone)
            for clock in _CLOCK_BELOW.finditer(rest, begin)
            if allowed(clock)
        )
        return [stamp for stamp in found if stamp is not None]

    def is_stated(clock: re.Match[str]) -> bool:
        """Return whether numbers state a time of day, and do not count something."""
        if clock["S"] or clock["half"] or clock["S2"]:
            return bool(clock["S"] or clock["half"]) or rest[clock.start() - 1] == "/"
        if "/" in clock[0] and (parts["sep"] != "/" or re.match(r"[-_.:h]\d", rest[clock.end() :])):
            # A folder of digits alone is an hour with minutes and seconds below, or in folders from the year on.
            return False
        return rest[clock.start() - 1] == "/"

    own = stamps(len(rest) - len(name), lambda clock: bool(clock["S"] or clock["S2"]) and is_stated(clock))
    return own or stamps(0, is_stated)


def hour_folder(text: str) -> str:
    """Return the folder that is the hour of a stamp, by its text, "" for none."""
    ends = [match.end() for pattern in _IN_FOLDERS for match in pattern.finditer(text)]
    found = re.fullmatch(r"/(\d\d)/\d\d(?:\D?\d\d)?", text[max(ends) :]) if ends else None
    return "" if found is None else found[1]


def _found_by(text: str, zone: str, pattern: str) -> list[Stamp]:
    found: list[Stamp] = []
    for match in compiled(pattern).finditer(text):
        plain, leap = match[0], 0
        if match.groupdict().get("S") == "60" and match.groupdict().get("M") == "59":
            begin, end = (place - match.start() for place in match.span("S"))
            plain, leap = f"{plain[:begin]}59{plain[end:]}", 1
        try:
            stamp = _stamp(match[0], datetime.strptime(plain, pattern), zone, leap)
        except ValueError:
            continue
        found += [] if stamp is None else [replace(stamp, resolution=_resolution(match.groupdict()))]
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
    body = "".join(
        re.escape(part) if index % 2 == 0 else "%" if part == "%" else f"(?P<{part}>{_DIRECTIVES[part]})"
        for index, part in enumerate(parts)
    )
    return re.compile(rf"(?<!\d){body}(?!\d)")
