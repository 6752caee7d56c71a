"""The periodic engine away from the thesis' bench: error against time, family by family.

Run as ``python -m benchmarks.engine.families [--quick] [--json FILE]``. Each family varies what its name says; all else
is as in benchmarks/six_dof.py (thesis' rig and bearing, 15 to 50 Hz, 500 to 5000 N, 0.8 to 50 degrees, 1 to 32 um). The
reference is the same engine at REFERENCE_ACCURACY, whose own estimate is stated; reference/periodic holds the
engine against code that shares nothing with it. Times are thread CPU time at an operating point already seen.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from benchmarks.common import Row, Tables, benchmark, calibration_kernel, interleaved_ms
from benchmarks.six_dof import ACCURACIES, random_scenes
from models.machine.bearing import catalogue_entry
from models.machine.contact_estimates import element_mass, estimate_stiffness
from models.machine.rig import Rig
from models.machine.scene import Defect, Scene
from models.solve.simulate import simulate
from reference.periods import solve_scene

SEED = 12
REFERENCE_ACCURACY = 1e-5
_ROUNDS = 3

Change = Callable[[Scene, np.random.Generator], Scene]


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return math.exp(rng.uniform(math.log(low), math.log(high)))


def _extent(scene: Scene, rng: np.random.Generator) -> Scene:
    defect = scene.defect
    assert defect is not None
    return replace(scene, defect=replace(defect, dphi_d=math.radians(_log_uniform(rng, 0.05, 0.8))))


def _rig(scene: Scene, rng: np.random.Generator) -> Scene:
    rig, changes = scene.rig, {}
    for name in ("m_i", "m_o", "m_r"):
        changes[name] = getattr(rig, name) * _log_uniform(rng, 0.03, 10.0)
    for name in ("k_i", "k_r", "k_c", "c_i", "c_r", "beta_c"):
        changes[name] = getattr(rig, name) * _log_uniform(rng, 0.1, 10.0)
    return replace(scene, rig=replace(rig, **changes))


def _bearing(names: tuple[str, ...]) -> Change:
    def change(scene: Scene, rng: np.random.Generator) -> Scene:
        found = estimate_stiffness(catalogue_entry(names[int(rng.integers(len(names)))]))
        rig = Rig(k_c=found.value, m_b=element_mass(found.bearing), element=found.bearing.element)
        return replace(scene, bearing=found.bearing, rig=rig)

    return change


FAMILIES: dict[str, Change] = {
    "as in six_dof": lambda scene, rng: scene,
    "0.5 to 5 Hz": lambda scene, rng: replace(scene, speed=_log_uniform(rng, 0.5, 5.0)),
    "100 to 400 Hz": lambda scene, rng: replace(scene, speed=_log_uniform(rng, 100.0, 400.0)),
    "1 to 100 N, clearance 5 um": lambda scene, rng: replace(scene, load=_log_uniform(rng, 1.0, 100.0), clearance=5e-6),
    "0.05 to 0.8 degrees": _extent,
    "masses x 0.03 to 10, stiffness and damping x 0.1 to 10": _rig,
    "other ball bearings": _bearing(("6205", "6305", "6210", "7206", "1210")),
    "roller bearings": _bearing(("NU205", "22207", "30206")),
}


def family_rows(name: str, count: int) -> list[Row]:
    """Return errors and times of a family for each accuracy that can be asked for."""
    rng, change = np.random.default_rng(SEED), FAMILIES[name]
    scenes = [change(scene, rng) for scene in random_scenes(count, rough=False, seed=SEED)]
    found = [simulate(scene, accuracy=REFERENCE_ACCURACY) for scene in scenes]
    fine = [(s, r) for s, r in zip(scenes, found, strict=True) if r.repeats]
    rows: list[Row] = []
    for accuracy in ACCURACIES:
        answers = [simulate(scene, accuracy=accuracy) for scene, _ in fine]
        errors = np.array([a.rms / r.rms - 1.0 for a, (_, r) in zip(answers, fine, strict=True)])
        bounds = np.array([a.rms_error + r.rms_error for a, (_, r) in zip(answers, fine, strict=True)])
        rows.append(
            {
                "family": name,
                "asked for": accuracy,
                "scenes": len(fine),
                "not periodic": count - len(fine),
                "steps, median": float(np.median([solve_scene(s, accuracy).steps for s, _ in fine])),
                "RMS error rms": float(np.sqrt(np.mean(errors**2))),
                "max": float(np.abs(errors).max()),
                "estimate bounds it": float(np.mean(np.abs(errors) <= bounds)),
                "inaccurate": sum(a.status == "inaccurate" for a in answers),
                "ms, median": float(np.median([_ms(s, accuracy) for s, _ in fine])),
                "ms, most": max(_ms(s, accuracy) for s, _ in fine),
                "estimate of the reference, most": max(r.rms_error for _, r in fine),
                "calibration FFT ms": interleaved_ms({"fft": calibration_kernel()}, 11)["fft"],
            }
        )
    return rows


def _ms(scene: Scene, accuracy: float) -> float:
    times = []
    for _ in range(_ROUNDS):
        start = time.thread_time()
        simulate(scene, accuracy=accuracy)
        times.append(1e3 * (time.thread_time() - start))
    return float(np.median(times))


@benchmark("The periodic engine away from the thesis' bench.")
def main(quick: bool) -> Tables:
    """Print the table and write the JSON file if one was asked for."""
    simulate(Scene(40.0, 4000.0, defect=Defect(0.1, 1e-5)))
    rows = [row for name in FAMILIES for row in family_rows(name, 4 if quick else 16)]
    return {"families": rows}
