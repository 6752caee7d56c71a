"""Every block of some lives of ``benchmarks.forecast``, as issued: scores, refusals, and what a block costs.

Moments at fixed shares of a life favour whoever knows that they are: at three quarters of it, a third of the time gone
is what remains. Here every block before the threshold counts, and a run is the mean over its blocks.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence

import numpy as np

from benchmarks.common import Row
from benchmarks.forecast_cases import LEVEL, LEVELS, WORST, Floats
from benchmarks.forecast_filter import FEATURES, slice_of
from benchmarks.forecast_population import THRESHOLD
from benchmarks.forecast_thesis import map_plan
from models.lives.life import LifeHistory
from models.maps.data import RmsMap
from models.maps.file import cached_map
from monitor.health.rest import quadratic as forecast
from monitor.health.size import DamageInput, edv
from monitor.health.size.filter import particle_filter as physical
from monitor.health.size.level_set import LevelMap
from monitor.health.size.library import forecaster as stage
from monitor.health.size.library.model import Library
from monitor.report.score import baselines
from monitor.report.score.metrics import crps_from_quantiles, mean_over_runs
from tests.support.followed_lives import block_of

Answer = tuple[float, float, float, Sequence[float]]
"""V_eq and its lower and upper end, m2; quantiles of the time to threshold at ``LEVELS``, or one number, s; NaN or ()
where there is none."""
Method = Callable[[LifeHistory], Callable[[int], Answer]]
_NAN = math.nan
_TAIL = 0.5 * (1.0 - LEVEL)
# A tracked volume below this counts as this in ln V_eq, m2; the least true one is eight times as large.
_LEAST = 1e-10


def by_library(library: Library, features: str) -> Method:
    """Return the library forecaster, block by block."""
    settings = stage.LibrarySettings(features=features, interval=LEVEL)

    def begin(life: LifeHistory) -> Callable[[int], Answer]:
        state = stage.LibraryState()

        def answer(k: int) -> Answer:
            nonlocal state
            state, found, (result,) = stage.step(state, block_of(life, k), library, settings, thresholds=[THRESHOLD])
            return found.v_eq, found.v_eq_lower, found.v_eq_upper, tuple(value for _, value in result.quantiles)

        return answer

    return begin


def by_filter(rms_map: RmsMap, features: str) -> Method:
    """Return the physical tracker, block by block."""
    settings = physical.FilterSettings(rms_map.part_radius, lines=FEATURES[features], interval=LEVEL)

    def begin(life: LifeHistory) -> Callable[[int], Answer]:
        map_slice = slice_of(rms_map, life)
        state = physical.FilterState()

        def answer(k: int) -> Answer:
            nonlocal state
            heard = DamageInput(float(life.t[k]), float(life.rms[k]), tuple(life.harmonics[k].tolist()))
            state, found = physical.step(state, heard, map_slice=map_slice, settings=settings)
            return found.v_eq, found.v_eq_lower, found.v_eq_upper, ()

        return answer

    return begin


def by_thesis(rms_map: RmsMap) -> Method:
    """Return the thesis' tracker and forecast, block by block."""

    def begin(life: LifeHistory) -> Callable[[int], Answer]:
        map_slice = slice_of(rms_map, life)
        tracked, fit = edv.EdvState(), forecast.ForecastState()
        level_map = LevelMap(map_slice.dphi_d, map_slice.h_d, map_slice.rms, rms_map.part_radius)

        def answer(k: int) -> Answer:
            nonlocal tracked, fit
            tracked, found = edv.step(tracked, float(life.rms[k]), map_slice=level_map)
            fit, (time_to,) = forecast.step(fit, float(life.t[k]), found.v_eq, thresholds=[THRESHOLD])
            return found.v_eq, _NAN, _NAN, () if math.isnan(time_to.tt) else (time_to.tt,)

        return answer

    return begin


def by_elapsed_time(forecast_of: Callable[[float], baselines.Sample]) -> Method:
    """Return a forecast that knows nothing but the time gone."""

    def begin(life: LifeHistory) -> Callable[[int], Answer]:
        return lambda k: (_NAN, _NAN, _NAN, forecast_of(float(life.t[k])).quantiles(LEVELS).tolist())

    return begin


