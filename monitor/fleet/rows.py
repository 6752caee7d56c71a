"""Rows of an archive from the netCDF files of its recordings: which files a range of rows needs, and their values."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import netCDF4
import numpy as np
from numpy.typing import NDArray

from models.words.errors import SpallwatchError
from models.work.task import FileStore
from monitor.fleet.arrays import CHANNEL, PART, ROW, UNDATED, Array
from monitor.fleet.result import RecordingResult

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
