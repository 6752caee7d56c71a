"""Build RMS maps, with the axes of their plan or refined (``models.maps.refine``) to a given interpolation error.

The simulation, and numba with it, is imported when points are computed.

Refine the axes of a plan until the chords between its nodes are accurate enough.

RMS has stripes along dphi_d that belong to the model (about 4 degrees and 0.8 degrees apart for the 1205 ETN9 at 40 Hz:
the resonator swings a whole number of times while a ball crosses the defect), so that a coarse axis aliases them. An
axis is refined by halving the intervals whose middle, simulated, is off the line between its ends.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from itertools import product
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import numpy as np

from models.machine.rig import Rig
from models.maps.check import condition_errors, interpolation_errors, rms_and_most
from models.maps.data import RIG_COMMON, Nodes, RmsMap
from models.maps.nodes import (
    BATCH_SECONDS,
    ROW_MEMORY,
    Progress,
    RigSpread,
    rig_rows,
    rig_scenes,
    scene_seconds,
    simulate_node_row,
)
from models.maps.plan import DAMAGED, LINES, SCHEMA_VERSION, VOLUMES, MapError, MapPlan
from models.path.contour import part_radius
from models.solve.response import CASING, HARMONICS, STATUSES
from models.work.runner import SERIAL
from models.work.task import Work

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.words.request import Sensor
    from models.work.runner import Runner


# Default limit of the nodes of a refined map.
MAX_NODES = 200_000
# How the tolerance is shared between the axes; their squares add up to one.
_SHARE_DPHI_D, _SHARE_H_D = 0.9, 0.43
# RMS over an interval of the error of a chord of a parabola, over its error in the middle.
_PARABOLA = (8.0 / 15.0) ** 0.5
# The mean over more floors is no rougher than over these.
_FLOORS = 8
_CONDITIONS, _DEPTHS, _EXTENTS = 4, 9, 24
# Smallest RMS that an error is divided by, m/s2.
_SILENCE = 1e-12

Sample = Callable[["NDArray[np.float64]"], "NDArray[np.float64]"]
_Row = tuple[float, float, float, "NDArray[np.float64]"]
_T = TypeVar("_T")


def refine_plan(plan: MapPlan, tolerance: float, *, most_nodes: int = MAX_NODES, runner: Runner = SERIAL) -> MapPlan:
    """Return a plan with its axes of extent and depth refined to a tolerance, or to the limit of nodes.

    The plan does not depend on ``runner``.

    Raises:
        MapError: if the tolerance is not positive or the plan has too many nodes to begin with.
    """
    if not tolerance > 0.0:
        raise MapError(f"interpolation tolerance must be positive, got {tolerance!r}")
    total = int(np.prod(plan.shape))
    if total > most_nodes:
        raise MapError(f"the map has {total} nodes before it is refined, more than the {most_nodes} that it may have")
    conditions = _spread_over(list(product(plan.load, plan.speed)), _CONDITIONS)
    still = replace(plan, slip=None, floors=min(plan.floors, _FLOORS) if plan.floor.kind == "rough" else 1)
    depths = _spread_over([h for h in plan.h_d if h > 0.0], _DEPTHS)
    extents = np.array(_spread_over([x for x in plan.dphi_d if x > 0.0], _EXTENTS))
    if not depths or len(extents) == 0:
        return plan

    def means(depths: Sequence[float], extents: NDArray[np.float64]) -> NDArray[np.float64]:
        work = _REFINED_ROWS.sized(len(extents) * still.floors * scene_seconds(still), chunk=BATCH_SECONDS)
        rows = list(runner.run(work, still, [(*c, h, extents) for c in conditions for h in depths]))
        return np.array(rows).reshape(len(conditions), len(depths), len(extents))

    def along_dphi_d(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return means(depths, values)

    def along_h_d(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.swapaxes(means(values.tolist(), extents), 1, 2)

    fixed = len(plan.load) * len(plan.speed)
    depth = _refined(plan.h_d, along_h_d, _SHARE_H_D * tolerance, most_nodes // (fixed * len(plan.dphi_d)))
    extent = _refined(plan.dphi_d, along_dphi_d, _SHARE_DPHI_D * tolerance, most_nodes // (fixed * len(depth)))
    return replace(plan, h_d=depth, dphi_d=extent)


def _spread_over(values: list[_T], count: int) -> list[_T]:
    """Return up to ``count`` of the values, evenly among them, the last included."""
    if len(values) <= count:
        return values
    return [values[round((n + 1) * len(values) / count) - 1] for n in range(count)]


def _refined(axis: tuple[float, ...], sample: Sample, target: float, most: int) -> tuple[float, ...]:
    """Return an axis with intervals halved until the chords are off by less than the target (RMS along the axis).

    ``sample`` returns the RMS at places of the axis, shape (conditions, rows, places); the target is relative to the
    largest RMS of a condition; ``most`` is the limit of nodes.
    """
    places = np.array(axis)
    if len(places) < 2:
        return axis
    values = sample(places)
    scale = np.maximum(np.max(values, axis=(1, 2), keepdims=True), _SILENCE)
    errors = np.full(len(places) - 1, np.nan)
    middle = np.empty((*values.shape[:2], len(errors)))
    while True:
        untried = np.isnan(errors)
        middle[..., untried] = sample(0.5 * (places[:-1] + places[1:])[untried])
        off = (middle - 0.5 * (values[..., :-1] + values[..., 1:])) / scale
        errors = _PARABOLA * np.sqrt(np.mean(off**2, axis=(0, 1)))
        width = np.diff(places)
        if np.sqrt(np.average(errors**2, weights=width)) <= target:
            break
        # The worst first; those within the target are left as they are.
        worst = np.argsort(-errors)[: most - len(places)]
        split = np.sort(worst[errors[worst] > target])
        if len(split) == 0:
            break
        places = np.insert(places, split + 1, 0.5 * (places[split] + places[split + 1]))
        values = np.insert(values, split + 1, middle[..., split], axis=2)
        halves = np.zeros(len(errors), dtype=bool)
        halves[split] = True
        errors = np.repeat(np.where(halves, np.nan, errors), 1 + halves)
        middle = np.repeat(middle, 1 + halves, axis=2)
    return tuple(places.tolist())


def _mean_row(plan: MapPlan, row: _Row) -> NDArray[np.float64]:
    """Return the RMS of a row (load, speed, h_d, extents) averaged over the plan's floors, m/s2, shape (D,)."""
    load, speed, h_d, extents = row
    rows = [simulate_node_row(plan, load, speed, h_d, extents, seed).rms for seed in range(plan.floors)]
    return np.mean(rows, axis=0)


