"""Lines of numbers: fields, one pass of pandas over them, and the place of what is no number."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from streams.types import large
from streams.types.large import FileBytes, empty_rows, forget_pages
from streams.types.limits import MAX_BYTES
from streams.types.samples import ReaderError

_BLANKS = b"\r\n "
_NOT_A_NUMBER = ["nan", "NaN", "NAN", "-nan"]


@dataclass(frozen=True)
class Dialect:
    """How the lines of a text are cut; ``separator`` "" stands for any run of blanks."""

    separator: str
    decimal: str

    def fields(self, line: bytes) -> list[str]:
        """Return the fields of a line, without blanks around them."""
        text = line.decode("latin-1")
        parts = text.split(self.separator) if self.separator else text.split()
        return [part.strip() for part in parts]

    def count(self, line: bytes) -> int:
        """Return the number of fields, without making them where a separator can be counted."""
        return line.count(self.separator.encode()) + 1 if self.separator else len(self.fields(line))

    def is_number(self, field: str) -> bool:
        """Return whether a field is a number, see :func:`is_number`."""
        return is_number(field, self.decimal)


def is_number(field: str, decimal: str = ",") -> bool:
    """Return whether a field is a number, with a point or the sign given."""
    if "_" in field:
        return False
    try:
        float(field.replace(decimal, "."))
    except ValueError:
        return False
    return True


def first_line_of(body: bytes, begin: int = 0) -> bytes:
    """Return the line that begins at ``begin``, without its newline."""
    end = body.find(b"\n", begin)
    return body[begin:] if end < 0 else body[begin:end]


_GROUPING = ((rb"\.", rb",\d"), (rb",", rb"\.\d"), (rb"'", b""), (rb" |\xc2\xa0|\xa0|\xe2\x80\xaf", b""))
"""Signs that may group thousands, and what must follow such a number once that they do."""


def is_plain(line: bytes) -> bool:
    """Return whether a line of numbers has neither quotes nor a separator at its end."""
    return b'"' not in line and not line.rstrip(b"\r ").endswith((b";", b",", b"\t"))


def plain_numbers(body: bytes) -> bytes:
    """Return lines of numbers without quotes, separators behind the last fields, and signs that group thousands.

    A separator is left that stands behind some lines alone: a number is missing there. Points and commas group where
    the other sign stands behind one of them, each before three digits: ``1.234,5``.
    """
    first = first_line_of(body)
    if b'"' in first:
        inner = any(b"," in part for part in re.findall(rb'"([^"\n]*)"', body))
        body = re.sub(rb'"[^"\n]*"|,', _unquoted, body) if inner else body.replace(b'"', b"")
        first = first_line_of(body)
    bare = first.rstrip(b"\r ")
    sign = next((sign for sign in (b";", b",", b"\t") if bare.endswith(sign)), b"")
    if sign:
        text = body.rstrip(b"\r\n ")
        # Columns of which only the head has something: as many as are empty in all rows.
        for length in range(len(bare) - len(bare.rstrip(sign)), 0, -1):
            behind = sign * length
            ends = (behind + b"\r\n", behind + b"\n")
            if sum(map(text.count, ends)) + text.endswith(behind) == text.count(b"\n") + 1:
                body = text.removesuffix(behind).replace(ends[0], b"\r\n").replace(ends[1], b"\n") + b"\n"
                break
    if b";" not in first and b"\t" not in first:
        return body
    for sign, behind in _GROUPING:
        proof = rb"\d(?:" + sign + rb")\d{3}(?!\d)" + behind
        if re.search(sign, body) and re.search(proof, body):
            alone = rb"(?:" + sign + rb")(?!\d{3}(?!\d))"
            if not behind or not re.search(alone, body):
                body = re.sub(rb"(?<=\d)(?:" + sign + rb")(?=\d{3}(?!\d))", b"", body)
    return body


def _unquoted(match: re.Match[bytes]) -> bytes:
    """Return a field without quotes, or a separator that its commas are told from."""
    return b";" if match[0] == b"," else match[0].strip(b'"')


def parse_columns(
    body: bytes,
    name: str,
    dialect: Dialect,
    width: int,
    columns: tuple[int, ...] | None,
    precision: type[np.float32] | type[np.float64],
    first_line: int,
) -> NDArray[np.floating]:
    """Return the numbers of lines of ``width`` fields, or of some ``columns`` counted from 1, as (column, line).

    Raises:
        ReaderError: with the place of the first field that is missing or no number; ``refused`` for too many.
    """
    # One newline behind the last digit is no reason for a copy.
    trimmed = body if body[-1:] == b"\n" and body[-2:-1].isdigit() else body.rstrip(_BLANKS)
    n_lines = trimmed.count(b"\n") + (trimmed[-1:] != b"\n")
    _check_count(n_lines * (width if columns is None else len(columns)), precision, name)

    def wrong(reason: str) -> ReaderError:
        return located(body, name, dialect, width, first_line, reason)

    # pandas silently drops surplus fields where only some columns are read.
    if dialect.separator and trimmed.count(dialect.separator.encode()) != n_lines * (width - 1):
        raise wrong("the columns do not agree")
    try:
        # A number beyond float32 becomes inf, which the quality stage names.
        with np.errstate(over="ignore"):
            values = _parse_with_pandas(trimmed, dialect, columns, precision)
    except (ValueError, OverflowError) as error:
        raise wrong(str(error)) from error
    if values.shape[1] != n_lines:
        raise wrong(f"{n_lines} lines, but {values.shape[1]} of numbers")
    return values


def parse_file(data: FileBytes, begin: int, name: str, dialect: Dialect, width: int) -> NDArray[np.floating]:
    """Return what :func:`parse_columns` gives of all columns of the lines from ``begin`` on, read piece by piece.

    Raises:
        ReaderError: as that; line numbers count from ``begin``.
    """
    end = _trimmed_end(data, begin)
    n_lines = sum(piece.count(b"\n") for piece in _between(data, begin, end)) + 1
    _check_count(n_lines * width, np.float64, name)
    values = empty_rows((width, n_lines), np.float64)
    done = 0
    first = b""
    for lines in _whole_lines(data, begin, end):
        first = first or first_line_of(lines)
        last = begin + len(lines) >= end
        begin += len(lines)
        trimmed = lines if last else lines[:-1]
        count = trimmed.count(b"\n") + 1
        # The last byte of the file tells whether its last line is complete.
        body = lines + data[max(end, len(data) - 1) :] if last else lines
        try:
            if dialect.separator and trimmed.count(dialect.separator.encode()) != count * (width - 1):
                raise ValueError("the columns do not agree")
            # The first line tells pandas how many columns there are.
            part = _parse_with_pandas(first + b"\n" + trimmed, dialect, None, np.float64)[:, 1:]
            if part.shape[1] != count:
                raise ValueError(f"{count} lines, but {part.shape[1]} of numbers")
        except (ValueError, OverflowError) as error:
            raise located(body, name, dialect, width, done + 1, str(error), trimmed) from error
        values[:, done : done + count] = part
        forget_pages(values)
        done += count
    return values


def _between(data: FileBytes, begin: int, end: int) -> Iterator[bytes]:
    """Yield a part of a file in pieces."""
    for place in range(begin, end, large.PIECE_BYTES):
        yield data[place : min(place + large.PIECE_BYTES, end)]


def _trimmed_end(data: FileBytes, begin: int) -> int:
    """Return the place behind the last byte that is not blank."""
    end = len(data)
    while end > begin:
        place = max(begin, end - large.PIECE_BYTES)
        left = len(data[place:end].rstrip(_BLANKS))
        if left:
            return place + left
        end = place
    return begin


def _whole_lines(data: FileBytes, begin: int, end: int) -> Iterator[bytes]:
    """Yield pieces of whole lines with their ends, the last up to ``end``."""
    rest = b""
    for piece in _between(data, begin, end):
        lines, newline, behind = piece.rpartition(b"\n")
        if newline:
            yield rest + lines + newline
            rest = behind
        else:
            rest += piece
    yield rest


def _check_count(numbers: int, precision: type[np.floating], name: str) -> None:
    """Raise ``refused`` for more numbers than a file may have."""
    size = numbers * np.dtype(precision).itemsize
    if size > MAX_BYTES:
        raise ReaderError("refused", f"{name}: {numbers} numbers of {size} bytes, {MAX_BYTES} bytes are allowed")


def parse_row(
    body: bytes, name: str, dialect: Dialect, precision: type[np.float32] | type[np.float64], first_line: int
) -> NDArray[np.floating]:
    """Return the numbers of one line in shape (1, number); as a column, since pandas is slow with many columns."""
    trimmed = body.rstrip(_BLANKS)
    width = dialect.count(trimmed)
    _check_count(width, precision, name)
    column = trimmed.replace(dialect.separator.encode(), b"\n") if dialect.separator else b"\n".join(trimmed.split())
    try:
        with np.errstate(over="ignore"):
            values = _parse_with_pandas(column, dialect, None, precision)
    except (ValueError, OverflowError) as error:
        raise located(body, name, dialect, width, first_line, str(error)) from error
    if values.shape != (1, width):
        raise located(body, name, dialect, width, first_line, f"{width} fields, but {values.size} numbers")
    return values


def _parse_with_pandas(
    body: bytes, dialect: Dialect, columns: tuple[int, ...] | None, precision: type[np.float32] | type[np.float64]
) -> NDArray[np.floating]:
    # The one import here that takes half a second.
    import pandas as pd

    frame = pd.read_csv(
        io.BytesIO(body),
        header=None,
        sep=dialect.separator or r"\s+",
        decimal=dialect.decimal,
        usecols=None if columns is None else [i - 1 for i in columns],
        dtype=precision,
        engine="c",
        quoting=csv.QUOTE_NONE,
        keep_default_na=False,
        na_values=_NOT_A_NUMBER,
        skip_blank_lines=True,
    )
    return np.ascontiguousarray(frame.to_numpy(dtype=precision).T)


def located(
    body: bytes, name: str, dialect: Dialect, width: int, first_line: int, reason: str, trimmed: bytes | None = None
) -> ReaderError:
    """Return the error of the first line that is not ``width`` numbers; slow.

    ``trimmed``: the lines, by default without what is blank behind the last one.
    """
    lines = (body.rstrip(_BLANKS) if trimmed is None else trimmed).split(b"\n")
    broken_off = not body.endswith((b"\n", b"\r"))
    for index, line in enumerate(lines):
        fields = dialect.fields(line.rstrip(b"\r"))
        last = broken_off and index == len(lines) - 1
        where = f"{name}: line {first_line + index}"
        if len(fields) != width:
            status = "incomplete" if last and len(fields) < width else "wrong_shape"
            return ReaderError(status, f"{where}: expected {width} columns, found {len(fields)}")
        for column, text in enumerate(fields, start=1):
            if not dialect.is_number(text):
                shown = re.sub(r"[^ -~]", "?", text[:30])
                status = "incomplete" if last and column == width else "unreadable"
                return ReaderError(status, f"{where}, column {column}: expected a number, found {shown!r}")
    return ReaderError("unreadable", f"{name}: {reason}")
