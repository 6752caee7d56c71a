"""What runs in a worker of a cluster: the test by which it joins a run, and chunks."""

from __future__ import annotations

import importlib.metadata
import signal
import threading
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from models.words.errors import SpallwatchError
from models.work.chunk import cached_store, run_chunk
from models.work.program import program, versions
from models.work.redact import redact
from models.work.task import ChunkCall, ChunkOutcome

_TRANSPORT = ("dask", "distributed", "cloudpickle", "msgpack")
"""Distributions whose versions both ends of a connection must share."""
_FILES = ("netcdf4", "xarray", "zarr")
"""Distributions that write results: their files are compared with those of one process."""
_SHOWN_DIGITS = 12


def facts() -> dict[str, str]:
    """Return what must be equal in all processes of a run: versions, and the digest of the program."""
    found = dict(versions())
    for name in (*_TRANSPORT, *_FILES):
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            found[name] = "missing"
    return found | {"program": program()}


def differences(theirs: Mapping[str, str], mine: Mapping[str, str]) -> str:
    """Return how the facts of another process differ from those of this one, for people; "" where they do not."""
    different = [name for name in (*mine, *sorted(set(theirs).difference(mine))) if theirs.get(name) != mine.get(name)]
    # The digest depends on the versions: alone it means other files.
    if len(different) > 1 and "program" in different:
        different.remove("program")
    return "; ".join(f"{_called(name)} {_value(theirs, name)}, expected {_value(mine, name)}" for name in different)


def _called(name: str) -> str:
    return "spallwatch of other files, digest" if name == "program" else name


def _value(facts: Mapping[str, str], name: str) -> str:
    value = facts.get(name, "unknown")
    return value[:_SHOWN_DIGITS] if name == "program" else value


PROGRAM_BYTES = 250_000_000
"""Memory of a worker beside its tasks (docs/evidence/cluster.md), once its kernels are compiled."""


@dataclass(frozen=True)
class Membership:
    """Answer of a worker that was asked to join.

    Attributes:
        name: of the worker, for people.
        threads: chunks that it runs side by side.
        memory: bytes for their tasks together.
        problem: why it cannot join; "" where it has.
    """

    name: str
    threads: int = 0
    memory: int = 0
    problem: str = ""


def join(url: str, token: str, expected: Mapping[str, str], resource: str) -> Membership:
    """Compare this worker with the caller, read and write a token in the store, and offer memory for chunks.

    The scheduler gives chunks only to workers that offer this resource, so none to a worker that was refused or that
    came later and was not asked yet. It sees to it that chunks at work never need more than is offered.

    Args:
        url: of the store.
        token: name of a file in it, which holds its own name.
        expected: facts of the caller.
        resource: name of the resource.
    """
    import distributed
    from distributed.utils import sync

    worker: Any = distributed.get_worker()
    name = f"{worker.name} at {worker.address}"
    problem = differences(facts(), expected) or _store_problem(url, token, str(worker.address))
    if problem:
        return Membership(name, problem=problem)
    memory = offered_memory(worker.memory_manager.memory_limit, worker.memory_manager.memory_pause_fraction)
    if resource not in worker.state.total_resources:
        sync(worker.loop, worker.set_resources, **{resource: float(memory), turn_name(resource): 1.0})
    return Membership(name, worker.state.nthreads, memory)


def turn_name(resource: str) -> str:
    """Return the name of the resource of which a worker has one, whatever its threads.

    Chunks that need a process take it: netCDF is not safe in two threads of a process.
    """
    return f"{resource}-process"


def offered_memory(limit: int | None, pause: float | bool | None) -> int:
    """Return the bytes for tasks of a worker, so that it neither pauses nor is ended while they keep to their memory.

    Args:
        limit: of the worker; None or 0 where it has none: that of the machine.
        pause: share of the limit at which it takes no further task, False where it does not pause.
    """
    from distributed.system import MEMORY_LIMIT

    usable = (limit or MEMORY_LIMIT) * (float(pause) if pause else 1.0)
    return max(int(usable) - PROGRAM_BYTES, 0)


def run(call: ChunkCall, resource: str) -> ChunkOutcome:
    """Run a chunk with the memory that this worker offers under the name of a resource."""
    import distributed

    worker: Any = distributed.get_worker()
    memory = int(worker.state.total_resources.get(resource, 0))
    with _without_cluster():
        return run_chunk(call, memory=memory, worker=f"{worker.name} at {worker.address}")


_at_work: list[Any] = []
_lock = threading.Lock()


@contextmanager
def _without_cluster() -> Generator[None]:
    """Keep dask, and xarray by it, from using the scheduler within a chunk.

    xarray would ask it for a lock of each file, which fails in a worker that has lost its scheduler and ends its chunk.
    The setting is one for all threads of the process.
    """
    from dask import config

    with _lock:
        if not _at_work:
            setting: Any = config.set
            _at_work.append(setting(scheduler="synchronous"))
        _at_work.append(None)
    try:
        yield
    finally:
        with _lock:
            _at_work.pop()
            if len(_at_work) == 1:
                _at_work.pop().__exit__(None, None, None)


def _store_problem(url: str, token: str, address: str) -> str:
    """Return why this worker does not reach the store of the caller, "" where it does."""
    try:
        store = cached_store(url)
        found = store.read(token)
        if found is None:
            return f"cannot read {redact(url)}: it is another folder here; all workers must reach the same"
        store.write(answer_name(token, address), found)
    except (SpallwatchError, OSError) as error:
        return f"cannot use {redact(url)}: {redact(str(error))}"
    return ""


def answer_name(token: str, address: str) -> str:
    """Return the name of the file in which a worker answers a token."""
    return f"{token}-{''.join(letter if letter.isalnum() else '_' for letter in address)}"


def dask_setup(_worker: object) -> None:
    """Ignore Ctrl-C: it reaches all processes of a terminal, and the command ends its workers."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
