"""The speed of ``spallwatch simulate`` where it changes, and the tacho in its signal."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click
import numpy as np

from models.machine.shaft_marks import ShaftMarks, as_channel, time_of_turns
from models.machine.speed_profile import SpeedProfile, coast_down, constant, hunt, ramp, table
from monitor.commands import option

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.machine.scene import Scene
    from models.solve.response import Response

F = TypeVar("F", bound=Callable[..., Any])
_USUAL_SECONDS = 1.0
_MOST_SECONDS = 60.0
_COLUMNS = ("time_s", "speed_hz")


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

    Raises:
        ValueError: if the options contradict each other.
    """
    spec: SpeedSpec | None = options["speed_profile"]
    if options["duration_s"] is None:
        own = None if spec is None else spec.seconds
        options["duration_s"] = _USUAL_SECONDS if own is None else min(own, _MOST_SECONDS)
    if options["tacho"] is not None and options["waveform"] is None:
        raise ValueError("--tacho is a column of --waveform, which is not given")
    for name in ("error_deg", "jitter_us", "missing", "extra"):
        if options[f"tacho_{name}"] > 0.0 and options["tacho"] is None:
            raise ValueError(f"--tacho-{name.replace('_', '-')} belongs to --tacho")
    if spec is None:
        return
    options["speed_profile"] = profile = spec.profile(options["duration_s"])
    if "speed_hz" not in given:
        # Of what is simulated: a profile may be longer.
        seconds = options["duration_s"]
        options["speed_hz"] = float(profile.turns_at(seconds)) / seconds


def speed_values(scene: Scene, seconds: float) -> dict[str, Any]:
    """Return what is printed of a speed that changes: nothing where it does not."""
    profile = scene.rotation(seconds)
    if profile is None:
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
