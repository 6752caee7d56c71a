"""Text files of pulses: a time a line, in seconds from the first sample of the recording or as dates."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from streams.files.formats.head import MAX_HEAD_LINES, Head, decoded, head_of, titles_with_blanks
from streams.files.formats.numbers import is_number
from streams.files.formats.text import clean_text, read_text
from streams.files.keys import PULSE_KEYS, UNIT_IN_NAME
from streams.files.pulse_times import with_pulses
from streams.files.statements import Facts, plain_key, seconds_utc
from streams.types.limits import MAX_BYTES
from streams.types.samples import ReaderError, Samples

_NAMES = {
    "time",
    "times",
    "zeit",
    "t",
    "tempo",
    "pulse",
    "pulses",
    "pulsetime",
    "impuls",
    "impulse",
    "impulso",
    "tacho",
}
_DATE = re.compile(r"\"?(\d{4}-\d\d-\d\d)[T ](\d\d:\d\d:\d\d(?:\.\d{1,9})?)(Z|[+-]\d\d:?\d\d)?\"?\s*$")


def pulse_column(data: bytes, name: str, zone: str = "UTC") -> Samples:
    """Read the times of pulses from a text: one row, as it stands, with what the text states of it.

    Above the times there may be lines ``KEY: VALUE`` (``pulses_per_revolution``, ``unit``) and a line of names. Of
    several columns the one called ``time`` or ``pulses`` is taken. Without a unit the times are s from the first sample
    of the recording; ``unit: ms since 2024-05-01T12:00:00Z`` counts from a date; a line may be a date in ISO 8601.
    ``zone`` is the IANA name of the zone of dates that name none.

    Raises:
        ReaderError: as :func:`streams.files.formats.text.read_text`; ``wrong_shape`` where no column is that of times;
            as :func:`streams.files.pulse_times.with_pulses`.
    """
    text = clean_text(data, name)
    skipped: list[str] = []
    begin = 0
    while begin < len(text) and len(skipped) <= MAX_HEAD_LINES:
        end = text.find(b"\n", begin)
        line = decoded(text[begin : len(text) if end < 0 else end]).strip()
        if _DATE.match(line) or is_number(re.split(r"[;\t, ]", line)[0]):
            break
        skipped.append(line)
        begin = len(text) if end < 0 else end + 1
    else:
        if len(skipped) > MAX_HEAD_LINES:
            raise ReaderError("unreadable", f"{name}: no time of a pulse in the first {MAX_HEAD_LINES} lines")
    head = head_of(skipped) if any(skipped) else Head()
    body = text[begin:]
    base = Samples(np.zeros((1, 1)))
    facts: Facts = head.facts
    if not body.strip():
        # The shaft stood still: only the head was written.
        titles = {plain_key(_bare(title)[0]) for title in head.names or ()}
        if not (titles & _NAMES or any(key in facts for key in PULSE_KEYS)):
            raise ReaderError("empty", f"{name}: no line of numbers")
        return with_pulses(base, np.empty(0), {**facts, **_unit_of(head, 0)}, zone, name)
    if _DATE.match(decoded(body[:64].partition(b"\n")[0]).strip()):
        times, epoch = _dates(body, name, zone, len(skipped))
        counted = with_pulses(base, times, {key: facts[key] for key in facts if key.startswith("p")}, zone, name)
        return Samples(base.values, pulses=counted.pulses, pulse_epoch=epoch)
    if head.names is not None and "," not in head.title and b"." not in body:
        # One column has no other use for a comma.
        body = body.replace(b",", b".")
    rows = read_text(body, name, header=False)
    if head.names is not None and len(head.names) != len(rows.names):
        head.names = titles_with_blanks(head.title, len(rows.names))
    place = _column(head, len(rows.names), name)
    return with_pulses(base, rows.values[place], {**facts, **_unit_of(head, place)}, zone, name)


def _column(head: Head, width: int, name: str) -> int:
    """Return which column has the times."""
    if width == 1:
        return 0
    names = [plain_key(_bare(title)[0]) for title in head.names or ()]
    found = [place for place, title in enumerate(names) if title in _NAMES]
    if len(names) != width or len(found) != 1:
        raise ReaderError("wrong_shape", f"{name}: {width} columns; expected one, or one that is called time or pulses")
    return found[0]


def _bare(title: str) -> tuple[str, str | None]:
    """Return a title without the unit behind it, and the unit."""
    found = UNIT_IN_NAME.match(title)
    return (title, None) if found is None else (found[1], found[2])


def _unit_of(head: Head, place: int) -> Facts:
    """Return the unit that the name of a column or the line below it states."""
    names, units = head.names or (), head.units or ()
    below = units[place] if place < len(units) else None
    behind = _bare(names[place])[1] if place < len(names) else None
    unit = below or behind
    return {} if unit is None else {"unit": unit}


def _dates(body: bytes, name: str, zone: str, head: int) -> tuple[NDArray[np.float64], float]:
    """Return seconds from the first whole second on, and that second since 1970 UTC."""
    lines = decoded(body).split("\n")
    while lines and not lines[-1].strip():
        lines.pop()
    stamps: list[str] = []
    zones: set[str | None] = set()
    for number, line in enumerate(lines, start=head + 1):
        found = _DATE.match(line.strip())
        if found is None:
            shown = re.sub(r"[^ -~]", "?", line[:30])
            raise ReaderError("unreadable", f"{name}: line {number}: expected a date, found {shown!r}")
        stamps.append(f"{found[1]}T{found[2]}")
        zones.add(found[3])
    if len(zones) > 1:
        raise ReaderError("unreadable", f"{name}: the dates are of several zones")
    if 8 * len(stamps) > MAX_BYTES:
        raise ReaderError("refused", f"{name}: {len(stamps)} times, {MAX_BYTES // 8} are allowed")
    own = zones.pop() or ""
    try:
        values = np.array(stamps, dtype="datetime64[ns]")
    except ValueError as error:
        raise ReaderError("unreadable", f"{name}: {str(error)[:80]}") from error
    first = values[0].astype("datetime64[s]")
    epoch = seconds_utc(f"{first}{own.replace('Z', '+00:00')}", zone)
    if epoch is None:
        raise ReaderError("unreadable", f"{name}: {stamps[0]}{own} is not a date")
    return (values - first).astype(np.int64) * 1e-9, epoch
