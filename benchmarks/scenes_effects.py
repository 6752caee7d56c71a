"""What leaving out an effect costs in error and saves in time, for the page of scenes.

Each row is a scene with one effect, of a size that is usual, and the same scene without it, both by the model that
``auto`` takes: change of RMS, of A* (the first five lines of the passages over the defect, Eq. 57), and of V_eq (that
of ln RMS over the local slope of ln RMS by ln V), and processor time of either.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from benchmarks.common import Row
from benchmarks.scenes_trial import timed
from models.machine.bearing import from_catalogue
from models.machine.scene import Defect, Floor, Scene, Slip, Waviness
from models.solve.engine.motion import passage_rate
from models.solve.response import Response
from models.solve.rotor.rig import RotorRig
from models.solve.simulate import simulate, volume_slope
from models.words.request import Request

REQUEST = Request(accuracy=1e-3, duration=1.0, rate=25600.0)
CASING = Scene(30.0, 2000.0, defect=Defect(math.radians(6.0), 8e-6))
_DISC = RotorRig(m=3.0, c_n=300.0, length=0.2, a=0.1, end_mass=0.3)
ROTOR = Scene(
    30.0, 500.0, bearing=from_catalogue("6206"), rig=replace(_DISC, end_mass=0.0), clearance=5e-6, defect=CASING.defect
)

Change = Callable[[Scene], Scene]
EFFECTS: dict[str, tuple[Scene, Change]] = {
    "rough floor, 1 µm": (CASING, lambda s: _damaged(s, floor=Floor(kind="rough", seed=1))),
    "both rows damaged": (CASING, lambda s: _damaged(s, rows=2)),
    "inner race too, alike": (CASING, lambda s: replace(s, more_defects=(replace(_of(s), part="inner"),))),
    "clearance 5 µm": (CASING, lambda s: replace(s, clearance=5e-6)),
    "gravity": (CASING, lambda s: replace(s, gravity=9.81)),
    "unbalance 1 kg mm": (CASING, lambda s: replace(s, unbalance=1e-3)),
    "outer race wavy, 0.5 µm": (CASING, lambda s: replace(s, waviness=(Waviness(5e-7, 13),))),
    "inner race wavy, 0.5 µm": (CASING, lambda s: replace(s, waviness=(Waviness(5e-7, 13, "inner"),))),
    "slip 0.5°": (CASING, lambda s: replace(s, slip=Slip(math.radians(0.5), seed=1))),
    "slip 0.5°, its mean force": (CASING, lambda s: replace(s, slip=Slip(math.radians(0.5), "mean_force"))),
    "rotor: unbalance 0.1 kg mm": (ROTOR, lambda s: replace(s, unbalance=1e-4)),
    "rotor: bow 10 µm": (ROTOR, lambda s: replace(s, bow=1e-5)),
    "rotor: couple unbalance": (ROTOR, lambda s: replace(s, couple_unbalance=1e-5)),
    "rotor: clearance 5 µm": (replace(ROTOR, clearance=0.0), lambda s: replace(s, clearance=5e-6)),
    "rotor: elastic shaft": (ROTOR, lambda s: replace(s, rig=_DISC, physics=("elastic_shaft",))),
}
"""The scene without each effect, and what adds it."""
_TIMES = ("with ms", "without ms")


def _of(scene: Scene) -> Defect:
    if scene.defect is None:
        raise ValueError("the scene has no defect")
    return scene.defect


def _damaged(scene: Scene, **changes: object) -> Scene:
    return replace(scene, defect=replace(_of(scene), **changes))


def _response(scene: Scene) -> tuple[Response, float]:
    # Compiled before it is timed.
    simulate(scene, accuracy=0.1, duration=0.05, rate=REQUEST.rate)
    return timed(lambda: simulate(scene, accuracy=REQUEST.accuracy, duration=REQUEST.duration, rate=REQUEST.rate))


def _a_star(found: Response, scene: Scene) -> float:
    if found.record is None:
        return float(np.linalg.norm(found.harmonics[:5]))
    return float(np.linalg.norm(2.0 * np.abs(found.record.coefficients(passage_rate(scene), 5)[0, 1:])))


def effect_rows() -> list[Row]:
    """Return a row for each effect."""
    rows: list[Row] = []
    for name, (without, add) in EFFECTS.items():
        scene = add(without)
        (full, seconds), (left, saved) = _response(scene), _response(without)
        slope = abs(volume_slope(without, REQUEST))
        ratio = left.rms / full.rms
        rows.append(
            {
                "left out": name,
                "model": full.model,
                "RMS": ratio - 1.0,
                "standard error": full.rms_se / full.rms,
                "A*": _a_star(left, without) / _a_star(full, scene) - 1.0,
                "V_eq": abs(math.log(ratio)) / slope,
                "with ms": 1e3 * seconds,
                "without ms": 1e3 * saved,
                "status": full.status,
            }
        )
    return rows


def effect_table(rows: Sequence[Row]) -> str:
    """Return the table of the page."""
    lines = ["left out | RMS | A* | V_eq | ms with | without", "---|---|---|---|---|---"]
    for row in rows:
        rms, noise = float(row["RMS"] or 0.0), float(row["standard error"] or 0.0)
        below = abs(rms) <= 2.0 * noise
        cells = [
            str(row["left out"]),
            f"within {200.0 * noise:.1g}%" if below else _signed(rms),
            _signed(float(row["A*"] or 0.0)),
            "" if below else _volume(float(row["V_eq"] or 0.0)),
            *(f"{float(row[name] or 0.0):.{1 if float(row[name] or 0.0) < 10.0 else 0}f}" for name in _TIMES),
        ]
        lines.append(" | ".join(cells))
    return "\n".join(lines)


def _volume(error: float) -> str:
    """Return an error of V_eq; a local slope tells no larger one than the volume itself."""
    return f"{100.0 * error:.2g}%" if error < 1.0 else "> 100%"


def _signed(share: float) -> str:
    return f"{100.0 * share:+.2g}%"
