"""Options that several commands share, and the types of their values."""

from __future__ import annotations

import functools
import inspect
import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import click

from models.machine.scene import PARTS

F = TypeVar("F", bound=Callable[..., Any])


class FiniteRange(click.FloatRange):
    """A range of numbers without nan, which lies in every range of click, and without infinities."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the number; refuse one that is not finite."""
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value!r} is not a finite number", param, ctx)
        return number


class Place(click.Path):
    """A path; an empty one, which would be the working directory, is refused."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the path; refuse an empty one, as an empty variable of a shell gives it."""
        if not str(value).strip():
            self.fail(f"expected a path, got {value!r}", param, ctx)
        return super().convert(value, param, ctx)


class PlaceOrUrl(click.ParamType):
    """A path or a URL as it is given; an empty one is refused."""

    name = "PATH"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the text; refuse an empty one."""
        if not str(value).strip():
            self.fail(f"expected a path or a URL, got {value!r}", param, ctx)
        return str(value)


POSITIVE = FiniteRange(min=0, min_open=True)
NOT_NEGATIVE = FiniteRange(min=0)
WHOLE = click.IntRange(min=0)
FILE = Place(path_type=Path)
OUT_FILE = Place(path_type=Path, dir_okay=False)
FOLDER = Place(path_type=Path, file_okay=False)
PLACE = PlaceOrUrl()

config = click.option("--config", "config_path", type=FILE, help="Configuration of the machine (TOML).")
bearing = click.option("--bearing", "name", help="A bearing of the configuration or of the catalogue.")
channel = click.option("--channel", help="Channel of the records, where several have a final stage.")
interval = click.option("--interval", type=click.FloatRange(0.5, 0.98), default=0.8, help="Level of intervals.")
library = click.option("--library", "library_path", type=FILE, help="Library of simulated lives (.npz).")
libraries = click.option(
    "--library",
    "library_path",
    type=FILE,
    multiple=True,
    help="Library of simulated lives (.npz) or of recorded runs (library learn); both for --method combined.",
)
floor = click.option(
    "--floor",
    type=click.Choice(["smooth", "rough"]),
    default="smooth",
    help="Bottom of the defect; rough: 1 µm (sd) after filtering, where the thesis scales by R = 10 µm.",
)
line_contact = click.option(
    "--line-contact",
    type=click.Choice(["palmgren", "houpert", "lundberg"]),
    default="palmgren",
    help="Stiffness of rollers; lundberg: crowned ones.",
)
rows = click.option("--out", type=OUT_FILE, help="Write the rows too: .csv, .json or .nc.")


DONE, WRONG = 0, 2
"""Exit codes of a command that judges; monitor.cli has those of errors."""
Result = tuple[Mapping[str, Any], Iterable[str]] | tuple[Mapping[str, Any], Iterable[str], int]
"""What a command answers: its JSON object, the lines for people, and the exit code (true is 1); by default it is 0."""


def output(function: Callable[..., Any]) -> Any:
    """Add ``--json`` and ``--quiet``, and print the :data:`Result` that the command returns.

    A command that prints by itself takes ``as_json``; one whose other words can be left out takes ``quiet``.
    """
    taken = inspect.signature(function).parameters

    @click.option("--json", "as_json", is_flag=True, help="Print one JSON object on standard output, for programs.")
    @click.option("--quiet", is_flag=True, help="Print only errors on standard error.")
    @functools.wraps(function)
    def command(*args: Any, as_json: bool, quiet: bool, **options: Any) -> None:
        from monitor.commands.common import emit

        asked = {"as_json": as_json, "quiet": quiet}
        result = function(*args, **options, **{name: value for name, value in asked.items() if name in taken})
        if result is None:
            return
        emit(*result[:2], as_json=as_json)
        if len(result) == 3 and result[2]:
            click.get_current_context().exit(int(result[2]))

    return command


def method(*methods: str) -> Callable[[F], F]:
    """Add ``--method`` for commands that also have ``--library``."""
    words = "Default: library with --library, else thesis."
    return click.option("--method", type=click.Choice(methods), help=words)


def thresholds(kind: click.ParamType = POSITIVE) -> Callable[[F], F]:
    """Add ``--threshold-mm2``, which may be given several times."""
    return click.option(
        "--threshold-mm2",
        type=kind,
        multiple=True,
        default=(0.05,),
        help="Threshold of V_eq, mm3 per mm of width; may be given several times.",
    )


def workers(words: str) -> Callable[[F], F]:
    """Add ``--workers``; ``words`` say what they are."""
    return click.option("--workers", type=WHOLE, default=0, help=f"{words}; 0: one per core.")


class Axis(click.ParamType):
    """LO:HI:N, evenly spaced values."""

    name = "LO:HI:N"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return (lo, hi, n); refuse an axis that does not rise or has fewer than two values."""
        if isinstance(value, tuple):
            return value
        parts = str(value).split(":")
        try:
            low, high, count = float(parts[0]), float(parts[1]), int(parts[2])
        except (ValueError, IndexError):
            self.fail(f"{value!r} is not LO:HI:N, such as 0:50:51", param, ctx)
        if len(parts) != 3 or not (0 <= low < high < float("inf")) or not 2 <= count <= 10001:
            self.fail(f"{value!r}: expected 0 <= LO < HI and 2 <= N <= 10001", param, ctx)
        return low, high, count


