"""Tasks shared between threads or processes; results are in order and independent of the number of workers."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from functools import partial
from typing import TypeVar

_T = TypeVar("_T")
_R = TypeVar("_R")


def in_threads(function: Callable[[_T], _R], tasks: Sequence[_T], workers: int) -> Iterator[_R]:
    """Yield ``function`` of each task in order, from one or several threads, for kernels that release the GIL.

    ``workers`` is the number of threads; 0 is one per core.

    Raises:
        ValueError: if workers is negative.
    """
    return _in_order(ThreadPoolExecutor, function, tasks, workers)


def in_processes(function: Callable[[_T], _R], tasks: Sequence[_T], workers: int) -> Iterator[_R]:
    """Yield ``function``, picklable, of each task, from this process or several; otherwise as ``in_threads``."""
    processes = partial(ProcessPoolExecutor, mp_context=multiprocessing.get_context("spawn"))
    return _in_order(processes, function, tasks, workers)


def _in_order(
    executor: Callable[[int], Executor], function: Callable[[_T], _R], tasks: Sequence[_T], workers: int
) -> Iterator[_R]:
    count = (os.cpu_count() or 1) if workers == 0 else workers
    if count < 1:
        raise ValueError(f"workers must not be negative, got {workers!r}")
    if count == 1 or len(tasks) <= 1:
        yield from map(function, tasks)
        return
    with executor(min(count, len(tasks))) as pool:
        try:
            yield from pool.map(function, tasks)
        finally:
            pool.shutdown(cancel_futures=True)
