"""Memory and processor time of the tasks of replay, report --batch and score, beside the program.

    python -m benchmarks.batch_memory [--quick] [--json FILE]

Each task runs once in a process of its own that has imported what it needs; its peak is compared with that before.
"""

from __future__ import annotations

import importlib
import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.common import Row, arguments, print_table, write_json
from benchmarks.reports import make_store
from tests.support.small_machine import small_machine

RATE = 25_600


def write_recording(folder: Path, samples: int, channels: int, blocks: int) -> None:
    """Write a recording of noise, a file a block, with its configuration beside it."""
    config = small_machine(rate=RATE, block_s=str(samples / RATE), channels=channels, channel="")
    (folder / "m.toml").write_text(config)
    (folder / "in").mkdir()
    for number in range(blocks):
        rows = np.random.default_rng(number).standard_normal((samples, channels))
        np.save(folder / "in" / f"b{number:05d}.npy", rows.astype(np.float32))


def run(kind: str, folder: Path) -> dict[str, float]:
    """Run one task in this process; return its peak beside the program, MB, and its processor time, s."""
    from monitor.commands import replay_many, report_batch
    from monitor.commands import score as score_runs

    for name in ("monitor.report.report", "monitor.service.replay", "monitor.report.tables"):
        importlib.import_module(name)
    before, began = _peak_mb(), time.process_time()
    if kind == "replay":
        (recording,) = replay_many.find_recordings([str(folder / "in")])
        outcome = replay_many.replay_one(
            replay_many.Replays(folder / "m.toml", folder / "out"), replay_many.Task(recording)
        )
        assert not outcome.error, outcome.error
    elif kind == "report":
        from monitor.report.options import Options

        (item,) = report_batch.find_runs(folder / "in", recordings=False)
        pages = report_batch.Pages.of(folder / "out", report_batch.BatchSettings(Options()))
        page = report_batch.report_one(pages, report_batch.Task(item))
        assert not page.error, page.error
    else:
        from models.work.runner import SERIAL
        from monitor.report.score.scoring import End, score_run

        for _, issued in score_runs.read_all([folder / "in"], None, SERIAL, elsewhere=False):
            score_run(issued, End(float(issued.all_clock[-1]), "given"))
    return {"MB": _peak_mb() - before, "processor_s": time.process_time() - began}


def _peak_mb() -> float:
    return 1.024e-3 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def measured(kind: str, folder: Path) -> dict[str, Any]:
    """Return what a child process says of a task."""
    command = [sys.executable, "-m", "benchmarks.batch_memory", "--child", kind, str(folder)]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def main() -> None:
    """Measure all kinds."""
    options = arguments("Memory of the tasks of replay, report --batch and score.")
    rows: list[Row] = []
    scale = 10 if options.quick else 1
    with tempfile.TemporaryDirectory() as place:
        for samples, channels, blocks in ((2560, 2, 3000), (128_000, 4, 100), (1_280_000, 4, 10)):
            folder = Path(place, f"replay-{samples}")
            folder.mkdir()
            write_recording(folder, samples, channels, max(blocks // scale, 2))
            task = f"replay of {channels} x {samples} samples"
            rows.append({"task": task, "blocks": blocks // scale, **measured("replay", folder)})
        for blocks in (1000, 30_000 // scale):
            folder = Path(place, f"store-{blocks}")
            make_store(folder / "in" / "state.db", blocks, 24)
            kinds = ("report", "score")
            rows += [{"task": f"{kind} of a run", "blocks": blocks, **measured(kind, folder)} for kind in kinds]
    print_table("memory of a task beside the program", rows)
    write_json(options.json, {"tasks": rows})


if __name__ == "__main__":
    if sys.argv[1:2] == ["--child"]:
        print(json.dumps(run(sys.argv[2], Path(sys.argv[3]))))
    else:
        main()
