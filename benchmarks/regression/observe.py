"""Read what a case left: the store, the published files, the printed JSON, as named columns.

Nothing of the product is imported: the modules may move, what they write may not. A column is an array whose first
axis is the row; names are ``TABLE/COLUMN``, such as ``out/store/blocks/x.rms``.
"""

from __future__ import annotations

import json
import math
import sqlite3
from collections.abc import Iterable, Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
from numpy.typing import NDArray

Observation = dict[str, NDArray[Any]]
Row = Mapping[str, Any]

EXCLUDED = frozenset(
    {
        *("issued_utc", "acknowledged_utc_s", "utc", "created"),  # when the machine did it
        *("software_version", "config_hash"),
        *("map_hash", "library_hash", "hash", "prior"),  # they cover versions and words; the contents are compared
        *("seconds", "cpu_seconds", "seconds_in_all", "blocks_per_second"),
        *("records", "report", "out", "library"),  # paths
        *("ignored", "offered", "files", "time_from", "dating"),  # printed by a replay since; the baseline has them not
    }
)
"""Parts of names that are not compared."""
TEXTS = frozenset({"reason", "reasons", "text", "problems", "note", "notes", "words"})
"""Parts of names of sentences for people, compared on demand."""

_QUERIES = {
    "blocks": "SELECT * FROM blocks ORDER BY source, sequence",
    "refusals": "SELECT * FROM refusals ORDER BY source, sequence, content_hash",
    "events": "SELECT source, sequence, body FROM events JOIN blocks ON blocks.id = block"
    " ORDER BY source, sequence, events.id",
    "forecasts": "SELECT forecasts.*, source, sequence FROM forecasts JOIN blocks ON blocks.id = block"
    " ORDER BY source, sequence, forecasts.id",
    "acknowledgements": "SELECT event, who, note FROM acknowledgements ORDER BY id",
}
_ROW_KEYS = ("id", "block", "run")
"""Keys of rows within one database."""


def of_rows(name: str, rows: Iterable[Row]) -> Observation:
    """Return rows of plain values as columns; nested values become columns of their own."""
    flat = [dict(_leaves("", row)) for row in rows]
    names = dict.fromkeys(key for row in flat for key in row if not EXCLUDED & set(key.split("/")))
    return {f"{name}/{key}": _column([row.get(key) for row in flat]) for key in names}


def of_json(name: str, value: Row) -> Observation:
    """Return a printed object as columns: lists of objects as tables, all else as tables of one row."""
    tables = {key: item for key, item in value.items() if _is_table(item)}
    found = of_rows(name, [{key: item for key, item in value.items() if key not in tables}])
    for key, rows in tables.items():
        found |= of_rows(f"{name}/{key}", rows)
    return found


def of_store(name: str, path: Path) -> Observation:
    """Return the ledger, the records, the events, the forecasts and the acknowledgements of a state.db."""
    found: Observation = {}
    with closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True)) as connection:
        connection.row_factory = sqlite3.Row
        there = {row[0] for row in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
        for table, query in _QUERIES.items():
            if table in there:
                rows = [_plain_row(row) for row in connection.execute(query)]
                found |= of_rows(f"{name}/{table}", rows)
        if "layouts" in there:
            found |= _records(f"{name}/blocks", connection)
    return found


def of_netcdf(name: str, folder: Path) -> Observation:
    """Return the variables of all netCDF files of a folder, words decoded, with their units."""
    found: Observation = {}
    for path in sorted(folder.glob("*.nc")):
        with netCDF4.Dataset(path) as dataset:
            dataset.set_auto_maskandscale(False)
            for key, variable in dataset.variables.items():
                values = np.asarray(variable[...])
                if key == "events":
                    events = [event for text in values for event in json.loads(text)]
                    found |= of_rows(f"{name}/{path.name}/events", events)
                elif key not in EXCLUDED:
                    found[f"{name}/{path.name}/{key}"] = _decoded(variable, values)
                    units = getattr(variable, "units", "")
                    found[f"{name}/{path.name}/units/{key}"] = np.array([units])
    return found


def of_npz(name: str, path: Path) -> Observation:
    """Return the numeric arrays of an .npz file."""
    with np.load(path, allow_pickle=False) as arrays:
        found = {f"{name}/{key}": np.atleast_1d(arrays[key]) for key in arrays.files}
    return {key: value for key, value in found.items() if value.dtype.kind in "fiub"}


def _records(name: str, connection: sqlite3.Connection) -> Observation:
    """Return the packed values of all blocks, one column a channel and variable: shape (block, number)."""
    rows = connection.execute(
        "SELECT layout.layout, row FROM blocks JOIN records ON records.block = blocks.id"
        " JOIN layouts AS layout ON layout.id = records.layout ORDER BY source, sequence"
    ).fetchall()
    values: dict[str, dict[int, NDArray[np.float64]]] = {}
    for place, (layout, packed) in enumerate(rows):
        numbers, start = np.frombuffer(packed, dtype="<f8"), 0
        for channel, variables in json.loads(layout):
            counted = np.array([float(len(variables))])
            values.setdefault(f"{channel}.number of values", {})[place] = counted
            for variable, shape in variables:
                size = 0 if shape is None else math.prod(shape)
                values.setdefault(f"{channel}.{variable}", {})[place] = numbers[start : start + size]
                start += size
    found: Observation = {}
    for key, parts in values.items():
        column = np.full((len(rows), max(part.size for part in parts.values())), np.nan)
        for place, part in parts.items():
            column[place, : part.size] = part
        found[f"{name}/{key}"] = column
    return found


def _plain_row(row: sqlite3.Row) -> dict[str, Any]:
    """Return a row of a table with its JSON unfolded, without the keys that only hold within the database."""
    values = {key: value for key, value in dict(row).items() if key not in _ROW_KEYS}
    for key in ("body", "quantiles"):
        if values.get(key) is not None:
            values[key] = json.loads(values[key])
    return values


def _decoded(variable: Any, values: NDArray[Any]) -> NDArray[Any]:
    if values.dtype.kind == "O":
        return values.astype(str)
    if not hasattr(variable, "flag_meanings"):
        return np.atleast_1d(values)
    meanings = variable.flag_meanings.split()
    if hasattr(variable, "flag_masks"):
        masks = [int(mask) for mask in np.atleast_1d(variable.flag_masks)]
        known = {
            int(value): "|".join(word for mask, word in zip(masks, meanings, strict=True) if int(value) & mask)
            for value in np.unique(values)
        }
    else:
        known = dict(zip(map(int, np.atleast_1d(variable.flag_values)), meanings, strict=True))
    return np.array([known.get(int(value), "") for value in values.flat], dtype=str).reshape(values.shape)


def _is_table(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(item, dict) for item in value)


def _leaves(path: str, value: Any) -> Iterable[tuple[str, Any]]:
    items: Iterable[tuple[Any, Any]]
    if isinstance(value, Mapping):
        items = value.items()
    elif isinstance(value, list | tuple):
        items = enumerate(value)
    else:
        yield path, value
        return
    for key, item in items:
        yield from _leaves(f"{path}/{key}" if path else str(key), item)


def _column(values: Sequence[Any]) -> NDArray[Any]:
    if all(value is None or isinstance(value, int | float) for value in values):
        return np.array([math.nan if value is None else float(value) for value in values])
    return np.array(["" if value is None else str(value) for value in values])