class Range(click.ParamType):
    """LO:HI with 0 <= LO < HI; with ``positive``, 0 < LO <= HI, and one number is a range of no width."""

    name = "LO:HI"

    def __init__(self, *, positive: bool = False) -> None:
        """Set which ranges are valid."""
        self._positive = positive

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return (lo, hi)."""
        if isinstance(value, tuple):
            return value
        try:
            ends = [float(part) for part in str(value).split(":")]
        except ValueError:
            self.fail(f"{value!r} is not LO:HI, such as 20:9500", param, ctx)
        if self._positive and len(ends) == 1:
            ends *= 2
        expected = "0 < LO <= HI" if self._positive else "0 <= LO < HI"
        low, high = ends if len(ends) == 2 else (math.nan, math.nan)
        valid = 0.0 < low <= high if self._positive else 0.0 <= low < high
        if not valid or math.isinf(high):
            self.fail(f"{value!r}: expected {expected}", param, ctx)
        return low, high


class FurtherDefect(click.ParamType):
    """PART:DPHI_DEG:H_D_UM, or PART:DPHI_DEG:H_D_UM:POSITION_DEG."""

    name = "PART:DPHI_DEG:H_D_UM[:POSITION_DEG]"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return (part, dphi, h_d, position), numbers as given; the scene checks what they may be."""
        if isinstance(value, tuple):
            return value
        part, *numbers = str(value).split(":")
        try:
            dphi, h_d, *rest = [float(number) for number in numbers]
        except ValueError:
            self.fail(f"{value!r} is not {self.name}, such as inner:4:500:90", param, ctx)
        if len(rest) > 1 or part not in PARTS:
            self.fail(f"{value!r} is not {self.name} with outer, inner or ball first", param, ctx)
        return part, dphi, h_d, rest[0] if rest else 0.0


def spread_names(arguments: Sequence[str], names: Mapping[str, Collection[str]]) -> Iterator[str]:
    """Yield arguments in which an option of ``names`` is repeated before each of the names that follow it.

    ``--free m_r k_r`` becomes ``--free m_r --free k_r``; what is no name of the option ends its list.
    """
    option, taken = "", 0
    for argument in arguments:
        if argument in names:
            option, taken = argument, 0
        elif option:
            taken += 1
            if taken > 1 and argument in names[option]:
                yield option
            elif taken > 1:
                option = ""
        yield argument
