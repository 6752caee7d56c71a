"""Archives: a history in parts against one replay, and an index of ten million recordings.

Run: python -m benchmarks.archive [--quick] [--json FILE]

The history is Bearing2_4 of FEMTO (SPALLWATCH_DATA), its 751 blocks taken as one an hour, so that they fill a month.
"""

from __future__ import annotations

import csv
import datetime
import os
import tempfile
import time
import tracemalloc
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.common import arguments, print_table, write_json
from models.work.runner import Runner
from models.work.serial import SerialExecutor
from models.work.stores import open_store
from monitor.config.load import load_config
from monitor.fleet.index import Index, Outcome
from monitor.fleet.part import described
from monitor.fleet.plan import Planner
from monitor.fleet.result import RecordingResult
from monitor.fleet.run import Plan, replay_waiting
from monitor.service.replay import replay
from monitor.service.setup import open_configured
from streams.block import Block
from tests.support.recordings import EXAMPLES, RUNS

RECORDINGS = 10_000_000
PLANNED = 200_000
NOTED = 200_000
PARTS = (50, 200, 5000)
BEGIN = datetime.datetime(2024, 3, 1, tzinfo=datetime.UTC)

CONFIG = """
[machine]
name = "rig"
[[bearing]]
name = "test"
designation = "PRONOSTIA"
[operating]
speed_hz = 27.5
load_newton = 4200
[[source]]
name = "s"
rate_hz = 25600
block_s = "file"
time_from = "name"
time_name = "%Y%m%d-%H%M%S"
[[channel]]
name = "h"
source = "s"
column = 1
unit = "g"
bearing = "test"
average_blocks = 16
[[channel]]
name = "v"
source = "s"
column = 2
unit = "g"
bearing = "test"
average_blocks = 16
[detect]
learn_blocks = 100
run_in_blocks = 30
[forecast]
method = "learned"
"""


def write_history(folder: Path, count: int) -> None:
    """Write the blocks of a recording as files that are dated by their names, one an hour."""
    run = next(run for run in RUNS if run.name == "Bearing2_4")
    config = load_config(EXAMPLES / f"{run.config}.toml")
    source = open_configured(config, config.source[0], f"{os.environ['SPALLWATCH_DATA']}/{run.file}")
    folder.mkdir()
    for number, item in enumerate(source):
        if number == count:
            break
        if isinstance(item, Block):
            moment = BEGIN + datetime.timedelta(hours=number)
            np.save(folder / f"{moment:%Y%m%d-%H%M%S}.npy", item.samples.T.astype(np.float32))


def digests(result: RecordingResult) -> list[tuple[int | None, int, str]]:
    """Return what stands for the records of a result."""
    return [(file.day, file.rows, file.digest) for file in result.files]


def measure_parts(folder: Path, count: int) -> list[dict[str, Any]]:
    """Replay one history in one go and in parts; say what the parts cost, and whether the records are equal."""
    write_history(folder / "in", count)
    (folder / "m.toml").write_text(CONFIG)
    began = time.process_time()
    replay(load_config(folder / "m.toml"), str(folder / "in"), folder / "one")
    alone = time.process_time() - began
    rows: list[dict[str, Any]] = [
        {"replay": "plain replay", "parts": 1, "cpu_s": alone, "over": 1.0, "days": "", "equal": ""}
    ]
    wanted = [(one.day, one.rows, one.digest) for one in map(described, sorted((folder / "one/records").glob("*.nc")))]
    for given in ("in", "in/*.npy"):
        for blocks in reversed(PARTS):
            out = folder / f"{'glob' if '*' in given else 'folder'}-{blocks}"
            manifest = folder / "manifest.toml"
            manifest.write_text(
                f'[[machine]]\nname = "rig"\nconfig = "m.toml"\nrecordings = "{given}"\nhistory = "continued"\n'
            )
            runner = Runner(SerialExecutor(), open_store(folder / f"{out.name}.chunks"))
            began = time.process_time()
            with Index(out / "index.db") as index, runner:
                replay_waiting(Plan(manifest, str(out), part_blocks=blocks), index, runner)
            spent = time.process_time() - began
            found = digests(RecordingResult.from_json((out / "rig/history/result.json").read_bytes()))
            rows.append(
                {
                    "replay": f"{'a glob of files' if '*' in given else 'one folder'}, parts of {blocks} blocks",
                    "parts": runner.tally.chunks,
                    "cpu_s": spent,
                    "over": spent / alone,
                    "days": len(found),
                    "equal": found == wanted,
                }
            )
    return rows