def all_methods(library: Library, lifetimes: Floats, *, coarse: bool) -> dict[str, Method]:
    """Return the methods by name.

    Args:
        library: the forecaster.
        lifetimes: of the lives that it was fitted on, s.
        coarse: whether on coarse maps.
    """
    smooth = cached_map(map_plan(coarse=coarse))
    methods = {
        "climatology": by_elapsed_time(lambda elapsed: baselines.climatology(elapsed, lifetimes)),
        "elapsed time alone": by_elapsed_time(lambda elapsed: baselines.elapsed_alone(elapsed, lifetimes)),
        "thesis, smooth map": by_thesis(smooth),
    }
    for features, name in (("rms", "rms"), ("rms+harmonics", "rms and harmonics")):
        methods[f"library, {name}"] = by_library(library, features)
        methods[f"filter, {name}"] = by_filter(smooth, features)
    return methods


def block_rows(runs: Sequence[LifeHistory], library: Library, lifetimes: Floats, *, coarse: bool) -> list[Row]:
    """Return the figures of every block before the threshold, by method; all are means over runs.

    Args:
        runs: lives.
        library: the forecaster.
        lifetimes: of the lives that it was fitted on, s.
        coarse: whether on coarse maps.
    """
    rows: list[Row] = []
    for name, method in all_methods(library, lifetimes, coarse=coarse).items():
        seconds, blocks, figures = 0.0, 0, []
        for life in runs:
            known = int(np.searchsorted(life.t, life.crossing(THRESHOLD)))
            answer = method(life)
            begin = time.thread_time()
            answers = [answer(k) for k in range(known)]
            seconds += time.thread_time() - begin
            blocks += known
            figures.append(_figures(life, answers, lifetimes))
        found = _means(np.array(figures))
        rows.append(
            {"method": name, "runs": len(runs), "blocks": blocks, **found, "ms_per_block": 1e3 * seconds / blocks}
        )
    return rows


_NAMES = ("v_refused", "v_coverage", "v_rms_ln", "tt_refused", "tt_coverage", "crps_min")


def _figures(life: LifeHistory, answers: Sequence[Answer], lifetimes: Floats) -> list[float]:
    """Return the figures of ``_NAMES`` of one life, NaN where the method has no such."""
    volume = np.array([row[:3] for row in answers])
    truth = life.v_eq[: len(answers)]
    given = np.isfinite(volume[:, 0])
    error = np.log(np.maximum(volume[given, 0], _LEAST) / truth[given])
    found = [float(np.mean(~given)), _inside(volume[:, 1], volume[:, 2], truth), _root_mean_square(error)]
    width = max(len(row[3]) for row in answers)
    if width == 0:
        return [*found, 1.0, _NAN, _NAN]
    tt = np.array([row[3] if len(row[3]) else [_NAN] * width for row in answers])
    left = life.crossing(THRESHOLD) - life.t[: len(answers)]
    missing = np.isnan(tt[:, 0])
    guess = np.abs(baselines.constant(life.t[: len(answers)], lifetimes) - left)
    score = np.where(missing, guess, crps_from_quantiles(LEVELS if width > 1 else [0.5], tt, left))
    lower, upper = int(np.argmin(np.abs(LEVELS - _TAIL))), int(np.argmin(np.abs(LEVELS - 1.0 + _TAIL)))
    inside = _inside(tt[:, lower], tt[:, upper], left) if width > 1 else _NAN
    return [*found, float(np.mean(missing)), inside, float(np.mean(np.minimum(score, WORST))) / 60.0]


def _inside(lower: Floats, upper: Floats, truth: Floats) -> float:
    """Return the share of the intervals that were given that hold the truth."""
    given = np.isfinite(lower)
    return float(np.mean(((lower <= truth) & (truth <= upper))[given])) if np.any(given) else _NAN


def _root_mean_square(values: Floats) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else _NAN


def _means(figures: Floats) -> dict[str, float | None]:
    found: dict[str, float | None] = {}
    for name, column in zip(_NAMES, figures.T, strict=True):
        mean = mean_over_runs(column.tolist())
        # A method that never answers is one that does not claim to.
        found[name] = mean.mean if mean.runs and not np.all(column == 1.0) else None
        if not name.endswith("refused"):
            found[f"{name}_se"] = mean.standard_error if mean.runs else None
    return found
