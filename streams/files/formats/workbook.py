"""The sheets of an Excel workbook as lines of cells.

Source: ECMA-376, Office Open XML, part 1, 18 (SpreadsheetML). Nothing is evaluated: of a formula the value that the
workbook keeps counts. No document type, and so no entity, is accepted.
"""

from __future__ import annotations

import re
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from typing import Any
from xml.parsers import expat

from streams.files.formats.numbers import is_number
from streams.types.limits import MAX_ROWS
from streams.types.samples import ReaderError, check_rows

_MAX_SHEET_ROWS = 1 << 20
_PIECE_BYTES = 1 << 16
_BUILT_IN = {
    **dict.fromkeys((*range(14, 18), *range(27, 32), 36, *range(50, 59)), "day"),
    **dict.fromkeys((*range(18, 22), 45, 46, 47), "clock"),
    22: "moment",
}
"""Formats of dates and times that a workbook does not define, by number."""
_UNSAID = re.compile(r'"[^"]*"|\\.|_.|\*.|\[(?!h+\]|m+\]|s+\])[^\]]*\]', re.IGNORECASE)
"""Parts of a format of numbers that are text, colours and conditions."""
_MIN_DATE_DAYS = 366.0
"""A time of day of more days than this is a date of which the time is shown."""


@dataclass
class Worksheet:
    """A sheet as lines: of each row the first column with a cell, from 0, and its cells with tabs between them.

    ``tables`` are the rows that begin with a number and hold more numbers than texts.
    """

    title: str
    lines: list[tuple[int, str]] = field(default_factory=list)
    tables: list[int] = field(default_factory=list)


@dataclass
class _Workbook:
    """What cells refer to: texts, the kind of format by style ("day", "clock", "moment"), and day 0."""

    texts: list[str]
    formats: list[str]
    epoch: datetime


def sheets_of(packed: zipfile.ZipFile, name: str) -> Iterator[Worksheet]:
    """Yield the sheets of a workbook in order."""
    root = next(
        (target for kind, target in _relations(packed, "", "_rels/.rels").values() if kind == "officeDocument"),
        "xl/workbook.xml",
    )
    folder, _, file = root.rpartition("/")
    relations = _relations(packed, folder, f"{folder}/_rels/{file}.rels".removeprefix("/"))
    of_kind = dict(relations.values())
    titles: list[tuple[str, str]] = []
    epoch = datetime(1899, 12, 30)
    for tag, attributes in _elements(packed, root):
        if tag == "workbookPr" and attributes.get("date1904") in ("1", "true"):
            epoch = datetime(1904, 1, 1)
        elif tag == "sheet":
            kind, target = relations.get(_local(attributes, "id"), ("", ""))
            if kind == "worksheet":
                titles.append((attributes.get("name", ""), target))
    texts = _shared(packed, of_kind["sharedStrings"]) if "sharedStrings" in of_kind else []
    formats = list(_formats(packed, of_kind["styles"])) if "styles" in of_kind else []
    book = _Workbook(texts, formats, epoch)
    for title, target in titles:
        yield _Parser(packed, target, Worksheet(title), book, name).sheet


def _relations(packed: zipfile.ZipFile, folder: str, part: str) -> dict[str, tuple[str, str]]:
    """Return kind and path of the parts to which a part refers, by identifier."""
    if part not in packed.namelist():
        return {}
    return {
        attributes["Id"]: (
            attributes.get("Type", "").rpartition("/")[2],
            _joined(folder, attributes["Target"]),
        )
        for tag, attributes in _elements(packed, part)
        if tag == "Relationship" and attributes.get("TargetMode") != "External"
    }


def _joined(folder: str, target: str) -> str:
    if target.startswith("/"):
        return target[1:]
    parts = folder.split("/") if folder else []
    for word in target.split("/"):
        if word == ".." and parts:
            parts.pop()
        elif word not in ("", "."):
            parts.append(word)
    return "/".join(parts)


