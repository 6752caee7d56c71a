"""The settled six-degree-of-freedom motion, period by period, with the problems of ``benchmarks.work_precision``.

``benchmarks.integrators`` compares more integrators on more scenes; ``benchmarks.six_dof`` has the time of a settled
scene.
"""

from __future__ import annotations

import math

from benchmarks.common import Row
from benchmarks.models.integrated import OverTimeProblem
from benchmarks.models.problem import Setting, solved
from benchmarks.work_precision import DT0, SCALE, SCENES, Judged, Problem, run_product, run_scipy
from models.machine.scene import Scene

MODEL = "six_dof, periodic"
SETTINGS = (
    Setting("RK45", 1e-6),
    Setting("RK45", 1e-7),
    Setting("DOP853", 1e-6),
    Setting("DOP853", 1e-7),
    Setting("LSODA", 1e-6),
    Setting("LSODA", 1e-7),
)
_ROUNDS = 7


def _row(name: str, step: float, found: Judged) -> Row:
    return {
        "model": MODEL,
        "scene": name,
        "step us": 1e6 * step,
        "error": found.wave_error,
        "peak error": None,
        "ms per s": found.ms_per_s,
    }


def _ours(name: str, problem: Problem, step: float) -> Row:
    return _row(name, step, problem.judge(run_product(problem, max(8, math.ceil(problem.period / step))), _ROUNDS))


def cost_rows(name: str, problem: Problem) -> list[Row]:
    """Return time and error of some steps."""
    return [_ours(name, problem, factor * DT0) for factor in (2.0, 1.0, 0.5)]


def against(name: str, problem: Problem, *, quick: bool) -> Row:
    """Return the kernel's cost at the thesis' step beside those of scipy and plain Python."""
    ours = _ours(name, problem, DT0)
    mine, wanted = float(str(ours["ms per s"])), float(str(ours["error"]))
    best: tuple[Setting, Judged] | None = None
    for setting in SETTINGS[2:4] if quick else SETTINGS:
        run = run_scipy(problem, setting.method, setting.tolerance, setting.tolerance * SCALE)
        found = problem.judge(run, 1)
        if found.wave_error <= wanted and (best is None or found.ms_per_s < best[1].ms_per_s):
            best = setting, found
    plain = None if best is None else _plain(problem.scene, name, best[0])
    return {
        **ours,
        "scipy": None if best is None else str(best[0]),
        "scipy error": None if best is None else best[1].wave_error,
        "error there": wanted,
        "scipy ms per s": None if best is None else best[1].ms_per_s,
        "times scipy": None if best is None else best[1].ms_per_s / mine,
        "plain ms per s": plain,
        "times plain": None if plain is None else plain / mine,
        "prototype ms per s": None,
        "share of prototype": None,
    }


def _plain(scene: Scene, name: str, setting: Setting) -> float:
    other = OverTimeProblem(name, scene.speed, scene.load, scene.defect)
    return 1e3 * solved(setting, other.plain(), other.grid, other.plain_span)[0]


def problems(*, quick: bool) -> dict[str, Problem]:
    """Return the problems, with their names."""
    names = ("D2, 2 kN, 30 Hz",) if quick else ("healthy, 4 kN", "D2, 2 kN, 30 Hz", "20 deg, 20 um, smooth")
    return {name: Problem(SCENES[name]) for name in names}
