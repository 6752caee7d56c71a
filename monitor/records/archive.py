"""The archive of forecasts as issued, which are scored once the end is known.

A forecast is committed with its record and never changed. Its body is that of the record; further columns hold the
time of the commit, the time of the latest data, and the hashes of its inputs.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

COLUMNS = {
    "channel": "TEXT",
    "method": "TEXT",
    "threshold_mm2": "REAL",
    "status": "TEXT",
    "issued_utc": "REAL",
    "data_until": "REAL",
    "tt_s": "REAL",
    "interval_level": "REAL",
    "quantiles": "TEXT",
    "library_hash": "TEXT",
    "map_hash": "TEXT",
    "config_hash": "TEXT",
}
"""Columns of the table ``forecasts`` beside ``id``, ``block`` and ``body``, with their types."""

_HASHES = ("library_hash", "map_hash", "config_hash")
_MEDIAN = 0.5
_CHUNK = 500


@dataclass(frozen=True)
class Archived:
    """One forecast as it was issued, with the block that it came with.

    Attributes:
        dated: whether ``data_until`` is UTC seconds since 1970 rather than seconds from the first block.
        threshold_mm2: V_th, mm3 per mm.
        status: as in ``monitor.health.schema.TT_STATUSES``.
        issued_utc: when it was committed or replayed, UTC seconds since 1970; None in a store of an older version.
        data_until: time of its latest block, s.
        tt_s: time to threshold (the median where there is a distribution), s, or None.
        interval_level: probability of its interval, or None for a single number.
        quantiles: seconds by level, rising; empty without a value.
    """

    source: str
    block: int
    dated: bool
    channel: str | None
    method: str | None
    threshold_mm2: float | None
    status: str | None
    issued_utc: float | None
    data_until: float
    tt_s: float | None
    interval_level: float | None
    quantiles: Mapping[float, float]
    library_hash: str | None
    map_hash: str | None
    config_hash: str | None


def forecast_values(
    body: Mapping[str, Any], run: Mapping[str, Any], data_until: float, issued_utc: float | None
) -> tuple[Any, ...]:
    """Return the values of the ``COLUMNS`` for one forecast; times as in :class:`Archived`.

    Args:
        body: as in :class:`monitor.health.record.Record`; ``quantiles_s`` is an object of seconds by level.
        run: attributes of the run (:meth:`monitor.records.store.Store.describe`), for what the body lacks.
    """
    channel = body.get("channel")
    level = _level(body.get("interval"), of_channel(run.get("interval_level"), channel))
    quantiles = _quantiles(body, level)
    hashes = (body.get(name) or of_channel(run.get(name), channel) for name in _HASHES)
    return (
        *(channel, body.get("method"), body.get("threshold_mm2"), body.get("status")),
        *(issued_utc, data_until, body.get("tt_s"), level if len(quantiles) > 1 else None),
        json.dumps({str(p): quantiles[p] for p in sorted(quantiles)}) if quantiles else None,
        *hashes,
    )


def insert_forecasts(
    connection: sqlite3.Connection,
    block: int,
    bodies: Sequence[Mapping[str, Any]],
    run: Mapping[str, Any],
    *,
    data_until: float,
    issued_utc: float | None,
) -> list[str]:
    """Archive the forecasts of a block within its transaction, as :func:`forecast_values` says; return their JSON."""
    marks = ", ".join("?" for _ in range(2 + len(COLUMNS)))
    texts = [json.dumps(body) for body in bodies]
    connection.executemany(
        f"INSERT INTO forecasts (block, body, {', '.join(COLUMNS)}) VALUES ({marks})",
        [
            (block, text, *forecast_values(body, run, data_until, issued_utc))
            for body, text in zip(bodies, texts, strict=True)
        ],
    )
    return texts


def complete_archive(connection: sqlite3.Connection) -> None:
    """Add the ``COLUMNS`` to a table of forecasts without them, within a transaction; inputs are those of the run."""
    for name, kind in COLUMNS.items():
        connection.execute(f"ALTER TABLE forecasts ADD COLUMN {name} {kind}")
    runs = {row[0]: json.loads(row[1]) for row in connection.execute("SELECT id, attributes FROM runs")}
    changes = ", ".join(f"{name} = ?" for name in COLUMNS)
    last = 0
    while rows := connection.execute(
        "SELECT forecasts.id, body, run, axis_time FROM forecasts JOIN blocks ON blocks.id = block"
        " WHERE forecasts.id > ? ORDER BY forecasts.id LIMIT ?",
        (last, _CHUNK),
    ).fetchall():
        last = rows[-1][0]
        connection.executemany(
            f"UPDATE forecasts SET {changes} WHERE id = ?",
            [(*forecast_values(json.loads(body), runs[run], time, None), key) for key, body, run, time in rows],
        )


_NAMES = ", ".join(field.name for field in fields(Archived) if field.name in COLUMNS)
_STORED_QUERY = f"""
SELECT forecasts.id, source, sequence, day IS NOT NULL, {_NAMES.replace("status", "forecasts.status")}
FROM forecasts JOIN blocks ON blocks.id = block WHERE forecasts.id > ?1
"""
ARCHIVE_QUERY = f"{_STORED_QUERY} ORDER BY forecasts.id LIMIT {_CHUNK}"
"""Forecasts after a number, a chunk at a time, in the order in which they were committed."""
FULL_ARCHIVE_QUERY = f"""
{_STORED_QUERY} UNION ALL
SELECT kept.id, condensed_sources.source, sequence, dated, {_NAMES}
FROM condensed_forecasts AS kept JOIN forecast_inputs ON forecast_inputs.id = inputs
JOIN condensed_sources ON condensed_sources.id = kept.source WHERE kept.id > ?1 ORDER BY 1 LIMIT {_CHUNK}
"""
"""The same with the forecasts of condensed blocks."""


def archived_of(rows: Sequence[Sequence[Any]]) -> Iterator[Archived]:
    """Yield the forecasts in the rows of :data:`ARCHIVE_QUERY`."""
    names = [field.name for field in fields(Archived)]
    for row in rows:
        values = dict(zip(names, row[1:], strict=True))
        found = json.loads(values["quantiles"] or "{}")
        yield Archived(
            **{**values, "dated": bool(values["dated"]), "quantiles": {float(p): found[p] for p in found}},
        )


def of_channel(value: Any, channel: str | None) -> Any:
    """Return the value of one channel where an attribute of the run lists one a channel, or the value itself."""
    if not isinstance(value, str):
        return value
    parts = [part.partition(": ") for part in value.split("; ")]
    if not all(separator for _, separator, _ in parts):
        return value or None
    return next((text for name, _, text in parts if name == channel), None)


def _level(*candidates: Any) -> float | None:
    """Return the first of the candidates that is a probability."""
    for candidate in candidates:
        try:
            level = float(candidate)
        except (TypeError, ValueError):
            continue
        if 0.0 < level < 1.0:
            return level
    return None


def _quantiles(body: Mapping[str, Any], level: float | None) -> dict[float, float]:
    """Return seconds by level: as the body lists them, or from its middle and the ends of its interval."""
    listed = body.get("quantiles_s")
    if isinstance(listed, Mapping):
        return {float(p): float(value) for p, value in listed.items()}
    ends = (body.get("tt_lower_s"), body.get("tt_upper_s"))
    middle = body.get("tt_s")
    found = {} if middle is None else {_MEDIAN: float(middle)}
    if level is not None and ends[0] is not None and ends[1] is not None:
        tail = round((1.0 - level) / 2.0, 12)
        found |= {tail: float(ends[0]), round(1.0 - tail, 12): float(ends[1])}
    return found
