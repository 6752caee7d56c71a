"""The physical tracker on the cases of ``benchmarks.forecast.methods``. It tracks; it forecasts nothing.

On two maps: of a smooth floor, with which the widths of its intervals were fitted (``benchmarks.filter``), and the mean
over six rough floors, whose spread tells it how far to trust the map at each node. Both are read between loads and
speeds.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.forecast.cases import LEVEL, Answers, Cases, only_volume
from benchmarks.forecast.thesis import map_plan
from models.lives.life import LifeHistory
from models.machine.scene import Floor
from models.maps.data import MapSlice, RmsMap
from models.maps.file import cached_map
from monitor.health.size import Damage, DamageInput
from monitor.health.size.filter.particle_filter import FilterSettings, FilterState, step

FEATURES = {"rms": 0, "rms+harmonics": 3}
"""Lines of BPFO that are read with a set of features."""


def floors_map(*, coarse: bool = False) -> RmsMap:
    """Return the mean over six rough floors; a coarse one is of one floor."""
    plan = map_plan(Floor("rough", sd=0.9e-6, seed=1), coarse=coarse)
    # The mean over floors has no stripes narrower than a degree.
    return cached_map(plan if coarse else replace(plan, dphi_d=plan.dphi_d[::2], floors=6))


def track(cases: Cases, features: str, rms_map: RmsMap) -> Answers:
    """Return what the tracker answers.

    Args:
        cases: the cases.
        features: "rms" or "rms+harmonics".
        rms_map: over all their loads and speeds.
    """
    settings = FilterSettings(rms_map.part_radius, lines=FEATURES[features], interval=LEVEL)
    found = np.full((3, *cases.t.shape), np.nan)
    for r, life in enumerate(cases.runs):
        results = _followed(life, slice_of(rms_map, life), settings, int(cases.blocks[r, -1]))
        for m, known in enumerate(cases.blocks[r]):
            result = results[known - 1]
            found[:, r, m] = result.v_eq, result.v_eq_lower, result.v_eq_upper
    return only_volume(*found)


def slice_of(rms_map: RmsMap, life: LifeHistory) -> MapSlice:
    """Return a map at the load and speed of a life."""
    return rms_map.slice_at(float(life.load[0]), float(life.speed[0]))


def _followed(life: LifeHistory, map_slice: MapSlice, settings: FilterSettings, blocks: int) -> list[Damage]:
    """Return the result of each of the first blocks of a life."""
    state, found = FilterState(), []
    for k in range(blocks):
        heard = DamageInput(float(life.t[k]), float(life.rms[k]), tuple(life.harmonics[k].tolist()))
        state, result = step(state, heard, map_slice=map_slice, settings=settings)
        found.append(result)
    return found
