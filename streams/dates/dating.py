"""What dates the blocks of a source: the choice beside its ledger, and what in the names of files dates them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Any, Literal

from streams.types.listing import natural_key, printable, unpacked_name
from streams.types.source import ACCEPTED, Ledger
from streams.types.spec import SourceError, SourceSpec
from streams.types.stamps import Order, stamp_in_name, utc_text

_VERSIONS = (1, 2)
"""Layouts that are read; version 1 knew no ``counter``."""
By = Literal["header", "name", "count", "mtime", "nothing"]


@dataclass(frozen=True)
class Dating:
    """The kept choice of a source; None for what is not chosen.

    Attributes:
        by: what dates the blocks; None: chosen at the next file.
        pattern: ``time_name``, where one was configured.
        order: of day and month; ``decided_by`` is the file that left no other, or "configuration".
        start: ``start_utc`` of a count, s since 1970 UTC.
        interval: ``interval_s`` of a count.
        step: time from one place of a count to the next, s.
        group: which number of a file's name is its place, from the right; None: the number of the block.
        first: the number at ``start``.
        numbers: how many numbers a name has; ``folder`` holds all files that are counted by their names.
        example: the file at which the choice was made.
        counter: which number beside the date in a name counts files, from the right; None: the dates alone order them.
        growing: a file whose end was not seen, ``grown`` its length so far, s: the step, once another file comes.
    """

    by: By | None = None
    pattern: str | None = None
    order: Order | None = None
    decided_by: str | None = None
    start: float | None = None
    interval: float | None = None
    step: float | None = None
    group: int | None = None
    first: int = 0
    numbers: int = 0
    folder: str = ""
    example: str = ""
    counter: int | None = None
    growing: str = ""
    grown: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return the choice as plain values for JSON."""
        return {"version": _VERSIONS[-1], **asdict(self)}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Dating:
        """Restore a choice written by :meth:`to_dict`; ValueError for another version."""
        if values.get("version") not in _VERSIONS:
            raise ValueError(f"dating of version {values.get('version')!r}, expected {_VERSIONS[-1]}")
        return cls(**{key: value for key, value in values.items() if key != "version"})

    def describe(self) -> str:
        """Return the choice in words."""
        order = "" if self.order is None else printable(f", {self.order.replace('_', ' ')} ({self.decided_by})")
        if self.by == "header":
            return f"by the header of each file{order}"
        if self.by == "name":
            return f"by the name of each file{'' if self.pattern is None else f', {self.pattern}'}{order}"
        if self.by == "mtime":
            return "by the time of the last change of each file, less its length"
        if self.by != "count":
            return "by nothing" if self.by else "not chosen yet"
        place = "the number of the block" if self.group is None else f"the number in the name, from {self.first} on"
        step = "the length of a file" if self.step is None else f"{self.step:g} s"
        begin = "no start_utc: seconds from the first block" if self.start is None else f"from {utc_text(self.start)}"
        return f"by count ({begin}; {place}; {step} each)"


def check_kept(spec: SourceSpec, kept: Dating) -> None:
    """Raise SourceError where the configuration contradicts the kept choice; it names the command that changes it."""
    if kept.by is None:
        return
    pairs: list[tuple[str, object, object]] = [("time_from", wanted_by(spec) or kept.by, kept.by)]
    if kept.by == "name":
        pairs.append(("time_name", spec.time_name, kept.pattern))
    if kept.order is not None and spec.date_order is not None:
        pairs.append(("date_order", spec.date_order, kept.order))
    if kept.by == "count":
        pairs.append(("start_utc", _utc(spec.start), _utc(kept.start)))
        pairs.append(("interval_s", spec.interval, kept.interval))
    for key, configured, found in pairs:
        if configured != found:
            since = printable(f" since {kept.example}" if kept.example else "")
            raise SourceError(
                f"[[source]] {spec.name}: {key} is {configured if configured is not None else 'not set'}, but its "
                f"blocks are dated {kept.describe()}{since}; go back to it, or change the dates of later blocks by: "
                f"spallwatch redate {spec.name}"
            )


