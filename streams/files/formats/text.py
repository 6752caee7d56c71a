"""Text files: numbers in lines, alone or below the head that a logger writes."""

from __future__ import annotations

import re
from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from streams.files.formats.below import add_footer, cut_footer, without_spectrum
from streams.files.formats.described import described
from streams.files.formats.encodings import in_utf8
from streams.files.formats.head import (
    MAX_HEAD_LINES,
    Head,
    cut_head,
    head_of,
    titles_with_blanks,
)
from streams.files.formats.lvm import END_OF_HEAD, is_labview, labview_body, labview_head
from streams.files.formats.numbers import (
    Dialect,
    first_line_of,
    is_plain,
    located,
    parse_columns,
    parse_file,
    parse_row,
    plain_numbers,
)
from streams.files.formats.sections import TextSection, labview_sections, repeated_sections
from streams.files.formats.stamped import is_row, lines_above_stamps, split_stamps
from streams.files.parse.worker import from_disk
from streams.files.successive import successive
from streams.types.large import Data, FileBytes
from streams.types.limits import MIN_COLUMNS_OF_A_ROW
from streams.types.samples import ReaderError, Samples, check_rows

_BOM = b"\xef\xbb\xbf"
_MAX_HEAD_BYTES = 4 << 20
"""Of a large file: its first lines of numbers stand in them."""
_MAX_TAIL_BYTES = 1 << 14


def read_text(
    data: bytes,
    name: str,
    *,
    separators: str = ";\t, ",
    header: bool | None = None,
    n_columns: int | tuple[int, ...] | None = None,
    columns: tuple[int, ...] | None = None,
    precision: type[np.float32] | type[np.float64] = np.float64,
    as_row: bool = False,
    head: Head | None = None,
) -> Samples:
    """Read lines of numbers, one line a sample and one column a channel.

    The separator is the first of ``separators`` that the first line holds; a blank stands for any run of them. Where it
    is ";" or a tab and the file has commas but no points, the commas are decimal. Leading lines that begin with "#" or
    "%" are comments, and so is a byte order mark. "nan" and "inf" are numbers, an empty field is not.

    Args:
        header: whether the first line names the columns; None: it does where none of its fields is a number.
        n_columns: the number or numbers of columns that the file may have; None: any.
        columns: which columns to give, counted from 1; None: all.
        precision: float64, or float32 where the numbers have no more than six significant digits.
        as_row: whether a single line of at least ``MIN_COLUMNS_OF_A_ROW`` numbers without names is one channel.
        head: what stands above the lines, whose names tell a decimal comma from a separator.

    Returns:
        Samples of shape (column, line), named by the header.

    Raises:
        ReaderError: ``empty`` without a line of numbers, ``wrong_shape`` where the columns do not fit, ``incomplete``
            where the last line breaks off, ``refused`` beyond the limits, ``unreadable`` for anything else; the
            message has line and column.
    """
    body, first_line = _body(data, name)
    line = first_line_of(body)
    dialect = _sniff(line, body, separators, head)
    if head is not None:
        head.decimal = dialect.decimal
    names: tuple[str, ...] | None = None
    width = dialect.count(line)
    if as_row and width >= MIN_COLUMNS_OF_A_ROW and not body[len(line) :].strip():
        return Samples(parse_row(body, name, dialect, precision, first_line))
    check_rows(width, name, "columns")
    if header or (header is None and not any(dialect.is_number(field) for field in dialect.fields(line))):
        names = tuple(field.strip('"') for field in dialect.fields(line))
        body, first_line = body[len(line) + 1 :], first_line + 1
        if not body.strip():
            raise ReaderError("empty", f"{name}: no line of numbers" + (f" after the header {names[0]!r}"[:60]))
    line = first_line_of(body)
    width = dialect.count(line)
    if width == 1 and not dialect.is_number(dialect.fields(line)[0]):
        raise located(body, name, dialect, width, first_line, "no number")
    check_rows(width, name, "columns")
    _check_width(width, n_columns, names, name, first_line)
    if columns is not None and max(columns) > width:
        raise ReaderError("wrong_shape", f"{name}: expected at least {max(columns)} columns, found {width}")
    values = parse_columns(body, name, dialect, width, columns, precision, first_line)
    if columns is None:
        return Samples(values, names or ())
    chosen = tuple(names[i - 1] if names else f"column_{i}" for i in columns)
    return Samples(values, chosen, columns=columns)


