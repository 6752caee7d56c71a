"""The scene of ``simulate``: its speeds over time, and the models that answer for it."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click
import numpy as np

from models.machine.shaft_marks import ShaftMarks, as_channel, time_of_turns
from models.machine.speed_profile import SpeedProfile, coast_down, constant, hunt, ramp, table
from models.solve.registry import MODELS
from models.solve.response import PASSBAND
from models.words.request import USUAL_SECONDS, Request
from monitor.commands import option
from monitor.commands.common import finite, write_plot
from monitor.commands.model_parameters import able_models, missing_effects, with_parameters
from monitor.words.sensors import unit_in_names, unit_of_sensor
from streams.types.block import STANDARD_GRAVITY

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.machine.bearing import CatalogueEntry
    from models.machine.scene import Scene
    from models.solve.response import Response
    from monitor.config.load import Config

_SWEPT = {"speed_hz": ("speed", 1.0), "load_newton": ("load", 1.0), "clearance_um": ("clearance", 1e-6)}
_SWEPT |= {"dphi_deg": ("dphi_d", math.pi / 180.0), "h_d_um": ("h_d", 1e-6)}
"""Options that a motion is followed along: the parameter of the scene, and one of its unit in SI."""
F = TypeVar("F", bound=Callable[..., Any])
_RECORDS = ("waveform", "plot")
_MOST_SECONDS = 60.0
_COLUMNS = ("time_s", "speed_hz")
_COLUMNS_SWEPT = (("rms_g", ".4g"), ("rms_error", ".1e"), ("peak_g", ".4g"))
NO_UNIT = "levels without a unit, until one defect of known level sets the gain"


@dataclass(frozen=True)
class SpeedSpec:
    """A profile whose length may be left open.

    Attributes:
        profile: makes it, of a length in s.
        seconds: its own length, None where that is open.
    """

    profile: Callable[[float], SpeedProfile]
    seconds: float | None = None


class _Speeds(click.ParamType):
    """A profile of the speed: by numbers, or a CSV file."""

    name = "A:B:SECONDS|hunt:MEAN:PERCENT:HZ|coast:A:B:SECONDS|FILE"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the profile; refuse what is none."""
        if isinstance(value, SpeedSpec):
            return value
        try:
            return parse_speeds(str(value))
        except (ValueError, OSError) as error:
            self.fail(f"{value!r}: {error}", param, ctx)


def parse_speeds(text: str) -> SpeedSpec:
    """Return the profile that a text stands for.

    Raises:
        ValueError: it is none, or the shaft would stop.
        OSError: the file cannot be read.
    """
    word, *rest = text.split(":")
    if word == "hunt":
        mean, share, frequency = _numbers(rest, 3, "hunt:25:10%:0.3")
        hunt(mean, 0.01 * share, frequency, 1.0)
        return SpeedSpec(lambda seconds: hunt(mean, 0.01 * share, frequency, seconds))
    if word == "coast":
        begin, end, seconds = _numbers(rest, 3, "coast:40:10:20")
        return _whole(coast_down(begin, end, seconds))
    path = Path(text)
    if path.suffix.lower() == ".csv":
        return _whole(_read(path))
    begin, end, seconds = _numbers([word, *rest], 3, "10:40:5, hunt:25:10%:0.3, coast:40:10:20 or a .csv file")
    return _whole(ramp(begin, end, seconds))


def _whole(profile: SpeedProfile) -> SpeedSpec:
    return SpeedSpec(lambda seconds: profile, profile.duration)


def _numbers(parts: list[str], count: int, example: str) -> list[float]:
    try:
        numbers = [float(part.removesuffix("%")) for part in parts]
    except ValueError:
        raise ValueError(f"expected such as {example}") from None
    if len(numbers) != count:
        raise ValueError(f"expected such as {example}")
    return numbers


def _read(path: Path) -> SpeedProfile:
    """Return the profile of a file with the columns time_s and speed_hz."""
    with path.open(encoding="utf-8") as file:
        header = [name.strip() for name in file.readline().split(",")]
        if header[:2] != list(_COLUMNS):
            raise ValueError(f"expected the columns {','.join(_COLUMNS)}, got {','.join(header)[:60]}")
        rows = np.loadtxt(file, delimiter=",", usecols=(0, 1), ndmin=2)
    return table(rows[:, 0], rows[:, 1])


def with_speeds(function: F) -> F:
    """Add the options of a speed that changes and of a tacho."""
    added = (
        click.option("--speed-profile", type=_Speeds(), help="The speed changes; see the reference of commands."),
        click.option("--tacho", type=click.IntRange(1, 4096), help="Pulses a turn, a column of --waveform."),
        click.option("--tacho-error-deg", type=option.NOT_NEGATIVE, default=0.0, help="Of the marks, rms."),
        click.option("--tacho-jitter-us", type=option.NOT_NEGATIVE, default=0.0, help="Of the times, sd."),
        click.option("--tacho-missing", type=click.FloatRange(0, 1, max_open=True), default=0.0, help="Share."),
        click.option("--tacho-extra", type=click.FloatRange(0, 1), default=0.0, help="Share of pulses too many."),
    )
    for add in reversed(added):
        function = add(function)
    return function


