"""What the workers of a test run share: made by the first that needs it, read by the others."""

from __future__ import annotations

import functools
import hashlib
import os
import pickle
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import ParamSpec, TypeVar, cast

import pytest

from models.platform.portable import FileLock

P = ParamSpec("P")
T = TypeVar("T")

_folder: list[Path] = []


@pytest.fixture(autouse=True, scope="session")
def folder_of_the_run(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Let the workers of a run share results that take seconds."""
    if "PYTEST_XDIST_WORKER" in os.environ:
        _folder[:] = [tmp_path_factory.getbasetemp().parent]


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


def shared_by_workers(make: Callable[P, T]) -> Callable[P, T]:
    """Let a function of hashable arguments run once for all workers of a run; what it returns must not be changed.

    Results are kept under the function's name and the text (repr) of its arguments, which must tell them apart.
    """

    def made(*args: P.args, **options: P.kwargs) -> T:
        digest = hashlib.sha256(repr((args, sorted(options.items()))).encode()).hexdigest()[:16]
        return made_once(f"{make.__module__}.{make.__qualname__}-{digest}", lambda: make(*args, **options))

    return cast("Callable[P, T]", functools.cache(functools.wraps(make)(made)))
