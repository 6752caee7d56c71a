"""The head of a text of numbers, as loggers write it."""

from __future__ import annotations

import itertools
import re
from dataclasses import dataclass, field

from streams.files.abscissa import abscissa_called
from streams.files.axes import AXES
from streams.files.formats.encodings import western_signs
from streams.files.formats.numbers import first_line_of, is_number
from streams.files.keys import (
    COUNT,
    FACTORS,
    KEYS,
    LIKE_STEP,
    OTHER_UNITS,
    STEPS,
    TIME_UNITS,
    UNIT_IN_NAME,
    UNIT_KEYS,
)
from streams.files.statements import (
    Facts,
    add_fact,
    is_date,
    is_of_vibration,
    known_unit,
    plain_key,
    plain_unit,
    time_statements,
)
from streams.files.unlisted import is_stating
from streams.types.samples import ReaderError, Samples
from streams.types.stamps import CLOCK

MAX_HEAD_LINES = 200
_MAX_SNIFFED_CHARACTERS = 1 << 16
_MARKS = "#%!'/*;\""
"""Signs of comments and quotes before a line."""
_FACT = re.compile(rf"[{_MARKS}\s]*([^\W\d_][^:=;\t,]{{0,60}}?)\s*([:=;\t,])[\s;,]*(.*?)[\"\s;,]*$")
_FACT_BY_BLANK = re.compile(rf"[{_MARKS}\s]*([^\W\d_][^:=;\t,\d]{{0,60}}?)\s+([\d.]\S*(?:\s+\S{{1,12}})?)\s*$")
_OF_SCOPE = ("start", "increment", "xincrement", "xorigin", "tstart", "tinc")
_UNITS = OTHER_UNITS | TIME_UNITS.keys() | set(COUNT)
"""Units beside those of vibration of which a line of units may consist."""
_CLOCK_IN_VALUE = re.compile(r"\d:\d\d,\d+$|\d,\s*\d{1,2}:\d\d")
_GROUPED = re.compile(r"[-+]?\d{1,3}(?:[.,'\s]\d{3})+(?:[.,]\d+)?")
"""A number whose thousands are grouped."""
_INNER = re.compile(r"(?<=[:;,|(\s])\s*([^\W\d_][\w ]{0,40}?)\s*=\s*([^,;|)=]+)")
"""A key and its value among others in one line."""
_LEVEL = re.compile(r"(?<![\w.,/])(\d+(?:[.,]\d+)? ?[mµu]?g ?/ ?(?:LSB|digit|count))(?![\w/])", re.IGNORECASE)
_WITH_COMMA = re.compile(r"[-+]?\d+,\d+(?:[eE][-+]?\d+)?")
_UNIT_BEHIND = re.compile(r"^(.*?)(?:\s+in\s+|\s*/\s*)(\S.*?)\s*$")
"""A name with its unit as in ``Zeit/s`` and ``Beschleunigung in m/s²``."""


def decoded(line: bytes) -> str:
    """Return a line of UTF-8 or, where it is none, of Windows-1252."""
    try:
        return western_signs(line.decode("utf-8"))
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
        if is_numbers(decoded(line).strip()):
            return (body[begin:] if begin else body), skipped
        skipped.append(line_of(line))
        begin += len(line) + 1
    if any(skipped):
        first = next(line for line in skipped if line)
        shown = re.sub(r"[^ -~]", "?", first[:30])
        status = "empty" if len(skipped) <= 3 and begin >= len(body) else "unreadable"
        raise ReaderError(status, f"{name}: line 1: expected a number or a header above numbers, found {shown!r}")
    raise ReaderError("empty", f"{name}: no line of numbers")


def line_of(line: bytes) -> str:
    """Return a line without the blanks around it; a tab before it stands behind a name that is empty."""
    return decoded(line).rstrip().lstrip(" ")


def is_numbers(line: str) -> bool:
    """Return whether most fields of a line, and the first, are numbers, whose thousands may be grouped."""
    filled = [field for field in _fields(line[:_MAX_SNIFFED_CHARACTERS]) if field]
    numbers = [is_number(field) or _GROUPED.fullmatch(field) is not None for field in filled]
    by_blanks = line[:_MAX_SNIFFED_CHARACTERS].split()
    return (bool(filled) and numbers[0] and sum(numbers) * 2 >= len(filled)) or (
        len(by_blanks) > 1 and all(map(_WITH_COMMA.fullmatch, by_blanks))
    )


def _fields(line: str) -> list[str]:
    separator = next((c for c in ";\t" if c in line), None)
    if separator is None:
        separator = "," if "," in line else None
    return [part.strip().strip('"') for part in line.split(separator)]


