"""Text files: numbers in lines, alone or below the head that a logger writes."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from streams.files.formats.head import (
    MAX_HEAD_LINES,
    TIMES,
    Head,
    StampedRows,
    begins_with_stamps,
    cut_head,
    head_of,
    names_and_units,
    split_stamps,
    titles_with_blanks,
)
from streams.files.formats.numbers import Dialect, first_line_of, located, parse_columns, parse_file, parse_row
from streams.files.judge import StatedValue, rate_of, stated_rate
from streams.files.parse.worker import from_disk
from streams.files.statements import plain_key, rate_of_times, stated_time, stated_unit, written_start
from streams.types.large import Data, FileBytes, elementwise
from streams.types.limits import MIN_COLUMNS_OF_A_ROW
from streams.types.samples import ReaderError, Samples, check_rows

_BOM = b"\xef\xbb\xbf"
_MAX_HEAD_BYTES = 4 << 20
"""Of a large file: its first lines of numbers stand in them."""
_IN_MS = {"timems"}


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

    Returns:
        Samples of shape (column, line), named by the header.

    Raises:
        ReaderError: ``empty`` without a line of numbers, ``wrong_shape`` where the columns do not fit, ``incomplete``
            where the last line breaks off, ``refused`` beyond the limits, ``unreadable`` for anything else; the
            message has line and column.
    """
    body, first_line = _body(data, name)
    head = first_line_of(body)
    dialect = _sniff(head, body, separators)
    names: tuple[str, ...] | None = None
    width = dialect.count(head)
    if as_row and width >= MIN_COLUMNS_OF_A_ROW and not body[len(head) :].strip():
        return Samples(parse_row(body, name, dialect, precision, first_line))
    check_rows(width, name, "columns")
    if header or (header is None and not any(dialect.is_number(field) for field in dialect.fields(head))):
        names = tuple(field.strip('"') for field in dialect.fields(head))
        body, first_line = body[len(head) + 1 :], first_line + 1
        if not body.strip():
            raise ReaderError("empty", f"{name}: no line of numbers" + (f" after the header {names[0]!r}"[:60]))
    head = first_line_of(body)
    width = dialect.count(head)
    if width == 1 and not dialect.is_number(dialect.fields(head)[0]):
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
    body = data.removeprefix(_BOM)
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


def _sniff(head: bytes, body: bytes, separators: str) -> Dialect:
    text = head.decode("latin-1").strip()
    found = next((c for c in separators if (c in text if c != " " else len(text.split()) > 1)), separators[0])
    decimal = "," if found in ";\t" and b"," in body and b"." not in body else "."
    return Dialect("" if found == " " else found, decimal)


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
def read_layout(data: Data, name: str, zone: str = "UTC") -> Samples:
    """Read a text file of a layout recognised without guessing, as (column, line).

    Above the numbers there may be lines ``KEY: VALUE`` (also with "=", ";", "," or a tab; "#" or "%" before them), a
    line of column names and a line of units. Known are the keys of the sampling rate or interval, the unit and the time
    of the first sample; units also stand behind a name, as ``x [g]``. A column called time (``t``, ``Time [s]``,
    ``X_Value``) is no channel but states the rate. A single line of many numbers with one name or none is one channel.
    ``zone`` is the IANA name of the zone of stamps that name none.

    Raises:
        ReaderError: as :func:`read_text`; ``wrong_rate`` for uneven times or contradictory rates.
    """
    if isinstance(data, FileBytes):
        found = _read_from_disk(data, name, zone)
        if found is not None:
            return found
    text = clean_text(data[:], name)
    stamped = split_stamps(text, name, zone)
    body, skipped = cut_head(text, name) if stamped is None else (stamped.body, stamped.head)
    # The text is not held while its numbers are parsed.
    del text
    head = head_of(skipped)
    if stamped is not None:
        return _with_times(_read_rows(body, head, name, zone, stamped.columns), stamped, name)
    return _read_rows(body, head, name, zone)


