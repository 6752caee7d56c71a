"""Memory, time and bytes of the tasks of maps, lives and identifications, and what sharing them on this machine costs.

Each kind of task runs in a process of its own, twice: the second time counts, beside the memory that the first left.

Run: python -m benchmarks.task_memory [--quick] [--json FILE]
"""

from __future__ import annotations

import ctypes
import multiprocessing
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.common import Row, arguments, print_table, write_json
from models.identify.evaluate import Evaluator
from models.identify.space import Space
from models.identify.trials import Condition
from models.lives.life import simulate_lives
from models.lives.population import Population
from models.machine.bearing import catalogue_entry, from_catalogue
from models.machine.rig import Rig
from models.machine.scene import Defect, Floor, Scene, Slip
from models.maps.build import build_map
from models.maps.ensemble import ensemble_nodes
from models.maps.plan import MapPlan
from models.solve.angular.rig import AngularRig
from models.solve.nominal_rigs import nominal_rig
from models.solve.rotor.rig import RotorRig
from models.solve.six_dof.lanes import LaneOptions, simulate_lanes
from models.work.choose import local_runner
from models.work.codec import encode
from models.work.runner import SERIAL, Runner
from models.work.serial import SerialExecutor
from models.work.task import Work

PLAN = MapPlan(
    load=(4000.0,),
    speed=(40.0,),
    h_d=tuple(np.linspace(0.0, 32e-6, 33).tolist()),
    dphi_d=tuple(np.radians(np.linspace(0.0, 50.0, 51)).tolist()),
    rms_band=(0.0, 9500.0),
)
ROUGH = Floor("rough", seed=1)
SLOW = replace(PLAN, speed=(2.0,))
SLIPPING = replace(PLAN, slip=Slip(0.01), floor=ROUGH, floors=32)
BAND = (0.0, 9500.0)
LOADS = (1000.0, 2000.0, 4000.0)
CONDITIONS = tuple(Condition(load, 40.0, extent, 5e-4) for load in LOADS for extent in (0.04, 0.08, 0.12))
Kind = tuple[Work[Any, Any, Any], Any, Any]


class FoundError(Exception):
    """Ends a run whose tasks are known."""


class Watching(Runner):
    """Keeps the first kind of work of a name with its tasks, and ends the run there."""

    def __init__(self, name: str) -> None:
        """Take the name."""
        super().__init__(SerialExecutor())
        self.name = name
        self.found: tuple[Work[Any, Any, Any], Any, list[Any]] | None = None

    def run(
        self, work: Work[Any, Any, Any], shared: Any, tasks: Iterable[Any], *, total: int | None = None
    ) -> Iterator[Any]:
        """Yield the results, or end the run."""
        if work.name == self.name:
            self.found = work, shared, list(tasks)
            raise FoundError
        return super().run(work, shared, tasks, total=total)


def model_plan(kind: type[Any]) -> MapPlan:
    """Return a plan of one deep defect by another model."""
    entry = catalogue_entry("6205")
    rig = nominal_rig(kind, entry)
    return MapPlan(
        (4000.0,), (40.0,), (15e-6,), (0.2,), bearing=entry.bearing, rig=rig, model=kind.model, rms_band=BAND
    )


def candidates(runner: Runner) -> object:
    """Simulate a candidate of an identification."""
    space = Space(Rig(), from_catalogue("1205 ETN9"), LOADS, free=("m_r",))
    return Evaluator(space, CONDITIONS, BAND, runner, runner).levels([space.known])


def lanes(speed: float, rule: str, runner: Runner) -> object:
    """Simulate a group of scenes with slip."""
    slip: Any = Slip(0.01, rule)  # type: ignore[arg-type]
    scenes = [Scene(speed, 4000.0, defect=Defect(0.8, 1e-5 + 1e-7 * i), slip=slip) for i in range(32)]
    return simulate_lanes(scenes, LaneOptions(slip_blocks=2, max_blocks=3), runner=runner)


def one_life(population: Population, runner: Runner) -> object:
    """Simulate a life."""
    return list(simulate_lives(population, [3], runner))


ROWS, GROUPS = "rows of the map", "groups of scenes"
KINDS: dict[str, tuple[str, Callable[[Runner], object]]] = {
    "row, 51 extents": (ROWS, lambda r: build_map(PLAN, runner=r)),
    "row, 501 extents": (ROWS, lambda r: build_map(replace(PLAN, dphi_d=FINE), runner=r)),
    "row at 2 Hz": (ROWS, lambda r: build_map(SLOW, runner=r)),
    "row, 20 rough floors": (ROWS, lambda r: build_map(replace(PLAN, floor=ROUGH, floors=20), runner=r)),
    "row of the inner race": (ROWS, lambda r: build_map(replace(PLAN, part="inner"), runner=r)),
    "row of the inner race at 2 Hz": (ROWS, lambda r: build_map(replace(SLOW, part="inner"), runner=r)),
    "node by the rotor": (ROWS, lambda r: build_map(model_plan(RotorRig), runner=r)),
    "node over the angle": (ROWS, lambda r: build_map(model_plan(AngularRig), runner=r)),
    "row of 16 rigs": ("rows of drawn rigs", lambda r: build_map(replace(PLAN, h_d=(16e-6,), rig_draws=16), runner=r)),
    "24 groups with slip": ("groups of scenes of the map", lambda r: ensemble_nodes(SLIPPING, runner=r)),
    "24 groups with slip at 2 Hz": (
        "groups of scenes of the map",
        lambda r: ensemble_nodes(replace(SLIPPING, speed=(2.0,)), runner=r),
    ),
    "group with slip": (GROUPS, partial(lanes, 40.0, "per_passage")),
    "group with mean slip": (GROUPS, partial(lanes, 40.0, "mean_force")),
    "group with mean slip at 5 Hz": (GROUPS, partial(lanes, 5.0, "mean_force")),
    "life": ("lives", partial(one_life, Population())),
    "life, 100 s from block to block": ("lives", partial(one_life, replace(Population(), interval=100.0))),
    "row of a candidate": ("candidates of the identification", candidates),
}
FINE = tuple(np.radians(np.linspace(0.0, 50.0, 501)).tolist())


