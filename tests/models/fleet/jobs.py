"""Functions of tasks for workers of a cluster."""

from __future__ import annotations

import dataclasses
import os
import socket
import time
from typing import Any


def repeated(shared: int, task: str) -> str:
    return shared * task


def dies_on(shared: int, task: int) -> int:
    if task == shared:
        os._exit(9)
    return task


def naps(shared: float, task: int) -> int:
    time.sleep(shared)
    return task


def grows(shared: int, task: int) -> int:
    """Take a gigabyte more each 0.05 s in the task that is ``shared``."""
    held = []
    while task == shared:
        held.append(b"x" * 100_000_000)
        time.sleep(0.02)
    return task + len(held)


def dask_scheduler(_shared: None, _task: int) -> str:
    """Return the module of what computes dask's collections here."""
    from dask.base import get_scheduler

    return str(getattr(get_scheduler(), "__module__", ""))


def listening() -> list[str]:
    """Return the addresses of all sockets of this process that listen."""
    found = []
    for number in range(1000):
        try:
            held = socket.socket(fileno=number)
        except OSError:  # no socket
            continue
        inet = held.family in (socket.AF_INET, socket.AF_INET6)
        if inet and held.getsockopt(socket.SOL_SOCKET, socket.SO_ACCEPTCONN):
            found.append(held.getsockname()[0])
        held.detach()
    return found


def periodic(dask_worker: Any) -> list[str]:
    """Return what a worker does again and again; dask gives the worker."""
    return list(dask_worker.periodic_callbacks)


class Unreadable(Exception):  # noqa: N818  # what is raised, not how it is called, matters
    """An exception that cannot be unpickled."""

    def __reduce__(self) -> tuple[Any, ...]:
        return _refuse, ()


def _refuse() -> None:
    raise RuntimeError("not unpickled")


def misbehave(how: str) -> None:
    """Let this worker answer chunks as one that means harm; "": as before."""
    from models.fleet import member
    from models.work import chunk
    from models.work.codec import encode
    from models.work.task import ChunkCall, ChunkOutcome

    def answer(call: ChunkCall, memory: int, worker: str) -> Any:
        outcome = ChunkOutcome(call.key, None, 0.0, 0, worker, "p")
        if how == "raises":
            raise Unreadable
        if how == "too few results":
            data = encode(chunk.StoredChunk(call.key, [], 0.0, worker, "p"))
            chunk.cached_store(call.store).write(chunk.chunk_name(call.key), data)
        return {
            "nothing": None,
            "another kind": {"key": call.key},
            "giant": b"x" * 20_000_000,
            "another chunk": dataclasses.replace(outcome, key="00"),
            "unreadable": Unreadable(),
        }.get(how, outcome)

    member.run_chunk = answer if how else chunk.run_chunk
