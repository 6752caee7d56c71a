"""Errors of a map: by its steps, between its nodes, and between its loads and speeds."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from models.maps.nodes import (
    BATCH_SECONDS,
    ROW_MEMORY,
    Progress,
    nodes_at_random,
    point_level,
    scene_seconds,
    simulate_node_row,
)
from models.work.runner import SERIAL
from models.work.task import Work

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.maps.data import RmsMap
    from models.maps.plan import MapPlan
    from models.work.runner import Runner

# Smallest RMS that an error is divided by, m/s2.
_SILENCE = 1e-12

# Steps of a true node with slip over those of a map, and accuracy of a map over that of a true node without: most are
# far more accurate than asked, and a little finer they are the same.
_FINER_STEPS, _FINER = 4, 50

Point = tuple[float, float, float, float]


@dataclass(frozen=True)
class _Shared:
    """What the points of a check have in common; ``factor`` is that of ``mean_levels``."""

    plan: MapPlan
    factor: int

    @property
    def slips(self) -> bool:
        """Whether the points are simulated in lanes."""
        slip = self.plan.slip
        return self.plan.part == "outer" and slip is not None and slip.phi_slip > 0.0


def _mean_level(shared: _Shared, task: tuple[int, Point]) -> float:
    number, point = task
    plan, factor = shared.plan, shared.factor
    if shared.slips:
        from models.maps.ensemble import ensemble_rms

        return ensemble_rms(plan, point, factor, number)
    return sum(_rms_at(plan, point, seed, factor) for seed in range(plan.floors)) / plan.floors


_POINTS = Work("points of the map", _mean_level, memory=ROW_MEMORY, threads=True)
_SLIPPING = Work("points of the map with slip", _mean_level, memory=ROW_MEMORY)


def mean_levels(
    plan: MapPlan, points: Sequence[tuple[int, Point]], factor: int = 1, runner: Runner = SERIAL
) -> Iterator[float]:
    """Yield the RMS at any points (load, speed, h_d, dphi_d), averaged over the plan's floors, m/s2.

    Points of different numbers draw different slip. ``factor`` divides the accuracy of the nodes, or multiplies their
    steps where slip is redrawn.
    """
    shared = _Shared(plan, factor)
    if not shared.slips:
        # A point costs more than a scene of a row: no other shares its tables.
        work = _POINTS.sized(2.0 * math.sqrt(factor) * plan.floors * scene_seconds(plan), chunk=BATCH_SECONDS)
        return runner.run(work, shared, points)
    from models.maps.ensemble import lane_work

    return runner.run(lane_work(_SLIPPING, plan, len(points), plan.floors, factor), shared, points)


def _rms_at(plan: MapPlan, point: Point, seed: int, factor: int) -> float:
    if factor > 1:
        return point_level(plan, point, seed, factor)[0]
    # With the steps of the nodes, a row is faster.
    return float(simulate_node_row(plan, *point[:3], np.array([point[3]]), seed).rms[0])


def interpolation_errors(rms_map: RmsMap, points: int, seed: int, runner: Runner = SERIAL) -> NDArray[np.float64]:
    """Return the errors of a map at random extents and depths, over the largest RMS of its slice, shape (points,).

    Each point lies at one of the map's loads and speeds; diverging ones are left out.
    """
    rng = np.random.default_rng(seed)
    axes = (rms_map.load, rms_map.speed, rms_map.h_d, rms_map.dphi_d)
    load, speed = (rng.choice(axis, points) for axis in axes[:2])
    h_d, dphi_d = (rng.uniform(axis[0], axis[-1], points) for axis in axes[2:])
    return _errors_at(rms_map, np.column_stack((load, speed, h_d, dphi_d)), runner)


def condition_errors(rms_map: RmsMap, points: int, seed: int, runner: Runner = SERIAL) -> NDArray[np.float64]:
    """Return the errors of a map at random nodes of its extents and depths, but loads and speeds between its own.

    They are relative to the largest RMS of the map at that load and speed, shape (points,); diverging
    points are left out.
    """
    rng = np.random.default_rng(seed)
    load, speed = (rng.uniform(axis[0], axis[-1], points) for axis in (rms_map.load, rms_map.speed))
    h_d, dphi_d = (rng.choice(axis, points) for axis in (rms_map.h_d, rms_map.dphi_d))
    return _errors_at(rms_map, np.column_stack((load, speed, h_d, dphi_d)), runner)


def _errors_at(rms_map: RmsMap, points: NDArray[np.float64], runner: Runner) -> NDArray[np.float64]:
    rows: list[Point] = [tuple(row) for row in points.tolist()]
    errors = np.empty(len(rows))
    levels = mean_levels(rms_map.plan, list(enumerate(rows)), runner=runner)
    for n, (row, true) in enumerate(zip(rows, levels, strict=True)):
        at = rms_map.slice_at(row[0], row[1])
        errors[n] = (float(at.interpolate(row[3], row[2])) - true) / max(float(np.nanmax(at.rms)), _SILENCE)
    return errors[np.isfinite(errors)]


def rms_and_most(errors: Sequence[float] | NDArray[np.float64]) -> tuple[float, float]:
    """Return the RMS and the largest absolute value of errors, NaN without any."""
    if len(errors) == 0:
        return math.nan, math.nan
    return float(np.sqrt(np.mean(np.square(errors)))), float(np.max(np.abs(errors)))


@dataclass(frozen=True)
class MapCheck:
    """Errors of a map against the converged model, each as RMS and as largest absolute value; NaN if all diverge.

    Attributes:
        points: number of random nodes, and of random points between nodes.
        error_rms: of the stored RMS at nodes, relative, against a quarter of their accuracy.
        interpolation_rms: between nodes, relative to the largest RMS of the map's slice.
        condition_rms: between loads and speeds at nodes of h_d and dphi_d, likewise relative; None for a map with one
            load and one speed.
    """

    points: int
    error_rms: float
    error_max: float
    interpolation_rms: float
    interpolation_max: float
    condition_rms: float | None
    condition_max: float | None


def check_map(
    rms_map: RmsMap, points: int, *, seed: int = 0, runner: Runner = SERIAL, progress: Progress | None = None
) -> MapCheck:
    """Measure the error of a map at random nodes, against more accurate ones, and at random points between the nodes.

    Maps averaged over several floors are checked on the mean of the same floors; where slip is redrawn, both means
    contain the scatter of their records. The check does not depend on ``runner``; ``progress`` is called with the
    points done and their total.

    Raises:
        ValueError: if points is not positive.
    """
    if points < 1:
        raise ValueError(f"points must be positive, got {points!r}")
    plan = rms_map.plan
    node_errors: list[float] = []
    several = len(rms_map.load) > 1 or len(rms_map.speed) > 1
    parts = 3 if several else 2
    nodes = nodes_at_random(plan, points, seed)
    factor = _FINER_STEPS if _Shared(plan, 1).slips else _FINER
    levels = mean_levels(plan, [(0, node) for node in nodes], factor, runner)
    for n, (node, true) in enumerate(zip(nodes, levels, strict=True)):
        stored = float(rms_map.slice_at(node[0], node[1]).interpolate(node[3], node[2]))
        error = 0.0 if true == 0.0 else stored / true - 1.0
        if math.isfinite(error):
            node_errors.append(error)
        if progress is not None:
            progress(n + 1, parts * points)
    between = interpolation_errors(rms_map, points, seed, runner)
    if progress is not None:
        progress(2 * points, parts * points)
    conditions = condition_errors(rms_map, points, seed, runner) if several else None
    if progress is not None and several:
        progress(3 * points, parts * points)
    between_conditions = (None, None) if conditions is None else rms_and_most(conditions)
    return MapCheck(points, *rms_and_most(node_errors), *rms_and_most(between), *between_conditions)
