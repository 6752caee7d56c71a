"""The library forecaster on the cases of ``benchmarks.forecast.methods``."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchmarks.forecast.cases import LEVEL, LEVELS, Answers, Cases
from benchmarks.forecast.population import LIBRARY, THRESHOLD
from models.lives.life import LifeHistory
from monitor.health.size.library.fit import fit_library
from monitor.health.size.library.forecaster import Conditions, LibrarySettings, LibraryState, step
from monitor.health.size.library.model import Library, levels_of
from monitor.health.size.library.summaries import LevelHistory
from reference.lives import block_of


def fitted(lives: Sequence[LifeHistory]) -> Library:
    """Return the forecaster as it is fitted on lives by ``spallwatch library build``, for the one threshold."""
    return fit_library(
        lives,
        thresholds=(THRESHOLD,),
        interval=LIBRARY.interval,
        prior="the library of the benchmark",
        made_of={"population": LIBRARY.hash()},
    )


def without_law(lives: Sequence[LifeHistory], law: str) -> list[LifeHistory]:
    """Return the lives that grow by other laws."""
    return [life for life in lives if life.law != law]


def ask(library: Library, cases: Cases, features: str) -> Answers:
    """Return what the library answers.

    Args:
        library: fitted.
        cases: the cases.
        features: "rms", "rms+harmonics", or "v_eq": the true V_eq, which bounds what any tracker could give.
    """
    shape = cases.t.shape
    v_eq, v_lower, v_upper = np.full((3, *shape), np.nan)
    tt = np.full((*shape, LEVELS.size), np.nan)
    settings = LibrarySettings(features=features, interval=LEVEL)
    for r, life in enumerate(cases.runs):
        for m, state in enumerate(_states(library, life, features, cases.blocks[r].tolist())):
            _, damage, (result,) = step(
                state, block_of(life, int(cases.blocks[r, m]) - 1), library, settings, thresholds=[THRESHOLD]
            )
            v_eq[r, m], v_lower[r, m], v_upper[r, m] = damage.v_eq, damage.v_eq_lower, damage.v_eq_upper
            if result.quantiles:
                tt[r, m] = [value for _, value in result.quantiles]
    return Answers(v_eq, v_lower, v_upper, tt)


def _states(library: Library, life: LifeHistory, features: str, blocks: Sequence[int]) -> list[LibraryState]:
    """Return the state before the last of so many blocks: what ``step`` makes of them, without its answers."""
    fit = library.fit_for(features)
    levels = levels_of(features, life.rms, life.harmonics, life.v_eq)
    relative = fit.relative_levels(levels, life.load, life.speed)
    history, changes, found = LevelHistory.empty(fit.channels), Conditions(), []
    for k in range(max(blocks)):
        found.append(LibraryState(library.hash, features, history if history.count else None, changes))
        if features != "v_eq":
            changes = changes.add(float(life.load[k]), float(life.speed[k]))
        history = history.add(float(life.t[k]), fit.bounded(relative[k])[0])
    return [found[known - 1] for known in blocks]
