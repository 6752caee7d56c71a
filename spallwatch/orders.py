"""Spectra over the angle of a shaft whose speed varies."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Unpack

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from monitor.health.rotation.fit import rotation_of
from monitor.health.rotation.profile import rotation_of_speed
from monitor.health.rotation.repair import repaired
from monitor.health.rotation.rotation import Rotation, constant
from monitor.health.spectrum.orders import order_spectrum as spectrum_of
from monitor.health.spectrum.orders import warp_or_error
from monitor.health.spectrum.transform import BlockTransform
from spallwatch._pulses import Tacho, with_pulses
from spallwatch.analysis import SignalError, signal_of


@dataclass(frozen=True)
class _Row:
    """The spectrum of one channel: spacing in orders, amplitudes, and the mean of what was transformed."""

    step: float
    amplitude: NDArray[np.floating]
    mean: float


def order_spectrum(
    signal: xr.DataArray | ArrayLike,
    *,
    speed_hz: ArrayLike | None = None,
    tacho_missing_teeth: int = 0,
    tacho_ratio: float = 1.0,
    band_hz: tuple[float, float] | None = None,
    max_order: float | None = None,
    rate_hz: float | None = None,
    unit: str | None = None,
    **tacho: Unpack[Tacho],
) -> xr.DataArray:
    """Return the amplitude spectrum of a signal, or of the envelope of a band, over orders of the shaft.

    The signal is resampled at equal steps of angle at its full rate: a line of constant order reads its amplitude
    within 1e-3 up to 0.4 of the samples in the fastest revolution.

    Args:
        signal, rate_hz, unit: as in ``spectrum``.
        speed_hz: of the shaft: a number, or at equal steps from the first to the last sample.
        tacho: or pulses, as in ``features``; a turn of the wheel, missing teeth included, has so many.
        tacho_missing_teeth: consecutive teeth that the wheel lacks.
        tacho_ratio: turns of the shaft per turn of the wheel.
        band_hz: the envelope of this band is transformed instead of the signal.
        max_order: highest order; by default all that are below half of the sampling rate at every speed.

    Returns:
        Dimensions (channel, order), the channel of the tacho left out; ``order`` is events per revolution. Attributes:
        ``revolutions``, ``mean_speed_hz``, ``speed_min_hz``, ``speed_max_hz``. With a band, ``envelope_mean`` is a
        coordinate.

    Raises:
        SignalError: no angle, or two; its pulses are too few, irregular, or the shaft stops; the speed varies by more
            than a factor of 6; or as ``spectrum``.
        PulsesError: the pulses do not go with the signal.
    """
    given = signal_of(signal, rate_hz, unit)
    rate, samples = float(given.attrs["rate_hz"]), given.sizes["time"]
    given, pulses = with_pulses(given, tacho)
    if speed_hz is not None:
        if tacho:
            raise SignalError(f"expected pulses or speed_hz, got both: {', '.join(tacho)}")
        rotation = _of_speed(np.asarray(speed_hz, dtype=np.float64), samples, rate)
    elif pulses is None:
        raise SignalError("expected speed_hz, tacho_channel or pulse_times_s, got none; the recording has no pulses")
    else:
        resolution = 1.0 / rate if "tacho_channel" in tacho else 0.0
        marks = pulses.per_revolution or 1
        found = repaired(pulses.times, samples / rate, marks, tacho_missing_teeth, resolution)
        if found.train is None:
            raise SignalError(f"{found.status}: {pulses.times.size} pulses in {samples / rate:g} s give no angle")
        rotation = rotation_of(found.train, samples / rate, tacho_ratio)
    try:
        rows = [_row(row, rate, rotation, band_hz, max_order) for row in given.values]
    except ValueError as error:
        raise SignalError(f"signal: {error}") from None
    return _over_orders(given, rows, rotation, band_hz)


def _of_speed(speed: NDArray[np.float64], samples: int, rate: float) -> Rotation:
    """Return the angle of a shaft of a speed, shape () or (n,), Hz."""
    duration = samples / rate
    if not (np.all(np.isfinite(speed)) and np.all(speed > 0.0) and speed.ndim <= 1 and speed.size):
        raise SignalError("speed_hz: expected a positive number, or positive numbers of shape (n,)")
    if speed.size == 1:
        return constant(float(speed.reshape(-1)[0]), duration)
    at = np.linspace(0.0, (samples - 1) / rate, speed.size)
    rotation, status = rotation_of_speed(np.interp(np.arange(samples) / rate, at, speed), rate)
    if rotation is None:
        raise SignalError(f"speed_hz: {status}: {speed.size} speeds over {duration:g} s give no angle")
    return rotation


def _row(
    samples: NDArray[np.number],
    rate: float,
    rotation: Rotation,
    band: tuple[float, float] | None,
    max_order: float | None,
) -> _Row:
    """Return the spectrum of one channel; ValueError where it cannot be had."""
    if band is None:
        whole = spectrum_of(np.asarray(samples, dtype=np.float64), rate, rotation, max_order)
        return _Row(whole.step, whole.amplitude, whole.mean)
    warp_or_error(rotation, samples.size / rate)
    found = BlockTransform(samples.size, rate, [band], raw_limit=0.0, precision="float64")(samples, rotation=rotation)
    envelope = found.envelopes[0]
    step = envelope.resolution / rotation.mean_speed
    count = envelope.amplitude.size if max_order is None else math.floor(max_order / step) + 1
    return _Row(step, envelope.amplitude[:count], envelope.mean)


def _over_orders(
    signal: xr.DataArray, rows: list[_Row], rotation: Rotation, band: tuple[float, float] | None
) -> xr.DataArray:
    amplitude = np.stack([row.amplitude for row in rows])
    attributes = {"units": "1", "long_name": "events per revolution"}
    order = xr.Variable("order", np.arange(amplitude.shape[1]) * rows[0].step, attributes)
    low, high = rotation.speed_range
    found = xr.DataArray(
        amplitude,
        dims=("channel", "order"),
        coords={"channel": signal.channel, "order": order},
        name="amplitude",
        attrs={
            "units": signal.attrs["units"],
            "long_name": f"amplitude of the {'' if band is None else 'envelope '}spectrum over orders",
            "revolutions": rotation.turned,
            "mean_speed_hz": rotation.mean_speed,
            "speed_min_hz": low,
            "speed_max_hz": high,
        },
    )
    if band is None:
        return found
    found.attrs["band_hz"] = [float(edge) for edge in band]
    mean = xr.Variable("channel", [row.mean for row in rows], {"units": signal.attrs["units"]})
    return found.assign_coords(envelope_mean=mean)