_REFINED_ROWS = Work("rows to refine the axes by", _mean_row, memory=ROW_MEMORY, threads=True)


Solver = Literal["rows", "lanes", "time", "scenes"]

# Random points at which a build measures the error between its nodes; fewer where a point costs more, because it is
# simulated on several floors or over time.
_POINTS = 200
_POINTS_OF_FLOORS = 40
_POINT_SEED = 1205
# Numbers per node.
_COLUMNS = 5 + 4 * HARMONICS

# Rounds of refinement.
_ROUNDS = 3


def solver_of(plan: MapPlan) -> Solver:
    """Return the solver of a plan: rows that settle, with slip lanes, or records over time of a defect that turns.

    Another model than the six-degree-of-freedom one simulates each node as a scene of its own.

    Without slip, lanes are neither faster nor more accurate.
    """
    if plan.model != Rig.model:
        return "scenes"
    if plan.part != "outer":
        return "time"
    return "lanes" if plan.slip is not None and plan.slip.phi_slip > 0.0 else "rows"


def build_map(plan: MapPlan, *, runner: Runner = SERIAL, progress: Progress | None = None) -> RmsMap:
    """Return the map of a plan, by the solver of ``solver_of``.

    Args:
        runner: runs rows (rows, time, scenes) or groups of scenes (lanes). The result does not depend on it.
        progress: called with the scenes done and their total, from this process.

    Raises:
        ValueError: if the plan is outside the model; the message names the field.
    """
    sensor: Sensor = CASING[0]
    if plan.model != Rig.model:
        from models.maps.model_nodes import check_model

        sensor = check_model(plan)
    floors = int(np.prod(plan.shape)) * plan.floors
    total = floors + int(np.prod(plan.shape)) * rig_scenes(plan)

    def note(done: int, _total: int) -> None:
        if progress is not None:
            progress(done, total)

    solver = solver_of(plan)
    if solver != "lanes":
        nodes = _row_nodes(plan, runner, note)
    else:
        from models.maps.ensemble import ensemble_nodes

        nodes = ensemble_nodes(plan, runner=runner, progress=note)
    rms_rig, harmonic_rig, common = _rig_nodes(plan, runner, lambda done, _total: note(floors + done, total))
    built = RmsMap(
        load=np.array(plan.load),
        speed=np.array(plan.speed),
        h_d=np.array(plan.h_d),
        dphi_d=np.array(plan.dphi_d),
        **vars(nodes),
        rms_rig_std=rms_rig,
        harmonic_rig_std=harmonic_rig,
        attributes=map_attributes(plan) | {"solver": solver, "sensor": sensor} | common,
    )
    _measure(built, runner)
    return built


