"""Checks every record of a recovered store, fills its gaps from the published records, and counts the results."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

from monitor.records.condense import identity_of
from monitor.records.filing import Filing, Stored, content_digest, ledger_digest, states_digest
from monitor.records.packing import pack
from monitor.records.published_folder import Snapshot
from monitor.records.recover.published import LEDGER, insert_row
from monitor.records.recover.rows import States, add_layout

LOST = "its record was lost when the store was damaged"
"""The reason of a ledger entry whose record is gone."""

_BLOCKS = f"""
SELECT blocks.id, {LEDGER}, layout, row, ledger, content FROM blocks
LEFT JOIN records ON records.block = blocks.id LEFT JOIN digests ON digests.block = blocks.id
WHERE blocks.id > ? ORDER BY blocks.id LIMIT 500
"""
_PARTS = ("forecasts", "events", "records", "digests")
_REPLACED = " ON CONFLICT (block) DO UPDATE SET ledger = excluded.ledger, content = excluded.content"
# A single table may hold a damaged number.
_HIGHEST = """
SELECT coalesce(max(id), 0) FROM (SELECT id FROM (SELECT id FROM blocks UNION ALL SELECT block FROM records
UNION ALL SELECT block FROM digests) GROUP BY id HAVING count(*) > 1)
"""
_OFFERED = """
SELECT theirs.id, theirs.source, theirs.sequence, theirs.content_hash, ours.id, ours.content_hash
FROM published.blocks AS theirs LEFT JOIN blocks AS ours USING (source, sequence) ORDER BY theirs.id
"""
_CONDENSED = """
SELECT count(*) FROM identities JOIN condensed_sources ON id = identities.source
WHERE condensed_sources.source = ? AND sequence > ? AND sequence < ?
"""


@dataclass(frozen=True)
class BlockRange:
    """Consecutive blocks of a source: numbers of the first and the last."""

    source: str
    first: int
    last: int

    def __str__(self) -> str:
        """Return the blocks in words."""
        return f"{self.source} {self.first}" + (f" to {self.last}" if self.last > self.first else "")


def ranges_of(blocks: Iterable[tuple[str, int]]) -> tuple[BlockRange, ...]:
    """Join consecutive numbers."""
    parts: list[BlockRange] = []
    for source, numbers in groupby(sorted(blocks), key=lambda item: item[0]):
        for _, run in groupby(enumerate(number for _, number in numbers), key=lambda item: item[1] - item[0]):
            members = [number for _, number in run]
            parts.append(BlockRange(source, members[0], members[-1]))
    return tuple(parts)


@dataclass
class Account:
    """Counts of a recovery.

    Attributes:
        saved: number of records that are as they were committed.
        unchecked: those of them without a digest: of an older version, or the digest is lost.
        restored: those of them from the published files.
        emptied: blocks whose record is lost; the ledger entry is kept as ``unreadable``.
        missing: blocks without a ledger entry.
        unplaced: number of further lost blocks, of unknown sources.
    """

    saved: int = 0
    unchecked: int = 0
    restored: int = 0
    emptied: tuple[BlockRange, ...] = ()
    missing: tuple[BlockRange, ...] = ()
    unplaced: int = 0


def settle(fresh: sqlite3.Connection, states: States, snapshot: Snapshot | None) -> Account:
    """Keep what is as it was committed, and fill the gaps.

    A block with an intact ledger entry but no record stays in the ledger as ``unreadable``. Of each source, the newest
    states are kept that a block which is there came with.

    Args:
        fresh: the new store, in autocommit and without foreign keys; the published records are attached as
            ``published``, empty where there are none.
        states: of the damaged store.
        snapshot: the published one.
    """
    account = Account()
    known = max(fresh.execute(_HIGHEST).fetchone()[0], 0 if snapshot is None else snapshot.last_block)
    groups = _grouped(states)
    proven = {block: texts for block, texts in groups.items() if _is_as_committed(fresh, block, texts)}
    fresh.execute("BEGIN")
    emptied = _check(fresh, account)
    _fill_gaps(fresh, account, emptied)
    account.emptied = ranges_of((row[1], row[2]) for row in emptied.values())
    for row in emptied.values():
        _empty(fresh, row)
    fresh.execute(
        "DELETE FROM spectra WHERE NOT EXISTS"
        " (SELECT 1 FROM blocks WHERE blocks.source = spectra.source AND blocks.sequence = spectra.sequence)"
        " AND NOT EXISTS (SELECT 1 FROM identities JOIN condensed_sources ON id = identities.source"
        " WHERE condensed_sources.source = spectra.source AND identities.sequence = spectra.sequence)"
    )
    fresh.execute("UPDATE blocks SET run = 0 WHERE typeof(run) <> 'integer'")
    fresh.execute("INSERT OR IGNORE INTO runs SELECT DISTINCT run, '{}' FROM blocks")
    if snapshot is not None:
        _add_tables(fresh, snapshot)
    _settle_states(fresh, proven, snapshot)
    _find_missing(fresh, account, known)
    (highest,) = fresh.execute("SELECT max(coalesce(max(id), 0), ?) FROM blocks", (known,)).fetchone()
    # The numbers of lost blocks are not given again.
    fresh.execute("DELETE FROM sqlite_sequence WHERE name = 'blocks'")
    fresh.execute("INSERT INTO sqlite_sequence VALUES ('blocks', ?)", (highest,))
    fresh.execute("COMMIT")
    return account


def first_change(store: sqlite3.Connection, most: int) -> str | None:
    """Return which of the newest ``most`` blocks, or of the states after them, is not as committed, or None."""
    (highest,) = store.execute("SELECT coalesce(max(id), 0) FROM blocks").fetchone()
    last = highest - most
    while rows := store.execute(_BLOCKS, (last,)).fetchall():
        last = rows[-1][0]
        for row in rows:
            if _verdict(store, row)[0] in ("gone", "emptied"):
                return f"block {row[2]} of {row[1]} is not as it was committed"
    groups = _grouped(store.execute("SELECT name, block, state FROM stage_states"))
    changed = (min(texts) for block, texts in groups.items() if not _is_as_committed(store, block, texts))
    name = next(changed, None)
    return None if name is None else f"the state of {name} is not as it was committed"


def _check(fresh: sqlite3.Connection, account: Account) -> dict[int, tuple[Any, ...]]:
    """Delete what is not as it was committed; return the blocks of which only the ledger entry is left."""
    emptied: dict[int, tuple[Any, ...]] = {}
    last = 0
    while rows := fresh.execute(_BLOCKS, (last,)).fetchall():
        last = rows[-1][0]
        for row in rows:
            verdict, layout = _verdict(fresh, row)
            if verdict in ("saved", "unchecked"):
                account.saved += 1
                account.unchecked += verdict == "unchecked"
                if layout != row[13]:
                    fresh.execute("UPDATE records SET layout = ? WHERE block = ?", (layout, row[0]))
            elif verdict == "emptied":
                emptied[row[0]] = row
                for table in ("forecasts", "events", "records"):
                    fresh.execute(f"DELETE FROM {table} WHERE block = ?", (row[0],))
            else:
                fresh.execute("DELETE FROM blocks WHERE id = ?", (row[0],))
    for table in _PARTS:
        fresh.execute(f"DELETE FROM {table} WHERE block NOT IN (SELECT id FROM blocks)")
    return emptied


def _verdict(store: sqlite3.Connection, row: tuple[Any, ...]) -> tuple[str, int | None]:
    """Return "saved", "unchecked", "emptied" or "gone" of a row of the query for blocks, and its layout."""
    block, entry, (layout, values, ledger, content) = row[0], row[1:13], row[13:]
    if ledger is not None and ledger != ledger_digest(entry):
        return "gone", None
    bodies = [_bodies(store, table, block) for table in ("forecasts", "events")]
    if values is not None:
        for number, text in store.execute("SELECT id, layout FROM layouts ORDER BY id <> ?", (layout,)):
            if content is None and _makes_a_record(entry, text, values, bodies):
                return "unchecked", number
            if content is not None and content_digest(text, values, *bodies) == content:
                return "saved", number
    if content is None and not _makes_a_record(entry, *pack({}), [[], []]):
        return "gone", None
    return "emptied", None


def _bodies(store: sqlite3.Connection, table: str, block: int) -> list[str]:
    return [row[0] for row in store.execute(f"SELECT body FROM {table} WHERE block = ? ORDER BY id", (block,))]


def _makes_a_record(entry: tuple[Any, ...], layout: str, values: bytes, bodies: Sequence[list[str]]) -> bool:
    """Return whether parts without a digest form a valid record."""
    source, sequence, content_hash, name, status, flags, reason, time, elapsed, *filing = entry
    forecasts, events = (f"[{','.join(texts)}]" for texts in bodies)
    identity = (source, sequence, name, content_hash, status, flags, reason, time, elapsed)
    try:
        Stored(Filing(*filing), layout, values, *identity, forecasts, events).to_record()
    except (TypeError, ValueError, LookupError, AttributeError):
        return False
    return True


def _fill_gaps(fresh: sqlite3.Connection, account: Account, emptied: dict[int, tuple[Any, ...]]) -> None:
    """Take from the published records the blocks that the new store lacks, under their numbers where these are free."""
    layouts = {
        number: add_layout(fresh, None, text) for number, text in fresh.execute("SELECT * FROM published.layouts")
    }
    runs: dict[int, int] = {}
    for number, text in fresh.execute("SELECT id, attributes FROM published.runs").fetchall():
        known = fresh.execute("SELECT id FROM runs WHERE attributes = ?", (text,)).fetchone()
        runs[number] = (
            known[0] if known else fresh.execute("INSERT INTO runs (attributes) VALUES (?)", (text,)).lastrowid or 0
        )
    forecasts = ", ".join(row[1] for row in fresh.execute("PRAGMA table_info(forecasts)").fetchall()[2:])
    for number, source, sequence, content_hash, ours, our_hash in fresh.execute(_OFFERED).fetchall():
        if ours is None and identity_of(fresh, source, sequence) is not None:
            # Its full record left the store on purpose.
            continue
        if ours is None:
            taken = fresh.execute("SELECT 1 FROM blocks WHERE id = ?", (number,)).fetchone()
            statement = (
                f"INSERT INTO blocks (id, {LEDGER}, run) SELECT ?, {LEDGER}, run FROM published.blocks WHERE id = ?"
            )
            block = fresh.execute(statement, (None if taken else number, number)).lastrowid or 0
            (run,) = fresh.execute("SELECT run FROM blocks WHERE id = ?", (block,)).fetchone()
            fresh.execute("UPDATE blocks SET run = ? WHERE id = ?", (runs.get(run, 0), block))
        elif ours in emptied and our_hash == content_hash:
            block = ours
            del emptied[ours]
        else:
            continue
        layout, row = fresh.execute("SELECT layout, row FROM published.records WHERE block = ?", (number,)).fetchone()
        fresh.execute("INSERT INTO records VALUES (?, ?, ?)", (block, layouts[layout], row))
        statement = f"INSERT INTO forecasts (block, {forecasts}) SELECT ?, {forecasts} FROM published.forecasts"
        fresh.execute(f"{statement} WHERE block = ? ORDER BY id", (block, number))
        for event, body in fresh.execute("SELECT id, body FROM published.events WHERE block = ?", (number,)).fetchall():
            free = fresh.execute("SELECT 1 FROM events WHERE id = ?", (event,)).fetchone() is None
            fresh.execute("INSERT INTO events VALUES (?, ?, ?)", (event if free else None, block, body))
        statement = "INSERT INTO digests (block, ledger, content) SELECT ?, ledger, content FROM published.digests"
        proven = fresh.execute(f"{statement} WHERE block = ?{_REPLACED}", (block, number)).rowcount
        account.saved += 1
        account.restored += 1
        account.unchecked += not proven
    _take_files(fresh)


def _take_files(fresh: sqlite3.Connection) -> None:
    """Take what is newer of the progress of files, of those whose latest block is there."""
    columns = [row[1] for row in fresh.execute("PRAGMA table_info(files)")]
    query = f"SELECT {', '.join(columns)} FROM published.files WHERE block IN (SELECT id FROM published.blocks)"
    for row in fresh.execute(query).fetchall():
        values = dict(zip(columns, row, strict=True))
        known = fresh.execute(
            "SELECT block FROM files WHERE source = ? AND path = ?", (values["source"], values["path"])
        ).fetchone()
        if known is None or (known[0] or 0) < values["block"]:
            insert_row(fresh, "files", values, set(columns))


def _empty(fresh: sqlite3.Connection, row: tuple[Any, ...]) -> None:
    """Keep only the ledger entry of a block."""
    block, entry = row[0], list(row[1:13])
    entry[4:7] = "unreadable", "", LOST
    layout, values = pack({})
    fresh.execute("UPDATE blocks SET status = ?, flags = ?, reason = ? WHERE id = ?", (*entry[4:7], block))
    fresh.execute("INSERT INTO records VALUES (?, ?, ?)", (block, add_layout(fresh, None, layout), values))
    digests = (block, ledger_digest(entry), content_digest(layout, values, (), ()))
    fresh.execute(f"INSERT INTO digests (block, ledger, content) VALUES (?, ?, ?){_REPLACED}", digests)


def _add_tables(fresh: sqlite3.Connection, snapshot: Snapshot) -> None:
    """Insert the published rows of the small tables that the new store lacks."""
    for table, rows in snapshot.tables.items():
        columns = {row[1] for row in fresh.execute(f"PRAGMA table_info({table})")}
        for values in rows if columns else ():
            insert_row(fresh, table, values, columns, "OR IGNORE")


def _settle_states(fresh: sqlite3.Connection, proven: dict[int, dict[str, str]], snapshot: Snapshot | None) -> None:
    """Write of each source the newest states, by block and name, whose block is there."""
    if snapshot is not None:
        identity = "SELECT id FROM blocks WHERE source = ? AND sequence = ? AND content_hash = ?"
        found = [
            (name, fresh.execute(identity, stated[:3]).fetchone(), stated) for name, stated in snapshot.states.items()
        ]
        published = _grouped((name, row[0], stated.state) for name, row, stated in found if row is not None)
        proven = published | proven
    newest: dict[str, int] = {}
    for block in sorted(proven):
        row = fresh.execute("SELECT source FROM blocks WHERE id = ?", (block,)).fetchone()
        if row is not None:
            newest[row[0]] = block
    for block in newest.values():
        rows = [(name, block, text) for name, text in proven[block].items()]
        fresh.executemany("INSERT OR REPLACE INTO stage_states VALUES (?, ?, ?)", rows)
        fresh.execute("UPDATE digests SET states = ? WHERE block = ?", (states_digest(proven[block]), block))


def _grouped(states: Iterable[tuple[str, int, str]]) -> dict[int, dict[str, str]]:
    """Return the states by block and name."""
    groups: dict[int, dict[str, str]] = {}
    for name, block, text in states:
        groups.setdefault(block, {})[name] = text
    return groups


def _is_as_committed(store: sqlite3.Connection, block: int, texts: Mapping[str, str]) -> bool:
    """Return whether the states after a block have the digest that was committed with them, or none was."""
    found = store.execute("SELECT states FROM digests WHERE block = ?", (block,)).fetchone()
    if found is not None and found[0] is not None:
        return found[0] == states_digest(texts)
    try:
        return all(isinstance(json.loads(text), dict) for text in texts.values())
    except (TypeError, ValueError):
        return False


def _find_missing(fresh: sqlite3.Connection, account: Account, known: int) -> None:
    """Attribute the missing ledger numbers to sources.

    A gap in the numbers of a source counts as missing where the ledger has a gap of that size at this place: senders
    leave gaps, too.
    """
    (condensed,) = fresh.execute("SELECT coalesce(sum(blocks), 0) FROM condensed_days").fetchone()
    gone = known - _between(fresh, 0, known + 1) - condensed
    before: dict[str, tuple[int, int]] = {}
    rows = fresh.execute("SELECT source, sequence, id FROM blocks ORDER BY source, sequence").fetchall()
    for source, sequence, block in rows:
        last, place = before.get(source, (0, 0))
        gap = sequence - last - 1 - fresh.execute(_CONDENSED, (source, last, sequence)).fetchone()[0]
        if 0 < gap <= gone and gap <= block - place - 1 - _between(fresh, place, block):
            account.missing += (BlockRange(source, last + 1, sequence - 1),)
            gone -= gap
        before[source] = (sequence, block)
    if len(before) == 1 and gone > 0:
        ((source, (last, _)),) = before.items()
        account.missing += (BlockRange(source, last + 1, last + gone),)
        gone = 0
    account.unplaced = max(gone, 0)


def _between(fresh: sqlite3.Connection, lower: int, upper: int) -> int:
    return fresh.execute("SELECT count(*) FROM blocks WHERE id > ? AND id < ?", (lower, upper)).fetchone()[0]
