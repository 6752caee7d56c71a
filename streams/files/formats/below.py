"""What stands below or beside the samples of a text and is none of its channels: a footer, a spectrum."""

from __future__ import annotations

from streams.files.abscissa import abscissa_called
from streams.files.formats.head import Head, decoded, head_of
from streams.files.formats.numbers import first_line_of
from streams.files.formats.stamped import is_row
from streams.files.keys import TIME_KEYS
from streams.files.statements import add_fact

_MAX_BYTES, _MAX_LINES = 1 << 14, 100
_MARKS = ("#", "%", ";", "*", "//")


def cut_footer(text: bytes, zone: str) -> tuple[bytes, list[str]]:
    """Cut the lines of words below the last row of a text: those behind a blank line, or comments.

    ``zone`` is the IANA name of that of stamps in rows.
    """
    begin = max(0, len(text) - _MAX_BYTES)
    tail = text[begin:].rstrip()
    last = tail[tail.rfind(b"\n") + 1 :].strip()
    if not last or is_row(last, zone):
        return text, []
    lines = tail.split(b"\n")
    place = len(lines)
    while place > 1 and len(lines) - place < _MAX_LINES and not is_row(lines[place - 1], zone):
        place -= 1
    below = [decoded(line).strip() for line in lines[place:]]
    words = [line for line in below if line]
    is_footer = below[:1] == [""] or all(line.startswith(_MARKS) for line in words)
    if not words or not is_footer or not is_row(lines[place - 1], zone) or not all(_is_word(line) for line in words):
        return text, []
    length = begin + sum(len(line) + 1 for line in lines[:place])
    return text[:length], words


def _is_word(line: str) -> bool:
    return line.startswith(_MARKS) or line.lstrip("\"'([<-= ")[:1].isalpha()


def add_footer(head: Head, lines: list[str]) -> None:
    """Add what a footer states; its times may be those of the end."""
    for key, value in head_of(lines).facts.items() if lines else ():
        if key.partition("#")[0] not in TIME_KEYS:
            add_fact(head.facts, key.partition("#")[0], value, f"{key} below the numbers")


def without_spectrum(body: bytes, head: Head) -> bytes:
    """Return rows without the last columns where those are a spectrum that ends before the signal does.

    Their names, of which the first is one of frequencies, are taken from the head.
    """
    names = head.names
    first = first_line_of(body).rstrip(b"\r ")
    sign = next((sign for sign in (b";", b"\t", b",") if sign in first), b"")
    last = body[max(0, len(body) - _MAX_BYTES) :].rstrip(b"\r\n ")
    count = len(last) - len(last.rstrip(sign)) if sign else 0
    if not count or names is None or len(names) != first.count(sign) + 1 or count >= len(names):
        return body
    if abscissa_called(names[-count], "").kind != "frequency":
        return body
    parts = [row.rstrip(b"\r ").rsplit(sign, count) for row in body.rstrip(b"\r\n ").split(b"\n")]
    filled = [len(part) == count + 1 and all(part[1:]) for part in parts]
    empty = [len(part) == count + 1 and not any(part[1:]) for part in parts]
    shorter = sum(filled)
    if not (all(filled[:shorter]) and all(empty[shorter:])):
        return body
    head.names = names[:-count]
    head.units = None if head.units is None else head.units[:-count]
    head.of_columns = head.of_columns[: len(names) - count]
    head.title = ""
    return b"\n".join(part[0] for part in parts) + (b"\n" if body.endswith(b"\n") else b"")
