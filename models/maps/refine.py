"""Refine the axes of a plan until the chords between its nodes are accurate enough.

RMS has stripes along dphi_d that belong to the model (about 4 degrees and 0.8 degrees apart for the 1205 ETN9 at 40 Hz:
the resonator swings a whole number of times while a ball crosses the defect), so that a coarse axis aliases them. An
axis is refined by halving the intervals whose middle, simulated, is off the line between its ends.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import product
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from models.maps.nodes import BATCH_SECONDS, ROW_MEMORY, scene_seconds, simulate_node_row
from models.maps.plan import MapError, MapPlan
from models.work.runner import SERIAL
from models.work.task import Work

if TYPE_CHECKING:
    from numpy.typing import NDArray

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
        work = _ROWS.sized(len(extents) * still.floors * scene_seconds(still), chunk=BATCH_SECONDS)
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


_ROWS = Work("rows to refine the axes by", _mean_row, memory=ROW_MEMORY, threads=True)
