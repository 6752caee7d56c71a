"""``spallwatch simulate``: one scene of the bearing model."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from models.machine.bearing import Bearing, CatalogueEntry, kinematics
from models.machine.contact_estimates import estimate_stiffness
from models.machine.rig import Rig
from models.machine.scene import Defect, Floor, Part, Scene, Slip, Waviness
from models.solve.registry import AUTO, MODELS
from models.solve.response import row_of
from models.words.extras import brought, load
from models.words.request import QUANTITIES, SENSORS, Sensor
from monitor.commands import option
from monitor.commands.common import (
    PICTURES,
    check_suffix,
    find_entry,
    finite,
    input_errors,
    output_errors,
    read_machine,
    write_plot,
)
from monitor.commands.model_parameters import further_effects, with_machine, with_parameters
from monitor.commands.simulate.scene import (
    NO_UNIT,
    WAVEFORM_RATE,
    SweepRange,
    compare,
    compared_lines,
    derivative_lines,
    derivative_values,
    request_of,
    settle_speeds,
    simulated,
    speed_lines,
    speed_values,
    speed_words,
    swept,
    swept_lines,
    tacho_signal,
    with_speeds,
)
from monitor.records.durable import replacing
from monitor.words.numbers import floor_of_defect
from monitor.words.sensors import MEASURED, data_name, unit_in_names, unit_of_sensor
from streams.types.block import STANDARD_GRAVITY

if TYPE_CHECKING:
    from models.solve.response import Response


_USUAL = {"speed_hz": 40.0, "load_newton": 4000.0}
"""Conditions where neither an option nor the configuration names them: those of the thesis."""


@click.command("simulate")
@option.config
@option.bearing
@click.option("--speed-hz", type=option.POSITIVE, help="Default: that of [operating], else 40.")
@click.option("--load-newton", type=option.NOT_NEGATIVE, help="Default: that of [operating], else 4000.")
@click.option("--dphi-deg", type=click.FloatRange(0, 360), default=0.0, help="Extent of the defect.")
@click.option("--h-d-um", type=option.NOT_NEGATIVE, default=0.0, help="Depth of the defect.")
@click.option("--clearance-um", type=option.NOT_NEGATIVE, help="Radial clearance.")
@option.floor
@click.option("--seed", type=option.WHOLE, default=0, help="Seed of rough floor and slip.")
@click.option("--rows", type=click.Choice(["1", "2"]), default="1", help="Number of damaged rows.")
@click.option("--first-row", type=click.IntRange(1), default=1, help="The first damaged row.")
@click.option("--sensor", type=click.Choice(SENSORS), help="Default: the first acceleration.")
@click.option("--direction-deg", type=float, default=0.0, help="Angle of the sensor from the load.")
@click.option("--fault", type=click.Choice(["outer", "inner", "ball"]), default="outer", help="Damaged part.")
@click.option("--more-defect", type=option.FurtherDefect(), multiple=True, help="A further defect; repeatable.")
@click.option("--unbalance-kg-m", type=option.NOT_NEGATIVE, default=0.0, help="Of the shaft.")
@click.option("--waviness-um", type=option.NOT_NEGATIVE, default=0.0, help="Amplitude of waves.")
@click.option("--waviness-order", type=click.IntRange(1), default=12, help="Waves around the race.")
@click.option("--waviness-race", type=click.Choice(["outer", "inner"]), default="outer")
@click.option("--gravity/--no-gravity", default=False, help="Add gravity on the masses, along the load.")
@click.option("--slip-deg", type=click.FloatRange(0, 28), default=0.0, help="Largest slip angle.")
@click.option("--slip-rule", type=click.Choice(["per_passage", "mean_force"]), default="per_passage")
@click.option("--duration-s", type=click.FloatRange(0.01, 60.0), help="Default: as --accuracy needs; 1 for files.")
@click.option(
    "--model",
    type=click.Choice([AUTO, *MODELS, *brought("simulate")]),
    default=AUTO,
    help="auto: the cheapest that has all.",
)
@click.option("--accuracy", type=click.FloatRange(1e-7, 0.1), default=1e-3, help="Relative error of --quantity.")
@click.option("--quantity", type=click.Choice(QUANTITIES), default="rms", help="What the accuracy is for.")
@click.option("--tolerance", type=click.FloatRange(1e-12, 0.1), help="Of settling; a hundredth of --accuracy.")
@click.option("--periods", type=click.IntRange(min=20), default=300, help="Ball periods where it does not settle.")
@click.option("--rms-band-hz", type=option.Range(), help="Take RMS and peak in this band only.")
@click.option("--plot", type=option.OUT_FILE, help="Draw the scene (PNG, SVG or HTML).")
@click.option("--waveform", type=option.OUT_FILE, help="Write the signal as CSV.")
@click.option("--derivatives", default="", metavar="NAME,...", help="By load, speed, k_r ...; see the reference.")
@click.option("--compare", is_flag=True, help="Every model that describes the scene.")
@click.option("--sweep", type=SweepRange(), help="Follow the motion along an option; folds, lost stability.")
@option.line_contact
@with_speeds
@further_effects
@option.output
def command(config_path: Path | None, name: str | None, as_json: bool, **options: Any) -> option.Result | None:
    """Simulate a bearing with a defect and print RMS, peak and lines.

    A motion that repeats with the ball passage is solved for one period; any other (a rotating defect, several defects,
    an unbalance, slip) is simulated over time and averaged, with its standard error.

    --model gear_train simulates the train of [gear] instead.
    """
    check_suffix("--plot", options["plot"], PICTURES)
    if options["model"] in brought("simulate"):
        load("simulate", options["model"])(config_path, options, as_json=as_json)
        return None
    config = read_machine(config_path)
    given = {key: options[key] for key in _USUAL if options[key] is not None}
    configured = {key: value for key in _USUAL if (value := getattr(config.operating, key)) is not None}
    options |= _USUAL | configured | given
    with input_errors("simulate"):
        settle_speeds(options, given)
    entry, clearance = find_entry(config, name)
    if options["clearance_um"] is not None:
        clearance = options["clearance_um"] * 1e-6
    with input_errors("simulate"):
        rig = config.rig_of(entry)
        if options["line_contact"] != "palmgren":
            rig = _with_line_contact(rig, entry, options)
        second = None if options["second_bearing"] is None else find_entry(config, options["second_bearing"])[0].bearing
        scene = _scene(options, entry.bearing, rig, clearance, second)
        if options["compare"]:
            compared = compare(scene, config, entry, options)
            return compared, compared_lines(compared)
        scene, left_out = with_machine(with_parameters(scene, config, entry, options["parameters"]), config)
        values = _answer(scene, options) if options["sweep"] is None else swept(scene, options)
        values["left_out"] += [{"effect": key, "bound": None} for key in left_out]
    return values, _lines(values, scene) if options["sweep"] is None else swept_lines(values)


def _with_line_contact(rig: Rig, entry: CatalogueEntry, options: dict[str, Any]) -> Rig:
    """Return the parameters with the contact stiffness of a roller by the formula that is asked for."""
    if entry.bearing.element == "ball":
        raise ValueError(f"--line-contact is the contact of rollers, {entry.bearing.designation} has balls")
    return replace(rig, k_c=estimate_stiffness(entry, options["line_contact"], options["load_newton"]).value)


def _answer(scene: Scene, options: dict[str, Any]) -> dict[str, Any]:
    """Simulate a scene; return its values and write the requested files."""
    response = simulated(scene, options)
    sensor: Sensor = options["sensor"] or response.accelerometer
    row_of(response.sensors, sensor)
    if options["waveform"] is not None:
        signal = response.acceleration(WAVEFORM_RATE, options["duration_s"], sensor=sensor)
        tacho = None if options["tacho"] is None else tacho_signal(response, scene, options, WAVEFORM_RATE)
        _write_waveform(options["waveform"], signal, sensor, response.status, tacho)
    if options["plot"] is not None:
        _plot(response, options, scene, sensor)
    values = _values(response, scene, sensor) | speed_values(scene, options["duration_s"])
    return values | derivative_values(response)


def _values(response: Response, scene: Scene, sensor: Sensor) -> dict[str, Any]:
    """Return what is printed of one sensor; errors and spread, known for the first, apply relatively."""
    rms, peak = response.levels_of(sensor)
    share = rms / response.rms if response.rms > 0.0 else 0.0
    one, text = unit_of_sensor(sensor)
    unit = unit_in_names(text)
    return {
        f"rms_{unit}": finite(rms / one),
        "rms_error": finite(response.rms_error),
        "quantity": response.quantity,
        "error": finite(response.error),
        f"rms_se_{unit}": finite(response.rms_se * share / one) if response.rms_se > 0.0 else None,
        f"peak_{unit}": finite(peak / one),
        "peak_error": finite(response.peak_error),
        "waveform_error": finite(response.waveform_error),
        "rms_resonator_g": finite(response.levels_of("mr")[0] / STANDARD_GRAVITY) if "mr" in response.sensors else None,
        **_frequencies(scene),
        f"harmonics_{unit}": [finite(float(line) / one) for line in response.lines(sensor)[1][:6]],
        "periods": response.periods,
        "period_change": finite(response.period_change),
        f"spread_{unit}": finite(response.spread * share / one),
        "sensor": sensor,
        "model": response.model,
        "solver": response.solver,
        "status": response.status,
        "why": response.why,
        "left_out": [one._asdict() for one in response.left_out],
        "added": [] if response.added is None else list(response.added.effects),
    }


def _frequencies(scene: Scene) -> dict[str, float]:
    lines = kinematics(scene.bearing, scene.speed)
    return {"bpfo_hz": lines.bpfo, "bpfi_hz": lines.bpfi, "bsf_hz": lines.bsf, "ftf_hz": lines.ftf}


def _scene(options: dict[str, Any], bearing: Bearing, rig: Rig, clearance: float, second: Bearing | None) -> Scene:
    waves = (Waviness(options["waviness_um"] * 1e-6, options["waviness_order"], options["waviness_race"]),)
    return Scene(
        speed=options["speed_hz"],
        load=options["load_newton"],
        bearing=bearing,
        rig=rig,
        defect=_first_defect(options),
        clearance=clearance,
        model=options["model"],
        waviness=waves if options["waviness_um"] > 0.0 else (),
        unbalance=options["unbalance_kg_m"],
        gravity=STANDARD_GRAVITY if options["gravity"] else 0.0,
        slip=_slip(options),
        more_defects=tuple(_more_defects(options)),
        second_bearing=second,
        axial_load=options["axial_load_newton"],
        couple_unbalance=options["couple_unbalance_kg_m2"],
        bow=options["bow_um"] * 1e-6,
        load_turns=options["rotating_load"],
        speed_slope=options["speed_slope_hz_per_s"],
        speed_profile=options["speed_profile"],
        physics=tuple(dict.fromkeys(options["physics"])),
    )


def _slip(options: dict[str, Any]) -> Slip | None:
    if options["slip_deg"] == 0.0:
        return None
    return Slip(math.radians(options["slip_deg"]), options["slip_rule"], options["seed"])


def _more_defects(options: dict[str, Any]) -> Iterator[Defect]:
    """Yield the further defects, with the floor and rows of the first."""
    if options["more_defect"] and _first_defect(options) is None:
        raise ValueError("--more-defect needs a first defect: give --dphi-deg and --h-d-um")
    for part, dphi, h_d, position in options["more_defect"]:
        yield _defect(options, part, dphi, h_d, position=math.radians(position))


def _plot(response: Response, options: dict[str, Any], scene: Scene, sensor: Sensor) -> None:
    from models.solve.registry import trajectories
    from monitor.report.figures.scene import fundamental_of, scene_sheet, signal_of

    sensed = signal_of(response, sensor, fundamental_of(scene)[0])
    moved = trajectories(scene, request_of(options), response)
    sheet = scene_sheet(scene, sensed, sensor=sensor, title=_title(options, scene), moved=moved)
    write_plot(sheet, options["plot"])


def _title(options: dict[str, Any], scene: Scene) -> str:
    damage = "healthy"
    if scene.defect is not None:
        where = {"outer": "outer race", "inner": "inner race", "ball": "ball"}[scene.defect.part]
        damage = f"{options['dphi_deg']:g}° x {options['h_d_um']:g} µm of the {where}, {options['floor']} floor"
        damage += f", {len(scene.more_defects)} more" if scene.more_defects else ""
    return f"{scene.bearing.designation}, {speed_words(scene)}, {scene.load:g} N, {damage}"


def _first_defect(options: dict[str, Any]) -> Defect | None:
    dphi, h_d, width = options["dphi_deg"], options["h_d_um"], options["width_deg"]
    if dphi == 0.0 or h_d == 0.0:
        return None
    return _defect(options, options["fault"], dphi, h_d, width=None if width is None else math.radians(width))


def _defect(options: dict[str, Any], part: Part, dphi: float, h_d: float, **place: Any) -> Defect:
    """Return a defect of so many degrees and µm."""
    return Defect(
        dphi_d=math.radians(dphi),
        h_d=h_d * 1e-6,
        floor=Floor(kind=options["floor"], seed=options["seed"]),
        rows=int(options["rows"]),
        part=part,
        first_row=options["first_row"] - 1,
        support=options["support"],
        **place,
    )


def _write_waveform(path: Path, signal: Any, sensor: Sensor, status: str, tacho: Any = None) -> None:
    """Write time, signal and the tacho where there is one, replacing the file in one step."""
    one, text = unit_of_sensor(sensor, status)
    columns = [np.arange(signal.size) / WAVEFORM_RATE, signal / one, *(() if tacho is None else (tacho,))]
    rows = np.column_stack(columns)
    header = f"time_s,{data_name(MEASURED[sensor], text)}" + ("" if tacho is None else ",tacho_v")
    with output_errors("--waveform", path), replacing(path) as temporary:
        np.savetxt(temporary, rows, delimiter=",", header=header, comments="", fmt="%.9g")


def _lines(values: dict[str, Any], scene: Scene) -> Iterator[str]:
    words = unit_of_sensor(values["sensor"])[1]
    unit = unit_in_names(words)
    if values["status"] == "uncalibrated":
        words = "(no unit)"
    rms, se, peak, spread = (values[f"{name}_{unit}"] for name in ("rms", "rms_se", "peak", "spread"))
    level = "RMS unknown" if rms is None else f"RMS {rms:.4g} {words}"
    if se is not None:
        level += f" (standard error {se:.2g} {words})"
    elif rms is not None and values["rms_error"] is not None:
        level += f" (estimated error {100.0 * values['rms_error']:.2g} %)"
    if values["quantity"] != "rms":
        error = "unknown" if values["error"] is None else f"{100.0 * values['error']:.2g} %"
        level += f" (error of {values['quantity']} {error})"
    if spread:
        level += f", {spread:.2g} {words} from period to period"
    if peak is not None:
        level += f", peak {peak:.4g} {words}"
    if values["rms_resonator_g"] is not None:
        level += f" (resonator RMS {values['rms_resonator_g']:.4g} g)"
    yield f"{values['status']} after {values['periods']} ball periods: {level}"
    harmonics = ", ".join("-" if a is None else f"{a:.3g}" for a in values[f"harmonics_{unit}"])
    yield f"BPFO {values['bpfo_hz']:.2f} Hz, its harmonics {harmonics} {words}"
    yield from speed_lines(values, scene)
    yield from derivative_lines(values)
    yield from _remarks(values, scene)


def _remarks(values: dict[str, Any], scene: Scene) -> Iterator[str]:
    """Yield the lines for people that only some scenes have."""
    if any(defect.part != "outer" for defect in scene.defects):
        yield (
            f"BPFI {values['bpfi_hz']:.2f} Hz, twice BSF {2.0 * values['bsf_hz']:.2f} Hz, FTF {values['ftf_hz']:.2f} Hz"
        )
    if scene.defect is not None and scene.defect.floor.kind == "rough":
        yield f"floor {floor_of_defect('rough', scene.defect.floor.sd)}"
    if values["why"] is not None:
        yield values["why"]
    if values["status"] == "uncalibrated":
        yield f"{values['model']}: {NO_UNIT}"
    if unknown := [one["effect"] for one in values["left_out"] if one["bound"] is None]:
        yield f"configured, but left out by {values['model']}: {', '.join(unknown)}"
    if scene.defect is None:
        yield "no defect: give --dphi-deg and --h-d-um"
