"""Every block of some lives of ``benchmarks.forecast``, as issued: refusals, coverage, and what a block costs."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import numpy as np

from benchmarks.common import Row
from benchmarks.forecast_cases import LEVEL, Floats
from benchmarks.forecast_filter import FEATURES
from benchmarks.forecast_library import block_of
from benchmarks.forecast_population import THRESHOLD
from benchmarks.forecast_thesis import map_plan
from models.lives import LifeHistory
from models.map_data import MapSlice
from models.rms_map import cached_map
from monitor.health import edv, forecast
from monitor.health import filter as physical
from monitor.health import library as stage
from monitor.health.library_model import Library
from monitor.report.score_metrics import mean_over_runs

Answer = tuple[float, float, float, float, float, float]
"""V_eq and its lower and upper end, m2; time to threshold and its lower and upper end, s; NaN where there is none."""
Method = Callable[[LifeHistory, MapSlice], Callable[[int], Answer]]
_NAN = float("nan")


def by_library(library: Library, features: str) -> Method:
    """Return the library forecaster, block by block."""
    settings = stage.LibrarySettings(features=features, interval=LEVEL)

    def begin(life: LifeHistory, map_slice: MapSlice) -> Callable[[int], Answer]:
        del map_slice
        state = stage.LibraryState()

        def answer(k: int) -> Answer:
            nonlocal state
            state, found = stage.step(state, block_of(life, k), library, settings, thresholds=[THRESHOLD])
            time_to = found.forecasts[0]
            return found.v_eq, found.v_eq_lower, found.v_eq_upper, time_to.tt, time_to.tt_lower, time_to.tt_upper

        return answer

    return begin


def by_filter(race: float, features: str) -> Method:
    """Return the physical tracker, block by block."""
    settings = physical.FilterSettings(race, lines=FEATURES[features], interval=LEVEL)

    def begin(life: LifeHistory, map_slice: MapSlice) -> Callable[[int], Answer]:
        state = physical.FilterState()

        def answer(k: int) -> Answer:
            nonlocal state
            heard = physical.FilterInput(float(life.t[k]), float(life.rms[k]), tuple(life.harmonics[k].tolist()))
            state, found = physical.step(state, heard, map_slice=map_slice, settings=settings)
            return found.v_eq, found.v_eq_lower, found.v_eq_upper, _NAN, _NAN, _NAN

        return answer

    return begin


def by_thesis(race: float) -> Method:
    """Return the thesis' tracker and forecast, block by block."""

    def begin(life: LifeHistory, map_slice: MapSlice) -> Callable[[int], Answer]:
        tracked, fit = edv.EdvState(), forecast.ForecastState()
        level_map = edv.MapSlice(map_slice.dphi_d, map_slice.h_d, map_slice.rms, race)

        def answer(k: int) -> Answer:
            nonlocal tracked, fit
            tracked, found = edv.step(tracked, float(life.rms[k]), map_slice=level_map)
            fit, (time_to,) = forecast.step(fit, float(life.t[k]), found.v_eq, thresholds=[THRESHOLD])
            return found.v_eq, _NAN, _NAN, time_to.tt, _NAN, _NAN

        return answer

    return begin


def block_rows(runs: Sequence[LifeHistory], library: Library, *, coarse: bool) -> list[Row]:
    """Return the figures of every block before the threshold, by method; shares are means over runs.

    Args:
        runs: lives.
        library: the forecaster.
        coarse: whether on a coarse map.
    """
    rms_map = cached_map(map_plan(coarse=coarse))
    race = rms_map.outer_race_radius
    methods = {"thesis, smooth map": by_thesis(race)}
    for features, name in (("rms", "rms"), ("rms+harmonics", "rms and harmonics")):
        methods[f"library, {name}"] = by_library(library, features)
        methods[f"filter, {name}"] = by_filter(race, features)
    rows: list[Row] = []
    for name, method in methods.items():
        seconds, blocks, shares = 0.0, 0, []
        for life in runs:
            known = int(np.searchsorted(life.t, life.crossing(THRESHOLD)))
            answer = method(life, rms_map.slice_at(float(life.load[0]), float(life.speed[0])))
            begin = time.thread_time()
            answers = np.array([answer(k) for k in range(known)])
            seconds += time.thread_time() - begin
            blocks += known
            shares.append(_shares(life, answers))
        rows.append({"method": name, "runs": len(runs), "blocks": blocks, **_means(np.array(shares))})
        rows[-1] = {**rows[-1], "ms_per_block": 1e3 * seconds / blocks}
    return rows


_NAMES = ("v_refused", "v_coverage", "tt_refused", "tt_coverage")


def _shares(life: LifeHistory, answers: Floats) -> list[float]:
    """Return the shares of ``_NAMES`` in the blocks of one life; of coverages, NaN where there are no intervals."""
    found: list[float] = []
    true_tt = life.crossing(THRESHOLD) - life.t[: len(answers)]
    for (middle, low, high), truth in ((answers.T[:3], life.v_eq[: len(answers)]), (answers.T[3:], true_tt)):
        given = np.isfinite(low)
        inside = (low <= truth) & (truth <= high)
        found += [float(np.mean(np.isnan(middle))), float(np.mean(inside[given])) if np.any(given) else _NAN]
    return found


def _means(shares: Floats) -> dict[str, float | None]:
    found: dict[str, float | None] = {}
    for name, column in zip(_NAMES, shares.T, strict=True):
        mean = mean_over_runs(column.tolist())
        # A method that never answers is one that does not claim to.
        found[name] = mean.mean if mean.runs and not np.all(column == 1.0) else None
        if name.endswith("coverage"):
            found[f"{name}_se"] = mean.standard_error if mean.runs else None
    return found
