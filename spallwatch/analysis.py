"""What one signal says: spectra, features, and the damaged part by name."""

from __future__ import annotations

import math
from typing import Any, Unpack

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from models.machine.bearing import Bearing
from models.words.errors import WrongInputError
from monitor.health.name.naming import Naming
from monitor.health.record import Record
from monitor.health.signal.differentiate import USUAL_LIMIT, acceleration_of
from monitor.health.signal.transform import MIN_SAMPLES, BlockTransform
from monitor.pipeline import Pipeline, SourceOutput
from monitor.records.dataset import to_dataset
from monitor.records.filing import Filing, Stored
from monitor.records.packing import pack
from monitor.service.setup import source_settings
from spallwatch._arguments import SOURCE, Tacho, configuration, plain_names, with_pulses
from spallwatch.recordings import to_signal
from spallwatch.records import readable
from streams.turns.pulses import Pulses
from streams.types.block import VELOCITY, Block

_LEDGER = (
    *("source", "name", "content_hash", "status", "flags", "reason", "events", "sequence"),
    *("elapsed", "time_status"),
)
_OF_A_LIFE = ("stage", "fault_basis", "tta_status")
"""Words that only a monitor can know, which saw the signals before."""


class SignalError(WrongInputError):
    """A signal that cannot be analysed; the message says what was expected and what came."""


def spectrum(
    signal: xr.DataArray | ArrayLike, *, rate_hz: float | None = None, unit: str | None = None
) -> xr.DataArray:
    """Return the amplitude spectrum of a signal, single-sided, with a Hann window.

    A line of amplitude A on a bin reads A there and A/2 beside it.

    Args:
        signal: of ``read`` or ``to_signal``, (channel, time), or plain samples with their rate and unit.
        rate_hz, unit: see ``to_signal``, for plain samples.

    Returns:
        Dimensions (channel, frequency); Hz, and m/s2, or m/s of a velocity.

    Raises:
        SignalError: a sample is not finite, or the signal is shorter than 64 samples.
    """
    given = signal_of(signal, rate_hz, unit, differentiated=False)
    rows = _transformed(given, ())
    amplitude = np.stack([found.raw.amplitude for found in rows])
    return _over_frequency(given, amplitude, rows[0].raw.resolution, "amplitude of the spectrum")


def envelope_spectrum(
    signal: xr.DataArray | ArrayLike,
    band_hz: tuple[float, float],
    *,
    rate_hz: float | None = None,
    unit: str | None = None,
) -> xr.DataArray:
    """Return the amplitude spectrum of the envelope of a band, its mean removed (Gabrielli's thesis, Eqs. 94-95).

    Args:
        signal, rate_hz, unit: as in ``spectrum``; a velocity is differentiated up to its ``sensor_max_hz``.
        band_hz: lowest and highest frequency that is demodulated.

    Returns:
        Dimensions (channel, frequency), up to the width of the band; m/s2 and Hz. ``envelope_mean`` is a coordinate:
        an amplitude over it is a depth of modulation.

    Raises:
        SignalError: as ``spectrum``, or the band does not fit below half of the sampling rate or ``sensor_max_hz``.
    """
    given = signal_of(signal, rate_hz, unit)
    if band_hz[1] > given.attrs.get("sensor_max_hz", math.inf):
        limit = given.attrs["sensor_max_hz"]
        raise SignalError(f"band_hz: up to {band_hz[1]:g} Hz, the sensor of velocity has sensor_max_hz = {limit:g}")
    envelopes = [found.envelopes[0] for found in _transformed(given, (band_hz,))]
    amplitude = np.stack([envelope.amplitude for envelope in envelopes])
    found = _over_frequency(given, amplitude, envelopes[0].resolution, "amplitude of the envelope spectrum")
    found.attrs["band_hz"] = [float(edge) for edge in band_hz]
    mean = xr.Variable("channel", [envelope.mean for envelope in envelopes], {"units": given.attrs["units"]})
    return found.assign_coords(envelope_mean=mean)


