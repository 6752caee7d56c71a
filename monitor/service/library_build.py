"""A library of simulated lives for a rig: the population that is simulated, the fit, and in words what it leans on."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence

from models.lives.life import simulate_lives
from models.lives.population import Population
from monitor.health.damage.library.fit import FitSettings, fit_library
from monitor.health.damage.library.model import Library

Progress = Callable[[int, int], None]


def build_library(
    population: Population,
    *,
    runs: int,
    thresholds: Sequence[float],
    workers: int = 0,
    progress: Progress | None = None,
    settings: FitSettings | None = None,
) -> Library:
    """Simulate lives 0 to ``runs - 1`` of a population and fit the forecaster on them.

    Args:
        population: what the lives are drawn from; its ``until`` must be the largest threshold or more.
        runs: how many.
        thresholds: V_th to forecast, m2.
        workers: threads that simulate; 0 means one a core. The library does not depend on it.
        progress: called with the lives done and their total.
        settings: how to fit; by default with the population's seed.

    Raises:
        ValueError: too few lives, thresholds that the population does not reach, or a scene outside the model.
    """
    if max(thresholds, default=0.0) > population.until * (1.0 + 1e-9):
        raise ValueError(
            f"thresholds up to {max(thresholds) * 1e6:g} mm2 need lives that go on until there; "
            f"these go on until {population.until * 1e6:g} mm2"
        )
    lives = list(simulate_lives(population, range(runs), workers, progress))
    return fit_library(
        lives,
        thresholds=thresholds,
        interval=population.interval,
        prior=prior_words(population, runs),
        made_of={"population": json.loads(population.as_json()), "population_hash": population.hash(), "runs": runs},
        settings=settings or FitSettings(seed=population.seed),
    )


def prior_words(population: Population, runs: int) -> str:
    """Return in one sentence what every answer of a library of this population leans on."""
    laws = ", ".join(law.replace("_", " ") for law, _ in population.laws)
    depth = " to ".join(f"{value * 1e6:g}" for value in population.h_threshold)
    extent = " to ".join(f"{_extent_deg(population, value):.0f}" for value in reversed(population.h_threshold))
    hours = " to ".join(f"{value / 3600.0:.3g}" for value in population.durations)
    load = " to ".join(f"{value:g}" for value in population.load)
    speed = " to ".join(f"{value:g}" for value in population.speed)
    return (
        f"{runs} simulated lives (population {population.hash()[:12]}): growth {laws}; {hours} h from onset to "
        f"{population.threshold * 1e6:g} mm2, there {depth} um deep and {extent} deg wide; "
        f"{load} N, {speed} Hz; gains {population.gain_sd:.0%} off"
    )


def _extent_deg(population: Population, depth: float) -> float:
    from models.path.defect import race_radius

    return math.degrees(population.threshold / (race_radius(population.bearing) * depth))
