"""``spallwatch cyclic``: spectral coherence of a recording over the orders of its shaft."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click

from models.words.errors import WrongInputError
from monitor.commands import option
from monitor.commands.common import (
    PICTURES,
    InputError,
    check_suffix,
    find_entry,
    input_errors,
    read_config,
    read_machine,
    write_plot,
)
from monitor.health.signal.cyclic import CyclicStudy, cyclic_study, known_rotation


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
def command(
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
    samples, rate, stated = _read(input_path, column, rate_hz, block_s)
    with input_errors(str(input_path)):
        rotation = known_rotation(samples, rate, bearing, speed_hz or stated, speed_range_hz)
        study = cyclic_study(samples, rate, bearing, rotation, band_hz)
    if plot is not None:
        from monitor.report.figures.cyclic import cyclic_sheet, rotation_facts

        title = f"Cyclic coherence: {input_path.name}"
        write_plot(cyclic_sheet(study.found, study.orders, rotation_facts(rotation), title), plot)
    values = _values(study)
    return values, _lines(values)


def _read(path: Path, column: str | None, rate: float | None, block_s: float) -> tuple[Any, float, float | None]:
    """Return the samples of the first block of a file, its rate, and the speed that it states."""
    from streams.open import open_source
    from streams.types.block import Block
    from streams.types.spec import ChannelSpec, SourceSpec

    chosen = None if column is None else int(column) if column.isdigit() else column
    row = ChannelSpec("vibration", column=chosen, unit="unknown", any_unit=True)
    spec = SourceSpec("recording", str(path), block_s=block_s, rate=rate, channels=(row,))
    try:
        block = next(iter(open_source(spec)), None)
    except WrongInputError as error:
        raise InputError(str(error)) from None
    if not isinstance(block, Block):
        raise InputError(f"{path}: no block of {block_s:g} s" if block is None else f"{path}: {block.reason}")
    return block.samples[0], block.rate, block.speed


def _values(study: CyclicStudy) -> dict[str, Any]:
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


def _lines(values: dict[str, Any]) -> Iterator[str]:
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
