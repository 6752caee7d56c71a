"""``spallwatch gear``: a gear train, from its orders to what is heard."""

from __future__ import annotations

from pathlib import Path

import click

from monitor.commands import option
from monitor.commands.common import InputError, check_suffix, emit
from monitor.commands.gear_kinematics import kinematic_lines, kinematic_values, read_gears


@click.command("gear")
@click.argument("stages", nargs=-1, metavar="[TEETH/TEETH]...")
@option.config
@click.option("--speed-hz", type=option.POSITIVE, help="Of the bearings' shaft; default: that of [operating].")
@click.option("--duration-s", type=click.FloatRange(0.01, 60.0), default=1.0, help="Of the motion; whole turns.")
@click.option("--rate-hz", type=click.FloatRange(1000.0, 1e6), default=51200.0, help="Instants a second.")
@click.option("--csv", "csv_path", type=option.OUT_FILE, help="Write the forces over time.")
@option.output
def command(
    stages: tuple[str, ...],
    config_path: Path | None,
    speed_hz: float | None,
    duration_s: float,
    rate_hz: float,
    csv_path: Path | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Print speeds, mesh orders and frequencies, sidebands and hunting teeth of a gear train.

    The train is [gear] of a configuration, or stages such as 23/71 17/53: the driven wheel of one sits on the shaft of
    the next. The speed is that of the first shaft, or of bearing_shaft of [gear].

    Where [gear] has [[gear.shaft]], its motion is computed too: natural frequencies, forces of meshes and bearings,
    loss of contact.
    """
    del quiet
    given = read_gears(config_path, stages)
    speed = speed_hz if speed_hz is not None else given.config.operating.speed_hz
    values, lines = kinematic_values(given.gear, speed), []
    wanted = [name for name, path in (("--csv", csv_path),) if path is not None]
    if csv_path is not None:
        check_suffix("--csv", csv_path, (".csv",))
    if given.gear.shaft:
        from monitor.commands.gear_forces import build_train, force_lines, force_values, run_train, write_forces

        run = run_train(build_train(given, speed), duration_s, rate_hz)
        forces = force_values(run)
        values["train"], lines = forces, [*force_lines(forces)]
        if csv_path is not None:
            write_forces(run, csv_path)
    elif wanted:
        raise InputError(
            f"{given.name}: {wanted[0]} needs the train itself: [[gear.shaft]] with mass and inertia, and more"
        )
    else:
        values["train"] = None
    emit(values, [*kinematic_lines(values), *lines], as_json=as_json)
