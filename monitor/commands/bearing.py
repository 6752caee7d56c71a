"""``spallwatch bearing``: kinematics, contacts, stiffness and life from geometry and load."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
import numpy as np

from models.bearing import Bearing, CatalogueEntry, kinematics
from models.contact_estimates import StiffnessEstimate, estimate_stiffness
from models.hertz import contact_patches, contact_stiffness, l10h_life, mean_bearing_stiffness
from models.line_contact import LINE_CONTACTS, LineContact
from models.load_distribution import (
    StiffnessPassage,
    load_distribution,
    load_zone,
    stiffness_against_load,
    stiffness_over_passage,
)
from models.published.thesis import published_figures
from models.rigs.six_dof import Rig, natural_frequencies
from models.scene import Defect
from monitor.commands import option
from monitor.commands.bearing_balls import BallCase, ball_case, ball_lines, ball_values, draw_balls
from monitor.commands.bearing_origins import origin_lines, origin_values
from monitor.commands.common import PICTURES, InputError, check_suffix, emit, find_entry, read_machine
from monitor.config.load import Config

LOAD_STEPS = (0.25, 0.5, 1.0, 2.0, 4.0)
"""Multiples of the load at which the radial stiffness is printed."""
_PRINTED = ("place", "quantity", "condition", "unit", "relation", "printed", "obtained")


@click.command("bearing")
@click.argument("designation", required=False)
@option.config
@option.bearing
@click.option("--load-newton", type=option.POSITIVE, help="Radial load.")
@click.option("--speed-hz", type=option.POSITIVE, help="Shaft speed.")
@click.option("--clearance-um", type=option.NOT_NEGATIVE, help="Radial clearance.")
@click.option("--dphi-deg", type=click.FloatRange(min=0, max=360), help="Extent of a defect of the outer race.")
@click.option("--h-d-um", type=option.NOT_NEGATIVE, default=500.0, help="Depth of the defect.")
@click.option("--statics", type=click.Choice(["balls"]), help="balls: forces and contact angles ball by ball.")
@click.option("--axial-load-newton", type=float, help="Ball by ball, with an axial load.")
@click.option("--tilt-mrad", type=float, help="Ball by ball; positive: the loaded side moves against the axial load.")
@click.option("--plot", type=option.OUT_FILE, help="Draw the balls (PNG, SVG or HTML).")
@option.line_contact
@option.output
def command(
    designation: str | None,
    config_path: Path | None,
    name: str | None,
    load_newton: float | None,
    speed_hz: float | None,
    clearance_um: float | None,
    dphi_deg: float | None,
    h_d_um: float,
    statics: str | None,
    axial_load_newton: float | None,
    tilt_mrad: float | None,
    plot: Path | None,
    line_contact: LineContact,
    as_json: bool,
    quiet: bool,
) -> None:
    """Print fault frequencies, contacts, load distribution, radial stiffness, natural frequencies and L10h life.

    With --dphi-deg the stiffness of the damaged bearing is printed beside that of the healthy one. --statics balls, an
    axial load, a tilt or --plot add the equilibrium of each ball, with its centrifugal force.

    DESIGNATION, or --bearing, is a bearing of the configuration or of the catalogue, such as 6205-2RS/C3 or NU205.
    Without a configuration, the test bench of the thesis is used: a 1205 ETN9 at 40 Hz and 4000 N.
    """
    if designation is not None and name is not None:
        raise InputError(f"{designation!r} and --bearing {name!r}: give one of them")
    config = read_machine(config_path)
    entry, clearance = find_entry(config, designation if name is None else name)
    bearing = entry.bearing
    speed = speed_hz if speed_hz is not None else config.operating.speed_hz
    load = load_newton if load_newton is not None else config.operating.load_newton
    if speed is None or not load:
        raise InputError("--speed-hz and --load-newton: neither given nor in the configuration ([operating])")
    if clearance_um is not None:
        clearance = clearance_um * 1e-6
    defect = None if dphi_deg is None else Defect(math.radians(dphi_deg), h_d_um * 1e-6)
    values: dict[str, Any] = {"ball_statics": None}
    if any(given is not None for given in (statics, axial_load_newton, tilt_mrad, plot)):
        axial = config.operating.axial_load_newton if axial_load_newton is None else axial_load_newton
        tilt = 0.0 if tilt_mrad is None else 1e-3 * tilt_mrad
        values = {"ball_statics": _ball_by_ball(ball_case(entry, load, axial, tilt, speed, clearance), plot)}
    values = describe(config, entry, load, speed, clearance, defect, line_contact) | values
    emit(values, _lines(bearing, load, speed, values), as_json=as_json)


def _ball_by_ball(case: BallCase, plot: Path | None) -> dict[str, Any]:
    """Return what is printed ball by ball; draw it where a file is given."""
    if plot is not None:
        check_suffix("--plot", plot, PICTURES)
    try:
        states = case.passage()
    except (ValueError, RuntimeError) as error:
        raise InputError(f"--statics balls: {error}") from None
    values = ball_values(case, states)
    if plot is not None:
        draw_balls(case, states, values, plot)
    return values


def describe(
    config: Config,
    entry: CatalogueEntry,
    load: float,
    speed: float,
    clearance: float,
    defect: Defect | None = None,
    line_contact: LineContact = "palmgren",
) -> dict[str, Any]:
    """Return the keys of the interface; None for values that need data missing from the catalogue."""
    bearing = entry.bearing
    lines = kinematics(bearing, speed)
    rig = config.rig_of(entry)
    configured = bearing.element == "ball" or config.rig.k_c_newton_per_m109 is not None
    k_c = rig.k_c if config.owns_rig(entry) and configured else None
    geometry, elliptic = contact_stiffnesses(bearing)
    estimate = None if geometry is not None and not entry.estimated else _estimate(entry, line_contact, load)
    formulas = None if bearing.element == "ball" else _formulas(entry, load)
    used = k_c if k_c is not None else geometry
    if used is None and estimate is not None:
        used = estimate.value
    if formulas is not None and line_contact != "palmgren":
        used = formulas[line_contact]["value"]
    filled = bearing if estimate is None else estimate.bearing
    life = None
    if bearing.dynamic_load_rating is not None:
        life = l10h_life(bearing.dynamic_load_rating, load, speed, bearing.element) / 86400.0
    return {
        "designation": bearing.designation,
        "source": bearing.source,
        "ftf_hz": lines.ftf,
        "bpfo_hz": lines.bpfo,
        "bpfi_hz": lines.bpfi,
        "bsf_hz": lines.bsf,
        "k_c_newton_per_m15": k_c if bearing.element == "ball" else None,
        "k_c_newton_per_m109": k_c if bearing.element == "roller" else None,
        f"k_c_geometry_newton_per_{_power(bearing)}": geometry,
        "k_c_elliptic_newton_per_m15": elliptic,
        f"k_c_estimate_newton_per_{_power(bearing)}": None if estimate is None else _bounded(estimate),
        "k_c_line_contact_newton_per_m109": formulas,
        **origin_values(entry),
        **statics(bearing, rig, load, used, clearance, defect),
        "contact_areas_um": None if used is None else _areas_known(filled, load, used, clearance),
        "l10h_days": life,
        "published": [
            {
                **{key: getattr(figure, key) for key in _PRINTED},
                "difference_percent": 100.0 * figure.difference,
                "verdict": figure.verdict,
                "note": figure.note,
            }
            for figure in published_figures(bearing.designation)
        ],
    }


def contact_stiffnesses(bearing: Bearing) -> tuple[float | None, float | None]:
    """Return k_c from the geometry by the thesis' formulas and, of balls, by exact elliptic Hertz; None if unknown."""
    try:
        geometry = contact_stiffness(bearing)
    except ValueError:
        return None, None
    return geometry, contact_stiffness(bearing, method="elliptic") if bearing.element == "ball" else None


