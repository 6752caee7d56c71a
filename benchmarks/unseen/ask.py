"""What the product answers to lives of ``benchmarks.unseen.lives``: asked block by block, as a daemon asks."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.forecast.cases import LEVEL, LEVELS, Answers, Cases
from benchmarks.forecast.library import block_of
from benchmarks.forecast.thesis import map_plan
from benchmarks.unseen.laws import THRESHOLD, Floats
from benchmarks.unseen.lives import UnseenLife
from models.lives.life import draw_life
from models.lives.population import Population
from models.maps.data import RmsMap
from models.maps.file import cached_map
from monitor.health.size import Damage, Remaining
from monitor.health.size.library.forecaster import LibrarySettings
from monitor.health.size.library.model import Library
from monitor.health.tracker import DamageGate, DamageSettings, DamageState, TrackMethod, step
from monitor.records.library_file import load_library
from monitor.service.libraries import build_library
from monitor.service.setup import part_map

FRACTIONS = (0.25, 0.5, 0.75)
"""Shares of the time from the onset to the threshold at which methods are asked."""
_FIRST_INDEPENDENT = 1_000_000
"""Number of the first life of a library's population whose lifetime is used: the library is made of earlier ones."""


def library_for(path: Path | None, runs: int) -> Library:
    """Return the library of a file, or that of ``library build`` over all loads and speeds."""
    return load_library(path) if path is not None else build_library(Population(), runs=runs, thresholds=[THRESHOLD])


def population_of(library: Library) -> Population:
    """Return the population that a library was made from."""
    return Population.from_json(json.dumps(library.made_of["population"]))


def map_for(*, coarse: bool = True) -> RmsMap:
    """Return the map of the filter over all loads and speeds, of a smooth floor."""
    return cached_map(map_plan(coarse=coarse))


def independent_lifetimes(library: Library, count: int) -> tuple[Floats, Floats]:
    """Return lifetimes of the library's own population, s, shape (n,), and V_eq at the moments, m2, shape (n, 3).

    The lives are none of those that it was made of; of ``count``, those that never reach the threshold are left out.
    """
    population = population_of(library)
    paths = [draw_life(population, _FIRST_INDEPENDENT + k).path for k in range(count)]
    paths = [path for path in paths if np.isfinite(path.crossing(THRESHOLD))]
    ends = np.array([path.crossing(THRESHOLD) for path in paths])
    shares = np.array(FRACTIONS)
    return ends, np.array([path.at(end * shares) for path, end in zip(paths, ends, strict=True)])


def settings_for(
    library: Library | None, features: str, method: TrackMethod = "library", rms_map: RmsMap | None = None
) -> DamageSettings:
    """Return the settings of a calibrated channel.

    Args:
        library: that forecasts, or None.
        features: "rms", "rms+harmonics" or "v_eq".
        method: that tracks V_eq.
        rms_map: of the outer race, or None.
    """
    return DamageSettings(
        track_method=method,
        forecast_method="library",
        maps={} if rms_map is None else {"outer": part_map(rms_map, features.split("+"), LEVEL)},
        thresholds=(THRESHOLD,),
        library=library,
        library_settings=LibrarySettings(features=features, interval=LEVEL),
        calibrated=True,
    )


def follow(
    life: UnseenLife, settings: DamageSettings, blocks: int, gate: DamageGate | None = None
) -> Iterator[tuple[Damage, Remaining]]:
    """Yield V_eq and forecast of each of the first blocks of a life."""
    state, gate = DamageState(), gate or DamageGate()
    for k in range(blocks):
        state, damage, (forecast,) = step(state, block_of(life, k), gate, settings)
        yield damage, forecast


@dataclass(frozen=True, eq=False)
class Said:
    """Answers at the moments of some lives, with their statuses, each of shape (lives, moments).

    Attributes:
        answers: V_eq and quantiles of TT.
        lower, upper: bounds of TT as issued, s; the upper may be infinite, NaN where there are none.
        edv, tt: statuses.
    """

    answers: Answers
    lower: Floats
    upper: Floats
    edv: NDArray[np.str_]
    tt: NDArray[np.str_]


def moments_of(lives: Sequence[UnseenLife]) -> Cases:
    """Return the moments of lives: the last block before each share of the time to the threshold."""
    ends = np.array([life.crossing for life in lives])
    known = np.array(
        [np.searchsorted(life.t, np.array(FRACTIONS) * life.crossing, side="right") for life in lives], dtype=np.int64
    )
    blocks = np.maximum(known, 1)
    t = np.array([life.t[last - 1] for life, last in zip(lives, blocks, strict=True)])
    v_eq = np.array([life.v_eq[last - 1] for life, last in zip(lives, blocks, strict=True)])
    return Cases((), blocks, t, v_eq, ends[:, None] - t, np.array([life.law for life in lives]))


def ask(lives: Sequence[UnseenLife], cases: Cases, settings: DamageSettings) -> Said:
    """Return what the product answers at the moments of lives; ``cases`` are those of the lives."""
    shape = cases.t.shape
    volumes, tt = np.full((5, *shape), np.nan), np.full((*shape, LEVELS.size), np.nan)
    statuses = np.full((2, *shape), "", dtype="U40")
    for r, life in enumerate(lives):
        found = list(follow(life, settings, int(cases.blocks[r, -1])))
        for m, known in enumerate(cases.blocks[r].tolist()):
            damage, forecast = found[known - 1]
            issued = damage.v_eq, damage.v_eq_lower, damage.v_eq_upper, forecast.tt_lower, forecast.tt_upper
            volumes[:, r, m] = issued
            statuses[:, r, m] = damage.status.value, forecast.status.value
            if forecast.quantiles:
                tt[r, m] = [value for _, value in forecast.quantiles]
    v_eq, v_lower, v_upper, lower, upper = volumes
    return Said(Answers(v_eq, v_lower, v_upper, tt), lower, upper, statuses[0], statuses[1])
