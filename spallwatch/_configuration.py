"""The configuration that the arguments of a call stand for."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from models.machine.bearing import Bearing
from monitor.config.fields import plain_name
from monitor.config.load import Config, load_config, validate

SOURCE = "signal"
_NAME = "bearing"
_WHERE = Path("spallwatch")
_LENGTHS = (
    *("element_diameter", "pitch_diameter", "outer_race_radius", "inner_race_radius"),
    *("inner_groove_radius", "outer_groove_radius"),
)
_PLAIN = ("n_elements", "rows", "element", "rotating_ring")


def configuration(
    channels: Sequence[Mapping[str, Any]],
    *,
    bearing: Bearing | str,
    operating: Mapping[str, Any],
    source: Mapping[str, Any] | None = None,
    machine: Mapping[str, Any] | None = None,
) -> Config:
    """Return the configuration of one source.

    Args:
        channels: keys of each ``[[channel]]`` but its source and bearing.
        bearing: geometry or designation.
        operating, source, machine: keys of these sections; those that are None are left out.

    Raises:
        ConfigError: naming the key of each value that is not allowed.
    """
    section = {"designation": bearing} if isinstance(bearing, str) else _geometry(bearing)
    return validate(
        {
            "bearing": [{"name": _NAME, **section}],
            "source": [{"name": SOURCE, **_stated(source or {})}],
            "channel": [{"source": SOURCE, "bearing": _NAME, **_stated(channel)} for channel in channels],
            "operating": _stated(operating),
            "machine": _stated(machine or {}),
        },
        _WHERE,
    )


def plain_names(titles: Sequence[str]) -> list[str]:
    """Return a name that the configuration takes for each title, all different."""
    names: list[str] = []
    for number, title in enumerate(titles, start=1):
        name = plain_name(title) or f"channel_{number}"
        names.append(name if name not in names else f"{name}_{number}")
    return names


def given_configuration(config: Path | str | Mapping[str, Any]) -> Config:
    """Return the configuration in a file, or of its tables; ConfigError as :func:`configuration`."""
    return validate(dict(config), _WHERE) if isinstance(config, Mapping) else load_config(Path(config))


def _stated(values: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in values.items() if value is not None}


def _geometry(bearing: Bearing) -> dict[str, Any]:
    """Return the keys of ``[[bearing]]`` of a geometry."""
    values: dict[str, Any] = {name: getattr(bearing, name) for name in _PLAIN}
    values |= {f"{name}_mm": 1e3 * length for name in _LENGTHS if (length := getattr(bearing, name)) is not None}
    if bearing.effective_length is not None:
        values["element_length_mm"] = 1e3 * bearing.effective_length
    return values | {"contact_angle_deg": math.degrees(bearing.contact_angle)}
