"""The six-degree-of-freedom model: error against time.

Run as ``python -m benchmarks.six_dof [--quick] [--json FILE]``. All times are thread CPU time unless they say "wall".

1. reference: 8192 steps per ball period against twice as many; tests/models/solve holds the model against DOP853;
2. settled scenes: error of RMS, line amplitudes and peak against that reference over random scenes (0.8 to 50 degrees,
   half of them up to 15; 1 to 32 um; 500 to 5000 N; 15 to 50 Hz) for each accuracy that can be asked for, beside the
   time of a scene, set-up and lines included: at an operating point seen for the first time, and at one already seen;
3. integrated: the time of one second that is really integrated, period by period, at the same steps and at the fewest
   whose level is still within what was asked for;
4. settling: ball periods until the RMS has settled, with the accelerated search and by simulating on;
5. map: 51 x 33 nodes at four loads and 40 Hz, beside its error at random nodes;
6. lanes: many scenes at once, as maps with slip take them, in whole steps and with parts where contacts change: errors
   of RMS and lines (over the largest) against settled answers, and time of a scene until its blocks change by 3e-3;
7. cores: the speed-up of the map on two threads beside that of two processes of the calibration transform, in turns.
"""

from __future__ import annotations

import math
import multiprocessing
import os
import time
from collections.abc import Callable
from dataclasses import replace
from multiprocessing.context import SpawnContext
from multiprocessing.synchronize import Barrier

import numpy as np
from numpy.typing import NDArray

from benchmarks.common import Row, Tables, benchmark, calibration_kernel, interleaved_ms
from models.machine.scene import Defect, Floor, Scene
from models.maps.build import build_map
from models.maps.check import check_map
from models.maps.data import RmsMap
from models.maps.plan import MapPlan, scene_at
from models.solve.response import Response
from models.solve.simulate import simulate
from models.solve.six_dof.kernels.lane_instants import LANES
from models.solve.six_dof.kernels.period import Period, blank_trace, mean_square
from models.solve.six_dof.kernels.settled import R_ERROR, R_RMS
from models.solve.six_dof.lanes import LaneOptions, simulate_lanes
from models.words.request import Request
from models.work.choose import local_runner
from models.work.runner import SERIAL
from reference.periods import Solved, period_of, run, simulate_plainly, solve_scene

SEED = 11
ACCURACIES = (2e-3, 1e-3, 2e-4)
REFERENCE_STEPS = 8192
ROUNDS = 7
CALIBRATION_RUNS = 3000
# Periods after which a motion that began on the orbit of another grid has come to its own.
_SETTLING = 60


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
    """Return the reference beside twice its steps."""
    rows: list[Row] = []
    for scene in random_scenes(count, rough=False, seed=SEED + 1):
        assert scene.defect is not None
        finest = simulate(scene, steps_per_period=2 * REFERENCE_STEPS, tolerance=1e-8).rms
        fine = simulate(scene, steps_per_period=REFERENCE_STEPS, tolerance=1e-8)
        rows.append(
            {
                "scene": f"{math.degrees(scene.defect.dphi_d):.1f} deg, {scene.defect.h_d * 1e6:.1f} um, "
                f"{scene.load:.0f} N, {scene.speed:.1f} Hz",
                "twice the steps m/s2": finest,
                "reference/twice - 1": fine.rms / finest - 1.0,
                "default/twice - 1": simulate(scene).rms / finest - 1.0,
            }
        )
    return rows


def error_rows(count: int) -> list[Row]:
    """Return errors and times for each accuracy that can be asked for, smooth and rough floors apart."""
    rows: list[Row] = []
    for rough in (False, True):
        scenes = random_scenes(count, rough=rough)
        fine = [simulate(s, steps_per_period=REFERENCE_STEPS, tolerance=1e-7) for s in scenes]
        rows.extend(_error_row(scenes, fine, accuracy, rough=rough) for accuracy in ACCURACIES)
    return rows


def _error_row(scenes: list[Scene], fine: list[Response], accuracy: float, *, rough: bool) -> Row:
    # A load that differs in its last digits is an operating point that no cache knows.
    fresh = [replace(s, load=s.load * (1.0 + 1e-9 * accuracy)) for s in scenes]
    # Rough floors are drawn beforehand: they are many, and the same for every scene that has them.
    found = [simulate(s, accuracy=accuracy) for s in scenes]
    first = _times_ms(fresh, accuracy)
    seen = np.median([_times_ms(fresh, accuracy) for _ in range(ROUNDS)], axis=0)
    rms = np.array([a.rms / b.rms - 1.0 for a, b in zip(found, fine, strict=True)])
    resonator = np.array([a.levels_of("mr")[0] / b.levels_of("mr")[0] - 1.0 for a, b in zip(found, fine, strict=True)])
    lines = np.array([np.abs(a.harmonics - b.harmonics).max() / b.rms for a, b in zip(found, fine, strict=True)])
    peak = np.array([a.peak / b.peak - 1.0 for a, b in zip(found, fine, strict=True)])
    return {
        "floor": "rough" if rough else "smooth",
        "asked for": accuracy,
        "steps": float(np.median([solve_scene(s, accuracy).steps for s in scenes])),
        "RMS error rms": float(np.sqrt(np.mean(rms**2))),
        "p99": float(np.quantile(np.abs(rms), 0.99)),
        "max": float(np.abs(rms).max()),
        "m_r max": float(np.abs(resonator).max()),
        "lines max": float(lines.max()),
        "peak max": float(np.abs(peak).max()),
        "estimate bounds it": float(np.mean(np.abs(rms) <= [r.rms_error + 0.05 * accuracy for r in found])),
        "periods": float(np.mean([r.periods for r in found])),
        "ms first": float(np.median(first)),
        "ms seen": float(np.median(seen)),
        "not converged": sum(r.status != "converged" for r in found),
    }


