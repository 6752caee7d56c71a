"""Build RMS maps; the simulation, and numba with it, is imported when points are computed."""

from __future__ import annotations

import math
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from itertools import product
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from models.maps.check import condition_errors, interpolation_errors, rms_and_most, step_error
from models.maps.data import Nodes, RmsMap
from models.maps.nodes import Progress, rig_rows, rig_scenes, simulate_node_row
from models.maps.plan import MODEL_VERSION, SCHEMA_VERSION, MapPlan
from models.response import HARMONICS
from models.workers import in_threads

if TYPE_CHECKING:
    from numpy.typing import NDArray

Solver = Literal["rows", "lanes"]

# Random points at which a build measures the error between its nodes; fewer with several floors, because each point is
# simulated on all of them.
_POINTS = 200
_POINTS_OF_FLOORS = 40
_POINT_SEED = 1205
# Numbers per node.
_COLUMNS = 5 + 2 * HARMONICS


def solver_of(plan: MapPlan) -> Solver:
    """Return the solver of a plan: rows that settle, or with slip lanes in time.

    Without slip, lanes are neither faster nor more accurate (benchmarks/ensemble.py).
    """
    return "lanes" if plan.slip is not None and plan.slip.phi_slip > 0.0 else "rows"


def build_map(plan: MapPlan, *, workers: int = 1, progress: Progress | None = None) -> RmsMap:
    """Return the map of a plan.

    Floors are solved row by row, scenes with slip by the lane kernels (``models.maps.ensemble``).

    Args:
        workers: threads (rows) or processes (lanes); 0 is one per core. The result does not depend on it.
        progress: called with the scenes done and their total, from this process.

    Raises:
        ValueError: if the plan is outside the model; the message names the field.
    """
    floors = int(np.prod(plan.shape)) * plan.floors
    total = floors + int(np.prod(plan.shape)) * rig_scenes(plan)

    def note(done: int, _total: int) -> None:
        if progress is not None:
            progress(done, total)

    solver = solver_of(plan)
    if solver == "rows":
        nodes = _row_nodes(plan, workers, note)
    else:
        from models.maps.ensemble import ensemble_nodes

        nodes = ensemble_nodes(plan, workers=workers, progress=note)
    rms_rig, harmonic_rig = _rig_nodes(plan, workers, lambda done, _total: note(floors + done, total))
    built = RmsMap(
        load=np.array(plan.load),
        speed=np.array(plan.speed),
        h_d=np.array(plan.h_d),
        dphi_d=np.array(plan.dphi_d),
        **vars(nodes),
        rms_rig_std=rms_rig,
        harmonic_rig_std=harmonic_rig,
        attributes=map_attributes(plan) | {"solver": solver},
    )
    _measure(built, workers)
    return built


def _measure(built: RmsMap, workers: int) -> None:
    """Add to the attributes the error between the nodes, and between loads and speeds if there are several."""
    points = _POINTS if built.plan.floors == 1 else _POINTS_OF_FLOORS
    measures = {"interpolation": interpolation_errors}
    if len(built.load) > 1 or len(built.speed) > 1:
        measures["condition"] = condition_errors
    for name, measure in measures.items():
        errors = measure(built, points, _POINT_SEED, workers)
        built.attributes[f"{name}_error"], built.attributes[f"{name}_error_max"] = rms_and_most(errors)
        built.attributes[f"{name}_points"] = len(errors)


def _row_nodes(plan: MapPlan, workers: int, progress: Progress) -> Nodes:
    values = np.empty((*plan.shape, _COLUMNS))
    tasks = [(plan, i, j, k) for i, j, k in np.ndindex(plan.shape[:3])]
    done = 0
    for (_, i, j, k), row in zip(tasks, in_threads(_row, tasks, workers), strict=True):
        values[i, j, k] = row
        done += plan.shape[3] * plan.floors
        progress(done, 0)
    rms, steps = values[..., 0], step_error(plan, workers)
    harmonic_std = values[..., 5 + HARMONICS :]
    settling = (values[..., 3] * rms)[..., None]
    return Nodes(
        rms=rms,
        rms_std=values[..., 1],
        rms_se=values[..., 2],
        rms_error=(values[..., 3] + steps.rms) * rms,
        harmonic_amplitude=values[..., 5 : 5 + HARMONICS],
        harmonic_std=harmonic_std,
        harmonic_se=harmonic_std / math.sqrt(plan.floors),
        harmonic_error=settling + steps.lines * rms[..., None],
        status=values[..., 4].astype(np.int8),
    )


def _row(task: tuple[MapPlan, int, int, int]) -> NDArray[np.float64]:
    """Return all nodes along dphi_d at one load, speed and depth, shape (D, _COLUMNS)."""
    plan, i, j, k = task
    extents = np.array(plan.dphi_d)
    rows = [
        simulate_node_row(plan, plan.load[i], plan.speed[j], plan.h_d[k], extents, seed) for seed in range(plan.floors)
    ]
    rms, harmonics = np.array([r.rms for r in rows]), np.array([r.harmonics for r in rows])
    if plan.floors > 1:
        spread, harmonic_std = np.std(rms, axis=0, ddof=1), np.std(harmonics, axis=0, ddof=1)
        error = spread / math.sqrt(plan.floors)
    else:
        spread, harmonic_std, error = rows[0].spread, np.zeros_like(harmonics[0]), np.zeros(len(extents))
    settling = np.max([r.settling for r in rows], axis=0)
    status = np.max([r.status for r in rows], axis=0)
    columns = (np.mean(rms, axis=0), spread, error, settling, status)
    return np.column_stack((*columns, np.mean(harmonics, axis=0), harmonic_std))


def _rig_nodes(plan: MapPlan, workers: int, progress: Progress) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the spread over the plan's draws of the rig, shapes (L, S, H, D) and (L, S, H, D, 6)."""
    rms, harmonics = np.zeros(plan.shape), np.zeros((*plan.shape, HARMONICS))
    if plan.rig_draws == 0:
        return rms, harmonics
    tasks = [(plan, *point) for point in product(plan.load, plan.speed, plan.h_d)]
    found = in_threads(lambda task: rig_rows(*task), tasks, workers)
    for n, (at, (spread, lines)) in enumerate(zip(np.ndindex(plan.shape[:3]), found, strict=True)):
        rms[at], harmonics[at] = spread, lines
        progress((n + 1) * plan.shape[3] * rig_scenes(plan), 0)
    return rms, harmonics


def software_version() -> str:
    """Return the version of the installed distribution, or "unknown" without one."""
    try:
        return version("spallwatch")
    except PackageNotFoundError:
        return "unknown"


def map_attributes(plan: MapPlan) -> dict[str, Any]:
    """Return the attributes of a map file: parameters in SI units, and the plan as JSON."""
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
        "rig_draws": plan.rig_draws,
    }
    if plan.rig_draws > 0:
        flat |= {name: getattr(plan, name) for name in ("rig_spread", "rig_spread_k_r", "rig_seed")}
    parts: list[tuple[str, object]] = [("bearing", plan.bearing), ("rig", plan.rig), ("floor", plan.floor)]
    if plan.slip is not None:
        parts.append(("slip", plan.slip))
    for prefix, part in parts:
        for name, value in vars(part).items():
            if isinstance(value, bool):
                value = int(value)
            if value is not None:
                flat[f"{prefix}_{name}"] = value
    return flat
