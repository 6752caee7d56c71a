"""Questions to a store with typed answers, for page, report, metrics, publishers and daemon.

Each takes any open store (the writer's, a connection beside it, or the reader of the page) and raises StoreError where
that cannot be read. No rows, cursors or errors of SQLite leave this room.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from monitor.records.condense import condensed_on, condensed_up_to, has_condensed, identity_of
from monitor.records.database import Readable
from monitor.records.events import Acknowledgement, LoggedEvent, tables_of
from monitor.records.packing import columns_of, numbers_of, places_of, unpack
from monitor.records.rollup import ENTRY_QUERY, BlockEntry, SeriesKey, read_points
from monitor.records.trends import TrendTable

_RECENT_BLOCKS = 200
_RECORDS = "blocks JOIN records ON records.block = blocks.id JOIN layouts ON layouts.id = records.layout"
_FIELDS = "blocks.id, source, sequence, status, flags, reason, time, elapsed, layouts.layout, row"
_WITH_BLOCKS = """
SELECT axis_time AS moment, 0 AS kind, events.id AS id, source, sequence, day IS NOT NULL AS dated, body
FROM events JOIN blocks ON blocks.id = block
"""
_WITHOUT = "SELECT utc, 1, id, NULL, NULL, 1, body FROM notices"


class LedgerPlace(NamedTuple):
    """A place in the ledger: number, and the source and block that it belongs to."""

    id: int
    source: str
    sequence: int


class LedgerBlock(NamedTuple):
    """A block of the ledger; ``time`` is in seconds on the dated or the undated axis."""

    id: int
    source: str
    sequence: int
    status: str
    time: float
    dated: int
    name: str
    reason: str


class RefusedBlock(NamedTuple):
    """How often a repetition of a block was refused; ``status`` is "duplicate" or "changed"."""

    sequence: int
    name: str
    status: str
    content_hash: str
    times: int


class LogMarks(NamedTuple):
    """Numbers of the newest event, notice and acknowledgement, 0 where there is none."""

    events: int = 0
    notices: int = 0
    acknowledgements: int = 0


class EventPlace(NamedTuple):
    """Sort key of an event among those of all machines."""

    moment: float
    machine: str
    kind: int
    id: int


@dataclass(frozen=True)
class StoredRecord:
    """A record as the store has it; ``flags`` are separated by blanks, times are s, values SI."""

    machine: str
    source: str
    sequence: int
    status: str
    flags: str
    reason: str
    time: float | None
    elapsed: float | None
    channels: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)


def newest_id(store: Readable) -> int:
    """Return the number of the newest block in the ledger, 0 where there is none."""
    return store.rows("SELECT coalesce(max(id), 0) FROM blocks")[0][0]


def newest_day(store: Readable) -> int | None:
    """Return the newest UTC day with blocks, days since 1970, None where no block has a date."""
    return store.rows("SELECT max(day) FROM blocks")[0][0]


def place_at(store: Readable, number: int) -> LedgerPlace | None:
    """Return the place with a number of the ledger, or None."""
    found = store.rows("SELECT id, source, sequence FROM blocks WHERE id = ?", number)
    return LedgerPlace(*found[0]) if found else None


def place_of(store: Readable, source: str, sequence: int) -> LedgerPlace | None:
    """Return the place of a block, or None where it is not in the ledger any more."""
    query = "SELECT id, source, sequence FROM blocks WHERE source = ? AND sequence = ?"
    found = store.rows(query, source, sequence)
    return LedgerPlace(*found[0]) if found else None


def condensed_place(store: Readable, source: str, sequence: int) -> int | None:
    """Return the ledger number up to which blocks are condensed, None where the block is not one of them."""
    with store.connection() as connection:
        oldest = condensed_up_to(connection) if has_condensed(connection) else 0
        return oldest if oldest and identity_of(connection, source, sequence) is not None else None


def condensed_blocks(store: Readable) -> int:
    """Return of how many blocks the full records have left the store."""
    with store.connection() as connection:
        has = has_condensed(connection)
    return (store.rows("SELECT sum(blocks) FROM condensed_days")[0][0] or 0) if has else 0


def condensed_of_day(store: Readable, day: int | None) -> int:
    """Return how many blocks of a UTC day, days since 1970, or of the undated axis have no full record in the store."""
    with store.connection() as connection:
        return condensed_on(connection, day)


def last_published(store: Readable, file: str) -> int | None:
    """Return the ledger number of the last block in a published file, or None."""
    found = store.rows("SELECT last_block FROM published WHERE file = ?", file)
    return found[0][0] if found else None


def blocks_after(store: Readable, number: int, most: int) -> list[LedgerBlock]:
    """Return at most so many blocks after a number of the ledger."""
    query = "SELECT id, source, sequence, status, axis_time, day IS NOT NULL, name, reason FROM blocks"
    return [LedgerBlock(*row) for row in store.rows(f"{query} WHERE id > ? ORDER BY id LIMIT ?", number, most)]


def refused_files(store: Readable, source: str, most: int) -> dict[str, str]:
    """Return why readers refused files of a source, by name, the first ones; copies of others are left out."""
    query = (
        "SELECT name, substr(reason, length(name) + 3) FROM blocks WHERE source = ? AND status != 'duplicate'"
        " AND name != '' AND substr(reason, 1, length(name) + 2) = name || ': ' ORDER BY id LIMIT ?"
    )
    return dict(store.rows(query, source, most))


def is_dated(store: Readable, source: str) -> bool | None:
    """Return whether the blocks of a source have dates, None where they have no time at all.

    Blocks rejected without a time do not count.
    """
    query = "SELECT day FROM blocks WHERE source = ? AND time_status = 'given' ORDER BY sequence DESC LIMIT 1"
    if rows := store.rows(query, source):
        return rows[0][0] is not None
    return None if store.rows("SELECT 1 FROM blocks WHERE source = ? LIMIT 1", source) else False


def has_undated(store: Readable, source: str | None = None) -> bool:
    """Return whether blocks of a source that have a time, or any block at all, have no date."""
    if source is None:
        return bool(store.rows("SELECT 1 FROM blocks WHERE day IS NULL LIMIT 1"))
    query = "SELECT 1 FROM blocks WHERE source = ? AND time IS NULL AND elapsed IS NOT NULL LIMIT 1"
    return bool(store.rows(query, source))


def first_start(store: Readable, source: str) -> float | None:
    """Return the start of the first dated block of a source, condensed or not, seconds since 1970 UTC, or None."""
    condensed = store.rows("SELECT began FROM condensed_sources WHERE source = ?", source)
    query = "SELECT time FROM blocks WHERE source = ? AND time IS NOT NULL ORDER BY id LIMIT 1"
    return next((time for (time,) in (*condensed, *store.rows(query, source)) if time is not None), None)


def refusals_of(store: Readable, source: str) -> list[RefusedBlock]:
    """Return the refused repetitions of a source."""
    query = "SELECT sequence, name, status, content_hash, times FROM refusals WHERE source = ?"
    return [RefusedBlock(*row) for row in store.rows(query, source)]


def refused_counts(store: Readable) -> dict[tuple[str, str], int]:
    """Return how many repetitions were refused, by source and status."""
    rows = store.rows("SELECT source, status, sum(times) FROM refusals GROUP BY source, status")
    return {(source, status): times for source, status, times in rows}


def has_ledger(store: Readable) -> bool:
    """Return whether a store has the tables of a ledger of files, which a daemon makes."""
    return bool(store.rows("SELECT 1 FROM sqlite_master WHERE name = 'files'"))


def state_block(store: Readable, name: str) -> int:
    """Return the ledger number of the block after which the state of a stage is, 0 where there is none."""
    found = store.rows("SELECT block FROM stage_states WHERE name = ?", name)
    return found[0][0] if found else 0


def newest_values(
    store: Readable, source: str, names: tuple[str, ...], channels: Collection[str]
) -> dict[str, dict[str, float]]:
    """Return the finite values of some names in the latest record of a source that has any, by channel, SI."""
    query = f"SELECT layouts.layout, row FROM {_RECORDS} WHERE source = ? AND length(row) > 0"
    for layout, row in store.rows(f"{query} ORDER BY sequence DESC LIMIT 1", source):
        places = places_of(layout, names)
        return {channel: _values(row, places[channel], names) for channel in channels if channel in places}
    return {}


def staged_values(store: Readable, source: str, channel: str, names: tuple[str, ...]) -> dict[str, float]:
    """Return the finite values of some names in the latest record of a channel that has a stage, SI."""
    query = f"SELECT layouts.layout, row FROM {_RECORDS} WHERE source = ? ORDER BY sequence DESC LIMIT {_RECENT_BLOCKS}"
    with store.connection() as connection:
        for layout, row in connection.execute(query, (source,)):
            places = places_of(layout, (*names, "stage")).get(channel)
            if places is not None and places[-1] >= 0:
                return _values(row, places[:-1], names)
    return {}


def _values(row: bytes, places: NDArray[np.intp], names: Sequence[str]) -> dict[str, float]:
    values = columns_of(numbers_of(row)[None, :], places)[0]
    return {name: value for name, value in zip(names, values.tolist(), strict=True) if np.isfinite(value)}


def values_since(
    store: Readable, source: str, channel: str, names: tuple[str, ...], first: int, most: int
) -> NDArray[np.float64]:
    """Return time (s) and the values of some names from a block on, evenly thinned, shape (n, 1 + name), SI."""
    (last,) = store.rows("SELECT max(sequence) FROM blocks WHERE source = ?", source)[0]
    step = max(1, -(-(last - first + 1) // most))
    rows = store.rows(
        "SELECT axis_time, layout, row FROM blocks JOIN records ON block = id WHERE source = ? AND sequence >= ?"
        " AND (sequence % ? = ? OR sequence = ?) ORDER BY sequence",
        *(source, first, step, last % step, last),
    )
    layouts = {number: places_of(text, names) for number, text in store.rows("SELECT id, layout FROM layouts")}
    points = [
        (time, *columns_of(numbers_of(row)[None, :], layouts[layout][channel])[0])
        for time, layout, row in rows
        if channel in layouts.get(layout, {})
    ]
    return np.array(points, dtype=float).reshape(-1, 1 + len(names))


def trends_after(store: Readable, key: SeriesKey, after: int, until: int, most: int) -> TrendTable:
    """Return the newest records of a channel with ledger numbers above ``after``, up to ``until``."""
    query = f"{ENTRY_QUERY} WHERE id > ? AND id <= ? AND +source = ? ORDER BY id DESC LIMIT ?"
    with store.connection() as connection:
        rows = connection.execute(query, (after, until, key.source, most)).fetchall()
        entries = [entry for row in reversed(rows) if (entry := BlockEntry(*row)).dated == key.dated]
        entries.sort(key=lambda entry: (entry.time, entry.id))
        return TrendTable.of_points(read_points(connection, entries, key.channel), dated=key.dated)


def records_after(store: Readable, machine: str, number: int, most: int) -> Iterator[tuple[int, StoredRecord]]:
    """Yield at most so many records after a number of the ledger, each with its number."""
    query = f"SELECT {_FIELDS} FROM {_RECORDS} WHERE blocks.id > ? ORDER BY blocks.id LIMIT ?"
    for row in store.rows(query, number, most):
        yield row[0], _stored_record(machine, row)


def latest_record(store: Readable, machine: str, source: str) -> StoredRecord | None:
    """Return the record of the latest block of a source, or None."""
    query = f"SELECT {_FIELDS} FROM {_RECORDS} WHERE source = ? ORDER BY sequence DESC LIMIT 1"
    return next((_stored_record(machine, row) for row in store.rows(query, source)), None)


def _stored_record(machine: str, row: Sequence[Any]) -> StoredRecord:
    *values, layout, packed = row[1:]
    return StoredRecord(machine, *values, channels=unpack(layout, packed))


def committed_values(store: Readable, source: str, sequence: int, content_hash: str) -> dict[str, dict[str, Any]]:
    """Return the values by channel of the record of a block with this content, none where it is not committed."""
    query = f"SELECT layouts.layout, row FROM {_RECORDS} WHERE source = ? AND sequence = ? AND content_hash = ?"
    return next((unpack(*row) for row in store.rows(query, source, sequence, content_hash)), {})


def log_marks(store: Readable) -> LogMarks:
    """Return numbers that change with each event, notice and acknowledgement."""
    with store.connection() as connection:
        tables = tables_of(connection)
        return LogMarks(
            *(
                connection.execute(f"SELECT coalesce(max(id), 0) FROM {table}").fetchone()[0] if table in tables else 0
                for table in LogMarks._fields
            )
        )


def latest_flow_notices(store: Readable) -> dict[str, str]:
    """Return the kind of the latest notice on the flow of each source: "no_data" or "data_again"."""
    kind = "json_extract(body, '$.kind')"
    query = f"SELECT json_extract(body, '$.source'), {kind} FROM notices"
    return dict(store.rows(f"{query} WHERE {kind} IN ('no_data', 'data_again') ORDER BY id"))


def newest_events(
    store: Readable, machine: str, limit: int, before: EventPlace | None = None, name: str | None = None
) -> list[tuple[EventPlace, LoggedEvent]]:
    """Return events of one machine with their places, the newest first; with ``name``, that of this name in its log."""
    where, values = "1", ()
    if name is not None:
        where, values = "kind = ? AND id = ?", (int(name.startswith("n")), int(name.lstrip("n")))
    if before is not None:
        where += " AND (moment, ?, kind, id) < (?, ?, ?, ?)"
        values = (*values, machine, *before)
    with store.connection() as connection:
        tables = tables_of(connection)
        log = _WITH_BLOCKS + (f" UNION ALL {_WITHOUT}" if "notices" in tables else "")
        query = f"SELECT * FROM ({log}) WHERE {where} ORDER BY moment DESC, kind DESC, id DESC LIMIT ?"
        rows = connection.execute(query, (*values, limit)).fetchall()
        given: dict[str, tuple[Acknowledgement, ...]] = {}
        if "acknowledgements" in tables:
            names = json.dumps([_log_name(row[1], row[2]) for row in rows])
            query = "SELECT event, who, utc, note FROM acknowledgements WHERE event IN (SELECT value FROM json_each(?))"
            for event, *words in connection.execute(f"{query} ORDER BY id", (names,)):
                given[event] = (*given.get(event, ()), Acknowledgement(*words))
    found: list[tuple[EventPlace, LoggedEvent]] = []
    for moment, kind, number, source, sequence, dated, body in rows:
        log_name = _log_name(kind, number)
        utc = moment if dated else None
        event = LoggedEvent(log_name, source, sequence, utc, json.loads(body), given.get(log_name, ()))
        found.append((EventPlace(moment, machine, kind, number), event))
    return found


def _log_name(kind: int, number: int) -> str:
    return f"n{number}" if kind else str(number)
