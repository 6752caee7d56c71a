"""Libraries of simulated lives for a rig: simulate the population, fit the forecaster; and the one that ships."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path

from models.lives.growth import TrackingError
from models.lives.life import simulate_lives
from models.lives.population import Population
from models.machine.rig import Rig
from models.work.runner import SERIAL, Runner
from monitor.health.size.library.fit import FitSettings, fit_library
from monitor.health.size.library.model import Library
from monitor.records.library_file import load_library

Progress = Callable[[int, int], None]

SHIPPED = Path(__file__).with_name("growth_library.npz")
"""The library that ships: for histories of V_eq, without a rig (``benchmarks.forecast.growth_library`` makes it)."""
SHIPPED_NAME = "growth"


def build_library(
    population: Population,
    *,
    runs: int,
    thresholds: Sequence[float],
    runner: Runner = SERIAL,
    progress: Progress | None = None,
    settings: FitSettings | None = None,
) -> Library:
    """Simulate lives 0 to ``runs - 1`` of a population and fit the forecaster on them.

    It forecasts the ``thresholds`` (V_th, m2), which the lives must reach. It does not depend on ``runner``.
    ``progress`` is called with the lives done and their total. By default the fit has the population's seed.

    Raises:
        ValueError: too few lives, thresholds that the population does not reach, or a scene outside the model.
    """
    if max(thresholds, default=0.0) > population.until * (1.0 + 1e-9):
        raise ValueError(
            f"thresholds up to {max(thresholds) * 1e6:g} mm2 need lives that go on until there; "
            f"these go on until {population.until * 1e6:g} mm2"
        )
    lives = list(simulate_lives(population, range(runs), runner, progress))
    return fit_library(
        lives,
        thresholds=thresholds,
        interval=population.interval,
        prior=prior_words(population, runs),
        made_of={"population": json.loads(population.as_json()), "population_hash": population.hash(), "runs": runs},
        settings=settings or FitSettings(seed=population.seed),
    )


@cache
def shipped_library() -> Library:
    """Return the library that ships; LibraryError where the installation lacks it."""
    return load_library(SHIPPED)


def growth_words(population: Population, error: TrackingError, runs: int) -> str:
    """Return the assumptions behind a library of growth alone, in one sentence."""
    blocks = " to ".join(f"{value / population.interval:g}" for value in population.durations)
    first = " to ".join(f"{value / population.threshold:.1%}" for value in population.v_0)
    known = " to ".join(f"{value:g}" for value in error.sd)
    return (
        f"{runs} simulated growths of V_eq without a rig: {_laws_words(population)}; {blocks} blocks from onset to "
        f"threshold, {first} of it at the onset; V_eq known to {known} in its logarithm"
    )


def _laws_words(population: Population) -> str:
    total = sum(weight for _, weight in population.laws)
    return ", ".join(f"{law.replace('_', ' ')} {weight / total:.0%}" for law, weight in population.laws)


def prior_words(population: Population, runs: int) -> str:
    """Return the assumptions behind every answer of a library of this population, in one sentence."""
    depth = " to ".join(f"{value * 1e6:g}" for value in population.h_threshold)
    extent = " to ".join(f"{_extent_deg(population, value):.0f}" for value in reversed(population.h_threshold))
    hours = " to ".join(f"{value / 3600.0:.3g}" for value in population.durations)
    laws = _laws_words(population)
    load = " to ".join(f"{value:g}" for value in population.load)
    speed = " to ".join(f"{value:g}" for value in population.speed)
    posterior = population.rig_posterior
    rigs = "" if posterior is None else f"; rigs of the posterior of identification {posterior.identification[:12]}"
    model = "" if population.rig.model == Rig.model else f" by the model {population.rig.model}"
    return (
        f"{runs} simulated lives{model} (population {population.hash()[:12]}): growth {laws}; {hours} h from onset to "
        f"{population.threshold * 1e6:g} mm2, there {depth} um deep and {extent} deg wide; "
        f"{load} N, {speed} Hz; gains {population.gain_sd:.0%} off{rigs}"
    )


def _extent_deg(population: Population, depth: float) -> float:
    from models.path.defect import race_radius

    return math.degrees(population.threshold / (race_radius(population.bearing) * depth))
