"""Answers of the HTTP API about machines, channels, trends, spectra and health; called in threads."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from typing import Any

import numpy as np

from models.machine.bearing import Bearing, kinematics
from models.machine.rig import Calibration
from monitor import __version__
from monitor.config.source import ChannelSection
from monitor.config.stages import method_or_best
from monitor.health.signal.features import fundamentals
from monitor.health.signal.quality import FLAGS, REJECTIONS
from monitor.records.database import StoreError
from monitor.records.queries import LedgerBlock, is_dated, newest_id, refused_counts, staged_values
from monitor.records.rollup import SeriesKey
from monitor.records.trends import TrendTable, read_trends
from monitor.service.progress import unhealthy
from monitor.web.answers import Query, RequestError, numbers, optional_number, times, whole_number, without_folders
from monitor.web.machines import Machines, WatchedMachine
from monitor.words.features import FEATURES, TRENDS
from monitor.words.zones import machine_class

MAX_CHANNELS = 40
POINTS = 60


def levels(machine: WatchedMachine, query: Query) -> dict[str, Any]:
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


MAX_POINTS = 5000
_POINTS = 1000
_MARKS = ("t_fs", "t_fs_known", "t_eol", "t_fs_block", "speed", "load")
_RECENT = 200


def machines(site: Machines) -> dict[str, Any]:
    """Return the status of all machines."""
    return {
        "server": {"version": __version__, "utc": datetime.now(UTC).isoformat(timespec="milliseconds")},
        "machines": [machine.status().values for machine in site],
    }


def blocks(machine: WatchedMachine, query: Query) -> dict[str, Any]:
    """Return the number of blocks by status, and the latest of those that are not ``ok``."""
    limit = whole_number(query, "limit", 200, 1, 1000)
    source = query.get("source") or None
    sources = machine.status().values.get("sources", {})
    counts = machine.tally.counts(source)
    for (name, status), times_refused in refused_counts(machine.store).items():
        if source in (None, name):
            counts[status] = counts.get(status, 0) + times_refused
    return {
        "counts": counts,
        "counting": not machine.tally.complete,
        "pending": sum(found["pending"] for name, found in sources.items() if source in (None, name)),
        "blocks": [listed(block) for block in machine.tally.others(limit, source)],
    }


def listed(block: LedgerBlock) -> dict[str, Any]:
    """Return a block of the ledger as the page lists it, without folders."""
    return {
        "source": block.source,
        "block": block.sequence,
        "name": block.name.replace("\\", "/").rpartition("/")[2],
        "time_s": block.time,
        "dated": bool(block.dated),
        "status": block.status,
        "reason": without_folders(block.reason),
    }


def channel(machine: WatchedMachine, name: str) -> dict[str, Any]:
    """Return bearing, units, levels of a channel, and its marks on the axis of time."""
    section, config = machine.channel(name), machine.config
    bearing = config.bearing_of(section)
    state = machine.status().values.get("channels", {}).get(name, {})
    marks = latest_values(machine, section.source, name)
    method = method_or_best(config.track.method, section.library)
    absolute = section.unit != "unknown"
    calibrated = calibration(machine, section)
    compared = calibrated is not False or not section.track or config.forecast.uncalibrated_threshold
    learns = config.forecast.method == "learned"
    thresholds = config.forecast.thresholds if compared and not learns else ()
    return {
        "machine": machine.name,
        "channel": name,
        "source": section.source,
        "dated": is_dated(machine.store, section.source),
        "unit": "g" if absolute else "unknown",
        "velocity_limit_hz": section.velocity_limit if section.measures_velocity else None,
        "timezone": config.machine.timezone,
        "bearing": {"name": section.bearing, **_bearing(bearing)},
        "orders": fundamentals(kinematics(bearing, 1.0)),
        "thresholds_mm2": [round(threshold * 1e6, 12) for threshold in thresholds],
        "interval": config.forecast.interval,
        "forecast_end": "recorded runs" if learns else "threshold",
        "iso_class": _machine_class(config.machine.iso_class),
        "window_hours": config.forecast.window_hours,
        "tracked": section.track,
        "method": method if section.track else None,
        "calibrated": calibrated,
        "levels": [_level(level, absolute) for level in _levels(machine, name, state)],
        "marks": {f"{key}_s": marks.get(key) for key in ("t_fs", "t_fs_known", "t_eol")},
        "state": state,
    }


def _machine_class(name: str | None) -> dict[str, Any] | None:
    if name is None:
        return None
    found = machine_class(name)
    limits = [round(1e3 * limit, 9) for limit in found.limits]
    return {"name": found.name, "text": found.text, "table": found.table, "limits_mm_s": limits}


def calibration(machine: WatchedMachine, section: ChannelSection) -> Calibration:
    """Return whether the rig of a channel is calibrated, by its daemon where that has run, else by ``[rig]``."""
    known = machine.status().values.get("channels", {}).get(section.name, {}).get("calibrated")
    return machine.config.calibration_of(section) if known is None else known


def _bearing(bearing: Bearing) -> dict[str, Any]:
    return {
        "designation": bearing.designation,
        "n_elements": bearing.n_elements,
        "rows": bearing.rows,
        "element": bearing.element,
        "element_diameter_mm": round(bearing.element_diameter * 1e3, 9),
        "pitch_diameter_mm": round(bearing.pitch_diameter * 1e3, 9),
        "rotating_ring": bearing.rotating_ring,
    }


def _levels(machine: WatchedMachine, name: str, state: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the levels in the status of the daemon, or as configured where no daemon has run."""
    if "levels" in state:
        return state["levels"]
    rules = machine.config.alarms.to_settings(name, 0).rules
    return [
        {
            "rule": rule.name,
            "feature": rule.feature,
            "side": rule.side,
            "alert_si": None if rule.alert is None else rule.alert.value,
            "danger_si": None if rule.danger is None else rule.danger.value,
        }
        for rule in rules
    ]


