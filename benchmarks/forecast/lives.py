"""Simulated lives kept between runs of a benchmark, in the user's cache folder, by the hash of their population."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
from platformdirs import user_cache_dir
from tqdm import tqdm

from models.lives.laws import PATH_STEP, GrowthPath
from models.lives.life import LifeHistory, simulate_lives
from models.lives.population import Population
from models.work.choose import local_runner

CHUNK = 50
"""Lives in one file."""
_ARRAYS = tuple(field.name for field in fields(LifeHistory) if field.name not in ("number", "law", "path"))


def save_lives(lives: Sequence[LifeHistory], path: Path) -> None:
    """Write lives to a file of plain arrays."""
    path.parent.mkdir(parents=True, exist_ok=True)
    arrays: dict[str, Any] = {name: np.concatenate([getattr(life, name) for life in lives]) for name in _ARRAYS}
    arrays["path"] = np.concatenate([life.path.v_eq for life in lives])
    arrays["blocks"] = np.array([life.t.size for life in lives])
    arrays["points"] = np.array([life.path.t.size for life in lives])
    arrays["number"] = np.array([life.number for life in lives])
    arrays["law"] = np.array([life.law for life in lives])
    # Written beside and moved: a run that is interrupted leaves no half file.
    beside = path.with_suffix(".part.npz")
    np.savez(beside, **arrays)
    beside.replace(path)


def load_lives(path: Path) -> list[LifeHistory]:
    """Return the lives of a file."""
    with np.load(path) as stored:
        arrays = {name: stored[name] for name in stored.files}
    ends, path_ends = np.cumsum(arrays["blocks"])[:-1], np.cumsum(arrays["points"])[:-1]
    parts = {name: np.split(arrays[name], ends) for name in _ARRAYS}
    paths = [
        GrowthPath(PATH_STEP * np.arange(v.size, dtype=np.float64), v) for v in np.split(arrays["path"], path_ends)
    ]
    return [
        LifeHistory(number=int(number), law=str(law), path=path, **{name: parts[name][i] for name in _ARRAYS})
        for i, (number, law, path) in enumerate(zip(arrays["number"], arrays["law"], paths, strict=True))
    ]


def cached_lives(population: Population, count: int, workers: int = 1) -> list[LifeHistory]:
    """Return the first lives of a population, simulated where they are not kept yet.

    Args:
        population: what they are drawn from.
        count: how many.
        workers: threads; 0: one a core.
    """
    folder = Path(user_cache_dir("spallwatch")) / "lives"
    found: list[LifeHistory] = []
    for first in range(0, count, CHUNK):
        wanted = range(first, min(first + CHUNK, count))
        path = folder / f"{population.hash()[:16]}-{first:05d}-{len(wanted)}.npz"
        whole = folder / f"{population.hash()[:16]}-{first:05d}-{CHUNK}.npz"
        if whole.exists():
            found += load_lives(whole)[: len(wanted)]
            continue
        if not path.exists():
            with local_runner(workers) as runner:
                save_lives(list(_shown(simulate_lives(population, wanted, runner), len(wanted), first)), path)
        found += load_lives(path)
    return found


def _shown(lives: Iterable[LifeHistory], count: int, first: int) -> Iterable[LifeHistory]:
    return tqdm(lives, total=count, desc=f"lives from {first}", file=sys.stderr, leave=False)
