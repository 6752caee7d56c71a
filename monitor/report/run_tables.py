"""Tables of one run: what happened, and how its records were made."""

from __future__ import annotations

import math
from typing import Any

from monitor.report.data_quality import without_folders
from monitor.report.runs import Run
from monitor.report.tables import Column, Table
from monitor.words.events import event_text
from monitor.words.numbers import Clock

_MOST_EVENTS = 200
_EVENT_NAMES = {
    "final_stage": "start of the final stage known",
    "end_of_life": "end of life reached",
    "alarm_raised": "alarm",
    "alarm_cleared": "alarm over",
    "condition": "condition",
}
_PROVENANCE = {
    "software_version": "software version",
    "schema_version": "record schema",
    "config_hash": "hash of the configuration",
    "map_hash": "hash of the RMS map",
    "calibrated": "map calibrated on this machine",
    "rms_band_hz": "band of RMS (Hz)",
    "track_method": "method of V_eq",
    "forecast_method": "method of TT",
    "interval_level": "level of intervals",
    "prior": "what intervals lean on",
    "library_hash": "hash of the library of simulated lives",
}
_DISCOVERY = frozenset(
    {"Conventions", "title", "summary", "keywords", "id", "machine", "source", "history", "processing_level"}
    | {"date_created", "product_version", "dated"}
)
"""Attributes that describe a file and say nothing of how its records were made."""


def events_table(run: Run, clock: Clock) -> Table | None:
    """Return the latest events of a run, or None where nothing happened."""
    if not run.events:
        return None
    places = {
        (str(source), int(number)): at
        for source, number, at in zip(run.ledger["source"], run.ledger["sequence"], run.time, strict=True)
    }
    rows = []
    for event in run.events[-_MOST_EVENTS:]:
        kind = str(event.get("kind", "event"))
        block = int(event.get("block", 0))
        channel = run.channels.get(str(event.get("channel", "")))
        text = event_text(_readable(event), absolute=channel is None or channel.has_level)
        at = float(places.get((str(event.get("source", "")), block), math.nan))
        name = _EVENT_NAMES.get(kind, without_folders(kind))
        rows.append((block, at, str(event.get("channel", "")), name, without_folders(text)))
    where = clock.label if clock.dated else "from the first block"
    columns = (
        Column("block", "block", "1"),
        Column("time", f"time ({where})", "s", "s", words=clock.short),
        Column("channel", "channel"),
        Column("event", "event"),
        Column("details", "details"),
    )
    left = len(run.events) - len(rows)
    return Table("events", "Events", columns, rows, f"{left:,} earlier ones are in the records." if left else "")


def _readable(event: Any) -> dict[str, Any]:
    """Return an event whose numbers are numbers: records may hold anything under any key."""
    found = dict(event)
    for key in ("value_si", "level_si"):
        if not isinstance(found.get(key), int | float):
            found.pop(key, None)
    return found


def provenance(run: Run) -> list[tuple[str, str]]:
    """Return pairs of what and how: versions, hashes, methods."""
    known = [(label, run.attributes[key]) for key, label in _PROVENANCE.items() if key in run.attributes]
    others = [
        (key, text)
        for key, text in sorted(run.attributes.items())
        if key not in _PROVENANCE and key not in _DISCOVERY and not key.startswith("time_coverage")
    ]
    return [(label, without_folders(text) or "none") for label, text in (*known, *others)]
