"""Weight of a library's forecasts beside learned ones, by runs that the learned ones were not fitted on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from monitor.health.rest.learned.fit import LearnedRun, fit_runs
from monitor.health.rest.learned.forecaster import LearnedSettings, LearnedState, step
from monitor.health.rest.learned.model import LIBRARY_RUNS
from monitor.health.rest.learned.pool import pool
from monitor.health.rest.learned.scores import MAX_CRPS_SHARE, SCORED_SHARES
from monitor.health.size import DamageInput, Remaining

_GRID = tuple(i / 10 for i in range(11))


@dataclass(frozen=True, eq=False)
class PhysicalRun:
    """A run and the forecast of a library after each of its blocks."""

    run: LearnedRun
    forecasts: Sequence[Remaining]


def library_weight(runs: Sequence[PhysicalRun]) -> float | None:
    """Return the weight of least mean CRPS, drawn towards that of ``LIBRARY_RUNS`` runs; None with less than two runs.

    Each run is forecast by the others, at the scored shares of its life, and counts once.
    """
    if len(runs) < 2:
        return None
    losses: list[list[float]] = []
    for place, one in enumerate(runs):
        others = [other.run for number, other in enumerate(runs) if number != place]
        pairs = _pairs(one, others)
        if pairs:
            losses.append([float(np.mean([_loss(*pair, weight, one.run.life) for pair in pairs])) for weight in _GRID])
    if not losses:
        return None
    count = len(losses)
    best = _GRID[int(np.argmin(np.mean(losses, axis=0)))]
    prior = LIBRARY_RUNS / (LIBRARY_RUNS + count)
    return (count * best + LIBRARY_RUNS * prior) / (count + LIBRARY_RUNS)


def _pairs(one: PhysicalRun, others: Sequence[LearnedRun]) -> list[tuple[Remaining, Remaining, float]]:
    """Return learned forecast, the library's, and what was left, s, at the scored shares."""
    run, model, state = one.run, fit_runs(others), LearnedState()
    wanted = {
        int(np.searchsorted(run.t, share * run.life * (1.0 + 1e-12), side="right")) - 1 for share in SCORED_SHARES
    }
    found: list[tuple[Remaining, Remaining, float]] = []
    rows = zip(run.t.tolist(), np.exp(run.ln_rms).tolist(), one.forecasts, strict=True)
    baseline = float(np.exp(run.ln_baseline)) if np.isfinite(run.ln_baseline) else None
    for place, (t, rms, physical) in enumerate(rows):
        state, learned = step(state, DamageInput(t, rms), model, baseline=baseline)
        if place in wanted and learned.quantiles and run.life > t:
            found.append((learned, physical, run.life - t))
    return found


def _loss(learned: Remaining, physical: Remaining, left: float, weight: float, life: float) -> float:
    """Return the CRPS of the combination over the life, at most ``MAX_CRPS_SHARE``, from its quantiles."""
    pairs = np.array(pool(learned, physical, weight, LearnedSettings()).quantiles, dtype=np.float64)
    levels, values = pairs[:, 0], pairs[:, 1]
    pinball = np.where(left >= values, levels * (left - values), (1.0 - levels) * (values - left))
    return min(2.0 * float(pinball.mean()) / life, MAX_CRPS_SHARE)