def _local(attributes: Mapping[str, str], word: str) -> str:
    """Return the attribute of a name whatever its namespace, "" where there is none."""
    return next((value for key, value in attributes.items() if key.rpartition(":")[2] == word and ":" in key), "")


@contextmanager
def _no_types() -> Iterator[Any]:
    """Give a parser that refuses document types."""
    parser = expat.ParserCreate()
    parser.buffer_text = True

    def refuse(*_: object) -> None:
        raise ValueError("a document type")

    parser.StartDoctypeDeclHandler = refuse
    yield parser


def _feed(parser: Any, packed: zipfile.ZipFile, part: str) -> None:
    with packed.open(part) as stream:
        while piece := stream.read(_PIECE_BYTES):
            parser.Parse(piece, False)
        parser.Parse(b"", True)


def _elements(packed: zipfile.ZipFile, part: str) -> list[tuple[str, dict[str, str]]]:
    """Return the elements of a small part with their attributes."""
    found: list[tuple[str, dict[str, str]]] = []
    with _no_types() as parser:
        parser.StartElementHandler = lambda tag, attributes: found.append((tag.rpartition(":")[2], attributes))
        _feed(parser, packed, part)
    return found


def _shared(packed: zipfile.ZipFile, part: str) -> list[str]:
    """Return the texts that cells share; those of phonetic runs are none."""
    found: list[str] = []
    words: list[str] = []
    inside = {"t": 0, "rPh": 0}

    def start(tag: str, _: object) -> None:
        if (tag := tag.rpartition(":")[2]) in inside:
            inside[tag] += 1

    def end(tag: str) -> None:
        if (tag := tag.rpartition(":")[2]) in inside:
            inside[tag] -= 1
        elif tag == "si":
            found.append("".join(words))
            words.clear()

    def text(part: str) -> None:
        if inside["t"] and not inside["rPh"]:
            words.append(part)

    with _no_types() as parser:
        parser.StartElementHandler, parser.EndElementHandler, parser.CharacterDataHandler = start, end, text
        _feed(parser, packed, part)
    return found


def _formats(packed: zipfile.ZipFile, part: str) -> Iterator[str]:
    """Yield of each style of cells whether its numbers are shown as "day", "clock", both ("moment") or neither ("")."""
    own: dict[str, str] = {}
    inside = False
    for tag, attributes in _elements(packed, part):
        if tag == "numFmt":
            own[attributes.get("numFmtId", "")] = attributes.get("formatCode", "")
        elif tag in ("cellXfs", "cellStyleXfs", "cellStyles", "dxfs"):
            inside = tag == "cellXfs"
        elif tag == "xf" and inside:
            number = attributes.get("numFmtId", "0")
            yield _kind_of(own.get(number), int(number))


def _kind_of(code: str | None, number: int) -> str:
    if code is None:
        return _BUILT_IN.get(number, "")
    words = _UNSAID.sub("", code.partition(";")[0]).lower()
    words = re.sub(r"general|standard|am/pm|a/p", "", words)
    has_clock = "h" in words or "s" in words
    if "y" in words or "d" in words or ("m" in words and not has_clock):
        return "moment" if has_clock else "day"
    return "clock" if has_clock else ""


