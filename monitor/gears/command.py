"""``spallwatch gear``: a gear train, from its orders to its sound."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from monitor.commands import option
from monitor.commands.common import PICTURES, InputError, check_suffix, emit, say
from monitor.gears.kinematics import GearInput, kinematic_lines, kinematic_values, read_gears

if TYPE_CHECKING:
    from monitor.gears.forces import GearRun
    from monitor.gears.transfer import CasingResponses

_FILES: dict[str, tuple[tuple[str, ...], str | None]] = {
    "csv": ((".csv",), None),
    "casing": ((".toml",), None),
    "frf": ((".csv", ".uff", ".unv"), None),
    "atv": ((".csv", ".npz"), "frf"),
    "wav": ((".wav",), None),
    "plot": (PICTURES, None),
}
"""Options that name a file: what it may end in, and the option without which it has no use."""


@click.command("gear")
@click.argument("stages", nargs=-1, metavar="[TEETH/TEETH]...")
@option.config
@click.option("--speed-hz", type=option.POSITIVE, help="Of the bearings' shaft; default: that of [operating].")
@click.option("--duration-s", type=click.FloatRange(0.01, 60.0), default=1.0, help="Of the motion; whole turns.")
@click.option("--rate-hz", type=click.FloatRange(1000.0, 1e7), help="Instants a second; default 51200 or more.")
@click.option("--csv", type=option.OUT_FILE, help="Write the forces over time.")
@click.option("--casing", type=option.FILE, help="A box by finite elements (TOML), with its sound.")
@click.option("--frf", type=option.FILE, help="Responses of the casing to the bearings (CSV, UFF58).")
@click.option("--atv", type=option.FILE, help="Acoustic transfer vectors of the surface (.npz, .csv).")
@click.option("--wav", type=option.OUT_FILE, help="Write the sound at the microphones.")
@click.option("--plot", type=option.OUT_FILE, help="Draw the train, forces and levels (PNG, SVG or HTML).")
@option.output
def command(
    stages: tuple[str, ...],
    config_path: Path | None,
    speed_hz: float | None,
    duration_s: float,
    rate_hz: float | None,
    as_json: bool,
    quiet: bool,
    **files: Path | None,
) -> None:
    """Print speeds, mesh orders and frequencies, sidebands and hunting teeth of a gear train.

    The train is [gear] of a configuration, or stages such as 23/71 17/53: the driven wheel of one sits on the shaft of
    the next. The speed is that of the first shaft, or of bearing_shaft of [gear].

    Where [gear] has [[gear.shaft]], its motion is computed too: natural frequencies, forces of meshes and bearings,
    loss of contact. With --frf or --casing they become accelerations and third-octave levels; with --atv, where the
    responses are pressures, or with a [[microphone]] of --casing, sound.
    """
    for name, (suffixes, needs) in _FILES.items():
        path = files[name]
        if path is None:
            continue
        check_suffix(f"--{name}", path, suffixes)
        if needs is not None and files[needs] is None:
            raise InputError(f"--{name} {path}: needs --{needs}")
    given = read_gears(config_path, stages)
    speed = speed_hz if speed_hz is not None else given.config.operating.speed_hz
    values: dict[str, Any] = kinematic_values(given.gear, speed) | {
        "train": None,
        "casing_by_elements": None,
        "casing": None,
        "sound": None,
    }
    lines = [*kinematic_lines(values)]
    if given.gear.shaft:
        lines += _add_motion(given, speed, duration_s, rate_hz, files, values, quiet=quiet)
    elif wanted := next((name for name, path in files.items() if path is not None), None):
        raise InputError(
            f"{given.name}: --{wanted} needs the train itself: [[gear.shaft]] with mass and inertia, and more"
        )
    emit(values, lines, as_json=as_json)


def _add_motion(
    given: GearInput,
    speed: float | None,
    duration: float,
    rate: float | None,
    files: Mapping[str, Path | None],
    values: dict[str, Any],
    *,
    quiet: bool,
) -> Iterator[str]:
    """Add motion, levels and sound of the train to the values; yield them as text, and write the files."""
    from monitor.gears.forces import build_train, force_lines, force_values, run_train, write_forces

    builder = build_train(given, speed)
    casing, known = _casing(given, files, quiet=quiet)
    run = run_train(builder, duration, rate, 0.0 if casing is None else 2.0 * casing.lead)
    values["train"] = force_values(run)
    yield from force_lines(values["train"])
    if files["csv"] is not None:
        write_forces(run, files["csv"])
    if casing is not None and run.motion.finite:
        yield from _add_levels(run, casing, known, files["wav"], values)
    if files["plot"] is not None and run.motion.finite:
        from monitor.gears.picture import draw_gears

        draw_gears(run, values, given.title, files["plot"])


def _casing(
    given: GearInput, files: Mapping[str, Path | None], *, quiet: bool
) -> tuple[CasingResponses | None, dict[str, Any]]:
    """Return the responses of the casing, None where none is asked for, and what is known of one by elements."""
    frf, shape, wav = files["frf"], files["casing"], files["wav"]
    if frf is not None and shape is not None:
        raise InputError(f"--frf {frf} and --casing {shape}: give one of them")
    casing: CasingResponses | None = None
    known: dict[str, Any] = {}
    if frf is not None:
        from monitor.gears.transfer import read_casing

        casing = read_casing(given.gear, frf, files["atv"])
    elif shape is not None:
        from monitor.gears.casing import casing_by_elements

        casing, known = casing_by_elements(given.gear, shape, lambda text: say(text, quiet=quiet))
    if wav is not None and (casing is None or casing.pressure is None):
        raise InputError(
            f"--wav {wav}: there is no sound; give --atv, responses in Pa, or a [[microphone]] of --casing"
        )
    return casing, known


def _add_levels(
    run: GearRun, casing: CasingResponses, known: dict[str, Any], wav: Path | None, values: dict[str, Any]
) -> Iterator[str]:
    """Add acceleration and sound to the values; yield them as text, and write the sound."""
    from monitor.gears.transfer import (
        felt,
        motion_lines,
        motion_values,
        pressure_lines,
        pressure_values,
        write_sound,
    )

    if known:
        from monitor.gears.casing import casing_lines

        values["casing_by_elements"] = known
        yield from casing_lines(known)
    if casing.motion is not None:
        values["casing"] = motion_values(felt(run, casing.motion, casing.lead))
        yield from motion_lines(values["casing"])
    if casing.pressure is None:
        return
    heard = felt(run, casing.pressure, casing.lead)
    values["sound"] = pressure_values(heard)
    yield from pressure_lines(values["sound"])
    if wav is not None:
        values["sound"]["full_scale_pascal"] = write_sound(heard, wav)
        yield f"wrote {wav}, full scale at {values['sound']['full_scale_pascal']:g} Pa"
