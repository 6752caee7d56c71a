"""The trend features of blocks, read out of the packed rows of the store."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from monitor.health.schema import STATUSES
from monitor.records.packing import columns_of, numbers_of, places_of
from monitor.words.features import TRENDS

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

ENTRY_QUERY = """
SELECT id, source, sequence, status, day IS NOT NULL, axis_time, layout FROM blocks JOIN records ON block = id
"""
"""Selects the columns of :class:`BlockEntry`."""

FEATURES = tuple(feature.name for feature in TRENDS)
"""Names of the features whose extremes are kept, in their order in rows and buckets."""
_WANTED = (*FEATURES, "quality_status")
_STATUS_PLACES = {status: place for place, status in enumerate(STATUSES)}


class BlockEntry(NamedTuple):
    """A row of ``ENTRY_QUERY``; ``time`` is in seconds on the dated or the undated axis."""

    id: int
    source: str
    sequence: int
    status: str
    dated: int
    time: float
    layout: int


class SeriesKey(NamedTuple):
    """A channel of a source on one axis; blocks without any channel have the channel ""."""

    source: str
    channel: str
    dated: bool


@dataclass(frozen=True, eq=False)
class Points:
    """The trend features of one channel in n blocks.

    Attributes:
        time: s, shape (n,).
        values: the ``FEATURES``, SI, NaN where absent, shape (n, feature).
        status: place of the channel's status in ``STATUSES``, shape (n,).
        sequence: number of the block in its source, shape (n,).
    """

    time: Floats
    values: Floats
    status: Ints
    sequence: Ints


def read_points(connection: sqlite3.Connection, entries: Sequence[BlockEntry], channel: str) -> Points:
    """Return the points of one channel in the order of the entries, reading only its part of each row.

    Blocks with other channels only are left out; blocks without any channel count for every channel.
    """
    values = np.full((len(entries), len(_WANTED)), np.nan)
    known = np.zeros(len(entries), dtype=bool)
    by_layout: dict[int, list[int]] = {}
    for place, entry in enumerate(entries):
        by_layout.setdefault(entry.layout, []).append(place)
    for layout, members in by_layout.items():
        channels = _places(connection, layout)
        if channel in channels:
            values[members] = _row_parts(connection, [entries[place].id for place in members], channels[channel])
        known[members] = not channels or channel in channels
    return _points([entry for entry, wanted in zip(entries, known, strict=True) if wanted], values[known])


def points_by_series(
    connection: sqlite3.Connection, entries: Sequence[BlockEntry], rows: Sequence[bytes]
) -> Iterator[tuple[SeriesKey, Points]]:
    """Yield the points of all channels; ``rows`` are the packed rows of the entries."""
    alike: dict[tuple[str, int, int], list[int]] = {}
    for place, entry in enumerate(entries):
        alike.setdefault((entry.source, entry.dated, entry.layout), []).append(place)
    for (source, dated, layout), members in alike.items():
        group = [entries[place] for place in members]
        numbers = numbers_of(b"".join(rows[place] for place in members)).reshape(len(members), -1)
        channels = _places(connection, layout) or {"": np.full(len(_WANTED), -1, dtype=np.intp)}
        for channel, places in channels.items():
            yield SeriesKey(source, channel, bool(dated)), _points(group, columns_of(numbers, places))


def _places(connection: sqlite3.Connection, layout: int) -> dict[str, NDArray[np.intp]]:
    (text,) = connection.execute("SELECT layout FROM layouts WHERE id = ?", (layout,)).fetchone()
    return places_of(text, _WANTED)


def _points(entries: Sequence[BlockEntry], values: Floats) -> Points:
    """Separate the channel's status, which overrides that of the block, from the features."""
    statuses = np.array([_STATUS_PLACES[entry.status] for entry in entries], dtype=np.int64)
    own = values[:, -1]
    return Points(
        time=np.array([entry.time for entry in entries], dtype=np.float64),
        values=values[:, :-1],
        status=np.where(np.isnan(own), statuses, np.nan_to_num(own)).astype(np.int64),
        sequence=np.array([entry.sequence for entry in entries], dtype=np.int64),
    )


def _row_parts(connection: sqlite3.Connection, blocks: Sequence[int], places: NDArray[np.intp]) -> Floats:
    """Return the numbers at places of the rows of blocks of one layout, shape (block, place)."""
    present = places[places >= 0]
    if not present.size:
        return np.full((len(blocks), places.size), np.nan)
    first, last = int(present.min()), int(present.max())
    query = "SELECT block, substr(row, ?, ?) FROM records WHERE block IN (SELECT value FROM json_each(?))"
    parts = dict(connection.execute(query, (8 * first + 1, 8 * (last - first + 1), json.dumps(blocks))))
    numbers = numbers_of(b"".join(parts[block] for block in blocks)).reshape(len(blocks), -1)
    return columns_of(numbers, np.where(places >= 0, places - first, -1))
