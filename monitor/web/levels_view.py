"""Answers of the HTTP API about the latest levels of many channels, with their course; called in threads."""

from __future__ import annotations

from typing import Any

import numpy as np

from monitor.records.rollup import SeriesKey
from monitor.records.trends import read_trends
from monitor.web.answers import Query, RequestError, numbers, times
from monitor.web.api import is_dated
from monitor.web.machines import Machine
from monitor.words.features import FEATURES

MAX_CHANNELS = 40
POINTS = 60


def levels(machine: Machine, query: Query) -> dict[str, Any]:
    """Return RMS over the life of some channels in at most 60 points, and its latest value; unknown ones left out.

    Raises:
        RequestError: 400 for none or too many channels.
    """
    wanted = [name for name in query.get("channels", "").split(",") if name]
    if not 0 < len(wanted) <= MAX_CHANNELS:
        raise RequestError(400, f"channels must name 1 to {MAX_CHANNELS} channels, separated by commas")
    known = [name for name in dict.fromkeys(wanted) if name in machine.channels]
    sources = dict.fromkeys(machine.channels[name].source for name in known)
    dated = {source: bool(is_dated(machine.store, source)) for source in sources}
    found: dict[str, Any] = {}
    for name in known:
        section = machine.channels[name]
        absolute = section.unit != "unknown"
        table = read_trends(machine.store, SeriesKey(section.source, name, dated[section.source]), points=POINTS)
        high = table.high["rms"] * FEATURES["rms"].of_si(absolute=absolute)
        there = np.flatnonzero(np.isfinite(high))
        shown = numbers(high[there], 4)
        found[name] = {
            "unit": "g" if absolute else "unknown",
            "dated": dated[section.source],
            "time_s": times(table.time[there]),
            "rms_g": shown,
            "latest_g": shown[-1] if shown else None,
        }
    return {"machine": machine.name, "channels": found}
