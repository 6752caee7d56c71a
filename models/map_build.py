"""Building and checking RMS maps. The simulation, and numba with it, is imported only when points are computed."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Any

import numpy as np

from models.bearing import kinematics
from models.map_data import HARMONICS, MODEL_VERSION, SCHEMA_VERSION, STATUSES, MapError, MapPlan, RmsMap
from models.scene import Defect, Scene

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.response import Response

Progress = Callable[[int, int], None]

# What the steps of a map may leave of error (see models.dynamics.six_dof.steps_for); the map says what they did leave.
MAP_ACCURACY = 1e-3
# Nodes on which a build measures the error of its own steps, against twice as many.
_ERROR_NODES = 24
_ERROR_SEED = 20220
# A node's share: everything that it contributes to the map, one row of numbers.
_COLUMNS = 5 + 2 * HARMONICS
_Task = tuple[MapPlan, int, int, int]


def build_map(plan: MapPlan, *, workers: int = 1, progress: Progress | None = None) -> RmsMap:
    """Return the map of a plan.

    Args:
        plan: what to build.
        workers: threads to share the nodes between; 0 means one a core. The result does not depend on it.
        progress: called with the nodes done and their total, from this process.

    Raises:
        ValueError: if the plan is outside what the model describes; the message names the field.
    """
    total = int(np.prod(plan.shape))
    values = np.empty((*plan.shape, _COLUMNS))
    tasks = [(plan, i, j, k) for i in range(plan.shape[0]) for j in range(plan.shape[1]) for k in range(plan.shape[2])]
    done = 0
    for (_, i, j, k), row in zip(tasks, _rows(tasks, workers), strict=True):
        values[i, j, k] = row
        done += plan.shape[3]
        if progress is not None:
            progress(done, total)
    rms = values[..., 0]
    return RmsMap(
        load=np.array(plan.load),
        speed=np.array(plan.speed),
        h_d=np.array(plan.h_d),
        dphi_d=np.array(plan.dphi_d),
        rms=rms,
        rms_std=values[..., 1],
        rms_se=values[..., 2],
        rms_error=(values[..., 3] + _step_error(plan)) * rms,
        harmonic_amplitude=values[..., 5 : 5 + HARMONICS],
        harmonic_std=values[..., 5 + HARMONICS :],
        status=values[..., 4].astype(np.int8),
        attributes=_attributes(plan),
    )


def _rows(tasks: list[_Task], workers: int) -> Iterator[NDArray[np.float64]]:
    workers = (os.cpu_count() or 1) if workers == 0 else workers
    if workers < 1:
        raise ValueError(f"workers must not be negative, got {workers!r}")
    if workers == 1 or len(tasks) == 1:
        yield from map(_row, tasks)
        return
    with ThreadPoolExecutor(min(workers, len(tasks))) as pool:
        try:
            yield from pool.map(_row, tasks)
        finally:
            pool.shutdown(cancel_futures=True)


def scene_at(plan: MapPlan, load: float, speed: float, h_d: float, dphi_d: float, seed: int = 0) -> Scene:
    """Return the scene of one point of a plan; ``seed`` counts its floors from zero."""
    floor = replace(plan.floor, seed=plan.floor.seed + seed)
    defect = Defect(dphi_d, h_d, floor, plan.position, plan.rows)
    return Scene(speed, load, plan.bearing, plan.rig, defect, plan.clearance, plan.model)


def _simulate(plan: MapPlan, scene: Scene, steps: int | None = None) -> Response:
    from models.simulate import simulate

    # Lines beyond the band and the stored harmonics are not needed.
    lines_to = 0.0 if plan.rms_band is None else plan.rms_band[1]
    steps = steps or _steps(plan, scene)
    return simulate(scene, band=plan.rms_band, steps_per_period=steps, lines_to=lines_to)


def _row(task: _Task) -> NDArray[np.float64]:
    """Return all nodes along dphi_d at one load, speed and depth, shape (D, _COLUMNS)."""
    from models.dynamics.rows import simulate_row

    plan, i, j, k = task
    extents = np.array(plan.dphi_d)
    rms, settling = np.empty((2, plan.floors, len(extents)))
    harmonics = np.empty((plan.floors, len(extents), HARMONICS))
    spread, status = np.zeros(len(extents)), np.zeros(len(extents))
    for seed in range(plan.floors):
        scene = scene_at(plan, plan.load[i], plan.speed[j], plan.h_d[k], plan.dphi_d[-1], seed)
        row = simulate_row(scene, extents, steps_per_period=_steps(plan, scene), band=plan.rms_band)
        rms[seed], settling[seed], harmonics[seed] = row.rms, row.change, row.harmonics
        # What does not settle at once is simulated on, and may not repeat at all.
        for d in np.flatnonzero(~row.settled):
            response = _simulate(plan, scene_at(plan, scene.load, scene.speed, plan.h_d[k], plan.dphi_d[d], seed))
            rms[seed, d], settling[seed, d], harmonics[seed, d] = response.rms, _settling(response), response.harmonics
            spread[d], status[d] = response.spread, max(status[d], STATUSES.index(response.status))
    several = plan.floors > 1
    harmonic_std = np.std(harmonics, axis=0, ddof=1) if several else np.zeros((len(extents), HARMONICS))
    if several:
        spread = np.std(rms, axis=0, ddof=1)
    error = spread / math.sqrt(plan.floors) if several else np.zeros(len(extents))
    columns = (np.mean(rms, axis=0), spread, error, np.max(settling, axis=0), status)
    return np.column_stack((*columns, np.mean(harmonics, axis=0), harmonic_std))


def _settling(response: Response) -> float:
    """Return the relative error of the RMS that the search for the settled motion leaves."""
    if response.status == "converged":
        return response.period_change
    return response.spread / response.rms if response.status == "not_periodic" else 1.0


def _nodes_at_random(plan: MapPlan, count: int, seed: int) -> list[tuple[float, float, float, float]]:
    """Return load, speed, h_d and dphi_d of random nodes, the healthy edges left out where there are others."""
    rng = np.random.default_rng(seed)
    depths = [h for h in plan.h_d if h > 0.0] or [plan.h_d[0]]
    extents = [x for x in plan.dphi_d if x > 0.0] or [plan.dphi_d[0]]
    axes = (plan.load, plan.speed, depths, extents)
    picks = [rng.integers(0, len(axis), count) for axis in axes]
    return [tuple(axis[pick[n]] for axis, pick in zip(axes, picks, strict=True)) for n in range(count)]


def _steps(plan: MapPlan, scene: Scene) -> int:
    """Return the steps per period that a scene of the plan is simulated with: finer where its band asks for it."""
    from models.dynamics.six_dof import steps_for
    from models.simulate import steps_to_resolve

    if plan.steps_per_period:
        return plan.steps_per_period
    duration = 1.0 / kinematics(scene.bearing, scene.speed).bpfo
    band = 0 if plan.rms_band is None else steps_to_resolve(plan.rms_band[1], duration)
    return max(steps_for(scene, MAP_ACCURACY), min(band, steps_for(scene)))


def _errors(plan: MapPlan, nodes: list[tuple[float, float, float, float]], factor: int) -> NDArray[np.float64]:
    """Return the relative errors of the RMS at points against ``factor`` times as many steps."""
    errors = []
    for load, speed, h_d, dphi_d in nodes:
        scene = scene_at(plan, load, speed, h_d, dphi_d)
        coarse, fine = _simulate(plan, scene), _simulate(plan, scene, factor * _steps(plan, scene))
        errors.append(0.0 if fine.rms == 0.0 else coarse.rms / fine.rms - 1.0)
    return np.array(errors)


def _step_error(plan: MapPlan) -> float:
    """Return the RMS relative error of the plan's steps, measured at some of its nodes."""
    return float(np.sqrt(np.mean(_errors(plan, _nodes_at_random(plan, _ERROR_NODES, _ERROR_SEED), 2) ** 2)))


