"""The RMS map of 51 x 33 nodes averaged over a hundred rough floors, on one core, with and without slip.

A first table has both solvers that could make a map without slip: rows that settle, which ``build_map`` takes, and
lanes.

Run as ``python -m benchmarks.ensemble [--quick] [--json FILE]`` (quick: 6 x 5 nodes). Each row prints the CPU time of
the map, the standard error of its means (median, 99th percentile and maximum over the damaged nodes, relative), and the
error that the steps leave in the RMS of one floor.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.common import REFERENCE_MS, Row, arguments, calibration_kernel, interleaved_ms, print_table, write_json
from models.machine.scene import Floor, Slip
from models.maps.build import build_map
from models.maps.ensemble import ensemble_nodes, ensemble_options, step_error
from models.maps.nodes import MAP_ACCURACY, scene_at, simulate_node_row
from models.maps.plan import MapPlan
from models.solve.six_dof.rows import simulate_row

FLOORS = 100


def plan_of(extents: int, depths: int, slip: Slip | None = None, floors: int = FLOORS) -> MapPlan:
    """Return the plan of the map for 4 kN and 40 Hz."""
    return MapPlan(
        load=(4000.0,),
        speed=(40.0,),
        h_d=tuple(np.linspace(0.0, 32e-6, depths).tolist()),
        dphi_d=tuple(np.radians(np.linspace(0.0, 50.0, extents)).tolist()),
        floor=Floor("rough"),
        floors=floors,
        rms_band=(0.0, 9500.0),
        slip=slip,
    )


def map_row(plan: MapPlan) -> Row:
    """Return the time of a map, what its means are worth, and the speed of the machine in the same minute."""
    start, cpu = time.perf_counter(), time.process_time()
    built = build_map(plan)
    seconds, cpu = time.perf_counter() - start, time.process_time() - cpu
    damaged = (built.h_d[:, None] > 0.0) & (built.dphi_d > 0.0)
    relative = (built.rms_se / built.rms)[0, 0][damaged]
    scenes, slip = built.rms.size * plan.floors, plan.slip
    return {
        "solver": built.attributes["solver"],
        "slip": "none" if slip is None else f"{slip.rule}, {slip.phi_slip} rad",
        "nodes": built.rms.size,
        "floors": plan.floors,
        "seconds": seconds,
        "cpu seconds": cpu,
        "ms a scene": 1e3 * cpu / scenes,
        "standard error median": float(np.median(relative)),
        "p99": float(np.quantile(relative, 0.99)),
        "max": float(relative.max()),
        "step error of one floor, rms": step_error(plan, ensemble_options(plan), 256).rms,
        "calibration FFT ms": interleaved_ms({"fft": calibration_kernel()}, 51)["fft"],
    }


def solver_rows(plan: MapPlan) -> list[Row]:
    """Return what a scene costs either solver, and how far each is from rows of a tenth of their accuracy (rms)."""
    extents, seeds = np.array(plan.dphi_d), range(plan.floors)

    def rows_of(row: Callable[[float, int], NDArray[np.float64]]) -> NDArray[np.float64]:
        return np.asarray(np.mean([[row(h, seed) for seed in seeds] for h in plan.h_d[1:]], axis=1), dtype=np.float64)

    def node_row(h_d: float, seed: int) -> NDArray[np.float64]:
        return simulate_node_row(plan, 4000.0, 40.0, h_d, extents, seed).rms

    def fine_row(h_d: float, seed: int) -> NDArray[np.float64]:
        scene = scene_at(plan, 4000.0, 40.0, h_d, float(extents[-1]), seed)
        return simulate_row(scene, extents, accuracy=0.1 * MAP_ACCURACY, band=plan.rms_band).rms

    true = rows_of(fine_row)
    damaged = replace(plan, h_d=plan.h_d[1:])
    rows: list[Row] = []
    for name, make in (("rows", lambda: rows_of(node_row)), ("lanes", lambda: ensemble_nodes(damaged).rms[0, 0])):
        start = time.process_time()
        found = make()
        seconds = time.process_time() - start
        error = float(np.sqrt(np.mean((found[:, 1:] / true[:, 1:] - 1.0) ** 2)))
        rows.append({"solver": name, "ms a scene": 1e3 * seconds / (found.size * plan.floors), "error, rms": error})
    return rows


def main() -> None:
    """Print the table and write the JSON file if one was asked for."""
    options = arguments("Ensemble maps: time and standard error.")
    build_map(plan_of(2, 2, Slip(0.01), 2))
    size = (6, 5) if options.quick else (51, 33)
    rows = [map_row(plan_of(*size, slip)) for slip in (None, Slip(0.01))]
    plan = plan_of(*size)
    solvers = solver_rows(plan_of(11 if options.quick else 51, 5, floors=4 if options.quick else 32))
    print_table("Solvers without slip, means over floors", solvers)
    print_table(f"Map over {math.degrees(plan.dphi_d[-1]):.0f} degrees and {plan.h_d[-1] * 1e6:.0f} um", rows)
    print(f"\nTargets refer to a machine whose calibration FFT takes {REFERENCE_MS} ms.")
    write_json(options.json, {"solvers": solvers, "maps": rows})


if __name__ == "__main__":
    main()
