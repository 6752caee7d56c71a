"""Checks every record of a salvaged store, removes those that fail, and counts the results."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from monitor.records.filing import Filing, Stored, content_digest, ledger_digest, states_digest
from monitor.records.packing import pack
from monitor.records.recover.from_published import Restore
from monitor.records.recover.rows import LEDGER, Found

LOST = "its record was lost when the store was damaged"
"""The reason of a ledger entry whose record is gone."""

_BLOCKS = f"""
SELECT blocks.id, {LEDGER}, layout, row, ledger, content FROM blocks
LEFT JOIN records ON records.block = blocks.id LEFT JOIN digests ON digests.block = blocks.id
WHERE blocks.id > ? ORDER BY blocks.id LIMIT 500
"""
_PARTS = ("forecasts", "events", "records", "digests")


@dataclass
class Account:
    """Counts of a salvage; see :class:`monitor.records.recover.salvage.SalvageReport`.

    ``emptied`` has source and number of blocks; ``missing`` has source, first and last number.
    """

    saved: int = 0
    unchecked: int = 0
    restored: int = 0
    emptied: list[tuple[str, int]] = field(default_factory=list)
    missing: list[tuple[str, int, int]] = field(default_factory=list)
    unplaced: int = 0
    relearning: list[str] = field(default_factory=list)


def settle(fresh: sqlite3.Connection, found: Found, restore: Restore | None = None) -> Account:
    """Check every copied record, and keep those that are as committed.

    A block with an intact ledger entry but a damaged record stays in the ledger as ``unreadable``. A state stays where
    it is the state after the last block of its source.

    Args:
        fresh: the new store, in autocommit and without foreign keys.
        found: result of :func:`monitor.records.recover.rows.carry_over`.
        restore: searches lost records in the published files.
    """
    account = Account()
    known = _highest(fresh)
    checker = _Checker(fresh, found)
    emptied: dict[int, tuple[Any, ...]] = {}
    fresh.execute("BEGIN")
    last = 0
    while rows := fresh.execute(_BLOCKS, (last,)).fetchall():
        last = rows[-1][0]
        for row in rows:
            verdict = checker.verdict(row)
            if verdict in ("saved", "unchecked"):
                account.saved += 1
                account.unchecked += verdict == "unchecked"
            elif verdict == "emptied":
                emptied[row[0]] = row
            else:
                fresh.execute("DELETE FROM blocks WHERE id = ?", (row[0],))
    if restore is not None:
        _restore(fresh, found, restore, checker, account, emptied)
    checker.write_layouts()
    for row in emptied.values():
        account.emptied.append((row[1], row[2]))
        _empty(fresh, row)
    for table in _PARTS:
        fresh.execute(f"DELETE FROM {table} WHERE block NOT IN (SELECT id FROM blocks)")
    fresh.execute(
        "DELETE FROM spectra WHERE NOT EXISTS"
        " (SELECT 1 FROM blocks WHERE blocks.source = spectra.source AND blocks.sequence = spectra.sequence)"
    )
    fresh.execute("UPDATE blocks SET run = 0 WHERE typeof(run) <> 'integer'")
    fresh.execute("INSERT OR IGNORE INTO runs SELECT DISTINCT run, '{}' FROM blocks")
    account.relearning = _settle_states(fresh, found.states)
    _find_missing(fresh, account, known)
    _never_again(fresh, known)
    fresh.execute("COMMIT")
    return account


def _restore(
    fresh: sqlite3.Connection,
    found: Found,
    restore: Restore,
    checker: _Checker,
    account: Account,
    emptied: dict[int, tuple[Any, ...]],
) -> None:
    """Restore ledger entries from the published files, and records, where digests prove them."""
    lost = {
        row[1]: row[0]
        for row in fresh.execute("SELECT block, ledger FROM digests WHERE block NOT IN (SELECT id FROM blocks)")
    }
    lost |= {row[15]: block for block, row in emptied.items() if row[15] is not None}
    layouts = [(number, text) for number, texts in found.layouts.items() for text in texts]
    for piece in restore(list(lost), layouts):
        block = lost[piece.ledger]
        if block not in emptied:
            values = (block, *piece.entry)
            run = "coalesce((SELECT run FROM blocks WHERE id < ? ORDER BY id DESC LIMIT 1), 0)"
            marks = ", ".join("?" for _ in values)
            statement = f"INSERT OR IGNORE INTO blocks (id, {LEDGER}, run) VALUES ({marks}, {run})"
            if not fresh.execute(statement, (*values, block)).rowcount:
                continue
            emptied[block] = values
        if not _bodies(fresh, "events", block):
            rows = [(block, text) for text in piece.events]
            fresh.executemany("INSERT INTO events (block, body) VALUES (?, ?)", rows)
        for layout, row in piece.rows:
            fresh.execute("INSERT OR REPLACE INTO records VALUES (?, ?, ?)", (block, layout, row))
            if checker.verdict(fresh.execute(_BLOCKS, (block - 1,)).fetchone()) == "saved":
                account.saved += 1
                account.restored += 1
                del emptied[block]
                break


def first_change(store: sqlite3.Connection, most: int) -> str | None:
    """Return which of the newest ``most`` blocks, or of the states after them, is not as committed, or None."""
    layouts = {number: [text] for number, text in store.execute("SELECT id, layout FROM layouts")}
    checker = _Checker(store, Found(layouts=layouts))
    (highest,) = store.execute("SELECT coalesce(max(id), 0) FROM blocks").fetchone()
    last = highest - most
    while rows := store.execute(_BLOCKS, (last,)).fetchall():
        last = rows[-1][0]
        for row in rows:
            if checker.verdict(row) in ("gone", "emptied"):
                return f"block {row[2]} of {row[1]} is not as it was committed"
    by_block: dict[int, dict[str, str]] = {}
    for name, block, text in store.execute("SELECT name, block, state FROM stage_states"):
        by_block.setdefault(block, {})[name] = text
    for block, texts in by_block.items():
        digest = store.execute("SELECT states FROM digests WHERE block = ?", (block,)).fetchone()
        if digest is not None and digest[0] is not None and digest[0] != states_digest(texts):
            return f"the state of {min(texts)} is not as it was committed"
    return None


class _Checker:
    """Compares blocks with their digests, and finds the layout that fits."""

    def __init__(self, fresh: sqlite3.Connection, found: Found) -> None:
        self._fresh = fresh
        self._candidates = found.layouts
        self._proven: dict[int, str] = {}
        self._plausible: dict[int, str] = {}

    def verdict(self, row: tuple[Any, ...]) -> str:
        """Return "saved", "unchecked", "emptied" or "gone" of a row of the query for blocks."""
        block, entry, (layout, values, ledger, content) = row[0], row[1:13], row[13:]
        if ledger is not None and ledger != ledger_digest(entry):
            return "gone"
        bodies = [_bodies(self._fresh, table, block) for table in ("forecasts", "events")]
        if values is None:
            texts, values = (), b""
        else:
            texts = self._texts(layout)
        if content is not None:
            text = next((text for text in texts if content_digest(text, values, *bodies) == content), None)
            if text is None:
                return "emptied"
            self._proven[layout] = text
            return "saved"
        text = next((text for text in texts if _makes_a_record(entry, text, values, bodies)), None)
        if text is None:
            return "emptied" if _makes_a_record(entry, *pack({}), [[], []]) else "gone"
        self._plausible[layout] = text
        return "unchecked"

    def _texts(self, layout: int) -> Sequence[str]:
        return [self._proven[layout]] if layout in self._proven else self._candidates.get(layout, ())

    def write_layouts(self) -> None:
        """Insert the layouts that are used."""
        rows = (self._plausible | self._proven).items()
        self._fresh.executemany("INSERT OR IGNORE INTO layouts VALUES (?, ?)", rows)


def _bodies(fresh: sqlite3.Connection, table: str, block: int) -> list[str]:
    return [row[0] for row in fresh.execute(f"SELECT body FROM {table} WHERE block = ? ORDER BY id", (block,))]


def _makes_a_record(entry: tuple[Any, ...], layout: str, values: bytes, bodies: list[list[str]]) -> bool:
    """Return whether parts without a digest form a valid record."""
    source, sequence, content_hash, name, status, flags, reason, time, elapsed, *filing = entry
    forecasts, events = (f"[{','.join(texts)}]" for texts in bodies)
    identity = (source, sequence, name, content_hash, status, flags, reason, time, elapsed)
    try:
        Stored(Filing(*filing), layout, values, *identity, forecasts, events).to_record()
    except (TypeError, ValueError, LookupError, AttributeError):
        return False
    return True


def _empty(fresh: sqlite3.Connection, row: tuple[Any, ...]) -> None:
    """Keep only the ledger entry of a block."""
    block, entry = row[0], list(row[1:13])
    entry[4:7] = "unreadable", "", LOST
    layout, values = pack({})
    fresh.execute("INSERT OR IGNORE INTO layouts (layout) VALUES (?)", (layout,))
    fresh.execute("UPDATE blocks SET status = ?, flags = ?, reason = ? WHERE id = ?", (*entry[4:7], block))
    fresh.execute(
        "INSERT OR REPLACE INTO records SELECT ?, id, ? FROM layouts WHERE layout = ?", (block, values, layout)
    )
    for table in ("forecasts", "events"):
        fresh.execute(f"DELETE FROM {table} WHERE block = ?", (block,))
    fresh.execute(
        "INSERT INTO digests (block, ledger, content) VALUES (?, ?, ?)"
        " ON CONFLICT (block) DO UPDATE SET ledger = excluded.ledger, content = excluded.content",
        (block, ledger_digest(entry), content_digest(layout, values, (), ())),
    )


def _settle_states(fresh: sqlite3.Connection, states: Mapping[str, list[tuple[int, str]]]) -> list[str]:
    """Write the states after the last block of their source; return the names of the others."""
    newest = {row[0] for row in fresh.execute("SELECT max(id) FROM blocks GROUP BY source")}
    by_block: dict[int, dict[str, str]] = {}
    for name, found in states.items():
        block, text = found[0]
        if block in newest and _is_object(text):
            by_block.setdefault(block, {})[name] = text
    kept: set[str] = set()
    for block, texts in by_block.items():
        digest = fresh.execute("SELECT states FROM digests WHERE block = ?", (block,)).fetchone()
        if digest is None or digest[0] is None or digest[0] == states_digest(texts):
            kept.update(texts)
            fresh.executemany(
                "INSERT OR REPLACE INTO stage_states VALUES (?, ?, ?)",
                [(name, block, text) for name, text in texts.items()],
            )
    return sorted(set(states) - kept)


def _is_object(text: str) -> bool:
    try:
        return isinstance(json.loads(text), dict)
    except (TypeError, ValueError):
        return False


def _highest(fresh: sqlite3.Connection) -> int:
    """Return the highest block number in at least two tables: a single one may be damaged."""
    union = "SELECT id FROM blocks UNION ALL SELECT block FROM records UNION ALL SELECT block FROM digests"
    query = f"SELECT coalesce(max(id), 0) FROM (SELECT id FROM ({union}) GROUP BY id HAVING count(*) > 1)"
    return fresh.execute(query).fetchone()[0]


def _find_missing(fresh: sqlite3.Connection, account: Account, known: int) -> None:
    """Attribute the missing ledger numbers to sources.

    A gap in the numbers of a source counts as missing where the ledger has a gap of that size at this place: senders
    leave gaps, too.
    """
    gone = known - _between(fresh, 0, known + 1)
    before: dict[str, tuple[int, int]] = {}
    rows = fresh.execute("SELECT source, sequence, id FROM blocks ORDER BY source, sequence").fetchall()
    for source, sequence, block in rows:
        last, place = before.get(source, (0, 0))
        gap = sequence - last - 1
        if 0 < gap <= gone and gap <= block - place - 1 - _between(fresh, place, block):
            account.missing.append((source, last + 1, sequence - 1))
            gone -= gap
        before[source] = (sequence, block)
    if len(before) == 1 and gone > 0:
        ((source, (last, _)),) = before.items()
        account.missing.append((source, last + 1, last + gone))
        gone = 0
    account.unplaced = gone


def _between(fresh: sqlite3.Connection, lower: int, upper: int) -> int:
    return fresh.execute("SELECT count(*) FROM blocks WHERE id > ? AND id < ?", (lower, upper)).fetchone()[0]


def _never_again(fresh: sqlite3.Connection, known: int) -> None:
    """Reserve the ledger numbers of lost blocks."""
    (highest,) = fresh.execute("SELECT max(coalesce(max(id), 0), ?) FROM blocks", (known,)).fetchone()
    fresh.execute("DELETE FROM sqlite_sequence WHERE name = 'blocks'")
    fresh.execute("INSERT INTO sqlite_sequence VALUES ('blocks', ?)", (highest,))
