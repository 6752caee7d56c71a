"""A dask scheduler on this node, and workers as jobs of Slurm, for ``spallwatch ... --cluster tls://NODE:8786``.

Run it in a terminal multiplexer or as a job of its own, in an environment with ``spallwatch[cluster]`` and
``dask-jobqueue`` that all nodes see under the same path:

    DASK_CONFIG=jobqueue.yaml python slurm.py --jobs 20
    DASK_CONFIG=jobqueue.yaml python slurm.py --print          the job script only

It prints the address; give the command the same DASK_CONFIG. Jobs that end, as at the end of their time, are replaced.
Where this program ends, the jobs end too; started again on the same node, the command that waits goes on.
"""

from __future__ import annotations

import argparse
import signal
import threading
from typing import Any

import dask.config
from dask_jobqueue.slurm import SLURMCluster
from distributed import Security

_TLS = "distributed.comm.tls"


def security() -> Security:
    """Return the certificates that dask's configuration names.

    Raises:
        ValueError: one is not named, or encryption is not required.
    """
    if not dask.config.get("distributed.comm.require-encryption", False):
        raise ValueError("distributed.comm.require-encryption: expected true")
    names = ["ca-file", *(f"{role}.{part}" for role in ("scheduler", "worker", "client") for part in ("cert", "key"))]
    if missing := [name for name in names if not dask.config.get(f"{_TLS}.{name}", None)]:
        raise ValueError(f"{_TLS}: expected {', '.join(missing)}")
    return Security(require_encryption=True)


def start(**options: Any) -> Any:
    """Start the scheduler and return its ``SLURMCluster``; ``options`` take the place of those of the configuration."""
    return SLURMCluster(security=security(), protocol="tls://", **options)


def main() -> None:
    """Start it, and wait for a signal."""
    parser = argparse.ArgumentParser(description="A dask scheduler here, and workers as jobs of Slurm.")
    parser.add_argument("--jobs", type=int, default=1, help="jobs at a time [1]")
    parser.add_argument("--print", action="store_true", help="print the job script and end")
    arguments = parser.parse_args()
    with start() as cluster:
        if arguments.print:
            print(cluster.job_script())
            return
        # Unlike a fixed number, this replaces jobs that have ended.
        cluster.adapt(minimum_jobs=arguments.jobs, maximum_jobs=arguments.jobs)
        print(cluster.scheduler_address, flush=True)
        ended = threading.Event()
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: ended.set())
        ended.wait()


if __name__ == "__main__":
    main()
