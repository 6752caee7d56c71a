"""A scheduler and workers of dask as processes on loopback, restarted when they end, and ways of killing them.

What a container runtime does with ``restart: always``: a process that ends, however, is started again until it is
stopped on purpose. Nothing here imports dask; the commands are those of ``deploy/cluster``.
"""

from __future__ import annotations

import gc
import os
import signal
import socket
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

from tests.support.waiting import wait_until

RESTART_S = 0.1
LOOPBACK = "127.0.0.1"


def free_port() -> int:
    """Return a port of loopback without a listener at this moment."""
    with socket.socket() as listener:
        listener.bind((LOOPBACK, 0))
        return int(listener.getsockname()[1])


class Supervised:
    """A process in a process group of its own, started again whenever it ends until ``stop``.

    Args:
        command: program and arguments.
        log: file that takes standard output and error of all its starts.
        environment: of the process, whole.
    """

    def __init__(self, command: list[str], log: Path, environment: Mapping[str, str]) -> None:
        self.command = command
        self.log = log
        self.starts = 0
        self._environment = dict(environment)
        self._lock = threading.Lock()
        self._stopping = False
        self._held = threading.Event()
        self._held.set()
        self._process = self._start()
        self._thread = threading.Thread(target=self._supervise, name=f"supervisor of {log.stem}", daemon=True)
        self._thread.start()

    @property
    def pid(self) -> int:
        """Identifier of the process that runs now or ran last."""
        return self._process.pid

    def kill(self) -> None:
        """Send SIGKILL to the process and its children; it is started again."""
        with self._lock:
            _kill_group(self._process)

    def hold(self) -> None:
        """Kill it and do not start it again until ``release``."""
        self._held.clear()
        self.kill()

    def release(self) -> None:
        """Let it be started again."""
        self._held.set()

    def stop(self) -> None:
        """Kill it for good."""
        with self._lock:
            self._stopping = True
            _kill_group(self._process)
        self._held.set()
        self._thread.join()

    def _start(self) -> subprocess.Popen[bytes]:
        with self.log.open("ab") as log:
            process = subprocess.Popen(
                self.command,
                env=self._environment,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )
        self.starts += 1
        return process

    def _supervise(self) -> None:
        while True:
            self._process.wait()
            _kill_group(self._process)
            time.sleep(RESTART_S)
            self._held.wait()
            with self._lock:
                if self._stopping:
                    return
                self._process = self._start()


def _kill_group(process: subprocess.Popen[bytes]) -> None:
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)


@dataclass
class ClusterProcesses:
    """A scheduler and its workers.

    Attributes:
        folder: logs and scratch folders of the workers.
        port: of the scheduler, the same after each restart.
        environment: of all processes, whole.
        memory: limit of each worker, as ``dask worker --memory-limit`` takes it.
        scheduler: process of the scheduler.
        workers: processes of the workers by name; each is a nanny with one child.
        protocol: "tcp" or "tls".
    """

    folder: Path
    port: int
    environment: Mapping[str, str]
    memory: str
    scheduler: Supervised
    workers: dict[str, Supervised] = field(default_factory=dict[str, Supervised])
    protocol: str = "tcp"

    @property
    def address(self) -> str:
        """Address of the scheduler."""
        return f"{self.protocol}://{LOOPBACK}:{self.port}"

    def ends_for_memory(self) -> int:
        """Return how often a nanny ended its worker for its memory."""
        return sum(self._log(name).count("exceeded 95% memory budget") for name in self.workers)

    def _log(self, name: str) -> str:
        return (self.folder / f"{name}.log").read_text()

    def add_worker(self, name: str, memory: str | None = None) -> Supervised:
        """Start a worker of one thread; it does not wait until the worker has joined."""
        scratch = self.folder / name
        scratch.mkdir()
        command = [
            *(sys.executable, "-m", "dask", "worker", self.address),
            *("--host", LOOPBACK, "--name", name, "--nthreads", "1", "--memory-limit", memory or self.memory),
            *("--no-dashboard", "--death-timeout", "60", "--local-directory", str(scratch)),
        ]
        self.workers[name] = Supervised(command, self.folder / f"{name}.log", self.environment)
        return self.workers[name]

    def kill_child(self, name: str) -> int:
        """Send SIGKILL to the child of a worker, as the kernel does that runs out of memory; return its pid."""
        child = computing_child(self.workers[name])
        os.kill(child, signal.SIGKILL)
        return child

    def restart_scheduler(self) -> None:
        """Kill the scheduler; wait until its successor listens."""
        starts = self.scheduler.starts
        self.scheduler.kill()
        wait_until(lambda: self.scheduler.starts > starts and _listens(self.port))

    def stop(self) -> None:
        """Kill all processes."""
        for worker in self.workers.values():
            worker.stop()
        self.scheduler.stop()

    def logs(self) -> str:
        """Return what all processes wrote, for a message of failure."""
        files = sorted(self.folder.glob("*.log"))
        return "\n".join(f"--- {file.stem}\n{file.read_text(errors='replace')}" for file in files)