def kept_dating(spec: SourceSpec, ledger: Ledger) -> Dating | None:
    """Return what dates the blocks of a source by its ledger, None where nothing is chosen.

    Blocks of an earlier version that dated none stay so: dates begin at a command, not at an update. SourceError where
    the configuration contradicts it.
    """
    values = ledger.dating(spec.name)
    kept = None if values is None else Dating.from_dict(values)
    if kept is None and ledger.began(spec.name) is None and ledger.file_counts(spec.name).get(ACCEPTED):
        kept = Dating("nothing", example="an earlier version")
    if kept is not None:
        check_kept(spec, kept)
    return kept


def _utc(seconds: float | None) -> str | None:
    return None if seconds is None else utc_text(seconds)


def wanted_by(spec: SourceSpec) -> By | None:
    """Return what the configuration asks for, None where the files decide."""
    return spec.time_from or ("name" if spec.time_name is not None else None)


_MAX_MISSING = 100
"""A count whose first file has a number up to this one begins at 1; behind it, at that file."""
_MAX_DIGITS = 15
_MIN_DISTINCT = 0.9
"""Share of the names that must have a number of their own."""
_NUMBER = re.compile(r"\d+")
_CLOCK_OF_HALVES = re.compile(r"(?<!\d)\d{1,2}[-_.:h]\d\d(?:[-_.:]\d\d)?[-_ ]?[AaPp][Mm](?![A-Za-z])")
"""A time of day, which counts no files."""


@dataclass(frozen=True)
class Number:
    """A number in a name: its value, and how likely it counts files."""

    value: int
    rank: int


def folder_of(path: str) -> str:
    """Return the folder in the path of a file."""
    return path.rpartition("/")[0]


def numbers_of(path: str) -> list[Number]:
    """Return the numbers in the name of a file that may count files: none before a letter, as in 25600Hz."""
    name = unpacked_name(path).rpartition("/")[2]
    stem, dot, ending = name.rpartition(".")
    text = stem if dot and not ending.isdigit() else name
    found: list[Number] = []
    clocks = [match.span() for match in _CLOCK_OF_HALVES.finditer(text)]
    for match in _NUMBER.finditer(text):
        if any(begin <= match.start() < end for begin, end in clocks):
            continue
        after, before = text[match.end() : match.end() + 1], text[: match.start()][-1:]
        if after.isalpha() or len(match[0]) > _MAX_DIGITS:
            continue
        padded = match[0][0] == "0" and len(match[0]) > 1
        found.append(Number(int(match[0]), 2 if padded else 0 if before.isalpha() else 1))
    return found


def place_in_names(path: str, names: list[str]) -> tuple[int, int, int] | None:
    """Return which number from the right counts files, how many a name has, and the first; None: none does.

    Of several, one counts that differs from name to name; then one with leading zeros, then one that stands alone,
    then the last. The first is 0 or 1, unless the least number shows that others were counted before.
    """
    own = numbers_of(path)
    if not own or any(folder_of(name) != folder_of(path) for name in names):
        return None
    numbers = {name: numbers_of(name) for name in {path, *names}}
    alike = sorted((name for name, found in numbers.items() if len(found) == len(own)), key=natural_key)
    if 2 * len(alike) < len(set(names)):
        return None
    table = [numbers[name] for name in alike]
    possible = [i for i in range(len(own)) if len({row[i].value for row in table}) >= _MIN_DISTINCT * len(table)]
    if not possible:
        return None
    chosen = max(possible, key=lambda i: (own[i].rank, i))
    least = min(row[chosen].value for row in table)
    first = least if least == 0 or least > _MAX_MISSING else 1
    return len(own) - chosen, len(own), first


