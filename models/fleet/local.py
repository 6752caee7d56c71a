"""A cluster of processes on this machine, for "local"."""

from __future__ import annotations

import copy
import logging
import os
from typing import Any

from models.fleet.connect import new_client

_NO_PAGES: dict[str, Any] = {
    "distributed.scheduler.http.routes": [],
    "distributed.worker.http.routes": [],
    # What pages would show: samples of the stack, which take 1.5 % of each worker's time.
    "distributed.worker.profile.enabled": False,
}


class Local:
    """A scheduler in this process and workers of one thread each, which share the memory of the machine.

    Threads of BLAS are one a worker (dask's own setting). Other users of this machine reach loopback too, and dask
    runs what it is sent: the ports ask for a certificate of this run, whose key is in the memory of its processes
    alone, and those of web pages serve none.
    """

    address = "local"
    lasting = False

    def __init__(self, workers: int) -> None:
        """Start the workers; 0 is one per core."""
        import distributed
        from dask import config
        from distributed.system import MEMORY_LIMIT

        self.workers = workers or os.cpu_count() or 1
        settings: Any = config
        security: Any = distributed.Security
        start: Any = distributed.LocalCluster
        self._security = security.temporary()
        with config.set(_NO_PAGES):
            self._cluster = start(
                n_workers=self.workers,
                threads_per_worker=1,
                processes=True,
                host="127.0.0.1",
                security=self._security,
                # None would be port 8787 of all interfaces; of workers it is any port of loopback.
                dashboard_address="127.0.0.1:0",
                scheduler_kwargs={"dashboard": False},
                memory_limit=MEMORY_LIMIT // self.workers,
                # A nanny refers to the settings of the process: a worker started again would have those of then.
                config=copy.deepcopy(settings.config),
                silence_logs=logging.CRITICAL,
                preload=["models.fleet.local_worker"],
            )

    def connect(self) -> Any:
        """Return a new client of the scheduler."""
        return new_client(self._cluster.scheduler_address, self._security)

    def close(self) -> None:
        """End the workers and the scheduler."""
        self._cluster.close()
