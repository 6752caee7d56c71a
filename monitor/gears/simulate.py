"""``spallwatch simulate --model gear_train``: the train of ``[gear]`` in the place of a bearing."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np
from click.core import ParameterSource

from monitor.commands.common import InputError, check_suffix, emit, finite
from monitor.gears.kinematics import read_gears
from streams.types.block import STANDARD_GRAVITY

if TYPE_CHECKING:
    from monitor.gears.forces import GearRun

GEAR_TRAIN = "gear_train"
_TAKEN = {"config_path", "speed_hz", "duration_s", "model", "plot", "waveform", "as_json", "quiet"}
"""Options of ``simulate`` that a train takes; the others are about a bearing."""
_ACCURACY = 1e-3
"""Relative error of the RMS, by halving the steps, up to which a motion has converged."""
_STATUSES = {"settled": "converged", "not_settled": "not_periodic", "not_finite": "not_converged"}


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
    from monitor.gears.forces import build_train, force_lines, force_values, run_train, write_forces

    waveform, plot = options["waveform"], options["plot"]
    if waveform is not None:
        check_suffix("--waveform", waveform, (".csv",))
    given = read_gears(config_path, ())
    if not given.gear.shaft:
        raise InputError(f"{given.name}: --model {GEAR_TRAIN} needs [[gear.shaft]] with mass and inertia, and more")
    configured = given.config.operating.speed_hz
    builder = build_train(given, configured if options["speed_hz"] is None else options["speed_hz"])
    run = run_train(builder, 1.0 if options["duration_s"] is None else options["duration_s"])
    values = {"model": GEAR_TRAIN, **force_values(run), **levels_of(run)}
    if waveform is not None:
        write_forces(run, waveform, "--waveform")
    if plot is not None and run.motion.finite:
        from monitor.gears.picture import draw_gears

        draw_gears(run, {"train": values, "casing": None, "sound": None}, given.title, plot)
    emit(values, [*force_lines({**values, "status": run.status}), level_line(values)], as_json=as_json)


def levels_of(run: GearRun) -> dict[str, Any]:
    """Return the acceleration of the shaft on which the speed counts, along the mean force on its bearings.

    ``rms_error`` is the change of the RMS when the steps are halved; ``status`` is that of the other models:
    ``converged`` where the motion has settled and that error is within 1e-3.
    """
    from models.gears.train.motion import longest_step, simulate_train

    train, motion, body = run.train, run.motion, run.builder.gear.speed_shaft
    supports, status = train.body(body).supports, _STATUSES[run.status]
    if not motion.finite or not supports:
        unknown = {"rms_g": None, "peak_g": None, "rms_error": None, "sensor": None}
        return {**unknown, "status": "inaccurate" if status == "converged" else status}
    force = np.sum([run.forces[support.name].mean(axis=0) for support in supports], axis=0)
    angle = math.atan2(force[1], force[0])

    def along(acceleration: np.ndarray[Any, np.dtype[np.float64]]) -> np.ndarray[Any, np.dtype[np.float64]]:
        x, y = (acceleration[:, motion.names.index(f"{body}.{axis}")] for axis in "xy")
        return math.cos(angle) * x + math.sin(angle) * y

    found = along(motion.acceleration)
    rms = math.sqrt(float(np.mean(found**2)))
    finer = simulate_train(train, duration=len(found) / motion.rate, rate=motion.rate, step=0.5 * longest_step(train))
    halved = math.sqrt(float(np.mean(along(finer.acceleration) ** 2)))
    error = abs(halved - rms) / rms if rms > 0.0 else 0.0
    return {
        "rms_g": rms / STANDARD_GRAVITY,
        "peak_g": float(np.abs(found).max()) / STANDARD_GRAVITY,
        "rms_error": finite(error),
        "sensor": f"{body} at {math.degrees(angle):.1f} deg",
        "status": "inaccurate" if status == "converged" and not error <= _ACCURACY else status,
    }


def level_line(values: Mapping[str, Any]) -> str:
    """Return the level of the acceleration and the status for people."""
    if values["rms_g"] is None:
        return f"acceleration: not known; {values['status']}"
    return (
        f"acceleration of shaft {values['sensor']}: RMS {values['rms_g']:.4g} g, peak {values['peak_g']:.4g} g; "
        f"RMS to {values['rms_error']:.1g}; {values['status']}"
    )
