"""``spallwatch warmup`` and ``examples``: what is prepared after the installation, and what comes with it."""

from __future__ import annotations

import importlib.metadata
import time
from pathlib import Path
from typing import TYPE_CHECKING

import click

from models.platform.process_signals import ROOT
from monitor.commands import option
from monitor.commands.common import InputError, read_config, say
from monitor.config.load import Config

if TYPE_CHECKING:
    from models.warmup import CompiledPart


@click.command("warmup")
@option.config
@option.output
def command(config_path: Path | None, quiet: bool) -> option.Result:
    """Compile the bearing model and plan the transforms of a configuration.

    Compiled code is kept for later runs on this machine if the installation or the home of the user is writable; a
    second warmup only loads it. Every process plans its transforms again, by estimate, so that results are
    reproducible; planning them here checks that it works and how long it takes.

    compile_seconds is processor time of the compiler, in total and by function; elapsed_seconds is wall time.
    """
    began = time.perf_counter()
    parts = _compile(quiet=quiet)
    elapsed = time.perf_counter() - began
    kernels: dict[str, float] = {}
    for part in parts:
        for name, seconds in part.kernels.items():
            kernels[name] = kernels.get(name, 0.0) + seconds
    config = read_config(config_path) if config_path is not None or Path("config.toml").exists() else None
    began = time.perf_counter()
    planned = 0 if config is None else _plan(config)
    values = {
        "compile_seconds": sum(kernels.values()),
        "elapsed_seconds": elapsed,
        "parts": {
            part.name: {
                "compile_seconds": sum(part.kernels.values()),
                "elapsed_seconds": part.elapsed,
                "kernels": len(part.kernels),
            }
            for part in parts
        },
        "kernels": dict(sorted(kernels.items(), key=lambda item: -item[1])),
        "plan_seconds": time.perf_counter() - began,
        "transforms": planned,
    }
    lines = (
        f"model: {len(kernels)} functions compiled in {values['compile_seconds']:.2f} s of processor time, "
        f"the rest loaded; {elapsed:.2f} s in all",
        f"transforms: {planned} planned in {values['plan_seconds']:.2f} s",
    )
    return values, lines


def _compile(*, quiet: bool) -> list[CompiledPart]:
    """Compile or load every kernel; return the time of each part."""
    from models.warmup import PARTS, compile_parts

    say(f"compiling {len(PARTS)} parts of the model, or loading them", quiet=quiet)
    parts: list[CompiledPart] = []
    for part in compile_parts(workers=0):
        parts.append(part)
        say(
            f"{len(parts)} of {len(PARTS)}: {part.name}, {len(part.kernels)} functions compiled, {part.elapsed:.1f} s",
            quiet=quiet,
        )
    return parts


def _plan(config: Config) -> int:
    """Plan one transform for each channel whose bands, block length and rate are configured; return how many."""
    from monitor.health.signal.transform import get_transform

    sources = {source.name: source for source in config.source}
    planned = 0
    for channel in config.channel:
        source = sources[channel.source]
        if source.block_s == "file" or source.rate_hz is None or channel.band_hz == "auto":
            continue
        samples = round(source.block_s * source.rate_hz)
        get_transform(samples, source.rate_hz, channel.band_hz, rms_band=channel.rms_band_hz)
        planned += 1
    return planned


_FOLDER = "share/spallwatch/examples"
"""Where the wheel has them, below the folder of the installation."""


def example_files(root: Path = ROOT) -> dict[str, Path]:
    """Return the examples by name, such as "notebooks/name_a_recording.ipynb".

    Args:
        root: the folder that holds the packages of this program.
    """
    if (root / "examples").is_dir():
        paths = {path.relative_to(root / "examples").as_posix(): path for path in (root / "examples").rglob("*.*")}
        return {name: path for name, path in sorted(paths.items()) if path.is_file() and _is_example(name)}
    try:
        files = importlib.metadata.files("spallwatch") or []
    except importlib.metadata.PackageNotFoundError:
        files = []
    found = {file.as_posix().partition(f"{_FOLDER}/")[2]: Path(str(file.locate())) for file in files}
    return {name: path.resolve() for name, path in sorted(found.items()) if _is_example(name)}


def _is_example(name: str) -> bool:
    """Return whether a name is that of an example, not of what Python or an editor put beside it."""
    return bool(name) and "__pycache__" not in name and "/." not in f"/{name}"


@click.command("examples")
@click.argument("names", nargs=-1, metavar="[NAME]...")
@click.option("--out", type=option.FOLDER, default=".", help="Folder to copy the named ones to.")
@option.output
def examples_command(names: tuple[str, ...], out: Path, quiet: bool) -> option.Result:
    """List the examples, or copy the ones that are named: configurations, notebooks, a sender.

    A file of that name that is already there is not replaced.
    """
    del quiet
    known = example_files()
    if not names:
        return {"examples": list(known)}, known
    for name in names:
        if name not in known:
            raise InputError(f"there is no example {name!r}; expected one of: {', '.join(known) or 'none installed'}")
        if (out / Path(name).name).exists():
            raise InputError(f"{out / Path(name).name} is there already; choose another --out")
    out.mkdir(parents=True, exist_ok=True)
    copied = [out / Path(name).name for name in names]
    for name, target in zip(names, copied, strict=True):
        target.write_bytes(known[name].read_bytes())
    return {"out": [str(path) for path in copied]}, map(str, copied)
