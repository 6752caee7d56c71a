"""A map, a library and an archive on a cluster whose processes are killed: equal to those of one process, bit for bit.

Each command runs three times: in one process, in two processes of this machine, and on a scheduler with three workers
of which one is killed for good, one more joins, the scheduler is killed and restarted, one runs out of memory, and at
last the command itself is killed and continued with ``--resume``. Run with ``python -m benchmarks.cluster_chaos``;
``benchmarks/results/cluster_chaos.json`` keeps what came of it.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from benchmarks.cluster_cases import Case, chosen_cases, chunk_files, command
from benchmarks.common import print_table, write_json
from tests.support.cluster_processes import ClusterProcesses, cluster_processes
from tests.support.cluster_tasks import exhaust
from tests.support.waiting import wait_until

WORKERS = ("w1", "w2", "w3")


@dataclass
class Events:
    """What happens to a run, each after a share of its chunks."""

    cluster: ClusterProcesses
    total: int
    done: Callable[[], int]
    log: list[dict[str, Any]] = field(default_factory=list[dict[str, Any]])
    begun: float = field(default_factory=time.monotonic)
    killed: bool = False

    def happen(self, process: subprocess.Popen[str]) -> None:
        """Cause all events in turn; the last one kills the command."""
        for share, name, cause in self._all(process):
            wait_until(lambda share=share: self.done() >= share * self.total or process.poll() is not None)
            if process.poll() is not None:
                return
            self.log.append({"event": name, "chunks_done": self.done(), "at_s": time.monotonic() - self.begun})
            cause()
        self.killed = True

    def _all(self, process: subprocess.Popen[str]) -> Iterator[tuple[float, str, Callable[[], object]]]:
        yield 0.10, "w1 killed for good", self.cluster.workers["w1"].stop
        yield 0.20, "w4 added", lambda: self.cluster.add_worker("w4")
        yield 0.35, "scheduler killed and restarted", self.cluster.restart_scheduler
        yield 0.55, "w2 out of memory", lambda: exhaust(self.cluster, "w2")
        yield 0.75, "the command killed", process.kill


def _start(arguments: list[str]) -> subprocess.Popen[str]:
    return subprocess.Popen(command(arguments), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def _answer(process: subprocess.Popen[str]) -> dict[str, Any]:
    output, errors = process.communicate()
    if process.returncode != 0:
        raise SystemExit(f"{process.args}: exit code {process.returncode}\n{errors}")
    return json.loads(output)


def undisturbed(case: Case, folder: Path, workers: int) -> dict[str, Any]:
    """Run a case on this machine; return its content hash, its number of chunks and the seconds it took."""
    out = folder / f"{case.name}-{workers}{case.suffix}"
    chunks = folder / f"{case.name}-{workers}-chunks"
    begun = time.monotonic()
    answer = _answer(_start(case.arguments(folder, out, "--workers", str(workers), "--chunks", str(chunks))))
    took = time.monotonic() - begun
    return {
        "hash": case.content(out),
        "chunks": answer["cluster"]["chunks"],
        "chunk_s": _count(chunks) and case.chunk_seconds(chunks),
        "seconds": took,
    }


def _count(chunks: Path) -> int:
    return len(chunk_files(chunks))


def disturbed(case: Case, folder: Path, total: int) -> dict[str, Any]:
    """Run a case on a cluster while its processes are killed."""
    out, chunks = folder / f"{case.name}-cluster{case.suffix}", folder / f"{case.name}-cluster-chunks"
    with cluster_processes(folder / f"{case.name}-logs", WORKERS, case.memory) as cluster:
        options = ("--cluster", cluster.address, "--workers", "2", "--chunks", str(chunks))
        begun = time.monotonic()
        process = _start(case.arguments(folder, out, *options))
        events = Events(cluster, total, lambda: _count(chunks))
        events.happen(process)
        if events.killed:
            process.communicate()
            process = _start(case.arguments(folder, out, *options, "--resume"))
        answer = _answer(process)["cluster"]
        starts = {"scheduler": cluster.scheduler.starts} | {n: w.starts for n, w in cluster.workers.items()}
        children = cluster.ends_for_memory()
    return {
        "hash": case.content(out),
        "seconds": time.monotonic() - begun,
        "chunks": answer["chunks"],
        "found_done_after_resume": answer["kept"],
        "failed": len(answer["failed"]),
        "starts": starts,
        "ended_for_memory": children,
        "events": events.log,
    }


def main() -> None:
    """Run all cases; exit code 1 where a result differs."""
    json_file, cases = chosen_cases(__doc__ or "")
    tables: dict[str, Any] = {}
    for case in cases:
        with tempfile.TemporaryDirectory(prefix="spallwatch-chaos-") as scratch:
            folder = Path(scratch)
            case.prepare(folder)
            alone, two = (undisturbed(case, folder, workers) for workers in (1, 2))
            found = disturbed(case, folder, two["chunks"])
        equal = alone["hash"] == two["hash"] == found["hash"]
        tables[case.name] = {"equal": equal, "one_process": alone, "two_processes": two, "cluster": found}
        print_table(
            f"{case.name}: {'equal' if equal else 'DIFFERENT'}",
            [
                {"run": name, "chunks": run["chunks"], "seconds": run["seconds"], "hash": run["hash"][:16]}
                for name, run in (("one process", alone), ("two processes", two), ("cluster", found))
            ],
        )
        print_table("events", found["events"])
        sys.stdout.flush()
        write_json(json_file, tables)
    if not all(table["equal"] for table in tables.values()):
        raise SystemExit(1)


if __name__ == "__main__":
    main()
