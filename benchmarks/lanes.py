"""Many scenes at once: error against time of the lane kernel, slip, and two processes.

Run as ``python -m benchmarks.lanes [--quick] [--json FILE]``. Times are thread CPU times of one core, medians of seven,
set-up and path tables included. Five tables:

1. the reference (one scene at a time, 2048 steps per ball period) against scipy's DOP853 on an independent writing;
2. error of RMS and lines against that reference over map points (1 to 50 degrees, half of them up to 15; 1 to 32 um,
   half of them rough; 1 to 5 kN; 40 Hz) for several numbers of steps, beside the time of an integrated second and of a
   settled scene;
3. rough floors by the lanes and one scene at a time: error and time of a settled scene;
4. slip: RMS of the defects D1 to D3 of the thesis by rule and angle, with its standard error, and the time;
5. groups shared between two processes, beside two independent processes of the calibration kernel.
"""

from __future__ import annotations

import math
import multiprocessing
import statistics
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from typing import Literal

import numpy as np

from benchmarks.common import REFERENCE_MS, Row, arguments, calibration_kernel, interleaved_ms, print_table, write_json
from models.machine.scene import Defect, Floor, Scene, Slip
from models.solve.simulate import simulate
from models.solve.six_dof.kernels.lanes import LANES
from models.solve.six_dof.lanes import LaneOptions, LaneRunner, simulate_lanes
from tests.oracles.six_dof_oracle import Case, simulate_oracle

SEED = 29
REFERENCE_STEPS = 2048
G = 9.80665
# Localised defects of the thesis: mean extent of Table 2, degrees, load, N, and speed, Hz.
LOCALISED = {"D1": (2.362, 1000.0, 40.0), "D2": (4.236, 2000.0, 30.0), "D3": (6.366, 2000.0, 40.0)}


def map_points(count: int, seed: int = SEED) -> list[Scene]:
    """Return scenes over the range of a map, neighbours of like extent beside each other."""
    rng = np.random.default_rng(seed)
    scenes = []
    for i in range(count):
        extent = rng.uniform(1.0, 50.0) if i % 2 else rng.uniform(1.0, 15.0)
        floor = Floor("rough" if i % 4 > 1 else "smooth", seed=i)
        defect = Defect(math.radians(extent), rng.uniform(1e-6, 32e-6), floor)
        scenes.append((extent, Scene(40.0, rng.uniform(1000.0, 5000.0), defect=defect)))
    return [scene for _, scene in sorted(scenes, key=lambda pair: pair[0])]


def reference_rows(count: int) -> list[Row]:
    """Return the reference and the lanes beside the independent integration."""
    rows: list[Row] = []
    for scene in [s for s in map_points(4 * count) if s.defect is not None and s.defect.floor.kind == "smooth"][:count]:
        defect = scene.defect
        assert defect is not None
        truth = simulate_oracle(Case(scene.speed, scene.load, defect.dphi_d, defect.h_d), periods=30, rtol=1e-10).rms
        fine = simulate(scene, steps_per_period=REFERENCE_STEPS, tolerance=1e-7)
        rows.append(
            {
                "scene": f"{math.degrees(defect.dphi_d):.1f} deg, {defect.h_d * 1e6:.1f} um, {scene.load:.0f} N",
                "DOP853 m/s2": truth,
                "reference/DOP853 - 1": fine.rms / truth - 1.0,
                "lanes/DOP853 - 1": float(simulate_lanes([scene]).rms[0]) / truth - 1.0,
            }
        )
    return rows


def error_rows(count: int) -> list[Row]:
    """Return errors and times for several numbers of steps."""
    scenes = map_points(count)
    fine = [simulate(s, steps_per_period=REFERENCE_STEPS, tolerance=1e-7) for s in scenes]
    truth = np.array([r.rms for r in fine])
    lines = np.array([r.harmonics for r in fine])
    fft = calibration_kernel()
    rows: list[Row] = []
    for steps in (160, 192, 256, 320, 384, 512):
        found = simulate_lanes(scenes, LaneOptions(steps_per_period=steps))
        error = np.abs(found.rms / truth - 1.0)
        runner = LaneRunner(LaneOptions(steps_per_period=steps))
        groups = [scenes[i : i + LANES] for i in range(0, len(scenes) - LANES + 1, LANES)]
        times, seconds = _group_times(runner, groups)
        rows.append(
            {
                "steps": steps,
                "RMS error rms": float(np.sqrt(np.mean(error**2))),
                "median": float(np.median(error)),
                "p99": float(np.quantile(error, 0.99)),
                "max": float(error.max()),
                "lines max": float(np.max(np.abs(found.harmonics - lines) / truth[:, None])),
                "ms a second and scene": times / seconds,
                "ms a settled scene": times,
                "periods": float(np.mean(found.periods)),
                "calibration FFT ms": interleaved_ms({"fft": fft}, 51)["fft"],
            }
        )
    return rows