def _level(level: Mapping[str, Any], absolute: bool) -> dict[str, Any]:
    feature = FEATURES[level["feature"]]
    factor = feature.of_si(absolute=absolute)
    values = {key: level[f"{key}_si"] for key in ("alert", "danger")}
    return {
        **{key: level[key] for key in ("rule", "feature", "side")},
        "column": feature.column,
        **{key: None if value is None else float(f"{value * factor:.9g}") for key, value in values.items()},
    }


def latest_values(machine: WatchedMachine, source: str, name: str) -> dict[str, float]:
    """Return marks, speed and load of a channel from its latest record that has a stage, SI."""
    return staged_values(machine.store, source, name, _MARKS)


def records(machine: WatchedMachine, name: str, query: Query) -> dict[str, Any]:
    """Return the trends of a channel over a span of time."""
    section = machine.channel(name)
    points = whole_number(query, "points", _POINTS, 10, MAX_POINTS)
    since, until = optional_number(query, "from"), optional_number(query, "to")
    dated = is_dated(machine.store, section.source)
    found = read_trends(machine.store, SeriesKey(section.source, name, bool(dated)), since, until, points)
    return {
        "machine": machine.name,
        "channel": name,
        "dated": dated,
        "resolution_s": found.resolution,
        "first_s": found.first,
        "last_s": found.last,
        "columns": columns(found, absolute=section.unit != "unknown"),
        "updating": not found.complete,
    }


def columns(table: TrendTable, *, absolute: bool) -> dict[str, list[Any]]:
    """Return time and extremes by the names of their columns, in the units of these."""
    found: dict[str, list[Any]] = {"time_s": times(table.time)}
    for feature in TRENDS:
        factor = feature.of_si(absolute=absolute)
        low, high = table.low[feature.name], table.high[feature.name]
        found[f"{feature.column}_min"] = numbers(low * factor)
        found[f"{feature.column}_max"] = found[f"{feature.column}_min"] if high is low else numbers(high * factor)
    found["records"] = table.records.tolist()
    found["rejected"] = _counted(table, REJECTIONS)
    found["flagged"] = _counted(table, FLAGS)
    if table.blocks is not None:
        found["block"] = table.blocks.tolist()
    return found


def _counted(table: TrendTable, statuses: tuple[str, ...]) -> list[int]:
    total = np.zeros(table.time.size, dtype=np.int64)
    for status in statuses:
        if status in table.counts:
            total = total + table.counts[status]
    return total.tolist()


def health(site: Machines) -> tuple[int, dict[str, Any]]:
    """Return the HTTP status, and ``ok`` or ``failing`` with the reasons.

    Reasons: a daemon that does not run or whose status is old, a silent source, a store that cannot be used.
    """
    reasons = [f"machine {machine.name}: {reason}" for machine in site for reason in _reasons(machine)]
    return (503 if reasons else 200), {"status": "failing" if reasons else "ok", "reasons": reasons}


def _reasons(machine: WatchedMachine) -> Iterator[str]:
    status = machine.status()
    values = status.values
    yield from (without_folders(reason) for reason in unhealthy(values))
    if values.get("running") is not True or values["status"] == "starting":
        return
    try:
        newest_id(machine.store)
    except StoreError as error:
        yield f"the store cannot be read: {without_folders(str(error))}"
    silent: dict[str, str] = {}
    for channel in values["channels"].values():
        if channel["state"] == "no_data":
            silent.setdefault(channel["source"], channel["reason"])
    for source, reason in silent.items():
        yield f"source {source}: {reason}"
