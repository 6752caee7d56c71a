"""``spallwatch warmup``: compile kernels and plan transforms in advance."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING

import click

from monitor.commands import option
from monitor.commands.common import emit, read_config, say
from monitor.config.load import Config

if TYPE_CHECKING:
    from models.warmup import CompiledPart


@click.command("warmup")
@option.config
@option.output
def command(config_path: Path | None, as_json: bool, quiet: bool) -> None:
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
    emit(values, lines, as_json=as_json)


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
