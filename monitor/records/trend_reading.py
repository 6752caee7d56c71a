"""The few numbers of each record that trends are made of, out of the packed rows of the store."""

from __future__ import annotations

import json
import sqlite3
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from monitor.health.schema import STATUSES
from monitor.records.packing import columns_of, numbers_of, places_of
from monitor.records.trend_levels import FEATURES, Array, Whole

_WANTED = (*FEATURES, "quality_status")
_STATUS = {status: place for place, status in enumerate(STATUSES)}
_MOST_LAYOUTS = 500
_MOST_BYTES = 16_000_000
_BLOCKS = "blocks.id, source, sequence, status, flags, day IS NOT NULL, axis_time, layout"
_JOINED = "FROM blocks JOIN records ON records.block = blocks.id"

Places = dict[str, NDArray[np.intp]]


class Ledgered(NamedTuple):
    """A block of the ledger: its number there, identity, status, flags, place on the time axis, layout of its row."""

    id: int
    source: str
    sequence: int
    status: str
    flags: str
    dated: int
    time: float
    layout: int


@dataclass(frozen=True, eq=False)
class Points:
    """What records say of one channel; n records.

    Attributes:
        time: of the block, s, shape (n,).
        values: the ``FEATURES``, NaN where there is none, shape (n, feature).
        status: place of the channel's status in ``STATUSES``, shape (n,).
    """

    time: Array
    values: Array
    status: Whole


class Layouts:
    """Where in the rows of each layout the wanted numbers stand; may be asked from any thread."""

    def __init__(self) -> None:
        """Know none yet."""
        self._known: dict[int, Places] = {}
        self._lock = threading.Lock()

    def places(self, connection: sqlite3.Connection, layout: int) -> Places:
        """Return the places of the wanted numbers by channel."""
        with self._lock:
            found = self._known.get(layout)
            if found is None:
                if len(self._known) >= _MOST_LAYOUTS:
                    self._known.clear()
                (text,) = connection.execute("SELECT layout FROM layouts WHERE id = ?", (layout,)).fetchone()
                found = self._known[layout] = places_of(text, _WANTED)
            return found

    def forget(self) -> None:
        """Know none any more: the store is another one."""
        with self._lock:
            self._known.clear()


def read_after(connection: sqlite3.Connection, number: int, most: int) -> tuple[list[Ledgered], list[bytes], bool]:
    """Read the blocks after a ledger number: their entries, their rows, and whether there are more.

    Args:
        connection: to the store.
        number: that of the last block that is known.
        most: at most so many blocks; fewer where their rows are large.
    """
    entries: list[Ledgered] = []
    rows: list[bytes] = []
    size = 0
    query = f"SELECT {_BLOCKS}, row {_JOINED} WHERE blocks.id > ? ORDER BY blocks.id LIMIT ?"
    for found in connection.execute(query, (number, most + 1)):
        if len(rows) == most or size > _MOST_BYTES:
            return entries, rows, True
        entries.append(Ledgered(*found[:-1]))
        rows.append(found[-1])
        size += len(found[-1])
    return entries, rows, False


def points_of(
    connection: sqlite3.Connection, layouts: Layouts, entries: list[Ledgered], rows: list[bytes]
) -> Iterator[tuple[tuple[str, str, bool], Points]]:
    """Yield what blocks say by (source, channel, dated); each row is unpacked once.

    A block without any channel, rejected as a whole, says its status under the channel "".
    """
    alike: dict[tuple[str, int, int], list[int]] = {}
    for place, entry in enumerate(entries):
        alike.setdefault((entry.source, entry.layout, entry.dated), []).append(place)
    for (source, layout, dated), members in alike.items():
        time = np.array([entries[place].time for place in members])
        status = np.array([_STATUS[entries[place].status] for place in members], dtype=np.int64)
        places = layouts.places(connection, layout)
        if not places:
            yield (source, "", bool(dated)), Points(time, np.full((time.size, len(FEATURES)), np.nan), status)
            continue
        numbers = numbers_of(b"".join(rows[place] for place in members)).reshape(time.size, -1)
        for channel, where in places.items():
            yield (source, channel, bool(dated)), _points(time, status, columns_of(numbers, where))