def _times_ms(scenes: list[Scene], accuracy: float) -> list[float]:
    times = []
    for scene in scenes:
        start = time.thread_time()
        simulate(scene, accuracy=accuracy)
        times.append(1e3 * (time.thread_time() - start))
    return times


def integrated_rows(count: int) -> list[Row]:
    """Return the time of one integrated second over random scenes, settled before it is timed.

    At the steps with which a settled scene ends, and at the coarsest grid of its search whose level is within what was
    asked for, as the level and the error estimate of the last grid show: a scene must be solved once to know it.
    """
    rows: list[Row] = []
    for accuracy in ACCURACIES:
        found: list[dict[str, float]] = []
        for scene in random_scenes(count, rough=False):
            solved = solve_scene(scene, accuracy)
            duration = float(solved.period.time[-1])
            periods = max(1, round(0.25 / duration))
            coarse = _coarsest(scene, solved, accuracy)
            times = interleaved_ms(
                {
                    "last": lambda p=solved.period, s=solved.state, n=periods: _second(p, s, n),
                    "coarsest": lambda p=coarse, s=solved.state, n=periods: _second(p, s, n),
                    "fft": calibration_kernel(),
                },
                ROUNDS,
            )
            found.append({name: times[name] / (periods * duration) for name in ("last", "coarsest")})
            found[-1] |= {"fft": times["fft"], "share": len(coarse.nodes.turn) / len(solved.period.nodes.turn)}
        rows.append(
            {
                "asked for": accuracy,
                "ms a second, median": float(np.median([f["coarsest"] for f in found])),
                "max": max(f["coarsest"] for f in found),
                "share of the last grid's steps": float(np.median([f["share"] for f in found])),
                "at the last grid": float(np.median([f["last"] for f in found])),
                "calibration FFT ms": float(np.median([f["fft"] for f in found])),
            }
        )
    return rows


def _coarsest(scene: Scene, solved: Solved, accuracy: float) -> Period:
    """Return the coarsest grid of a scene whose settled level is within ``accuracy`` of the true one."""
    level, error, fold = float(solved.found[R_RMS]), float(solved.found[R_ERROR]), 1
    while True:
        period = period_of(scene, fold=fold)
        if len(period.nodes.turn) >= solved.steps:
            return solved.period
        there = simulate_plainly(period, _SETTLING, _SETTLING - 1, solved.state).mean
        if abs(there / level - 1.0) + error <= accuracy:
            return period
        fold *= 2


def _second(period: Period, state: NDArray[np.float64], periods: int) -> tuple[NDArray[np.float64], float]:
    """Integrate some periods; return the state and the mean square."""
    trace, total = blank_trace(period), 0.0
    for _ in range(periods):
        state = run(period, state, trace)
        total += mean_square(trace, 0)
    return state, total / periods


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
                "not periodic": sum(not r.repeats for r in accelerated),
            }
        )
    return rows


def _plain_periods(scene: Scene, tolerance: float) -> int:
    """Return after how many periods of plain simulation the RMS stays within the tolerance of its settled value."""
    period = solve_scene(scene, Request.accuracy, 1e-9).period
    levels = simulate_plainly(period, 320, 0).levels
    # Where the motion does not repeat, its level never stays.
    off = np.flatnonzero(np.abs(levels[:120] / levels[-1] - 1.0) > tolerance)
    return int(off[-1]) + 2 if len(off) else 1


def _plan(loads: tuple[float, ...] = (3000.0, 4000.0, 4700.0, 5000.0)) -> MapPlan:
    return MapPlan(
        load=loads,
        speed=(40.0,),
        h_d=tuple(np.linspace(0.0, 32e-6, 33).tolist()),
        dphi_d=tuple(np.radians(np.linspace(0.0, 50.0, 51)).tolist()),
        rms_band=(0.0, 9500.0),
    )


