"""Spectra over the angle of a shaft whose speed varies: of a signal, of the angular speed, and cyclic coherence."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, Unpack

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from models.machine.bearing import Bearing
from monitor.health.signal.cyclic import RESOLUTION, CyclicStudy, cyclic_study, known_rotation
from monitor.health.signal.orders import order_spectrum as spectrum_of
from monitor.health.signal.orders import warp_or_error
from monitor.health.signal.rotation.fit import rotation_of, rotation_of_speed
from monitor.health.signal.rotation.ias import study
from monitor.health.signal.rotation.repair import repaired
from monitor.health.signal.rotation.rotation import Rotation, TachoSettings, constant
from monitor.health.signal.transform import BlockTransform
from spallwatch._arguments import Tacho, with_pulses
from spallwatch.analysis import SignalError, refuse_several, signal_of
from spallwatch.bearings import as_bearing
from streams.turns.tacho import edge_times


@dataclass(frozen=True)
class _ChannelSpectrum:
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


def _over_order(values: NDArray[np.floating], name: str = "events per revolution") -> xr.Variable:
    return xr.Variable("order", values, {"units": "1", "long_name": name})


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
) -> _ChannelSpectrum:
    """Return the spectrum of one channel; ValueError where it cannot be had."""
    if band is None:
        whole = spectrum_of(np.asarray(samples, dtype=np.float64), rate, rotation, max_order)
        return _ChannelSpectrum(whole.step, whole.amplitude, whole.mean)
    warp_or_error(rotation, samples.size / rate)
    found = BlockTransform(samples.size, rate, [band], raw_limit=0.0, precision="float64")(samples, rotation=rotation)
    envelope = found.envelopes[0]
    step = envelope.resolution / rotation.mean_speed
    count = envelope.amplitude.size if max_order is None else math.floor(max_order / step) + 1
    return _ChannelSpectrum(step, envelope.amplitude[:count], envelope.mean)


def _over_orders(
    signal: xr.DataArray, rows: list[_ChannelSpectrum], rotation: Rotation, band: tuple[float, float] | None
) -> xr.DataArray:
    amplitude = np.stack([row.amplitude for row in rows])
    order = _over_order(np.arange(amplitude.shape[1]) * rows[0].step)
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
        refuse_several(pulses, "pulses: expected one channel, got")
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
    order = _over_order(spectrum.orders)
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


def cyclic_coherence(
    signal: xr.DataArray | ArrayLike,
    *,
    bearing: Bearing | str,
    speed_hz: float | tuple[float, float] | None = None,
    pulses_s: ArrayLike | None = None,
    pulses_per_revolution: int = 1,
    band_hz: tuple[float, float] | None = None,
    resolution_hz: float = RESOLUTION,
    rate_hz: float | None = None,
    unit: str | None = None,
) -> xr.DataArray:
    """Return the squared spectral coherence of a signal, by frequency and cyclic order of the shaft.

    Args:
        signal, rate_hz, unit: as in ``spectrum``, of one channel.
        bearing: geometry, or a designation of the catalogue; orders reach to the fourth line of its inner race.
        speed_hz: of a steady shaft, by default what the recording states; or the lowest and the highest speed,
            between which the angle of the shaft is found in the vibration.
        pulses_s: times of the pulses of a tacho, s from the first sample, instead of a speed.
        pulses_per_revolution: pulses of a turn.
        band_hz: frequencies over which the coordinate ``enhanced`` is averaged, by default all.
        resolution_hz: about the spacing of the frequencies; one over it must be shorter than from impact to impact.

    Returns:
        Dimensions (frequency, order), Hz and events per revolution; 0 for noise, at most about 1. Coordinate
        ``enhanced`` (order): the enhanced envelope spectrum. Attributes: ``limit`` (stationary noise exceeds it
        anywhere in 1 % of signals), ``speed_hz``, ``speed_min_hz``, ``speed_max_hz``, ``turns_sd``.

    Raises:
        SignalError: several channels, a signal that is too short, or no angle of the shaft.
    """
    given = signal_of(signal, rate_hz, unit)
    refuse_several(given, "expected one channel, got")
    known = as_bearing(bearing)
    rate, samples = float(given.attrs["rate_hz"]), given.values[0]
    limits = speed_hz if isinstance(speed_hz, tuple) else None
    speed = given.attrs.get("speed_hz") if speed_hz is None or isinstance(speed_hz, tuple) else speed_hz
    times = None if pulses_s is None else np.asarray(pulses_s, dtype=np.float64)
    try:
        rotation = known_rotation(samples, rate, known, speed, limits, times, pulses_per_revolution)
        study = cyclic_study(samples, rate, known, rotation, band_hz, resolution_hz)
    except ValueError as error:
        raise SignalError(f"signal: {error}") from None
    return _to_array(study)


def _to_array(study: CyclicStudy) -> xr.DataArray:
    found, rotation = study.found, study.rotation
    order = _over_order(found.cyclic)
    frequency = xr.Variable("frequency", found.frequency, {"units": "Hz", "long_name": "frequency"})
    enhanced = _over_order(found.enhanced, "mean squared coherence")
    low, high = rotation.speed_range
    return xr.DataArray(
        found.coherence,
        dims=("frequency", "order"),
        coords={"frequency": frequency, "order": order, "enhanced": enhanced},
        name="coherence",
        attrs={
            "units": "1",
            "long_name": "squared spectral coherence",
            "limit": found.limit,
            "band_hz": list(found.band),
            "turns": rotation.turned,
            "speed_hz": rotation.mean_speed,
            "speed_min_hz": low,
            "speed_max_hz": high,
            "turns_sd": rotation.turns_sd,
        },
    )
