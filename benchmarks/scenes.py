"""Scenes: what each model costs and misses where another could answer, and what ``--model auto`` makes of it.

Run as ``python -m benchmarks.scenes [--quick] [--json FILE]``. Two parts:

1. a dozen named scenes: the reference, each model that can stand for it whatever its error, what that leaves out, how
   far it is off in RMS, A* (the first five lines of the passages over the defect, Eq. 57), the largest line and V_eq,
   and what both cost.
2. What leaving out each effect costs and saves (``benchmarks.scenes_effects``). Without ``--quick`` both tables of
   docs/explanation/scenes.md are written anew.

How ``auto`` does in random scenes: ``benchmarks.scenes_judged``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.common import Row, arguments, print_table, write_json
from benchmarks.scenes_effects import effect_rows, effect_table
from benchmarks.scenes_trial import timed, truth_of
from models.machine.bearing import from_catalogue
from models.machine.scene import Defect, Scene
from models.solve.ball_inertia.rig import BallInertiaRig
from models.solve.engine.motion import passage_rate
from models.solve.registry import choose
from models.solve.response import Response
from models.solve.rotor.rig import RotorRig
from models.solve.simulate import select, stand_ins, volume_slope
from models.words.request import Request

QUICK = 3
PAGE = Path(__file__).resolve().parents[1] / "docs" / "explanation" / "scenes.md"
REQUEST = Request(accuracy=1e-3, duration=0.5, rate=25600.0)
ASKED = 5e-2
"""Accuracy of the RMS for which the table says what ``auto`` takes."""


def named_scenes() -> dict[str, Scene]:
    """Return the scenes of the table."""
    bearing = from_catalogue("6206")
    balls = BallInertiaRig(c_ci=500.0, c_co=500.0, defect_shape="half_sine")
    rotor = RotorRig(m=3.0, c_n=300.0, cage_angle_a=0.0)
    short = replace(rotor, length=0.06, a=0.03, shaft_diameter=0.06, end_mass=0.3, j_p=1e-2, j_t=1e-2)
    plain = Scene(30.0, 2000.0, bearing=bearing, rig=balls)
    defect = Defect(math.radians(4.0), 1e-5)
    return {
        "healthy, steel balls": plain,
        "the same, slow (15 Hz)": replace(plain, speed=15.0),
        "the same, ceramic balls": replace(plain, rig=replace(balls, m_b=0.41 * balls.ball_mass(bearing))),
        "the same, clearance 5 µm": replace(plain, clearance=5e-6),
        "outer race, steel balls": replace(plain, defect=defect),
        "inner race, steel balls": replace(plain, defect=replace(defect, part="inner")),
        "unbalance, steel balls": replace(plain, unbalance=1e-3),
        "rotor, healthy": replace(plain, rig=rotor),
        "rotor, slow, light load": replace(plain, rig=rotor, speed=15.0, load=500.0),
        "rotor, clearance 5 µm": replace(plain, rig=rotor, clearance=5e-6),
        "short elastic shaft, outer race": replace(plain, rig=short, defect=defect),
        "long elastic shaft, outer race": replace(plain, rig=replace(short, length=0.4, a=0.2), defect=defect),
    }


def _lines(found: Response, scene: Scene) -> Any:
    if found.record is None:
        return found.harmonics
    return 2.0 * np.abs(found.record.coefficients(passage_rate(scene), 6)[0, 1:])


def table(count: int | None) -> list[Row]:
    """Return a row for each of the first named scenes and each model that can stand for its reference."""
    rows: list[Row] = []
    for name, scene in list(named_scenes().items())[:count]:
        reference, _ = choose(scene, REQUEST)
        truth = truth_of(scene, REQUEST, reference)
        _, seconds = timed(lambda reference=reference, scene=scene: reference.solve(scene, REQUEST))
        lines, slope = _lines(truth, scene), math.nan
        if scene.defect is not None:
            slope = abs(volume_slope(replace(scene, model=reference.model), REQUEST))
        taken = select(scene, replace(REQUEST, accuracy=ASKED))
        for one in stand_ins(scene, REQUEST, reference)[0]:
            found, instead = timed(lambda one=one: one.mapped.back(one.solver.solve(one.mapped.scene, one.request)))
            ours = _lines(found, scene)
            rms = found.rms / truth.rms - 1.0
            rows.append(
                {
                    "scene": name,
                    "reference": f"{reference.model} {reference.name}",
                    "instead": f"{one.solver.model} {one.solver.name}",
                    "leaves out": one.mapping.neglected,
                    "RMS": rms,
                    "A*": float(np.linalg.norm(ours[:5]) / np.linalg.norm(lines[:5])) - 1.0,
                    "largest line": float(np.max(np.abs(ours - lines)) / np.max(lines)),
                    "V_eq": abs(rms) / slope if math.isfinite(slope) and slope > 0.0 else None,
                    "reference ms": 1e3 * seconds,
                    "instead ms": 1e3 * instead,
                    "auto takes": f"{taken.solver.model} {taken.solver.name}",
                }
            )
    return rows


def page_table(rows: Sequence[Row]) -> str:
    """Return the table of the page: of the stand-ins of a scene, the cheapest."""
    lines = ["scene | reference | instead | RMS | A* | line | V_eq | `auto`", "---|---|---|---|---|---|---|---"]
    for scene in dict.fromkeys(row["scene"] for row in rows):
        row = min((row for row in rows if row["scene"] == scene), key=lambda row: float(row["instead ms"] or 0.0))
        cells = [
            str(scene),
            _costing(row, "reference"),
            _costing(row, "instead"),
            *(_percent(row[name]) for name in ("RMS", "A*", "largest line", "V_eq")),
            "instead" if row["auto takes"] == row["instead"] else "reference",
        ]
        lines.append(" | ".join(cells))
    return "\n".join(lines)


def _costing(row: Row, which: str) -> str:
    """Return the name of a solver, of the rotor's that of its shaft, and its time."""
    spent, (model, solver) = float(row[f"{which} ms"] or 0.0), str(row[which]).split(" ")
    name = solver if model == "rotor" else model
    return f"{name} {spent:.0f}" if spent >= 10.0 else f"{name} {spent:.1f}"


def _percent(value: float | str | None) -> str:
    """Return a share as two digits of percent."""
    if value is None:
        return ""
    percent = 100.0 * float(value)
    return f"{percent:.0f}%" if abs(percent) >= 9.5 else f"{percent:.1g}%"


def write_page(name: str, table: str) -> None:
    """Replace one of the tables of the page."""
    begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
    text = PAGE.read_text(encoding="utf-8")
    before, rest = text.split(begin)
    _, after = rest.split(end)
    PAGE.write_text(f"{before}{begin}\n\n{table}\n\n{end}{after}", encoding="utf-8")


def main() -> None:
    """Run both parts."""
    given = arguments(__doc__ or "")
    rows = table(QUICK if given.quick else None)
    print_table("Named scenes", rows)
    effects: list[Row] = []
    if not given.quick:
        effects = effect_rows()
        print_table("Effects left out", effects)
        write_page("table", page_table(rows))
        write_page("effects", effect_table(effects))
    write_json(given.json, {"named": rows, "effects": effects})


if __name__ == "__main__":
    main()
