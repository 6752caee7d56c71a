"""Workers of a local cluster: the time until they take part, what TLS costs, and their memory beside their tasks.

``python -m benchmarks.cluster_workers``; ``benchmarks/results/cluster_workers.json`` keeps the figures. A worker offers
its limit less ``PROGRAM_BYTES`` for tasks, so its memory must stay below that and what tasks state, also where its
kernels are compiled anew.
"""

from __future__ import annotations

import os
import subprocess
import tempfile
import time
from pathlib import Path
from statistics import median
from typing import Any
from unittest.mock import patch

import distributed
import psutil

from benchmarks.cluster_cases import CASES, Case, command
from benchmarks.common import arguments, print_table, write_json
from models.fleet import open_executor
from models.fleet.member import PROGRAM_BYTES
from models.work.folder_store import FolderStore
from models.work.runner import Runner
from models.work.task import Work
from tests.support.cluster_tasks import bytes_of

_REPEATS = 3
_WORKERS = (1, 2, 4)
_SAMPLE_S = 0.2


def join_seconds(workers: int) -> float:
    """Return the time from nothing until so many workers of this machine take part, s."""
    with tempfile.TemporaryDirectory() as folder:
        begun = time.perf_counter()
        executor = open_executor("local", workers, FolderStore(folder), print)
        seconds = time.perf_counter() - begun
        executor.close()
    return seconds


def encryption(chunks: int, rounds: int) -> list[dict[str, Any]]:
    """Return the seconds until two workers take part, and the processor time of all processes per chunk of no work.

    With TLS and without, in turns; medians.
    """
    found: dict[str, list[tuple[float, float]]] = {"tls": [], "tcp": []}
    for _ in range(rounds):
        found["tls"].append(_start_and_chunk(chunks))
        with patch.object(distributed.Security, "temporary", lambda: None):
            found["tcp"].append(_start_and_chunk(chunks))
    return [
        {
            "protocol": protocol,
            "join_s": median(row[0] for row in rows),
            "processor_ms_per_chunk": 1e3 * median(row[1] for row in rows),
        }
        for protocol, rows in found.items()
    ]


def _start_and_chunk(chunks: int) -> tuple[float, float]:
    with tempfile.TemporaryDirectory() as folder:
        store = FolderStore(folder)
        begun = time.perf_counter()
        executor = open_executor("local", 2, store, print)
        joined = time.perf_counter() - begun
        with Runner(executor, store) as runner:
            work = Work("nothing", bytes_of, memory=10_000_000)
            # The first ones import.
            for _ in runner.run(work, 0, range(20)):
                pass
            before = _processor_seconds()
            for _ in runner.run(work, 0, range(20, 20 + chunks)):
                pass
            return joined, (_processor_seconds() - before) / chunks


def _processor_seconds() -> float:
    processes = [psutil.Process(), *psutil.Process().children(recursive=True)]
    return sum(times.user + times.system for times in (process.cpu_times() for process in processes))


def peak_bytes(case: Case, folder: Path, kernels: Path) -> int:
    """Return the greatest memory of the one worker that runs a case, as dask counts it.

    Args:
        case: the command.
        folder: for its files.
        kernels: folder of compiled kernels, of which the worker compiles what is missing.
    """
    case.prepare(folder)
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(kernels)}
    out = folder / f"out{case.suffix}"
    options = case.arguments(folder, out, "--cluster", "local", "--workers", "1")
    with subprocess.Popen(command(options), env=environment, stdout=subprocess.DEVNULL) as process:
        peak = 0
        while process.poll() is None:
            peak = max(peak, _worker_bytes(process.pid))
            time.sleep(_SAMPLE_S)
    if process.returncode:
        raise RuntimeError(f"{case.name}: exit code {process.returncode}")
    return peak


def _worker_bytes(pid: int) -> int:
    """Return the greatest memory so far of the worker of a command; 0 where there is none yet."""
    found = 0
    try:
        for child in psutil.Process(pid).children(recursive=True):
            if "--multiprocessing-fork" in child.cmdline():
                status = Path(f"/proc/{child.pid}/status").read_text()
                found = max(found, 1024 * int(status.partition("VmHWM:")[2].split()[0]))
    except (psutil.Error, OSError, IndexError):
        return 0
    return found


def main() -> None:
    """Print the tables and write the JSON."""
    options = arguments("Workers of a local cluster: time to join and memory beside the tasks.")
    joined = [
        {"workers": workers, "median_s": median(join_seconds(workers) for _ in range(_REPEATS))} for workers in _WORKERS
    ]
    print_table("time until workers take part", joined)
    encrypted = encryption(100 if options.quick else 300, 1 if options.quick else 3)
    print_table("with TLS and without", encrypted)
    peaks: list[dict[str, float | str]] = []
    with tempfile.TemporaryDirectory() as kernels:
        for case in CASES:
            for compiled in ("anew", "before"):
                with tempfile.TemporaryDirectory() as folder:
                    peak = 1e-6 * peak_bytes(case, Path(folder), Path(kernels))
                peaks.append({"case": case.name, "kernels_compiled": compiled, "peak_mb": peak})
                print(peaks[-1], flush=True)
    print_table(f"memory of a worker; {1e-6 * PROGRAM_BYTES:.0f} MB are set aside for the program", peaks)
    write_json(options.json, {"joined": joined, "encryption": encrypted, "peaks": peaks})


if __name__ == "__main__":
    main()
