"""Texts of several recordings: the head of the first stands again among the numbers, of LabVIEW that of its data."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

from streams.files.formats.head import MAX_HEAD_LINES, decoded
from streams.files.formats.lvm import END_OF_HEAD, is_labview
from streams.files.formats.stamped import is_row
from streams.files.successive import HOW_TO_SPLIT, MAX_RECORDINGS
from streams.types.samples import ReaderError

_CHANNELS = re.compile(rb"(?mi)^[ \t]*channels[\t,]")
_END = re.compile(rb"(?m)^[ \t]*" + re.escape(END_OF_HEAD.encode()) + rb".*\n?")


@dataclass(frozen=True)
class TextSection:
    """A recording of a text as a text of its own, whose own lines begin behind ``above`` and in ``line`` of the file.

    ``title`` is the line of the file in which its head ends.
    """

    text: bytes
    line: int
    title: int
    above: int = 0

    def moved(self, error: ReaderError, name: str) -> ReaderError:
        """Return an error of the section with its line counted from the top of the file."""

        def place(match: re.Match[str]) -> str:
            number = int(match[2])
            return f"{match[1]}{number + self.line - 1 - self.above if number > self.above else number}"

        text = re.sub(rf"^({re.escape(name)}: line )(\d+)", place, str(error))
        return ReaderError(error.status, f"{text} (in the recording from line {self.line} on)")


def labview_sections(text: bytes, name: str) -> list[TextSection]:
    """Return the segments of a file of LabVIEW, each below the head of the file; none where there is only one.

    Raises:
        ReaderError: ``wrong_shape`` where it is not seen where the head of a segment begins.
    """
    ends = [match.end() for match in _END.finditer(text)] if text.count(END_OF_HEAD.encode()) > 1 else []
    # The head of a segment that breaks off has no end.
    unended = None if len(ends) < 2 else _CHANNELS.search(text, ends[-1])
    if len(ends) + (unended is not None) < 3:
        return []
    begins = [ends[0]]
    for before, end in pairwise(ends[1:]):
        found = [match.start() for match in _CHANNELS.finditer(text, before, end)]
        if not found:
            raise ReaderError(
                "wrong_shape",
                f"{name}: a segment of data ends its head in line {_line(text, end) - 1}, and no line Channels begins "
                f"it; {HOW_TO_SPLIT}",
            )
        begins.append(found[-1])
    head = text[: ends[0]]
    titles = [_line(text, end) - 1 for end in ends[1:]]
    if unended is not None:
        begins.append(unended.start())
        titles.append(_line(text, unended.start()))
    return list(_cut(text, begins, titles, head))


def repeated_sections(text: bytes, heads: Sequence[str], zone: str) -> list[TextSection]:
    """Return the parts of a text that begin with a head that ends in the same line; none where there is only one.

    ``heads`` are the lines above the first numbers; ``zone`` is that of stamps.
    """
    title = next((line for line in reversed(heads) if line.strip()), "").strip()
    if not title or is_labview(text):
        return []
    lines = text.split(b"\n")
    titles = [number for number, line in enumerate(lines) if decoded(line[: 4 * len(title) + 8]).strip() == title]
    if not 2 <= len(titles) <= MAX_RECORDINGS:
        return []
    starts = [0]
    for place in titles[1:]:
        begin = place
        while begin > 0 and place - begin < MAX_HEAD_LINES and not is_row(lines[begin - 1], zone):
            begin -= 1
        starts.append(begin)
    places, at = [], 0
    wanted = set(starts)
    for number, line in enumerate(lines):
        if number in wanted:
            places.append(at)
        at += len(line) + 1
    return list(_cut(text, places, [number + 1 for number in titles], b""))


def _cut(text: bytes, begins: Sequence[int], titles: Sequence[int], head: bytes) -> Iterator[TextSection]:
    above, line, done = head.count(b"\n"), 1, 0
    for number, (begin, end) in enumerate(pairwise((*begins, len(text)))):
        line, done = line + text.count(b"\n", done, begin), begin
        part = text[begin:end]
        if end < len(text):
            part = part.rstrip(b"\r\n\t, ;") + b"\n"
        yield TextSection(head + part, line, titles[number], above)


def _line(text: bytes, place: int) -> int:
    return text.count(b"\n", 0, place) + 1
