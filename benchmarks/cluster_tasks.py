"""Seconds and bytes of a task, by kind of work: how many tasks make a chunk.

Run with ``python -m benchmarks.cluster_tasks``; ``benchmarks/results/cluster_tasks.json`` keeps the figures.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from benchmarks.common import Row, arguments, print_table, write_json
from benchmarks.identify import BAND
from models.lives.life import simulate_lives
from models.lives.population import Population
from models.machine.scene import Floor, Slip
from models.maps.build import build_map
from models.maps.plan import MapPlan
from models.work.codec import decode
from models.work.folder_store import FolderStore
from models.work.runner import Runner
from models.work.serial import SerialExecutor
from models.work.task import ChunkCall, ChunkOutcome


@dataclass
class Meter(SerialExecutor):
    """Runs chunks in this process and notes what each one takes."""

    seconds: dict[str, list[float]] = field(default_factory=lambda: defaultdict[str, list[float]](list))
    sizes: dict[str, list[int]] = field(default_factory=lambda: defaultdict[str, list[int]](list))
    sent: dict[str, list[int]] = field(default_factory=lambda: defaultdict[str, list[int]](list))

    def __post_init__(self) -> None:
        """Begin with nothing to do."""
        super().__init__()
        self._call: ChunkCall | None = None

    def submit(self, call: ChunkCall) -> None:
        """Note the chunk."""
        self._call = call
        super().submit(call)

    def wait(self) -> ChunkOutcome:
        """Run the chunk that was submitted."""
        call = self._call
        assert call is not None
        begun = time.process_time()
        outcome = super().wait()
        kind, count = call.label.rpartition(" to ")[0].rstrip("0123456789 ") or call.label, len(decode(call.tasks))
        kind = kind.rstrip("0123456789 ")
        self.seconds[kind].append((time.process_time() - begun) / count)
        self.sizes[kind].append(outcome.size // count)
        self.sent[kind].append(len(call.tasks) // count)
        if outcome.failure is not None:
            raise SystemExit(outcome.failure.log)
        return outcome


def map_plan(extents: int, depths: int) -> MapPlan:
    """Return the plan of an evenly spaced map of 50 degrees and 32 um."""
    return MapPlan(
        load=(4000.0,),
        speed=(40.0,),
        h_d=tuple(np.linspace(0.0, 32e-6, depths).tolist()),
        dphi_d=tuple(np.radians(np.linspace(0.0, 50.0, extents)).tolist()),
        rms_band=BAND,
    )


JOBS: dict[str, Callable[[Runner], object]] = {
    "map, 51 extents": lambda runner: build_map(map_plan(51, 5), runner=runner),
    "map, 4 rough floors": lambda runner: build_map(
        replace(map_plan(11, 3), floor=Floor("rough"), floors=4), runner=runner
    ),
    "map, slip, 4 floors": lambda runner: build_map(
        replace(map_plan(5, 3), floor=Floor("rough"), floors=4, slip=Slip(0.005)), runner=runner
    ),
    "map, 4 rigs": lambda runner: build_map(replace(map_plan(11, 3), rig_draws=4, rig_spread=0.035), runner=runner),
    "library": lambda runner: list(simulate_lives(Population(), range(8), runner)),
}


def main() -> None:
    """Print the table and write the JSON."""
    options = arguments(__doc__ or "")
    rows: list[Row] = []
    for name, job in JOBS.items():
        for again in (False, True):
            meter = Meter()
            with tempfile.TemporaryDirectory() as scratch:
                runner = Runner(meter, FolderStore(Path(scratch)))
                job(runner)
                shared = max((path.stat().st_size for path in Path(scratch).glob("shared/*")), default=0)
            # The first time compiles.
            if again:
                rows += [
                    {
                        "job": name,
                        "kind": kind,
                        "tasks": len(taken),
                        "median_s": statistics.median(taken),
                        "max_s": max(taken),
                        "task_bytes": max(meter.sent[kind]),
                        "result_bytes": max(meter.sizes[kind]),
                        "shared_bytes": shared,
                    }
                    for kind, taken in meter.seconds.items()
                ]
    print_table("tasks", rows)
    write_json(options.json, {"tasks": rows})


if __name__ == "__main__":
    main()
