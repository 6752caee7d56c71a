"""Memory that a recording of an archive needs beside the program, for files of several sizes.

Run: python -m benchmarks.archive_memory [--quick] [--json FILE]

Each is replayed in a fresh process. Of large files the pages that are mapped count, which the system takes back when it
needs them.
"""

from __future__ import annotations

import multiprocessing
import resource
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.common import arguments, print_table, write_json
from models.work.runner import Runner
from models.work.serial import SerialExecutor
from monitor.fleet.index import Index
from monitor.fleet.run import Plan, replay_waiting
from tests.monitor.fleet.fleet_files import CONFIG


def replay_alone(folder: str) -> float:
    """Replay the recording in a folder; return the greatest resident memory of this process beyond that before, MB."""
    root = Path(folder)
    before = resident_mb()
    with Index(root / "out/index.db") as index, Runner(SerialExecutor()) as runner:
        replay_waiting(Plan(root / "manifest.toml", str(root / "out")), index, runner)
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3 - before


def resident_mb() -> float:
    """Return the resident memory of this process, MB."""
    lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    return int(next(line for line in lines if line.startswith("VmRSS")).split()[1]) / 1e3


def measure_memory(folder: Path, minutes: Sequence[float]) -> list[dict[str, Any]]:
    """Replay recordings of one file each in fresh processes, blocks of 5 s; say what they need."""
    rows: list[dict[str, Any]] = []
    for length in minutes:
        root = folder / f"{length:g}"
        (root / "in").mkdir(parents=True)
        (root / "m.toml").write_text(CONFIG.replace('block_s = "file"', "block_s = 5"))
        (root / "manifest.toml").write_text('[[machine]]\nname = "rig"\nconfig = "m.toml"\nrecordings = "in"\n')
        samples = np.random.default_rng(0).standard_normal((int(length * 60 * 25600), 2), dtype=np.float32)
        np.save(root / "in/20240301-000000.npy", samples)
        size = samples.nbytes / 1e6
        del samples
        with multiprocessing.get_context("spawn").Pool(1) as pool:
            rows.append({"file_mb": size, "memory_mb": pool.apply(replay_alone, (str(root),))})
    return rows


def main() -> None:
    """Measure and print a table."""
    options = arguments(__doc__ or "")
    with tempfile.TemporaryDirectory() as name:
        memory = measure_memory(Path(name), (0.1, 1.0) if options.quick else (0.1, 10.0, 20.0))
    print_table("memory of a replay", memory)
    write_json(options.json, {"memory": memory})


if __name__ == "__main__":
    main()
