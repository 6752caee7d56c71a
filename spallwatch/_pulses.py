"""The pulses of a tacho that go with a signal."""

from __future__ import annotations

from typing import TypedDict

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from models.words.errors import WrongInputError
from streams.pulses import Pulses
from streams.tacho import edge_times


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
