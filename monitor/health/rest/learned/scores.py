"""Scores of learned forecasts on runs that they were not fitted on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from monitor.health.rest.learned.fit import MOMENTS, LearnedRun, fit_runs, moments_of
from monitor.health.rest.learned.forecaster import LearnedState, step
from monitor.health.rest.learned.model import LIBRARY_RUNS, Distribution, LearnedModel
from monitor.health.rest.learned.pool import pool
from monitor.health.size import DamageInput, Remaining, RemainingSettings

SCORED_SHARES = (0.25, 0.5, 0.75)
INTERVAL = 0.8
MAX_CRPS_SHARE = 10.0
_LN_GRID = np.linspace(-14.0, 10.0, 1201)


def crps(found: Distribution, left: float) -> float:
    """Return the CRPS of a forecast, s, when TT turned out to be ``left``, s."""
    x = found.elapsed * np.exp(_LN_GRID)
    reached = 1.0 / (1.0 + np.exp(-np.clip((_LN_GRID - found.centre) / found.scale, -60.0, 60.0)))
    widths = np.diff(x, prepend=0.0)
    middle = 0.5 * (reached + np.concatenate((reached[:1], reached[:-1])))
    # In the bin that holds the truth both parts count.
    before = np.clip((left - (x - widths)) / widths, 0.0, 1.0)
    return float(np.sum(widths * (before * middle**2 + (1.0 - before) * (1.0 - middle) ** 2)))


def crps_share(found: Distribution, left: float, life: float) -> float:
    """Return the CRPS over the life, at most ``MAX_CRPS_SHARE``."""
    return min(crps(found, left) / life, MAX_CRPS_SHARE)


def covers(found: Distribution, left: float) -> bool:
    """Return whether the interval of ``INTERVAL`` holds the TT that turned out, s."""
    half = 0.5 * INTERVAL
    return found.quantile(0.5 - half) <= left <= found.quantile(0.5 + half)


def scores_out_of_run(runs: Sequence[LearnedRun]) -> dict[str, Any]:
    """Return the scores of each run by the others: at the scored shares, and over the whole of each life."""
    everywhere = ((np.arange(MOMENTS) + 0.5) / MOMENTS).tolist()
    by_share: dict[float, list[tuple[float, float, bool]]] = {share: [] for share in SCORED_SHARES}
    over_life: list[tuple[float, float]] = []
    brier: list[tuple[float, float]] = []
    for place, run in enumerate(runs):
        others = [other for number, other in enumerate(runs) if number != place]
        model = fit_runs(others)
        for share in SCORED_SHARES:
            for found, left in _asked(model, run, (share,)):
                prior = crps_share(Distribution(found.elapsed), left, run.life)
                by_share[share].append((crps_share(found, left, run.life), prior, covers(found, left)))
        asked = _asked(model, run, everywhere)
        if asked:
            over_life.append(
                (
                    float(np.mean([crps_share(found, left, run.life) for found, left in asked])),
                    float(np.mean([covers(found, left) for found, left in asked])),
                )
            )
        brier += _crossed_scores(model, others, run, everywhere)
    pooled = [row for rows in by_share.values() for row in rows]
    return {
        "crps_share": _mean([row[0] for row in pooled]),
        "coverage": _mean([float(row[2]) for row in pooled]),
        "by_share": {
            f"{share:g}": {
                "crps_share": _mean([row[0] for row in rows]),
                "elapsed_crps_share": _mean([row[1] for row in rows]),
                "coverage": _mean([float(row[2]) for row in rows]),
                "runs": len(rows),
            }
            for share, rows in by_share.items()
        },
        "over_life": {
            "crps_share": _mean([row[0] for row in over_life]),
            "coverage": _mean([row[1] for row in over_life]),
        },
        "p_crossed": {"brier": _mean([row[0] for row in brier]), "brier_base_rate": _mean([row[1] for row in brier])},
    }


def _asked(model: LearnedModel, run: LearnedRun, shares: Sequence[float]) -> list[tuple[Distribution, float]]:
    moments = moments_of(run, shares)
    rows = zip(moments.inputs, moments.elapsed.tolist(), moments.left.tolist(), strict=True)
    return [(model.distribution(x, elapsed), left) for x, elapsed, left in rows]


def _crossed_scores(
    model: LearnedModel, others: Sequence[LearnedRun], run: LearnedRun, shares: Sequence[float]
) -> list[tuple[float, float]]:
    """Return the mean Brier scores of a run: of P(crossed), and of the share of moments at the end level in others."""
    mine = _reached(run, shares)
    rate = [reached for other in others for _, reached in _reached(other, shares)]
    rows = [
        ((probability - reached) ** 2, (float(np.mean(rate)) - reached) ** 2)
        for level, reached in mine
        if math.isfinite(probability := model.end_levels.probability_beyond(level))
    ]
    return [(float(np.mean([row[0] for row in rows])), float(np.mean([row[1] for row in rows])))] if rows else []


def _reached(run: LearnedRun, shares: Sequence[float]) -> list[tuple[float, bool]]:
    """Return the levels of a run at shares of its life and at its end, and whether they are those of its end."""
    levels = [*moments_of(run, shares).inputs[:, 1].tolist(), run.end_level]
    return [(level, level >= run.end_level) for level in levels if math.isfinite(level)]


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if values else None


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
    pairs = np.array(pool(learned, physical, weight, RemainingSettings()).quantiles, dtype=np.float64)
    levels, values = pairs[:, 0], pairs[:, 1]
    pinball = np.where(left >= values, levels * (left - values), (1.0 - levels) * (values - left))
    return min(2.0 * float(pinball.mean()) / life, MAX_CRPS_SHARE)