def settle_speeds(options: dict[str, Any], given: dict[str, Any]) -> None:
    """Set duration, speed and profile in the options, from those that were given.

    The duration stays open where nothing but levels of one speed are asked for.

    Raises:
        ValueError: if the options contradict each other.
    """
    spec: SpeedSpec | None = options["speed_profile"]
    recorded = any(options[name] is not None for name in _RECORDS)
    own = None if spec is None else spec.seconds
    usual = USUAL_SECONDS if own is None else min(own, _MOST_SECONDS)
    if options["duration_s"] is None and (recorded or spec is not None or options["speed_slope_hz_per_s"] != 0.0):
        options["duration_s"] = usual
    if options["tacho"] is not None and options["waveform"] is None:
        raise ValueError("--tacho is a column of --waveform, which is not given")
    for name in ("error_deg", "jitter_us", "missing", "extra"):
        if options[f"tacho_{name}"] > 0.0 and options["tacho"] is None:
            raise ValueError(f"--tacho-{name.replace('_', '-')} belongs to --tacho")
    if spec is None:
        return
    seconds = float(options["duration_s"] or usual)
    options["speed_profile"] = profile = spec.profile(seconds)
    if "speed_hz" not in given:
        # Of what is simulated: a profile may be longer.
        options["speed_hz"] = float(profile.turns_at(seconds)) / seconds


def speed_values(scene: Scene, seconds: float | None) -> dict[str, Any]:
    """Return what is printed of a speed that changes: nothing where it does not."""
    profile = None if seconds is None else scene.rotation(seconds)
    if seconds is None or profile is None:
        return {}
    low, high = profile.part(0.0, seconds).speed_range
    return {"speed_min_hz": low, "speed_max_hz": high, "revolutions": float(profile.turns_at(seconds))}


def speed_lines(values: dict[str, Any], scene: Scene) -> Iterator[str]:
    """Yield a line for people of a speed that changes."""
    if "revolutions" in values:
        low, high, turns = (values[name] for name in ("speed_min_hz", "speed_max_hz", "revolutions"))
        yield f"{low:.4g} to {high:.4g} Hz, {turns:.4g} turns; lines are over the angle, as at {scene.speed:.4g} Hz"


def speed_words(scene: Scene) -> str:
    """Return the speed of a scene for a title."""
    if scene.speed_profile is None:
        return f"{scene.speed:g} Hz"
    low, high = scene.speed_profile.speed_range
    return f"{low:.4g} to {high:.4g} Hz"


def tacho_signal(response: Response, scene: Scene, options: dict[str, Any], rate: float) -> NDArray[np.float32]:
    """Return the channel of the tacho over the signal that is written, V, shape (samples,).

    Raises:
        ValueError: if the marks pass too fast for the sampling rate.
    """
    seconds = options["duration_s"]
    marks = ShaftMarks(
        options["tacho"],
        error=math.radians(options["tacho_error_deg"]),
        jitter=1e-6 * options["tacho_jitter_us"],
        missing=options["tacho_missing"],
        extra=options["tacho_extra"],
        seed=options["seed"],
    )
    profile = scene.rotation(seconds) or constant(scene.speed, seconds)
    turned, time_at = float(profile.turns_at(seconds)), profile.time_at
    if "ias" in response.sensors and response.record is not None:
        time_at = time_of_turns(response.turns(), response.record.rate)
    pulses = marks.pulses(time_at, turned, seconds)
    return as_channel(pulses, round(rate * seconds), rate, marks.per_turn * profile.speed_range[1])


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
        derivatives=tuple(name.strip() for name in options["derivatives"].split(",") if name.strip()),
    )


def simulated(scene: Scene, options: dict[str, Any]) -> Response:
    """Return the response to a scene, as the options of ``simulate`` ask."""
    from models.solve.simulate import simulate

    return simulate(scene, **asdict(request_of(options)))


def derivative_values(response: Response) -> dict[str, Any]:
    """Return what is printed of derivatives, m/s2 over the SI unit of each parameter; nothing where there are none."""
    found = {
        name: {
            "rms": finite(one.rms),
            "rms_error": finite(one.rms_error),
            "harmonics": [finite(float(line)) for line in one.harmonics],
            "harmonics_error": [finite(float(line)) for line in one.harmonics_error],
            "status": one.status,
            "why": one.why or None,
        }
        for name, one in response.derivatives.items()
    }
    return {"derivatives": found} if found else {}