@dataclass(frozen=True)
class MapCheck:
    """How far a map is from the converged model.

    Attributes:
        points: number of random nodes, and of random points between nodes.
        error_rms: RMS of the relative error of the stored RMS at nodes, against four times as many steps.
        error_max: largest absolute value of it.
        interpolation_rms: RMS of the error between nodes, relative to the largest RMS of the map's slice.
        interpolation_max: largest absolute value of it.
    """

    points: int
    error_rms: float
    error_max: float
    interpolation_rms: float
    interpolation_max: float


def check_map(rms_map: RmsMap, points: int, *, seed: int = 0, progress: Progress | None = None) -> MapCheck:
    """Measure the error of a map at random nodes, against finer steps, and at random points between the nodes.

    Maps averaged over several floors are checked on the mean of the same floors.

    Args:
        rms_map: the map.
        points: how many of each.
        seed: seed of their choice.
        progress: called with the simulations done and their total.

    Raises:
        ValueError: if points is not positive.
    """
    if points < 1:
        raise ValueError(f"points must be positive, got {points!r}")
    plan = rms_map.plan
    node_errors, between = [], []
    rng = np.random.default_rng(seed)
    for n, node in enumerate(_nodes_at_random(plan, points, seed)):
        load, speed, h_d, dphi_d = node
        at = rms_map.slice_at(load, speed)
        true = _mean_rms(plan, node, 4)
        node_errors.append(0.0 if true == 0.0 else float(at.interpolate(dphi_d, h_d)) / true - 1.0)
        h = float(rng.uniform(plan.h_d[0], plan.h_d[-1]))
        x = float(rng.uniform(plan.dphi_d[0], plan.dphi_d[-1]))
        scale = max(float(at.rms.max()), 1e-12)
        between.append((float(at.interpolate(x, h)) - _mean_rms(plan, (load, speed, h, x), 1)) / scale)
        if progress is not None:
            progress(n + 1, points)
    return MapCheck(
        points,
        float(np.sqrt(np.mean(np.square(node_errors)))),
        float(np.max(np.abs(node_errors))),
        float(np.sqrt(np.mean(np.square(between)))),
        float(np.max(np.abs(between))),
    )


