"""``spallwatch gear``: a gear train, from its orders to what is heard."""

from __future__ import annotations

from pathlib import Path

import click

from monitor.commands import option
from monitor.commands.common import emit
from monitor.commands.gear_kinematics import kinematic_lines, kinematic_values, read_gears


@click.command("gear")
@click.argument("stages", nargs=-1, metavar="[TEETH/TEETH]...")
@option.config
@click.option("--speed-hz", type=option.POSITIVE, help="Of the bearings' shaft; default: that of [operating].")
@option.output
def command(
    stages: tuple[str, ...], config_path: Path | None, speed_hz: float | None, as_json: bool, quiet: bool
) -> None:
    """Print speeds, mesh orders and frequencies, sidebands and hunting teeth of a gear train.

    The train is [gear] of a configuration, or stages such as 23/71 17/53: the driven wheel of one sits on the shaft of
    the next. The speed is that of the first shaft, or of bearing_shaft of [gear].
    """
    del quiet
    config = read_gears(config_path, stages)
    assert config.gear is not None
    speed = speed_hz if speed_hz is not None else config.operating.speed_hz
    values = kinematic_values(config.gear, speed)
    emit(values, kinematic_lines(values), as_json=as_json)
