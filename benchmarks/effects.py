"""Effects of a scene over time: what each costs, and its error.

Run as ``python -m benchmarks.effects [--quick] [--json FILE]``. Three tables:

1. thread time of the kernel per simulated second with each effect, over that of the healthy bearing, and of setting up;
2. error of RMS and waveform at several steps against steps of 0.6 us, with the time of a simulated second;
3. the waveform from rest at the default step against scipy's DOP853 on an independent writing of the equations.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from benchmarks.common import Row, arguments, calibration_kernel, interleaved_ms, print_table, write_json
from models.machine.scene import Defect, Floor, Scene, Slip, Waviness
from models.machine.speed_profile import hunt, ramp
from models.solve.six_dof.kernels import time_domain as kernels
from models.solve.six_dof.kernels.step import P_DIRECTION_1, P_DIRECTION_2
from models.solve.six_dof.time_domain import DEFAULT_STEP, prepare_plan, simulate_time
from tests.oracles.time_domain_oracle import Case, Oracle, Turning

RATE = 51200.0
REFERENCE_STEP = 0.625e-6
HEALTHY = Scene(40.0, 4000.0)
PIT, SPALL = Defect(math.radians(4.0), 5e-4), Defect(math.radians(20.0), 2e-5)

SCENES = {
    "healthy": HEALTHY,
    "gravity": replace(HEALTHY, gravity=9.80665, gravity_angle=1.0),
    "unbalance 1 kg mm": replace(HEALTHY, unbalance=1e-3),
    "waviness, one race": replace(HEALTHY, waviness=(Waviness(1e-6, 13),)),
    "waviness, both races": replace(HEALTHY, waviness=(Waviness(1e-6, 13), Waviness(5e-7, 7, "inner"))),
    "outer, 4 deg pit": replace(HEALTHY, defect=PIT),
    "outer, with slip": replace(HEALTHY, defect=PIT, slip=Slip(0.0173)),
    "inner, 4 deg pit": replace(HEALTHY, defect=replace(PIT, part="inner")),
    "inner, 20 deg rough spall": replace(HEALTHY, defect=replace(SPALL, part="inner", floor=Floor("rough"))),
    "inner, both rows": replace(HEALTHY, defect=replace(PIT, part="inner", rows=2)),
    "ball, 16 deg pit": replace(HEALTHY, defect=replace(PIT, part="ball", dphi_d=math.radians(16.0))),
    "outer, 4 deg pit, 20 to 60 Hz": replace(HEALTHY, defect=PIT, speed_profile=ramp(20.0, 60.0, 1.0)),
    "inner, 4 deg pit, ±10 %": replace(
        HEALTHY, defect=replace(PIT, part="inner"), speed_profile=hunt(40.0, 0.1, 0.5, 2.0)
    ),
    "all of them": replace(
        HEALTHY,
        defect=replace(PIT, part="inner"),
        slip=Slip(0.0173),
        unbalance=1e-3,
        gravity=9.80665,
        clearance=5e-6,
        waviness=(Waviness(5e-7, 7, "inner"),),
    ),
}

ORACLE_CASES = {
    "inner, 5.7 deg pit": (Case(40.0, 4000.0, "inner", 0.1, 5e-4), Defect(0.1, 5e-4, part="inner")),
    "inner, 29 deg, 20 um": (Case(40.0, 4000.0, "inner", 0.5, 2e-5), Defect(0.5, 2e-5, part="inner")),
    "ball, 17 deg pit": (Case(40.0, 4000.0, "ball", 0.3, 1e-3), Defect(0.3, 1e-3, part="ball")),
    "ball, 34 deg, 10 um": (Case(40.0, 4000.0, "ball", 0.6, 1e-5), Defect(0.6, 1e-5, part="ball")),
}
# Speeds that change far faster than those of machines, so that 30 ms show it: 2000 Hz/s, and 30 % at 60 Hz.
_RISING, _SWINGING = Turning(slope=4000.0 * math.pi), Turning(swing=24.0 * math.pi, pace=120.0 * math.pi)
CHANGING_CASES = {
    "outer, 5.7 deg pit, run-up": (
        Case(40.0, 4000.0, "outer", 0.1, 5e-4, turning=_RISING),
        replace(HEALTHY, defect=Defect(0.1, 5e-4), speed_profile=ramp(40.0, 140.0, 0.05)),
    ),
    "inner, 11 deg, 30 um, hunting": (
        Case(40.0, 4000.0, "inner", 0.2, 3e-5, turning=_SWINGING),
        replace(HEALTHY, defect=Defect(0.2, 3e-5, part="inner"), speed_profile=hunt(40.0, 0.3, 60.0, 0.05)),
    ),
    "ball, 34 deg, 10 um, run-up": (
        Case(40.0, 4000.0, "ball", 0.6, 1e-5, turning=_RISING),
        replace(HEALTHY, defect=Defect(0.6, 1e-5, part="ball"), speed_profile=ramp(40.0, 140.0, 0.05)),
    ),
    "unbalance of 2 kg mm, hunting": (
        Case(40.0, 4000.0, unbalance=2e-3, turning=_SWINGING),
        replace(HEALTHY, unbalance=2e-3, speed_profile=hunt(40.0, 0.3, 60.0, 0.05)),
    ),
}


def cost_rows(seconds: float, rounds: int) -> list[Row]:
    """Return times of the kernel alone and of setting a run up, ms per simulated second."""
    samples = round(seconds / DEFAULT_STEP)
    wave = np.empty((samples, 2))
    plans = {name: prepare_plan(scene, samples * DEFAULT_STEP) for name, scene in SCENES.items()}

    def run(plan: kernels.Plan) -> None:
        kernels.run(np.zeros((2, 6)), wave, DEFAULT_STEP, plan)

    calls: dict[str, Callable[[], object]] = {name: partial(run, plan) for name, plan in plans.items()}
    times = interleaved_ms({"calibration": calibration_kernel(), **calls}, rounds)
    set_up = interleaved_ms({name: partial(prepare_plan, scene, seconds) for name, scene in SCENES.items()}, rounds)
    calibration = times.pop("calibration")
    return [
        {
            "effect": name,
            "kernel ms/s": ms / seconds,
            "over healthy": ms / times["healthy"],
            "set-up ms/s": set_up[name] / seconds if name in set_up else None,
            "calibration ms": calibration,
        }
        for name, ms in times.items()
    ]


def step_rows(seconds: float, rounds: int) -> list[Row]:
    """Return errors against the reference step, and times."""
    names = ("outer, 4 deg pit", "inner, 4 deg pit", "inner, 20 deg rough spall", "ball, 16 deg pit", "all of them")
    fine = {name: simulate_time(SCENES[name], seconds, RATE, step=REFERENCE_STEP, settle=0.2) for name in names}
    rows: list[Row] = []
    for step in (10e-6, 5e-6, 2.5e-6):
        found = {name: simulate_time(SCENES[name], seconds, RATE, step=step, settle=0.2) for name in names}
        levels = np.array([found[n].rms / fine[n].rms - 1.0 for n in names])
        waves = [
            relative(low_passed(found[n].acceleration(RATE, seconds)), low_passed(fine[n].acceleration(RATE, seconds)))
            for n in names
        ]
        timed = interleaved_ms(
            {n: partial(simulate_time, SCENES[n], seconds, RATE, step=step, settle=0.2) for n in names[:3]},
            rounds,
        )
        rows.append(
            {
                "step us": 1e6 * 1.0 / (RATE * max(2, math.ceil(1.0 / (RATE * step) - 1e-9))),
                "RMS error, rms": float(np.sqrt(np.mean(levels**2))),
                "RMS error, max": float(np.max(np.abs(levels))),
                "waveform to 10 kHz, median": float(np.median(waves)),
                "waveform, max": float(np.max(waves)),
                "ms per simulated s": float(np.median(list(timed.values()))) / (seconds + 0.2),
            }
        )
    return rows


def low_passed(signal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what a signal has up to 10 kHz."""
    spectrum = np.fft.rfft(signal)
    spectrum[np.fft.rfftfreq(len(signal), 1.0 / RATE) > 10e3] = 0.0
    return np.fft.irfft(spectrum, len(signal))


