"""Trends the slow and obvious way: every record of the store, whole, put into its stretch by itself."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from monitor.records.rollup import FEATURES
from monitor.records.store import Store


class Said(NamedTuple):
    """What one record says of one channel: its time, block, status, and the features that it has."""

    time: float
    block: int
    status: str
    values: dict[str, float]


def said_of(store: Store, source: str, channel: str, dated: bool) -> list[Said]:
    """Return what all records say of a channel, in the order of time."""
    found: list[tuple[float, int, Said]] = []
    for place, stored in enumerate(store.stored()):
        record = stored.to_record()
        if record.source != source or (stored.filing.day is not None) != dated:
            continue
        if record.channels and channel not in record.channels:
            continue
        given = record.channels.get(channel, {})
        values = {name: _first(given.get(name)) for name in FEATURES}
        status = given.get("quality_status") or record.status
        time = stored.filing.time
        there = {name: value for name, value in values.items() if value is not None}
        found.append((time, place, Said(time, record.sequence, status, there)))
    return [said for _, _, said in sorted(found, key=lambda item: item[:2])]


def _first(value: Any) -> float | None:
    while isinstance(value, Sequence):
        value = value[0] if value else None
    return value


def stretches(said: Sequence[Said], length: float) -> list[tuple[float, list[Said]]]:
    """Return the records by the stretch that they fall into, in the order of time."""
    found: dict[float, list[Said]] = {}
    for item in said:
        found.setdefault(item.time // length, []).append(item)
    return [(number * length, found[number]) for number in sorted(found)]


def extremes(said: Sequence[Said], feature: str) -> tuple[float, float]:
    """Return the least and the largest value of a feature, NaN where there is none."""
    values = [item.values[feature] for item in said if feature in item.values]
    return (min(values), max(values)) if values else (math.nan, math.nan)
