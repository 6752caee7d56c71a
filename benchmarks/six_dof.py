"""The six-degree-of-freedom model: error against time.

Run as ``python -m benchmarks.six_dof [--quick] [--json FILE]``. Four tables:

1. the reference (8192 steps per ball period) against scipy's DOP853 on an independent writing of the equations;
2. error of RMS, line amplitudes and peak against that reference over random scenes (0.8 to 50 degrees, half of them up
   to 15; 1 to 32 um; 500 to 5000 N; 15 to 50 Hz) for several numbers of steps, beside the time of a scene: at an
   operating point seen for the first time, and at one already seen (as in a map);
3. ball periods until the RMS has settled, with the accelerated search and by simulating on;
4. the map of 51 x 33 nodes at 4 kN and 40 Hz on one core, beside its error at random nodes.
"""

from __future__ import annotations

import math
import time
from dataclasses import replace

import numpy as np

from benchmarks.common import Row, arguments, calibration_kernel, interleaved_ms, print_table, write_json
from models.dynamics.orbit import STATE_SCALE, find_orbit
from models.dynamics.six_dof import prepare
from models.map_build import build_map, check_map
from models.map_data import MapPlan
from models.response import Response
from models.scene import Defect, Floor, Scene
from models.simulate import simulate
from tests.oracles.six_dof_oracle import Case, simulate_oracle

SEED = 11
REFERENCE_STEPS = 8192


def random_scenes(count: int, *, rough: bool, seed: int = SEED) -> list[Scene]:
    """Return scenes over the range for which the accuracy is promised."""
    rng = np.random.default_rng(seed)
    scenes = []
    for i in range(count):
        extent = rng.uniform(0.8, 50.0) if i % 2 else rng.uniform(0.8, 15.0)
        floor = Floor("rough" if rough else "smooth", seed=i)
        defect = Defect(math.radians(extent), rng.uniform(1.0, 32.0) * 1e-6, floor)
        scenes.append(Scene(rng.uniform(15.0, 50.0), rng.uniform(500.0, 5000.0), defect=defect))
    return scenes


def reference_rows(count: int) -> list[Row]:
    """Return the reference beside the independent integration."""
    rows: list[Row] = []
    for scene in random_scenes(count, rough=False, seed=SEED + 1):
        defect = scene.defect
        assert defect is not None
        truth = simulate_oracle(Case(scene.speed, scene.load, defect.dphi_d, defect.h_d), periods=30, rtol=1e-10).rms
        fine = simulate(scene, steps_per_period=REFERENCE_STEPS, tolerance=1e-8)
        rows.append(
            {
                "scene": f"{math.degrees(defect.dphi_d):.1f} deg, {defect.h_d * 1e6:.1f} um, {scene.load:.0f} N, "
                f"{scene.speed:.1f} Hz",
                "DOP853 m/s2": truth,
                "reference/DOP853 - 1": fine.rms / truth - 1.0,
                "default/DOP853 - 1": simulate(scene).rms / truth - 1.0,
            }
        )
    return rows


def error_rows(count: int) -> list[Row]:
    """Return errors and times for several numbers of steps, smooth and rough floors apart."""
    rows: list[Row] = []
    for rough in (False, True):
        scenes = random_scenes(count, rough=rough)
        fine = [simulate(s, steps_per_period=REFERENCE_STEPS, tolerance=1e-7) for s in scenes]
        rows.extend(_error_row(scenes, fine, steps, rough=rough) for steps in (256, 384, 512, None, 1024))
    return rows


def _error_row(scenes: list[Scene], fine: list[Response], steps: int | None, *, rough: bool) -> Row:
    # A load that differs in its last digits is an operating point that no cache knows.
    fresh = [replace(s, load=s.load * (1.0 + 1e-12 * ((steps or 0) + 1))) for s in scenes]
    first_ms = _median_ms(fresh, steps)
    seen_ms = _median_ms(fresh, steps)
    found = [simulate(s, steps_per_period=steps) for s in scenes]
    rms = np.array([a.rms / b.rms - 1.0 for a, b in zip(found, fine, strict=True)])
    resonator = np.array([a.rms_resonator / b.rms_resonator - 1.0 for a, b in zip(found, fine, strict=True)])
    lines = np.array([np.abs(a.harmonics - b.harmonics).max() / b.rms for a, b in zip(found, fine, strict=True)])
    peak = np.array([a.peak / b.peak - 1.0 for a, b in zip(found, fine, strict=True)])
    return {
        "floor": "rough" if rough else "smooth",
        "steps": "default" if steps is None else str(steps),
        "RMS error rms": float(np.sqrt(np.mean(rms**2))),
        "p99": float(np.quantile(np.abs(rms), 0.99)),
        "max": float(np.abs(rms).max()),
        "m_r max": float(np.abs(resonator).max()),
        "lines max": float(lines.max()),
        "peak max": float(np.abs(peak).max()),
        "ms first": first_ms,
        "ms seen": seen_ms,
        "not converged": sum(r.status != "converged" for r in found),
    }


