"""Gear trains: mesh frequencies, and the motion with its forces on the bearings."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from models.words.errors import WrongInputError
from monitor.gears.forces import build_train, force_values, run_train
from monitor.gears.kinematics import GearInput, gear_input, kinematic_values, read_gears

if TYPE_CHECKING:
    import xarray as xr


def mesh_frequencies(gears: Path | str | Mapping[str, Any], *, speed_hz: float | None = None) -> dict[str, float]:
    """Return the mesh frequency of each pair, Hz, by the names of its wheels.

    Args:
        gears: stages such as "23/71 17/53", a configuration's path, or its tables with ``gear``.
        speed_hz: of the first shaft, or of ``bearing_shaft``; by default that of the configuration.

    Raises:
        WrongInputError: the gears cannot be read or turn, or no speed is given.
    """
    given = _given(gears)
    pairs = kinematic_values(given.gear, _speed(given, speed_hz))["pairs"]
    return {f"{pair['driver']}-{pair['driven']}": pair["mesh_hz"] for pair in pairs}


def gear_motion(
    gears: Path | str | Mapping[str, Any],
    *,
    speed_hz: float | None = None,
    duration_s: float = 1.0,
    rate_hz: float | None = None,
) -> xr.Dataset:
    """Return the motion of a train over whole turns of its drive; SI units, which attributes name.

    Forces of the bearings on the casing (time, support, axis), forces and transmission error of the meshes (time,
    mesh), natural frequencies, shares of the time out of contact. The attribute ``status`` is "settled", "not_settled"
    or "not_finite".

    Args:
        gears: a configuration's path, or its tables with ``gear``, which has all that the model needs.
        speed_hz: of ``bearing_shaft``; by default that of the configuration.
        duration_s: wished for.
        rate_hz: instants a second; by default 51200, or more where a mesh needs it.

    Raises:
        WrongInputError: a key is missing or does not fit; the message names each.
    """
    import xarray as xr

    if not duration_s > 0.0:
        raise WrongInputError(f"duration_s must be positive, got {duration_s!r}")
    given = _given(gears)
    run = run_train(build_train(given, _speed(given, speed_hz)), duration_s, rate_hz)
    values = force_values(run)
    motion, meshes = run.motion, [mesh.name for mesh in run.train.meshes]
    return xr.Dataset(
        {
            "support_force": (
                ("time", "support", "axis"),
                np.stack(list(run.forces.values()), axis=1),
                {"units": "N", "long_name": "on the casing"},
            ),
            "mesh_force": (("time", "mesh"), motion.mesh_force, {"units": "N"}),
            "transmission_error": (("time", "mesh"), motion.transmission_error, {"units": "m"}),
            "mesh_stiffness": ("mesh", [mesh.stiffness.mean for mesh in run.train.meshes], {"units": "N m-1"}),
            "mesh_frequency": ("mesh", list(run.train.mesh_frequencies().values()), {"units": "Hz"}),
            "out_of_contact": ("mesh", motion.out_of_contact, {"units": "1"}),
            "natural_frequency": ("mode", values["natural_frequencies_hz"], {"units": "Hz"}),
        },
        {
            "time": ("time", np.arange(len(motion.mesh_force)) / motion.rate, {"units": "s"}),
            "support": list(run.forces),
            "axis": ["x", "y"],
            "mesh": meshes,
        },
        {
            "status": values["status"],
            "drive_torque": values["torque_newton_m"],
            "energy_residual": np.nan if values["energy_residual"] is None else values["energy_residual"],
            "faults": "; ".join(values["faults"]),
        },
    )


def _given(gears: Path | str | Mapping[str, Any]) -> GearInput:
    if isinstance(gears, Mapping):
        return gear_input(gears, "gears")
    stages = str(gears).split()
    if isinstance(gears, str) and all(part.replace("/", "").isdigit() for part in stages):
        return read_gears(None, stages)
    return read_gears(Path(gears), ())


def _speed(given: GearInput, speed: float | None) -> float:
    if speed is not None and not speed > 0.0:
        raise WrongInputError(f"speed_hz must be positive, got {speed!r}")
    found = given.config.operating.speed_hz if speed is None else speed
    if found is None:
        raise WrongInputError("speed_hz: neither given nor in the configuration ([operating])")
    return found
