"""Tables of columns: Apache Parquet, through pyarrow."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from streams.files.formats.described import described
from streams.files.formats.head import Head
from streams.files.formats.stamped import StampedRows
from streams.files.parse.worker import check_claim, from_disk, library, readable
from streams.files.statements import add_fact, plain_key
from streams.types.large import Data, empty_rows, forget_pages, stream_of
from streams.types.samples import ReaderError, Samples, check_rows, stored_as
from streams.types.stamps import read_stamp

_MAGIC = b"PAR1"
_ATTRIBUTES = b"PANDAS_ATTRS"
_OF_WRITERS = (b"pandas", b"ARROW:schema", b"PARQUET:field_id")
_NANOSECONDS = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}
_FLOATS = {"halffloat": "f2", "float": "f4", "double": "f8"}
_SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}


@from_disk
def read_parquet(data: Data, name: str, zone: str = "UTC", disregard: Sequence[str] = ()) -> Samples:
    """Read the columns of numbers of a table, each a channel; columns of texts and nested ones are passed over.

    Rate, unit and time come from the metadata of the file, those of its columns and their names, and from a column of
    dates or times, as those of a text (:mod:`streams.files.formats.described`). Missing values are NaN.

    Args:
        zone: IANA name of the zone of dates that name none.
        disregard: patterns of the keys that are not believed.

    Raises:
        ReaderError: ``empty``, ``incomplete`` where the file breaks off, ``unreadable``; ``wrong_shape`` without a
            column of numbers or with several of dates; ``refused`` beyond the limits; as
            :func:`streams.files.formats.described.described`.
    """
    if not data:
        raise ReaderError("empty", f"{name}: the file has 0 bytes")
    if data[:4] == _MAGIC and data[len(data) - 4 :] != _MAGIC:
        raise ReaderError("incomplete", f"{name}: {len(data)} bytes, without the description that ends a Parquet table")
    arrow = library("pyarrow", "tables", f"{name}: Parquet tables need")
    tables = library("pyarrow.parquet", "tables", f"{name}: Parquet tables need")
    with readable(name, "a readable Parquet table"), stream_of(data) as stream, tables.ParquetFile(stream) as file:
        schema, length = file.schema_arrow, file.metadata.num_rows
        names, dates = _columns(schema, arrow.types, name)
        check_rows(len(names), name, "columns")
        if not length:
            raise ReaderError("empty", f"{name}: holds no row")
        kinds = [_numpy_type(schema.field(title).type, arrow.types) for title in names]
        is_single = all(np.can_cast(kind, np.float32) for kind in kinds)
        check_claim(length * (len(names) * (4 if is_single else 8) + 8 * len(dates)), len(data), name)
        values = empty_rows((len(names), length), np.float32 if is_single else np.float64)
        moments = np.empty(length if dates else 0, np.int64)
        _fill(file, values, moments, names, dates, name)
    stamped = _stamped(moments, schema.field(dates[0]).type, zone, name) if dates else None
    head = Head(facts=_facts(schema.metadata), names=tuple(names))
    head.of_columns = tuple(_facts(schema.field(title).metadata) for title in names)
    samples = Samples(values, stored=tuple(map(stored_as, kinds)))
    return described(samples, head, name, zone, disregard, stamped)


def _columns(schema: Any, types: Any, name: str) -> tuple[list[str], list[str]]:
    """Return the names of the columns of numbers, and of those of dates, of which there is one at most."""
    if len(set(schema.names)) < len(schema.names):
        twice = next(title for title in schema.names if schema.names.count(title) > 1)
        raise ReaderError("wrong_shape", f"{name}: holds several columns {twice!r}")
    numbers = [field.name for field in schema if _numpy_type(field.type, types) is not None]
    dates = [field.name for field in schema if types.is_timestamp(field.type)]
    if not numbers:
        listed = ", ".join(f"{field.name} ({field.type})" for field in schema)[:300]
        raise ReaderError("wrong_shape", f"{name}: holds no column of numbers: {listed}")
    if len(dates) > 1:
        raise ReaderError("wrong_shape", f"{name}: several columns of dates: {', '.join(dates)[:300]}; write one")
    return numbers, dates


def _numpy_type(kind: Any, types: Any) -> Any:
    """Return the type of the numbers of a column, None of other columns."""
    if types.is_boolean(kind):
        return np.dtype(bool)
    if types.is_integer(kind) or types.is_floating(kind):
        return np.dtype(_FLOATS.get(str(kind), str(kind)))
    if types.is_decimal(kind) or types.is_duration(kind) or types.is_time(kind):
        return np.dtype(np.float64)
    return None


def _fill(
    file: Any, values: np.ndarray, moments: np.ndarray, names: Sequence[str], dates: Sequence[str], name: str
) -> None:
    """Read the rows batch by batch; ReaderError ``unreadable`` for a date that is missing."""
    place = 0
    for batch in file.iter_batches(columns=[*names, *dates], use_threads=False):
        end = place + batch.num_rows
        for row, title in enumerate(names):
            values[row, place:end] = _numbers(batch.column(title))
        for title in dates:
            column = batch.column(title)
            if column.null_count:
                raise ReaderError("unreadable", f"{name}: {column.null_count} dates are missing in {title!r}")
            moments[place:end] = column.cast("int64").to_numpy(zero_copy_only=False)
        place = end
        forget_pages(values)
    if place != values.shape[1]:
        raise ReaderError("incomplete", f"{name}: {place} rows, its description states {values.shape[1]}")


def _numbers(column: Any) -> Any:
    """Return the numbers of a column, durations and times of day in s, what is missing as NaN."""
    kind = column.type
    unit = getattr(kind, "unit", None)
    if unit is not None:
        return column.cast(f"int{kind.bit_width}").cast("float64").to_numpy(zero_copy_only=False) * _SECONDS[unit]
    if column.null_count or str(kind).startswith("decimal"):
        column = column.cast("float64")
    return column.to_numpy(zero_copy_only=False)


def _stamped(moments: np.ndarray, kind: Any, zone: str, name: str) -> StampedRows:
    """Return the dates of rows as those with which the rows of a text begin."""
    first, size = int(moments[0]) * _NANOSECONDS[kind.unit], _SECONDS[kind.unit]
    whole, rest = divmod(first, 10**9)
    text = f"{np.datetime64(whole, 's')}.{rest:09d}" + ("Z" if kind.tz is not None else "")
    start = read_stamp(text, zone)
    if start is None:
        raise ReaderError("unreadable", f"{name}: the first date is {text}")
    return StampedRows(b"", [], (moments - moments[0]) * size, start, 1, "")


def _facts(metadata: Any) -> dict[str, object]:
    """Return what metadata state, by plain key."""
    found: dict[str, object] = {}
    for key, value in (metadata or {}).items():
        if key in _OF_WRITERS:
            continue
        text = value.decode("utf-8", "replace")
        if key != _ATTRIBUTES:
            add_fact(found, plain_key(key.decode("utf-8", "replace")), text)
            continue
        attributes = json.loads(text)
        for own, stated in attributes.items() if isinstance(attributes, dict) else ():
            add_fact(found, plain_key(own), stated)
    return found
