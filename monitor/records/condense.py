"""Condensing of old blocks: their full records leave the store, what is still needed of them stays.

A condensed block keeps its buckets of the rollup, its identity (source, number, content hash: it is not taken twice),
its place in the counts, and its forecasts as issued. Its record is in the published file of its day. Blocks with an
event and the newest block of each source are kept whole. Blocks are condensed in the order of the ledger;
``meta.condensed_up_to`` is the ledger number up to which this is done.
"""

from __future__ import annotations

import json
import sqlite3
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from monitor.records.database import CONDENSED_VERSION
from monitor.records.rollup import rolled_up_to

if TYPE_CHECKING:
    from monitor.records.store import Store

_UP_TO = "condensed_up_to"
_SCANNED_BLOCKS = 1024
_MIN_UNDATED_BLOCKS = 20_000
"""Blocks that stay where no block has a usable time."""
_LISTED = "SELECT value FROM json_each(?)"
_CANDIDATES = """
SELECT id, source, sequence, content_hash, status, instr(flags, 'clock') > 0, time, day, axis_time FROM blocks
WHERE id > ? ORDER BY id LIMIT ?
"""
_NEWEST_TIME = """
SELECT max(axis_time) FROM blocks WHERE source = ? AND (day IS NULL) = ? AND (instr(flags, 'clock') > 0) = 0
"""
_INPUTS = ("channel", "method", "threshold_mm2", "interval_level", "library_hash", "map_hash", "config_hash")
_ISSUED = ("status", "issued_utc", "data_until", "tt_s", "quantiles")
_FORECASTS = f"""
SELECT forecasts.id, block, {", ".join(f"forecasts.{name}" for name in (*_ISSUED, *_INPUTS))} FROM forecasts
WHERE block IN (SELECT value FROM json_each(?)) ORDER BY forecasts.id
"""


class _Candidate(NamedTuple):
    id: int
    source: str
    sequence: int
    content_hash: str
    status: str
    clock: int
    time: float | None
    day: int | None
    axis_time: float


class Newest(NamedTuple):
    """Newest usable times of all sources on the dated and the undated axis, s, None where there is none."""

    dated: float | None
    undated: float | None

    def is_young(self, block: _Candidate, full_s: float) -> bool | None:
        """Return whether a block is not older than ``full_s``, None where its time does not say."""
        on_axis = (block.day is not None) == (self.dated is not None)
        newest = self.undated if self.dated is None else self.dated
        if block.clock or not on_axis or newest is None:
            return None
        return block.axis_time >= newest - full_s


def has_condensed(connection: sqlite3.Connection) -> bool:
    """Return whether a store has the tables of this module; one of an older version has not."""
    row = connection.execute("SELECT CAST(value AS INTEGER) FROM meta WHERE key = 'schema_version'").fetchone()
    return row is not None and row[0] >= CONDENSED_VERSION


def condensed_up_to(connection: sqlite3.Connection) -> int:
    """Return the ledger number up to which blocks are condensed or kept for good."""
    row = connection.execute("SELECT value FROM meta WHERE key = ?", (_UP_TO,)).fetchone()
    return int(row[0]) if row else 0


def newest_times(connection: sqlite3.Connection) -> Newest:
    """Return the newest times from which ages count; those with the flag ``clock`` are not usable."""
    found: list[list[float]] = [[], []]
    for source in sources_of(connection):
        for undated in (0, 1):
            time = connection.execute(_NEWEST_TIME, (source, undated)).fetchone()[0]
            # On the undated axis, 0 is also the time of blocks of which none is known.
            if time is not None and (time or not undated):
                found[undated].append(time)
    return Newest(*(max(times, default=None) for times in found))


def sources_of(connection: sqlite3.Connection) -> list[str]:
    """Return the sources of all blocks in the store, in order."""
    found: list[str] = []
    # DISTINCT would read the whole index.
    query, last = "SELECT min(source) FROM blocks WHERE source > ?", ""
    while (name := connection.execute(query, (last,)).fetchone()[0]) is not None:
        found.append(name)
        last = name
    return found


def condense(store: Store, full_s: float, most: int, *, by_number: bool = False) -> int:
    """Condense at most ``most`` of the oldest blocks in one transaction; return how many it settled.

    A block is condensed where it is older than ``full_s`` before the newest one, in the rollup, and in the published
    file of its day. Blocks whose time does not say how old they are go with older ones behind them.

    Args:
        store: of the writer.
        full_s: age up to which full records stay, s of record time.
        most: blocks in one step.
        by_number: where no time is usable, condense all but the newest 20,000 blocks instead of none.
    """
    with store.transaction() as connection:
        return condense_within(connection, full_s, most, by_number=by_number)


