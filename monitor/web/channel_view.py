"""Answers of the HTTP API about a channel: spectra and waveforms of blocks, and its RMS map; called in threads."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from monitor.health.schema import DOMAINS
from monitor.health.signal.cyclic import kept_coherence
from monitor.health.signal.settings import shared_lines
from monitor.health.signal.spectra import BlockView
from monitor.health.signal.waterfall import SpectrumRow
from monitor.health.tracker import part_of
from monitor.records.queries import is_dated, values_since
from monitor.records.spectra import (
    binned,
    in_orders,
    kept_blocks,
    read_block_view,
    read_ias,
    read_kurtogram,
    read_spectra,
    viewed_blocks,
)
from monitor.service.summary import weakest_calibration
from monitor.web.answers import Query, RequestError, numbers, optional_number, times, whole_number
from monitor.web.api import calibration, latest_values
from monitor.web.machines import WatchedMachine
from monitor.words.features import FEATURES

if TYPE_CHECKING:
    from models.machine.scene import Part
    from models.maps.data import RmsMap

_BINS = 300


def spectrum(machine: WatchedMachine, channel: str, query: Query) -> dict[str, Any]:
    """Return the spectrum of one block, by default the newest, and the blocks with a spectrum; 404 without one."""
    section = machine.channel(channel)
    block = whole_number(query, "block", 0, 0, 2**62)
    found = read_spectra(machine.store, channel, source=section.source, at=block or None, newest=1)
    if not found:
        raise RequestError(404, "no spectrum is kept of this block" if block else "no spectrum is kept yet")
    row = found[0]
    factor = _in_g(row)
    return {
        "block": row.sequence,
        "time_s": row.time,
        "resolution_hz": row.resolution,
        "band_hz": list(row.band),
        **_rotation(row),
        "domain": row.domain,
        "mean_g": row.mean * factor,
        "unit": "g" if row.absolute else "unknown",
        "amplitude_g": numbers(row.amplitude * factor, 4),
        "lines_hz": dict(row.lines),
        "shared_lines": _shared(row, row.resolution),
        "blocks": [number for number, _ in kept_blocks(machine.store, channel, source=section.source)],
    }


def raw(machine: WatchedMachine, channel: str, query: Query) -> dict[str, Any]:
    """Return the raw spectrum of one block, by default the newest with one; 404 without one."""
    row, view = _view(machine, channel, query)
    factor, spectra = _in_g(row), view.spectra
    return {
        **_about(row, view),
        "resolution_hz": spectra.resolution,
        "amplitude_g": numbers(spectra.amplitude * factor, 4),
        "width_hz": spectra.width,
        "highest_g": numbers(spectra.highest * factor, 4),
        "shared_lines": _shared(row, spectra.resolution),
        "blocks": viewed_blocks(machine.store, channel, source=row.source),
    }


def ias(machine: WatchedMachine, channel: str, query: Query) -> dict[str, Any]:
    """Return the latest spectrum of the angular speed, of a block or before it; 404 without one."""
    section = machine.channel(channel)
    block = whole_number(query, "block", 0, 0, 2**62)
    row = read_ias(machine.store, section.source, until=block or None)
    found = None if row is None or row.view is None else row.view.ias
    if row is None or row.view is None or found is None:
        raise RequestError(404, "no spectrum of the angular speed is kept yet")
    # It belongs to the source; the lines are those of the bearing of the channel that is asked for.
    own = read_spectra(machine.store, channel, source=section.source, at=row.sequence) or [row]
    return {
        **_about(own[0], row.view),
        "unit": "rad/s",
        "resolution_order": found.resolution,
        "amplitude_rad_s": numbers(found.amplitude, 4),
        "width_order": found.width,
        "highest_rad_s": numbers(found.highest, 4),
    }


def cyclic(machine: WatchedMachine, channel: str, query: Query) -> dict[str, Any]:
    """Return the mean coherence of the kept samples of a block by cyclic order; 404 where they do not give one."""
    row, view = _view(machine, channel, query)
    try:
        found = kept_coherence(row)
    except ValueError as error:
        raise RequestError(404, str(error)) from None
    return {
        **_about(row, view),
        "cyclic_order": numbers(found.cyclic, 6),
        "coherence": numbers(found.enhanced, 4),
        "limit": found.limit,
        "band_hz": list(found.band),
        "blocks": viewed_blocks(machine.store, channel, source=row.source),
    }


def waveform(machine: WatchedMachine, channel: str, query: Query) -> dict[str, Any]:
    """Return the beginning of the waveform of one block, by default the newest with one; 404 without one."""
    row, view = _view(machine, channel, query)
    if not view.waveform.size:
        raise RequestError(404, "the waveform of this block was given up for max_gb")
    return {
        **_about(row, view),
        "waveform_g": numbers(view.waveform * _in_g(row), 5),
        "blocks": viewed_blocks(machine.store, channel, source=row.source),
    }


def _view(machine: WatchedMachine, channel: str, query: Query) -> tuple[SpectrumRow, BlockView]:
    section = machine.channel(channel)
    block = whole_number(query, "block", 0, 0, 2**62)
    row = read_block_view(machine.store, channel, source=section.source, at=block or None)
    if row is None or row.view is None:
        raise RequestError(404, "nothing is kept of the samples of this block" if block else "no samples are kept yet")
    return row, row.view


def _about(row: SpectrumRow, view: BlockView) -> dict[str, Any]:
    return {
        "block": row.sequence,
        "time_s": row.time,
        "rate_hz": view.rate,
        "samples": view.samples,
        "unit": "g" if row.absolute else "unknown",
        **_rotation(row),
        "lines_hz": dict(row.lines),
    }


def _rotation(row: SpectrumRow) -> dict[str, Any]:
    """Return the speeds in the block; ``speed_course_hz`` is at equal steps from its beginning to its end."""
    return {
        "speed_hz": row.speed,
        "speed_range_hz": None if row.speed_range is None else list(row.speed_range),
        "speed_course_hz": None if row.speed_course is None else list(row.speed_course),
    }


def _shared(row: SpectrumRow, resolution: float) -> list[list[list[str | int]]]:
    return [[list(line) for line in group] for group in shared_lines(row.lines, resolution)]


def kurtogram(machine: WatchedMachine, channel: str, query: Query) -> dict[str, Any]:
    """Return the latest kurtogram, of a block or before it; 404 without one."""
    section = machine.channel(channel)
    block = whole_number(query, "block", 0, 0, 2**62)
    row = read_kurtogram(machine.store, channel, source=section.source, until=block or None)
    if row is None or row.kurtogram is None:
        raise RequestError(404, "no kurtogram is kept yet")
    found = row.kurtogram
    best = found.best()
    return {
        "block": row.sequence,
        "time_s": row.time,
        "nyquist_hz": found.nyquist,
        "kurtosis": [list(level) for level in found.levels],
        "noise": numbers(np.array([found.noise_limit(level) for level in range(len(found.levels))])),
        "band_hz": list(row.band),
        "best_hz": None if best is None else list(found.band(*best)),
    }


def waterfall(machine: WatchedMachine, channel: str, query: Query) -> dict[str, Any]:
    """Return all spectra over common bins of frequency or order: the highest amplitude in each."""
    section = machine.channel(channel)
    bins = whole_number(query, "bins", _BINS, 10, 2000)
    highest = optional_number(query, "to_hz")
    if highest is not None and highest <= 0.0:
        raise RequestError(400, "to_hz must be above 0")
    axis = query.get("axis", "auto" if highest is None else "hertz")
    if axis not in ("auto", *DOMAINS) or (axis == "order" and highest is not None):
        raise RequestError(400, f"axis must be auto, {' or '.join(DOMAINS)}, and hertz with to_hz")
    rows = read_spectra(machine.store, channel, source=section.source)
    # One scale for all: a sensor whose unit became known begins anew.
    rows = [row for row in rows if row.absolute == rows[-1].absolute and row.amplitude.size]
    if not rows:
        return {"unit": "g", "time_s": [], "blocks": [], "domain": "hertz", "frequency_hz": [], "amplitude_g": []}
    found = in_orders(rows)
    orders = found if axis == "auto" else axis == "order"
    if orders and not all(row.speed > 0.0 for row in rows):
        raise RequestError(400, "the speed is not known for all spectra: there is no axis of orders")
    edges, amplitude = binned(rows, bins, highest, orders=orders)
    return {
        "unit": "g" if rows[-1].absolute else "unknown",
        "time_s": [row.time for row in rows],
        "blocks": [row.sequence for row in rows],
        "speed_hz": [row.speed for row in rows],
        "domain": "order" if orders else "hertz",
        "varies": found,
        "order" if orders else "frequency_hz": numbers(np.asarray(edges)),
        "amplitude_g": [numbers(line * _in_g(rows[-1]), 4) for line in np.asarray(amplitude)],
    }


def newest_block(machine: WatchedMachine, channel: str) -> int | None:
    """Return the number of the newest block of which a spectrum is kept, or None."""
    section = machine.channel(channel)
    found = read_spectra(machine.store, channel, source=section.source, newest=1)
    return found[-1].sequence if found else None


def _in_g(row: SpectrumRow) -> float:
    return FEATURES["rms"].of_si(absolute=row.absolute)


_MAX_POINTS = 2000
_MAX_MAPS = 16
_TRACK = ("dphi_d", "h_d", "v_eq")
_COLUMNS = ("dphi_deg", "h_d_um", "v_eq_mm2")
_lock = threading.Lock()
_maps: dict[tuple[Path, int, int], RmsMap] = {}


def map_of(machine: WatchedMachine, channel: str, _: Query) -> dict[str, Any]:
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


def _nearest(rms_map: RmsMap, machine: WatchedMachine, latest: Mapping[str, float]) -> tuple[float, float]:
    """Return load and speed of the latest record, or as configured, limited to the map."""
    operating = machine.config.operating
    load = latest.get("load", operating.load_newton)
    speed = latest.get("speed", operating.speed_hz)
    wanted = [(load, rms_map.load), (speed, rms_map.speed)]
    first, second = (float(axis[0] if value is None else min(max(value, axis[0]), axis[-1])) for value, axis in wanted)
    return first, second


def _track(machine: WatchedMachine, source: str, channel: str, first: float | None) -> dict[str, Any]:
    """Return the track of the damage in the final stage, evenly thinned where it is long."""
    names = ("time_s", *_COLUMNS)
    if first is None:
        return {name: [] for name in names}
    found = values_since(machine.store, source, channel, _TRACK, int(first), _MAX_POINTS)
    table = found[np.isfinite(found[:, 3])]
    scaled = [numbers(table[:, place + 1] / FEATURES[name].unit.si) for place, name in enumerate(_TRACK)]
    return dict(zip(names, (times(table[:, 0]), *scaled), strict=True))