def _median_ms(scenes: list[Scene], steps: int | None) -> float:
    times = []
    for scene in scenes:
        start = time.thread_time()
        simulate(scene, steps_per_period=steps)
        times.append(time.thread_time() - start)
    return 1e3 * float(np.median(times))


def settling_rows(count: int) -> list[Row]:
    """Return how many ball periods the search for the settled motion takes, and what is left of its error."""
    rows: list[Row] = []
    for name, clearance, loads in (("none", 0.0, (500, 5000)), ("8 um", 8e-6, (500, 5000)), ("8 um", 8e-6, (20, 400))):
        rng = np.random.default_rng(SEED)
        scenes = [replace(s, clearance=clearance, load=rng.uniform(*loads)) for s in random_scenes(count, rough=False)]
        accelerated = [simulate(s) for s in scenes]
        tight = [simulate(s, tolerance=1e-9) for s in scenes]
        pairs = [(a, b) for a, b in zip(accelerated, tight, strict=True) if a.status == b.status == "converged"]
        plain = [_plain_periods(s, 1e-5) for s in scenes]
        rows.append(
            {
                "clearance": name,
                "load N": f"{loads[0]} to {loads[1]}",
                "periods median": float(np.median([r.periods for r in accelerated])),
                "periods max": max(r.periods for r in accelerated),
                "simulating on, median": float(np.median(plain)),
                "simulating on, max": max(plain),
                "error max": max(abs(a.rms / b.rms - 1.0) for a, b in pairs),
                "not periodic": sum(r.status == "not_periodic" for r in accelerated),
            }
        )
    return rows


def _plain_periods(scene: Scene, tolerance: float) -> int:
    """Return after how many periods of plain simulation the RMS stays within the tolerance of its settled value."""
    period = prepare(scene)
    orbit = find_orbit(period, tolerance=1e-9, max_periods=300)
    level = float(np.sqrt(period.weight @ orbit.waves[-1][:, 0] ** 2))
    state, wave, last = np.zeros((2, len(STATE_SCALE))), period.new_wave(), 0
    for n in range(1, 121):
        state, _ = period.run(state, wave)
        if abs(math.sqrt(period.weight @ wave[:, 0] ** 2) / level - 1.0) > tolerance:
            last = n
    return last + 1


def map_row(points: int) -> Row:
    """Return the time and error of the map that the tracker of the thesis needs for one load."""
    plan = MapPlan(
        load=(4000.0,),
        speed=(40.0,),
        h_d=tuple(np.linspace(0.0, 32e-6, 33).tolist()),
        dphi_d=tuple(np.radians(np.linspace(0.0, 50.0, 51)).tolist()),
        rms_band=(0.0, 9500.0),
    )
    start, cpu = time.perf_counter(), time.thread_time()
    built = build_map(plan)
    seconds, cpu = time.perf_counter() - start, time.thread_time() - cpu
    check = check_map(built, points)
    return {
        "nodes": built.rms.size,
        "seconds": seconds,
        "cpu seconds": cpu,
        "ms a node": 1e3 * cpu / built.rms.size,
        "error rms": check.error_rms,
        "error max": check.error_max,
        "between nodes rms (of the maximum)": check.interpolation_rms,
        "max": check.interpolation_max,
    }


def kernel_row() -> Row:
    """Return the time of one ball period in the kernel, and of this machine's calibration transform."""
    period = prepare(Scene(40.0, 4000.0, defect=Defect(math.radians(20.0), 20e-6)))
    state, wave = np.zeros((2, 6)), period.new_wave()
    for _ in range(20):
        state, _ = period.run(state, wave)
    times = interleaved_ms({"kernel": lambda: period.run(state, wave), "fft": calibration_kernel()}, 101)
    return {
        "steps": period.steps,
        "ms a ball period": times["kernel"],
        "ms a simulated second": times["kernel"] / period.duration,
        "calibration FFT ms": times["fft"],
    }


def main() -> None:
    """Print the tables and write the JSON file if one was asked for."""
    options = arguments("Six-degree-of-freedom model: error against time.")
    simulate(Scene(40.0, 4000.0))
    tables = {
        "reference": reference_rows(2 if options.quick else 6),
        "errors": error_rows(40 if options.quick else 240),
        "settling": settling_rows(12 if options.quick else 40),
        "map": [map_row(40 if options.quick else 200)],
        "kernel": [kernel_row()],
    }
    for title, rows in tables.items():
        print_table(title, rows)
    write_json(options.json, tables)


if __name__ == "__main__":
    main()
