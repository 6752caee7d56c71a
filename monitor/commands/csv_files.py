"""Tables of numbers in CSV files: read with clear refusals, written in one step."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from monitor.commands.common import InputError

_LARGEST = 64 * 2**20


def read_columns(path: Path, *, required: Sequence[str], optional: Sequence[str] = ()) -> dict[str, list[float]]:
    """Read named columns of a CSV file with a header row.

    Args:
        path: the file.
        required: columns that must be there.
        optional: columns that are taken where they are there.

    Returns:
        Finite numbers by column, in the order of the rows.

    Raises:
        InputError: naming the file, the row, the column, what was expected and what came.
    """
    try:
        if path.stat().st_size > _LARGEST:
            raise InputError(f"{path}: larger than {_LARGEST // 2**20} MiB; is it a history of features?")
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"{path}: not a text file; expected CSV with columns {', '.join(required)}") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None
    reader = csv.DictReader(io.StringIO(text, newline=""), skipinitialspace=True)
    header = [name.strip() for name in reader.fieldnames or []]
    missing = [name for name in required if name not in header]
    if missing:
        found = ", ".join(header) or "nothing"
        raise InputError(f"{path}: column {missing[0]} is missing; expected {', '.join(required)}, found {found}")
    reader.fieldnames = header
    columns: dict[str, list[float]] = {name: [] for name in (*required, *(n for n in optional if n in header))}
    for row in reader:
        for name, values in columns.items():
            values.append(_number(path, reader.line_num, name, row.get(name)))
    if not columns[required[0]]:
        raise InputError(f"{path}: no rows below the header")
    times = columns.get("time_s", [])
    for number, (before, after) in enumerate(pairwise(times), 2):
        if after <= before:
            raise InputError(f"{path}: row {number}: time_s goes from {before:g} to {after:g}; it must increase")
    return columns


def _number(path: Path, line: int, name: str, text: str | None) -> float:
    try:
        value = float(text or "")
    except ValueError:
        raise InputError(f"{path}: line {line}: {name} is {text!r}, expected a number") from None
    if not math.isfinite(value):
        raise InputError(f"{path}: line {line}: {name} is {text!r}, expected a finite number")
    return value


def write_rows(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows as CSV, replacing the file in one step; a value that is None is left empty.

    Raises:
        InputError: the file cannot be written.
    """
    buffer = io.StringIO(newline="")
    writer = csv.DictWriter(buffer, fieldnames=list(rows[0]))
    writer.writeheader()
    writer.writerows(rows)
    write_whole(path, buffer.getvalue())


def write_whole(path: Path, text: str) -> None:
    """Write a text file, replacing it in one step.

    Raises:
        InputError: the file cannot be written.
    """
    part = path.with_name(path.name + ".part")
    try:
        part.write_text(text, encoding="utf-8")
        part.replace(path)
    except OSError as error:
        raise InputError(f"--out {path}: cannot be written: {error.strerror or error}") from None
