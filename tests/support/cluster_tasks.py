"""Tasks for workers of a cluster: rows that take a while, one that kills its process, and one that eats memory."""

from __future__ import annotations

import os
import signal
import time
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from tests.support.cluster_processes import ClusterProcesses
from tests.support.waiting import wait_until

ROW_S = 0.1
LETHAL = -1
"""The task that kills its process."""


def row(shared: NDArray[np.float64], task: int) -> NDArray[np.float64]:
    """Return the largest values of a random walk that begins at ``shared``, shape (8,); it takes ``ROW_S``."""
    if task == LETHAL:
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(ROW_S)
    walk = np.cumsum(np.random.default_rng(task).standard_normal((8, 5000)), axis=1)
    return np.max(shared[:, None] + walk, axis=1)


def bytes_of(size: int, _task: int) -> bytes:
    """Return so many bytes."""
    return bytes(size)


def sleep(seconds: float, task: int) -> int:
    """Wait, without using a processor."""
    time.sleep(seconds)
    return task


def take_memory(limit: int) -> int:
    """Take memory, 100 MB every 20 ms, up to twice the limit: the nanny ends the process before."""
    size = 100_000_000
    taken: list[bytes] = []
    for _ in range(2 * limit // size):
        taken.append(b"\1" * size)
        time.sleep(0.02)
    return len(taken)


def exhaust(cluster: ClusterProcesses, name: str) -> None:
    """Let a worker run out of memory while it works, as another user of the cluster would."""
    from distributed import Client
    from distributed.comm.core import CommClosedError

    with Client(cluster.address, timeout=30, set_as_default=False) as client:

        def named() -> list[tuple[str, int]]:
            workers = client.scheduler_info(n_workers=-1)["workers"]
            return [(at, its["memory_limit"]) for at, its in workers.items() if its["name"] == name]

        # It may be on its way back from a lost scheduler.
        wait_until(named)
        address, limit = named()[0]
        with suppress(CommClosedError, OSError):
            client.run(take_memory, limit, workers=[address])
