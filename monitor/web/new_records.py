"""The records of a channel that came since a moment, as the trends show them."""

from __future__ import annotations

from typing import Any

import numpy as np

from monitor.health.quality import FLAGS, REJECTIONS
from monitor.health.schema import STATUSES
from monitor.records.trend_levels import FEATURES
from monitor.records.trend_reading import Layouts, Ledgered, points_between
from monitor.records.trends import TrendTable
from monitor.web.api import columns, is_dated
from monitor.web.machines import Machine

_MOST = 5000
_QUERY = """
SELECT id, source, sequence, status, flags, day IS NOT NULL, axis_time, layout
FROM blocks JOIN records ON records.block = blocks.id
WHERE id > ? AND id <= ? AND +source = ? ORDER BY id DESC LIMIT ?
"""


def newest_id(machine: Machine) -> int:
    """Return the number of the newest block in the ledger, 0 where there is none, or no store yet."""
    if machine.store.identity() is None:
        return 0
    return machine.store.rows("SELECT coalesce(max(id), 0) FROM blocks")[0][0]


def records_after(machine: Machine, channel: str, after: int, until: int) -> dict[str, Any]:
    """Return the records of a channel after one ledger number up to another, every one a point.

    Args:
        machine: the machine.
        channel: one of its channels.
        after: ledger number of the last one that is known.
        until: ledger number of the last one that is wanted.
    """
    section = machine.channel(channel)
    dated = is_dated(machine, section.source)
    with machine.store.connection() as connection:
        rows = connection.execute(_QUERY, (after, until, section.source, _MOST)).fetchall()
        entries = [Ledgered(*row) for row in reversed(rows) if bool(row[5]) == dated]
        points, blocks = points_between(connection, Layouts(), entries, channel)
    values = {name: points.values[:, place] for place, name in enumerate(FEATURES)}
    counts = {status: (points.status == STATUSES.index(status)).astype(np.int64) for status in (*FLAGS, *REJECTIONS)}
    ones = np.ones(points.time.size, dtype=np.int64)
    table = TrendTable(dated, None, points.time, values, values, ones, counts, blocks)
    return {
        "machine": machine.name,
        "channel": channel,
        "dated": dated,
        "resolution_s": None,
        "columns": columns(table, absolute=section.unit != "unknown"),
    }