def map_row(points: int) -> Row:
    """Return time and error of the maps that the tracker of the thesis needs: four loads, a band of 9.5 kHz."""
    plan = _plan()
    times, ffts = [], []
    for _ in range(ROUNDS):
        start = time.thread_time()
        built = build_map(plan)
        times.append(time.thread_time() - start)
        ffts.append(interleaved_ms({"fft": calibration_kernel()}, 11)["fft"])
    built, seconds = build_map(plan), float(np.median(times))
    errors = np.abs([_node_error(built, plan, n) for n in range(points)])
    check = check_map(built, min(points, 100))
    return {
        "nodes": built.rms.size,
        "cpu seconds": seconds,
        "ms a node": 1e3 * seconds / built.rms.size,
        "calibration FFT ms": float(np.median(ffts)),
        "random nodes": points,
        "error rms": float(np.sqrt(np.mean(errors**2))),
        "median": float(np.median(errors)),
        "p99": float(np.quantile(errors, 0.99)),
        "max": float(errors.max()),
        "own estimate": float(np.median(built.rms_error[built.rms > 0.0] / built.rms[built.rms > 0.0])),
        "between nodes rms (of the maximum)": check.interpolation_rms,
        "between nodes max": check.interpolation_max,
    }


def _node_error(built: RmsMap, plan: MapPlan, n: int) -> float:
    """Return the relative error of the n-th random node, every other one of them between 1 and 15 degrees."""
    rng = np.random.default_rng((SEED, n))
    i, k = int(rng.integers(len(plan.load))), int(rng.integers(1, len(plan.h_d)))
    d = int(rng.integers(1, 16 if n % 2 else len(plan.dphi_d)))
    scene = scene_at(plan, plan.load[i], plan.speed[0], plan.h_d[k], plan.dphi_d[d])
    fine = simulate(scene, steps_per_period=4096, tolerance=1e-7, band=plan.rms_band)
    return float(built.rms[i, 0, k, d]) / fine.rms - 1.0


def lane_rows(groups: int) -> list[Row]:
    """Return error and time of scenes side by side, by steps in a ball period, 40 Hz."""
    scenes = [
        replace(s, speed=40.0) for rough in (False, True) for s in random_scenes(groups * LANES // 2, rough=rough)
    ]
    fine = [simulate(s, accuracy=1e-6, quantity="lines") for s in scenes]
    true, lines = np.array([r.rms for r in fine]), np.array([r.harmonics for r in fine])
    rows: list[Row] = []
    for steps in (144, 192, 256, 384, 512):
        for instants in (False, True):
            options = LaneOptions(steps, 1e-5, instants=instants)
            found = simulate_lanes(scenes, options)
            rms, off = found.rms / true - 1.0, np.abs(found.harmonics - lines).max(axis=1) / lines.max(axis=1)
            start = time.thread_time()
            simulate_lanes(scenes, replace(options, tolerance=3e-3))
            rows.append(
                {
                    "steps": steps,
                    "in parts": "yes" if instants else "no",
                    "RMS error rms": float(np.sqrt(np.mean(rms**2))),
                    "max": float(np.abs(rms).max()),
                    "lines rms": float(np.sqrt(np.mean(off**2))),
                    "lines max": float(off.max()),
                    "ms a scene": 1e3 * (time.thread_time() - start) / len(scenes),
                }
            )
    return rows


def core_row(rounds: int) -> Row:
    """Return speed-ups by two cores: the map's on threads, and what the machine gives to two processes just then."""
    plan = _plan((4000.0, 5000.0))
    build_map(plan)
    context = multiprocessing.get_context("spawn")
    threads, processes = [], []
    for _ in range(rounds):
        with local_runner(2) as runner:
            one, two = (_wall(lambda r=r: build_map(plan, runner=r)) for r in (SERIAL, runner))
        threads.append(one / two)
        alone, both = (_calibration_wall(context, count) for count in (1, 2))
        processes.append(2.0 * alone / both)
    return {
        "map, 2 threads": float(np.median(threads)),
        "2 processes of the calibration kernel": float(np.median(processes)),
        "share": float(np.median(np.array(threads) / np.array(processes))),
        "load average": os.getloadavg()[0],
    }


def _wall(function: Callable[[], object]) -> float:
    start = time.perf_counter()
    function()
    return time.perf_counter() - start


def _calibrate(barrier: Barrier) -> None:
    execute = calibration_kernel()
    execute()
    barrier.wait()
    for _ in range(CALIBRATION_RUNS):
        execute()
    barrier.wait()


def _calibration_wall(context: SpawnContext, count: int) -> float:
    """Return the wall time in which ``count`` processes each run the calibration kernel, their start left out."""
    barrier = context.Barrier(count + 1)
    workers = [context.Process(target=_calibrate, args=(barrier,)) for _ in range(count)]
    for worker in workers:
        worker.start()
    barrier.wait()
    start = time.perf_counter()
    barrier.wait()
    seconds = time.perf_counter() - start
    for worker in workers:
        worker.join()
    return seconds


@benchmark("Six-degree-of-freedom model: error against time.")
def main(quick: bool) -> Tables:
    """Print the tables and write the JSON file if one was asked for."""
    simulate(Scene(40.0, 4000.0))
    return {
        "reference": reference_rows(2 if quick else 4),
        "settled scenes": error_rows(40 if quick else 240),
        "integrated": integrated_rows(5 if quick else 20),
        "settling": settling_rows(12 if quick else 24),
        "map": [map_row(40 if quick else 400)],
        "lanes": lane_rows(2 if quick else 8),
        "cores": [core_row(1 if quick else 3)],
    }
