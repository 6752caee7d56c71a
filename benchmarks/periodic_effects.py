"""Time and error of scenes with gravity, waves of the outer race and another direction of the sensor.

Run as ``python -m benchmarks.periodic_effects [--quick] [--json FILE]``. All of them keep the ball period and are
solved for one. Each time is the median thread time of a whole ``simulate`` call (stability test, error estimate and
lines included) in turns with the calibration kernel; "scaled" is that of a machine on which the kernel takes 0.35 ms,
where each scene may take 1.5 ms. Errors of the RMS are against 8192 steps a ball period.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from benchmarks.common import (
    REFERENCE_MS,
    Row,
    arguments,
    calibration_kernel,
    interleaved_ms,
    print_table,
    write_json,
)
from models.machine.scene import Defect, Scene, Waviness
from models.solve.response import Response
from models.solve.simulate import simulate

TARGET_MS = 1.5
ACCURACIES = (2e-3, 1e-3)
REFERENCE_STEPS = 8192

_SPALL = Scene(40.0, 4000.0, defect=Defect(math.radians(20.0), 20e-6))
_HEALTHY = replace(_SPALL, defect=None)
SCENES: dict[str, tuple[Scene, float]] = {
    "no effect, for comparison": (_SPALL, 0.0),
    "gravity along the load": (replace(_SPALL, gravity=9.81), 0.0),
    "gravity across it": (replace(_SPALL, gravity=9.81, gravity_angle=0.5 * math.pi), 0.0),
    "waves of the race": (replace(_HEALTHY, waviness=(Waviness(1e-6, 13),)), 0.0),
    "waves and a spall": (replace(_SPALL, waviness=(Waviness(1e-6, 13, phase=0.3),)), 0.0),
    "sensor across": (_SPALL, 0.5 * math.pi),
    "sensor between, gravity aside": (replace(_SPALL, gravity=9.81, gravity_angle=0.7), 0.6),
}


def scene_rows(accuracy: float, rounds: int) -> list[Row]:
    """Return time and error of each scene at an accuracy."""

    def solved(scene: Scene, direction: float) -> Callable[[], Response]:
        return lambda: simulate(scene, accuracy=accuracy, direction=direction)

    functions: dict[str, Callable[[], object]] = {name: solved(*pair) for name, pair in SCENES.items()}
    times = interleaved_ms({**functions, "fft": calibration_kernel()}, rounds)
    rows: list[Row] = []
    for name, (scene, direction) in SCENES.items():
        found = simulate(scene, accuracy=accuracy, direction=direction)
        fine = simulate(scene, steps_per_period=REFERENCE_STEPS, tolerance=1e-9, direction=direction)
        scaled = times[name] * REFERENCE_MS / times["fft"]
        rows.append(
            {
                "scene": name,
                "asked for": accuracy,
                "ms": times[name],
                "calibration FFT ms": times["fft"],
                "scaled ms": scaled,
                "within 1.5": "yes" if scaled <= TARGET_MS else "no",
                "RMS error": found.rms / fine.rms - 1.0,
                "estimated": found.rms_error,
                "status": found.status,
            }
        )
    return rows


def main() -> None:
    """Print the table and write the JSON file if one was asked for."""
    options = arguments("Scenes with gravity, waves and other directions of the sensor.")
    rows = [row for accuracy in ACCURACIES for row in scene_rows(accuracy, 30 if options.quick else 300)]
    print_table("Effects that keep the ball period", rows)
    write_json(options.json, {"scenes": rows})


if __name__ == "__main__":
    main()