def features(
    signal: xr.DataArray | ArrayLike,
    *,
    bearing: Bearing | str,
    speed_hz: float | None = None,
    load_newton: float | None = None,
    band_hz: tuple[float, float] | None = None,
    rms_band_hz: tuple[float, float] | None = None,
    speed_exact: bool = False,
    rate_hz: float | None = None,
    unit: str | None = None,
    **tacho: Unpack[Tacho],
) -> xr.Dataset:
    """Return the features of a signal as a monitor records them for one block.

    Args:
        signal, rate_hz, unit: as in ``spectrum``.
        bearing: geometry, or a designation of the catalogue.
        speed_hz: of the shaft; by default what the recording states.
        load_newton: radial load.
        band_hz: that is demodulated; by default the best of several for this signal.
        rms_band_hz: band of RMS and A*, by default all frequencies, of a velocity those up to ``sensor_max_hz``.
        speed_exact: whether the speed is that of a tacho or a controlled drive; otherwise it is sought around it.
        tacho: ``tacho_channel`` or ``pulse_times_s``, and ``pulses_per_revolution``, where the speed varies within the
            signal: lines are then those of the spectrum over the angle of the shaft (``domain`` is "order").

    Returns:
        Dimensions (channel, part, harmonic, ...), SI; the variables are those of health records that a single block
        has, words as strings, units and sources in their attributes.

    Raises:
        SignalError: the signal is rejected, with the reason; or its speed is not known.
        PulsesError: the pulses do not go with the signal.
        ConfigError: an argument is not allowed.
    """
    given = signal_of(signal, rate_hz, unit, differentiated=False)
    given, pulses = with_pulses(given, tacho)
    record = _analysed(given, pulses, bearing, speed_hz, load_newton, band_hz, rms_band_hz, speed_exact).record
    dataset = readable(to_dataset([_stored(record)], dated=False, attributes={})).isel(time=0, drop=True)
    unused = [name for name, array in dataset.data_vars.items() if name in _OF_A_LIFE or _is_empty(array)]
    found = dataset.drop_vars([*_LEDGER, *unused, "coefficient_name"]).assign_coords(channel=given.channel.values)
    found.attrs = {"flags": " ".join(record.flags)}
    return found


def name_fault(
    signal: xr.DataArray | ArrayLike,
    *,
    bearing: Bearing | str,
    speed_hz: float | None = None,
    band_hz: tuple[float, float] | None = None,
    speed_exact: bool = False,
    rate_hz: float | None = None,
    unit: str | None = None,
    **tacho: Unpack[Tacho],
) -> Naming:
    """Return which part of the bearing is damaged, by the envelope spectrum of one channel.

    Arguments and errors are those of ``features``.

    Returns:
        ``fault`` is "outer", "inner", "ball", "cage", two of them joined by "|", "undecided" with ``candidates`` where
        the speed does not tell, or None: nothing is named. ``verified``: whether the speed is known or was found in
        the signal. ``evidence``: depth of modulation, score and lines.

    Raises:
        SignalError: also a signal of several channels.
    """
    given = signal_of(signal, rate_hz, unit, differentiated=False)
    given, pulses = with_pulses(given, tacho)
    refuse_several(given, "name_fault takes one channel, the signal has")
    output = _analysed(given, pulses, bearing, speed_hz, None, band_hz, None, speed_exact)
    naming = next(iter(output.channels.values())).naming
    assert naming is not None
    return naming


def signal_of(
    signal: xr.DataArray | ArrayLike, rate_hz: float | None, unit: str | None, *, differentiated: bool = True
) -> xr.DataArray:
    """Return a signal in the form of ``to_signal``; of a velocity its acceleration, where it is ``differentiated``."""
    if not isinstance(signal, xr.DataArray):
        if rate_hz is None or unit is None:
            raise SignalError('plain samples: give rate_hz and unit="g", "m/s2", "mm/s" or "unknown"')
        signal, rate_hz, unit = to_signal(signal, rate_hz=rate_hz, unit=unit), None, None
    if "rate_hz" not in signal.attrs or signal.attrs.get("units") not in ("m s-2", "m s-1", "unknown"):
        raise SignalError("signal: expected an array of read or to_signal, with attributes rate_hz and units m s-2")
    if rate_hz is not None or unit is not None:
        raise SignalError("rate_hz and unit are for plain samples; the signal states its own")
    # A channel that was selected by name alone has no dimension any more.
    given = signal.expand_dims("channel") if "channel" not in signal.dims else signal
    given = given.transpose("channel", "time")
    return _differentiated(given) if differentiated and given.attrs["units"] == "m s-1" else given


def _differentiated(velocity: xr.DataArray) -> xr.DataArray:
    """Return the acceleration up to ``sensor_max_hz`` of a velocity; SignalError for a sample that is not finite."""
    rate, limit = velocity.attrs["rate_hz"], velocity.attrs.get("sensor_max_hz", USUAL_LIMIT)
    if velocity.sizes["time"] < MIN_SAMPLES or not np.isfinite(velocity.values).all():
        raise SignalError(f"signal: expected at least {MIN_SAMPLES} samples, all of them finite")
    rows = [acceleration_of(row, rate, limit) for row in velocity.values]
    found = velocity.copy(data=np.stack(rows)).rename("acceleration")
    named = {"units": "m s-2", "long_name": f"acceleration up to {limit:g} Hz, differentiated", "sensor_max_hz": limit}
    found.attrs |= named
    return found


