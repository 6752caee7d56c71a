"""``spallwatch warmup``: pay ahead what the first use would pay."""

from __future__ import annotations

import time
from pathlib import Path

import click

from monitor.commands.common import config_option, emit, output_options, read_config
from monitor.config import Config


@click.command("warmup")
@config_option()
@output_options
def command(config_path: Path | None, as_json: bool, quiet: bool) -> None:
    """Compile the bearing model and plan the transforms of a configuration.

    What is compiled is kept for later runs on this machine, where the installation or the home of the user can be
    written to; a second warmup then only loads it. Transforms are planned anew by every process, by estimate, so that
    results do not depend on the day: planning them here says how long that takes and that it can be done.
    """
    compiled = _compile()
    config = read_config(config_path) if config_path is not None or Path("config.toml").exists() else None
    began = time.perf_counter()
    planned = 0 if config is None else _plan(config)
    values = {"compile_seconds": compiled, "plan_seconds": time.perf_counter() - began, "transforms": planned}
    lines = (
        f"model: compiled or loaded in {values['compile_seconds']:.2f} s",
        f"transforms: {planned} planned in {values['plan_seconds']:.2f} s",
    )
    emit(values, lines, as_json=as_json)


def _compile() -> float:
    """Run every kernel of scenes and maps once; return the seconds that took, imports included."""
    began = time.perf_counter()
    from models.map_build import build_map
    from models.map_data import MapPlan
    from models.scene import Defect, Scene
    from models.simulate import simulate

    defect = Defect(dphi_d=0.1, h_d=1e-5)
    simulate(Scene(speed=40.0, load=4000.0, defect=defect))
    build_map(MapPlan(load=(4000.0,), speed=(40.0,), h_d=(defect.h_d,), dphi_d=(defect.dphi_d,)))
    return time.perf_counter() - began


def _plan(config: Config) -> int:
    """Plan one transform for each channel whose bands, block length and rate are configured; return how many."""
    from monitor.health.spectrum import get_transform

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
