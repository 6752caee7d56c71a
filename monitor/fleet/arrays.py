"""The arrays of an archive that is one Zarr store: names, dimensions, types and CF attributes.

The blocks of all recordings follow each other along ``row``, in the order of the recordings, so that nothing is padded
and each range of rows can be written by itself (a contiguous ragged array, CF conventions, section 9.3.3). A table
along ``recording`` says which rows are whose. The dimension ``channel`` counts the channels of a recording;
``channel_name`` has their names. Words are integers with CF flag attributes, as in the netCDF files of records.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.words.errors import WrongInputError
from models.work.task import FileStore
from monitor import __version__
from monitor.fleet.result import RecordingResult
from monitor.health.schema import DIMENSION_SIZES, SCHEMA_VERSION, VARIABLES, Variable
from monitor.records.dataset import (
    INT_FILL,
    LEDGER,
    NO_VALUE,
    UNDATED_UNITS,
    UTC_UNITS,
    attributes_of,
    labels,
    time_attributes,
    time_status_attributes,
)

ARCHIVE_VERSION = 1
"""Version of the layout, the attribute ``spallwatch_archive`` of the store; a higher one is refused."""
ROW, RECORDING, CHANNEL, PART = "row", "recording", "channel", "part"
UNDATED = "_undated"
"""End of the names of moments in seconds from the first block, beside those in UTC."""
TEXT = "string"
SEPARATOR = "."
"""Of the places of a chunk in the name of its file: an array of fewer dimensions may take the place of another one."""
MAX_CHUNK_BYTES = 32 * 1024**2
"""Of all variables over the rows of a chunk, before they are compressed."""
MIN_CHUNK_ROWS, MAX_CHUNK_ROWS = 16, 16384
TABLE_CHUNK = 16384
"""Recordings of a chunk of the table."""
RECORDING_STATUSES = ("done", "failed")
_TEXT_BYTES = 64
_DTYPES = {"float": "float64", "int": "int32", "flag": "int8", "mask": "int16"}
_FILLS: dict[str, float | int] = {"float": math.nan, "int": INT_FILL, "flag": NO_VALUE, "mask": 0}


@dataclass(frozen=True)
class Array:
    """One array of the store.

    Attributes:
        dims: names of its dimensions, one for each number of ``shape`` and of ``chunks``.
        dtype: of numpy, or ``TEXT``.
        fill: where nothing is written.
    """

    name: str
    dims: tuple[str, ...]
    shape: tuple[int, ...]
    chunks: tuple[int, ...]
    dtype: str
    fill: float | int | str
    attributes: Mapping[str, Any] = field(default_factory=dict[str, Any])

    def empty(self, length: int) -> NDArray[Any]:
        """Return an array of fill values, ``length`` along the first dimension."""
        kind = object if self.dtype == TEXT else self.dtype
        return np.full((length, *self.shape[1:]), self.fill, dtype=kind)

    def chunk_names(self) -> Iterator[str]:
        """Yield the names of the files of all chunks."""
        counts = [-(-size // chunk) for size, chunk in zip(self.shape, self.chunks, strict=True)]
        for place in np.ndindex(*counts):
            yield f"{self.name}/{SEPARATOR.join(('c', *map(str, place)))}"


@dataclass(frozen=True)
class ArchiveExtent:
    """What the arrays of an archive depend on.

    Attributes:
        rows, recordings: their numbers.
        channels: of the recording that has most.
        variables: dimensions of each variable beside the row, the longest of all recordings.
        sizes: greatest size of each of these.
        undated: whether any recording has records without a date.
    """

    rows: int = 0
    recordings: int = 0
    channels: int = 1
    variables: Mapping[str, tuple[str, ...]] = field(default_factory=dict[str, tuple[str, ...]])
    sizes: Mapping[str, int] = field(default_factory=dict[str, int])
    undated: bool = False

    @classmethod
    def of(cls, results: Iterable[RecordingResult]) -> ArchiveExtent:
        """Return the extent of recordings."""
        found, variables, sizes = cls(), dict[str, tuple[str, ...]](), dict[str, int]()
        for result in results:
            for name, dims in result.shape.variables.items():
                variables[name] = max(variables.get(name, ()), dims, key=len)
            for dim, size in result.shape.sizes.items():
                sizes[dim] = max(sizes.get(dim, 0), size)
            found = replace(
                found,
                rows=found.rows + sum(file.rows for file in result.files),
                recordings=found.recordings + 1,
                channels=max(found.channels, len(result.shape.channels)),
                undated=found.undated or any(file.day is None and file.rows for file in result.files),
            )
        return replace(found, variables=variables, sizes=sizes)


def arrays_of_rows(extent: ArchiveExtent) -> list[Array]:
    """Return the arrays along ``row``, with chunks of the same rows."""
    found = [*_ledger(extent), *_times(extent)]
    for variable in VARIABLES.values():
        if variable.name in extent.variables:
            found += _moments(variable, extent) if variable.units == "time" else [_variable(variable, extent)]
    chunk = chunk_rows(found, extent.rows)
    return [replace(array, chunks=(chunk, *array.chunks[1:])) for array in found]


def row_bytes(arrays: Iterable[Array]) -> int:
    """Return the bytes of a row of all arrays, texts taken as ``_TEXT_BYTES``."""
    return sum(
        math.prod(array.shape[1:]) * (_TEXT_BYTES if array.dtype == TEXT else np.dtype(array.dtype).itemsize)
        for array in arrays
    )


def chunk_rows(arrays: Iterable[Array], rows: int) -> int:
    """Return the rows of a chunk, a power of two: as many as fit ``MAX_CHUNK_BYTES``, hardly more than there are."""
    most = min(max(MAX_CHUNK_BYTES // row_bytes(arrays), MIN_CHUNK_ROWS), MAX_CHUNK_ROWS)
    return min(1 << (most.bit_length() - 1), max(1 << max(rows - 1, 0).bit_length(), MIN_CHUNK_ROWS))


def arrays_of_table(extent: ArchiveExtent) -> list[Array]:
    """Return the arrays along ``recording``."""
    statuses = np.arange(len(RECORDING_STATUSES), dtype=np.int8)
    flags = {"flag_values": statuses, "flag_meanings": " ".join(RECORDING_STATUSES)}
    dates = {"units": UTC_UNITS, "calendar": "standard"}
    size = {"long_name": "number of blocks", "units": "1", "sample_dimension": ROW}
    columns: list[tuple[str, str, float | int | str, dict[str, Any]]] = [
        ("machine", TEXT, "", {"long_name": "name of the machine"}),
        ("recording_name", TEXT, "", {"long_name": "name of the recording, unique in its machine"}),
        ("url", TEXT, "", {"long_name": "where the recording is"}),
        ("recording_status", "int8", 0, {"long_name": "whether the recording was replayed", **flags}),
        ("recording_reason", TEXT, "", {"long_name": "why the recording could not be replayed"}),
        ("first_row", "int64", 0, {"long_name": "row of the first block", "units": "1"}),
        ("row_size", "int64", 0, size),
        ("time_first", "float64", math.nan, {"long_name": "time of the first dated block", **dates}),
        ("time_last", "float64", math.nan, {"long_name": "time of the last dated block", **dates}),
        ("recording_shape", TEXT, "", {"long_name": "variables and sizes of the recording, JSON"}),
        ("made_with", TEXT, "", {"long_name": "what made the records, JSON"}),
    ]
    found = [
        Array(name, (RECORDING,), (extent.recordings,), (TABLE_CHUNK,), dtype, fill, attributes)
        for name, dtype, fill, attributes in columns
    ]
    shape = (extent.recordings, extent.channels)
    names = {"long_name": "names of the channels of the recording"}
    chunk = min(TABLE_CHUNK, max(1 << max(extent.recordings - 1, 0).bit_length(), MIN_CHUNK_ROWS))
    found.append(Array("channel_name", (RECORDING, CHANNEL), shape, shape, TEXT, "", names))
    return [replace(array, chunks=(chunk, *array.shape[1:])) for array in found]


def coordinates() -> list[tuple[Array, NDArray[Any]]]:
    """Return the labels of dimensions that are the same in all archives, with their values."""
    found: list[tuple[Array, NDArray[Any]]] = []
    for name, (dim, values, attributes) in labels().items():
        stored = PART if name == "fault_name" else name
        dtype = TEXT if values.dtype == object else str(values.dtype)
        fill = "" if dtype == TEXT else 0
        found.append((Array(stored, (_renamed(dim),), values.shape, values.shape, dtype, fill, attributes), values))
    return found


def global_attributes(extent: ArchiveExtent) -> dict[str, Any]:
    """Return the attributes of the store."""
    return {
        "Conventions": "CF-1.11, ACDD-1.3",
        "title": "Bearing health records of an archive",
        "summary": "What each block of acceleration said about the health of a rolling bearing, of many recordings.",
        "source": f"spallwatch {__version__}, from recorded acceleration",
        "comment": f"Rows first_row to first_row + row_size belong to a recording; names that end in {UNDATED} are in "
        "seconds from the first block, of records without a date.",
        "recordings": extent.recordings,
        "rows": extent.rows,
        "schema_version": SCHEMA_VERSION,
        "spallwatch_archive": ARCHIVE_VERSION,
    }


def _ledger(extent: ArchiveExtent) -> Iterator[Array]:
    for name, (kind, attributes) in LEDGER.items():
        dtype = TEXT if kind is object else np.dtype(kind).name
        fill = {TEXT: "", "float64": math.nan}.get(dtype, 0)
        yield Array(name, (ROW,), (extent.rows,), (1,), dtype, fill, attributes)
    yield Array("time_status", (ROW,), (extent.rows,), (1,), "int8", 0, time_status_attributes())
    number = {"long_name": "place of the recording in the table", "units": "1", "instance_dimension": RECORDING}
    yield Array("recording_index", (ROW,), (extent.rows,), (1,), "int32", 0, number)


def _times(extent: ArchiveExtent) -> Iterator[Array]:
    for dated in (True, False) if extent.undated else (True,):
        attributes = {key: value for key, value in time_attributes(dated=dated).items() if key != "axis"}
        name = "time" if dated else f"time{UNDATED}"
        yield Array(name, (ROW,), (extent.rows,), (1,), "float64", math.nan, attributes)


def _moments(variable: Variable, extent: ArchiveExtent) -> list[Array]:
    found = [_variable(variable, extent)]
    if extent.undated:
        attributes = _attributes(variable, UNDATED_UNITS)
        found.append(replace(found[0], name=f"{variable.name}{UNDATED}", attributes=attributes))
    return found


def _variable(variable: Variable, extent: ArchiveExtent) -> Array:
    dims = extent.variables[variable.name]
    inner = tuple(extent.channels if dim == CHANNEL else _size(dim, extent) for dim in dims)
    kind = variable.kind
    return Array(
        variable.name,
        (ROW, *map(_renamed, dims)),
        (extent.rows, *inner),
        (1, *inner),
        _DTYPES[kind],
        _FILLS[kind],
        _attributes(variable, UTC_UNITS),
    )


def _attributes(variable: Variable, time_units: str) -> dict[str, Any]:
    fill = {"_FillValue": INT_FILL} if variable.kind == "int" else {}
    return {**attributes_of(variable, time_units), "coordinates": "time", **fill}


def _size(dim: str, extent: ArchiveExtent) -> int:
    return extent.sizes.get(dim) or DIMENSION_SIZES.get(dim, 1)


def _renamed(dim: str) -> str:
    """Return a dimension's name in the store: ``fault`` is also the name of a variable."""
    return PART if dim == "fault" else dim


METADATA = "zarr.json"
"""Written last: with it a store is whole."""


def refuse_foreign(out: FileStore) -> None:
    """Refuse to write an archive over a Zarr store of something else.

    Raises:
        WrongInputError: it has metadata that are not those of an archive, or of a later version.
    """
    data = out.read(METADATA)
    if data is None:
        return
    try:
        version = json.loads(data)["attributes"]["spallwatch_archive"]
    except (ValueError, KeyError, TypeError):
        version = None
    if not isinstance(version, int) or version > ARCHIVE_VERSION:
        raise WrongInputError(
            f"{out.url}: is a Zarr store, but no archive of spallwatch up to version {ARCHIVE_VERSION}; it is left "
            "as it is"
        )


def refuse_unknown(out: FileStore) -> None:
    """Refuse a place in which no archive was begun, unless it is empty or holds a whole one.

    Raises:
        WrongInputError: as :func:`refuse_foreign`, or there are files without the metadata of an archive.
    """
    refuse_foreign(out)
    if out.read(METADATA) is None and (found := next(iter(out.names()), None)) is not None:
        raise WrongInputError(
            f"{out.url}: holds {found}, and no archive that was begun here; move it away, or take another --out"
        )
