"""What a cluster costs per chunk, how two workers compare with one, and what follows for a hundred.

Seconds of processor time of caller, scheduler and workers per chunk are measured with tasks that do nothing. They go
into a simulation of a hundred workers (``benchmarks.cluster_model``), which is compared with many workers that sleep.
Run with ``python -m benchmarks.cluster_scaling``; ``benchmarks/results/cluster_scaling.json`` keeps the figures.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

from benchmarks.cluster_cases import CASES, Case, chunk_files, command
from benchmarks.cluster_model import Costs, simulated_share, smallest_chunk
from benchmarks.common import arguments, print_table, write_json
from models.fleet.roster import Roster
from models.work.choose import open_runner
from models.work.codec import decode
from models.work.task import CHUNK_SECONDS, Work
from tests.support.cluster_processes import ClusterProcesses, cluster_processes, computing_child
from tests.support.cluster_tasks import bytes_of, sleep
from tests.support.waiting import wait_until

WORKERS = 100
MAX_LOST = 0.05
"""Share of the time that a hundred workers may lose to anything but their tasks."""
_SHARES = ("caller", "scheduler", "workers")
_RESULT_BYTES = (0, 100_000, 1_000_000)
_SLEEPERS = 16
_SLEEPS_S = (1.0, 5.0)


def used(pid: int) -> float:
    """Return the seconds of a processor that the threads of a process used so far (Linux: schedstat)."""
    paths = Path(f"/proc/{pid}/task").glob("*/schedstat")
    return sum(1e-9 * int(path.read_text().split()[0]) for path in paths)


def _used(cluster: ClusterProcesses) -> dict[str, float]:
    workers = [used(computing_child(worker)) for worker in cluster.workers.values()]
    return {
        "caller": used(os.getpid()),
        "scheduler": used(cluster.scheduler.pid),
        "workers": sum(workers),
    }


@contextmanager
def _more_addresses(count: int) -> Iterator[None]:
    """Send each chunk with so many addresses, of which those beyond the members are of no worker."""
    members = Roster.addresses

    def addresses(roster: Roster) -> list[str]:
        found = members(roster)
        return found + [f"tcp://127.0.0.1:{port}" for port in range(1, 1 + count - len(found))]

    with patch.object(Roster, "addresses", addresses):
        yield


def address_costs(chunks: int, rounds: int) -> list[dict[str, Any]]:
    """Return the milliseconds of processor time per chunk, by the number of workers that it may go to."""
    found: dict[int, list[dict[str, float]]] = {2: [], WORKERS: []}
    for _ in range(rounds):
        for count, rows in found.items():
            with _more_addresses(count):
                rows += chunk_costs(chunks, (0,))
    return [
        {"addresses": count} | {f"{name}_ms": statistics.median(row[f"{name}_ms"] for row in rows) for name in _SHARES}
        for count, rows in found.items()
    ]


def chunk_costs(chunks: int, sizes: tuple[int, ...] = _RESULT_BYTES) -> list[dict[str, Any]]:
    """Return the milliseconds of processor time per chunk, by the size of its result."""
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as scratch, cluster_processes(Path(scratch, "c"), ("w1", "w2")) as cluster:
        for size in sizes:
            work = Work("nothing", bytes_of, memory=10_000_000)
            with open_runner(cluster=cluster.address, workers=2, chunks=Path(scratch, f"chunks-{size}")) as runner:
                count = chunks if size < 1_000_000 else chunks // 4
                # The first ones import and compile.
                for _ in runner.run(work, size, range(20)):
                    pass
                before, begun = _used(cluster), time.monotonic()
                for _ in runner.run(work, size, range(20, 20 + count)):
                    pass
                took = time.monotonic() - begun
                after = _used(cluster)
            each = {name: 1e3 * (after[name] - before[name]) / count for name in after}
            rows.append(
                {"result_bytes": size, "chunks": count}
                | {f"{name}_ms": value for name, value in each.items()}
                | {"wall_ms": 1e3 * took / count}
            )
    return rows


def needed_chunks(costs: Mapping[int, Costs]) -> list[dict[str, Any]]:
    """Return on paper how much work a chunk needs, and what is lost with that of the program."""
    return [
        {
            "workers": workers,
            "result_bytes": size,
            "min_chunk_s": smallest_chunk(cost, workers, MAX_LOST),
            "lost_at_chunk_seconds": simulated_share(cost, workers, CHUNK_SECONDS, 20 * workers),
        }
        for size, cost in costs.items()
        for workers in (10, WORKERS)
    ]


def sleepers(costs: Costs) -> list[dict[str, Any]]:
    """Return the share of time lost by many workers that sleep, measured and simulated."""
    rows: list[dict[str, Any]] = []
    names = tuple(f"w{number}" for number in range(_SLEEPERS))
    with tempfile.TemporaryDirectory() as scratch, cluster_processes(Path(scratch, "c"), names) as cluster:
        for seconds in _SLEEPS_S:
            work = Work("sleep", sleep, memory=1_000_000)
            chunks = Path(scratch, f"chunks-{seconds}")
            with open_runner(cluster=cluster.address, workers=_SLEEPERS, chunks=chunks) as runner:
                count = 8 * _SLEEPERS
                for _ in runner.run(work, seconds, range(2 * _SLEEPERS)):
                    pass
                begun = time.monotonic()
                for _ in runner.run(work, seconds, range(1000, 1000 + count)):
                    pass
                took = time.monotonic() - begun
            rows.append(
                {
                    "workers": _SLEEPERS,
                    "chunk_s": seconds,
                    "chunks": count,
                    "lost": 1.0 - seconds * count / _SLEEPERS / took,
                    "lost_simulated": simulated_share(costs, _SLEEPERS, seconds, count),
                }
            )
    return rows


def _run(case: Case, folder: Path, cluster: ClusterProcesses, number: int) -> dict[str, float]:
    """Run a case on a cluster; return its seconds and how its workers spent them."""
    out = folder / f"{case.name}-{number}-{len(cluster.workers)}{case.suffix}"
    chunks = folder / f"{out.name}-chunks"
    options = ("--cluster", cluster.address, "--workers", str(len(cluster.workers)), "--chunks", str(chunks))
    children = [computing_child(worker) for worker in cluster.workers.values()]
    process = subprocess.Popen(
        command(case.arguments(folder, out, *options)), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    )
    # From when each worker has done a chunk to the last chunk: without starts, and what the command does alone.
    wait_until(lambda: len(_workers_of(chunks)) == len(children) or process.poll() is not None)
    begun, before = time.monotonic(), [used(child) for child in children]
    last, after = begun, before
    first = done = len(chunk_files(chunks))
    while process.poll() is None:
        found = len(chunk_files(chunks))
        if found != done:
            last, done, after = time.monotonic(), found, [used(child) for child in children]
        time.sleep(0.05)
    if process.returncode != 0:
        raise SystemExit(process.stderr.read().decode() if process.stderr else "")
    spent = [late - early for early, late in zip(before, after, strict=True)]
    wall = last - begun
    busy = sum(spent)
    return {
        "seconds": wall,
        "busy_s": busy,
        "chunks": done - first,
        "chunk_s": case.chunk_seconds(chunks),
    }


def _workers_of(chunks: Path) -> set[str]:
    return {decode(path.read_bytes()).worker for path in chunk_files(chunks)}


def scaling(rounds: int) -> Iterator[list[dict[str, Any]]]:
    """Yield after each pair of runs how two workers compare with one, in turns on the same machine."""
    pairs: dict[str, list[list[dict[str, float]]]] = {case.name: [] for case in CASES}
    with (
        tempfile.TemporaryDirectory() as scratch,
        cluster_processes(Path(scratch, "one"), ("w1",)) as one,
        cluster_processes(Path(scratch, "two"), ("w1", "w2")) as two,
    ):
        for case in CASES:
            case.prepare(Path(scratch))
        for number in range(rounds):
            for case in CASES:
                pairs[case.name].append([_run(case, Path(scratch), each, number) for each in (one, two)])
                yield [_compared(name, found) for name, found in pairs.items() if found]


def _compared(name: str, pairs: list[list[dict[str, float]]]) -> dict[str, Any]:
    """Return the medians over rounds; seconds are per chunk, since the runs begin to count at different ones."""

    def median(of: Callable[[dict[str, float], dict[str, float]], float]) -> float:
        return statistics.median(of(one, two) for one, two in pairs)

    return {
        "case": name,
        "rounds": len(pairs),
        "chunks": pairs[0][0]["chunks"],
        "chunk_s": median(lambda one, _: one["chunk_s"]),
        "wall_per_chunk_1": median(lambda one, _: one["seconds"] / one["chunks"]),
        "wall_per_chunk_2": median(lambda _, two: two["seconds"] / two["chunks"]),
        "processor_per_chunk_1": median(lambda one, _: one["busy_s"] / one["chunks"]),
        "processor_per_chunk_2": median(lambda _, two: two["busy_s"] / two["chunks"]),
        "ratio": median(lambda one, two: one["seconds"] / one["chunks"] / two["seconds"] * two["chunks"]),
    }


def main() -> None:
    """Print the tables and write the JSON."""
    options = arguments(__doc__ or "")
    costs_rows = chunk_costs(100 if options.quick else 400)
    print_table("processor time per chunk, ms", costs_rows)
    addressed = address_costs(100 if options.quick else 400, 1 if options.quick else 3)
    print_table("processor time per chunk by the workers that it may go to, ms", addressed)
    costs = {row["result_bytes"]: Costs(*(1e-3 * row[f"{name}_ms"] for name in _SHARES)) for row in costs_rows}
    needed = needed_chunks(costs)
    print_table(f"chunks of which at most {100 * MAX_LOST:g} % of the time is lost", needed)
    tables: dict[str, Any] = {"costs": costs_rows, "addresses": addressed, "needed": needed}
    write_json(options.json, tables)
    for scaled in scaling(1 if options.quick else 3):
        print_table("two workers and one", scaled)
        sys.stdout.flush()
        tables["scaling"] = scaled
        write_json(options.json, tables)
    sleeping = sleepers(costs[0])
    print_table("workers that sleep", sleeping)
    write_json(options.json, tables | {"sleepers": sleeping})


if __name__ == "__main__":
    main()
