"""Nodes of maps by models other than the six-degree-of-freedom one: each is a scene of its own, simulated over time.

The level is that of the model's first sensor of acceleration; its relative errors are those of the first sensor. Times
are lengthened until the error of the mean is below the accuracy of a node, or the longest is reached; what is
left stands beside the level.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from models.machine.bearing import kinematics
from models.maps.plan import LINES, MAP_ACCURACY, MapError, MapPlan, scene_at
from models.solve.response import HARMONICS, row_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from models.machine.scene import Scene
    from models.solve.response import Response, Status
    from models.words.request import Sensor

Point = tuple[float, float, float, float]

# Simulated times after what is dropped at the beginning, s.
_DURATIONS = (0.25, 1.0, 4.0)


@dataclass(frozen=True, eq=False)
class ModelLevel:
    """One point of a map on one floor.

    Attributes:
        rms, se, spread: level, its standard error and its standard deviation from block to block, m/s2.
        error: relative error of the level by the steps.
        harmonics: lines 1..6 of the damaged part, m/s2, shape (6,).
        status: of the simulation.
        sensor: whose level it is.
    """

    rms: float
    se: float
    spread: float
    error: float
    harmonics: NDArray[np.float64]
    status: Status
    sensor: Sensor


def check_model(plan: MapPlan) -> Sensor:
    """Return the sensor whose level a map has.

    Raises:
        MapError: if the model does not describe the scenes of the plan, or has no sensor of acceleration.
    """
    scene = scene_at(plan, plan.load[-1], plan.speed[-1], plan.h_d[-1], plan.dphi_d[-1])
    try:
        return acceleration_sensor(_simulated(plan, scene, _DURATIONS[0], 1).sensors)
    except ValueError as error:
        raise MapError(f"a map by the model {plan.model}: {error}") from error


def acceleration_sensor(sensors: tuple[Sensor, ...]) -> Sensor:
    """Return the first sensor that shows acceleration; raise a ValueError where there is none."""
    for sensor in sensors:
        if sensor != "ias":
            return sensor
    raise ValueError(f"no sensor of acceleration among {', '.join(sensors)}")


def model_level(plan: MapPlan, point: Point, seed: int = 0, factor: int = 1) -> ModelLevel:
    """Return the level at one point (load, speed, h_d, dphi_d) of a plan on one floor.

    Accuracy and standard error are those of the nodes divided by ``factor``.

    Raises:
        ValueError: if the scene is outside the model.
    """
    scene = scene_at(plan, *point, seed)
    accuracy = MAP_ACCURACY / factor
    response = _simulated(plan, scene, _DURATIONS[0], factor)
    for duration in _DURATIONS[1:]:
        if response.averaging_error <= accuracy and response.status != "not_converged":
            break
        response = _simulated(plan, scene, duration, factor)
    sensor = acceleration_sensor(response.sensors)
    first, rms = response.rms, response.levels_of(sensor)[0]
    share = rms / first if first > 0.0 else 0.0
    return ModelLevel(
        rms=rms,
        se=response.rms_se * share,
        spread=response.spread * share,
        error=max(0.0, response.rms_error - response.averaging_error),
        harmonics=_lines(plan, response, point[1], row_of(response.sensors, sensor)),
        status=response.status,
        sensor=sensor,
    )


def _simulated(plan: MapPlan, scene: Scene, duration: float, factor: int) -> Response:
    from models.solve.simulate import simulate

    steps = None if plan.steps_per_period is None else factor * plan.steps_per_period
    return simulate(
        scene,
        accuracy=MAP_ACCURACY / factor,
        steps_per_period=steps,
        band=plan.rms_band,
        lines_to=0.0 if plan.rms_band is None else plan.rms_band[1],
        duration=duration,
    )


def _lines(plan: MapPlan, response: Response, speed: float, row: int) -> NDArray[np.float64]:
    """Return the lines of the damaged part at one sensor, as far as they can be told from the response."""
    if response.record is None:
        return response.harmonics
    found = kinematics(plan.bearing, speed)
    line = {"BPFO": found.bpfo, "BPFI": found.bpfi, "2 BSF": 2.0 * found.bsf}[LINES[plan.part]]
    return 2.0 * np.abs(response.record.coefficients(line, HARMONICS)[row, 1:])


def scene_levels(
    scenes: Sequence[Scene], band: tuple[float, float] | None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return RMS in a band, Hz, (n,), and lines 1..6 (n, 6) of scenes with one defect, m/s2; NaN where they diverge.

    Raises:
        ValueError: if a scene is outside its model, or has no defect.
    """
    rms, lines = np.full(len(scenes), np.nan), np.full((len(scenes), HARMONICS), np.nan)
    for i, scene in enumerate(scenes):
        defect = scene.defect
        if defect is None:
            raise ValueError("a block of a life needs a scene with a defect, got None")
        plan = MapPlan(
            load=(scene.load,),
            speed=(scene.speed,),
            h_d=(defect.h_d,),
            dphi_d=(defect.dphi_d,),
            bearing=scene.bearing,
            rig=scene.rig,
            clearance=scene.clearance,
            rms_band=band,
            model=scene.model,
            part=defect.part,
        )
        level = model_level(plan, (scene.load, scene.speed, defect.h_d, defect.dphi_d))
        if level.status != "not_converged":
            rms[i], lines[i] = level.rms, level.harmonics
    return rms, lines