@from_disk
def first_characters(data: Data, name: str) -> str:
    """Return the first 200 characters of a text."""
    return data[:200].decode("latin-1")


def clean_text(data: bytes, name: str) -> bytes:
    """Return a text without byte order mark and with line ends that hold a newline.

    Raises:
        ReaderError: ``unreadable`` for binary data, ``empty`` where there is nothing but blanks.
    """
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        data = data[: len(data) // 2 * 2].decode("utf-16", "replace").encode("utf-8")
    if b"\0" in data:
        raise ReaderError(
            "unreadable", f"{name}: expected text, found binary data (or UTF-16 without a byte order mark)"
        )
    body = in_utf8(data.removeprefix(_BOM))
    if b"\n" not in body and b"\r" in body:
        body = body.replace(b"\r", b"\n")
    if not body or body.isspace():
        raise ReaderError("empty", f"{name}: no line of numbers ({len(data)} bytes)")
    return body


def _body(data: bytes, name: str) -> tuple[bytes, int]:
    """Return the text after byte order mark and comments, and its first line number."""
    body = clean_text(data, name)
    first_line = 1
    while body[:1] in (b"#", b"%"):
        body = body.partition(b"\n")[2]
        first_line += 1
    if not body or body.isspace():
        raise ReaderError("empty", f"{name}: no line of numbers ({len(data)} bytes)")
    return body, first_line


def _sniff(line: bytes, body: bytes, separators: str, head: Head | None = None) -> Dialect:
    text = line.decode("latin-1").strip()
    found = next((c for c in separators if (c in text if c != " " else len(text.split()) > 1)), separators[0])
    if found == "," and " " in separators and _has_decimal_commas(text, head):
        return Dialect("", ",")
    decimal = "," if found in ";\t" and b"," in body and b"." not in body else "."
    return Dialect("" if found == " " else found, decimal)


def _has_decimal_commas(line: str, head: Head | None) -> bool:
    """Return whether the commas of a line are decimal: one in each of its fields, of which there are as many as names.

    Without names they are where the digits behind them begin with 0, as those of a whole number do not.
    """
    fields = line.split()
    if not all(re.fullmatch(r"[-+]?\d+,\d+(?:[eE][-+]?\d+)?", field) for field in fields):
        return False
    if head is not None and head.names is not None:
        names = titles_with_blanks(head.title, len(fields)) if head.title else head.names
        return len(names or ()) == len(fields) and not head.title.count(",")
    return len(fields) > 1 or re.search(r",0\d", line) is not None


def _check_width(
    width: int, n_columns: int | tuple[int, ...] | None, names: tuple[str, ...] | None, name: str, line: int
) -> None:
    allowed = (n_columns,) if isinstance(n_columns, int) else n_columns
    if allowed is not None and width not in allowed:
        wanted = " or ".join(map(str, allowed))
        raise ReaderError("wrong_shape", f"{name}: line {line}: expected {wanted} columns, found {width}")
    if names is not None and len(names) != width:
        raise ReaderError("wrong_shape", f"{name}: {len(names)} names in the header, {width} columns in line {line}")


@from_disk
def read_layout(data: Data, name: str, zone: str = "UTC", disregard: Sequence[str] = ()) -> Samples:
    """Read a text file of a layout recognised without guessing, as (column, line).

    Above the numbers there may be lines ``KEY: VALUE`` (also with "=", ";", "," or a tab; "#" or "%" before them), a
    line of column names and a line of units; or the heads of LabVIEW (:mod:`.lvm`). Known are the keys of the sampling
    rate or interval, the unit and the time of the first sample; units also stand behind a name, as ``x [g]``. A column
    of times (``t``, ``Time [us]``, ``epoch_ms``, ``X_Value``) is no channel but states the rate, and the start where it
    counts from 1970; a running number is no channel either. A single line of many numbers with one name or none is one
    channel. Where the head stands again among the numbers, another recording begins.

    Args:
        zone: IANA name of the zone of stamps that name none.
        disregard: patterns of the keys that are not believed.

    Raises:
        ReaderError: as :func:`read_text`; ``wrong_rate`` for uneven times; as :func:`streams.files.judge.judged` for
            statements that contradict each other; as :func:`streams.files.successive.successive`.
    """
    found = _read_from_disk(data, name) if isinstance(data, FileBytes) else None
    if found is not None:
        return described(*found, name, zone, disregard)
    if is_labview(data[:64].removeprefix(_BOM)) and (sections := labview_sections(clean_text(data[:], name), name)):
        return _in_sections(sections, name, zone, disregard)
    try:
        # The text is not held while its numbers are parsed.
        return _read_alone(clean_text(data[:], name), name, zone, disregard)[0]
    except ReaderError as error:
        text = clean_text(data[:], name)
        sections = repeated_sections(text, _lines_above(text, name, zone), zone) if error.status != "empty" else []
        if not sections:
            raise
    return _in_sections(sections, name, zone, disregard)


def _in_sections(sections: Sequence[TextSection], name: str, zone: str, disregard: Sequence[str]) -> Samples:
    """Return the recordings of a text, without the last one where it breaks off.

    Raises:
        ReaderError: ``incomplete`` where another one has fewer rows than its head says; as :func:`_read_alone`.
    """
    found: list[tuple[str, Samples]] = []
    torn: list[str] = []
    for section in sections:
        try:
            samples, promised = _read_alone(section.text, name, zone, disregard)
            if samples.values.shape[1] < promised:
                reason = f"{promised} samples promised, {samples.values.shape[1]} there"
                raise ReaderError("incomplete", f"{name}: {reason}")
            found.append((f"that with its head in line {section.title}", samples))
        except ReaderError as error:
            told = section.moved(error, name)
            if section is not sections[-1] or not found or not _breaks_off(section, error, name, zone, disregard):
                raise told from error
            torn.append(str(told))
    return successive(found, name, zone, torn)


def _breaks_off(section: TextSection, error: ReaderError, name: str, zone: str, disregard: Sequence[str]) -> bool:
    """Return whether the last recording of a text ends too early: in its head, in its last row, or below its last."""
    own = section.text.split(b"\n")[section.above :]
    if error.status == "incomplete" or not any(is_row(line, zone) for line in own):
        return True
    without_last = section.text[: section.text.rstrip().rfind(b"\n") + 1]
    with suppress(ReaderError):
        _read_alone(without_last, name, zone, disregard)
        return True
    return False


def _lines_above(text: bytes, name: str, zone: str) -> list[str]:
    """Return the lines above the first row of numbers, [] where there is none."""
    with suppress(ReaderError):
        return lines_above_stamps(text, zone) or cut_head(text, name)[1]
    return []


def _read_alone(text: bytes, name: str, zone: str, disregard: Sequence[str]) -> tuple[Samples, int]:
    """Read a text of one recording; return also how many rows its head promises at least."""
    text, footer = (text, []) if is_labview(text) else cut_footer(text, zone)
    stamped = None if is_labview(text) else split_stamps(text, name, zone)
    body, skipped = cut_head(text, name) if stamped is None else (stamped.body, stamped.head)
    head = _head_of(skipped, name)
    removed = 0 if stamped is None else stamped.columns
    if is_labview(text):
        body = labview_body(body)
    else:
        add_footer(head, footer)
        body = plain_numbers(body if removed else without_spectrum(body, head))
    del text
    # Behind a stamp a single column may be left, with decimal commas.
    separators = head.separators if stamped is None or stamped.separator not in ";\t" else stamped.separator
    alone = head.names is None or len(head.names) == 1
    try:
        samples = read_text(body, name, separators=separators, header=False, as_row=alone, head=head)
    except ReaderError as error:
        raise _moved(error, name, head.lines, removed) from error
    return described(_titled(samples, head, name, removed), head, name, zone, disregard, stamped), head.promised


def _head_of(lines: list[str], name: str) -> Head:
    return labview_head(lines, name) if is_labview(lines[0].encode() if lines else b"") else head_of(lines)


def _read_from_disk(data: FileBytes, name: str) -> tuple[Samples, Head] | None:
    """Read a large file as :func:`read_layout`, line by line; None for one that has to be read as a whole.

    Such are other encodings than UTF-8, rows with stamps, several recordings, footers, ends of lines without a newline,
    and few long lines.
    """
    begin = len(_BOM) if data.startswith(_BOM) else 0
    top = data[begin : begin + _MAX_HEAD_BYTES]
    if data.startswith((b"\xff\xfe", b"\xfe\xff")) or top.count(b"\n") < MAX_HEAD_LINES + 2 or top.isspace():
        return None
    if data.find(b"\0") >= 0:
        clean_text(b"\0", name)
    if is_labview(top):
        if data.find(END_OF_HEAD.encode(), len(top) - len(cut_head(top, name)[0])) >= 0:
            return None
    elif lines_above_stamps(top, "UTC") is not None:
        return None
    rest, skipped = cut_head(top, name)
    if in_utf8(top) is not top or cut_footer(data[max(0, len(data) - _MAX_TAIL_BYTES) :], "UTC")[1]:
        return None
    begin += len(top) - len(rest)
    head, first = _head_of(skipped, name), first_line_of(rest)
    points = data.find(b".", begin) >= 0
    dialect = _sniff(first, b"," if not points and data.find(b",", begin) >= 0 else b".", head.separators, head)
    width, head.decimal = dialect.count(first), dialect.decimal
    if not is_plain(first) or not dialect.is_number(dialect.fields(first)[0]) or not rest[len(first) :].strip():
        return None
    try:
        check_rows(width, name, "columns")
        samples = Samples(parse_file(data, begin, name, dialect, width))
    except ReaderError as error:
        raise _moved(error, name, head.lines, 0) from error
    return _titled(samples, head, name), head


def _titled(samples: Samples, head: Head, name: str, removed: int = 0) -> Samples:
    """Check the names of a head, of which the first ones are of ``removed`` columns, against the columns."""
    width = len(samples.names)
    if removed:
        samples = Samples(samples.values, columns=tuple(column + removed for column in samples.columns))
    if head.title and head.names is not None and len(head.names) != width + removed:
        head.names = titles_with_blanks(head.title, width + removed) or head.names
    if head.names is not None and len(head.names) > removed:
        head.names = head.names[removed:]
        head.units = None if head.units is None else head.units[removed:]
    while head.names is not None and len(head.names) > width + 1 and not head.names[-1]:
        head.names = head.names[:-1]
    if head.names is not None and len(head.names) == width + 1 and head.names[-1].lower() in ("comment", ""):
        head.names, head.of_columns = head.names[:-1], head.of_columns[:width]
        head.units = None if head.units is None else head.units[:width]
    if head.names is not None and len(head.names) != width:
        raise ReaderError(
            "wrong_shape", f"{name}: {len(head.names)} names in the header, {width} columns in line {head.lines + 1}"
        )
    return samples


def _moved(error: ReaderError, name: str, lines: int, columns: int) -> ReaderError:
    """Return the error with its line counted from the top of the file, its column from the left."""
    line = re.compile(rf"^{re.escape(name)}: line (\d+)(?:, column (\d+))?")

    def place(match: re.Match[str]) -> str:
        column = "" if match[2] is None else f", column {int(match[2]) + columns}"
        return f"{name}: line {int(match[1]) + lines}{column}"

    return ReaderError(error.status, line.sub(place, str(error)))