def _estimate(entry: CatalogueEntry, line_contact: LineContact, load: float) -> StiffnessEstimate | None:
    try:
        return estimate_stiffness(entry, line_contact, load)
    except ValueError:
        return None


def _formulas(entry: CatalogueEntry, load: float) -> dict[str, dict[str, Any]] | None:
    """Return k_c of a roller by each formula of the line contact under the load, with its bound."""
    try:
        return {formula: _bounded(estimate_stiffness(entry, formula, load)) for formula in LINE_CONTACTS}
    except ValueError:
        return None


def _bounded(estimate: StiffnessEstimate) -> dict[str, Any]:
    return {
        "value": estimate.value,
        "low": estimate.low,
        "high": estimate.high,
        "estimated": list(estimate.estimated),
    }


_STATICS = (
    "k_xx_newton_per_m",
    "k_yy_newton_per_m",
    "natural_frequencies_hz",
    "displacement_um",
    "load_zone_deg",
    "largest_element_load_newton",
    "load_distribution",
    "stiffness_over_passage",
    "stiffness_over_damaged_passage",
    "radial_stiffness",
)


def statics(
    bearing: Bearing, rig: Rig, load: float, k_c: float | None, clearance: float, defect: Defect | None
) -> dict[str, Any]:
    """Return what follows from the contact stiffness k_c; all None if it is unknown."""
    if k_c is None:
        return dict.fromkeys(_STATICS)
    mean = mean_bearing_stiffness(bearing, load, k_c, clearance=clearance)
    k_yy, k_xx = float(mean[0, 0]), float(mean[1, 1])
    shared = load_distribution(bearing, load, k_c, clearance=clearance)
    order = np.argsort(shared.angles, kind="stable")
    loads = [share * load for share in LOAD_STEPS]
    displacement, stiffness = stiffness_against_load(bearing, loads, k_c, clearance=clearance)
    values = (
        k_xx,
        k_yy,
        [float(f) for f in natural_frequencies(rig, k_xx, k_yy)],
        1e6 * float(shared.displacement[0]),
        math.degrees(load_zone(float(shared.displacement[0]), clearance)),
        float(shared.loads.max()),
        [{"angle_deg": math.degrees(shared.angles[i]), "load_newton": float(shared.loads[i])} for i in order],
        _passage(stiffness_over_passage(bearing, load, k_c, clearance=clearance)),
        defect and _passage(stiffness_over_passage(bearing, load, k_c, clearance=clearance, defect=defect)),
        [
            {
                "load_newton": at,
                "displacement_um": 1e6 * float(u),
                "k_xx_newton_per_m": float(k[1, 1]),
                "k_yy_newton_per_m": float(k[0, 0]),
            }
            for at, u, k in zip(loads, displacement, stiffness, strict=True)
        ],
    )
    return dict(zip(_STATICS, values, strict=True))


