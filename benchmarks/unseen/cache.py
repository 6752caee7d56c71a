"""Lives of ``benchmarks.unseen.lives`` kept between runs, in the user's cache folder, by all that they depend on."""

from __future__ import annotations

import ast
import hashlib
import sys
from collections.abc import Callable, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
from platformdirs import user_cache_dir
from tqdm import tqdm

from benchmarks.unseen import laws as unseen_laws
from benchmarks.unseen import lives as unseen_lives
from benchmarks.unseen.lives import LifeOptions, UnseenLife, simulate_life
from models.machine.rig import Rig
from models.maps.plan import version_of
from models.work.choose import local_runner
from models.work.task import Work

CHUNK = 10
"""Lives in one file."""
_ARRAYS = tuple(one.name for one in fields(UnseenLife) if one.name not in ("law", "number", "crossing"))


def save_lives(lives: Sequence[UnseenLife], path: Path) -> None:
    """Write lives to a file of plain arrays."""
    path.parent.mkdir(parents=True, exist_ok=True)
    arrays: dict[str, Any] = {name: np.concatenate([getattr(life, name) for life in lives]) for name in _ARRAYS}
    for name in ("law", "number", "crossing"):
        arrays[name] = np.array([getattr(life, name) for life in lives])
    arrays["blocks"] = np.array([life.t.size for life in lives])
    # Written beside and moved: a run that is interrupted leaves no half file.
    beside = path.with_suffix(".part.npz")
    np.savez(beside, **arrays)
    beside.replace(path)


def load_lives(path: Path) -> list[UnseenLife]:
    """Return the lives of a file."""
    with np.load(path) as stored:
        arrays = {name: stored[name] for name in stored.files}
    parts = {name: np.split(arrays[name], np.cumsum(arrays["blocks"])[:-1]) for name in _ARRAYS}
    return [
        UnseenLife(
            law=str(arrays["law"][i]),
            number=int(arrays["number"][i]),
            crossing=float(arrays["crossing"][i]),
            **{name: parts[name][i] for name in _ARRAYS},
        )
        for i in range(arrays["law"].size)
    ]


def kept(name: str, make: Callable[[], Sequence[UnseenLife]]) -> list[UnseenLife]:
    """Return lives by the name of all that they depend on, made on first use.

    The code of the laws and lives, without its docstrings, and the version of the model are part of it.
    """
    digest = hashlib.sha256(f"{version_of(Rig.model)} {name}".encode())
    for module in (unseen_laws, unseen_lives):
        digest.update(_code_of(Path(str(module.__file__))).encode())
    path = Path(user_cache_dir("spallwatch")) / "lives" / f"unseen-{digest.hexdigest()[:20]}.npz"
    if not path.exists():
        save_lives(make(), path)
    return load_lives(path)


def _code_of(path: Path) -> str:
    """Return the code of a module without comments and docstrings."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list) and body and isinstance(body[0], ast.Expr):
            body[0] = ast.Pass()
    return ast.unparse(tree)


def _life(shared: tuple[str, int, LifeOptions | None], number: int) -> UnseenLife:
    law, first_seed, options = shared
    return simulate_life(law, number, first_seed, options)


_LIVES = Work("lives", _life, memory=256_000_000, threads=True)


def lives_of(
    law: str, count: int, first_seed: int, options: LifeOptions | None = None, workers: int = 1
) -> list[UnseenLife]:
    """Return the first lives of a law, simulated where they are not kept yet.

    Args:
        law: its name.
        count: how many.
        first_seed: of their range.
        options: of their group.
        workers: threads; 0 is one a core.
    """
    found: list[UnseenLife] = []
    for first in range(0, count, CHUNK):
        numbers = range(first, min(first + CHUNK, count))

        def make(numbers: range = numbers) -> list[UnseenLife]:
            with local_runner(workers) as runner:
                lives = runner.run(_LIVES, (law, first_seed, options), numbers)
                words = f"{law} from {numbers[0]}"
                return list(tqdm(lives, total=len(numbers), desc=words, file=sys.stderr, leave=False))

        found += kept(f"{law} {numbers} {first_seed} {options}", make)
    return found
