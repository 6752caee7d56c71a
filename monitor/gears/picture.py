"""``spallwatch gear --plot``: what is drawn of a train."""

from __future__ import annotations

import cmath
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from monitor.commands.common import output_errors
from monitor.gears.forces import GearRun

Array = NDArray[np.float64]

if TYPE_CHECKING:
    from monitor.gears.figure import GearPicture


def draw_gears(run: GearRun, values: dict[str, Any], name: str, path: Path) -> None:
    """Draw a train, its forces and its levels.

    Args:
        run: its motion.
        values: what the command prints.
        name: of the machine or the file.
        path: PNG, SVG or HTML.

    Raises:
        InputError: the file cannot be written.
    """
    from monitor.gears.figure import gear_sheet
    from monitor.report.figures.sheet import write_sheet

    with output_errors("--plot", path):
        write_sheet(gear_sheet(gear_picture(run, values, name)), path)


def gear_picture(run: GearRun, values: dict[str, Any], name: str) -> GearPicture:
    """Return what is drawn."""
    from monitor.gears.figure import DrawnForce, DrawnWheel, GearPicture, Levels

    centres = shaft_centres(run)
    at, radius = run.builder.gear.shaft_of, _pitch_radii(run)
    levels: list[Levels] = []
    if (casing := values["casing"]) is not None:
        rows = {one["name"]: one["bands_db"] for one in casing["outputs"]}
        levels.append(Levels("Acceleration of the casing", "level (dB re 1 µm/s²)", casing["bands_hz"], rows))
    if (sound := values["sound"]) is not None:
        rows = {one["name"]: one["bands_dba"] for one in sound["microphones"]}
        levels.append(Levels("Sound", "level (dB(A) re 20 µPa)", sound["bands_hz"], rows))
    train = values["train"]
    faults = "; ".join(train["faults"]) or "healthy"
    return GearPicture(
        title=f"{name}: gear train at {train['torque_newton_m']:.4g} N m, {train['power_kw']:.4g} kW",
        lead=f"{faults}; {train['status'].replace('_', ' ')}, {train['duration_s']:.3g} s.",
        wheels=[
            DrawnWheel(
                f"{wheel.name} ({wheel.teeth})",
                centres[at[wheel.name]].real,
                centres[at[wheel.name]].imag,
                radius[wheel.name],
            )
            for wheel in run.builder.gear.wheel
        ],
        forces=[
            DrawnForce(centre.real, centre.imag, (float(total[:, 0].mean()), float(total[:, 1].mean())))
            for shaft, centre in centres.items()
            if (total := _force_of(run, shaft)) is not None
        ],
        stiffness={mesh.name: mesh.stiffness.base for mesh in run.train.meshes},
        shafts={
            shaft: _along_mean(total)
            for shaft in run.builder.gear.shafts
            if (total := _force_of(run, shaft)) is not None
        },
        rate=run.motion.rate,
        meshes=list(run.train.mesh_frequencies().values()),
        modes=train["natural_frequencies_hz"],
        levels=levels,
    )


def shaft_centres(run: GearRun) -> dict[str, complex]:
    """Return the axes of the shafts with wheels in their plane, x + iy, m; the first at 0.

    Shafts that no mesh joins to those before begin beside the origin.
    """
    at = run.builder.gear.shaft_of
    found: dict[str, complex] = {at[run.builder.gear.pair[0].wheels[0]]: 0j}
    waiting = list(run.builder.pairs)
    while waiting:
        for model in waiting:
            first, second = (at[name] for name in model.section.wheels)
            arm = cmath.rect(model.distance, math.radians(model.section.direction_deg))
            if first in found or second in found:
                if first in found:
                    found.setdefault(second, found[first] + arm)
                else:
                    found[first] = found[second] - arm
                waiting.remove(model)
                break
        else:
            found[at[waiting[0].section.wheels[0]]] = 0j
    return found


def _pitch_radii(run: GearRun) -> dict[str, float]:
    return {
        name: radius / math.cos(model.working_angle)
        for model in run.builder.pairs
        for name, radius in zip(model.section.wheels, model.base_radii, strict=True)
    }


def _force_of(run: GearRun, shaft: str) -> Array | None:
    """Return the force of all bearings of a shaft on the casing, N, (N, 2), None where it has none."""
    forces = [run.forces[support.name] for support in run.builder.gear.support if support.shaft == shaft]
    return np.sum(forces, axis=0) if forces else None


def _along_mean(force: Array) -> Array:
    mean = force.mean(axis=0)
    size = float(np.linalg.norm(mean))
    unit = mean / size if size > 0.0 else np.array([1.0, 0.0])
    return np.asarray((force - mean) @ unit, dtype=np.float64)
