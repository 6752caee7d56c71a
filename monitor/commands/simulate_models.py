"""One scene by one model, or by every model that describes it."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from models.registry import MODULES
from models.response import PASSBAND
from monitor.commands.common import finite, output_errors
from monitor.commands.model_parameters import able_models, with_parameters
from streams.block import STANDARD_GRAVITY

if TYPE_CHECKING:
    from models.bearing import CatalogueEntry
    from models.response import Response
    from models.scene import Scene
    from monitor.config.load import Config

WAVEFORM_RATE = 51200.0


def simulated(scene: Scene, options: dict[str, Any]) -> Response:
    """Return the response to a scene, as the options of ``simulate`` ask."""
    from models.simulate import simulate

    return simulate(
        scene,
        accuracy=options["accuracy"],
        tolerance=options["tolerance"],
        max_periods=options["periods"],
        band=options["rms_band_hz"],
        direction=math.radians(options["direction_deg"]),
        lines_to=None if options["waveform"] is None else PASSBAND * 0.5 * WAVEFORM_RATE,
        duration=options["duration_s"],
        rate=WAVEFORM_RATE,
    )


def compare(scene: Scene, config: Config, entry: CatalogueEntry, options: dict[str, Any]) -> dict[str, Any]:
    """Return what every model says that describes a scene, each with parameters of its own, and what others lack.

    Raises:
        ValueError: if no model describes it, or an option belongs to one model.
    """
    for name in ("parameters", "waveform", "sensor"):
        if options[name]:
            written = "--parameter" if name == "parameters" else f"--{name}"
            raise ValueError(f"{written} belongs to one model; leave it out, or name that with --model")
    able = able_models(scene)
    if not able:
        raise ValueError(f"no model describes {', '.join(scene.effects)} together")
    answers: dict[str, Response] = {}
    refused: dict[str, str] = {name: "it lacks effects of the scene" for name in MODULES if name not in able}
    rows: list[dict[str, Any]] = []
    for model in able:
        began = time.process_time()
        try:
            answers[model] = found = simulated(with_parameters(scene, config, entry, (), model=model), options)
        except ValueError as error:
            refused[model] = str(error)
            continue
        rows.append(
            {
                "model": model,
                "solver": found.solver,
                "sensor": found.sensors[0],
                "status": found.status,
                "rms_g": finite(found.rms / STANDARD_GRAVITY),
                "rms_error": finite(found.rms_error),
                "peak_g": finite(found.peak / STANDARD_GRAVITY),
                "harmonics_g": [finite(float(line) / STANDARD_GRAVITY) for line in found.harmonics],
                "seconds": time.process_time() - began,
            }
        )
    if options["plot"] is not None:
        _plot(scene, answers, options["plot"])
    return {"models": rows, "refused": refused}


def compared_lines(values: dict[str, Any]) -> Iterator[str]:
    """Yield the lines of a comparison for people."""
    yield f"{'model':14}{'sensor':>8}{'status':>14}{'RMS, g':>12}{'error':>9}{'peak, g':>12}{'time, s':>9}"
    for row in values["models"]:
        rms, error, peak = row["rms_g"], row["rms_error"], row["peak_g"]
        yield (
            f"{row['model']:14}{row['sensor']:>8}{row['status']:>14}"
            f"{'-' if rms is None else format(rms, '.4g'):>12}"
            f"{'-' if error is None else format(error, '.1e'):>9}"
            f"{'-' if peak is None else format(peak, '.4g'):>12}{row['seconds']:9.2f}"
        )
    yield "each model with parameters of its own, at its first sensor: levels need not agree"
    for model, reason in values["refused"].items():
        yield f"{model}: {reason}"


def _plot(scene: Scene, answers: dict[str, Response], path: Path) -> None:
    from monitor.report.figures.compared import compared_sheet
    from monitor.report.figures.sheet import write_sheet

    with output_errors("--plot", path):
        write_sheet(compared_sheet(scene, answers), path)