def _passage(passage: StiffnessPassage) -> dict[str, float]:
    """Return the extremes of the stiffness, N/m, and the swing that they make, % of the mean."""
    low, high = passage.matrix.min(axis=0), passage.matrix.max(axis=0)
    return {
        "k_xx_least_newton_per_m": float(low[1, 1]),
        "k_xx_largest_newton_per_m": float(high[1, 1]),
        "k_xx_swing_percent": 100.0 * float(passage.swing[1]),
        "k_yy_least_newton_per_m": float(low[0, 0]),
        "k_yy_largest_newton_per_m": float(high[0, 0]),
        "k_yy_swing_percent": 100.0 * float(passage.swing[0]),
        "k_xy_largest_newton_per_m": passage.largest_coupling,
    }


def _areas_known(bearing: Bearing, load: float, k_c: float, clearance: float) -> dict[str, dict[str, float]] | None:
    """Return ``_areas``, or None where a radius is unknown."""
    try:
        return _areas(bearing, load, k_c, clearance)
    except ValueError:
        return None


def _areas(bearing: Bearing, load: float, k_c: float, clearance: float) -> dict[str, dict[str, float]]:
    """Return half length and half width of the most loaded contacts, um."""
    patches = contact_patches(bearing, float(load_distribution(bearing, load, k_c, clearance=clearance).loads.max()))
    return {
        race: {"half_length": 1e6 * half_length, "half_width": 1e6 * half_width}
        for race, (half_length, half_width) in zip(("inner", "outer"), patches, strict=True)
    }


