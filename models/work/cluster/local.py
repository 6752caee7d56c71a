"""A cluster of processes on this machine, for "local"."""

from __future__ import annotations

import logging
import os
from typing import Any

from models.work.cluster.connect import new_client


class Local:
    """A scheduler in this process and workers of one thread each, which share the memory of the machine.

    Threads of BLAS are one a worker (dask's own setting). The ports are open on loopback: other users of this
    machine could reach them.
    """

    address = "local"
    lasting = False

    def __init__(self, workers: int) -> None:
        """Start the workers; 0 is one per core."""
        import distributed
        from distributed.system import MEMORY_LIMIT

        self.workers = workers or os.cpu_count() or 1
        start: Any = distributed.LocalCluster
        self._cluster = start(
            n_workers=self.workers,
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            # None would be port 8787 of all interfaces.
            dashboard_address="127.0.0.1:0",
            worker_dashboard_address="127.0.0.1:0",
            memory_limit=MEMORY_LIMIT // self.workers,
            silence_logs=logging.CRITICAL,
            preload=["models.work.cluster.local_worker"],
        )

    def connect(self) -> Any:
        """Return a new client of the scheduler."""
        return new_client(self._cluster.scheduler_address, None)

    def close(self) -> None:
        """End the workers and the scheduler."""
        self._cluster.close()
