"""``spallwatch orders``: spectra over orders of the shaft of one block of a recording, at its full rate."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

from models.machine.bearing import kinematics
from monitor.commands import option
from monitor.commands.common import PICTURES, InputError, check_suffix, output_errors, read_config, write_plot
from monitor.config.load import Config
from monitor.health.output import ChannelOutput
from monitor.health.signal.features import fundamentals
from monitor.health.signal.orders import OrderSpectrum, order_spectrum
from monitor.health.state import ChannelSettings
from streams.types.block import STANDARD_GRAVITY, Block

MOST_LINES = 12
"""Highest lines that are listed."""
_APART_BINS = 3


@click.command("orders")
@click.argument("input_path", metavar="RECORDING", type=option.PLACE)
@option.config
@click.option("--block", "wanted", type=click.IntRange(min=1), help="Number of the block; by default the first.")
@click.option("--envelope", is_flag=True, help="Spectra of the envelopes of the channels' bands.")
@click.option("--max-order", type=option.POSITIVE, default=100.0, show_default=True, help="Highest order.")
@click.option("--out", type=option.OUT_FILE, help="Write the spectra (CSV).")
@click.option("--plot", type=option.OUT_FILE, help="Draw them (PNG, SVG or HTML).")
@option.output
def command(
    input_path: str,
    config_path: Path | None,
    wanted: int | None,
    envelope: bool,
    max_order: float,
    out: Path | None,
    plot: Path | None,
) -> option.Result:
    """Print the highest lines of one block of RECORDING over orders of the shaft.

    The angle of the shaft is that of the configuration: a tacho, pulses, a speed over time, or the vibration.
    """
    check_suffix("--out", out, (".csv",))
    check_suffix("--plot", plot, PICTURES)
    config = read_config(config_path)
    block, outputs, settings = _block(config, input_path, wanted)
    spectra = {
        name: _envelope(output, max_order) if envelope else _signal(block, output, max_order)
        for name, output in outputs.items()
        if output.block.found.rotation is not None and output.features is not None
    }
    if not spectra:
        status = next((output.block.found.status for output in outputs.values()), None)
        raise InputError(f"{block.name}: no channel has an angle of the shaft: {status or 'none is configured'}")
    if out is not None:
        _write(out, spectra, settings)
    if plot is not None:
        _draw(plot, block.name, spectra, outputs, settings, envelope=envelope)
    values = _values(block, outputs, spectra, settings)
    return values, _lines(values)


def _block(
    config: Config, recording: str, wanted: int | None
) -> tuple[Block, Mapping[str, ChannelOutput], Mapping[str, ChannelSettings]]:
    """Return the block of a number, or the first that is accepted, with what the stages make of it."""
    from monitor.service.setup import accepted_blocks

    for block, outputs, settings in accepted_blocks(config, recording, "orders"):
        if wanted is None or block.sequence == wanted:
            return block, outputs, settings
    which = "no block of it is" if wanted is None else f"block {wanted} is not"
    raise InputError(f"{recording}: {which} accepted; replay says why")


def _signal(block: Block, output: ChannelOutput, limit: float) -> OrderSpectrum:
    assert output.block.found.rotation is not None
    try:
        return order_spectrum(output.block.samples, block.rate, output.block.found.rotation, limit)
    except ValueError as error:
        raise InputError(f"{block.name}: {error}") from None


def _envelope(output: ChannelOutput, limit: float) -> OrderSpectrum:
    features, rotation = output.features, output.block.found.rotation
    assert features is not None
    assert rotation is not None
    if features.domain != "order":
        low, high = rotation.speed_range
        raise InputError(f"the envelope is not over the angle: domain hertz, speed from {low:g} to {high:g} Hz")
    envelope = features.envelopes[output.leading]
    spacing = envelope.resolution / rotation.mean_speed
    amplitude = np.asarray(envelope.amplitude[: int(limit / spacing) + 1], dtype=np.float64)
    reach = (envelope.amplitude.size - 1) * spacing
    return OrderSpectrum(spacing, amplitude, float(envelope.mean), 1.0 / spacing, rotation.mean_speed, reach)


def _one(settings: ChannelSettings) -> float:
    """Return the unit of amplitudes in that of the samples: g, or the channel's own."""
    return STANDARD_GRAVITY if settings.absolute else 1.0