def computing_child(worker: Supervised) -> int:
    """Return the number of the process in which a worker computes, the child of its nanny; wait for it."""
    wait_until(lambda: _children(worker.pid))
    return _children(worker.pid)[-1]


def _children(pid: int) -> list[int]:
    """Return the children of a process that compute (the resource tracker of multiprocessing is none)."""
    found: list[int] = []
    for children in Path(f"/proc/{pid}/task").glob("*/children"):
        with suppress(OSError):
            found += [int(child) for child in children.read_text().split() if _computes(int(child))]
    return sorted(found)


def _computes(pid: int) -> bool:
    with suppress(OSError):
        return b"resource_tracker" not in Path(f"/proc/{pid}/cmdline").read_bytes()
    return False


def _listens(port: int) -> bool:
    try:
        socket.create_connection((LOOPBACK, port), 1.0).close()
    except OSError:
        return False
    return True


def tls_variables(folder: Path) -> dict[str, str]:
    """Make certificates by the script of ``deploy/cluster``; return what names them in the environment."""
    script = Path(__file__).resolve().parents[2] / "deploy" / "cluster" / "certificates.sh"
    subprocess.run(["sh", str(script), str(folder), "2"], check=True)
    found = {"CA_FILE": folder / "ca.pem"}
    for role in ("scheduler", "worker", "client"):
        found |= {f"{role.upper()}__CERT": folder / f"{role}.pem", f"{role.upper()}__KEY": folder / f"{role}.key"}
    return {f"DASK_DISTRIBUTED__COMM__TLS__{name}": str(path) for name, path in found.items()}


@contextmanager
def cluster_processes(
    folder: Path,
    workers: tuple[str, ...] = ("w1",),
    memory: str = "2GiB",
    variables: Mapping[str, str] | None = None,
    protocol: str = "tcp",
) -> Iterator[ClusterProcesses]:
    """Start a scheduler and workers; they are killed with the block.

    Args:
        folder: for logs and scratch; it is made.
        workers: their names.
        memory: limit of each worker.
        variables: of the environment, beside those of this process.
        protocol: "tcp", or "tls" with ``tls_variables``.

    Yields:
        The processes. The scheduler listens; the workers may not have joined.
    """
    folder.mkdir(parents=True, exist_ok=True)
    repository = str(Path(__file__).resolve().parents[2])
    single = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    environment = {**os.environ, "PYTHONPATH": repository, "PYTHONUNBUFFERED": "1", **single, **(variables or {})}
    environment |= {"DASK_TEMPORARY_DIRECTORY": str(folder)}
    port = free_port()
    command = [
        *(sys.executable, "-m", "dask", "scheduler", "--host", LOOPBACK, "--port", str(port)),
        *("--protocol", protocol),
        *("--no-dashboard", "--dashboard-address", f"{LOOPBACK}:0"),
    ]
    cluster = ClusterProcesses(
        folder,
        port,
        environment,
        memory,
        Supervised(command, folder / "scheduler.log", environment),
        protocol=protocol,
    )
    try:
        for name in workers:
            cluster.add_worker(name)
        wait_until(lambda: _listens(port))
        yield cluster
    finally:
        cluster.stop()
        _collect_connections()


def _collect_connections() -> None:
    """Collect what a client of dask left behind, before it is reported in another test.

    ``Client._ensure_connected`` of distributed does not close the connection on which a handshake with a new scheduler
    fails, so that the garbage collector closes it, and warns.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ResourceWarning)
        gc.collect()
