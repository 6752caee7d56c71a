"""Libraries of simulated lives for a rig: simulate the population, fit the forecaster, keep the result.

A kept library is a file in the user's cache folder, whose name depends on everything that made it.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path

from platformdirs import user_cache_dir

from models.lives.growth import TrackingError
from models.lives.life import simulate_lives
from models.lives.population import Population
from models.machine.rig import Rig
from models.work.runner import SERIAL, Runner
from monitor.health.damage.library import acceleration, plausible, regression, summaries
from monitor.health.damage.library import fit as library_fit
from monitor.health.damage.library import model as library_model
from monitor.health.damage.library.fit import FitSettings, fit_library
from monitor.health.damage.library.model import Library
from monitor.records.library_file import SCHEMA_VERSION, LibraryError, load_library, save_library

Progress = Callable[[int, int], None]

SHIPPED = Path(__file__).with_name("growth_library.npz")
"""The library that ships: for histories of V_eq, without a rig (``benchmarks.growth_library`` makes it)."""
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


def library_path(
    population: Population, runs: int, thresholds: Sequence[float], cache_dir: Path | str | None = None
) -> Path:
    """Return the file of a library in ``cache_dir`` or the user's cache folder.

    The source of the modules that fit it is a part of its name: another version of the fit builds a library anew.
    """
    folder = Path(cache_dir) if cache_dir is not None else Path(user_cache_dir("spallwatch")) / "libraries"
    made_by = json.dumps([SCHEMA_VERSION, population.hash(), runs, list(thresholds)])
    digest = hashlib.sha256(made_by.encode())
    for module in (library_fit, library_model, acceleration, plausible, regression, summaries):
        digest.update(Path(str(module.__file__)).read_bytes())
    return folder / f"library-{digest.hexdigest()[:16]}.npz"


def cached_library(
    population: Population,
    runs: int,
    thresholds: Sequence[float],
    cache_dir: Path | str | None = None,
    *,
    runner: Runner = SERIAL,
    progress: Progress | None = None,
) -> Library:
    """Return a library, built on first use and read afterwards; a damaged one is built anew.

    Arguments are those of :func:`build_library` and :func:`library_path`.
    """
    path = library_path(population, runs, thresholds, cache_dir)
    try:
        return load_library(path)
    except LibraryError:
        pass
    built = build_library(population, runs=runs, thresholds=thresholds, runner=runner, progress=progress)
    save_library(built, path)
    return built
