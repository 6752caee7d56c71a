"""``spallwatch orders`` and ``cyclic``: a block of a recording over the angle of its shaft."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

from models.machine.bearing import kinematics
from monitor.commands import option
from monitor.commands.common import (
    PICTURES,
    InputError,
    check_suffix,
    find_entry,
    first_block,
    input_errors,
    output_errors,
    read_config,
    read_machine,
    write_plot,
)
from monitor.config.load import Config
from monitor.health.output import ChannelOutput
from monitor.health.signal.cyclic import CyclicStudy, cyclic_study, known_rotation
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


@click.command("cyclic")
@click.argument("input_path", metavar="FILE", type=option.FILE)
@click.option("--column", help="Column or array of FILE, by name or number; by default the first.")
@click.option("--rate-hz", type=option.POSITIVE, help="Sampling rate, where FILE states none.")
@click.option("--block-s", type=option.POSITIVE, default=5.0, show_default=True, help="Length of signal, s.")
@click.option("--speed-hz", type=option.POSITIVE, help="Speed of the shaft, where it is steady.")
@click.option(
    "--speed-range-hz", type=(float, float), help="Lowest and highest speed: the angle is found in the vibration."
)
@click.option("--band-hz", type=(float, float), help="Frequencies that are averaged over; by default all.")
@option.config
@option.bearing
@click.option("--plot", type=option.OUT_FILE, help="Draw it (PNG, SVG or HTML).")
@option.output
def cyclic_command(
    input_path: Path,
    column: str | None,
    rate_hz: float | None,
    block_s: float,
    speed_hz: float | None,
    speed_range_hz: tuple[float, float] | None,
    band_hz: tuple[float, float] | None,
    config_path: Path | None,
    name: str | None,
    plot: Path | None,
) -> option.Result:
    """Print which lines of a bearing recur with its shaft: spectral coherence of the first block of FILE.

    The speed is steady (--speed-hz, or what FILE states), or the angle of the shaft is found in the vibration
    (--speed-range-hz).
    """
    check_suffix("--plot", plot, PICTURES)
    if speed_hz is not None and speed_range_hz is not None:
        raise InputError("--speed-hz and --speed-range-hz exclude each other")
    config = None if config_path is None else read_config(config_path)
    bearing = find_entry(config or read_machine(None), name)[0].bearing
    block = first_block(input_path, "vibration", column, rate_hz, block_s, missing=f"no block of {block_s:g} s")
    samples, rate, stated = block.samples[0], block.rate, block.speed
    with input_errors(str(input_path)):
        rotation = known_rotation(samples, rate, bearing, speed_hz or stated, speed_range_hz)
        study = cyclic_study(samples, rate, bearing, rotation, band_hz)
    if plot is not None:
        from monitor.report.figures.cyclic import cyclic_sheet, rotation_facts

        title = f"Cyclic coherence: {input_path.name}"
        write_plot(cyclic_sheet(study.found, study.orders, rotation_facts(rotation), title), plot)
    values = _cyclic_values(study)
    return values, _cyclic_lines(values)


def _cyclic_values(study: CyclicStudy) -> dict[str, Any]:
    """Return the keys of the answer."""
    low, high = study.rotation.speed_range
    return {
        "domain": study.found.domain,
        "speed_hz": study.rotation.mean_speed,
        "speed_min_hz": low,
        "speed_max_hz": high,
        "turns": study.rotation.turned,
        "turns_sd": study.rotation.turns_sd,
        "limit": study.found.limit,
        "lines": {
            part: {
                "order": line.order,
                "found": line.found,
                "coherence": line.coherence,
                "stands_out": line.stands_out,
                "frequency_hz": line.frequency,
            }
            for part, line in study.lines().items()
        },
    }


def _cyclic_lines(values: dict[str, Any]) -> Iterator[str]:
    low, high = values["speed_min_hz"], values["speed_max_hz"]
    speeds = f"{values['speed_hz']:.5g} Hz" if high == low else f"{low:.4g} to {high:.4g} Hz"
    yield f"{values['turns']:.5g} turns at {speeds}; noise stays below {values['limit']:.3g}"
    yield f"{'part':<8}{'events/turn':>12}  {'found':>8}  {'coherence':>9}  loudest at (Hz)"
    for part, one in values["lines"].items():
        mark = "*" if one["stands_out"] else " "
        yield (
            f"{part:<8}{one['order']:>12.4f}  {one['found']:>8.4f}  {one['coherence']:>9.3g}{mark} "
            f"{one['frequency_hz']:>14.0f}"
        )
    if any(one["stands_out"] for one in values["lines"].values()):
        yield "* stands above the limit of noise, which is exceeded anywhere in 1 % of blocks"