def _points(time: Array, status: Whole, columns: Array) -> Points:
    """Separate the channel's own status, which takes the place of the block's where it has one, from its features."""
    own = columns[:, -1]
    status = np.where(np.isnan(own), status, np.nan_to_num(own, nan=0.0)).astype(np.int64)
    return Points(time, columns[:, :-1], status)


def blocks_between(
    connection: sqlite3.Connection,
    source: str,
    dated: bool,
    since: float,
    until: float,
    sequences: tuple[int, int] | None,
    others: list[int],
) -> list[Ledgered]:
    """Return the blocks of a source in a range of time, in the order of time.

    Args:
        connection: to the store.
        source: its name.
        dated: whether the time axis is UTC.
        since: begin of the range, s.
        until: end of the range, s, which belongs to it.
        sequences: first and last number of the blocks that came in order of time, or None.
        others: ledger numbers of blocks that did not.
    """
    query = f"SELECT {_BLOCKS} {_JOINED} WHERE %s AND axis_time BETWEEN ? AND ? AND (day IS NOT NULL) = ?"
    condition = (since, until, int(dated))
    found: dict[int, Ledgered] = {}
    if sequences is not None:
        rows = connection.execute(query % "source = ? AND sequence BETWEEN ? AND ?", (source, *sequences, *condition))
        found.update((row[0], Ledgered(*row)) for row in rows)
    if others:
        rows = connection.execute(
            query % "blocks.id IN (SELECT value FROM json_each(?))", (json.dumps(others), *condition)
        )
        found.update((row[0], Ledgered(*row)) for row in rows)
    return sorted(found.values(), key=lambda entry: (entry.time, entry.id))


def points_between(
    connection: sqlite3.Connection, layouts: Layouts, entries: list[Ledgered], channel: str
) -> tuple[Points, Whole]:
    """Return what blocks say of one channel, and their numbers in their source; those without the channel are left out.

    Of each row only the part of that channel is read.
    """
    time: list[Array] = []
    values: list[Array] = []
    status: list[Whole] = []
    members: list[Ledgered] = []
    alike: dict[int, list[Ledgered]] = {}
    for entry in entries:
        alike.setdefault(entry.layout, []).append(entry)
    for layout, group in alike.items():
        places = layouts.places(connection, layout)
        if places and channel not in places:
            continue
        said = np.array([_STATUS[entry.status] for entry in group], dtype=np.int64)
        where = places.get(channel, np.full(len(_WANTED), -1, dtype=np.intp))
        points = _points(np.array([entry.time for entry in group]), said, _part(connection, group, where))
        members += group
        time.append(points.time)
        values.append(points.values)
        status.append(points.status)
    if not members:
        nothing = Points(np.empty(0), np.empty((0, len(FEATURES))), np.empty(0, dtype=np.int64))
        return nothing, np.empty(0, dtype=np.int64)
    order = sorted(range(len(members)), key=lambda place: (members[place].time, members[place].id))
    points = Points(np.concatenate(time)[order], np.concatenate(values)[order], np.concatenate(status)[order])
    return points, np.array([members[place].sequence for place in order], dtype=np.int64)


def _part(connection: sqlite3.Connection, group: list[Ledgered], where: NDArray[np.intp]) -> Array:
    """Read the numbers at places of the rows of blocks of one layout, shape (block, place)."""
    there = where[where >= 0]
    if not there.size:
        return np.full((len(group), where.size), np.nan)
    first, last = int(there.min()), int(there.max())
    rows = dict(
        connection.execute(
            "SELECT block, substr(row, ?, ?) FROM records WHERE block IN (SELECT value FROM json_each(?))",
            (8 * first + 1, 8 * (last - first + 1), json.dumps([entry.id for entry in group])),
        )
    )
    numbers = numbers_of(b"".join(rows[entry.id] for entry in group)).reshape(len(group), -1)
    return columns_of(numbers, np.where(where >= 0, where - first, -1))
