"""The method of the thesis on the lives of ``forecast.methods``: its tracker on three kinds of maps, its
forecast.

Maps span the loads and speeds of the lives and are read between their nodes; ``exact_maps`` measures what that costs
the method, on maps of each run's very load and speed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from benchmarks.forecast.cases import Answers, Cases, Floats, no_volume
from benchmarks.forecast.population import THRESHOLD
from models.lives.life import LifeHistory
from models.machine.scene import Floor
from models.maps.build import build_map
from models.maps.data import RmsMap
from models.maps.file import cached_map
from models.maps.plan import MapPlan
from monitor.health.rest import quadratic as forecast
from monitor.health.rest.quadratic import ForecastState
from monitor.health.size import Remaining, TtStatus, edv
from monitor.health.size.edv import EdvState
from monitor.health.size.level_set import LevelMap

_ANSWERED = (TtStatus.OK, TtStatus.ALREADY_CROSSED)
_EXTENTS = tuple(math.radians(0.5 * i) for i in range(101))
_DEPTHS = tuple(1e-6 * i for i in range(33))

SliceOf = Callable[[LifeHistory], LevelMap]


def map_plan(floor: Floor | None = None, *, coarse: bool = False) -> MapPlan:
    """Return the plan of a map over all loads and speeds of the lives, by default of a smooth floor."""
    every = 2 if coarse else 1
    return MapPlan(
        load=(3000.0, 4000.0, 5000.0),
        speed=tuple(20.0 + 2.5 * i for i in range(0, 11, every)),
        h_d=_DEPTHS[::every],
        dphi_d=_EXTENTS[::every],
        floor=Floor() if floor is None else floor,
        rms_band=(0.0, 9500.0),
    )


def on_map(rms_map: RmsMap) -> SliceOf:
    """Return what gives each life its slice of a map."""

    def slice_of(life: LifeHistory) -> LevelMap:
        at = rms_map.slice_at(float(life.load[0]), float(life.speed[0]))
        return LevelMap(at.dphi_d, at.h_d, at.rms, rms_map.part_radius)

    return slice_of


def rough_map() -> SliceOf:
    """Return the map of one rough floor, as rough as the mean life's."""
    return on_map(cached_map(map_plan(Floor("rough", sd=0.9e-6, seed=1))))


def exact_maps(life: LifeHistory) -> LevelMap:
    """Return a map of a smooth floor at the very load and speed of a life."""
    plan = MapPlan(
        load=(float(life.load[0]),),
        speed=(float(life.speed[0]),),
        h_d=_DEPTHS[::2],
        dphi_d=_EXTENTS,
        rms_band=(0.0, 9500.0),
    )
    return on_map(build_map(plan))(life)


def tracked(life: LifeHistory, map_slice: LevelMap, blocks: int) -> tuple[Floats, list[Remaining]]:
    """Return V_eq (NaN where none) and forecast after each of the first blocks of a life."""
    state, forecasts = EdvState(), ForecastState()
    v_eq, issued = np.empty(blocks), []
    for k in range(blocks):
        state, found = edv.step(state, float(life.rms[k]), map_slice=map_slice)
        forecasts, (result,) = forecast.step(forecasts, float(life.t[k]), found.v_eq, thresholds=[THRESHOLD])
        v_eq[k] = found.v_eq
        issued.append(result)
    return v_eq, issued


def thesis(cases: Cases, slice_of: SliceOf) -> tuple[Answers, Sequence[Floats]]:
    """Return what the method answers, and the V_eq that it tracked in each run, of which others make forecasts."""
    shape = cases.t.shape
    v_eq, tt = np.full(shape, np.nan), np.full((*shape, 1), np.nan)
    histories = []
    for r, life in enumerate(cases.runs):
        history, issued = tracked(life, slice_of(life), int(cases.blocks[r, -1]))
        histories.append(history)
        for m, known in enumerate(cases.blocks[r]):
            v_eq[r, m] = history[known - 1]
            if issued[known - 1].status in _ANSWERED:
                tt[r, m, 0] = issued[known - 1].tt
    _, lower, upper = no_volume(shape)
    return Answers(v_eq, lower, upper, tt), histories
