"""What several commands share: configuration, errors of inputs and outputs, printing, progress."""

from __future__ import annotations

import json
import math
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click

from models.machine.bearing import Bearing, CatalogueEntry, catalogue_entry
from models.words.errors import WrongInputError
from monitor.config.load import Config, ConfigError, load_config, validate
from monitor.config.source import SourceSection

if TYPE_CHECKING:
    from monitor.records.store import Store
    from monitor.report.figures.sheet import Sheet
    from streams.types.block import Block

PROGRESS_AFTER_S = 2.0
"""Time after which progress is shown, s."""
PICTURES = (".png", ".svg", ".html")


class InputError(WrongInputError):
    """An input file or option cannot be used; the message names it, what was expected and what was found."""


def read_config(path: Path | None) -> Config:
    """Return the configuration at ``path``, or the one of the working directory.

    Raises:
        ConfigError: if there is none or it is not valid.
    """
    if path is not None and path.is_dir():
        raise ConfigError(
            f"{path}: is a folder; run follows one machine, so give one file of it. "
            "For all machines of a folder: one service each (spallwatch@NAME, made by make install-service) "
            f"and one page (spallwatch page --config {path})"
        )
    if path is not None:
        return load_config(path)
    here = Path("config.toml")
    if not here.exists():
        raise ConfigError("no --config FILE was given, and there is no config.toml in the working directory")
    return load_config(here)


def read_machine(path: Path | None) -> Config:
    """Return a configuration for commands that only use the model; without a file, the test bench of the thesis."""
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


def find_source(config: Config, name: str) -> SourceSection:
    """Return a source by its name; InputError if there is none of that name."""
    found = {section.name: section for section in config.source}
    if name not in found:
        raise InputError(f"{name!r} is not a [[source]] of the configuration; expected one of {', '.join(found)}")
    return found[name]


def publish_change(store: Store, records_dir: Path) -> None:
    """Publish a change of a store that was made by a command; say so where that fails, as the change is kept."""
    from monitor.service.publisher import publish_now

    problem = publish_now(store, records_dir)
    if problem is not None:
        click.echo(f"the change is in the store, but not published: {problem}", err=True)


def find_bearing(config: Config, name: str | None) -> tuple[Bearing, float]:
    """Return a bearing by its configured name or its designation, and its configured clearance, m.

    Raises:
        InputError: if there is none of that name.
    """
    entry, clearance = find_entry(config, name)
    return entry.bearing, clearance


def find_entry(config: Config, name: str | None) -> tuple[CatalogueEntry, float]:
    """Return a bearing by its configured name or its designation with its origins, and its configured clearance, m.

    Raises:
        InputError: if there is none of that name.
    """
    if name is None:
        return config.bearing[0].to_entry(), config.bearing[0].clearance_um * 1e-6
    for section in config.bearing:
        if section.name == name:
            return section.to_entry(), section.clearance_um * 1e-6
    try:
        return catalogue_entry(name), 0.0
    except KeyError as error:
        configured = ", ".join(section.name for section in config.bearing)
        raise InputError(f"--bearing: {error.args[0]}; configured are: {configured}") from None


@contextmanager
def input_errors(prefix: str) -> Iterator[None]:
    """Raise a ValueError as InputError, its message behind ``prefix``."""
    try:
        yield
    except ValueError as error:
        raise InputError(f"{prefix}: {error}") from None


@contextmanager
def output_errors(option: str, path: Path) -> Iterator[None]:
    """Raise an OSError as InputError that names the option and the file."""
    try:
        yield
    except OSError as error:
        raise InputError(f"{option} {path}: cannot be written: {error.strerror or error}") from None


def check_suffix(option: str, path: Path | None, suffixes: Sequence[str]) -> None:
    """Refuse an output file of another kind, before anything is computed for it; None is no output.

    Raises:
        InputError: naming the suffixes that are allowed.
    """
    if path is not None and path.suffix.lower() not in suffixes:
        *others, last = suffixes
        allowed = f"{', '.join(others)} or {last}" if others else last
        raise InputError(f"{option} {path}: expected a name that ends in {allowed}")


def write_plot(sheet: Sheet, path: Path, option: str = "--plot") -> None:
    """Draw a report of the model as a picture or a page; InputError where the file cannot be written."""
    from monitor.report.figures.sheet import write_sheet

    with output_errors(option, path):
        write_sheet(sheet, path)


def check_writable(option: str, path: Path) -> None:
    """Make the folder of an output file and refuse one that takes no file, before anything is computed for it.

    Raises:
        InputError: naming the option, the file and the reason.
    """
    if path.is_dir():
        raise InputError(f"{option} {path}: is a folder, expected a file")
    check_folder(option, path, path.parent)


def check_folder(option: str, path: Path, folder: Path) -> None:
    """Make a folder and refuse one that takes no file; ``path`` is what the option names.

    Raises:
        InputError: naming the option, the path and the reason.
    """
    with output_errors(option, path):
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass


def first_block(
    path: Path, name: str, column: str | None, rate: float | None, block_s: float | Literal["file"], *, missing: str
) -> Block:
    """Return the first block of a column of a file, by name or number; by default the first column.

    Args:
        name: of its channel.
        rate: Hz, where the file states none.
        missing: the reason where there is no block.

    Raises:
        InputError: there is none, or it cannot be read.
    """
    from streams.open import open_source
    from streams.types.block import Rejected
    from streams.types.spec import ChannelSpec, SourceSpec

    chosen = None if column is None else int(column) if column.isdigit() else column
    row = ChannelSpec(name, column=chosen, unit="unknown", any_unit=True)
    spec = SourceSpec("recording", str(path), block_s=block_s, rate=rate, channels=(row,))
    try:
        block = next(iter(open_source(spec)), None)
    except WrongInputError as error:
        raise InputError(str(error)) from None
    if block is None or isinstance(block, Rejected):
        raise InputError(f"{path}: {missing if block is None else block.reason}")
    return block


def emit(values: Mapping[str, Any], lines: Iterable[str], *, as_json: bool) -> None:
    """Print one JSON object for programs, or the lines for people, on standard output."""
    if as_json:
        click.echo(json.dumps(values, allow_nan=False))
    else:
        for line in lines:
            click.echo(line)


def say(text: str, *, quiet: bool) -> None:
    """Print a line for people on standard error."""
    if not quiet:
        click.echo(text, err=True)


def progress_bar(description: str, *, quiet: bool) -> Callable[[Iterable[Any], int], Iterator[Any]]:
    """Return a wrapper of an iterable that shows progress on a terminal, after ``PROGRESS_AFTER_S``."""

    def wrap(items: Iterable[Any], total: int) -> Iterator[Any]:
        if quiet or not sys.stderr.isatty():
            yield from items
            return
        from tqdm import tqdm

        with tqdm(total=total, desc=description, delay=PROGRESS_AFTER_S, file=sys.stderr, unit="block") as bar:
            for item in items:
                yield item
                bar.update()

    return wrap


def counter(description: str, *, quiet: bool) -> Callable[[int, int], None]:
    """Return a callback (done, total) that shows progress on a terminal, after ``PROGRESS_AFTER_S``."""
    began = time.monotonic()
    shown = False

    def show(done: int, total: int) -> None:
        nonlocal shown
        if quiet or not sys.stderr.isatty() or (not shown and time.monotonic() - began < PROGRESS_AFTER_S):
            return
        shown = True
        click.echo(f"\r{description}: {done} of {total}", nl=done >= total, err=True)

    return show


def finite(value: float) -> float | None:
    """Return a finite number, or None for NaN and infinity."""
    return float(value) if math.isfinite(value) else None
