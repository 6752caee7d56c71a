"""The published snapshot ``MACHINE-state.json``: what goes on from block to block, beside the published records.

It is written after the files of records and holds no block that they lack: the states of the stages, each with its
block, the newest rows of the small tables, and the sizes of the files. With the records it makes a lost store again.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

from monitor.records.database import replacing
from monitor.records.ledger import DATING
from monitor.records.store import Store

FORMAT = 1
_MAX_ROWS = 1000
_TABLES = {"notices": "id", "acknowledgements": "id", "refusals": "rowid", "told": "way", "stream_resets": "resets"}
"""Tables of the store of which the newest rows are published, and their order."""
# A single statement sees a single moment.
_STATES = """
SELECT (SELECT max(id) FROM blocks), stage_states.name, source, sequence, content_hash, state
FROM (SELECT 1) LEFT JOIN stage_states LEFT JOIN blocks ON blocks.id = block ORDER BY stage_states.name
"""


class StatedBlock(NamedTuple):
    """The state of a stage and the identity of the block after which it holds."""

    source: str
    sequence: int
    content_hash: str
    state: str


@dataclass(frozen=True)
class Snapshot:
    """What a store holds beside its records.

    Attributes:
        last_block: ledger number of the last block, 0 without one.
        states: by name of the stage.
        tables: rows by table, each a mapping by column.
        files: size in bytes of each file of records, by name.
    """

    machine: str
    last_block: int = 0
    states: Mapping[str, StatedBlock] = field(default_factory=dict[str, StatedBlock])
    tables: Mapping[str, list[dict[str, Any]]] = field(default_factory=dict[str, list[dict[str, Any]]])
    files: Mapping[str, int] = field(default_factory=dict[str, int])


def snapshot_path(records_dir: Path, machine: str) -> Path:
    """Return the path of the snapshot of a machine."""
    return records_dir / f"{machine}-state.json"


def take_snapshot(store: Store) -> Snapshot:
    """Return what a store holds now, without files; StoreError where it cannot be read."""
    rows = store.rows(_STATES)
    states = {row[1]: StatedBlock(*row[2:]) for row in rows if row[2] is not None}
    tables = {table: _newest(store, table) for table in _TABLES}
    dating = store.rows("SELECT key, value FROM meta WHERE key GLOB ?", f"{DATING}*")
    tables["meta"] = [{"key": key, "value": value} for key, value in dating]
    return Snapshot(store.machine, rows[0][0] or 0, states, tables)


def _newest(store: Store, table: str) -> list[dict[str, Any]]:
    """Return the newest rows of a table, oldest first; none where the store lacks it."""
    columns = [row[1] for row in store.rows(f"PRAGMA table_info({table})")]
    if not columns:
        return []
    rows = store.rows(f"SELECT {', '.join(columns)} FROM {table} ORDER BY {_TABLES[table]} DESC LIMIT {_MAX_ROWS}")
    return [dict(zip(columns, row, strict=True)) for row in reversed(rows)]


def write_snapshot(snapshot: Snapshot, records_dir: Path) -> None:
    """Replace the published snapshot durably; OSError where it cannot be written."""
    path = snapshot_path(records_dir, snapshot.machine)
    body = {"format": FORMAT, **{name: getattr(snapshot, name) for name in Snapshot.__dataclass_fields__}}
    with replacing(path) as temporary:
        temporary.write_text(json.dumps({**body, "digest": _digest(body)}), encoding="utf-8")


def read_snapshot(records_dir: Path, machine: str) -> Snapshot | None:
    """Return the published snapshot of a machine; None where there is none, or it is not as it was written."""
    try:
        body = json.loads(snapshot_path(records_dir, machine).read_text(encoding="utf-8"))
        digest = body.pop("digest")
        if body["format"] != FORMAT or body["machine"] != machine or digest != _digest(body):
            return None
        states = {name: StatedBlock(*values) for name, values in body["states"].items()}
        return Snapshot(machine, body["last_block"], states, body["tables"], body["files"])
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None


def is_published(snapshot: Snapshot, records_dir: Path) -> bool:
    """Return whether the published snapshot has the same states and tables."""
    present = read_snapshot(records_dir, snapshot.machine)
    return present is not None and replace(present, files=snapshot.files) == snapshot


def _digest(body: Mapping[str, Any]) -> str:
    return hashlib.blake2b(json.dumps(body, sort_keys=True).encode(), digest_size=16).hexdigest()
