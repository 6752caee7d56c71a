"""Stated and true errors of the steps of the shaft over its angle, over the stiffness of its couplings.

Run as ``python -m benchmarks.angular_errors [--json FILE] [--quick]``. The scene is that of the contracts: a spall of
the outer race. Couplings of 500 to 20,000 N m/rad move their mode, which rings long, across the lines. True errors are
those against steps an eighth (``FINE``) of the longest.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.common import Row, arguments, print_table, write_json
from models.solve.angular.rig import AngularRig
from models.solve.angular.solver import solve
from models.solve.response import Response
from models.words.request import Request, Sensor
from tests.support.models import SHAFT

COUPLINGS = tuple(float(round(c)) for c in np.geomspace(500.0, 20_000.0, 14))
RATE, STEPS, FINE = 25_600.0, (110, 220), 880
"""Samples a second; steps a passage: two and four a sample, and sixteen."""
SENSORS: tuple[Sensor, ...] = ("ias", "a")


def rows(sensor: Sensor, coupling: float) -> list[Row]:
    """Return the errors with each number of steps."""
    scene = replace(SHAFT, rig=AngularRig(mode_limit=15e3, coupling=coupling))

    def answer(steps: int) -> Response:
        return solve(
            scene, Request(5e-3, steps_per_period=steps, duration=0.1, rate=RATE, quantity="lines", sensor=sensor)
        )

    fine, found = answer(FINE), []
    for steps in STEPS:
        ours = answer(steps)
        lines = float(np.max(np.abs(ours.harmonics - fine.harmonics)) / np.max(fine.harmonics))
        pairs = {"lines": (lines, ours.lines_error), "rms": (abs(ours.rms / fine.rms - 1.0), ours.rms_error)}
        row: Row = {"sensor": sensor, "coupling_nm_per_rad": coupling, "steps": steps}
        for name, (true, stated) in pairs.items():
            row = {**row, f"{name}_true": true, f"{name}_stated": stated, f"{name}_share": true / stated}
        found.append(row)
    return found


def main() -> None:
    """Run, print, write."""
    options = arguments("Stated and true errors of the shaft over its angle.")
    couplings = COUPLINGS[::4] if options.quick else COUPLINGS
    table = [row for sensor in SENSORS for coupling in couplings for row in rows(sensor, coupling)]
    print_table("Errors of the steps; share: true over stated", table)
    write_json(options.json, {"errors": table})


if __name__ == "__main__":
    main()