def _measure(built: RmsMap, runner: Runner) -> None:
    """Add to the attributes the error between the nodes, and between loads and speeds if there are several."""
    cheap = solver_of(built.plan) != "scenes" and built.plan.floors == 1 and built.plan.part == "outer"
    points = _POINTS if cheap else _POINTS_OF_FLOORS
    measures = {"interpolation": interpolation_errors}
    if len(built.load) > 1 or len(built.speed) > 1:
        measures["condition"] = condition_errors
    for name, measure in measures.items():
        errors = measure(built, points, _POINT_SEED, runner)
        built.attributes[f"{name}_error"], built.attributes[f"{name}_error_max"] = rms_and_most(errors)
        built.attributes[f"{name}_points"] = len(errors)


def _row_nodes(plan: MapPlan, runner: Runner, progress: Progress) -> Nodes:
    values = np.empty((*plan.shape, _COLUMNS))
    tasks = list(np.ndindex(plan.shape[:3]))
    work = _ROWS.sized(plan.shape[3] * plan.floors * scene_seconds(plan), len(tasks))
    done = 0
    for at, row in zip(tasks, runner.run(work, plan, tasks), strict=True):
        values[at] = row
        done += plan.shape[3] * plan.floors
        progress(done, 0)
    rms = values[..., 0]
    harmonics, harmonic_std, harmonic_se, harmonic_error = np.split(values[..., 5:], 4, axis=-1)
    return Nodes(
        rms=rms,
        rms_std=values[..., 1],
        rms_se=values[..., 2],
        rms_error=values[..., 3] * rms,
        harmonic_amplitude=harmonics,
        harmonic_std=harmonic_std,
        harmonic_se=harmonic_se,
        harmonic_error=harmonic_error,
        status=values[..., 4].astype(np.int8),
    )


def _row(plan: MapPlan, at: tuple[int, ...]) -> NDArray[np.float64]:
    """Return all nodes along dphi_d at one load, speed and depth by their numbers, shape (D, _COLUMNS)."""
    i, j, k = at
    extents = np.array(plan.dphi_d)
    rows = [
        simulate_node_row(plan, plan.load[i], plan.speed[j], plan.h_d[k], extents, seed) for seed in range(plan.floors)
    ]
    rms, harmonics = np.array([r.rms for r in rows]), np.array([r.harmonics for r in rows])
    if plan.floors > 1:
        spread, harmonic_std = np.std(rms, axis=0, ddof=1), np.std(harmonics, axis=0, ddof=1)
        error, harmonic_se = (values / math.sqrt(plan.floors) for values in (spread, harmonic_std))
    else:
        spread, error = rows[0].spread, rows[0].se
        harmonic_std, harmonic_se = rows[0].harmonics_std, rows[0].harmonics_se
    worst = np.max([r.error for r in rows], axis=0)
    status = _worst_status(np.array([r.status for r in rows]))
    columns = (np.mean(rms, axis=0), spread, error, worst, status.astype(np.float64))
    lines_error = np.max([r.harmonics_error for r in rows], axis=0)
    return np.column_stack((*columns, np.mean(harmonics, axis=0), harmonic_std, harmonic_se, lines_error))


