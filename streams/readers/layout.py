"""Text files of loggers: metadata, header, units, a column of times, numbers."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace

from streams.readers.stated import Facts, known_unit, plain_key, rate_of_times, stated_rate, stated_start, stated_unit
from streams.readers.text import clean_text, first_line_of, is_number, read_text
from streams.samples import ReaderError, Samples

_MAX_HEAD_LINES = 200
_TIMES = {"time", "times", "timesec", "timeseconds", "timems", "zeit", "zeits", "t", "ts", "tempo", "temps", "xvalue"}
_SECONDS = ("s", "sec", "second", "seconds", "ms")
_IN_MS = {"timems"}
_FACT = re.compile(r"\s*[#%\"]*\s*([A-Za-z][^:=;\t,]{0,60}?)\s*[:=;\t,]\s*(.*?)[\"\s;,]*$")
_UNIT_IN_NAME = re.compile(r"^(.*?)\s*[\[(]([^\])]*)[\])]\s*$")


@dataclass
class _Head:
    """What stands above the numbers."""

    facts: dict[str, object] = field(default_factory=dict)
    names: tuple[str, ...] | None = None
    units: tuple[str | None, ...] | None = None
    lines: int = 0


def read_layout(data: bytes, name: str, zone: str = "UTC") -> Samples:
    """Read a text file whose layout can be recognised without guessing.

    Above the numbers there may be lines ``KEY: VALUE`` (also with "=", ";", "," or a tab; "#" or "%" before them), a
    line of column names and a line of units. Known are the keys of the sampling rate or interval, the unit and the time
    of the first sample; units also stand behind a name, as ``x [g]``. A column called time (``t``, ``Time [s]``,
    ``X_Value``) is no channel but states the rate.

    Args:
        zone: IANA name of the zone of stamps that name none.

    Returns:
        Samples of shape (column, line), the columns counted as in the file.

    Raises:
        ReaderError: as :func:`streams.readers.text.read_text`; ``wrong_rate`` for uneven times or contradictory rates.
    """
    body, skipped = _numbers(clean_text(data, name), name)
    head = _head(skipped)
    try:
        samples = read_text(body, name, header=False)
    except ReaderError as error:
        raise _moved(error, name, head.lines) from error
    width = len(samples.names)
    if head.names is not None and len(head.names) == width + 1 and plain_key(head.names[-1]) == "comment":
        head.names = head.names[:-1]
    if head.names is not None and len(head.names) != width:
        raise ReaderError(
            "wrong_shape", f"{name}: {len(head.names)} names in the header, {width} columns in line {head.lines + 1}"
        )
    return _described(samples, head, name, zone)


def _numbers(body: bytes, name: str) -> tuple[bytes, list[str]]:
    """Cut the text before its first line of numbers."""
    skipped: list[str] = []
    begin = 0
    while begin < len(body) and len(skipped) <= _MAX_HEAD_LINES:
        line = first_line_of(body, begin)
        text = line.decode("utf-8", "replace").strip()
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
    fields = _fields(line)
    return bool(fields) and any(fields) and is_number(fields[0]) and sum(map(is_number, fields)) * 2 >= len(fields)


def _fields(line: str) -> list[str]:
    separator = next((c for c in ";\t" if c in line), None)
    if separator is None:
        separator = "," if "," in line else None
    return [part.strip().strip('"') for part in line.split(separator)]


def _head(lines: list[str]) -> _Head:
    head = _Head(lines=len(lines))
    kept = [line for line in lines if line.strip()]
    titles = [line for line in kept[-2:] if not line.startswith(("#", "%", "***"))]
    if len(titles) == 2 and _are_units(_fields(titles[1])) and len(_fields(titles[0])) == len(_fields(titles[1])):
        head.names = tuple(_fields(titles[0]))
        head.units = tuple(known_unit(unit) for unit in _fields(titles[1]))
        kept = kept[:-2]
    elif titles and titles[-1] == kept[-1] and not _is_fact(titles[-1]):
        head.names = tuple(_fields(titles[-1]))
        kept = kept[:-1]
    for line in kept:
        match = _FACT.match(line)
        if match is not None:
            value = match[2] if is_number(match[2].split(" ")[0]) else re.split(r"[;\t,]", match[2])[0]
            head.facts.setdefault(plain_key(match[1]), value.strip().strip('"'))
    return head


def _are_units(fields: list[str]) -> bool:
    bare = [part.strip("[]() ") for part in fields]
    known = any(known_unit(part) in ("g", "m/s2", "V") for part in bare) or bare[0].lower() in _SECONDS
    return known and all(len(part) <= 12 for part in bare)


def _is_fact(line: str) -> bool:
    """Return whether a line is metadata: one value, and a known key or a number."""
    match = _FACT.match(line)
    if match is None:
        return False
    key, value = plain_key(match[1]), match[2].strip()
    facts: Facts = {key: value}
    return ":" in line or "=" in line or stated_start(facts, "UTC") is not None or is_number(value.split(" ")[0])


def _described(samples: Samples, head: _Head, name: str, zone: str) -> Samples:
    """Add what the head states; a column of times gives the rate and is removed."""
    names, units = _names_and_units(samples, head)
    times = [i for i, title in enumerate(names) if plain_key(title) in _TIMES] if head.names is not None else []
    rate = stated_rate(head.facts, name)
    start = stated_start(head.facts, zone)
    overall = stated_unit(head.facts)
    stated = tuple(unit or overall for unit in units)
    samples = replace(samples, channels=names, names=names, units=stated)
    if len(times) == 1 and len(names) > 1:
        place = times[0]
        millis = plain_key(names[place]) in _IN_MS or (units[place] or "").lower() == "ms"
        seconds = samples.values[place] * (1e-3 if millis else 1.0)
        by_times = rate_of_times(seconds, name)
        if by_times is not None and rate is not None and abs(by_times - rate) > 1e-4 * rate:
            raise ReaderError("wrong_rate", f"{name}: the header states {rate:g} Hz, the times {by_times:g} Hz")
        rate = rate if rate is not None else by_times
        if start is None and seconds[0] > 1e8:
            start = float(seconds[0])
        samples = samples.select([row for row in range(len(names)) if row != place])
    return replace(samples, rate=rate, start=start)


def _names_and_units(samples: Samples, head: _Head) -> tuple[tuple[str, ...], tuple[str | None, ...]]:
    if head.names is None:
        return samples.names, (None,) * len(samples.names)
    names: list[str] = []
    units: list[str | None] = list(head.units) if head.units is not None else [None] * len(head.names)
    for index, title in enumerate(head.names):
        match = _UNIT_IN_NAME.match(title)
        unit = known_unit(match[2]) if match is not None else None
        is_time = match is not None and plain_key(match[1]) in _TIMES
        if match is not None and (unit in ("g", "m/s2", "V") or is_time):
            names.append(match[1].strip() or title)
            units[index] = units[index] or unit
        else:
            names.append(title)
    return tuple(names), tuple(units)


def _moved(error: ReaderError, name: str, lines: int) -> ReaderError:
    """Return the error with its line counted from the top of the file."""
    moved = re.sub(
        rf"^{re.escape(name)}: line (\d+)", lambda match: f"{name}: line {int(match[1]) + lines}", str(error), count=1
    )
    return ReaderError(error.status, moved)