def one_scene_rows(count: int) -> list[Row]:
    """Return error and time of the solver of one scene at a time on the same points, rough floors only."""
    scenes = [s for s in map_points(count) if s.defect is not None and s.defect.floor.kind == "rough"]
    truth = np.array([simulate(s, steps_per_period=REFERENCE_STEPS, tolerance=1e-7).rms for s in scenes])
    rows: list[Row] = []
    for steps in (192, 256, 384):
        times, rms = [], []
        for scene in scenes:
            start = time.thread_time()
            rms.append(simulate(scene, steps_per_period=steps, tolerance=1e-3, lines_to=0.0).rms)
            times.append(1e3 * (time.thread_time() - start))
        options = LaneOptions(steps_per_period=steps)
        lanes = simulate_lanes(scenes, options).rms
        lane_ms, _ = _group_times(LaneRunner(options), [scenes[:LANES]])
        rows.append(
            {
                "steps": steps,
                "one scene, error rms": float(np.sqrt(np.mean((np.array(rms) / truth - 1.0) ** 2))),
                "one scene, ms": statistics.median(times),
                "lanes, error rms": float(np.sqrt(np.mean((lanes / truth - 1.0) ** 2))),
                "lanes, ms": lane_ms,
            }
        )
    return rows


def _group_times(runner: LaneRunner, groups: list[list[Scene]]) -> tuple[float, float]:
    """Return CPU milliseconds and integrated seconds of one scene, medians of seven groups."""
    times, seconds = [], []
    for i in range(7):
        group = groups[i % len(groups)]
        runner.run(group)
        start = time.thread_time()
        response = runner.run(group)
        times.append(1e3 * (time.thread_time() - start) / len(group))
        seconds.append(float(response.periods[0]) / response.bpfo)
    return statistics.median(times), statistics.median(seconds)


def slip_rows(blocks: int) -> list[Row]:
    """Return the RMS of localised defects under slip, in g; every lane is an independent record of the same scene."""
    rows: list[Row] = []
    rules: tuple[Literal["per_passage", "mean_force"], ...] = ("per_passage", "mean_force")
    for rule in rules:
        for angle in (0.0, 0.005, 0.01, 0.02):
            options = LaneOptions(slip_blocks=blocks)
            row: dict[str, float | int | str | None] = {"rule": rule, "phi_slip rad": angle}
            cost = []
            for name, (degrees, load, speed) in LOCALISED.items():
                scene = Scene(speed, load, defect=Defect(math.radians(degrees), 500e-6), slip=Slip(angle, rule))
                start = time.thread_time()
                found = simulate_lanes([scene] * LANES, options)
                cost.append(1e3 * (time.thread_time() - start) / (LANES * float(found.periods[0]) / found.bpfo))
                power = found.rms**2
                rms = math.sqrt(float(np.mean(power)))
                row[f"{name} g"] = rms / G
                row[f"{name} se"] = float(np.std(power, ddof=1)) / math.sqrt(LANES) / (2.0 * rms) / G
            rows.append({**row, "ms a second and scene": statistics.median(cost)})
    return rows


def _lanes_job(count: int) -> float:
    """Simulate some groups; return the seconds that they took."""
    runner = LaneRunner()
    scenes = map_points(LANES)
    runner.run(scenes)
    start = time.perf_counter()
    for _ in range(count):
        runner.run(scenes)
    return time.perf_counter() - start


def _calibration_job(count: int) -> float:
    """Execute the calibration kernel some times; return the seconds that it took."""
    execute = calibration_kernel()
    execute()
    start = time.perf_counter()
    for _ in range(count):
        execute()
    return time.perf_counter() - start


def parallel_rows(count: int) -> list[Row]:
    """Return the speed-up of two processes that share groups, and of two independent calibration kernels.

    Both do half of the work each; the time is that of the slower one.
    """
    rows: list[Row] = []
    first = 0.0
    jobs: dict[str, tuple[Callable[[int], float], int]] = {
        "calibration": (_calibration_job, 200 * count),
        "lanes": (_lanes_job, count),
    }
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(2, mp_context=context) as pool:
        for name, (job, size) in jobs.items():
            list(pool.map(job, [1, 1]))
            alone, both = [], []
            for _ in range(3):
                alone.append(job(size))
                both.append(max(pool.map(job, [size // 2, size // 2])))
            seconds = statistics.median(alone)
            speed_up = seconds / statistics.median(both)
            first = first or speed_up
            rows.append(
                {
                    "work": name,
                    "seconds alone": seconds,
                    "speed-up of two": speed_up,
                    "of the calibration's": speed_up / first,
                }
            )
    return rows


def main() -> None:
    """Print the tables and write the JSON file if one was asked for."""
    options = arguments("Many scenes at once: error against time.")
    simulate(Scene(40.0, 4000.0))
    simulate_lanes([replace(scene, slip=Slip(0.01)) for scene in map_points(2)])
    tables: dict[str, list[Row]] = {
        "reference": reference_rows(1 if options.quick else 4),
        "errors": error_rows(64 if options.quick else 256),
        "rough floors, against one scene at a time": one_scene_rows(64 if options.quick else 256),
        "slip": slip_rows(4 if options.quick else 20),
        "two processes": parallel_rows(10 if options.quick else 60),
    }
    for title, rows in tables.items():
        print_table(title, rows)
    print(f"\nTargets refer to a machine whose calibration FFT takes {REFERENCE_MS} ms.")
    write_json(options.json, tables)


if __name__ == "__main__":
    main()
