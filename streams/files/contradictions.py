"""Unlisted values against what was judged of a recording: each that contradicts it is a doubt, which quotes both."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from datetime import datetime
from zoneinfo import ZoneInfo

import numpy as np

from streams.files.statements import multiple_of
from streams.types.block import STANDARD_GRAVITY, VELOCITY
from streams.types.samples import RATE_TOLERANCE, Samples, UnlistedStatement
from streams.types.spec import ChannelSpec
from streams.types.stamps import utc_text

_LEVEL_TOLERANCE, _SPEED_TOLERANCE, _LOAD_TOLERANCE, _RANGE_TOLERANCE = 0.01, 0.1, 0.1, 1.05
_MINUTE, _QUARTER, _LONGEST_OFFSET = 60.0, 900.0, 14 * 3600.0
_WORDS = {"rate": "sampling rate", "step": "sampling rate", "speed": "speed of the shaft", "load": "radial load",
          "sensitivity": "sensitivity", "scale": "g of one count", "factor": "level", "gain": "level",
          "range": "level", "fill": "missing samples", "unit": "unit", "quantity": "quantity", "zone": "time zone",
          "end": "end", "start": "start"}  # fmt: skip


def doubts_of(samples: Samples, channels: Sequence[ChannelSpec], zone: str) -> tuple[str, ...]:
    """Return each unlisted value of a recording that contradicts what was judged of it, in words that quote both.

    Args:
        samples: with rate, units and times settled.
        channels: as configured, none for all rows.
        zone: IANA name of the zone of stamps that name none.
    """
    if not samples.unlisted:
        return ()
    agreed = {
        _numberless(one.place)
        for one in samples.unlisted
        if one.fact in ("rate", "step") and not _against(one, samples, channels, zone)
    }
    found = [
        f"{one.place} {one.written!r} bears on the {_WORDS[one.fact]}, {believed}; it is not believed: correct what "
        "is, or name it in [[source]] disregard"
        for one in samples.unlisted
        if _numberless(one.place) not in agreed and (believed := _against(one, samples, channels, zone))
    ]
    return tuple(dict.fromkeys(found))


def _numberless(place: str) -> str:
    return re.sub(r"\d+", "", place)


def _against(one: UnlistedStatement, samples: Samples, channels: Sequence[ChannelSpec], zone: str) -> str:
    """Return what is judged of a fact where an unlisted value contradicts it, "" where it does not."""
    if one.fact in ("rate", "step"):
        return _against_rate(one, samples)
    if one.fact in ("start", "end", "zone"):
        return _against_time(one, samples, zone)
    if one.fact in ("speed", "load"):
        known = {"speed": (samples.speed, samples.stated_speed), "load": (samples.load, samples.stated_load)}[one.fact]
        value = next((value for value in known if value is not None), None)
        tolerance = _SPEED_TOLERANCE if one.fact == "speed" else _LOAD_TOLERANCE
        is_near = value is None or any(abs(reading - value) <= tolerance * value for reading in one.readings)
        unit = "Hz" if one.fact == "speed" else "N"
        return "" if is_near else f"which is {value:.6g} {unit} by the other statements"
    return _against_level(one, samples, channels)


def _against_rate(one: UnlistedStatement, samples: Samples) -> str:
    rate = samples.rate
    if rate is None or any(abs(x - rate) <= RATE_TOLERANCE * rate + 1.01 * one.resolution for x in one.readings):
        return ""
    return f"which is {rate:.8g} Hz by {samples.rate_written or 'the configuration or what stands beside the file'}"


def _against_time(one: UnlistedStatement, samples: Samples, zone: str) -> str:
    """Compare with the start: zones that are not stated may differ, and a head may be written a minute later."""
    start = samples.start
    if start is None or samples.stated is None or not samples.stated.is_stated or samples.stated.source == "count":
        return ""
    if one.fact == "zone":
        own = datetime.fromtimestamp(start, ZoneInfo(zone)).utcoffset()
        offset = 0.0 if own is None else own.total_seconds()
        is_local = samples.stated.source.endswith("_local")
        if not is_local or abs(abs(one.readings[0]) - abs(offset)) < 1.0:
            return ""
        return f"and the start {utc_text(start)} is read in {zone}"
    length = samples.values.shape[1] / samples.known_rate
    time = start + length if one.fact == "end" else start
    lags = [abs(reading - time) for reading in one.readings]
    lags = [lag if lag > _LONGEST_OFFSET else abs(lag - _QUARTER * round(lag / _QUARTER)) for lag in lags]
    if min(lags) <= _MINUTE + length + one.resolution:
        return ""
    return f"which is {utc_text(time)} by its {samples.stated.source.removesuffix('_local')}"


def _against_level(one: UnlistedStatement, samples: Samples, channels: Sequence[ChannelSpec]) -> str:
    """Compare sensitivity, unit, scale, range and what numbers stand for missing samples."""
    volts = [channel.sensitivity_mv_per_g for channel in channels]
    value, bases = one.readings[0] if one.readings else 0.0, {multiple_of(unit)[0] for unit in samples.units}
    if one.fact == "fill":
        return f"and {one.text} samples have this value"
    if one.fact == "range":
        return _against_range(value, samples, channels)
    if one.fact in ("sensitivity", "scale"):
        stated = _sensitivities(samples) if one.fact == "sensitivity" else samples.count_scales
        known = [level for level in (*stated, *(volts if one.fact == "sensitivity" else ())) if level is not None]
        if one.fact == "scale":
            known += [_scale_in_g(channel) for channel in channels if channel.scale is not None]
        if not known or any(math.isclose(value, level, rel_tol=_LEVEL_TOLERANCE) for level in known):
            return ""
        words = ", ".join(f"{level:.6g}" for level in dict.fromkeys(known))
        return f"which is {words}{' mV/g' if one.fact == 'sensitivity' else ''} by the other statements"
    if one.fact == "unit":
        is_other = bases & {"g", "m/s2", VELOCITY} and multiple_of(one.text)[0] not in bases
        return f"and the samples are in {_listed(bases)}" if is_other else ""
    if one.fact == "quantity":
        wanted = {"acceleration": {VELOCITY}, "velocity": {"g", "m/s2"}}[one.text]
        return f"and the samples are in {_listed(bases)}" if bases and bases <= wanted else ""
    return _against_factor(value, samples, channels, bases)


def _against_factor(value: float, samples: Samples, channels: Sequence[ChannelSpec], bases: set[str]) -> str:
    """Return that it is open whether a factor or a gain was applied, "" where a scale is configured or stated."""
    scales = [channel.scale for channel in channels if channel.scale is not None]
    known = [*scales, *_sensitivities(samples), *(level for level in samples.count_scales if level is not None)]
    same = any(math.isclose(value, level, rel_tol=_LEVEL_TOLERANCE) for level in known)
    if same or samples.scaled or scales or bases == {"unknown"}:
        return ""
    return "and nothing says whether it was applied"


def _against_range(value: float, samples: Samples, channels: Sequence[ChannelSpec]) -> str:
    """Return the peak in g of rows beyond the range of the sensor, "" where none is."""
    if any(channel.scale is not None for channel in channels):
        return ""
    sizes = {"g": 1.0, "m/s2": 1.0 / STANDARD_GRAVITY}
    rows = [(row, sizes[unit]) for row, unit in zip(samples.values, samples.units, strict=True) if unit in sizes]
    peak = max((size * float(np.nanmax(np.abs(row))) for row, size in rows if np.isfinite(row).any()), default=0.0)
    return f"and a peak is {peak:.4g} g" if peak > _RANGE_TOLERANCE * value else ""


def _sensitivities(samples: Samples) -> list[float]:
    """Return the sensitivities in mV per g that are stated."""
    return [level.millivolts for level in samples.sensitivities if level is not None and level.unit == "g"]


def _scale_in_g(channel: ChannelSpec) -> float:
    return (channel.scale or 0.0) / (STANDARD_GRAVITY if channel.unit == "m/s2" else 1.0)


def _listed(units: set[str]) -> str:
    return ", ".join(sorted(unit for unit in units if unit))
