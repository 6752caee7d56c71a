"""Functions of tasks for workers of a cluster."""

from __future__ import annotations

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
