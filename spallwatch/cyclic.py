"""Spectral coherence of a signal over the orders of its shaft."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from models.machine.bearing import Bearing, kinematics
from monitor.health.spectrum.cyclic import RESOLUTION, CyclicCoherence
from monitor.health.spectrum.cyclic_study import CyclicStudy, cyclic_study, known_rotation
from monitor.health.spectrum.settings import fundamentals
from monitor.report.figures.cyclic import cyclic_sheet
from monitor.report.figures.sheet import compose
from spallwatch.analysis import SignalError, signal_of
from spallwatch.bearings import bearing as bearing_named


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
    if given.sizes["channel"] != 1:
        names = ", ".join(map(str, given.channel.values))
        raise SignalError(f"expected one channel, got {names}; choose one: signal.sel(channel=[...])")
    known = bearing_named(bearing) if isinstance(bearing, str) else bearing
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
    order = xr.Variable("order", found.cyclic, {"units": "1", "long_name": "events per revolution"})
    frequency = xr.Variable("frequency", found.frequency, {"units": "Hz", "long_name": "frequency"})
    enhanced = xr.Variable("order", found.enhanced, {"units": "1", "long_name": "mean squared coherence"})
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


def plot_cyclic(coherence: xr.DataArray, bearing: Bearing | str) -> Figure:
    """Return a map of the coherence and the enhanced envelope spectrum, with the lines of a bearing."""
    known = bearing_named(bearing) if isinstance(bearing, str) else bearing
    about = coherence.attrs
    found = CyclicCoherence(
        "order",
        coherence.order.values,
        coherence.frequency.values,
        coherence.values,
        tuple(about["band_hz"]),
        coherence.enhanced.values,
        about["limit"],
    )
    orders = fundamentals(kinematics(known, 1.0))
    facts = [("Speed", f"{about['speed_min_hz']:.4g} to {about['speed_max_hz']:.4g} Hz")]
    return compose(cyclic_sheet(found, orders, facts, f"Cyclic coherence, {known.designation}"))
