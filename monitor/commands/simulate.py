"""``spallwatch simulate``: one scene of the bearing model."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
import numpy as np

from models.response import Response
from models.scene import Defect, Floor, Scene
from monitor.commands.bearing import find_bearing
from monitor.commands.common import BandHz, InputError, config_option, emit, output_options, read_machine
from streams.block import STANDARD_GRAVITY


@click.command("simulate")
@config_option()
@click.option("--bearing", "name", help="A bearing of the configuration or of the catalogue.")
@click.option("--speed-hz", type=click.FloatRange(min=0, min_open=True), default=40.0, show_default=True)
@click.option("--load-newton", type=click.FloatRange(min=0), default=4000.0, show_default=True)
@click.option("--dphi-deg", type=click.FloatRange(0, 360), default=0.0, show_default=True, help="Extent of the defect.")
@click.option("--h-d-um", type=click.FloatRange(min=0), default=0.0, show_default=True, help="Depth of the defect.")
@click.option("--clearance-um", type=click.FloatRange(min=0), help="Radial clearance.")
@click.option("--floor", type=click.Choice(["smooth", "rough"]), default="smooth", show_default=True)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of a rough floor.")
@click.option("--rows", type=click.Choice(["1", "2"]), default="1", show_default=True, help="Rows that are damaged.")
@click.option("--sensor", type=click.Choice(["mo", "mr"]), default="mo", show_default=True, help="Casing or resonator.")
@click.option("--fault", type=click.Choice(["outer"]), default="outer", show_default=True, help="Damaged part.")
@click.option("--model", type=click.Choice(["six_dof"]), default="six_dof", show_default=True)
@click.option("--tolerance", type=click.FloatRange(1e-12, 0.1), default=1e-5, show_default=True)
@click.option("--periods", type=click.IntRange(min=2), default=300, show_default=True, help="Ball periods at most.")
@click.option("--rms-band-hz", type=BandHz(), help="Take RMS and peak in this band only.")
@click.option("--plot", type=click.Path(path_type=Path, dir_okay=False), help="Draw waveform and lines (PNG or SVG).")
@click.option("--waveform", type=click.Path(path_type=Path, dir_okay=False), help="Write one second as CSV.")
@output_options
def command(config_path: Path | None, name: str | None, as_json: bool, quiet: bool, **options: Any) -> None:
    """Simulate a bearing with an outer-race defect and print RMS, peak and lines."""
    from models.simulate import simulate

    config = read_machine(config_path)
    bearing, clearance = find_bearing(config, name)
    if options["clearance_um"] is not None:
        clearance = options["clearance_um"] * 1e-6
    scene = Scene(
        speed=options["speed_hz"],
        load=options["load_newton"],
        bearing=bearing,
        rig=config.rig.to_rig(),
        defect=_defect(options),
        clearance=clearance,
        model=options["model"],
    )
    band = options["rms_band_hz"]
    try:
        response = simulate(scene, tolerance=options["tolerance"], max_periods=options["periods"], band=band)
    except ValueError as error:
        raise InputError(f"simulate: {error}") from None
    casing = options["sensor"] == "mo"
    g = STANDARD_GRAVITY
    if options["waveform"] is not None:
        _write_waveform(options["waveform"], response.acceleration(51200.0, 1.0, sensor=options["sensor"]))
    if options["plot"] is not None:
        _plot(response, options, scene)
    lines = response.lines(options["sensor"])[1][:6]
    values = {
        "rms_g": _number((response.rms if casing else response.rms_resonator) / g),
        "peak_g": _number((response.peak if casing else response.peak_resonator) / g),
        "rms_resonator_g": _number(response.rms_resonator / g),
        "bpfo_hz": response.bpfo,
        "harmonics_g": [_number(float(line) / g) for line in lines],
        "periods": response.periods,
        "period_change": _number(response.period_change),
        "spread_g": _number(response.spread / g),
        "model": response.model,
        "status": response.status,
    }
    emit(values, _lines(values, options), as_json=as_json)


def _plot(response: Response, options: dict[str, Any], scene: Scene) -> None:
    path: Path = options["plot"]
    if path.suffix.lower() not in {".png", ".svg"}:
        raise InputError(f"--plot {path}: expected a name that ends in .png or .svg")
    from monitor.report.scene_figure import draw_response

    try:
        draw_response(response, path, sensor=options["sensor"], title=_title(options, scene))
    except OSError as error:
        raise InputError(f"--plot {path}: cannot be written: {error.strerror or error}") from None


def _title(options: dict[str, Any], scene: Scene) -> str:
    damage = "healthy"
    if scene.defect is not None:
        damage = f"{options['dphi_deg']:g}° x {options['h_d_um']:g} µm, {options['floor']} floor"
    return f"{scene.bearing.designation}, {scene.speed:g} Hz, {scene.load:g} N, {damage}"


def _number(value: float) -> float | None:
    """Return a finite number, or null: a motion that left the finite numbers has a status that says so."""
    return float(value) if math.isfinite(value) else None


def _defect(options: dict[str, Any]) -> Defect | None:
    if options["dphi_deg"] == 0.0 or options["h_d_um"] == 0.0:
        return None
    floor = Floor(kind=options["floor"], seed=options["seed"])
    return Defect(
        dphi_d=math.radians(options["dphi_deg"]),
        h_d=options["h_d_um"] * 1e-6,
        floor=floor,
        rows=int(options["rows"]),
    )


def _write_waveform(path: Path, signal: Any) -> None:
    """Write time and acceleration, replacing the file in one step."""
    rows = np.column_stack((np.arange(signal.size) / 51200.0, signal / STANDARD_GRAVITY))
    part = path.with_name(path.name + ".part")
    try:
        np.savetxt(part, rows, delimiter=",", header="time_s,acceleration_g", comments="", fmt="%.9g")
        part.replace(path)
    except OSError as error:
        raise InputError(f"--waveform {path}: cannot be written: {error}") from None


def _lines(values: dict[str, Any], options: dict[str, Any]) -> Iterator[str]:
    yield (
        f"{values['status']} after {values['periods']} ball periods: RMS {values['rms_g']:.4g} g, "
        f"peak {values['peak_g']:.4g} g (resonator RMS {values['rms_resonator_g']:.4g} g)"
    )
    yield (
        f"BPFO {values['bpfo_hz']:.2f} Hz, its harmonics " + ", ".join(f"{a:.3g}" for a in values["harmonics_g"]) + " g"
    )
    if options["dphi_deg"] == 0.0 or options["h_d_um"] == 0.0:
        yield "no defect: give --dphi-deg and --h-d-um"
