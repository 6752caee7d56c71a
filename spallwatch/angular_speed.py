"""The angular speed of a shaft, from the pulses of an encoder."""

from __future__ import annotations

from typing import Literal

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from monitor.health.rotation.ias_study import study
from monitor.health.rotation.settings import TachoSettings
from spallwatch.analysis import SignalError
from streams.tacho import edge_times


def ias_spectrum(
    pulses: xr.DataArray | ArrayLike,
    *,
    pulses_per_revolution: int,
    tacho_missing_teeth: int = 0,
    tacho_ratio: float = 1.0,
    tacho_level: float | None = None,
    tacho_edge: Literal["rising", "falling"] = "rising",
    clock_hz: float | None = None,
    remove_wheel: bool = False,
) -> xr.DataArray:
    """Return the amplitude spectrum of a shaft's angular speed over events per revolution.

    Single-sided, with a Hann window, of the relative change of the speed times its mean. What varies over more than
    eight turns is divided out first. The error of the marks stands on whole multiples of the wheel, where it cannot be
    told from what turns with it.

    Args:
        pulses: times, s, or a signal of one channel of ``read`` or ``to_signal``, whose edges are taken.
        pulses_per_revolution: marks of a whole turn, missing teeth included.
        tacho_missing_teeth: consecutive teeth that the wheel lacks once a turn.
        tacho_ratio: turns of the bearing's shaft per turn of the shaft with the marks.
        tacho_level, tacho_edge: of a pulse in a signal; by default half way between its levels.
        clock_hz: of the counter that gave the times.
        remove_wheel: take out what repeats with each turn of the wheel.

    Returns:
        Dimension (order), rad/s and events per revolution of the bearing's shaft; attributes ``speed_hz``, ``turns``,
        ``pulses_missing``, ``pulses_extra``, ``timing_noise_s`` (standard deviation of the time of a pulse) and
        ``wheel_error_deg`` (what repeats each turn, RMS) with its standard error ``wheel_error_sd_deg``.

    Raises:
        SignalError: fewer than 16 marks a turn or 16 turns, or pulses that do not follow one speed.
    """
    if isinstance(pulses, xr.DataArray) and "rate_hz" in pulses.attrs:
        if pulses.sizes.get("channel", 1) != 1:
            names = ", ".join(map(str, pulses.channel.values))
            raise SignalError(f"pulses: expected one channel, got {names}; choose one: signal.sel(channel=[...])")
        times = edge_times(
            pulses.values.reshape(-1), pulses.attrs["rate_hz"], tacho_level, falling=tacho_edge == "falling"
        )
    else:
        times = np.asarray(pulses, dtype=np.float64)
        if times.ndim != 1 or not np.all(np.isfinite(times)) or np.any(np.diff(times) < 0.0):
            raise SignalError(f"pulses: expected finite times that never fall, (pulse,), got shape {times.shape}")
    try:
        found = study(
            times,
            TachoSettings(per_revolution=pulses_per_revolution, missing_teeth=tacho_missing_teeth, ratio=tacho_ratio),
            resolution=0.0 if clock_hz is None else 1.0 / clock_hz,
            remove_wheel=remove_wheel,
        )
    except ValueError as error:
        raise SignalError(f"pulses: {error}") from None
    spectrum, wheel = found.spectrum, found.wheel
    order = xr.Variable("order", spectrum.orders, {"units": "1", "long_name": "events per revolution"})
    return xr.DataArray(
        spectrum.amplitude,
        dims=("order",),
        coords={"order": order},
        name="angular_speed",
        attrs={
            "units": "rad s-1",
            "long_name": "amplitude of the angular speed",
            "speed_hz": spectrum.mean_speed,
            "turns": spectrum.turns,
            "pulses_missing": found.missing,
            "pulses_extra": found.extra,
            "timing_noise_s": spectrum.timing_noise,
            "wheel_error_deg": 360.0 * wheel.rms,
            "wheel_error_sd_deg": 360.0 * wheel.rms_error,
        },
    )
