"""``spallwatch simulate --model gear_train``: the train of ``[gear]`` in the place of a bearing."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from monitor.commands.common import InputError, check_suffix, emit
from monitor.commands.gear_kinematics import read_gears

GEAR_TRAIN = "gear_train"
_TAKEN = {"config_path", "speed_hz", "duration_s", "model", "plot", "waveform", "as_json", "quiet"}
"""Options of ``simulate`` that a train takes; the others are about a bearing."""


def simulate_gears(config_path: Path | None, options: Mapping[str, Any], *, as_json: bool) -> None:
    """Simulate the train of ``[gear]``, print forces and write the files that are asked for.

    Raises:
        InputError: an option of a bearing was given, or the train cannot be built.
    """
    context = click.get_current_context()
    for parameter in context.command.params:
        name = parameter.name or ""
        if name not in _TAKEN and context.get_parameter_source(name) is ParameterSource.COMMANDLINE:
            raise InputError(
                f"{parameter.opts[0]} is about a bearing; --model {GEAR_TRAIN} takes its train from [gear]"
            )
    from monitor.commands.gear_forces import build_train, force_lines, force_values, run_train, write_forces

    waveform, plot = options["waveform"], options["plot"]
    if waveform is not None:
        check_suffix("--waveform", waveform, (".csv",))
    given = read_gears(config_path, ())
    if not given.gear.shaft:
        raise InputError(f"{given.name}: --model {GEAR_TRAIN} needs [[gear.shaft]] with mass and inertia, and more")
    configured = given.config.operating.speed_hz
    builder = build_train(given, configured if options["speed_hz"] is None else options["speed_hz"])
    run = run_train(builder, 1.0 if options["duration_s"] is None else options["duration_s"])
    values = force_values(run)
    if waveform is not None:
        write_forces(run, waveform, "--waveform")
    if plot is not None and run.motion.finite:
        from monitor.commands.gear_picture import draw_gears

        draw_gears(run, {"train": values, "casing": None, "sound": None}, given.title, plot)
    emit({"model": GEAR_TRAIN, **values}, force_lines(values), as_json=as_json)