def _mean_rms(plan: MapPlan, point: tuple[float, float, float, float], factor: int) -> float:
    scenes = [scene_at(plan, *point, seed) for seed in range(plan.floors)]
    return float(np.mean([_simulate(plan, scene, factor * _steps(plan, scene)).rms for scene in scenes]))


def software_version() -> str:
    """Return the version of the installed distribution, or "unknown" where it is not installed."""
    try:
        return version("spallwatch")
    except PackageNotFoundError:
        return "unknown"


def _attributes(plan: MapPlan) -> dict[str, Any]:
    """Return what a reader wants to know of a map, flat and in SI units, and the plan that recovers it exactly."""
    flat: dict[str, Any] = {
        "title": "RMS and BPFO lines of a bearing over the extent and depth of an outer-race defect",
        "Conventions": "CF-1.11",
        "schema_version": SCHEMA_VERSION,
        "software_version": f"spallwatch {software_version()}",
        "model": plan.model,
        "model_version": MODEL_VERSION,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "hash": plan.hash(),
        "parameters": plan.as_json(),
        "rms_band_hz": list(plan.rms_band) if plan.rms_band is not None else "full bandwidth",
        "units_of_attributes": "SI and radians unless a name ends in its unit",
        "clearance": plan.clearance,
        "floors": plan.floors,
        "defect_rows": plan.rows,
        "defect_position": plan.position,
        "steps_per_period": plan.steps_per_period or "chosen by the model",
    }
    for prefix, part in (("bearing", plan.bearing), ("rig", plan.rig), ("floor", plan.floor)):
        for name, value in vars(part).items():
            if isinstance(value, bool):
                value = int(value)
            if value is not None:
                flat[f"{prefix}_{name}"] = value
    return flat


__all__ = ["MapCheck", "MapError", "Progress", "build_map", "check_map", "scene_at"]
