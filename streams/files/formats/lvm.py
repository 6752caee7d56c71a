"""The heads of LabVIEW measurement files (.lvm): one of the file, one of the segment of data below it.

Source: National Instruments, Specification for the LabVIEW Measurement File (.lvm). Date and time of the head of the
file are those at which it was made; the start of the samples is that of the segment, to which X0 is added.
"""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime, timedelta

from streams.files.formats.head import Head
from streams.files.keys import KEYS
from streams.files.statements import Facts, add_fact, number_of, plain_key
from streams.files.unlisted import is_stating
from streams.types.samples import ReaderError
from streams.types.stamps import read_stamp

END_OF_HEAD = "***End_of_Header***"
_X_VALUE, _COMMENT = "xvalue", "comment"


def is_labview(text: bytes) -> bool:
    """Return whether a text begins as a measurement file of LabVIEW."""
    return text.lstrip()[:19].lower() == b"labview measurement"


def labview_head(lines: list[str], name: str) -> Head:
    """Return what both heads state, by the lines above the numbers of one segment.

    Raises:
        ReaderError: ``unreadable`` where no line ends the head; ``name`` is that of the file in messages.
    """
    lines = [line.strip() for line in lines]
    ends = [place for place, line in enumerate(lines) if line.startswith(END_OF_HEAD)]
    if not ends:
        raise ReaderError("unreadable", f"{name}: expected a line {END_OF_HEAD} above the numbers, found none")
    head = Head(lines=len(lines), size_of_times=1.0, separators="\t" if any("\t" in line for line in lines) else ",")
    of_file = {plain_key(line[0]): line[1].strip() for line in map(_parts, lines[: ends[0]]) if len(line) > 1}
    titles = [line for line in lines[ends[-1] + 1 :] if line.strip()]
    if titles:
        head.title = titles[-1]
        names = [part.strip().strip('"') for part in _parts(titles[-1])]
        unwritten = _X_VALUE if of_file.get("xcolumns", "").lower() == "no" else None
        head.names = tuple(name for name in names if plain_key(name) != unwritten)
    if len(ends) == 1:
        # Without a head of the segment, what is stated of the file is all there is.
        for line in map(_parts, lines[: ends[0]]):
            add_fact(head.facts, plain_key(line[0]), line[1].strip() if len(line) > 1 else "")
        return head
    stated: dict[str, list[str]] = {}
    decimal = of_file.get("decimalseparator") or "."
    for line in map(_parts, lines[ends[0] + 1 : ends[1]]):
        values = [part.strip().replace(decimal, ".") for part in line[1:]]
        if stated.setdefault(plain_key(line[0]), values) != values:
            stated[f"{plain_key(line[0])}#{line[0]} (again)"] = values
    head.facts.update((key, value) for key, value in of_file.items() if key not in KEYS and is_stating(key))
    counts = [number for text in stated.get("samples", []) if (number := number_of(text)) is not None]
    head.promised = int(max(counts, default=0.0))
    head.of_columns = tuple(_of_columns(stated, head.names or ()))
    return head


def labview_body(body: bytes) -> bytes:
    """Return the numbers without the empty columns that stand for times which are not written, and for comments."""
    sign = b"\t" if b"\t" in body[: body.find(b"\n")] else b","
    body = body.replace(sign + b"\r\n", b"\r\n").replace(sign + b"\n", b"\n").rstrip(sign)
    return body[1:].replace(b"\n" + sign, b"\n") if body.startswith(sign) else body


def _parts(line: str) -> list[str]:
    return line.split("\t" if "\t" in line else ",")


def _of_columns(stated: dict[str, list[str]], names: tuple[str, ...]) -> Iterator[Facts]:
    """Yield what the head of a segment states of each column; its values are those of the channels in order."""
    channel = -1
    for title in names:
        if plain_key(title) in (_X_VALUE, _COMMENT):
            yield {}
            continue
        channel += 1
        own = {key: values[channel] for key, values in stated.items() if channel < len(values) and values[channel]}
        found = {key: value for key, value in own.items() if key.partition("#")[0] in ("yunitlabel", "deltax")}
        start = _start(own)
        yield found if start is None else {**found, "starttime": start}


def _start(stated: dict[str, str]) -> str | None:
    """Return date and time of day of a channel, moved by X0 where that is not 0."""
    if "date" not in stated or "time" not in stated:
        return None
    text, first = f"{stated['date']} {stated['time']}", number_of(stated.get("x0", "0"))
    stamp = read_stamp(text, "UTC")
    if not first or stamp is None or stamp.open:
        return text
    return (datetime(1970, 1, 1) + timedelta(seconds=(stamp.fixed or 0.0) + first)).isoformat(timespec="microseconds")
