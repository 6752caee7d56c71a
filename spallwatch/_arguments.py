"""The configuration that the arguments of a call stand for."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypedDict

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from models.machine.bearing import Bearing
from models.words.errors import WrongInputError
from monitor.config.fields import plain_name
from monitor.config.load import Config, load_config, validate
from streams.turns.pulses import Pulses
from streams.turns.tacho import edge_times

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


class Tacho(TypedDict, total=False):
    """How the angle of the shaft is known.

    Attributes:
        tacho_channel: channel of the signal that holds the pulses; it is no vibration.
        pulse_times_s: or times of the pulses, s from the first sample; by default those that the recording has.
        pulses_per_revolution: of a whole turn of the shaft, 1 where neither given nor stated.
    """

    tacho_channel: str
    pulse_times_s: ArrayLike
    pulses_per_revolution: int


class PulsesError(WrongInputError):
    """Pulses that do not go with a signal; the message says what was expected and what came."""


def with_pulses(signal: xr.DataArray, tacho: Tacho) -> tuple[xr.DataArray, Pulses | None]:
    """Return the vibration of a signal, (channel, time), and its pulses, None without any.

    Raises:
        PulsesError: two sources of pulses, no such channel, or times that are not finite or fall.
    """
    wrong = sorted(set(tacho) - set(Tacho.__annotations__))
    if wrong:
        raise TypeError(f"{wrong[0]!r} is not an argument; expected {', '.join(Tacho.__annotations__)}")
    name = tacho.get("tacho_channel")
    times = tacho.get("pulse_times_s")
    if name is not None and times is not None:
        raise PulsesError("expected one of tacho_channel, pulse_times_s, got both")
    if name is not None:
        names = [str(found) for found in signal.channel.values]
        if name not in names or len(names) < 2:
            raise PulsesError(
                f"tacho_channel: {name!r} is not beside another channel of the signal: {', '.join(names)}"
            )
        times = edge_times(signal.values[names.index(name)], float(signal.attrs["rate_hz"]))
        signal = signal.sel(channel=signal.channel != name)
    if times is None:
        times = signal.attrs.get("pulse_times_s")
        if times is None:
            return signal, None
        # A part of a block begins later.
        times = np.asarray(times, dtype=np.float64) - float(signal.time.values[0])
        end = signal.sizes["time"] / float(signal.attrs["rate_hz"])
        times = times[(times >= 0.0) & (times < end)]
    marks = tacho.get("pulses_per_revolution", signal.attrs.get("pulses_per_revolution", 1))
    try:
        return signal, Pulses(np.asarray(times, dtype=np.float64), marks)
    except ValueError as error:
        raise PulsesError(f"pulse_times_s: {error}") from None
