"""Nodes of RMS maps averaged over many floors, with or without slip of the balls, computed by the lane kernels.

Floors are common to all nodes (floor n has the seed ``plan.floor.seed + n``), so that neighbouring nodes differ by what
the defect does and not by the draw.

With slip per passage every floor of every node is simulated for a few blocks only: the scatter of the RMS of so short
a record is part of the spread over floors, and so of the standard error of the map.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from models.machine.bearing import kinematics
from models.machine.scene import Scene
from models.maps.data import Nodes
from models.maps.nodes import NodeStepError, Progress, compare_steps
from models.maps.plan import MapPlan, scene_at
from models.solve.response import HARMONICS
from models.solve.six_dof.kernels.lanes import LANES
from models.solve.six_dof.lane_group import PERIODS, block_steps, group_bytes
from models.solve.six_dof.lanes import STEP_SECONDS, LaneOptions, LaneRunner, simulate_lanes
from models.work.runner import SERIAL
from models.work.task import Work

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.work.runner import Runner

_S = TypeVar("_S")
_T = TypeVar("_T")
_R = TypeVar("_R")

# Groups of lanes in one task of a worker process; the cost of starting a task is small beside them.
_GROUPS_PER_TASK = 24
# Between blocks; what is left of the settling afterwards is a tenth of it or less.
ENSEMBLE_TOLERANCE = 3e-3
ENSEMBLE_SLIP_BLOCKS = 2
# The standard error over a hundred floors is several times what these steps leave.
ENSEMBLE_STEP = 27e-6
ENSEMBLE_MIN_STEPS = 192
_ERROR_SEED = 20220
# Blocks of a scene, roughly.
_BLOCKS = 4
_COLUMNS = 3 + HARMONICS


@dataclass(frozen=True)
class _Task:
    """A run of scenes of one speed: nodes are counted with load outermost, then extent, then depth."""

    speed: int
    first_floor: int
    floors: int
    begin: int
    end: int


def ensemble_options(plan: MapPlan) -> LaneOptions:
    """Return the settings of the simulation of a plan."""
    bpfo = kinematics(plan.bearing, min(plan.speed)).bpfo
    return LaneOptions(
        steps_per_period=plan.steps_per_period or max(ENSEMBLE_MIN_STEPS, math.ceil(1.0 / (bpfo * ENSEMBLE_STEP))),
        tolerance=ENSEMBLE_TOLERANCE,
        slip_blocks=ENSEMBLE_SLIP_BLOCKS,
        band=plan.rms_band,
    )


def ensemble_nodes(plan: MapPlan, *, runner: Runner = SERIAL, progress: Progress | None = None) -> Nodes:
    """Return the nodes of a plan averaged over its floors.

    Args:
        runner: runs groups of scenes. The result does not depend on it.
        progress: called with the scenes done and their total, from this process.

    Raises:
        ValueError: if a scene is outside the model.
    """
    options = ensemble_options(plan)
    tasks = list(_tasks(plan))
    values = np.empty((len(plan.speed), _nodes(plan), plan.floors, _COLUMNS))
    work = lane_work(_GROUPS, plan, len(tasks), _GROUPS_PER_TASK * LANES)
    total, done = values[..., 0].size, 0
    for task, rows in zip(tasks, runner.run(work, (plan, options), tasks), strict=True):
        node, floor = np.divmod(np.arange(task.begin, task.end), task.floors)
        values[task.speed, node, task.first_floor + floor] = rows
        done += task.end - task.begin
        if progress is not None:
            progress(done, total)
    return _statistics(plan, options, values)


def lane_work(work: Work[_S, _T, _R], plan: MapPlan, tasks: int, scenes: int, factor: int = 1) -> Work[_S, _T, _R]:
    """Return a kind of task with its memory and its chunks.

    Args:
        work: kind of task.
        plan: whose scenes they simulate.
        tasks: their number.
        scenes: of a task.
        factor: multiplies the steps.
    """
    steps = factor * (ensemble_options(plan).steps_per_period or 0)
    speed = min(plan.speed)
    seconds = _BLOCKS * STEP_SECONDS * scenes * block_steps(kinematics(plan.bearing, speed).bpfo, steps)
    memory = group_bytes(plan.bearing, speed, (max(plan.dphi_d), plan.rows), plan.slip, steps)
    return replace(work, memory=memory).sized(seconds, tasks)


def ensemble_rms(plan: MapPlan, point: tuple[float, float, float, float], factor: int, number: int) -> float:
    """Return the RMS at any point (load, speed, h_d, dphi_d), averaged over the plan's floors, m/s2.

    ``factor`` multiplies the steps of the nodes; points of different numbers draw different slip.
    """
    options = ensemble_options(plan)
    assert options.steps_per_period is not None
    options = replace(options, steps_per_period=factor * options.steps_per_period)
    runner = LaneRunner(options)
    levels: list[NDArray[np.float64]] = []
    for first in range(0, plan.floors, LANES):
        seeds = range(first, min(first + LANES, plan.floors))
        scenes = [scene_at(plan, *point, seed) for seed in seeds]
        levels.append(runner.run(scenes, number * plan.floors + first).rms)
    return float(np.mean(np.concatenate(levels)))


def _nodes(plan: MapPlan) -> int:
    return len(plan.load) * len(plan.dphi_d) * len(plan.h_d)


def _tasks(plan: MapPlan) -> Iterator[_Task]:
    """Cut the scenes into tasks, floors by LANES at a time, so that few profiles are in use at once."""
    size = _GROUPS_PER_TASK * LANES
    for speed in range(len(plan.speed)):
        for first in range(0, plan.floors, LANES):
            floors = min(LANES, plan.floors - first)
            count = _nodes(plan) * floors
            for begin in range(0, count, size):
                yield _Task(speed, first, floors, begin, min(begin + size, count))


def _scene(plan: MapPlan, task: _Task, index: int) -> Scene:
    """Return one scene of a task; neighbours differ in floor first, then depth, so that their tables are alike."""
    node, floor = divmod(index, task.floors)
    outer, depth = divmod(node, len(plan.h_d))
    load, extent = divmod(outer, len(plan.dphi_d))
    return scene_at(
        plan,
        plan.load[load],
        plan.speed[task.speed],
        plan.h_d[depth],
        plan.dphi_d[extent],
        task.first_floor + floor,
    )


def _simulate(shared: tuple[MapPlan, LaneOptions], task: _Task) -> NDArray[np.float64]:
    """Return RMS, settling change, status and lines of the scenes of a task, shape (scenes, _COLUMNS)."""
    plan, options = shared
    runner = LaneRunner(options)
    rows: list[NDArray[Any]] = []
    for begin in range(task.begin, task.end, LANES):
        scenes = [_scene(plan, task, i) for i in range(begin, min(begin + LANES, task.end))]
        # A number that no other group of the map has, whatever process it runs in.
        number = (task.speed * plan.floors + task.first_floor) * _nodes(plan) + begin // LANES
        r = runner.run(scenes, number)
        rows.append(np.column_stack((r.rms, r.block_change, r.status, r.harmonics)))
    return np.concatenate(rows)


_GROUPS = Work("groups of scenes of the map", _simulate, memory=0)


def _statistics(plan: MapPlan, options: LaneOptions, values: NDArray[np.float64]) -> Nodes:
    """Return the nodes from the scenes' figures, shape (speeds, nodes, floors, _COLUMNS)."""
    shape = (len(plan.speed), len(plan.load), len(plan.dphi_d), len(plan.h_d), plan.floors, _COLUMNS)
    values = values.reshape(shape).transpose(1, 0, 3, 2, 4, 5)
    rms, harmonics = values[..., 0], values[..., 3:]
    mean = rms.mean(axis=-1)
    several = plan.floors > 1
    spread = rms.std(axis=-1, ddof=1) if several else np.zeros_like(mean)
    # A settled scene is off by less than the last change between blocks; slip has no settled motion to be off from.
    random = plan.slip is not None and plan.slip.redraws
    settling = np.zeros_like(mean) if random else values[..., 1].max(axis=-1) * mean
    steps = step_error(plan, options)
    harmonic_std = harmonics.std(axis=-2, ddof=1) if several else np.zeros_like(harmonics[..., 0, :])
    return Nodes(
        rms=mean,
        rms_std=spread,
        rms_se=spread / np.sqrt(plan.floors),
        rms_error=settling + steps.rms * mean,
        harmonic_amplitude=harmonics.mean(axis=-2),
        harmonic_std=harmonic_std,
        harmonic_se=harmonic_std / np.sqrt(plan.floors),
        harmonic_error=settling[..., None] + steps.lines * mean[..., None],
        status=values[..., 2].max(axis=-1).astype(np.int8),
    )


