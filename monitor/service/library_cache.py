"""A library built on first use and kept beside the maps, under a name that everything which makes it has a part in."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from pathlib import Path

from platformdirs import user_cache_dir

from models.lives.population import Population
from monitor.health.damage.library import fit as library_fit
from monitor.health.damage.library import model as library_model
from monitor.health.damage.library import summaries
from monitor.health.damage.library.model import Library
from monitor.records.library_file import SCHEMA_VERSION, LibraryError, load_library, save_library
from monitor.service.library_build import build_library

Progress = Callable[[int, int], None]


def library_path(
    population: Population, runs: int, thresholds: Sequence[float], cache_dir: Path | str | None = None
) -> Path:
    """Return where a library is kept: in ``cache_dir`` or the user's cache folder.

    The text of the modules that fit it is a part of its name: a library is not read by a fit that it was not made by.
    """
    folder = Path(cache_dir) if cache_dir is not None else Path(user_cache_dir("spallwatch")) / "libraries"
    made_by = json.dumps([SCHEMA_VERSION, population.hash(), runs, list(thresholds)])
    digest = hashlib.sha256(made_by.encode())
    for module in (library_fit, library_model, summaries):
        digest.update(Path(str(module.__file__)).read_bytes())
    return folder / f"library-{digest.hexdigest()[:16]}.npz"


def cached_library(
    population: Population,
    runs: int,
    thresholds: Sequence[float],
    cache_dir: Path | str | None = None,
    *,
    workers: int = 0,
    progress: Progress | None = None,
) -> Library:
    """Return a library, built on first use and read afterwards; one that is damaged is built anew.

    Args:
        population: what the lives are drawn from.
        runs: how many.
        thresholds: V_th to forecast, m2.
        cache_dir: folder of the kept libraries; by default the user's cache folder.
        workers: threads that simulate; 0 means one a core.
        progress: called with the lives done and their total; not called where nothing is built.
    """
    path = library_path(population, runs, thresholds, cache_dir)
    try:
        return load_library(path)
    except LibraryError:
        pass
    built = build_library(population, runs=runs, thresholds=thresholds, workers=workers, progress=progress)
    save_library(built, path)
    return built
