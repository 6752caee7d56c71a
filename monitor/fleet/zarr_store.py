"""An archive as one Zarr store (format 3), written by many workers at once from the netCDF files of its recordings.

Each task writes one chunk of rows of every array, whole, so that it can run twice and anywhere. The table of recordings
comes next, and last the metadata of the whole, consolidated in one file: before it is there, no reader opens the store.
Nothing in it depends on when or by whom it was written.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import netCDF4
import numpy as np
import zarr
from numpy.typing import NDArray
from zarr.codecs import BloscCodec, Crc32cCodec, ZstdCodec
from zarr.core.buffer import Buffer, default_buffer_prototype
from zarr.storage import MemoryStore

from models.words.errors import SpallwatchError
from models.work.folder_store import open_store
from models.work.runner import SERIAL, Runner
from models.work.task import FileStore, Work
from monitor.fleet.arrays import (
    CHANNEL,
    METADATA,
    PART,
    ROW,
    SEPARATOR,
    TEXT,
    UNDATED,
    ArchiveExtent,
    Array,
    arrays_of_rows,
    arrays_of_table,
    coordinates,
    global_attributes,
    refuse_foreign,
    row_bytes,
)
from monitor.fleet.result import RecordingResult
from monitor.health.schema import VARIABLES

_NAMES = {PART: "fault", ROW: "time"}
"""Dimensions of the archive that have another name in files of records."""


class RowsError(SpallwatchError):
    """Records of an archive are missing or not as they were planned; the message names the file."""


@dataclass(frozen=True)
class Piece:
    """Rows of one file.

    Attributes:
        file, digest: name in the store of the records, and digest of the records in it.
        begin, rows: which of its rows.
        recording: place in the table.
        channels: of the recording, in its order.
        dated: whether its times are UTC.
    """

    file: str
    digest: str
    begin: int
    rows: int
    recording: int
    channels: tuple[str, ...]
    dated: bool


@dataclass(frozen=True)
class RowRange:
    """Rows that are one chunk of each array along ``row``: from ``first``, of some files one after another."""

    first: int
    pieces: tuple[Piece, ...]


def row_ranges(results: Iterable[RecordingResult], chunk: int) -> Iterator[RowRange]:
    """Yield the rows of all recordings in their order, ``chunk`` at a time; the last range may be shorter."""
    first = filled = 0
    pieces: list[Piece] = []
    for place, result in enumerate(results):
        for file in result.files:
            begin = 0
            while begin < file.rows:
                rows = min(file.rows - begin, chunk - filled)
                pieces.append(
                    Piece(file.name, file.digest, begin, rows, place, result.shape.channels, file.day is not None)
                )
                begin, filled = begin + rows, filled + rows
                if filled == chunk:
                    yield RowRange(first, tuple(pieces))
                    first, filled, pieces = first + chunk, 0, []
    if pieces:
        yield RowRange(first, tuple(pieces))


def values_of(arrays: Sequence[Array], records: FileStore, rows: RowRange) -> dict[str, NDArray[Any]]:
    """Return the values of a range of rows for each array along ``row``, fill values where a file has none.

    Raises:
        RowsError: a file is missing, cannot be read, or has other rows or channels than planned.
    """
    found = {array.name: array.empty(sum(piece.rows for piece in rows.pieces)) for array in arrays}
    begin = 0
    for piece in rows.pieces:
        place = slice(begin, begin + piece.rows)
        found["recording_index"][place] = piece.recording
        data = records.read(piece.file)
        if data is None:
            raise RowsError(f"{records.url}: has no records {piece.file}, which the archive should hold")
        try:
            with netCDF4.Dataset("records", memory=data) as file:
                file.set_auto_mask(False)
                file.set_auto_scale(False)
                _copy(file, piece, {array.name: (array, found[array.name][place]) for array in arrays})
        except (OSError, RuntimeError, KeyError) as error:
            raise RowsError(f"{records.url}/{piece.file}: cannot be read as records: {error}") from error
        begin += piece.rows
    return found


def _copy(file: Any, piece: Piece, targets: Mapping[str, tuple[Array, NDArray[Any]]]) -> None:
    """Copy the variables of one file that the archive has into their rows."""
    channels = [str(name) for name in file.variables["channel"][...]]
    if len(file.dimensions["time"]) < piece.begin + piece.rows or not set(channels) <= set(piece.channels):
        raise RowsError(
            f"{piece.file}: expected {piece.begin + piece.rows} rows of {', '.join(piece.channels)}, got "
            f"{len(file.dimensions['time'])} of {', '.join(channels)}"
        )
    places = [piece.channels.index(name) for name in channels]
    for name, variable in file.variables.items():
        moment = not piece.dated and f"{name}{UNDATED}" in targets
        if (target := targets.get(f"{name}{UNDATED}" if moment else name)) is None or "time" not in variable.dimensions:
            continue
        values = variable[piece.begin : piece.begin + piece.rows]
        _put(target[0], target[1], values, variable.dimensions, places)


def _put(array: Array, target: NDArray[Any], values: NDArray[Any], dims: Sequence[str], places: Sequence[int]) -> None:
    """Put values over ``dims`` into those over the dimensions of an array, each channel into its place."""
    for axis, dim in enumerate(array.dims):
        if _NAMES.get(dim, dim) not in dims:
            values = np.expand_dims(values, axis)
    if CHANNEL not in array.dims:
        target[...] = values
        return
    for k, place in enumerate(places):
        target[(slice(None), place, *(slice(size) for size in values.shape[2:]))] = values[:, k]


_WRITERS = 8
"""Files that a task writes at a time: object storage answers late."""
_FILE_BYTES = 32 * 1024**2
"""Of the netCDF file that a task holds beside its rows."""
_TIMES_OF_PUBLICATION = ("history", "date_created")
_OF_ARRAY = re.compile(rf"c({re.escape(SEPARATOR)}\d+)*|{re.escape(METADATA)}")
"""Files of an array, as this module names them."""


@dataclass(frozen=True)
class Written:
    """What was written: numbers of recordings, rows, arrays, and chunks of rows of all arrays."""

    recordings: int
    rows: int
    arrays: int
    chunks: int


@dataclass(frozen=True)
class Target:
    """What all tasks share: where records are read, where the archive is written, its arrays and their metadata.

    ``writing``: identity of this writing of the store, without which a chunk of an earlier one would count as written
    though another one has replaced its files.
    """

    records: str
    out: str
    writing: str
    arrays: tuple[Array, ...]
    metadata: dict[str, bytes]


def write_archive(
    results: Iterable[RecordingResult],
    records: FileStore,
    out_url: str,
    runner: Runner = SERIAL,
    confirm: Callable[[], None] = lambda: None,
    writing: str = "",
) -> Written:
    """Write the records of recordings into one Zarr store, in their order; a store that is there is replaced.

    Args:
        results: iterated twice, with the same outcome; those that failed are in the table, with such rows as they have.
        records: has their files.
        out_url: folder or URL of the Zarr store.
        runner: runs the tasks.
        confirm: called before the metadata of the whole are deleted, and before they are written.
        writing: identity of this writing; what was written with the same one and the same records is not written again.

    Raises:
        LeaseLostError: as ``confirm``.
        WrongInputError: another Zarr store is at ``out_url``.
        RowsError: files of records are missing or damaged.
        ChunksFailedError: tasks were set aside; the store does not open until they are done.
    """
    out = open_store(out_url)
    refuse_foreign(out)
    extent = ArchiveExtent.of(results)
    confirm()
    # From here on it is not whole.
    out.delete(METADATA)
    arrays, table = arrays_of_rows(extent), arrays_of_table(extent)
    labels = coordinates()
    metadata = {array.name: metadata_of(array) for array in (*arrays, *table, *(array for array, _ in labels))}
    of_rows = {array.name: metadata[array.name] for array in arrays}
    target = Target(records.url, out.url, writing, tuple(arrays), of_rows)
    chunk = arrays[0].chunks[0]
    total = -(-extent.rows // chunk)
    work = Work("rows of the archive", write_rows, memory=3 * chunk * row_bytes(arrays) + _FILE_BYTES)
    for _ in runner.run(work, target, row_ranges(results, chunk), total=total):
        pass
    files = {f"{name}/{METADATA}": data for name, data in metadata.items()}
    for array, values in labels:
        files |= encoded(array, metadata[array.name], 0, values)
    _write_all(out, files)
    _write_table(out, table, metadata, results)
    _complete(out, [*arrays, *table, *(array for array, _ in labels)], target, row_ranges(results, chunk))
    confirm()
    out.write(METADATA, root_of(metadata, global_attributes(extent)))
    return Written(extent.recordings, extent.rows, len(metadata), total * len(arrays))


def write_rows(target: Target, rows: RowRange) -> int:
    """Write one chunk of every array along ``row``; return its bytes.

    Raises:
        RowsError: files of records are missing or damaged.
    """
    values = values_of(target.arrays, open_store(target.records), rows)
    files: dict[str, bytes] = {}
    for array in target.arrays:
        files |= encoded(array, target.metadata[array.name], rows.first, values.pop(array.name))
    _write_all(open_store(target.out), files)
    return sum(map(len, files.values()))


def metadata_of(array: Array) -> bytes:
    """Return the metadata of an array, the content of its ``zarr.json``."""
    files: dict[str, Buffer] = {}
    text = array.dtype == TEXT
    # Checksums find torn and changed files; Blosc sorts the bytes of numbers first, which halves them.
    packed = BloscCodec(cname="zstd", clevel=3, shuffle="shuffle")
    zarr.create_array(
        MemoryStore(files),
        shape=array.shape,
        chunks=tuple(max(size, 1) for size in array.chunks),
        dtype=str if text else array.dtype,
        compressors=ZstdCodec(level=3, checksum=True) if text else [packed, Crc32cCodec()],
        fill_value=array.fill,
        attributes={key: _plain(value) for key, value in array.attributes.items()},
        dimension_names=array.dims,
        chunk_key_encoding={"name": "default", "separator": SEPARATOR},
    )
    return files[METADATA].to_bytes()


def encoded(array: Array, metadata: bytes, first: int, values: NDArray[Any]) -> dict[str, bytes]:
    """Return the files of the chunks of an array that begin at ``first`` and hold ``values``, by name."""
    files: dict[str, Buffer] = {METADATA: default_buffer_prototype().buffer.from_bytes(metadata)}
    # Chunks without any value are written too, so that each file that should be there can be counted.
    opened = zarr.open_array(MemoryStore(files), mode="r+").with_config({"write_empty_chunks": True})
    opened[first : first + len(values)] = values
    return {f"{array.name}/{name}": data.to_bytes() for name, data in files.items() if name != METADATA}


def _write_table(
    out: FileStore, table: list[Array], metadata: Mapping[str, bytes], results: Iterable[RecordingResult]
) -> None:
    chunk, first, begin = table[0].chunks[0], 0, 0
    rows: list[dict[str, Any]] = []
    for result in results:
        rows.append(_row(result, first))
        first += rows[-1]["row_size"]
        if len(rows) == chunk:
            _write_recordings(out, table, metadata, begin, rows)
            begin, rows = begin + chunk, []
    if rows:
        _write_recordings(out, table, metadata, begin, rows)


def _write_recordings(
    out: FileStore, table: list[Array], metadata: Mapping[str, bytes], begin: int, rows: list[dict[str, Any]]
) -> None:
    files: dict[str, bytes] = {}
    for array in table:
        values = array.empty(len(rows))
        for place, row in enumerate(rows):
            if array.name == "channel_name":
                values[place, : len(row[array.name])] = row[array.name]
            else:
                values[place] = row[array.name]
        files |= encoded(array, metadata[array.name], begin, values)
    _write_all(out, files)


def _row(result: RecordingResult, first: int) -> dict[str, Any]:
    made = {key: value for key, value in result.shape.attributes.items() if key not in _TIMES_OF_PUBLICATION}
    return {
        "machine": result.machine,
        "recording_name": result.recording,
        "url": result.url,
        "recording_status": int(result.status != "done"),
        "recording_reason": result.reason,
        "first_row": first,
        "row_size": sum(file.rows for file in result.files),
        "time_first": np.nan if result.first is None else result.first,
        "time_last": np.nan if result.last is None else result.last,
        "recording_shape": _text({"variables": result.shape.variables, "sizes": result.shape.sizes}),
        "made_with": _text(made),
        "channel_name": result.shape.channels,
    }


def _complete(out: FileStore, arrays: list[Array], target: Target, ranges: Iterator[RowRange]) -> None:
    """See that each file of each array is there and no other one of them, as an older archive may have left.

    A chunk can be missing though its task is known as done: the store may have been deleted since.
    """
    expected = {name for array in arrays for name in (f"{array.name}/{METADATA}", *array.chunk_names())}
    there = set(out.names())
    if missing := expected - there:
        chunk = target.arrays[0].chunks[0]
        firsts = {chunk * int(name.split(SEPARATOR)[1]) for name in missing if not name.endswith(METADATA)}
        for rows in ranges:
            if rows.first in firsts:
                write_rows(target, rows)
        if still := sorted(expected - set(out.names())):
            raise RowsError(f"{out.url}: {len(still)} files that were written are missing, {still[0]} the first")
    ours = {array.name for array in arrays} | set(VARIABLES) | {f"{name}{UNDATED}" for name in VARIABLES}
    for name in there - expected:
        array, _, file = name.partition("/")
        if array in ours and _OF_ARRAY.fullmatch(file):
            out.delete(name)


def root_of(metadata: Mapping[str, bytes], attributes: Mapping[str, Any]) -> bytes:
    """Return the metadata of the whole, those of all arrays in it."""
    arrays = {name: json.loads(data) for name, data in sorted(metadata.items())}
    root = {
        "zarr_format": 3,
        "node_type": "group",
        "attributes": dict(attributes),
        "consolidated_metadata": {"kind": "inline", "must_understand": False, "metadata": arrays},
    }
    return json.dumps(root).encode()


def _write_all(out: FileStore, files: Mapping[str, bytes]) -> None:
    """Write files, several at a time; the first error is raised when all have ended."""
    with ThreadPoolExecutor(_WRITERS) as pool:
        for done in [pool.submit(out.write, name, data) for name, data in files.items()]:
            done.result()


def _text(value: Any) -> str:
    return json.dumps(value, sort_keys=True, default=_plain)


def _plain(value: Any) -> Any:
    """Return an attribute as JSON takes it."""
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value