def relative(found: NDArray[np.float64], truth: NDArray[np.float64]) -> float:
    """Return the RMS of a difference over the RMS of the truth."""
    return float(np.sqrt(np.mean((found - truth) ** 2) / np.mean(truth**2)))


def oracle_rows(seconds: float) -> list[Row]:
    """Return waveform errors from rest against DOP853, along and across the load."""
    samples = round(seconds / DEFAULT_STEP)
    times = np.linspace(0.0, (samples - 1) * DEFAULT_STEP, samples)
    rows: list[Row] = []
    steady = {name: (case, replace(HEALTHY, defect=defect)) for name, (case, defect) in ORACLE_CASES.items()}
    for name, (case, scene) in (steady | CHANGING_CASES).items():
        truth = Oracle(case).run(times, rtol=1e-10)
        plan = prepare_plan(scene, samples * DEFAULT_STEP)
        errors = []
        for k, direction in enumerate(((1.0, 0.0), (0.0, 1.0))):
            wave = np.empty((samples, 2))
            plan.parameter[[P_DIRECTION_1, P_DIRECTION_2]] = direction
            kernels.run(np.zeros((2, 6)), wave, DEFAULT_STEP, plan)
            errors.append(relative(wave[:, 0], truth[:, 0, k]))
        rows.append({"scene": name, "a_o along the load": errors[0], "a_o across": errors[1]})
    return rows


def main() -> None:
    """Print the tables, and write them if a file is named."""
    options = arguments("effects of a scene over time: cost and error")
    seconds, rounds = (0.25, 5) if options.quick else (1.0, 7)
    tables = {"cost": cost_rows(seconds, rounds)}
    print_table("cost of the effects, kernel at steps of 10 us", tables["cost"])
    tables["steps"] = step_rows(seconds, 3 if options.quick else 7)
    print_table("error against steps of 0.6 us", tables["steps"])
    tables["oracle"] = oracle_rows(0.01 if options.quick else 0.03)
    print_table("waveform from rest against DOP853", tables["oracle"])
    write_json(options.json, tables)


if __name__ == "__main__":
    main()