def refuse_several(signal: xr.DataArray, reason: str) -> None:
    """Raise SignalError, with what begins its message, where a signal has not one channel."""
    if signal.sizes.get("channel", 1) != 1:
        names = ", ".join(map(str, signal.channel.values))
        raise SignalError(f"{reason} {names}; choose one: signal.sel(channel=[...])")


def _transformed(signal: xr.DataArray, bands: tuple[tuple[float, float], ...]) -> list[Any]:
    try:
        transform = BlockTransform(signal.sizes["time"], signal.attrs["rate_hz"], bands)
        return [transform(row) for row in signal.values]
    except ValueError as error:
        raise SignalError(f"signal: {error}") from None


def _over_frequency(signal: xr.DataArray, amplitude: Any, resolution: float, name: str) -> xr.DataArray:
    attributes = {"units": "Hz", "long_name": "frequency"}
    frequency = xr.Variable("frequency", np.arange(amplitude.shape[1]) * resolution, attributes)
    return xr.DataArray(
        amplitude,
        dims=("channel", "frequency"),
        coords={"channel": signal.channel, "frequency": frequency},
        name="amplitude",
        attrs={"units": signal.attrs["units"], "long_name": name},
    )


def _analysed(
    signal: xr.DataArray,
    pulses: Pulses | None,
    bearing: Bearing | str,
    speed: float | None,
    load: float | None,
    band: tuple[float, float] | None,
    rms_band: tuple[float, float] | None,
    speed_exact: bool,
) -> SourceOutput:
    """Take a signal through the stages as the only block of a source."""
    unit, scale = {"m s-2": ("m/s2", 1.0), "m s-1": (VELOCITY, 1e3)}.get(signal.attrs["units"], ("unknown", 1.0))
    limit = signal.attrs.get("sensor_max_hz") if unit == VELOCITY else None
    names = plain_names([str(name) for name in signal.channel.values])
    config = configuration(
        [
            {
                "name": name,
                "unit": unit,
                "scale": None if scale == 1.0 else scale,
                "sensor_max_hz": limit,
                "band_hz": None if band is None else [list(band)],
                "rms_band_hz": rms_band,
            }
            for name in names
        ],
        bearing=bearing,
        operating={"speed_hz": speed, "load_newton": load, "speed_exact": speed_exact},
    )
    settings = source_settings(config, config.source[0])
    block = Block(
        samples=signal.values if signal.dtype.kind == "f" else signal.values.astype(np.float64),
        rate=float(signal.attrs["rate_hz"]),
        channels=tuple(names),
        units=(unit,) * len(names),
        source=SOURCE,
        sequence=1,
        name=str(signal.attrs.get("name", "signal")),
        elapsed=0.0,
        # What a block states precedes what is configured.
        speed=signal.attrs.get("speed_hz") if speed is None else None,
        load=signal.attrs.get("load_newton") if load is None else None,
        pulses=pulses,
    )
    pipeline = Pipeline({SOURCE: settings})
    try:
        pipeline.fix_bands(SOURCE, [block])
    except ValueError as error:
        raise SignalError(f"{block.name}: {error}") from None
    output = pipeline.take(block)
    verdicts = {name: channel.block.verdict for name, channel in output.channels.items()}
    wrong = {name: verdict for name, verdict in verdicts.items() if not verdict.accepted}
    if not output.record.accepted or wrong:
        reasons = "; ".join(f"{name}: {verdict.status}: {verdict.reason}" for name, verdict in wrong.items())
        raise SignalError(f"{block.name}: {reasons or f'{output.record.status}: {output.record.reason}'}")
    return output


def _stored(record: Record) -> Stored:
    layout, row = pack(record.channels)
    return Stored(
        filing=Filing(None, 0.0, "given"),
        layout=layout,
        row=row,
        source=record.source,
        sequence=record.sequence,
        name=record.name,
        content_hash=record.content_hash,
        status=record.status,
        flags=" ".join(record.flags),
        reason=record.reason,
        time=None,
        elapsed=0.0,
        forecasts="[]",
        events="[]",
    )


def _is_empty(array: xr.DataArray) -> bool:
    values = array.values
    if values.dtype == object:
        return bool(np.all(values == ""))
    return bool(np.all(np.isnan(values)))
