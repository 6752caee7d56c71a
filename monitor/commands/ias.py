"""``spallwatch ias``: the angular speed of a shaft from the pulses of an encoder."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
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
    finite,
    first_block,
    input_errors,
    output_errors,
    read_config,
    read_machine,
    write_plot,
)
from monitor.health.signal.comb import FaultLines
from monitor.health.signal.rotation.ias import IasStudy, clock_noise, interval_error, study
from monitor.health.signal.rotation.rotation import TachoSettings
from monitor.health.signal.settings import fundamentals

_TEXT_LINES = 5
"""Multiples of the shaft that are printed."""


@click.command("ias")
@click.argument("input_path", metavar="FILE", type=option.FILE)
@click.option("--pulses-per-revolution", "per_revolution", type=click.IntRange(min=1), help="Marks of a whole turn.")
@click.option("--tacho-missing-teeth", type=option.WHOLE, help="Teeth that the wheel lacks once a turn.")
@click.option("--tacho-ratio", type=option.POSITIVE, help="Turns of the bearing's shaft per turn of the wheel.")
@click.option("--tacho-channel", help="Column of FILE with the pulses, by name or number; FILE is a recording then.")
@click.option("--tacho-level", type=float, help="Threshold of a pulse, in the unit of the channel; else it is found.")
@click.option("--tacho-edge", type=click.Choice(["rising", "falling"]), help="The edge of a pulse that counts.")
@click.option("--rate-hz", type=option.POSITIVE, help="Sampling rate of the channel, where FILE states none.")
@click.option("--clock-mhz", type=option.POSITIVE, help="Clock of the counter, for the error that it makes.")
@click.option("--remove-wheel", is_flag=True, help="Take out what repeats with each turn of the wheel.")
@option.config
@option.bearing
@click.option("--out", type=option.OUT_FILE, help="Write the spectrum (CSV).")
@click.option("--plot", type=option.OUT_FILE, help="Draw it (PNG, SVG or HTML).")
@option.output
def command(
    input_path: Path,
    rate_hz: float | None,
    clock_mhz: float | None,
    remove_wheel: bool,
    config_path: Path | None,
    name: str | None,
    out: Path | None,
    plot: Path | None,
    **wheel: Any,
) -> option.Result:
    """Print the spectrum of a shaft's angular speed over events per revolution, from the pulses of an encoder.

    FILE is a text with a time a line, s, or any recording with --tacho-channel. A configuration states the wheel in
    [operating]. With --bearing, or a configuration, the lines of the bearing's parts are sought.
    """
    check_suffix("--out", out, (".csv",))
    check_suffix("--plot", plot, PICTURES)
    config = None if config_path is None else read_config(config_path)
    tacho = TachoSettings(per_revolution=0) if config is None else config.operating.to_condition().tacho
    # Each option of the wheel has the name of a field of the settings.
    tacho = replace(tacho, **{key.removeprefix("tacho_"): value for key, value in wheel.items() if value is not None})
    if tacho.channel is None and any(
        value is not None for value in (rate_hz, wheel["tacho_level"], wheel["tacho_edge"])
    ):
        raise InputError("--rate-hz, --tacho-level and --tacho-edge belong to --tacho-channel: times have no levels")
    times, stated = _text(input_path) if tacho.channel is None else (_sampled(input_path, tacho, rate_hz), None)
    if stated is not None and wheel["per_revolution"] is None:
        tacho = replace(tacho, per_revolution=stated)
    if tacho.per_revolution < 1:
        raise InputError(f"--pulses-per-revolution is missing, and {input_path} does not state it")
    orders: dict[str, float] = {}
    if name is not None or config is not None:
        orders = fundamentals(kinematics(find_entry(config or read_machine(None), name)[0].bearing, 1.0))
    clock = None if clock_mhz is None else 1e6 * clock_mhz
    resolution = 0.0 if clock is None else 1.0 / clock
    with input_errors(str(input_path)):
        found = study(times, tacho, resolution=resolution, remove_wheel=remove_wheel)
    values = _values(found, found.lines(orders) if orders else {}, clock)
    if out is not None:
        rows = np.column_stack([found.spectrum.orders, found.spectrum.amplitude])
        with output_errors("--out", out):
            np.savetxt(out, rows, "%.9g", delimiter=",", header="order,amplitude_rad_s", comments="")
    if plot is not None:
        _draw(found, orders, values, input_path, plot)
    return values, _lines(values)


def _text(path: Path) -> tuple[NDArray[np.float64], int | None]:
    """Return the times in a text, s, and the pulses a revolution that it states."""
    from streams.files.formats.pulse_text import pulse_column
    from streams.types.samples import ReaderError

    try:
        found = pulse_column(path.read_bytes(), str(path)).pulses
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None
    except ReaderError as error:
        raise InputError(f"{error}; of a recording, --tacho-channel names the column with the pulses") from None
    assert found is not None
    return found.times, found.per_revolution


def _sampled(path: Path, tacho: TachoSettings, rate: float | None) -> NDArray[np.float64]:
    """Return the times of the pulses in a channel, s."""
    from streams.turns.tacho import edge_times

    block = first_block(path, "pulses", str(tacho.channel), rate, "file", missing="no file that is read")
    return edge_times(block.samples[0], block.rate, tacho.level, falling=tacho.edge == "falling")


def _values(found: IasStudy, lines: dict[str, FaultLines], clock: float | None) -> dict[str, Any]:
    """Return the keys of the interface."""
    spectrum, wheel = found.spectrum, found.wheel
    shaft = spectrum.turns * np.arange(1, _TEXT_LINES + 1)
    inside = shaft[shaft < spectrum.amplitude.size]
    return {
        "pulses": found.train.times.size,
        "pulses_missing": found.missing,
        "pulses_extra": found.extra,
        "pulses_per_revolution": spectrum.per_revolution,
        "turns": spectrum.turns,
        "speed_hz": spectrum.mean_speed,
        "resolution": spectrum.resolution,
        "timing_noise_ns": 1e9 * spectrum.timing_noise,
        "clock_noise_ns": None if clock is None else 1e9 * clock_noise(clock),
        "interval_error_percent": (
            None if clock is None else 100.0 * interval_error(clock, spectrum.per_revolution, spectrum.mean_speed)
        ),
        "wheel_error_deg": 360.0 * wheel.rms,
        "wheel_error_sd_deg": 360.0 * wheel.rms_error,
        "wheel_removed": found.removed,
        "wheel_rad_s": spectrum.amplitude[inside].tolist(),
        "lines": {
            part: {
                "order": one.fundamental,
                "detected": one.detected,
                "score": one.score,
                "threshold": finite(one.threshold),
                "amplitude_rad_s": one.amplitude.tolist(),
                "floor_rad_s": one.floor.tolist(),
            }
            for part, one in lines.items()
        },
    }


def _draw(found: IasStudy, orders: dict[str, float], values: dict[str, Any], source: Path, path: Path) -> None:
    from monitor.report.figures.rotation import ias_sheet

    write_plot(ias_sheet(found, orders, values, source.name), path)


def _lines(values: dict[str, Any]) -> Iterator[str]:
    counts = f"{values['pulses']} pulses, {values['pulses_missing']} missing, {values['pulses_extra']} too many"
    yield f"{counts}; {values['turns']} turns at {values['speed_hz']:.5g} Hz"
    yield f"a pulse is timed to {values['timing_noise_ns']:.3g} ns" + (
        "" if values["clock_noise_ns"] is None else f", of which the clock makes {values['clock_noise_ns']:.3g} ns"
    )
    taken = ", taken out" if values["wheel_removed"] else ""
    yield (
        f"what repeats each turn: {values['wheel_error_deg']:.3g} degrees (standard error "
        f"{values['wheel_error_sd_deg']:.2g}){taken}"
    )
    if values["lines"]:
        yield f"{'part':<8}{'events/turn':>12}  {'score':>7}  {'limit':>6}  amplitudes (rad/s)"
    for part, one in values["lines"].items():
        amplitudes = " ".join(f"{amplitude:.3g}" for amplitude in one["amplitude_rad_s"])
        limit = math.inf if one["threshold"] is None else one["threshold"]
        mark = "*" if one["detected"] else " "
        yield f"{part:<8}{one['order']:>12.4f}  {one['score']:>7.3g}{mark} {limit:>6.3g}  {amplitudes}"
    if any(one["detected"] for one in values["lines"].values()):
        yield "* stands out: noise alone does so once in 10,000 spectra"
