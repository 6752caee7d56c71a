"""``spallwatch bearing``: what geometry and load say of a bearing."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click

from models.bearing import Bearing, catalogue, from_catalogue, kinematics
from models.hertz import contact_stiffness, l10h_life, mean_bearing_stiffness
from models.modes import natural_frequencies
from monitor.commands.common import InputError, config_option, emit, output_options, read_machine
from monitor.config import Config


@click.command("bearing")
@config_option()
@click.option("--bearing", "name", help="A bearing of the configuration or of the catalogue; the first configured one.")
@click.option("--load-newton", type=click.FloatRange(min=0, min_open=True), help="Radial load.")
@click.option("--speed-hz", type=click.FloatRange(min=0, min_open=True), help="Shaft speed.")
@click.option("--clearance-um", type=click.FloatRange(min=0), help="Radial clearance.")
@output_options
def command(
    config_path: Path | None,
    name: str | None,
    load_newton: float | None,
    speed_hz: float | None,
    clearance_um: float | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Print fault frequencies, contact and radial stiffness, natural frequencies and L10h life.

    Without a configuration the bench of the thesis is taken: a 1205 ETN9 at 40 Hz and 4000 N.
    """
    config = read_machine(config_path)
    bearing, clearance = find_bearing(config, name)
    speed = speed_hz if speed_hz is not None else config.operating.speed_hz
    load = load_newton if load_newton is not None else config.operating.load_newton
    if speed is None or not load:
        raise InputError("--speed-hz and --load-newton: neither given nor in the configuration ([operating])")
    if clearance_um is not None:
        clearance = clearance_um * 1e-6
    values = describe(config, bearing, load, speed, clearance)
    emit(values, _lines(bearing, load, speed, values), as_json=as_json)


def find_bearing(config: Config, name: str | None) -> tuple[Bearing, float]:
    """Return a bearing by its configured name or its designation, and its configured clearance, m.

    Raises:
        InputError: if there is none of that name.
    """
    if name is None:
        return config.bearing[0].to_bearing(), config.bearing[0].clearance_um * 1e-6
    for section in config.bearing:
        if section.name == name:
            return section.to_bearing(), section.clearance_um * 1e-6
    if name in catalogue():
        return from_catalogue(name), 0.0
    known = ", ".join([section.name for section in config.bearing] + sorted(catalogue()))
    raise InputError(f"--bearing {name!r} is neither configured nor in the catalogue; known are: {known}")


def describe(config: Config, bearing: Bearing, load: float, speed: float, clearance: float) -> dict[str, Any]:
    """Return the keys of the interface; null where the catalogue lacks what a figure needs."""
    lines = kinematics(bearing, speed)
    rig = config.rig.to_rig()
    # [rig] describes the first bearing of the configuration; its contact stiffness says nothing about another one.
    own = bearing == config.bearing[0].to_bearing() and bearing.element == "ball"
    k_c = rig.k_c if own else None
    try:
        geometry: float | None = contact_stiffness(bearing)
    except ValueError:
        geometry = None
    used = k_c if k_c is not None else geometry
    k_xx = k_yy = None
    frequencies: list[float] | None = None
    if used is not None:
        stiffness = mean_bearing_stiffness(bearing, load, used, clearance=clearance)
        k_yy, k_xx = float(stiffness[0, 0]), float(stiffness[1, 1])
        frequencies = [float(f) for f in natural_frequencies(rig, k_xx, k_yy)]
    life = None
    if bearing.dynamic_load_rating is not None:
        life = l10h_life(bearing.dynamic_load_rating, load, speed, bearing.element) / 86400.0
    exponent = "m15" if bearing.element == "ball" else "m109"
    return {
        "designation": bearing.designation,
        "source": bearing.source,
        "ftf_hz": lines.ftf,
        "bpfo_hz": lines.bpfo,
        "bpfi_hz": lines.bpfi,
        "bsf_hz": lines.bsf,
        "k_c_newton_per_m15": k_c,
        f"k_c_geometry_newton_per_{exponent}": geometry,
        "k_xx_newton_per_m": k_xx,
        "k_yy_newton_per_m": k_yy,
        "natural_frequencies_hz": frequencies,
        "l10h_days": life,
    }


def _lines(bearing: Bearing, load: float, speed: float, values: dict[str, Any]) -> Iterator[str]:
    yield f"{bearing.designation} at {speed:g} Hz and {load:g} N ({bearing.source})"
    yield f"cage (FTF)          {values['ftf_hz']:9.2f} Hz"
    yield f"outer race (BPFO)   {values['bpfo_hz']:9.2f} Hz"
    yield f"inner race (BPFI)   {values['bpfi_hz']:9.2f} Hz"
    yield f"element spin (BSF)  {values['bsf_hz']:9.2f} Hz, its defect shows at {2 * values['bsf_hz']:.2f} Hz"
    unit = "N/m^1.5" if bearing.element == "ball" else "N/m^(10/9)"
    for key, words in (
        ("k_c_newton_per_m15", "configured"),
        (f"k_c_geometry_newton_per_{_power(bearing)}", "geometry"),
    ):
        if values[key] is not None:
            yield f"contact stiffness   {values[key]:9.4g} {unit} ({words})"
    if values["k_xx_newton_per_m"] is None:
        yield "radial stiffness    not computed: the catalogue lacks the race radii"
    else:
        yield (
            f"radial stiffness    {values['k_xx_newton_per_m'] / 1e6:.1f} MN/m across the load, "
            f"{values['k_yy_newton_per_m'] / 1e6:.1f} MN/m along it"
        )
        yield "natural frequencies " + ", ".join(f"{f:.1f}" for f in values["natural_frequencies_hz"]) + " Hz"
    if values["l10h_days"] is not None:
        yield f"L10h life           {values['l10h_days']:.2f} days"


def _power(bearing: Bearing) -> str:
    return "m15" if bearing.element == "ball" else "m109"