def kind_of(name: str) -> Kind:
    """Return a kind of work, what its tasks share, and one of the costliest of them."""
    work_name, begin = KINDS[name]
    watching = Watching(work_name)
    with suppress(FoundError):
        begin(watching)
    assert watching.found is not None
    work, shared, tasks = watching.found
    return work, shared, tasks[3 * len(tasks) // 4]


def measured(name: str) -> Row:
    """Return the figures of a kind of task; for a process of its own."""
    work, shared, task = kind_of(name)
    work.function(shared, task)
    ctypes.CDLL(None).malloc_trim(0)
    Path("/proc/self/clear_refs").write_text("5")
    before, begun = _status("VmRSS"), time.process_time()
    result = work.function(shared, task)
    return {
        "task": name,
        "MB": 1e-6 * (_status("VmHWM") - before),
        "stated, MB": 1e-6 * work.memory,
        "processor, s": time.process_time() - begun,
        "in a chunk": work.per_chunk,
        "shared, kB": 1e-3 * len(encode(shared)),
        "task, kB": 1e-3 * len(encode(task)),
        "result, kB": 1e-3 * len(encode(result)),
    }


def _status(key: str) -> int:
    """Return a line of this process's status, bytes."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(f"{key}:"):
            return 1024 * int(line.split()[1])
    raise ValueError(f"/proc/self/status has no {key}")


def paired(ways: Mapping[str, Callable[[], object]], rounds: int) -> Row:
    """Return the median wall time of each way, s, and the median of the ratios of the first to the others."""
    for way in ways.values():
        way()
    times: dict[str, list[float]] = {name: [] for name in ways}
    for _ in range(rounds):
        for name, way in ways.items():
            begun = time.perf_counter()
            way()
            times[name].append(time.perf_counter() - begun)
    first, *others = ways
    ratios = {f"over {name}": float(np.median(np.divide(times[first], times[name]))) for name in others}
    return {name: float(np.median(values)) for name, values in times.items()} | ratios


def _in_threads(function: Callable[[Any], Any], tasks: Sequence[Any]) -> list[Any]:
    with ThreadPoolExecutor(2) as pool:
        return list(pool.map(function, tasks))


def _apply(work: Work[Any, Any, Any], shared: Any, task: Any) -> Any:
    return work.function(shared, task)


def local_rows(rounds: int) -> list[Row]:
    """Return what sharing costs on this machine, beside what the standard library takes for the same tasks."""
    watching = Watching(ROWS)
    with suppress(FoundError):
        build_map(PLAN, runner=watching)
    assert watching.found is not None
    work, shared, tasks = watching.found
    function = partial(_apply, work, shared)
    with local_runner(2) as two:
        threads = {
            "runner, s": lambda: list(two.run(work, shared, tasks)),
            "threads, s": lambda: _in_threads(function, tasks),
        }
        serial = {
            "runner, s": lambda: list(SERIAL.run(work, shared, tasks)),
            "loop, s": lambda: list(map(function, tasks)),
        }
        found = [
            {"ways": "33 rows, one core", **_plain(paired(serial, rounds))},
            {"ways": "33 rows, two threads", **_plain(paired(threads, rounds))},
        ]
    return [*found, _processes(rounds // 3)]


def _processes(rounds: int) -> Row:
    """Return the time of lanes in two processes that are begun anew, as they are by a command."""
    watching = Watching("groups of scenes of the map")
    with suppress(FoundError):
        ensemble_nodes(replace(SLIPPING, h_d=PLAN.h_d[::8]), runner=watching)
    assert watching.found is not None
    work, shared, tasks = watching.found
    spawn = multiprocessing.get_context("spawn")

    def pool() -> object:
        with ProcessPoolExecutor(2, mp_context=spawn) as processes:
            return list(processes.map(partial(_apply, work, shared), tasks))

    def runner() -> object:
        with local_runner(2) as two:
            return list(two.run(work, shared, tasks))

    return {"ways": f"{len(tasks)} times 24 groups, two processes", **_plain(paired({"a": runner, "b": pool}, rounds))}


def _plain(row: Row) -> Row:
    runner, other, ratio = row.values()
    return {"runner, s": runner, "standard library, s": other, "ratio": ratio}


def main() -> None:
    """Print and keep the figures."""
    asked = arguments(__doc__ or "")
    rows: list[Row] = []
    for name in KINDS:
        with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as process:
            rows.append(process.submit(measured, name).result())
    print_table("tasks", rows)
    local = local_rows(5 if asked.quick else 15)
    print_table("on this machine", local)
    write_json(asked.json, {"tasks": rows, "local": local})


if __name__ == "__main__":
    main()