MAX_NAMES = 2000
"""Names that are looked at, evenly over all."""
_EARLIEST = 631152000.0
"""1990-01-01 UTC: an earlier date is another number."""
_DAY = 86400.0
_NEAR = 32 * _DAY
_WIDTHS = {"Y": r"(?:19|20)\d\d", "y": r"\d\d", "m": r"[01]\d", "d": r"[0-3]\d", "j": r"[0-3]\d\d", "b": r"[A-Za-z]{3}"}
_ORDERS = ("Ymd", "dmY", "mdY", "ymd", "dmy", "mdy", "dbY", "bdY", "dby", "Yj")
_SEPARATORS = ("", "-", "_", ".", " ", "/")
_SHORT = ("%y%m%d", "%d%m%y", "%m%d%y")
_SIX_DIGITS = re.compile(r"(?<!\d)(?:[01]\d|2[0-3])[0-5]\d[0-5]\d(?!\d)")
_CLOCK = re.compile(r"([-_. T/]{0,2})([0-2]\d)([-_.:h ]?)([0-5]\d)(?:\3([0-5]\d))?(?!\d)")


@dataclass(frozen=True)
class NameReading:
    """A way to read the dates in the names of all files.

    Attributes:
        pattern: that of ``time_name``.
        first: time of the first file in the order given, s since 1970 UTC.
        has_clock: whether the time of day is stated too.
        is_open: whether all names may state a time of day instead, as 081500 does.
    """

    pattern: str
    first: float
    has_clock: bool
    is_open: bool = False


def nearest_change(readings: Sequence[NameReading], changed: float | None) -> list[NameReading]:
    """Return the one reading that is near the last change of the first file, else all.

    A file is closed when its recording ends; one that was copied without its time is near none. What may be no date is
    one only there.
    """
    near = [reading for reading in readings if changed is not None and -_DAY <= changed - reading.first <= _NEAR]
    return near if len(near) == 1 else [reading for reading in readings if not reading.is_open]


def find_readings(paths: Sequence[str], zone: str, latest: float) -> list[NameReading]:
    """Return the ways to read a date in every one of some names, those with a time of day before others.

    Two patterns that read all names alike are one way. A date is between 1990 and ``latest``, and files that differ in
    name differ in date.

    Args:
        paths: of all files below the folder.
        zone: IANA name of the zone of dates in names.
        latest: s since 1970 UTC that no date may exceed, such as a day from now.
    """
    step = -(-len(paths) // MAX_NAMES) if paths else 1
    names = list(dict.fromkeys(paths[::step]))
    found: dict[tuple[float, ...], NameReading] = {}
    for pattern, has_clock in _patterns(names[0]) if names else ():
        times = _times(names, zone, pattern)
        if not times or not all(_EARLIEST <= time <= latest for time in times) or len(set(times)) < len(times):
            continue
        is_open = not has_clock and all(_SIX_DIGITS.search(name.rpartition("/")[2]) for name in names)
        found.setdefault(times, NameReading(pattern, times[0], has_clock, is_open and pattern in _SHORT))
    clocked = [reading for reading in found.values() if reading.has_clock]
    return clocked or list(found.values())


def _times(names: Iterable[str], zone: str, pattern: str) -> tuple[float, ...]:
    """Return the time of each name, none at all where one has none."""
    times: list[float] = []
    for name in names:
        stamp = stamp_in_name(name, zone, pattern)
        if stamp is None or stamp.fixed is None:
            return ()
        times.append(stamp.fixed)
    return tuple(times)


@lru_cache(maxsize=1)
def _dates() -> tuple[tuple[str, re.Pattern[str]], ...]:
    """Return the patterns of dates alone, with the expression of each in full width."""
    return tuple(
        (
            separator.join(f"%{letter}" for letter in order),
            re.compile(rf"(?<!\d){re.escape(separator).join(_WIDTHS[letter] for letter in order)}"),
        )
        for order in _ORDERS
        for separator in _SEPARATORS
        if separator != "/" or "Y" in order
    )


def _patterns(path: str) -> Iterator[tuple[str, bool]]:
    """Yield the patterns that a path may follow, and whether each has a time of day."""
    for date, expression in _dates():
        for match in expression.finditer(path):
            rest = path[match.end() :]
            clock = _CLOCK.match(rest)
            if clock is not None:
                joint, separator = clock[1].replace("%", "%%"), clock[3]
                seconds = f"{separator}%S" if clock[5] is not None else ""
                yield f"{date}{joint}%H{separator}%M{seconds}", True
            if not rest[:1].isdigit():
                yield date, False
