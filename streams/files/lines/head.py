"""What stands above the numbers of a text: facts, names and units of its columns."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from streams.files.lines.numbers import first_line_of, is_number
from streams.files.statements import Facts, is_date, known_unit, multiple_of, plain_key, stated_time
from streams.types.samples import ReaderError, Samples

MAX_HEAD_LINES = 200
_MAX_SNIFFED_CHARACTERS = 1 << 16
_SECONDS = ("s", "sec", "second", "seconds", "ms")
_FACT = re.compile(r"\s*[#%\"]*\s*([A-Za-z][^:=;\t,]{0,60}?)\s*[:=;\t,]\s*(.*?)[\"\s;,]*$")
_CLOCK_IN_VALUE = re.compile(r"\d:\d\d,\d+$|\d,\s*\d{1,2}:\d\d")
_UNIT_IN_NAME = re.compile(r"^(.*?)\s*[\[(]([^\])]*)[\])]\s*$")
TIMES = {
    "time",
    "times",
    "timesec",
    "timeseconds",
    "timems",
    "zeit",
    "zeits",
    "zeitins",
    "timeins",
    "t",
    "ts",
    "tempo",
    "temps",
    "xvalue",
}
"""Plain names of a column of times."""


def decoded(line: bytes) -> str:
    """Return a line of UTF-8 or, where it is none, of Windows-1252."""
    try:
        return line.decode("utf-8")
    except UnicodeDecodeError:
        return line.decode("cp1252", "replace")


@dataclass
class Head:
    """What stands above the numbers."""

    facts: dict[str, object] = field(default_factory=dict)
    names: tuple[str, ...] | None = None
    units: tuple[str | None, ...] | None = None
    lines: int = 0
    title: str = ""


def cut_head(body: bytes, name: str) -> tuple[bytes, list[str]]:
    """Cut the text before its first line of numbers."""
    skipped: list[str] = []
    begin = 0
    while begin < len(body) and len(skipped) <= MAX_HEAD_LINES:
        line = first_line_of(body, begin)
        text = decoded(line).strip()
        if _is_numbers(text):
            return (body[begin:] if begin else body), skipped
        skipped.append(text)
        begin += len(line) + 1
    if any(skipped):
        first = next(line for line in skipped if line)
        shown = re.sub(r"[^ -~]", "?", first[:30])
        status = "empty" if len(skipped) <= 3 and begin >= len(body) else "unreadable"
        raise ReaderError(status, f"{name}: line 1: expected a number or a header above numbers, found {shown!r}")
    raise ReaderError("empty", f"{name}: no line of numbers")


def _is_numbers(line: str) -> bool:
    fields = _fields(line[:_MAX_SNIFFED_CHARACTERS])
    return bool(fields) and any(fields) and is_number(fields[0]) and sum(map(is_number, fields)) * 2 >= len(fields)


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
    if len(titles) == 2 and _are_units(_fields(titles[1])) and len(_fields(titles[0])) == len(_fields(titles[1])):
        head.names = tuple(_fields(titles[0]))
        head.units = tuple(known_unit(unit) for unit in _fields(titles[1]))
        kept = kept[:-2]
    elif titles and titles[-1] == kept[-1] and not _is_fact(titles[-1]):
        head.names, head.title = tuple(_fields(titles[-1])), titles[-1]
        kept = kept[:-1]
    for line in kept:
        match = _FACT.match(line)
        if match is not None:
            whole = is_number(match[2].split(" ")[0]) or _CLOCK_IN_VALUE.search(match[2])
            value = match[2] if whole else re.split(r"[;\t,]", match[2])[0]
            head.facts.setdefault(plain_key(match[1]), value.strip().strip('"'))
    return head


def titles_with_blanks(line: str, width: int) -> tuple[str, ...] | None:
    """Return names that hold blanks, such as ``acc [g]``, of a line without separators; None where they do not fit."""
    if width == 1:
        return None if any(separator in line for separator in ";\t,") else (line.strip().strip('"'),)
    names = re.findall(r"\S+(?:\s+[\[(][^\])]*[\])])?", line)
    return tuple(name.strip('"') for name in names) if len(names) == width else None


def _are_units(fields: list[str]) -> bool:
    bare = [part.strip("[]() ") for part in fields]
    known = any(multiple_of(known_unit(part))[0] in ("g", "m/s2", "V") for part in bare) or bare[0].lower() in _SECONDS
    return known and all(len(part) <= 12 for part in bare)


def _is_fact(line: str) -> bool:
    """Return whether a line is metadata: one value, and a known key or a number."""
    match = _FACT.match(line)
    if match is None:
        return False
    key, value = plain_key(match[1]), match[2].strip()
    facts: Facts = {key: value}
    dated = stated_time(facts, "UTC") != (None, None) or is_date(value)
    return ":" in line or "=" in line or dated or is_number(value.split(" ")[0])


def names_and_units(samples: Samples, head: Head) -> tuple[tuple[str, ...], tuple[str, ...], tuple[str | None, ...]]:
    """Return titles, names and units of the columns; a title is its name, or names the unit behind it."""
    if head.names is None:
        return samples.names, samples.names, (None,) * len(samples.names)
    names: list[str] = []
    units: list[str | None] = list(head.units) if head.units is not None else [None] * len(head.names)
    for index, title in enumerate(head.names):
        match = _UNIT_IN_NAME.match(title)
        unit = known_unit(match[2]) if match is not None else None
        is_time = match is not None and plain_key(match[1]) in TIMES
        is_ours = unit in ("g", "m/s2", "V") or is_time
        name = title
        if match is not None and (is_ours or multiple_of(unit)[0] in ("g", "m/s2", "V")):
            name = match[1].strip() or title
            units[index] = units[index] or unit
        names.append(name)
    # A configuration may name a column with its unit, as it stands in the file, or without.
    return tuple(head.names), tuple(names), tuple(units)