def condense_within(connection: sqlite3.Connection, full_s: float, most: int, *, by_number: bool) -> int:
    """Condense blocks as :func:`condense`, within a transaction."""
    last = condensed_up_to(connection)
    rows = [_Candidate(*row) for row in connection.execute(_CANDIDATES, (last, max(most, _SCANNED_BLOCKS)))]
    old = _old_of(connection, rows, full_s, by_number=by_number)[:most]
    old = _published_of(connection, [row for row in old if row.id <= rolled_up_to(connection)])
    if not old:
        return 0
    ids = json.dumps([row.id for row in old])
    kept = {row[0] for row in connection.execute(f"SELECT block FROM events WHERE block IN ({_LISTED})", (ids,))}
    newest = {
        source: connection.execute("SELECT max(sequence) FROM blocks WHERE source = ?", (source,)).fetchone()[0]
        for source in {row.source for row in old}
    }
    moved = [row for row in old if row.id not in kept and row.sequence != newest[row.source]]
    if moved:
        _move(connection, moved)
    connection.execute("INSERT OR REPLACE INTO meta VALUES (?, ?)", (_UP_TO, str(old[-1].id)))
    return len(old)


def _old_of(
    connection: sqlite3.Connection, rows: Sequence[_Candidate], full_s: float, *, by_number: bool
) -> Sequence[_Candidate]:
    """Return the first of the rows, up to the last old one before the first young one."""
    newest = newest_times(connection)
    if newest == (None, None):
        (end,) = connection.execute("SELECT coalesce(max(id), 0) FROM blocks").fetchone()
        return [row for row in rows if by_number and row.id <= end - _MIN_UNDATED_BLOCKS]
    reach = 0
    for place, row in enumerate(rows):
        young = newest.is_young(row, full_s)
        if young:
            return rows[:reach]
        if young is False:
            reach = place + 1
    # So many blocks without a usable time do not hold up those behind them.
    return rows[:reach] if reach or len(rows) < _SCANNED_BLOCKS else rows


def _published_of(connection: sqlite3.Connection, rows: Sequence[_Candidate]) -> Sequence[_Candidate]:
    """Return the first of the rows, as far as the published files have them."""
    files: dict[int | None, int] = {}
    for place, row in enumerate(rows):
        if row.day not in files:
            query = "SELECT coalesce(max(last_block), 0) FROM published WHERE day IS ?"
            files[row.day] = connection.execute(query, (row.day,)).fetchone()[0]
        if row.id > files[row.day]:
            return rows[:place]
    return rows


def _move(connection: sqlite3.Connection, rows: Sequence[_Candidate]) -> None:
    numbers = {source: _note_source(connection, source, rows) for source in {row.source for row in rows}}
    connection.executemany(
        "INSERT INTO identities VALUES (?, ?, ?)",
        [(numbers[row.source], row.sequence, _packed(row.content_hash)) for row in rows],
    )
    for day, blocks in Counter(row.day for row in rows).items():
        changed = connection.execute("UPDATE condensed_days SET blocks = blocks + ? WHERE day IS ?", (blocks, day))
        if not changed.rowcount:
            connection.execute("INSERT INTO condensed_days VALUES (?, ?)", (day, blocks))
    ids = json.dumps([row.id for row in rows])
    _keep_forecasts(connection, ids, {row.id: row for row in rows}, numbers)
    for table in ("forecasts", "digests", "records"):
        connection.execute(f"DELETE FROM {table} WHERE block IN ({_LISTED})", (ids,))
    connection.execute(f"DELETE FROM blocks WHERE id IN ({_LISTED})", (ids,))


