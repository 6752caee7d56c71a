"""A store of whole days that is condensed, and what is compared of it."""

from __future__ import annotations

from typing import Any

from monitor.health.record import Record
from monitor.records import rollup
from monitor.records.condense import condense
from monitor.records.database import SharedConnection
from monitor.records.rollup import SeriesKey
from monitor.records.store import Store
from monitor.records.trends import TrendTable, read_trends

DAY = 86400.0
BEGIN = 1_700_006_400.0
STEP = 1800.0
PER_DAY = round(DAY / STEP)
EVENT_EVERY, FIRST_FORECAST = 20, 51


def block(number: int, time: float | None = None, **fields: Any) -> Record:
    values = {"rms": 1.0 + number % 7, "stage": "healthy", "quality_status": "ok", "bpfo_amplitude": [1.0] * 6}
    return Record(
        **{
            "source": "s",
            "sequence": number,
            "name": f"b{number}",
            "content_hash": f"{number:032x}",
            "time": BEGIN + STEP * (number - 1) if time is None else time,
            "channels": {"x": values, "y": {}},
        }
        | fields
    )


def forecast(number: int) -> dict[str, Any]:
    return {"channel": "x", "method": "thesis", "threshold_mm2": 0.05, "status": "ok", "tt_s": 1e5 - number}


def fill(store: Store, days: int = 4) -> int:
    """Commit blocks of whole days: every 20th with an event, later ones with a forecast; return how many."""
    count = days * PER_DAY
    records = []
    for number in range(1, count + 1):
        events = ({"kind": "tick", "n": number},) if number % EVENT_EVERY == 0 else ()
        forecasts = (forecast(number),) if number >= FIRST_FORECAST else ()
        records.append((block(number, events=events, forecasts=forecasts), {"a": {"n": number}}))
    store.commit_many(records)
    with store.transaction() as connection:
        rollup.roll_up(connection, 60.0)
    return count


def condense_all(store: Store, full_days: float = 1.0, most: int = 100, *, by_number: bool = False) -> None:
    while condense(store, full_days * DAY, most, by_number=by_number):
        pass


def present(store: Store) -> list[int]:
    return [number for (number,) in store.rows("SELECT sequence FROM blocks ORDER BY sequence")]


def trends(store: Store, **asked: Any) -> TrendTable:
    with SharedConnection(store.path) as reader:
        return read_trends(reader, SeriesKey("s", "x", True), **asked)
