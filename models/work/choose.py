"""Which executor and which store a run gets: the one place that chooses."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from models.words.errors import WrongInputError
from models.words.extras import load
from models.work.folder_store import open_store
from models.work.pool import PoolExecutor, SerialExecutor, worker_count
from models.work.runner import Runner
from models.work.task import Executor, FileStore, Progress


def open_runner(
    *,
    cluster: str | None = None,
    workers: int = 0,
    chunks: str | Path | None = None,
    resume: bool = False,
    notify: Callable[[Progress], None] | None = None,
    keep: bool = False,
    lasting: bool = True,
    tell: Callable[[str], None] | None = None,
) -> Runner:
    """Return a runner, to be used with ``with``.

    At a clean end what it put into the store is deleted, unless ``keep`` or chunks failed; after an exception it stays.

    Args:
        cluster: address of a dask scheduler, or "local"; None for threads and processes of this machine.
        workers: threads and processes; 0 is one per core. With an address, so many workers are waited for.
        chunks: folder or URL of the store, which all workers reach; None for one that ends with the runner.
        resume: whether chunks that are found in the store are used.
        notify: called whenever a chunk is done.
        keep: whether the chunks stay, because the user named their place.
        lasting: whether ``chunks`` is there after the run.
        tell: called with lines for people while they matter, such as that a scheduler was lost.

    Raises:
        WrongInputError: a cluster or ``resume`` without a store, or as the cluster refuses.
        ValueError: if workers is negative.
    """
    if chunks is None and (cluster is not None or resume):
        named = "resume" if resume else "cluster"
        raise WrongInputError(f"{named}: expected a folder or URL for chunks, which all workers reach")
    store = None if chunks is None else open_store(chunks)
    executor = _executor(cluster, workers, store, tell or _silent)
    return Runner(executor, store, resume, notify, keep=keep, lasting=lasting)


def local_runner(workers: int) -> Runner:
    """Return a runner of threads and processes of this machine, to be used with ``with``; 0 is one per core.

    Raises:
        ValueError: if workers is negative.
    """
    return open_runner(workers=workers)


def _executor(cluster: str | None, workers: int, store: FileStore | None, tell: Callable[[str], None]) -> Executor:
    if cluster is not None:
        return load("work", "cluster")(cluster, workers, store, tell)
    return SerialExecutor() if worker_count(workers) == 1 else PoolExecutor(workers)


def _silent(_text: str) -> None:
    """Take a line for people, and show it nowhere."""
