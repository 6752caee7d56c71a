"""Records as an xarray dataset, the form in which they are published and drawn.

Rows are blocks along ``time``, sorted by time; every block of the ledger has its row, also the rejected ones. Words are
small integers with CF flag attributes, of which -1 ("no_value") says that there is none.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from monitor.health.schema import DIMENSION_SIZES, OPTIONAL_DIMENSIONS, SCHEMA_VERSION, VARIABLES, Variable
from monitor.records.filing import SECONDS_PER_DAY, Filing, Stored
from monitor.records.packing import Entry, channels_of, entries_of, numbers_of
from monitor.words.parts import FAULTS

UTC_UNITS = "seconds since 1970-01-01T00:00:00Z"
UNDATED_UNITS = "s"
NO_VALUE = -1
"""Value of a missing word."""
INT_FILL = -1
"""Value of a missing whole number, the ``_FillValue`` of the file."""
TIME_STATUSES = ("given", "carried", "unknown")

_FLAG_DTYPE = np.int8
_INT_DTYPE = np.int32
LEDGER: dict[str, tuple[type, dict[str, Any]]] = {
    "source": (object, {"long_name": "name of the source of the block"}),
    "name": (object, {"long_name": "where the block came from: a file name or a part of one"}),
    "content_hash": (object, {"long_name": "digest of the content of the block"}),
    "status": (object, {"long_name": "status of the block"}),
    "flags": (object, {"long_name": "all flags of the block, separated by blanks"}),
    "reason": (object, {"long_name": "why the block was rejected or flagged"}),
    "events": (object, {"long_name": "events of the block, a JSON array"}),
    "sequence": (np.int64, {"long_name": "number of the block in its source, from 1", "units": "1"}),
    "elapsed": (np.float64, {"long_name": "time since the first sample of the source", "units": "s"}),
}
"""Type and attributes of the entries of the ledger."""


def to_dataset(items: Iterable[Stored], *, dated: bool, attributes: Mapping[str, Any]) -> xr.Dataset:
    """Build the dataset of records in any order, with global attributes; SI, NaN where there is no value.

    Its time axis is UTC where ``dated``, else seconds from the first block. Dimensions are ``time``, ``channel`` and
    those of the schema, ``band`` and ``threshold`` where there are several.
    """
    rows = sorted(items, key=lambda item: (item.filing.time, item.source, item.sequence))
    groups = _groups(rows)
    channels = list(dict.fromkeys(channel for row in rows for channel in channels_of(row.layout)))
    time_units = UTC_UNITS if dated else UNDATED_UNITS
    variables: dict[str, Any] = dict(_ledger(rows))
    present = {entry.variable for group in groups for entry in group.entries}
    for variable in VARIABLES.values():
        if variable.optional and variable.name not in present:
            continue
        dims, values = _column(variable, groups, len(rows), channels)
        variables[variable.name] = (("time", "channel", *dims), values, attributes_of(variable, time_units))
    # At once: xarray looks at all variables again for each one that is added.
    dataset = xr.Dataset(variables, _coordinates([row.filing.time for row in rows], channels, dated=dated))
    dataset.attrs = {key: _attribute(value) for key, value in attributes.items()}
    dataset.attrs.update({"schema_version": SCHEMA_VERSION, "dated": "yes" if dated else "no"})
    return dataset


def from_dataset(dataset: xr.Dataset) -> list[Stored]:
    """Return the records of a dataset of :func:`to_dataset`, read without decoding; they make the same dataset again.

    Forecasts are no part of it. A channel is part of a record where any of its values is there.
    """
    ledger = {name: dataset[name].values for name in (*LEDGER, "time_status")}
    texts = ("source", "name", "content_hash", "status", "flags", "reason")
    dated = dataset.attrs["dated"] == "yes"
    matrices, entries = _matrices(dataset)
    there: dict[str, NDArray[np.bool_]] = {
        channel: np.asarray(np.isfinite(values).any(axis=1)) for channel, values in matrices.items()
    }
    found = []
    for place, time in enumerate(dataset["time"].values.tolist()):
        elapsed = float(ledger["elapsed"][place])
        status = TIME_STATUSES[int(ledger["time_status"][place])]
        # A channel without any value in the whole file is kept as its name.
        named = [
            (name, entries if here[place] else ()) for name, here in there.items() if here[place] or not here.any()
        ]
        row = [matrices[name][place].tobytes() for name, mine in named if mine]
        found.append(
            Stored(
                filing=Filing(int(time // SECONDS_PER_DAY) if dated else None, time, status),
                layout=json.dumps(named, separators=(",", ":")),
                row=b"".join(row),
                sequence=int(ledger["sequence"][place]),
                time=time if dated and status == "given" else None,
                elapsed=None if math.isnan(elapsed) else elapsed,
                forecasts="[]",
                events=str(ledger["events"][place]),
                **{name: str(ledger[name][place]) for name in texts},
            )
        )
    return found


def _matrices(dataset: xr.Dataset) -> tuple[dict[str, NDArray[np.float64]], list[tuple[str, tuple[int, ...]]]]:
    """Return the values of each channel, shape (record, place), and the variables of a row with their shapes."""
    names = [name for name in map(str, dataset.data_vars) if name in VARIABLES]
    columns = [(name, _numbers(VARIABLES[name], dataset[name])) for name in names]
    matrices = {
        str(channel): np.hstack([values[:, place].reshape(len(values), -1) for _, values in columns]).astype("<f8")
        for place, channel in enumerate(dataset["channel"].values)
    }
    return matrices, [(name, values.shape[2:]) for name, values in columns]


def _numbers(variable: Variable, array: xr.DataArray) -> NDArray[np.float64]:
    """Return the values of a variable as rows hold them, NaN where there is none."""
    values = np.asarray(array.values, dtype=np.float64)
    if variable.kind == "float":
        return values
    return np.where(values == (0.0 if variable.kind == "mask" else -1.0), np.nan, values)


def words(array: xr.DataArray | xr.Variable) -> NDArray[np.object_]:
    """Decode integers with CF flag attributes to strings, "" without a value, words of a mask joined by "|"."""
    meanings = str(array.attrs["flag_meanings"]).split()
    values = np.asarray(array.values)
    result = np.full(values.shape, "", dtype=object)
    for value in np.unique(values[np.isfinite(values.astype(float))]):
        if "flag_masks" in array.attrs:
            masks = np.atleast_1d(array.attrs["flag_masks"])
            word = "|".join(meaning for mask, meaning in zip(masks, meanings, strict=True) if int(value) & int(mask))
        else:
            flags = [int(flag) for flag in np.atleast_1d(array.attrs["flag_values"])]
            word = meanings[flags.index(int(value))] if int(value) != NO_VALUE else ""
        result[values == value] = word
    return result


def _coordinates(times: list[float], channels: list[str], *, dated: bool) -> dict[str, Any]:
    return {
        "time": ("time", np.array(times, dtype=np.float64), time_attributes(dated=dated)),
        "channel": ("channel", np.array(channels, dtype=object), {"long_name": "name of the channel"}),
        **labels(),
    }


def time_attributes(*, dated: bool) -> dict[str, Any]:
    """Return the CF attributes of the time of blocks, UTC or from the first block."""
    moment = f"time of the first sample of the block, {'UTC' if dated else 'from the first block'}"
    attributes = {"units": UTC_UNITS if dated else UNDATED_UNITS, "long_name": moment}
    if dated:
        attributes |= {"calendar": "standard", "standard_name": "time", "axis": "T"}
    return attributes


def labels() -> dict[str, tuple[str, NDArray[Any], dict[str, Any]]]:
    """Return dimension, values and attributes of the coordinates that are the same in all records."""
    bpfo = {"long_name": "order of the line of the raw spectrum"}
    return {
        "fault_name": ("fault", np.array(FAULTS, dtype=object), {"long_name": "part of the bearing"}),
        "harmonic": ("harmonic", np.arange(1, 6, dtype=_INT_DTYPE), {"long_name": "order of the envelope line"}),
        "bpfo_harmonic": ("bpfo_harmonic", np.arange(1, 7, dtype=_INT_DTYPE), bpfo),
        "coefficient_name": ("coefficient", np.array(["a", "b", "c"], dtype=object), {"long_name": "coefficient"}),
    }


def time_status_attributes() -> dict[str, Any]:
    """Return the attributes of ``time_status``."""
    return {
        "long_name": "where the time of the block comes from",
        "flag_values": np.arange(len(TIME_STATUSES), dtype=_FLAG_DTYPE),
        "flag_meanings": " ".join(TIME_STATUSES),
    }


class _Group(NamedTuple):
    """The records of one layout: their rows in the dataset, and their values as a matrix (record, place)."""

    entries: tuple[Entry, ...]
    places: NDArray[np.intp]
    values: NDArray[np.float64]


def _groups(rows: Sequence[Stored]) -> list[_Group]:
    """Gather the records by layout, in the order in which the layouts first occur."""
    by_layout: dict[str, list[int]] = {}
    for place, row in enumerate(rows):
        by_layout.setdefault(row.layout, []).append(place)
    groups: list[_Group] = []
    for layout, places in by_layout.items():
        values = numbers_of(b"".join(rows[place].row for place in places)).reshape(len(places), -1)
        groups.append(_Group(entries_of(layout), np.array(places, dtype=np.intp), values))
    return groups


def _ledger(rows: Sequence[Stored]) -> dict[str, xr.Variable]:
    """Build the variables over time alone: the ledger entries."""
    variables = {
        name: xr.Variable("time", np.array([getattr(row, name) for row in rows], dtype=dtype), attributes)
        for name, (dtype, attributes) in LEDGER.items()
    }
    statuses = [TIME_STATUSES.index(row.filing.time_status) for row in rows]
    variables["time_status"] = xr.Variable("time", np.array(statuses, dtype=_FLAG_DTYPE), time_status_attributes())
    return variables


def _column(
    variable: Variable, groups: Sequence[_Group], length: int, channels: Sequence[str]
) -> tuple[tuple[str, ...], NDArray[Any]]:
    """Gather one variable of all records: its extra dimensions and its values over (time, channel, *dims)."""
    found: list[tuple[_Group, Entry, tuple[int, ...]]] = []
    for group in groups:
        for entry in group.entries:
            if entry.variable == variable.name and entry.shape is not None:
                left_out = len(variable.dims) - len(entry.shape)
                found.append((group, entry, (1,) * left_out + entry.shape))
    sizes = [DIMENSION_SIZES.get(dim, 1) for dim in variable.dims]
    for _, _, shape in found:
        sizes = [max(size, other) for size, other in zip(sizes, shape, strict=True)]
    full = np.full((length, len(channels), *sizes), np.nan)
    for group, entry, shape in found:
        part = group.values[:, entry.start : entry.start + math.prod(shape)].reshape(-1, *shape)
        full[(group.places, channels.index(entry.channel), *(slice(size) for size in shape))] = part
    dims = list(variable.dims)
    if dims and dims[0] in OPTIONAL_DIMENSIONS and sizes[0] == 1:
        full = full.squeeze(axis=2)
        del dims[0]
    return tuple(dims), _typed(variable, full)


def _typed(variable: Variable, values: NDArray[np.float64]) -> NDArray[Any]:
    """Bring gathered values to the type of the file."""
    if variable.kind == "float":
        return values
    if variable.kind == "mask":
        return np.nan_to_num(values, nan=0.0).astype(np.int16)
    if variable.kind == "flag":
        return np.nan_to_num(values, nan=NO_VALUE).astype(_FLAG_DTYPE)
    return np.nan_to_num(values, nan=INT_FILL).astype(_INT_DTYPE)


def attributes_of(variable: Variable, time_units: str) -> dict[str, Any]:
    """Return the CF attributes of a variable; ``time_units`` are the units of moments on the time axis."""
    attributes: dict[str, Any] = {"long_name": variable.long_name}
    if variable.units is not None:
        attributes["units"] = time_units if variable.units == "time" else variable.units
    if variable.units == "time" and time_units == UTC_UNITS:
        attributes["calendar"] = "standard"
    if variable.symbol:
        attributes["symbol"] = variable.symbol
    if variable.source:
        attributes["references"] = variable.source
    if variable.comment:
        attributes["comment"] = variable.comment
    if variable.kind == "flag":
        attributes["flag_values"] = np.arange(NO_VALUE, len(variable.values), dtype=_FLAG_DTYPE)
        attributes["flag_meanings"] = " ".join(("no_value", *variable.values))
    if variable.kind == "mask":
        attributes["flag_masks"] = np.array([1 << bit for bit in range(len(variable.values))], dtype=np.int16)
        attributes["flag_meanings"] = " ".join(variable.values)
    return attributes


def _attribute(value: Any) -> Any:
    """Return a global attribute in a form that netCDF can hold."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if value is None:
        return "none"
    if isinstance(value, str | int | float):
        return value
    if isinstance(value, list | tuple) and value and all(isinstance(item, int | float) for item in value):
        return [float(item) for item in value]
    return json.dumps(value)
