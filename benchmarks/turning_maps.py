"""Maps of the inner race and of balls: what 51 x 33 nodes cost on one core, and whether their errors are what they say.

Run as ``python -m benchmarks.turning_maps [--quick] [--json FILE]`` (quick: 6 x 5 nodes). Bearing, rig and grid are
those of ``benchmarks.ensemble``: 1205 ETN9, 4 kN, 40 Hz, full bandwidth. Tables, in per cent unless said otherwise:

1. maps: CPU time of one core, standard error of the RMS (relative, over the damaged nodes), estimated error of the
   steps, nodes that miss either aim, error between the nodes relative to the largest RMS;
2. nodes: random nodes against an independent run of 20 s with steps of 5 us: their difference, the largest, and its
   root mean square over what both standard errors and the estimated step error allow (1: they say what they are);
3. records: scatter of the level between records that begin in other phases, over the standard error that each states.
"""

from __future__ import annotations

import math
import time
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.common import REFERENCE_MS, Row, arguments, calibration_kernel, interleaved_ms, print_table, write_json
from models.machine.scene import Part
from models.maps.build import build_map
from models.maps.nodes import MAP_ACCURACY, nodes_at_random, scene_at
from models.maps.plan import MapPlan
from models.solve.response import STATUSES
from models.solve.six_dof.stationary import stationary_level
from models.solve.six_dof.time_domain import simulate_time

PARTS: tuple[Part, ...] = ("inner", "ball")
SEED = 14


def plan_of(part: Part, extents: int, depths: int) -> MapPlan:
    """Return the plan of an evenly spaced map of 50 degrees and 32 um."""
    return MapPlan(
        load=(4000.0,),
        speed=(40.0,),
        h_d=tuple(np.linspace(0.0, 32e-6, depths).tolist()),
        dphi_d=tuple(np.radians(np.linspace(0.0, 50.0, extents)).tolist()),
        part=part,
    )


def map_row(plan: MapPlan) -> Row:
    """Return the time of a map, what its levels are worth, and the speed of the machine in the same minute."""
    start, cpu = time.perf_counter(), time.process_time()
    built = build_map(plan)
    seconds, cpu = time.perf_counter() - start, time.process_time() - cpu
    damaged = (built.h_d[:, None] > 0.0) & (built.dphi_d > 0.0)
    relative, steps = ((values / built.rms)[0, 0][damaged] for values in (built.rms_se, built.rms_error))
    kernel = interleaved_ms({"kernel": calibration_kernel()}, 60)["kernel"]
    return {
        "part": plan.part,
        "nodes": built.rms.size,
        "seconds": seconds,
        "cpu seconds": cpu,
        "ms a node": 1e3 * cpu / int(np.count_nonzero(damaged)),
        "standard error median": 100.0 * float(np.median(relative)),
        "p99": 100.0 * float(np.quantile(relative, 0.99)),
        "max": 100.0 * float(np.max(relative)),
        "steps, rms": 100.0 * _rms(steps),
        "steps, max": 100.0 * float(np.max(steps)),
        "inaccurate": int(np.count_nonzero(built.status == STATUSES.index("inaccurate"))),
        "not converged": int(np.count_nonzero(built.status == STATUSES.index("not_converged"))),
        "between nodes": 100.0 * float(built.attributes["interpolation_error"]),
        "calibration FFT ms": kernel,
        "reference FFT ms": REFERENCE_MS,
    }


def node_row(plan: MapPlan, nodes: int, duration: float) -> Row:
    """Return how far levels are off independent runs, and how that compares with what both say."""
    off: list[float] = []
    ratio: list[float] = []
    for load, speed, h_d, dphi_d in nodes_at_random(plan, nodes, SEED):
        scene = scene_at(plan, load, speed, h_d, dphi_d)
        level = stationary_level(scene, accuracy=MAP_ACCURACY)
        long = simulate_time(scene, duration, 10000.0, step=5e-6)
        change = level.rms - long.rms
        off.append(change / long.rms)
        ratio.append(change / math.hypot(level.rms_se, long.rms_se, level.rms_error * level.rms))
    return {
        "part": plan.part,
        "nodes": nodes,
        "difference, rms": 100.0 * _rms(np.array(off)),
        "max": 100.0 * float(np.max(np.abs(off))),
        "over what is stated, rms": _rms(np.array(ratio)),
        "largest": float(np.max(np.abs(ratio))),
    }


def record_row(plan: MapPlan, nodes: int, records: int) -> Row:
    """Return the scatter between records over the standard errors that they state."""
    ratio: list[float] = []
    for node in nodes_at_random(plan, nodes, SEED + 1):
        scene = scene_at(plan, *node)
        levels = [stationary_level(scene, accuracy=MAP_ACCURACY, number=number) for number in range(records)]
        scatter = float(np.std([level.rms for level in levels], ddof=1))
        ratio.append(scatter / _rms(np.array([level.rms_se for level in levels])))
    return {
        "part": plan.part,
        "nodes": nodes,
        "records": records,
        "scatter over stated, rms": _rms(np.array(ratio)),
        "largest": max(ratio),
    }


def _rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def main() -> None:
    """Print the tables."""
    options = arguments(__doc__ or "")
    extents, depths = (6, 5) if options.quick else (51, 33)
    nodes, duration, records = (3, 4.0, 4) if options.quick else (24, 20.0, 8)
    plans = [plan_of(part, extents, depths) for part in PARTS]
    for plan in plans:
        # Compiles what the maps need.
        build_map(replace(plan, h_d=(10e-6,), dphi_d=(0.1,)))
    tables = {
        "maps": [map_row(plan) for plan in plans],
        "nodes": [node_row(plan, nodes, duration) for plan in plans],
        "records": [record_row(plan, nodes, records) for plan in plans],
    }
    for title, rows in tables.items():
        print_table(title, rows)
    write_json(options.json, tables)


if __name__ == "__main__":
    main()