def derivative_lines(values: dict[str, Any]) -> Iterator[str]:
    """Yield a line for people of each derivative."""
    for name, one in values.get("derivatives", {}).items():
        known = f"{one['rms']:.6g} m/s² (± {one['rms_error']:.1g})" if one["rms"] is not None else str(one["why"])
        yield f"RMS by {name} (SI): {known}, {one['status']}"


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
    """Return what a comparison says of a model: levels in g, of a speed in rad/s, null where they have no unit."""
    sensor = found.sensors[0]
    scale, text = unit_of_sensor(sensor)
    unit, known = unit_in_names(text), found.status != "uncalibrated"
    return {
        "model": found.model,
        "solver": found.solver,
        "sensor": sensor,
        "status": found.status,
        f"rms_{unit}": finite(found.rms / scale) if known else None,
        "rms_error": finite(found.rms_error),
        f"peak_{unit}": finite(found.peak / scale) if known else None,
        f"harmonics_{unit}": [finite(float(line) / scale) for line in found.harmonics] if known else None,
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
    for row in values["models"]:
        if row["status"] == "uncalibrated":
            yield f"{row['model']}: {NO_UNIT}"
    for model, reason in values["refused"].items():
        yield f"{model}: not compared: {reason}"


def _level(row: dict[str, Any], name: str) -> str:
    value, unit = (row[f"{name}_g"], "g") if f"{name}_g" in row else (row[f"{name}_rad_s"], "rad/s")
    return "-" if value is None else f"{value:.4g} {unit}"


def _plot(scene: Scene, answers: dict[str, Response], path: Path) -> None:
    from monitor.report.figures.compared import compared_sheet

    write_plot(compared_sheet(scene, answers), path)


class SweepRange(click.ParamType):
    """A parameter and its first and last value."""

    name = "OPTION=FROM:TO"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return (option, first, last)."""
        if isinstance(value, tuple):
            return value
        name, _, ends = str(value).partition("=")
        if name not in _SWEPT:
            self.fail(f"{name!r}: expected one of {', '.join(_SWEPT)}", param, ctx)
        try:
            return name, *_numbers(ends.split(":"), 2, "speed_hz=10:40")
        except ValueError as error:
            self.fail(f"{value!r}: {error}", param, ctx)


def swept(scene: Scene, options: dict[str, Any]) -> dict[str, Any]:
    """Return what is printed of a sweep; raise a ValueError where it has no use for an option, or none is possible."""
    from models.solve.six_dof.sweep import sweep

    if named := [name for name in ("waveform", "plot", "sensor") if options[name] is not None]:
        raise ValueError(f"--{named[0]} does not go together with --sweep")
    if options["quantity"] != "rms":
        raise ValueError(f"--sweep is to an accuracy of the RMS, got --quantity {options['quantity']}")
    name, *ends = options["sweep"]
    parameter, one = _SWEPT[name]
    how = {"accuracy": options["accuracy"], "band": options["rms_band_hz"]}
    found = sweep(
        scene, parameter, ends[0] * one, ends[1] * one, direction=math.radians(options["direction_deg"]), **how
    )
    points = [
        {
            name: float(value) / one,
            "rms_g": finite(rms / STANDARD_GRAVITY),
            "rms_error": finite(error),
            "peak_g": finite(peak / STANDARD_GRAVITY),
            "harmonics_g": [finite(float(line) / STANDARD_GRAVITY) for line in lines],
            "multiplier": abs(complex(multiplier)),
            "contacts": int(contacts),
            "status": status,
        }
        for value, rms, error, peak, lines, multiplier, contacts, status in zip(
            *(found.values, found.rms, found.rms_error, found.peak, found.harmonics, found.multiplier),
            *(found.contacts, found.status),
            strict=True,
        )
    ]
    events = [
        {
            "kind": event.kind,
            name: event.value / one,
            "error": event.error / one,
            "rms_g": event.rms / STANDARD_GRAVITY,
            "stability": event.stability,
            "after": event.after,
        }
        for event in found.events
    ]
    return {"parameter": name, "points": points, "events": events, "ended": found.ended, "left_out": []}


def swept_lines(values: dict[str, Any]) -> Iterator[str]:
    """Yield the lines of a sweep for people: its points, and between them what happens."""
    name = values["parameter"]
    yield f"{name:>14}{'RMS, g':>12}{'error':>9}{'peak, g':>12}{'multiplier':>12}  status"
    for number, row in enumerate(values["points"]):
        level, error, peak = ("-" if row[key] is None else format(row[key], form) for key, form in _COLUMNS_SWEPT)
        yield f"{row[name]:14.6g}{level:>12}{error:>9}{peak:>12}{row['multiplier']:12.4f}  {row['status']}"
        for event in values["events"]:
            if event["after"] == number:
                changed = f", stability {event['stability']}" if event["stability"] else ""
                words = event["kind"].replace("_", " ")
                yield f"{event[name]:14.8g}  {words}{changed} ({name} within {event['error']:.1g})"
    yield f"ended: {values['ended']}"
