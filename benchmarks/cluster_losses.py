"""What dask itself does when a scheduler, a worker or a worker's memory is lost: seconds and what the client sees.

A scheduler and two workers on loopback, each started again when it ends. Run with ``python -m
benchmarks.cluster_losses``; ``benchmarks/results/cluster_losses.json`` keeps the figures.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from distributed import Client

from benchmarks.common import print_table, write_json
from tests.support.cluster_processes import ClusterProcesses, cluster_processes

_WORKERS = ("w1", "w2")
_MEMORY = "1GiB"
_SHORT_S, _LONG_S = 3.0, 90.0
_GROWTH_BYTES = 50_000_000
_AT_ONCE_BYTES = 4_800_000_000


def nap(seconds: float) -> int:
    """Sleep; return the number of the process."""
    time.sleep(seconds)
    return os.getpid()


def grow(number: int, size: int) -> int:
    """Take ``number`` arrays of a size in bytes, one every 20 ms."""
    taken: list[Any] = []
    for _ in range(number):
        taken.append(np.ones(size // 8))
        time.sleep(0.02)
    return len(taken)


def _joined(client: Client) -> int:
    return len(client.scheduler_info()["workers"]) if client.status == "running" else 0


def _until(condition: Callable[[], object]) -> float:
    begun = time.monotonic()
    while not condition():
        time.sleep(0.02)
    return time.monotonic() - begun


def _ended(future: Any) -> str:
    error = future.exception()
    return future.status if error is None else type(error).__name__


def scheduler_lost(cluster: ClusterProcesses, client: Client, task_s: float) -> dict[str, Any]:
    """Kill the scheduler while each worker has a task of so many seconds."""
    futures = [client.submit(nap, task_s, pure=False) for _ in _WORKERS]
    time.sleep(1.0)
    before = {name: worker.starts for name, worker in cluster.workers.items()}
    begun = time.monotonic()
    cluster.restart_scheduler()
    back = time.monotonic() - begun
    cancelled = _until(lambda: all(future.status == "cancelled" for future in futures))
    connected = back + cancelled + _until(lambda: client.status == "running")
    _until(lambda: _joined(client) == len(_WORKERS))
    return {
        "event": f"scheduler killed, tasks of {task_s:g} s",
        "task_sees": futures[0].status,
        "scheduler_back_s": back,
        "client_back_s": connected,
        "workers_back_s": time.monotonic() - begun,
        "worker_processes_ended": sum(worker.starts > before[name] for name, worker in cluster.workers.items()),
    }


def worker_lost(cluster: ClusterProcesses, client: Client, child: bool) -> dict[str, Any]:
    """Kill a worker, or its child alone, while each worker has a task."""
    futures = [client.submit(nap, _SHORT_S, pure=False) for _ in _WORKERS]
    time.sleep(1.0)
    begun = time.monotonic()
    if child:
        cluster.kill_child("w1")
    else:
        cluster.workers["w1"].kill()
    _until(lambda: _joined(client) < len(_WORKERS))
    _until(lambda: _joined(client) == len(_WORKERS))
    back = time.monotonic() - begun
    return {
        "event": "child of a worker killed" if child else "worker killed",
        "task_sees": ", ".join({_ended(future) for future in futures}),
        "workers_back_s": back,
    }


def memory_lost(cluster: ClusterProcesses, client: Client, number: int, size: int) -> dict[str, Any]:
    """Run a task that takes more memory than a worker may have."""
    begun = time.monotonic()
    seen = _ended(client.submit(grow, number, size, pure=False))
    took = time.monotonic() - begun
    attempts = cluster.ends_for_memory()
    _until(lambda: _joined(client) == len(_WORKERS))
    return {
        "event": f"{number} x {size / 1e6:g} MB within {_MEMORY}",
        "task_sees": seen,
        "ended_after_s": took,
        "workers_killed": attempts,
    }


def main() -> None:
    """Print the table and write the JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the same figures to this file")
    options = parser.parse_args()
    cases: list[Callable[[ClusterProcesses, Client], dict[str, Any]]] = [
        lambda cluster, client: scheduler_lost(cluster, client, _SHORT_S),
        lambda cluster, client: scheduler_lost(cluster, client, _LONG_S),
        lambda cluster, client: worker_lost(cluster, client, child=False),
        lambda cluster, client: worker_lost(cluster, client, child=True),
        lambda cluster, client: memory_lost(cluster, client, 200, _GROWTH_BYTES),
        lambda cluster, client: memory_lost(cluster, client, 1, _AT_ONCE_BYTES),
    ]
    rows: list[dict[str, Any]] = []
    for case in cases:
        with (
            tempfile.TemporaryDirectory() as folder,
            cluster_processes(Path(folder), _WORKERS, _MEMORY) as cluster,
            Client(cluster.address, timeout=30, set_as_default=False) as client,
        ):
            client.wait_for_workers(len(_WORKERS))
            rows.append(case(cluster, client))
    for event in dict.fromkeys(tuple(row) for row in rows):
        print_table("what dask does", [row for row in rows if tuple(row) == event])
    if options.json is not None:
        write_json(options.json, {"rows": rows})


if __name__ == "__main__":
    main()
