"""What the workers of a test run share: made by the first that needs it, read by the others."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import TypeVar

from models.portable import FileLock

T = TypeVar("T")

_folder: list[Path] = []


def share_in(folder: Path) -> None:
    """Keep what is made in this folder, which the other workers of the run use too."""
    _folder[:] = [folder]


def made_once(name: str, make: Callable[[], T]) -> T:
    """Return what ``make`` returns, of the first worker that asks for ``name``; it must be possible to pickle it."""
    if not _folder:
        return make()
    path = _folder[0] / f"{name}.pickle"
    with closing(FileLock(path.with_suffix(".lock"))) as lock:
        lock.wait()
        if path.exists():
            return pickle.loads(path.read_bytes())
        made = make()
        path.write_bytes(pickle.dumps(made))
    return made
