"""What gives way where the store and the published files reach ``[retention] max_gb``, and what never does.

In the order of :data:`KINDS`, the oldest first. States, blocks with events, forecasts as issued, the newest block of
each source, identities and counts, spectra around t_fs and the newest, trends of two hours and more, and all of the
newest day stay. ``meta.given_up`` says what gave way: it is written in the transaction that deletes.
"""

from __future__ import annotations

import json
import sqlite3
from typing import TYPE_CHECKING, NamedTuple

from monitor.records.compact import RESERVE_BYTES
from monitor.records.condense import condense_within, condensed_up_to, newest_times
from monitor.records.rollup import LEVELS_S, drop_buckets
from monitor.records.spectra import strip_views, thin_within

if TYPE_CHECKING:
    from monitor.records.database import Readable
    from monitor.records.store import Store

KINDS = ("waveforms", "raw_spectra", "records", "spectra", "trends_minute", "trends_10_minutes", "published_days")
"""What is given up, in this order; published days only where the configuration allows it."""
HEADROOM = 0.05
"""Share of the quota that is left free for what comes between two measurements."""
_MAX_VIEWS = 64
_GIVEN_UP = "given_up"
_BASE_BYTES = RESERVE_BYTES + (8 << 20)
"""Of an empty store: its free reserve, and its write-ahead log with tables."""
_CHANNEL_BYTES = 1 << 20
"""Of a channel: the spectra around t_fs and the end of life, and the newest."""
# Least bytes of a row with its place in indices.
_STAYING = {
    "identities": 40,
    "condensed_forecasts": 60,
    "events": 100,
    f"rollup WHERE level > {LEVELS_S[1]}": 500,
}


class GivenUp(NamedTuple):
    """When something of a kind gave way for the first and for the last time, UTC seconds."""

    since: float
    latest: float


def given_up(store: Readable) -> dict[str, GivenUp]:
    """Return what gave way for the quota, by its kind."""
    rows = store.rows("SELECT value FROM meta WHERE key = ?", _GIVEN_UP)
    return {kind: GivenUp(*found) for kind, found in json.loads(rows[0][0]).items()} if rows else {}


def _note_given_up(connection: sqlite3.Connection, kind: str, utc: float) -> None:
    """Note within a transaction that something of a kind gave way."""
    row = connection.execute("SELECT value FROM meta WHERE key = ?", (_GIVEN_UP,)).fetchone()
    known = json.loads(row[0]) if row else {}
    known[kind] = (known.get(kind, (utc,))[0], utc)
    connection.execute("INSERT OR REPLACE INTO meta VALUES (?, ?)", (_GIVEN_UP, json.dumps(known)))


def note_days_given_up(store: Store, utc: float) -> None:
    """Note that published days gave way; StoreError where that fails."""
    with store.transaction() as connection:
        _note_given_up(connection, KINDS[-1], utc)


def give_up(store: Store, full_s: float, blocks: int, utc: float, *, published: bool) -> str | None:
    """Give up a step of the first kind of which there is some, in one transaction; return the kind, None without any.

    Args:
        store: of the writer.
        full_s: record time before the newest block of which all records stay, s.
        blocks: most blocks to condense.
        utc: time to note.
        published: whether the files have all blocks that they are said to have; else no record gives way.
    """
    with store.transaction() as connection:
        for kind in KINDS[:-1]:
            if _step(connection, kind, full_s, blocks, published=published):
                _note_given_up(connection, kind, utc)
                return kind
    return None


def _step(connection: sqlite3.Connection, kind: str, full_s: float, blocks: int, *, published: bool) -> int:
    if kind in ("waveforms", "raw_spectra"):
        return strip_views(connection, whole=kind == "raw_spectra")
    if kind == "records":
        return condense_within(connection, full_s, blocks, by_number=True) if published else 0
    if kind == "spectra":
        return thin_within(connection, full_s)
    level = LEVELS_S[0] if kind == "trends_minute" else LEVELS_S[1]
    newest = newest_times(connection)
    axes = ((time, dated) for time, dated in zip(newest, (True, False), strict=True) if time is not None)
    return sum(drop_buckets(connection, level, time - full_s, dated=dated) for time, dated in axes)


def least_bytes(store: Readable | None, channels: int, full_s: float) -> int:
    """Return a lower bound of what cannot be given up, bytes; of an empty store where there is none.

    Args:
        store: open for reading.
        channels: of the machine.
        full_s: record time before the newest block of which everything stays, s.
    """
    least = _BASE_BYTES + channels * _CHANNEL_BYTES
    if store is None:
        return least
    with store.connection() as connection:
        for table, size in _STAYING.items():
            least += size * connection.execute(f"SELECT count(*) FROM {table}").fetchone()[0]
        # Blocks are condensed in the order of the ledger.
        newest = max((time for time in newest_times(connection) if time is not None), default=0.0)
        query = (
            "SELECT coalesce(sum(length(row)), 0) FROM records JOIN blocks ON id = block WHERE id > ? AND axis_time > ?"
        )
        least += connection.execute(query, (condensed_up_to(connection), newest - full_s)).fetchone()[0]
        # The day before the newest leaves the store during the newest.
        query = "SELECT coalesce(sum(size), 0) FROM (SELECT size FROM published ORDER BY day DESC LIMIT 2)"
        least += connection.execute(query).fetchone()[0]
    return least
