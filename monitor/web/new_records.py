"""The records of a channel that were committed after a ledger number, one point each."""

from __future__ import annotations

from typing import Any

from monitor.records.points import ENTRY_QUERY, BlockEntry, read_points
from monitor.records.trends import TrendTable
from monitor.web.api import columns, is_dated
from monitor.web.machines import Machine

_MAX_RECORDS = 5000


def newest_id(machine: Machine) -> int:
    """Return the number of the newest block in the ledger, 0 where there is no block or no store."""
    if machine.store.identity() is None:
        return 0
    return machine.store.rows("SELECT coalesce(max(id), 0) FROM blocks")[0][0]


def records_after(machine: Machine, channel: str, after: int, until: int) -> dict[str, Any]:
    """Return the newest records of a channel with ledger numbers above ``after``, up to ``until``."""
    section = machine.channel(channel)
    dated = is_dated(machine, section.source)
    query = f"{ENTRY_QUERY} WHERE id > ? AND id <= ? AND +source = ? ORDER BY id DESC LIMIT ?"
    with machine.store.connection() as connection:
        rows = connection.execute(query, (after, until, section.source, _MAX_RECORDS)).fetchall()
        entries = [entry for row in reversed(rows) if (entry := BlockEntry(*row)).dated == dated]
        entries.sort(key=lambda entry: (entry.time, entry.id))
        table = TrendTable.of_points(read_points(connection, entries, channel), dated=dated)
    return {
        "machine": machine.name,
        "channel": channel,
        "dated": dated,
        "resolution_s": None,
        "columns": columns(table, absolute=section.unit != "unknown"),
    }