def _lines(bearing: Bearing, load: float, speed: float, values: dict[str, Any]) -> Iterator[str]:
    yield f"{bearing.designation} at {speed:g} Hz and {load:g} N ({bearing.source})"
    yield f"cage (FTF)          {values['ftf_hz']:9.2f} Hz"
    yield f"outer race (BPFO)   {values['bpfo_hz']:9.2f} Hz"
    yield f"inner race (BPFI)   {values['bpfi_hz']:9.2f} Hz"
    yield f"element spin (BSF)  {values['bsf_hz']:9.2f} Hz, its defect shows at {2 * values['bsf_hz']:.2f} Hz"
    yield from origin_lines(values)
    unit = "N/m^1.5" if bearing.element == "ball" else "N/m^(10/9)"
    estimate = values[f"k_c_estimate_newton_per_{_power(bearing)}"]
    for key, words in (
        (f"k_c_newton_per_{_power(bearing)}", "configured"),
        (f"k_c_geometry_newton_per_{_power(bearing)}", "geometry"),
        ("k_c_elliptic_newton_per_m15", "geometry, exact elliptic Hertz"),
    ):
        if values[key] is not None and (estimate is None or words == "configured"):
            yield f"contact stiffness   {values[key]:9.4g} {unit} ({words})"
    if estimate is not None:
        yield (
            f"contact stiffness   {estimate['value']:9.4g} {unit} (estimated, {estimate['low']:.3g} to "
            f"{estimate['high']:.3g}; estimates: {', '.join(estimate['estimated'])})"
        )
    if values["k_c_line_contact_newton_per_m109"] is not None:
        parts = [f"{name} {found['value']:.3g}" for name, found in values["k_c_line_contact_newton_per_m109"].items()]
        yield f"line contact        {', '.join(parts)} {unit}; lundberg: crowned rollers"
    if values["k_xx_newton_per_m"] is None:
        yield "radial stiffness    not computed: the catalogue lacks radii of races or grooves"
    else:
        yield from _static_lines(values)
    if values["ball_statics"] is not None:
        yield from ball_lines(values["ball_statics"])
    if values["l10h_days"] is not None:
        yield f"L10h life           {values['l10h_days']:.2f} days"
    verdicts = Counter(figure["verdict"] for figure in values["published"])
    if verdicts:
        counts = ", ".join(f"{count} {verdict}" for verdict, count in verdicts.items())
        yield f"printed figures     {counts} (--json lists them)"


def _static_lines(values: dict[str, Any]) -> Iterator[str]:
    yield (
        f"radial stiffness    {values['k_xx_newton_per_m'] / 1e6:.1f} MN/m across the load, "
        f"{values['k_yy_newton_per_m'] / 1e6:.1f} MN/m along it; displacement {values['displacement_um']:.2f} um"
    )
    for key, words in (("stiffness_over_passage", "healthy"), ("stiffness_over_damaged_passage", "damaged")):
        if values[key] is not None:
            yield (
                f"swing of stiffness  {values[key]['k_xx_swing_percent']:.2f} % across, "
                f"{values[key]['k_yy_swing_percent']:.3f} % along, while the elements pass ({words})"
            )
    loaded = sum(element["load_newton"] > 0.0 for element in values["load_distribution"])
    yield (
        f"load distribution   {loaded} elements within {values['load_zone_deg']:.0f} deg, "
        f"{values['largest_element_load_newton']:.0f} N on the most loaded"
    )
    for row in values["radial_stiffness"]:
        yield (
            f"  at {row['load_newton']:8g} N     {row['k_xx_newton_per_m'] / 1e6:.1f} and "
            f"{row['k_yy_newton_per_m'] / 1e6:.1f} MN/m, {row['displacement_um']:.2f} um"
        )
    if values["contact_areas_um"] is not None:
        for race, area in values["contact_areas_um"].items():
            size = f"{2 * area['half_length']:.0f} x {2 * area['half_width']:.0f} um"
            yield f"contact area        {size} on the {race} race"
    yield "natural frequencies " + ", ".join(f"{f:.1f}" for f in values["natural_frequencies_hz"]) + " Hz"


def _power(bearing: Bearing) -> str:
    return "m15" if bearing.element == "ball" else "m109"
