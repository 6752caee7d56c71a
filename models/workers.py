"""Tasks shared between threads or processes; results are in order and independent of the number of workers."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from typing import TypeVar

_T = TypeVar("_T")
_R = TypeVar("_R")


def _worker_count(workers: int) -> int:
    workers = (os.cpu_count() or 1) if workers == 0 else workers
    if workers < 1:
        raise ValueError(f"workers must not be negative, got {workers!r}")
    return workers


def in_threads(function: Callable[[_T], _R], tasks: Sequence[_T], workers: int) -> Iterator[_R]:
    """Yield ``function`` of each task in order, from one or several threads, for kernels that release the GIL.

    ``workers`` is the number of threads; 0 is one per core.

    Raises:
        ValueError: if workers is negative.
    """
    workers = _worker_count(workers)
    if workers == 1 or len(tasks) <= 1:
        yield from map(function, tasks)
        return
    with ThreadPoolExecutor(min(workers, len(tasks))) as pool:
        try:
            yield from pool.map(function, tasks)
        finally:
            pool.shutdown(cancel_futures=True)


def in_processes(function: Callable[[_T], _R], tasks: Sequence[_T], workers: int) -> Iterator[_R]:
    """Yield ``function`` of each task in order, from this process or several; it must be picklable.

    ``workers`` is the number of processes; 0 is one per core.

    Raises:
        ValueError: if workers is negative.
    """
    workers = _worker_count(workers)
    if workers == 1 or len(tasks) <= 1:
        yield from map(function, tasks)
        return
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(workers, len(tasks)), mp_context=context) as pool:
        yield from pool.map(function, tasks)
