"""The physical tracker on the cases of ``benchmarks.forecast``. It tracks; it forecasts nothing."""

from __future__ import annotations

import numpy as np

from benchmarks.forecast_cases import LEVEL, Answers, Cases, only_volume
from benchmarks.forecast_thesis import map_plan
from models.lives import LifeHistory
from models.map_data import MapSlice, RmsMap
from models.rms_map import cached_map
from monitor.health.filter import FilterInput, FilterResult, FilterSettings, FilterState, step

FEATURES = {"rms": 0, "rms+harmonics": 3}
"""Lines of BPFO that are read with a set of features."""


def track(cases: Cases, features: str, *, coarse: bool = False) -> Answers:
    """Return what the tracker answers, on the map of a smooth floor.

    Args:
        cases: the cases.
        features: "rms" or "rms+harmonics".
        coarse: whether on a coarse map.
    """
    rms_map = cached_map(map_plan(coarse=coarse))
    settings = FilterSettings(rms_map.outer_race_radius, lines=FEATURES[features], interval=LEVEL)
    found = np.full((3, *cases.t.shape), np.nan)
    for r, life in enumerate(cases.runs):
        results = _followed(life, _slice(rms_map, life), settings, int(cases.blocks[r, -1]))
        for m, known in enumerate(cases.blocks[r]):
            result = results[known - 1]
            found[:, r, m] = result.v_eq, result.v_eq_lower, result.v_eq_upper
    return only_volume(*found)


def _slice(rms_map: RmsMap, life: LifeHistory) -> MapSlice:
    return rms_map.slice_at(float(life.load[0]), float(life.speed[0]))


def _followed(life: LifeHistory, map_slice: MapSlice, settings: FilterSettings, blocks: int) -> list[FilterResult]:
    """Return the result of each of the first blocks of a life."""
    state, found = FilterState(), []
    for k in range(blocks):
        heard = FilterInput(float(life.t[k]), float(life.rms[k]), tuple(life.harmonics[k].tolist()))
        state, result = step(state, heard, map_slice=map_slice, settings=settings)
        found.append(result)
    return found
