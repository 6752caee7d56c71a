"""One scene by one model, or by every model that describes it."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from models.solve.registry import MODELS
from models.solve.response import PASSBAND
from models.words.request import Request
from monitor.commands.common import finite, output_errors
from monitor.commands.model_parameters import able_models, missing_effects, with_parameters
from monitor.words.sensors import unit_in_names, unit_of_sensor

if TYPE_CHECKING:
    from models.machine.bearing import CatalogueEntry
    from models.machine.scene import Scene
    from models.solve.response import Response
    from monitor.config.load import Config

WAVEFORM_RATE = 51200.0


def request_of(options: dict[str, Any]) -> Request:
    """Return what the options of ``simulate`` ask about a scene."""
    return Request(
        accuracy=options["accuracy"],
        tolerance=options["tolerance"],
        max_periods=options["periods"],
        band=options["rms_band_hz"],
        direction=math.radians(options["direction_deg"]),
        lines_to=None if options["waveform"] is None else PASSBAND * 0.5 * WAVEFORM_RATE,
        duration=options["duration_s"],
        rate=WAVEFORM_RATE,
        quantity=options["quantity"],
        sensor=options["sensor"],
    )


def simulated(scene: Scene, options: dict[str, Any]) -> Response:
    """Return the response to a scene, as the options of ``simulate`` ask."""
    from models.solve.simulate import simulate

    return simulate(scene, **asdict(request_of(options)))


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
    refused = {
        name: "does not describe " + ", ".join(missing_effects(scene, name)) for name in MODELS if name not in able
    }
    rows: list[dict[str, Any]] = []
    for model in able:
        try:
            own = with_parameters(scene, config, entry, (), model=model)
            simulated(own, options)
            # A second call, because the first may compile kernels and load them.
            began = time.process_time()
            answers[model] = found = simulated(own, options)
        except ValueError as error:
            refused[model] = str(error)
            continue
        rows.append(_row(found, time.process_time() - began))
    if options["plot"] is not None:
        _plot(scene, answers, options["plot"])
    return {"models": rows, "refused": refused}


def _row(found: Response, seconds: float) -> dict[str, Any]:
    """Return what a comparison says of one model; levels are in g, of a speed in rad/s."""
    sensor = found.sensors[0]
    scale, text = unit_of_sensor(sensor)
    unit = unit_in_names(text)
    return {
        "model": found.model,
        "solver": found.solver,
        "sensor": sensor,
        "status": found.status,
        f"rms_{unit}": finite(found.rms / scale),
        "rms_error": finite(found.rms_error),
        f"peak_{unit}": finite(found.peak / scale),
        f"harmonics_{unit}": [finite(float(line) / scale) for line in found.harmonics],
        "seconds": seconds,
    }


def compared_lines(values: dict[str, Any]) -> Iterator[str]:
    """Yield the lines of a comparison for people."""
    yield f"{'model':14}{'sensor':>8}{'status':>14}{'RMS':>16}{'error':>9}{'peak':>16}{'time, s':>9}"
    for row in values["models"]:
        error = row["rms_error"]
        yield (
            f"{row['model']:14}{row['sensor']:>8}{row['status']:>14}{_level(row, 'rms'):>16}"
            f"{'-' if error is None else format(error, '.1e'):>9}{_level(row, 'peak'):>16}{row['seconds']:9.2g}"
        )
    yield "each model with parameters of its own, at its first sensor: levels need not agree"
    yield "error: of the RMS, relative, estimated; time: of the processor, in a second call, without compiling"
    for model, reason in values["refused"].items():
        yield f"{model}: not compared: {reason}"


def _level(row: dict[str, Any], name: str) -> str:
    value, unit = (row[f"{name}_g"], "g") if f"{name}_g" in row else (row[f"{name}_rad_s"], "rad/s")
    return "-" if value is None else f"{value:.4g} {unit}"


def _plot(scene: Scene, answers: dict[str, Response], path: Path) -> None:
    from monitor.report.figures.compared import compared_sheet
    from monitor.report.figures.sheet import write_sheet

    with output_errors("--plot", path):
        write_sheet(compared_sheet(scene, answers), path)