def step_error(plan: MapPlan, options: LaneOptions, count: int = LANES) -> NodeStepError:
    """Return the error of the steps without slip, at ``count`` random nodes and floors: against twice as many, in
    parts where contacts change, so that both do not share what they miss.
    """
    rng = np.random.default_rng(_ERROR_SEED)
    floors = 1 if plan.floor.kind == "smooth" else plan.floors
    depths = [h for h in plan.h_d if h > 0.0] or [plan.h_d[0]]
    extents = [x for x in plan.dphi_d if x > 0.0] or [plan.dphi_d[0]]
    speed = plan.speed[-1]
    plan, still = replace(plan, slip=None, floors=floors), replace(options, tolerance=1e-5)
    scenes = [
        scene_at(plan, float(rng.choice(plan.load)), speed, float(rng.choice(depths)), float(rng.choice(extents)), seed)
        for seed in rng.integers(0, plan.floors, count).tolist()
    ]
    coarse = simulate_lanes(scenes, still)
    steps = block_steps(kinematics(plan.bearing, speed).bpfo, options.steps_per_period) // PERIODS
    fine = simulate_lanes(scenes, replace(still, steps_per_period=2 * steps, instants=True))
    return compare_steps((coarse.rms, coarse.harmonics), (fine.rms, fine.harmonics))