def head_of(lines: list[str]) -> Head:
    """Return what the lines above the numbers state."""
    head = Head(lines=len(lines))
    kept = _of_scope(head, [line for line in lines if line.strip()])
    if kept and kept[-1].startswith(("#", "%")) and _are_titles(kept[-1].lstrip("#% ")):
        kept[-1] = kept[-1].lstrip("#% ")
    titles = [line for line in kept[-2:] if not line.startswith(("#", "%", "***"))]
    both = [_fields(line) for line in titles]
    if len(both) == 2 and "\t" in titles[1] and len(both[1]) < len(both[0]):
        # The units of the last columns are not stated.
        both[1] += [""] * (len(both[0]) - len(both[1]))
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
    elif head.names is None and titles and titles[-1] == kept[-1] and not _is_fact(titles[-1]):
        head.names, head.title = tuple(_fields(titles[-1])), titles[-1]
        kept = kept[:-1]
    for line in itertools.chain.from_iterable(map(_pairs, kept)):
        match = _fact_in(line)
        if match is not None:
            text = match[1].strip('"')
            whole = is_number(text.split(" ")[0]) or _CLOCK_IN_VALUE.search(text)
            value = text if whole else _value_of(text, is_axis=plain_key(match[0]) in AXES)
            add_fact(head.facts, plain_key(match[0]), value.strip().strip('"'), f"{match[0].strip()} (again)")
    return head


def _of_scope(head: Head, lines: list[str]) -> list[str]:
    """Take the two lines of names and units in which an oscilloscope states its step, and return those above.

    Behind the columns the first one has names such as ``Start`` and ``Increment``, the second one their numbers.
    """
    titles, below = (_fields(line) for line in lines[-2:]) if len(lines) > 1 else ([], [])
    stated = [
        place
        for place, (key, value) in enumerate(zip(titles, below, strict=False))
        if plain_key(key) in _OF_SCOPE and is_number(value)
    ]
    columns = stated[0] if stated else 0
    if not columns or not any(plain_key(titles[place]) in STEPS for place in stated):
        return lines
    head.names, head.title = tuple(titles[:columns]), ""
    head.units = tuple(known_unit(unit) for unit in below[:columns])
    if abscissa_called(below[0], "").kind is not None:
        head.names, head.units = (below[0], *head.names[1:]), (None, *head.units[1:])
    for place in stated:
        if plain_key(titles[place]) in STEPS:
            add_fact(head.facts, plain_key(titles[place]), below[place], titles[place])
    return lines[:-2]


def _fact_in(line: str) -> tuple[str, str] | None:
    """Return key and value of a line; a blank separates them only behind the key of a rate, before a number."""
    match = _FACT.match(line)
    if match is not None:
        return match[1], match[3]
    match = _FACT_BY_BLANK.match(line)
    return (match[1], match[2]) if match is not None and plain_key(match[1]) in FACTORS else None


def _are_titles(line: str) -> bool:
    """Return whether the last comment of a head names columns: one of them is a time, or has a unit of vibration."""
    names = titles_with_blanks(line, len(re.findall(r"\S+(?:\s+[\[(][^\])]*[\])])?", line))) or ()
    names = names if not re.search(r"[;\t,]", line) else tuple(_fields(line))
    units = [match[2] for name in names if (match := UNIT_IN_NAME.match(name)) is not None]
    return len(names) > 1 and not _is_fact(line) and any(is_of_vibration(known_unit(unit)) for unit in units)


def _pairs(line: str) -> list[str]:
    """Return a line as lines of one key each, where keys and values take turns in its fields.

    So are those of ``Config: data_rate = 2000.0 Hz, filter = 488 Hz`` and of a level behind words, as ``3.9 mg/LSB``.
    """
    inner = [(match[1], match[2].strip()) for match in _INNER.finditer(line)]
    levels = _LEVEL.findall(line)
    match = _FACT.match(line)
    if match is not None and plain_key(match[1]) not in KEYS:
        stated = [f"{key}\t{value}" for key, value in inner if is_stating(plain_key(key)) and value != match[3].strip()]
        if len(levels) == 1 and is_number(levels[0].split(" ")[0]):
            stated.append(f"scale\t{levels[0]}")
        if stated:
            return [line, *stated]
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
    known = any(is_of_vibration(known_unit(part)) for part in bare) or plain_unit(bare[0]) in LIKE_STEP
    others = {plain_unit(part) for part in bare} - {"", "-"}
    return (known and all(len(part) <= 16 for part in bare)) or (len(bare) > 1 and _UNITS >= others > set())


def _is_axis(fields: list[str]) -> bool:
    return plain_key(fields[0]) in AXES


def _is_fact(line: str) -> bool:
    """Return whether a line is metadata: one value, and a known key or a number."""
    match = _FACT.match(line)
    if match is None:
        return _fact_in(line) is not None
    key, value = plain_key(match[1]), match[3].strip('" ')
    dated = bool(time_statements({key: value}, "UTC")) or is_date(value)
    is_known = key in AXES or (key in UNIT_KEYS and is_of_vibration(known_unit(value)))
    is_clock = CLOCK.fullmatch(value) is not None
    return match[2] in ":=" or dated or is_clock or is_number(value.split(" ")[0]) or is_known


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
        if match is not None and unit is not None and (is_of_vibration(unit) or abscissa_called(match[1], unit).size):
            title = match[1].strip() or title
            own.append((f"the name {head.names[index]!r}", unit))
        elif unit is not None and plain_unit(unit) in OTHER_UNITS:
            own.append((f"the name {head.names[index]!r}", unit))
        names.append(title)
        units.append(own)
    # A configuration may name a column with its unit, as it stands in the file, or without.
    return tuple(head.names), tuple(names), units


StatedUnits = list[tuple[str, str]]
"""Units of a column, each with its place."""