def urls(count: int) -> Iterator[str]:
    """Yield URLs as an archive of a fleet has them."""
    for number in range(count):
        yield f"s3://plant-archive/line-{number % 40:02}/2024/{number % 366:03}/vibration-{number:08}.npy"


def measure_plan(folder: Path, count: int) -> dict[str, Any]:
    """Plan a CSV manifest; say how long a recording takes, and the memory."""
    (folder / "m.toml").write_text(CONFIG)
    with (folder / "fleet.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(("machine", "config", "recording"))
        writer.writerows(("press", "m.toml", url) for url in urls(count))
    with Index(folder / "planned.db") as index:
        began = time.perf_counter()
        Planner(index, open_store(folder / "work")).plan(folder / "fleet.csv")
        seconds = time.perf_counter() - began
    (folder / "planned.db").unlink()
    with Index(folder / "planned.db") as index:
        tracemalloc.start()
        Planner(index, open_store(folder / "work")).plan(folder / "fleet.csv")
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    return {"recordings": count, "plan_us_each": seconds / count * 1e6, "python_peak_mb": peak / 1e6}


def measure_index(path: Path, count: int) -> dict[str, Any]:
    """Fill an index with recordings, half of them done; say its size, and how long it takes to begin again."""
    with Index(path) as index:
        index.begin()
        machines = [index.add_machine(f"press-{number:02}", "0" * 40, "each") for number in range(40)]
        for number, url in enumerate(urls(count)):
            index.add_recording(machines[number % 40], url.rpartition("/")[2], url)
        index.commit()
        waiting = path.stat().st_size
        began = time.perf_counter()
        noted = 0
        for first in range(1, min(count // 2, NOTED) + 1, 64):
            last = min(first + 64, count // 2 + 1)
            index.note(Outcome(number, 1, 1440, 1.7e9, 1.7e9 + 86400, 31.2) for number in range(first, last))
            noted += last - first
        note_us = (time.perf_counter() - began) / noted * 1e6
        index.note(Outcome(number, 1, 1440, 1.7e9, 1.7e9 + 86400, 31.2) for number in range(noted + 1, count // 2 + 1))
    size = path.stat().st_size
    began = time.perf_counter()
    with Index(path) as index:
        opened = time.perf_counter() - began
        left = index.left()
        counted = time.perf_counter() - began
        began = time.perf_counter()
        row = next(index.waiting())
        first = time.perf_counter() - began
        began = time.perf_counter()
        counts = index.counts()
        total = time.perf_counter() - began
    assert (left, counts.done) == (count - count // 2, count // 2)
    assert row.id == count // 2 + 1
    return {
        "recordings": count,
        "waiting_bytes_each": waiting / count,
        "half_done_bytes_each": size / count,
        "gigabytes": size / 1e9,
        "note_us_each": note_us,
        "open_ms": opened * 1e3,
        "left_ms": counted * 1e3,
        "first_waiting_ms": first * 1e3,
        "counts_s": total,
    }


def main() -> None:
    """Measure both and print tables."""
    options = arguments(__doc__ or "")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        parts = measure_parts(folder, 120 if options.quick else 10**6)
        print_table("a history in parts", parts)
        plan = measure_plan(folder, PLANNED // 10 if options.quick else PLANNED)
        print_table("planning", [plan])
        index = measure_index(folder / "index.db", RECORDINGS // 100 if options.quick else RECORDINGS)
        print_table("index", [index])
    write_json(options.json, {"parts": parts, "plan": plan, "index": index})


if __name__ == "__main__":
    main()