def _read_from_disk(data: FileBytes, name: str, zone: str) -> Samples | None:
    """Read a large file as :func:`read_layout`, line by line; None for one that has to be read as a whole.

    Such are UTF-16, rows with stamps, ends of lines without a newline, and few long lines.
    """
    begin = len(_BOM) if data.startswith(_BOM) else 0
    top = data[begin : begin + _MAX_HEAD_BYTES]
    if data.startswith((b"\xff\xfe", b"\xfe\xff")) or top.count(b"\n") < MAX_HEAD_LINES + 2 or top.isspace():
        return None
    if data.find(b"\0") >= 0:
        clean_text(b"\0", name)
    if begins_with_stamps(top, zone):
        return None
    rest, skipped = cut_head(top, name)
    begin += len(top) - len(rest)
    head, first = head_of(skipped), first_line_of(rest)
    points = data.find(b".", begin) >= 0
    dialect = _sniff(first, b"," if not points and data.find(b",", begin) >= 0 else b".", ";\t, ")
    width = dialect.count(first)
    if not dialect.is_number(dialect.fields(first)[0]) or not rest[len(first) :].strip():
        return None
    try:
        check_rows(width, name, "columns")
        samples = Samples(parse_file(data, begin, name, dialect, width))
    except ReaderError as error:
        raise _moved(error, name, head.lines, 0) from error
    return _titled(samples, head, name, zone)


def _with_times(samples: Samples, stamped: StampedRows, name: str) -> Samples:
    """Add what the stamps of the rows state."""
    times = np.where(stamped.times < -43200.0, stamped.times + 86400.0, stamped.times)
    samples = replace(samples, rate=_rate_with_times(samples.rate, times, name))
    if stamped.start is None:
        return samples
    is_open = stamped.start.open
    return replace(
        samples,
        start=None if is_open else stamped.start.fixed,
        stamp=stamped.start.text if is_open else None,
        written=stamped.start.text if stamped.start.local else None,
    )


def _rate_with_times(rate: float | None, times: NDArray[np.floating], name: str) -> float | None:
    """Return the rate in Hz on which the header and times in s agree."""
    return rate_of((StatedValue("the header", rate), StatedValue("the times", rate_of_times(times, name))), name)


def _read_rows(body: bytes, head: Head, name: str, zone: str, removed: int = 0) -> Samples:
    """Read the numbers below a head, of whose names the first ones are ``removed`` columns."""
    try:
        samples = read_text(body, name, header=False, as_row=head.names is None or len(head.names) == 1)
    except ReaderError as error:
        raise _moved(error, name, head.lines, removed) from error
    return _titled(samples, head, name, zone, removed)


def _titled(samples: Samples, head: Head, name: str, zone: str, removed: int = 0) -> Samples:
    """Give columns what the head states; arguments as :func:`_read_rows`."""
    width = len(samples.names)
    if removed:
        samples = Samples(samples.values, columns=tuple(column + removed for column in samples.columns))
    if head.title and head.names is not None and len(head.names) != width + removed:
        head.names = titles_with_blanks(head.title, width + removed) or head.names
    if head.names is not None and len(head.names) > removed:
        head.names = head.names[removed:]
        head.units = None if head.units is None else head.units[removed:]
    if head.names is not None and len(head.names) == width + 1 and plain_key(head.names[-1]) == "comment":
        head.names = head.names[:-1]
    if head.names is not None and len(head.names) != width:
        raise ReaderError(
            "wrong_shape", f"{name}: {len(head.names)} names in the header, {width} columns in line {head.lines + 1}"
        )
    return _described(samples, head, name, zone)


def _described(samples: Samples, head: Head, name: str, zone: str) -> Samples:
    """Add what the head states; a column of times gives the rate and is removed."""
    titles, names, units = names_and_units(samples, head)
    times = [i for i, title in enumerate(names) if plain_key(title) in TIMES] if head.names is not None else []
    rate = stated_rate(head.facts, name)
    start, stamp = stated_time(head.facts, zone)
    overall = stated_unit(head.facts)
    stated = tuple(unit or overall for unit in units)
    samples = replace(samples, channels=names, names=titles, units=stated)
    if len(times) == 1 and len(names) > 1:
        place = times[0]
        millis = plain_key(names[place]) in _IN_MS or (units[place] or "").lower() == "ms"
        seconds = elementwise(lambda times: times * (1e-3 if millis else 1.0), samples.values[place])
        rate = _rate_with_times(rate, seconds, name)
        if start is None and seconds[0] > 1e8:
            start, stamp = float(seconds[0]), None
        samples = samples.select([row for row in range(len(names)) if row != place])
    return replace(samples, rate=rate, start=start, stamp=stamp, written=written_start(head.facts, zone))


def _moved(error: ReaderError, name: str, lines: int, columns: int) -> ReaderError:
    """Return the error with its line counted from the top of the file, its column from the left."""
    line = re.compile(rf"^{re.escape(name)}: line (\d+)(?:, column (\d+))?")

    def place(match: re.Match[str]) -> str:
        column = "" if match[2] is None else f", column {int(match[2]) + columns}"
        return f"{name}: line {int(match[1]) + lines}{column}"

    return ReaderError(error.status, line.sub(place, str(error)))
