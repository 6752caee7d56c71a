"""The JSON header of a frame, checked, and the error of bytes that break the protocol."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

from models.words.errors import SpallwatchError
from streams.files.pulse_times import MAX_PER_REVOLUTION
from streams.types.spec import UNITS
from streams.types.times import TIME_SOURCES, TimeStatement

MAX_SEQUENCE = 2**63 - 1
_SPEED_HZ = (1e-3, 1e4)
_LOAD_NEWTON = (0.0, 1e9)
_ELAPSED_S = (0.0, 1e10)
_RESOLUTION_S = (0.0, 86400.0)
_NANOSECOND = 1e-9


class WireError(SpallwatchError):
    """Bytes break the protocol; the message states what was expected and received.

    ``status`` is a rejection status of the interface. ``sequence`` is the number of the frame where its checksum is
    right, else None: then not even its length is reliable, and a connection must be closed.
    """

    def __init__(self, reason: str, status: str = "unreadable", sequence: int | None = None) -> None:
        """Keep status and sequence beside the message."""
        super().__init__(reason)
        self.status = status
        self.sequence = sequence


def _refuse_constant(word: str) -> None:
    raise ValueError(f"{word} is not JSON")


def header_of(text: bytes) -> dict[str, Any]:
    """Return the JSON object of a header; WireError where it is none."""
    try:
        header = json.loads(text.decode(), parse_constant=_refuse_constant)
    except (ValueError, RecursionError) as error:
        raise WireError(f"the header is not JSON: {type(error).__name__}: {error}") from None
    if not isinstance(header, dict):
        raise WireError(f"the header must be a JSON object, got {type(header).__name__}")
    return header


def stated_frame(header: Mapping[str, Any], channels: int) -> dict[str, Any]:
    """Return what a header states of the frame: scale, frame before, number of pulses."""
    return {"scale": _scale(header, channels), "after": _whole(header, "after"), "pulses": _whole(header, "pulses")}


def per_revolution_of(header: Mapping[str, Any]) -> int | None:
    """Return the pulses a revolution that a header states, or None; WireError where they are not from 1 to 10^6."""
    found = _whole(header, "pulses_per_revolution")
    if found is not None and not 1 <= found <= MAX_PER_REVOLUTION:
        raise WireError(f"pulses_per_revolution must be a whole number from 1 to {MAX_PER_REVOLUTION}, got {found}")
    return found


def stated_rows(header: Mapping[str, Any], channels: int) -> dict[str, Any]:
    """Return what a header states of the samples."""
    names = _words(header, "channels", channels)
    if len(set(names)) != channels or not all(name and name.isprintable() for name in names):
        raise WireError(f"channels must be different printable names, got {names!a}", "wrong_shape")
    units = _words(header, "units", channels)
    unknown = [unit for unit in units if unit not in UNITS]
    if unknown:
        raise WireError(f"units must be of {', '.join(UNITS)}, got {unknown[0]!a}", "wrong_unit")
    return {
        "channels": names,
        "units": units,
        "speed": _number(header, "speed_hz", _SPEED_HZ),
        "load": _number(header, "load_newton", _LOAD_NEWTON),
        "elapsed": _number(header, "elapsed_s", _ELAPSED_S),
        "pulses_per_revolution": per_revolution_of(header),
        "stated": _time_statement(header),
    }


def time_keys(stated: TimeStatement | None) -> dict[str, Any]:
    """Return the keys of a header that say what states the start of a frame."""
    if stated is None:
        return {}
    return {
        "time_source": stated.source,
        "time_resolution_s": stated.resolution,
        "time_repeated_s": stated.repeated_s or None,
        "time_skipped_s": stated.skipped_s or None,
    }


def _time_statement(header: Mapping[str, Any]) -> TimeStatement:
    source = header.get("time_source")
    if source is None:
        return TimeStatement("frame", _NANOSECOND)
    if source not in TIME_SOURCES:
        raise WireError(f"time_source must be one of {', '.join(TIME_SOURCES)}, got {source!a:.40}")
    return TimeStatement(
        source,
        _number(header, "time_resolution_s", _RESOLUTION_S),
        _number(header, "time_repeated_s", _RESOLUTION_S) or 0.0,
        _number(header, "time_skipped_s", _RESOLUTION_S) or 0.0,
    )


def _words(header: Mapping[str, Any], key: str, channels: int) -> tuple[str, ...]:
    values = header.get(key)
    if not isinstance(values, list) or len(values) != channels or not all(isinstance(value, str) for value in values):
        raise WireError(f"{key} must be a list of {channels} words", "wrong_shape")
    return tuple(values)


def _scale(header: Mapping[str, Any], channels: int) -> tuple[float, ...]:
    values = header.get("scale")
    if values is None:
        return (1.0,) * channels
    if not isinstance(values, list):
        values = [values] * channels
    if len(values) != channels or not all(_is_number(value) and float(value) != 0.0 for value in values):
        raise WireError(f"scale must be one number or {channels}, finite and not 0", "wrong_unit")
    return tuple(float(value) for value in values)


def _number(header: Mapping[str, Any], key: str, limits: tuple[float, float]) -> float | None:
    value = header.get(key)
    if value is None:
        return None
    if not _is_number(value) or not limits[0] <= value <= limits[1]:
        found = f"{value:g}" if _is_number(value) else type(value).__name__
        raise WireError(f"{key} must be a number from {limits[0]:g} to {limits[1]:g}, got {found}")
    return float(value)


def _whole(header: Mapping[str, Any], key: str) -> int | None:
    value = header.get(key)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= MAX_SEQUENCE:
        raise WireError(f"{key} must be a whole number from 0 to {MAX_SEQUENCE}")
    return value


def _is_number(value: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    try:
        return math.isfinite(float(value))
    except OverflowError:
        return False