def _highest(amplitude: NDArray[np.float64]) -> list[int]:
    """Return the bins of the highest maxima, the highest first."""
    padded = np.pad(amplitude[2:], _APART_BINS, constant_values=0.0)
    around = np.lib.stride_tricks.sliding_window_view(padded, 2 * _APART_BINS + 1).max(axis=1)
    tops = np.flatnonzero((amplitude[2:] == around) & (amplitude[2:] > 0.0)) + 2
    return tops[np.argsort(-amplitude[tops], kind="stable")][:MOST_LINES].tolist()


def _values(
    block: Block,
    outputs: Mapping[str, ChannelOutput],
    spectra: Mapping[str, OrderSpectrum],
    settings: Mapping[str, ChannelSettings],
) -> dict[str, Any]:
    """Return the keys of the interface."""
    channels: dict[str, Any] = {}
    for name, found in spectra.items():
        rotation, one = outputs[name].block.found.rotation, _one(settings[name])
        key = "amplitude_g" if settings[name].absolute else "amplitude_own"
        assert rotation is not None
        low, high = rotation.speed_range
        channels[name] = {
            "rotation_source": rotation.source,
            "revolutions": found.revolutions,
            "speed_hz": found.mean_speed,
            "speed_min_hz": low,
            "speed_max_hz": high,
            "order_step": found.step,
            "complete_order": found.complete,
            "lines": [
                {
                    "order": place * found.step,
                    key: float(found.amplitude[place]) / one,
                }
                for place in _highest(found.amplitude)
            ],
        }
    return {"block": block.sequence, "name": block.name, "channels": channels}


def _lines(values: Mapping[str, Any]) -> Iterator[str]:
    yield f"block {values['block']} ({values['name']})"
    for name, found in values["channels"].items():
        speeds = f"{found['speed_hz']:.5g} Hz, from {found['speed_min_hz']:.5g} to {found['speed_max_hz']:.5g}"
        yield f"channel {name}: {found['revolutions']:.5g} turns at {speeds} ({found['rotation_source']})"
        for line in found["lines"]:
            amplitude = line.get("amplitude_g", line.get("amplitude_own"))
            yield f"  {line['order']:>10.3f}  {amplitude:.4g}{' g' if 'amplitude_g' in line else ''}"


def _draw(
    path: Path,
    name: str,
    spectra: Mapping[str, OrderSpectrum],
    outputs: Mapping[str, ChannelOutput],
    settings: Mapping[str, ChannelSettings],
    *,
    envelope: bool,
) -> None:
    from monitor.report.figures.rotation import ChannelOrders, orders_sheet

    channels: dict[str, ChannelOrders] = {}
    for channel, found in spectra.items():
        rotation, set_up = outputs[channel].block.found.rotation, settings[channel]
        assert rotation is not None
        unit = "g" if set_up.absolute else "own unit"
        lines = fundamentals(kinematics(set_up.bearing, 1.0))
        channels[channel] = ChannelOrders(channel, found, rotation, _one(set_up), unit, lines)
    write_plot(orders_sheet(channels, name, envelope=envelope), path)


def _write(path: Path, spectra: Mapping[str, OrderSpectrum], settings: Mapping[str, ChannelSettings]) -> None:
    """Write one column of orders and one of each channel; channels of other shafts by their own orders."""
    columns: list[NDArray[np.float64]] = []
    names: list[str] = []
    for name, found in spectra.items():
        columns += [found.order, found.amplitude / _one(settings[name])]
        names += [f"{name}_order", f"{name}_amplitude{'_g' if settings[name].absolute else ''}"]
    rows = np.full((max(column.size for column in columns), len(columns)), np.nan)
    for place, column in enumerate(columns):
        rows[: column.size, place] = column
    with output_errors("--out", path):
        np.savetxt(path, rows, "%.9g", delimiter=",", header=",".join(names), comments="")
