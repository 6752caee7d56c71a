"""Digests of committed blocks, which detect silent damage to the database.

SQLite detects malformed pages, not changed values. The table has one row a block, written in its transaction: digests
of its ledger entry, of its record with forecasts and events, and of the states after it.
"""

from __future__ import annotations

import hashlib
import json
import sqlite3
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

DIGESTS_TABLE = """
CREATE TABLE IF NOT EXISTS digests (block INTEGER PRIMARY KEY, ledger BLOB NOT NULL, content BLOB NOT NULL, states BLOB)
"""
"""Made where it is missing when a store is opened for writing; older blocks have no digest."""

_BYTES = 8


def ledger_digest(values: Sequence[Any]) -> bytes:
    """Return the digest of a ledger entry: the columns of ``blocks`` from ``source`` to ``time_status``."""
    # The database keeps -0.0 as 0.0.
    return _digest(repr(value + 0.0 if isinstance(value, float) else value).encode() for value in values)


def content_digest(layout: str, row: bytes, forecasts: Iterable[str], events: Iterable[str]) -> bytes:
    """Return the digest of a packed record with the JSON of its forecasts and events."""
    return _digest(
        [layout.encode(), row, b"forecasts", *map(str.encode, forecasts), b"events", *map(str.encode, events)]
    )


def states_digest(states: Mapping[str, str]) -> bytes:
    """Return the digest of the states after a block: JSON by the name of the stage, in any order."""
    return _digest(text.encode() for name in sorted(states) for text in (name, states[name]))


def note_block(
    connection: sqlite3.Connection,
    block: int,
    ledger: Sequence[Any],
    packed: tuple[str, bytes],
    forecasts: Iterable[Mapping[str, Any]],
    events: Iterable[Mapping[str, Any]],
) -> None:
    """Write the digests of a block within its transaction; arguments as of the two digests."""
    content = content_digest(*packed, map(json.dumps, forecasts), map(json.dumps, events))
    values = (block, ledger_digest(ledger), content)
    connection.execute("INSERT INTO digests (block, ledger, content) VALUES (?, ?, ?)", values)


def note_states(connection: sqlite3.Connection, states: Mapping[str, tuple[int, str]]) -> None:
    """Write the digests of states, each a block number and JSON by name, within their transaction."""
    by_block: dict[int, dict[str, str]] = {}
    for name, (block, text) in states.items():
        by_block.setdefault(block, {})[name] = text
    for block, texts in by_block.items():
        connection.execute("UPDATE digests SET states = ? WHERE block = ?", (states_digest(texts), block))


def _digest(parts: Iterable[bytes]) -> bytes:
    result = hashlib.blake2b(digest_size=_BYTES)
    for part in parts:
        result.update(len(part).to_bytes(8, "little"))
        result.update(part)
    return result.digest()