def _worst_status(status: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the worst status over the floors, shape (floors, D) to (D,)."""
    worse = ("converged", "not_periodic", "inaccurate", "uncalibrated", "not_converged")
    order = [STATUSES.index(name) for name in worse]
    rank = np.argsort(order)
    return np.asarray(order, dtype=np.int64)[np.max(rank[status], axis=0)]


def _rig_nodes(
    plan: MapPlan, runner: Runner, progress: Progress
) -> tuple[NDArray[np.float64], NDArray[np.float64], dict[str, Any]]:
    """Return the spread over the plan's draws of the rig, shapes (L, S, H, D) and (L, S, H, D, 6), and an attribute.

    The attribute is that part of the spread of a posterior which all nodes share.
    """
    rms, harmonics = np.zeros(plan.shape), np.zeros((*plan.shape, HARMONICS))
    if plan.rig_draws == 0:
        return rms, harmonics, {}
    tasks = list(product(plan.load, plan.speed, plan.h_d))
    work = _RIG_ROWS.sized(plan.shape[3] * rig_scenes(plan) * scene_seconds(plan), len(tasks))
    found = runner.run(work, plan, tasks)
    rows: list[NDArray[np.float64]] = []
    for n, (at, spread) in enumerate(zip(np.ndindex(plan.shape[:3]), found, strict=True)):
        rms[at], harmonics[at] = spread.rms, spread.lines
        rows.append(spread.logarithms)
        progress((n + 1) * plan.shape[3] * rig_scenes(plan), 0)
    damaged = [row for row in rows if np.all(np.isfinite(row))]
    if plan.rig_posterior is None or not damaged:
        return rms, harmonics, {}
    common = np.sqrt(np.mean(np.mean(damaged, axis=0) ** 2, axis=0))
    return rms, harmonics, {RIG_COMMON: common.tolist()}


def _rig_row(plan: MapPlan, condition: tuple[float, float, float]) -> RigSpread:
    return rig_rows(plan, *condition)


_ROWS = Work("rows of the map", _row, memory=ROW_MEMORY, threads=True)
_RIG_ROWS = Work("rows of drawn rigs", _rig_row, memory=ROW_MEMORY, threads=True)


def _software_version() -> str:
    """Return the version of the installed distribution, or "unknown" without one."""
    try:
        return version("spallwatch")
    except PackageNotFoundError:
        return "unknown"


def map_attributes(plan: MapPlan) -> dict[str, Any]:
    """Return the attributes of a map file: parameters in SI units, and the plan as JSON."""
    flat: dict[str, Any] = {
        "title": f"RMS and lines of a bearing over the extent and depth of a defect of the {DAMAGED[plan.part]}",
        "Conventions": "CF-1.11",
        "schema_version": SCHEMA_VERSION,
        "software_version": f"spallwatch {_software_version()}",
        "model": plan.model,
        "model_version": plan.model_version,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "hash": plan.hash(),
        "parameters": plan.as_json(),
        "rms_band_hz": list(plan.rms_band) if plan.rms_band is not None else "full bandwidth",
        "units_of_attributes": "SI and radians unless a name ends in its unit",
        "clearance": plan.clearance,
        "floors": plan.floors,
        "damaged_part": plan.part,
        "v_eq": f"{VOLUMES[plan.part]} * dphi_d * h_d",
        "v_eq_radius": part_radius(plan.bearing, plan.part),
        "lines_of": LINES[plan.part],
        "defect_rows": plan.rows,
        "defect_position": plan.position,
        "steps_per_period": plan.steps_per_period or "chosen by the model",
        "rig_draws": plan.rig_draws,
        "rig_spread_over": plan.rig_spread_words,
    }
    if plan.rig_draws > 0 and plan.rig_posterior is None:
        flat |= {name: getattr(plan, name) for name in ("rig_spread", "rig_spread_k_r", "rig_seed")}
        if plan.rig_spread_k_c is not None:
            flat["rig_spread_k_c"] = plan.rig_spread_k_c
    parts: list[tuple[str, object]] = [("bearing", plan.bearing), ("rig", plan.rig), ("floor", plan.floor)]
    if plan.slip is not None:
        parts.append(("slip", plan.slip))
    if plan.second_bearing is not None:
        parts.append(("second_bearing", plan.second_bearing))
    if plan.axial_load:
        flat["axial_load"] = plan.axial_load
    for prefix, part in parts:
        for name, value in vars(part).items():
            if isinstance(value, bool):
                value = int(value)
            if value is not None:
                flat[f"{prefix}_{name}"] = value
    return flat


def build_refined_map(
    plan: MapPlan,
    tolerance: float,
    *,
    most_nodes: int = MAX_NODES,
    runner: Runner = SERIAL,
    progress: Progress | None = None,
) -> RmsMap:
    """Return the map of a plan with its axes of extent and depth refined until the error between nodes is small enough.

    The axes are refined at some of the plan's depths, loads and speeds, without slip and on its first floors; the error
    is then measured on the whole map (attribute ``interpolation_error``). It exceeds ``tolerance``, which is relative
    to the largest RMS of the map at that load and speed, only if the limit of nodes is reached.

    Raises:
        MapError: if the tolerance is not positive or the plan has too many nodes to begin with.
        ValueError: if the plan is outside the model.
    """
    aim, rounds = tolerance, 1
    plan = refine_plan(plan, aim, most_nodes=most_nodes, runner=runner)
    built = build_map(plan, runner=runner, progress=progress)
    while (reached := float(built.attributes["interpolation_error"])) > tolerance and rounds < _ROUNDS:
        aim *= 0.8 * tolerance / reached
        rounds += 1
        finer = refine_plan(plan, aim, most_nodes=most_nodes, runner=runner)
        if finer == plan:
            break
        plan, built = finer, build_map(finer, runner=runner, progress=progress)
    built.attributes["interpolation_tolerance"] = tolerance
    return built
