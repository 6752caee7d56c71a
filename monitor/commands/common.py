"""What several commands share: options, output, progress, ranges."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

import click

from models.errors import WrongInputError
from monitor.config.load import Config, ConfigError, load_config, validate

F = TypeVar("F", bound=Callable[..., Any])

PROGRESS_AFTER = 2.0
"""Seconds after which a progress bar appears."""


class InputError(WrongInputError):
    """An input file or option cannot be used; the message names it, what was expected and what came."""


def output_options(function: F) -> F:
    """Add ``--json`` and ``--quiet``."""
    function = click.option("--quiet", is_flag=True, help="Say nothing on standard error but errors.")(function)
    return click.option(
        "--json", "as_json", is_flag=True, help="Print one JSON object on standard output, for programs."
    )(function)


def config_option(*, required: bool = False) -> Callable[[F], F]:
    """Add ``--config FILE``."""
    return click.option(
        "--config",
        "config_path",
        type=click.Path(path_type=Path),
        required=required,
        help="Configuration of the machine (TOML).",
    )


def read_config(path: Path | None) -> Config:
    """Return the configuration at ``path``, or the one of the working directory.

    Raises:
        ConfigError: if there is none or it is not valid.
    """
    if path is not None:
        return load_config(path)
    here = Path("config.toml")
    if not here.exists():
        raise ConfigError("no --config FILE was given, and there is no config.toml in the working directory")
    return load_config(here)


def read_machine(path: Path | None) -> Config:
    """Return a configuration for commands that ask about the model only: without a file, the bench of the thesis."""
    if path is not None or Path("config.toml").exists():
        return read_config(path)
    return validate(
        {
            "bearing": [{"name": "test", "designation": "1205 ETN9"}],
            "source": [{"name": "none"}],
            "channel": [{"name": "test", "source": "none", "unit": "g", "bearing": "test"}],
            "operating": {"speed_hz": 40.0, "load_newton": 4000.0},
        },
        Path("defaults"),
    )


def emit(values: Mapping[str, Any], lines: Iterable[str], *, as_json: bool) -> None:
    """Print one JSON object for programs, or the lines for people, on standard output."""
    if as_json:
        click.echo(json.dumps(values, allow_nan=False))
    else:
        for line in lines:
            click.echo(line)


def say(text: str, *, quiet: bool) -> None:
    """Print something for people on standard error."""
    if not quiet:
        click.echo(text, err=True)


def progress_bar(description: str, *, quiet: bool) -> Callable[[Iterable[Any], int], Iterator[Any]]:
    """Return a wrapper that shows progress on a terminal once the work has taken two seconds."""

    def wrap(items: Iterable[Any], total: int) -> Iterator[Any]:
        if quiet or not sys.stderr.isatty():
            yield from items
            return
        from tqdm import tqdm

        with tqdm(total=total, desc=description, delay=PROGRESS_AFTER, file=sys.stderr, unit="block") as bar:
            for item in items:
                yield item
                bar.update()

    return wrap


def counter(description: str, *, quiet: bool) -> Callable[[int, int], None]:
    """Return a callback (done, total) that shows progress on a terminal once the work has taken two seconds."""
    began = time.monotonic()
    shown = False

    def show(done: int, total: int) -> None:
        nonlocal shown
        if quiet or not sys.stderr.isatty() or (not shown and time.monotonic() - began < PROGRESS_AFTER):
            return
        shown = True
        click.echo(f"\r{description}: {done} of {total}", nl=done >= total, err=True)

    return show


class Axis(click.ParamType):
    """LO:HI:N, evenly spaced values."""

    name = "LO:HI:N"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return (lo, hi, n); refuse what is no rising axis of at least two values."""
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


class BandHz(click.ParamType):
    """LO:HI in Hz."""

    name = "LO:HI"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return (lo, hi)."""
        if isinstance(value, tuple):
            return value
        try:
            low, high = (float(part) for part in str(value).split(":"))
        except ValueError:
            self.fail(f"{value!r} is not LO:HI in Hz, such as 0:9500", param, ctx)
        if not 0 <= low < high < float("inf"):
            self.fail(f"{value!r}: expected 0 <= LO < HI", param, ctx)
        return low, high


def duration_words(seconds: float) -> str:
    """Return a duration in the unit that people would use."""
    for unit, size in (("d", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if abs(seconds) >= 2 * size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.3g} s"
