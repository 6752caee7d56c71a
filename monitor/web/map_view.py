"""The RMS map of a channel at its operating point, and the track of its damage on it."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from monitor.health.tracker import part_of
from monitor.records.queries import is_dated, values_since
from monitor.service.summary import weakest_calibration
from monitor.web.answers import Query, RequestError, numbers, times
from monitor.web.api import calibration, latest_values
from monitor.web.machines import Machine
from monitor.words.features import FEATURES

if TYPE_CHECKING:
    from models.machine.scene import Part
    from models.maps.data import RmsMap

_MAX_POINTS = 2000
_MAX_MAPS = 16
_TRACK = ("dphi_d", "h_d", "v_eq")
_COLUMNS = ("dphi_deg", "h_d_um", "v_eq_mm2")
_lock = threading.Lock()
_maps: dict[tuple[Path, int, int], RmsMap] = {}


def map_of(machine: Machine, channel: str, _: Query) -> dict[str, Any]:
    """Return the map and the track, or ``map`` null and the reason."""
    section = machine.channel(channel)
    if not section.track:
        return {"map": None, "reason": "the channel is not tracked"}
    if not section.maps:
        return {"map": None, "reason": "the channel has no RMS map"}
    try:
        maps: dict[Part, RmsMap] = {rms_map.part: rms_map for rms_map in map(_load, section.maps)}
    except RequestError as error:
        return {"map": None, "reason": error.sentence}
    part = part_of(machine.status().values["channels"].get(channel, {}).get("fault"), maps)
    if part is None:
        return {"map": None, "reason": "the channel has no RMS map of the part that is named"}
    rms_map = maps[part]
    latest = latest_values(machine, section.source, channel)
    load, speed = _nearest(rms_map, machine, latest)
    at = rms_map.slice_at(load, speed)
    return {
        "dphi_deg": numbers(np.degrees(at.dphi_d)),
        "h_d_um": numbers(at.h_d * 1e6),
        "rms_g": [numbers(row / FEATURES["rms"].unit.si, 5) for row in at.rms],
        "load_newton": load,
        "speed_hz": speed,
        "fault": part,
        "v_eq": rms_map.volume_words,
        "calibrated": weakest_calibration(calibration(machine, section), rms_map.plan.rig.calibrated),
        "dated": is_dated(machine.store, section.source),
        "track": _track(machine, section.source, channel, latest.get("t_fs_block")),
    }


def _load(path: Path) -> RmsMap:
    """Return a map, kept in memory until its file changes; :class:`RequestError` 404 where it cannot be read."""
    from models.maps.file import load_map
    from models.maps.plan import MapError

    try:
        found = path.stat()
        key = (path, found.st_mtime_ns, found.st_size)
        with _lock:
            if key not in _maps:
                while len(_maps) >= _MAX_MAPS:
                    _maps.pop(next(iter(_maps)))
                _maps[key] = load_map(path)
            return _maps[key]
    except (MapError, OSError) as error:
        reason = str(error).replace(f"{path.parent}/", "")
        raise RequestError(404, f"the RMS map cannot be read: {reason}") from None


def _nearest(rms_map: RmsMap, machine: Machine, latest: Mapping[str, float]) -> tuple[float, float]:
    """Return load and speed of the latest record, or as configured, limited to the map."""
    operating = machine.config.operating
    load = latest.get("load", operating.load_newton)
    speed = latest.get("speed", operating.speed_hz)
    wanted = [(load, rms_map.load), (speed, rms_map.speed)]
    first, second = (float(axis[0] if value is None else min(max(value, axis[0]), axis[-1])) for value, axis in wanted)
    return first, second


def _track(machine: Machine, source: str, channel: str, first: float | None) -> dict[str, Any]:
    """Return the track of the damage in the final stage, evenly thinned where it is long."""
    names = ("time_s", *_COLUMNS)
    if first is None:
        return {name: [] for name in names}
    found = values_since(machine.store, source, channel, _TRACK, int(first), _MAX_POINTS)
    table = found[np.isfinite(found[:, 3])]
    scaled = [numbers(table[:, place + 1] / FEATURES[name].unit.si) for place, name in enumerate(_TRACK)]
    return dict(zip(names, (times(table[:, 0]), *scaled), strict=True))