class _Parser:
    """Turns the cells of a sheet into its lines."""

    def __init__(self, packed: zipfile.ZipFile, part: str, sheet: Worksheet, book: _Workbook, name: str) -> None:
        """Parse a part; ReaderError as :func:`read_xlsx`."""
        self.sheet, self._book, self._name = sheet, book, name
        self._row, self._column = 0, -1
        self._cells: list[str] = []
        self._first, self._numbers, self._leads = 0, 0, False
        self._kind, self._style, self._has_formula, self._is_value = "n", "", False, False
        self._value, self._has_prefix = "", False
        self._columns: dict[str, int] = {}
        with _no_types() as parser:
            parser.StartElementHandler, parser.EndElementHandler = self._root, self._end
            parser.CharacterDataHandler = self._text
            self._xml = parser
            _feed(parser, packed, part)

    def _root(self, tag: str, _: dict[str, str]) -> None:
        self._has_prefix = ":" in tag
        self._xml.StartElementHandler = self._start

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        if self._has_prefix:
            tag = tag.rpartition(":")[2]
        if tag == "v" or tag == "t":
            self._is_value = True
        elif tag == "c":
            self._kind, self._style = attributes.get("t", "n"), attributes.get("s", "")
            place = attributes.get("r")
            self._column = self._column + 1 if place is None else self._place(place)
            self._value, self._has_formula = "", False
        elif tag == "f":
            self._has_formula = True
        elif tag == "row":
            row = int(attributes.get("r", self._row + 1))
            if not self._row < row <= _MAX_SHEET_ROWS:
                raise ReaderError("refused", f"{self._name}: row {row} of {self.sheet.title!r}, behind {self._row}")
            self.sheet.lines += [(0, "")] * (row - self._row - 1)
            self._row, self._column = row, -1
            self._cells, self._numbers, self._leads = [], 0, False

    def _place(self, cell: str) -> int:
        """Return the column of a cell such as ``AB12``, from 0."""
        letters = cell.rstrip("0123456789")
        found = self._columns.get(letters)
        if found is None:
            column = 0
            for letter in letters[:4]:
                column = 26 * column + ord(letter.upper()) - ord("A") + 1
            check_rows(column, self._name, f"columns in {self.sheet.title!r}")
            found = self._columns[letters] = column - 1
        return found

    def _text(self, part: str) -> None:
        if self._is_value:
            self._value += part

    def _end(self, tag: str) -> None:
        if self._has_prefix:
            tag = tag.rpartition(":")[2]
        if tag == "v" or tag == "t":
            self._is_value = False
        elif tag == "c":
            self._add_cell()
        elif tag == "row":
            self._add_line()

    def _add_cell(self) -> None:
        text, is_numeric = self._value, True
        if self._kind != "n" or self._style:
            text, is_numeric = self._shown(text)
        if not text:
            if self._has_formula:
                where = f"sheet {self.sheet.title!r}, row {self._row}, column {self._column + 1}"
                reason = "a formula without its value; open the workbook in Excel and save it"
                raise ReaderError("unreadable", f"{self._name}: {where}: {reason}")
            return
        if not self._cells:
            self._first, self._leads = self._column, is_numeric
        missing = self._column - self._first - len(self._cells)
        if missing < 0 or self._column >= MAX_ROWS:
            raise ReaderError("unreadable", f"{self._name}: {self.sheet.title!r}: cells of row {self._row} disordered")
        if missing:
            self._cells += [""] * missing
        self._cells.append(text)
        self._numbers += is_numeric

    def _shown(self, value: str) -> tuple[str, bool]:
        """Return the text of a cell, and whether it is a number, a date or a time."""
        kind, book = self._kind, self._book
        if kind == "n":
            form = book.formats[int(self._style)] if value and self._style and book.formats else ""
            return (_dated(float(value), form, book.epoch) if form else value), bool(value)
        if kind == "b":
            return value, True
        text = book.texts[int(value)] if kind == "s" else value
        text = " ".join(text.replace(";", ",").split())
        if kind == "d":
            return text.replace("T", " "), True
        return text, bool(text) and is_number(text)

    def _add_line(self) -> None:
        cells = self._cells
        if self._leads and 2 * self._numbers >= len(cells):
            self.sheet.tables.append(len(self.sheet.lines))
        self.sheet.lines.append((self._first if cells else 0, "\t".join(cells)))


def _dated(days: float, form: str, epoch: datetime) -> str:
    """Return a cell of days since the first one as date, time of day or both."""
    moment = epoch + timedelta(microseconds=round(days * 86400e6))
    if form == "clock" and days < _MIN_DATE_DAYS:
        return moment.strftime("%H:%M:%S.%f") if days < 1.0 else repr(days * 86400.0)
    return moment.strftime("%Y-%m-%d") if days == int(days) and form == "day" else moment.isoformat(" ", "microseconds")
