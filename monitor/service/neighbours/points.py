"""What a control system is given of a machine: named values with a type, a quality and a time.

OPC UA and Sparkplug B publish the same points. The names are those of records over MQTT, docs/reference/wire.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from monitor.config.load import Config
from monitor.service.record_message import StoredRecord, channel_values

Kind = Literal["float", "int", "text"]
Quality = Literal["good", "uncertain", "old", "bad"]
Value = float | int | str | None
Path = tuple[str, ...]
"""``(name,)`` of the machine, ``(bearing, name)`` or ``(bearing, channel, name)``."""

_IDENTITY = ("machine", "source", "channel")
_INTEGERS = ("block", "t_fs_block", "t_fs_known_block", "t_eol_block", "pulses_missing", "pulses_extra")
_TEXTS = (
    *("time_utc", "status", "flags", "reason", "quality", "unit", "stage", "fault", "fault_basis", "t_fs_utc"),
    *("edv_status", "tt_status", "tta_status", "tta_level_source", "velocity_status", "velocity_zone"),
    *("domain", "rotation_status", "level_status"),
)
_STATUS_OF = {
    "v_eq": "edv_status",
    "dphi_d": "edv_status",
    "h_d": "edv_status",
    "tta": "tta_status",
    "tt": "tt_status",
    "p_threshold": "tt_status",
    "velocity": "velocity_status",
}
"""The status that qualifies the values whose names begin so; the first that fits."""
_DEVICE_HEALTH = {
    "normal": 0,
    "failure": 1,
    "no_data": 1,
    "bad_data": 1,
    "check_function": 2,
    "out_of_specification": 3,
    "maintenance_required": 4,
}
"""``DeviceHealthEnumeration`` of OPC 10000-100, which has the classes of NAMUR NE 107; without data it is a failure."""
_NO_RECORD = StoredRecord("", "", 0, "", "", "", None, None)


@dataclass(frozen=True)
class Point:
    """A value with its type and quality.

    Attributes:
        value: None where there is none; a text is never None.
        kind: its type, whatever the value.
        quality: ``good``; ``uncertain``: its status or the block has a reservation; ``old``: it was good, and nothing
            came since; ``bad``: there is no value.
        time: of the block, UTC s since 1970, or None: undated, or no value of a block.
    """

    value: Value
    kind: Kind
    quality: Quality = "good"
    time: float | None = None


@dataclass(frozen=True)
class Channel:
    """A channel and where it belongs."""

    name: str
    bearing: str
    source: str


@dataclass(frozen=True)
class Snapshot:
    """A machine at one moment.

    Attributes:
        status: of the status file, with ``running``, as :func:`monitor.service.status_file.read_status` gives it.
        records: the latest of each source.
        events: number of events in the log.
    """

    status: Mapping[str, Any] = field(default_factory=dict)
    records: Mapping[str, StoredRecord] = field(default_factory=dict)
    events: int | None = None


def channels_of(config: Config) -> tuple[Channel, ...]:
    """Return the channels of a configuration in its order."""
    return tuple(Channel(item.name, item.bearing, item.source) for item in config.channel)


def points_of(channels: tuple[Channel, ...], snapshot: Snapshot) -> dict[Path, Point]:
    """Return all points of a machine; which there are depends on the channels alone."""
    status = snapshot.status
    running = bool(status.get("running"))
    found: dict[Path, Point] = {
        ("state",): _text(status.get("state") if running else "no_data"),
        ("device_health",): Point(_health(status.get("state") if running else "no_data"), "int"),
        ("daemon",): _text(status.get("status")),
        ("problems",): _text("; ".join(f"{name}: {text}" for name, text in sorted(status.get("problems", {}).items()))),
        ("alarms",): _number(status.get("alarms"), "int"),
        ("unacknowledged",): _number(status.get("unacknowledged"), "int"),
        ("events",): _number(snapshot.events, "int"),
        ("updated_utc",): _text(status.get("updated_utc")),
        ("version",): _text(status.get("version")),
    }
    for name in dict.fromkeys(channel.bearing for channel in channels):
        verdict = status.get("bearings", {}).get(name) or {}
        found[name, "fault"] = _text(verdict.get("fault"))
    for channel in channels:
        state = status.get("channels", {}).get(channel.name, {}) if running else {"state": "no_data"}
        record = snapshot.records.get(channel.source)
        for name, point in _channel_points(channel, record, state).items():
            found[channel.bearing, channel.name, name] = point
    return found


def _channel_points(channel: Channel, record: StoredRecord | None, state: Mapping[str, Any]) -> dict[str, Point]:
    condition = state.get("state")
    values = channel_values(record or _NO_RECORD, channel.name)
    time = None if record is None else record.time
    found = {
        "state": _text(condition),
        "state_reason": _text(state.get("reason")),
        "headline": _text(state.get("headline")),
        "action": _text(state.get("action")),
        "device_health": Point(_health(condition), "int"),
        "alarms": _number(None if "alarms" not in state else len(state["alarms"]), "int"),
    }
    for name, value in values.items():
        if name in _IDENTITY:
            continue
        if name in _TEXTS:
            text = " ".join(value) if isinstance(value, list) else value
            found[name] = Point("" if text is None else text, "text", "bad" if record is None else "good", time)
            continue
        quality: Quality = "bad"
        if record is not None and value is not None:
            quality = "old" if condition == "no_data" else _reservation(name, record, values)
        found[name] = Point(None if record is None else value, "int" if name in _INTEGERS else "float", quality, time)
    return found


def _reservation(name: str, record: StoredRecord, values: Mapping[str, Any]) -> Quality:
    """Return ``uncertain`` where the block is flagged, or the status of the value is not ``ok``."""
    if name in _INTEGERS:
        return "good"
    status = next((values.get(key) for start, key in _STATUS_OF.items() if name.startswith(start)), None)
    clean = record.status == "ok" and status in (None, "ok")
    return "good" if clean else "uncertain"


def _text(value: Any) -> Point:
    return Point("" if value is None else str(value), "text", "bad" if value is None else "good")


def _number(value: Any, kind: Kind) -> Point:
    return Point(value, kind, "bad" if value is None else "good")


def _health(state: Any) -> int:
    return _DEVICE_HEALTH.get(str(state), _DEVICE_HEALTH["no_data"])
