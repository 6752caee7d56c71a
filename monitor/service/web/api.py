"""What the addresses below ``/api`` answer: plain functions of what is asked, called in threads."""

from __future__ import annotations

import math
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

import numpy as np

from monitor import __version__
from monitor.service.web.answers import RequestError, numbers, times
from monitor.service.web.columns import COLUMNS
from monitor.service.web.machines import Machine, Machines
from monitor.service.web.trend_view import Trend, read_trend

MOST_POINTS = 5000
_POINTS = 1000


def machines(site: Machines) -> dict[str, Any]:
    """Return all machines with all that their daemons say."""
    return {
        "server": {"version": __version__, "utc": datetime.now(UTC).isoformat(timespec="milliseconds")},
        "machines": [{"name": machine.name, **machine.status().values} for machine in site],
    }


def records(machine: Machine, channel: str, query: Mapping[str, str]) -> dict[str, Any]:
    """Return the trends of a channel over a span of time."""
    section = machine.channel(channel)
    points = int(number(query, "points", _POINTS, 10, MOST_POINTS))
    since, until = number(query, "from", -math.inf), number(query, "to", math.inf)
    dated = is_dated(machine, section.source)
    first, last = whole_span(machine, section.source, dated=dated)
    trend = read_trend(
        machine.store, section.source, channel, dated=dated, span=(max(since, -1e18), min(until, 1e18)), points=points
    )
    return {
        "dated": dated,
        "resolution_s": trend.resolution,
        "first_s": first,
        "last_s": last,
        "columns": columns_of(trend, absolute=section.unit != "unknown"),
        "updating": False,
    }


def columns_of(trend: Trend, *, absolute: bool) -> dict[str, list[float | None]]:
    """Return time and extremes by the names of their columns, in the units of these."""
    found: dict[str, list[float | None]] = {"time_s": [*times(trend.time)]}
    for column in COLUMNS:
        factor = column.of_si(absolute=absolute)
        for end, side in (("min", trend.low), ("max", trend.high)):
            values = side.get(column.feature)
            if values is not None:
                found[f"{column.name}_{end}"] = numbers(np.asarray(values) * factor)
    return found


def is_dated(machine: Machine, source: str) -> bool:
    """Return whether the latest block of a source has a date."""
    rows = machine.store.rows("SELECT day FROM blocks WHERE source = ? ORDER BY sequence DESC LIMIT 1", source)
    return bool(rows) and rows[0][0] is not None


def whole_span(machine: Machine, source: str, *, dated: bool) -> tuple[float | None, float | None]:
    """Return the times of the first and of the last block of a source on its axis."""
    query = "SELECT min(axis_time), max(axis_time) FROM blocks WHERE source = ? AND (day IS NOT NULL) = ?"
    return machine.store.rows(query, source, dated)[0]


def number(query: Mapping[str, str], key: str, default: float, low: float = -math.inf, high: float = math.inf) -> float:
    """Return a number of the query, brought between two ends.

    Raises:
        RequestError: 400, it is none.
    """
    text = query.get(key)
    if text is None or text == "":
        return default
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise RequestError(400, f"{key} must be a number")
    return min(max(value, low), high)
