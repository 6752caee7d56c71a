"""Every command that shares its work, on a scheduler and workers with TLS of which some are lost.

Each command (``benchmarks/work_cases.py``) runs in one process, and then once per loss on a cluster of three worker
processes: a worker at work is killed, one is frozen until the command has ended, one joins, the scheduler is killed and
started again. The loss comes when a worker has begun a chunk. Where workers write the output themselves, it is compared
again some seconds after a frozen one goes on, as that one ends what others have done. Counted as a problem: another
result than that of one process, another exit code than 0, chunks that are set aside, markers that are left. Run with
``python -m benchmarks.cluster_commands``; ``benchmarks/results/cluster_commands.json`` keeps what came of it.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from benchmarks.common import print_table, write_json
from benchmarks.work_cases import CASES, WorkCase
from tests.support.cluster_processes import ClusterProcesses, cluster_processes, computing_child, tls_variables

WORKERS = ("w1", "w2", "w3")
_POLL_S = 0.002
_AFTER_S = 5.0
_PROGRAM = """
import models.identify.evaluate
import models.work.task
models.work.task.CHUNK_SECONDS = 0.3
models.identify.evaluate._SENT_SECONDS = 0.0
from monitor.cli import main
main()
"""
"""Short chunks, and all steps of an identification sent, so that small cases have many. The caller alone cuts them."""


def worker_at_work(chunks: Path) -> str | None:
    """Return the name of a worker that has begun a chunk and not ended it, None where there is none."""
    for path in (chunks / "started").rglob("*"):
        with suppress(OSError, ValueError, KeyError):
            return str(json.loads(path.read_bytes())["worker"]).partition(" ")[0]
    return None


def kill(cluster: ClusterProcesses, name: str) -> None:
    """Kill the process of a worker that computes; its nanny starts another."""
    cluster.kill_child(name)


def freeze(cluster: ClusterProcesses, name: str) -> Callable[[], None]:
    """Stop the process of a worker; return what lets it go on."""
    child = computing_child(cluster.workers[name])
    os.kill(child, signal.SIGSTOP)

    def thaw() -> None:
        with suppress(ProcessLookupError):
            os.kill(child, signal.SIGCONT)

    return thaw


def join(cluster: ClusterProcesses, _name: str) -> Callable[[], None]:
    """Start one more worker; return what ends it."""
    name = f"more-{len(cluster.workers)}"
    return cluster.add_worker(name).stop


def restart(cluster: ClusterProcesses, _name: str) -> None:
    """Kill the scheduler; wait until its successor listens."""
    cluster.restart_scheduler()


LOSSES: dict[str, Callable[[ClusterProcesses, str], Callable[[], None] | None]] = {
    "a worker killed": kill,
    "a worker frozen": freeze,
    "a worker added": join,
    "the scheduler restarted": restart,
}


def start(case: WorkCase, folder: Path, inputs: Path, environment: dict[str, str], *options: str) -> Any:
    """Start a command whose output and chunks are in a new folder."""
    folder.mkdir()
    place = [] if case.suffix is None else ["--out", str(folder / f"result{case.suffix}")]
    shared = ["--chunks", str(folder / "chunks"), *options, "--json"]
    command = [sys.executable, "-c", _PROGRAM, *case.arguments(inputs), *place, *shared]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)


def ended(process: Any, case: WorkCase, folder: Path) -> dict[str, Any]:
    """Wait for the end of a command; return what came of it."""
    output, errors = process.communicate()
    said = errors.strip().replace(f"{folder.parent}/", "").splitlines()
    row: dict[str, Any] = {"exit_code": process.returncode, "said": said[-3:]}
    if process.returncode == 0:
        answer = row["answer"] = json.loads(output)
        row["digest"] = case.content(folder / f"result{case.suffix or ''}", answer)
        row["chunks"] = answer["cluster"]["chunks"]
        row["set_aside"] = len(answer["cluster"]["failed"])
    row["markers"] = sum(1 for path in (folder / "chunks" / "started").rglob("*") if path.is_file())
    return row


def lost(case: WorkCase, name: str, folder: Path, inputs: Path, cluster: ClusterProcesses) -> dict[str, Any]:
    """Run a command on the cluster, with a loss once a worker is at work."""
    options = ("--cluster", cluster.address, "--workers", "2")
    begun = time.monotonic()
    process = start(case, folder, inputs, dict(cluster.environment), *options)
    worker = None
    while worker is None and process.poll() is None:
        worker = worker_at_work(folder / "chunks")
        time.sleep(_POLL_S)
    undo = LOSSES[name](cluster, worker) if worker is not None else None
    row = ended(process, case, folder) | {"came": worker is not None, "seconds": time.monotonic() - begun}
    if undo is not None:
        undo()
        if case.suffix == "" and row["exit_code"] == 0:
            time.sleep(_AFTER_S)
            row["later"] = case.content(folder / "result", row["answer"])
    return row


def campaign(case: WorkCase, folder: Path, cluster: ClusterProcesses) -> Iterator[dict[str, Any]]:
    """Yield what came of each loss."""
    folder.mkdir()
    inputs = folder / "inputs"
    case.prepare(inputs)
    alone = ended(start(case, folder / "alone", inputs, dict(os.environ), "--workers", "1"), case, folder / "alone")
    for number, name in enumerate(LOSSES):
        row = lost(case, name, folder / f"run-{number}", inputs, cluster)
        equal = {row.pop("digest", None), row.pop("later", alone["digest"])} == {alone["digest"]}
        row.pop("answer", None)
        good = equal and row["exit_code"] == row["set_aside"] == row["markers"] == 0
        yield {"command": case.name, "loss": name, "equal": equal, "problem": not good} | row


def main() -> None:
    """Run all commands; exit code 1 where there is a problem."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the same figures to this file")
    parser.add_argument("--only", metavar="NAME", action="append", help="commands whose name begins so")
    options = parser.parse_args()
    cases = [case for case in CASES if not options.only or case.name.startswith(tuple(options.only))]
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory(prefix="spallwatch-commands-") as scratch:
        folder = Path(scratch)
        variables = tls_variables(folder / "tls")
        with cluster_processes(folder / "cluster", WORKERS, "1500MB", variables, "tls") as cluster:
            for number, case in enumerate(cases):
                for row in campaign(case, folder / f"case-{number}", cluster):
                    rows.append(row)
                    print(json.dumps(row), flush=True)
                    write_json(options.json, {"rows": rows})
    shown = ("command", "loss", "chunks", "equal", "set_aside", "came", "seconds")
    print_table("commands on a cluster", [{key: row.get(key, "") for key in shown} for row in rows])
    if any(row["problem"] for row in rows):
        raise SystemExit(1)


if __name__ == "__main__":
    main()
