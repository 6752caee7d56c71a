"""Records and status of a machine for other programs: JSON for MQTT, and points with type, quality and time.

OPC UA and Sparkplug B publish the same points. docs/reference/wire.md has the keys, which are the names of the points.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from monitor.config.load import Config
from monitor.records.database import SharedConnection, StoreError
from monitor.records.queries import StoredRecord, latest_record, log_marks, newest_id
from monitor.service.system import read_status
from monitor.words.events import utc_text
from monitor.words.features import FEATURES, TRENDS, columns, first

_WORDS = (
    *("stage", "fault", "fault_basis", "edv_status", "tt_status", "p_no_growth"),
    *("t_fs_block", "t_fs_known_block", "t_eol_block", "tta_status", "tta_level_source"),
    *("velocity_status", "velocity_zone", "domain", "rotation_status", "pulses_missing", "pulses_extra"),
    "level_status",
)

_ROTATION = ("acceleration", "revolutions", "encoder_error")
"""Features without a trend that are published beside those with one."""


Kind = Literal["float", "int", "text"]
Quality = Literal["good", "uncertain", "old", "bad"]
Value = float | int | str | None
PointPath = tuple[str, ...]
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
    message |= columns((*(feature.name for feature in TRENDS), *_ROTATION), values, absolute=absolute)
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


@dataclass(frozen=True)
class MachinePoint:
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
class MachineChannel:
    """A channel and where it belongs."""

    name: str
    bearing: str
    source: str


@dataclass(frozen=True)
class MachineSnapshot:
    """A machine at one moment.

    Attributes:
        status: of the status file, with ``running``, as :func:`monitor.service.system.read_status` gives it.
        records: the latest of each source.
        events: number of events in the log.
    """

    status: Mapping[str, Any] = field(default_factory=dict)
    records: Mapping[str, StoredRecord] = field(default_factory=dict)
    events: int | None = None


def channels_of(config: Config) -> tuple[MachineChannel, ...]:
    """Return the channels of a configuration in its order."""
    return tuple(MachineChannel(item.name, item.bearing, item.source) for item in config.channel)


def points_of(channels: tuple[MachineChannel, ...], snapshot: MachineSnapshot) -> dict[PointPath, MachinePoint]:
    """Return all points of a machine; which there are depends on the channels alone."""
    status = snapshot.status
    running = status.get("running") is True
    found: dict[PointPath, MachinePoint] = {
        ("state",): _text(status.get("state") if running else "no_data"),
        ("device_health",): MachinePoint(_health(status.get("state") if running else "no_data"), "int"),
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


def _channel_points(
    channel: MachineChannel, record: StoredRecord | None, state: Mapping[str, Any]
) -> dict[str, MachinePoint]:
    condition = state.get("state")
    values = channel_values(record or _NO_RECORD, channel.name)
    time = None if record is None else record.time
    found = {
        "state": _text(condition),
        "state_reason": _text(state.get("reason")),
        "headline": _text(state.get("headline")),
        "action": _text(state.get("action")),
        "device_health": MachinePoint(_health(condition), "int"),
        "alarms": _number(None if "alarms" not in state else len(state["alarms"]), "int"),
    }
    for name, value in values.items():
        if name in _IDENTITY:
            continue
        if name in _TEXTS:
            text = " ".join(value) if isinstance(value, list) else value
            found[name] = MachinePoint("" if text is None else text, "text", "bad" if record is None else "good", time)
            continue
        quality: Quality = "bad"
        if record is not None and value is not None:
            quality = "old" if condition == "no_data" else _reservation(name, record, values)
        found[name] = MachinePoint(
            None if record is None else value, "int" if name in _INTEGERS else "float", quality, time
        )
    return found


def _reservation(name: str, record: StoredRecord, values: Mapping[str, Any]) -> Quality:
    """Return ``uncertain`` where the block is flagged, or the status of the value is not ``ok``."""
    if name in _INTEGERS:
        return "good"
    status = next((values.get(key) for start, key in _STATUS_OF.items() if name.startswith(start)), None)
    clean = record.status == "ok" and status in (None, "ok")
    return "good" if clean else "uncertain"


def _text(value: Any) -> MachinePoint:
    return MachinePoint("" if value is None else str(value), "text", "bad" if value is None else "good")


def _number(value: Any, kind: Kind) -> MachinePoint:
    return MachinePoint(value, kind, "bad" if value is None else "good")


def _health(state: Any) -> int:
    return _DEVICE_HEALTH.get(str(state), _DEVICE_HEALTH["no_data"])


class Snapshots:
    """The latest of one machine; from one thread."""

    def __init__(self, machine: str, sources: Iterable[str], state_dir: Path) -> None:
        """Keep names and folder; nothing is read yet."""
        self._machine, self._sources = machine, tuple(dict.fromkeys(sources))
        self._state_dir = state_dir
        self._newest: int | None = None
        self._found = MachineSnapshot()

    def read(self) -> MachineSnapshot:
        """Return the present status and records; where the store cannot be read, the last known records."""
        try:
            # A store that was replaced meanwhile is found, too.
            with SharedConnection(self._state_dir / "state.db") as store:
                self._read_store(store)
        except StoreError:
            self._newest = None
        return replace(self._found, status=read_status(self._state_dir))

    def _read_store(self, store: SharedConnection) -> None:
        marks, newest = log_marks(store), newest_id(store)
        events = marks.events + marks.notices
        if newest == self._newest:
            self._found = replace(self._found, events=events)
            return
        records = {}
        for source in self._sources:
            record = latest_record(store, self._machine, source)
            if record is not None:
                records[source] = record
        self._newest, self._found = newest, MachineSnapshot(records=records, events=events)
