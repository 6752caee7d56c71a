"""Numbers in lines of text: CSV, semicolons, tabs or blanks between them."""

from __future__ import annotations

import csv
import io
import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from streams.samples import ReaderError, Samples

_NOT_A_NUMBER = ["nan", "NaN", "NAN", "-nan"]
_BOM = b"\xef\xbb\xbf"


@dataclass(frozen=True)
class _Dialect:
    """How the lines of a text are cut; ``separator`` "" stands for any run of blanks."""

    separator: str
    decimal: str

    def fields(self, line: bytes) -> list[str]:
        text = line.decode("latin-1")
        parts = text.split(self.separator) if self.separator else text.split()
        return [part.strip() for part in parts]

    def is_number(self, field: str) -> bool:
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


def read_text(
    data: bytes,
    name: str,
    *,
    separators: str = ";\t, ",
    header: bool | None = None,
    n_columns: int | tuple[int, ...] | None = None,
    columns: tuple[int, ...] | None = None,
    precision: type[np.float32] | type[np.float64] = np.float64,
) -> Samples:
    """Read lines of numbers, one line a sample and one column a channel.

    The separator is the first of ``separators`` that the first line holds; a blank stands for any run of them. Where it
    is ";" or a tab and the file has commas but no points, the commas are decimal. Leading lines that begin with "#" or
    "%" are comments, and so is a byte order mark. "nan" and "inf" are numbers, an empty field is not.

    Args:
        separators: the separators that may occur.
        header: whether the first line names the columns; None: it does where none of its fields is a number.
        n_columns: the number or numbers of columns that the file may have; None: any.
        columns: which columns to give, counted from 1; None: all.
        precision: float64, or float32 where the numbers have no more than six significant digits.

    Returns:
        Samples of shape (column, line); the names of the header, or ``column_1`` and so on.

    Raises:
        ReaderError: ``empty`` without a line of numbers, ``wrong_shape`` where the columns do not fit, ``incomplete``
            where the last line breaks off, ``unreadable`` for anything else; the message has line and column.
    """
    body, first_line = _body(data, name)
    head = first_line_of(body)
    dialect = _sniff(head, body, separators)
    names: tuple[str, ...] | None = None
    if header or (header is None and not any(dialect.is_number(field) for field in dialect.fields(head))):
        names = tuple(field.strip('"') for field in dialect.fields(head))
        body, first_line = body[len(head) + 1 :], first_line + 1
        if not body.strip():
            raise ReaderError("empty", f"{name}: no line of numbers" + (f" after the header {names[0]!r}"[:60]))
    fields = dialect.fields(first_line_of(body))
    width = len(fields)
    if width == 1 and not dialect.is_number(fields[0]):
        raise _located(body, name, dialect, width, first_line, "no number")
    _check_width(width, n_columns, names, name, first_line)
    if columns is not None and max(columns) > width:
        raise ReaderError("wrong_shape", f"{name}: expected at least {max(columns)} columns, found {width}")
    values = _parse(body, name, dialect, width, columns, precision, first_line)
    if columns is None:
        return Samples(values, names or ())
    chosen = tuple(names[i - 1] if names else f"column_{i}" for i in columns)
    return Samples(values, chosen, columns=columns)


def first_line_of(body: bytes, begin: int = 0) -> bytes:
    """Return the line that begins at ``begin``, without its newline."""
    end = body.find(b"\n", begin)
    return body[begin:] if end < 0 else body[begin:end]


def clean_text(data: bytes, name: str) -> bytes:
    """Return a text without byte order mark and with line ends that hold a newline.

    Raises:
        ReaderError: ``unreadable`` for binary data, ``empty`` where there is nothing but blanks.
    """
    if b"\0" in data:
        raise ReaderError("unreadable", f"{name}: expected text, found binary data (or UTF-16)")
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


def _sniff(head: bytes, body: bytes, separators: str) -> _Dialect:
    text = head.decode("latin-1").strip()
    found = next((c for c in separators if (c in text if c != " " else len(text.split()) > 1)), separators[0])
    decimal = "," if found in ";\t" and b"," in body and b"." not in body else "."
    return _Dialect("" if found == " " else found, decimal)


def _check_width(
    width: int, n_columns: int | tuple[int, ...] | None, names: tuple[str, ...] | None, name: str, line: int
) -> None:
    allowed = (n_columns,) if isinstance(n_columns, int) else n_columns
    if allowed is not None and width not in allowed:
        wanted = " or ".join(map(str, allowed))
        raise ReaderError("wrong_shape", f"{name}: line {line}: expected {wanted} columns, found {width}")
    if names is not None and len(names) != width:
        raise ReaderError("wrong_shape", f"{name}: {len(names)} names in the header, {width} columns in line {line}")


def _parse(
    body: bytes,
    name: str,
    dialect: _Dialect,
    width: int,
    columns: tuple[int, ...] | None,
    precision: type[np.float32] | type[np.float64],
    first_line: int,
) -> NDArray[np.floating]:
    trimmed = body.rstrip(b"\r\n ")
    n_lines = trimmed.count(b"\n") + 1
    # pandas silently drops surplus fields where only some columns are read.
    if dialect.separator and trimmed.count(dialect.separator.encode()) != n_lines * (width - 1):
        raise _located(body, name, dialect, width, first_line, "the columns do not agree")
    try:
        # A number beyond float32 becomes inf, which the quality stage names.
        with np.errstate(over="ignore"):
            values = _parse_with_pandas(trimmed, dialect, columns, precision)
    except (ValueError, OverflowError) as error:
        raise _located(body, name, dialect, width, first_line, str(error)) from error
    if values.shape[1] != n_lines:
        raise _located(body, name, dialect, width, first_line, f"{n_lines} lines, but {values.shape[1]} of numbers")
    return values


def _parse_with_pandas(
    body: bytes, dialect: _Dialect, columns: tuple[int, ...] | None, precision: type[np.float32] | type[np.float64]
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


def _located(body: bytes, name: str, dialect: _Dialect, width: int, first_line: int, reason: str) -> ReaderError:
    """Return the error of the first line that is not ``width`` numbers; slow."""
    lines = body.rstrip(b"\r\n ").split(b"\n")
    broken_off = not body.endswith((b"\n", b"\r"))
    for index, line in enumerate(lines):
        fields = dialect.fields(line.rstrip(b"\r"))
        last = broken_off and index == len(lines) - 1
        where = f"{name}: line {first_line + index}"
        if len(fields) != width:
            status = "incomplete" if last and len(fields) < width else "wrong_shape"
            return ReaderError(status, f"{where}: expected {width} columns, found {len(fields)}")
        for column, field in enumerate(fields, start=1):
            if not dialect.is_number(field):
                shown = re.sub(r"[^ -~]", "?", field[:30])
                status = "incomplete" if last and column == width else "unreadable"
                return ReaderError(status, f"{where}, column {column}: expected a number, found {shown!r}")
    return ReaderError("unreadable", f"{name}: {reason}")
