"""Records and machine status as JSON for MQTT; docs/reference/wire.md has the keys."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from monitor.words.events import utc_text
from monitor.words.features import FEATURES, TRENDS

_WORDS = (
    *("stage", "fault", "fault_basis", "edv_status", "tt_status", "p_no_growth"),
    *("t_fs_block", "t_fs_known_block", "t_eol_block", "tta_status", "tta_level_source"),
    *("velocity_status", "velocity_zone", "domain", "rotation_status", "pulses_missing", "pulses_extra"),
    "level_status",
)

_ROTATION = ("acceleration", "revolutions", "encoder_error")
"""Features without a trend that are published beside those with one."""


@dataclass(frozen=True)
class StoredRecord:
    """A record as the store has it; ``flags`` are separated by blanks, times are s, values SI."""

    machine: str
    source: str
    sequence: int
    status: str
    flags: str
    reason: str
    time: float | None
    elapsed: float | None
    channels: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)


def channel_message(record: StoredRecord, channel: str) -> str:
    """Return the values of a channel in a record as a JSON object; null is no value."""
    return json.dumps(channel_values(record, channel), allow_nan=False, separators=(",", ":"))


def channel_values(record: StoredRecord, channel: str) -> dict[str, Any]:
    """Return the values of a channel in a record, units in their names; the same keys whatever the record holds."""
    values = record.channels.get(channel, {})
    absolute = values.get("absolute_level") != "no"
    threshold, t_fs = first(values.get("v_th")), values.get("t_fs")
    message: dict[str, Any] = {
        "machine": record.machine,
        "source": record.source,
        "channel": channel,
        "block": record.sequence,
        "time_utc": utc_text(record.time),
        "elapsed_s": record.elapsed,
        "status": record.status,
        "flags": record.flags.split(),
        "reason": record.reason or None,
        "quality": values.get("quality_status"),
        "t_fs_utc": None if record.time is None else utc_text(t_fs),
        **{name: first(values.get(name)) for name in _WORDS},
        "threshold_mm2": None if threshold is None else threshold * 1e6,
        "unit": "g" if absolute else "unknown",
    }
    for feature in (*TRENDS, *(FEATURES[name] for name in _ROTATION)):
        value = first(values.get(feature.name))
        message[feature.column] = None if value is None else value * feature.of_si(absolute=absolute)
    message |= {f"{name}_s": values.get(name) for name in ("tta", "tta_lower", "tta_upper")}
    level = values.get("tta_level")
    message["tta_level_g"] = None if level is None else level * FEATURES["rms"].of_si(absolute=absolute)
    return message


def state_message(machine: str, status: Mapping[str, Any] | None) -> str:
    """Return the status of a machine by its status file, or without one that it is unreachable."""
    if status is None:
        values: dict[str, Any] = {"machine": machine, "status": "unreachable", "state": "no_data", "channels": {}}
    else:
        channels = {name: channel.get("state") for name, channel in status.get("channels", {}).items()}
        values = {
            "machine": machine,
            "status": status.get("status"),
            "state": status.get("state"),
            "problems": sorted(status.get("problems", {})),
            "channels": channels,
            "headlines": {name: channel.get("headline") for name, channel in status.get("channels", {}).items()},
        }
    return json.dumps(values, allow_nan=False, separators=(",", ":"))


def first(value: Any) -> Any:
    """Return the first of several values (bands, thresholds), or the only one."""
    return (value[0] if value else None) if isinstance(value, list | tuple) else value