def _note_source(connection: sqlite3.Connection, source: str, rows: Sequence[_Candidate]) -> int:
    """Add the rows of a source to its counts and its range of time; return its number."""
    mine = [row for row in rows if row.source == source]
    query = "SELECT id, began, counts, first_dated, last_dated, first_undated, last_undated FROM condensed_sources"
    found = connection.execute(f"{query} WHERE source = ?", (source,)).fetchone()
    began, *ends = (None,) * 5 if found is None else (found[1], *found[3:])
    counts = Counter({} if found is None else json.loads(found[2]))
    counts.update(row.status for row in mine)
    if began is None:
        began = next((row.time for row in mine if row.time is not None), None)
    for dated in (True, False):
        times = [row.axis_time for row in mine if (row.day is not None) == dated and not row.clock]
        place = 0 if dated else 2
        if times:
            first, last = ends[place : place + 2]
            ends[place : place + 2] = (
                min(times) if first is None else min(first, *times),
                max(times) if last is None else max(last, *times),
            )
    connection.execute(
        "INSERT INTO condensed_sources (source, began, counts, first_dated, last_dated, first_undated, last_undated)"
        " VALUES (?, ?, ?, ?, ?, ?, ?) ON CONFLICT (source) DO UPDATE SET began = excluded.began,"
        " counts = excluded.counts, first_dated = excluded.first_dated, last_dated = excluded.last_dated,"
        " first_undated = excluded.first_undated, last_undated = excluded.last_undated",
        (source, began, json.dumps(counts), *ends),
    )
    return connection.execute("SELECT id FROM condensed_sources WHERE source = ?", (source,)).fetchone()[0]


def _keep_forecasts(
    connection: sqlite3.Connection, ids: str, blocks: Mapping[int, _Candidate], sources: Mapping[str, int]
) -> None:
    """Copy the forecasts of blocks without their bodies; common inputs are written once."""
    known: dict[tuple[Any, ...], int] = {}
    same = " AND ".join(f"{name} IS ?" for name in _INPUTS)
    for number, block, *values in connection.execute(_FORECASTS, (ids,)).fetchall():
        issued, inputs = values[: len(_ISSUED)], tuple(values[len(_ISSUED) :])
        if inputs not in known:
            found = connection.execute(f"SELECT id FROM forecast_inputs WHERE {same}", inputs).fetchone()
            if found is None:
                marks = ", ".join("?" for _ in _INPUTS)
                statement = f"INSERT INTO forecast_inputs ({', '.join(_INPUTS)}) VALUES ({marks}) RETURNING id"
                found = connection.execute(statement, inputs).fetchone()
            known[inputs] = found[0]
        row = blocks[block]
        values = (number, sources[row.source], row.sequence, row.day is not None, known[inputs], *issued)
        connection.execute("INSERT INTO condensed_forecasts VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)", values)


def identity_of(connection: sqlite3.Connection, source: str, sequence: int) -> str | None:
    """Return the content hash of a condensed block, or None."""
    query = (
        "SELECT content FROM identities JOIN condensed_sources ON id = identities.source"
        " WHERE condensed_sources.source = ? AND sequence = ?"
    )
    found = connection.execute(query, (source, sequence)).fetchone()
    return _unpacked(found[0]) if found else None


def numbers_with(connection: sqlite3.Connection, source: str, content_hash: str) -> int | None:
    """Return the least number of a condensed block with this content, or None."""
    content = _packed(content_hash)
    query = (
        "SELECT min(sequence) FROM identities JOIN condensed_sources ON id = identities.source"
        " WHERE condensed_sources.source = ? AND substr(content, 1, 6) = substr(?, 1, 6) AND content = ?"
    )
    return connection.execute(query, (source, content, content)).fetchone()[0]


def condensed_counts(connection: sqlite3.Connection) -> Iterator[tuple[str, int]]:
    """Yield statuses and numbers of condensed blocks, source by source; none where a store is of an older version."""
    for (text,) in connection.execute("SELECT counts FROM condensed_sources") if has_condensed(connection) else ():
        yield from json.loads(text).items()


def condensed_on(connection: sqlite3.Connection, day: int | None) -> int:
    """Return how many blocks of a UTC day (days since 1970), or of the undated axis, are condensed."""
    if not has_condensed(connection):
        return 0
    found = connection.execute("SELECT blocks FROM condensed_days WHERE day IS ?", (day,)).fetchone()
    return found[0] if found else 0


def condensed_span(connection: sqlite3.Connection, source: str, *, dated: bool) -> tuple[float, float] | None:
    """Return first and last time of the condensed blocks of a source on one axis, s, or None."""
    if not has_condensed(connection):
        return None
    columns = "first_dated, last_dated" if dated else "first_undated, last_undated"
    found = connection.execute(f"SELECT {columns} FROM condensed_sources WHERE source = ?", (source,)).fetchone()
    return found if found is not None and found[0] is not None else None


def _packed(content_hash: str) -> bytes | str:
    """Return a hexadecimal digest as bytes, any other text as it is."""
    try:
        content = bytes.fromhex(content_hash)
    except ValueError:
        return content_hash
    return content if content.hex() == content_hash else content_hash


def _unpacked(content: bytes | str) -> str:
    return content if isinstance(content, str) else content.hex()
