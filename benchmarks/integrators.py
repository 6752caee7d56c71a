"""Work-precision diagram of integrators of the six-degree-of-freedom model.

Run as ``python -m benchmarks.integrators [--quick] [--json FILE] [--document FILE]``. On five scenes, each method at
several steps or tolerances: relative error of RMS and waveform of the casing's acceleration along the load, beside the
thread time of an integrated second (median of seven; solve_ivp once). What is compared is in benchmarks/opponents.py,
how in benchmarks/work_precision.py. ``--document`` renews the tables of docs/evidence/speed-against-error.md and the
diagram beside it.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from benchmarks.common import Row, calibration_kernel, interleaved_ms, print_table, write_json
from benchmarks.speed_page import renew
from benchmarks.work_precision import (
    DT0,
    SCALE,
    SCENES,
    Problem,
    Run,
    run_dormand_prince,
    run_lawson,
    run_multistep,
    run_product,
    run_rk4,
    run_scipy,
)
from models.solve.simulate import simulate
from tests.support.periods import solve_scene

Attempt = tuple[str, str, Callable[[], Run], int]

ACCURACIES = (5e-3, 2e-3, 1e-3, 2e-4)
FACTORS = (2.0, 1.0, 0.5, 0.25, 0.125)
LAWSON = {
    "Lawson, equal steps": (False, False, False),
    "Lawson, steps on kinks": (True, False, False),
    "Lawson, kinks, one-sided": (True, True, False),
    "Lawson, kinks, one-sided, contacts": (True, True, True),
}
SCIPY = ("RK23", "RK45", "DOP853", "LSODA", "BDF", "Radau")


def attempts(problem: Problem, quick: bool) -> Iterator[Attempt]:
    """Yield name, setting, work and rounds of every method and setting."""
    for factor in (1.0, 0.25) if quick else FACTORS:
        step, label = factor * DT0, f"{1e6 * factor * DT0:.1f} us"
        yield "explicit RK4, equal steps", label, run_rk4(problem, step, landed=False), 7
        yield "explicit RK4, kinks, one-sided", label, run_rk4(problem, step, landed=True), 7
        for name, (landed, sided, refined) in LAWSON.items():
            work = run_lawson(problem, step, landed=landed, sided=sided, refined=refined)
            yield name, label, work, 7
        yield "ETD-AB3, equal steps", label, run_multistep(problem, step, 3), 7
        yield "ETD-AB4, equal steps", label, run_multistep(problem, step, 4), 7
    for factor in FACTORS:
        step = factor * DT0
        count = max(8, int(np.ceil(problem.period / step)))
        yield "this project's kernel", f"{1e6 * step:.1f} us", run_product(problem, count), 7
    matlab = np.full(12, 1e-6)
    yield "Dormand-Prince 5(4)", "rtol 1e-3, atol 1e-6", run_dormand_prince(problem, 1e-3, matlab), 7
    for rtol in (1e-4, 1e-6) if quick else (1e-3, 1e-4, 1e-5, 1e-6, 1e-7):
        yield "Dormand-Prince 5(4)", f"rtol {rtol:.0e}, scaled", run_dormand_prince(problem, rtol, rtol * SCALE), 7
    for method in SCIPY[1:4] if quick else SCIPY:
        yield f"solve_ivp {method}", "rtol 1e-3, atol 1e-6", run_scipy(problem, method, 1e-3, 1e-6), 1
        for rtol in (1e-5,) if quick else (1e-4, 1e-5, 1e-6):
            yield f"solve_ivp {method}", f"rtol {rtol:.0e}, scaled", run_scipy(problem, method, rtol, rtol * SCALE), 1


def measure(quick: bool) -> dict[str, list[Row]]:
    """Return the tables: references beside DOP853, every method on every scene, and what simulate() makes of them."""
    references: list[Row] = []
    rows: list[Row] = []
    settled: list[Row] = []
    fft = calibration_kernel()
    for name, scene in list(SCENES.items())[1:3] if quick else SCENES.items():
        problem = Problem(scene)
        rms, wave = problem.against_oracle()
        calibration = interleaved_ms({"fft": fft}, 51)["fft"]
        references.append(
            {
                "scene": name,
                "RMS m/s2": problem.rms,
                "BPFO Hz": 1.0 / problem.period,
                "RMS against DOP853": rms,
                "waveform against DOP853": wave,
                "calibration FFT ms": calibration,
            }
        )
        rows += runs_of(name, problem, quick)
        settled += settled_of(name, problem)
    return {"references": references, "runs": rows, "settled": settled}


def runs_of(name: str, problem: Problem, quick: bool) -> list[Row]:
    """Return every method and setting on one scene."""
    rows: list[Row] = []
    for method, setting, work, rounds in attempts(problem, quick):
        found = problem.judge(work, rounds)
        rows.append(
            {
                "scene": name,
                "method": method,
                "setting": setting,
                "RMS error": found.rms_error,
                "waveform error": found.wave_error,
                "evaluations a second": found.evaluations_per_s,
                "ms a second": found.ms_per_s,
            }
        )
    return rows


def settled_of(name: str, problem: Problem) -> list[Row]:
    """Return the RMS that simulate() gives for some accuracies, quadrature over one period included."""
    rows: list[Row] = []
    for accuracy in ACCURACIES:
        found = simulate(problem.scene, accuracy=accuracy, tolerance=1e-8)
        rows.append(
            {
                "scene": name,
                "accuracy": accuracy,
                "steps a period": solve_scene(problem.scene, accuracy, 1e-8).steps,
                "RMS error": found.rms / problem.rms - 1.0,
                "estimate": found.rms_error,
            }
        )
    return rows


def main() -> None:
    """Print the tables; write the JSON file and renew the document if they were asked for."""
    parser = argparse.ArgumentParser(description="Error against time of integrators.")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the same figures to this file")
    parser.add_argument("--quick", action="store_true", help="two scenes and fewer settings: ends within a minute")
    parser.add_argument("--document", type=Path, metavar="FILE", help="renew the tables and the diagram of this page")
    options = parser.parse_args()
    tables = measure(options.quick)
    for title, rows in tables.items():
        print_table(title, rows)
    write_json(options.json, tables)
    if options.document is not None:
        renew(options.document, tables)


if __name__ == "__main__":
    main()
