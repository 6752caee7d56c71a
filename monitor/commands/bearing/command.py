"""``spallwatch bearing``: kinematics, contacts, stiffness and life from geometry and load."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import click

from models.machine.bearing import Bearing, CatalogueEntry, kinematics, kinematics_uncertainty
from models.machine.catalogue.series import GeometryOrigin
from models.machine.contact_estimates import LINE_CONTACTS, LineContact, StiffnessEstimate, estimate_stiffness
from models.machine.hertz import contact_stiffness, l10h_life
from models.machine.scene import Defect
from models.published.thesis import published_figures
from models.words.extras import brought
from monitor.commands import option
from monitor.commands.bearing.statics import (
    BallCase,
    analytic_statics,
    areas_known,
    ball_case,
    ball_lines,
    ball_values,
    draw_balls,
    static_lines,
)
from monitor.commands.common import PICTURES, InputError, check_suffix, find_entry, read_machine
from monitor.config.load import Config
from monitor.health.signal.features import fundamentals
from monitor.health.signal.search import family_searches, overlapping

_SHOWN = {
    "n_elements": ("number of elements", 1.0, ""),
    "element_diameter": ("element diameter", 1e3, "mm"),
    "pitch_diameter": ("pitch diameter", 1e3, "mm"),
    "contact_angle": ("contact angle", 180.0 / math.pi, "deg"),
    "effective_length": ("roller length", 1e3, "mm"),
    "outer_race_radius": ("outer race radius", 1e3, "mm"),
    "inner_race_radius": ("inner race radius", 1e3, "mm"),
    "outer_groove_radius": ("outer groove radius", 1e3, "mm"),
    "inner_groove_radius": ("inner groove radius", 1e3, "mm"),
    "dynamic_load_rating": ("load rating C", 1e-3, "kN"),
}
_RATES = {"bpfo": "BPFO", "bpfi": "BPFI", "ftf": "FTF", "bsf": "BSF"}


def origin_values(entry: CatalogueEntry) -> dict[str, Any]:
    """Return the keys of the answer that say where its values come from and how certain they are."""
    uncertainty = kinematics_uncertainty(entry)
    lines = fundamentals(kinematics(entry.bearing, 1.0))
    return {
        "geometry": {name: _value(entry, name, origin) for name, origin in entry.origins.items() if name in _SHOWN},
        "count_probabilities": {str(count): probability for count, probability in entry.counts},
        "bpfo_uncertainty": uncertainty.bpfo,
        "bpfi_uncertainty": uncertainty.bpfi,
        "ftf_uncertainty": uncertainty.ftf,
        "bsf_uncertainty": uncertainty.bsf,
        "families_not_separable": ["|".join(pair) for pair in overlapping(lines, family_searches(uncertainty))],
        "dimensions_mm": None if entry.dimensions is None else [1e3 * value for value in entry.dimensions],
        "clearance_range_um": None
        if entry.clearance_range is None
        else [1e6 * value for value in entry.clearance_range],
        "suffixes": list(entry.notes),
    }


def _value(entry: CatalogueEntry, name: str, origin: GeometryOrigin) -> dict[str, Any]:
    _, factor, unit = _SHOWN[name]
    known = getattr(entry.bearing, name)
    # The spread of an angle is absolute, the others are relative.
    spread = origin.spread * (1.0 if name == "contact_angle" else known)
    return {
        "value": known * factor,
        "unit": unit,
        "source": origin.kind,
        "uncertainty": spread * factor,
        "note": origin.note,
    }


def origin_lines(values: dict[str, Any]) -> Iterator[str]:
    """Yield the lines of text for the keys of ``origin_values``."""
    for name, found in values["geometry"].items():
        uncertain = f" ± {found['uncertainty']:.2g}" if found["uncertainty"] else ""
        yield f"{_SHOWN[name][0]:19s} {found['value']:9.5g}{uncertain} {found['unit']} ({found['source']})".replace(
            "  (", " ("
        )
    alternatives = list(values["count_probabilities"].items())
    if len(alternatives) > 1:
        yield "elements of a row   " + ", ".join(f"{count} ({100 * share:.0f} %)" for count, share in alternatives)
        uncertain = ", ".join(f"{label} {100 * values[f'{name}_uncertainty']:.1f} %" for name, label in _RATES.items())
        yield f"uncertainty         {uncertain} for this number of elements"
    if values["families_not_separable"] and len(alternatives) > 1:
        yield f"not separable       {', '.join(values['families_not_separable'])}: naming may answer with both"
    if values["clearance_range_um"] is not None:
        low, high = values["clearance_range_um"]
        yield f"radial play         {low:.0f} to {high:.0f} um by ISO 5753-1, unmounted; half of it is --clearance-um"
    for note in values["suffixes"]:
        yield f"suffix              {note}"


_PRINTED = ("place", "quantity", "condition", "unit", "relation", "printed", "obtained")


def _extras() -> dict[str, Any]:
    """Return by key of the answer what extras add: ``options``, ``answer``, ``lines`` and ``WORDS`` of modules."""
    return {name: point.load() for name, point in brought("bearing").items()}


def _options_of_extras(function: Callable[..., None]) -> Callable[..., None]:
    for extra in reversed(_extras().values()):
        function = extra.options(function)
    return function


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
@click.option("--plot", type=option.OUT_FILE, help="Draw the balls, or what --fe found (PNG, SVG or HTML).")
@_options_of_extras
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
    quiet: bool,
    **asked: Any,
) -> option.Result:
    """Print fault frequencies, contacts, load distribution, radial stiffness, natural frequencies and L10h life.

    With --dphi-deg the stiffness of the damaged bearing is printed beside that of the healthy one. --statics balls, an
    axial load, a tilt or --plot add the equilibrium of each ball, with its centrifugal force. --fe adds what finite
    elements say of contacts and stiffness under the radial load, beside the analytic answer (half a minute or so;
    results are kept).

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
    check_suffix("--plot", plot, PICTURES)
    extras = {name: extra for name, extra in _extras().items() if asked[name] is not None}
    for name, extra in extras.items():
        _refuse_with(f"--{name}", extra.WORDS, statics, axial_load_newton, tilt_mrad)
    law = contact_law(config, entry, load, line_contact)
    values = describe(config, entry, load, speed, clearance, law, defect)
    values |= dict.fromkeys(("ball_statics", *_extras()))
    for key, extra in extras.items():
        rig_name = designation or name or config.bearing[0].name
        options = replace(asked[key], plot=plot, rig_name=rig_name, quiet=quiet)
        values[key] = extra.answer(entry, load, clearance, values, law.partner, options)
    if not extras and any(given is not None for given in (statics, axial_load_newton, tilt_mrad, plot)):
        axial = config.operating.axial_load_newton if axial_load_newton is None else axial_load_newton
        tilt = 0.0 if tilt_mrad is None else 1e-3 * tilt_mrad
        values["ball_statics"] = _ball_by_ball(ball_case(entry, load, axial, tilt, speed, clearance), plot)
    return values, _lines(bearing, load, speed, values)


def _ball_by_ball(case: BallCase, plot: Path | None) -> dict[str, Any]:
    """Return what is printed ball by ball; draw it where a file is given."""
    try:
        states = case.passage()
    except (ValueError, RuntimeError) as error:
        raise InputError(f"--statics balls: {error}") from None
    values = ball_values(case, states)
    if plot is not None:
        draw_balls(case, states, values, plot)
    return values


def _refuse_with(option: str, words: str, statics: str | None, axial_load: float | None, tilt: float | None) -> None:
    for given, other in ((statics, "--statics"), (axial_load, "--axial-load-newton"), (tilt, "--tilt-mrad")):
        if given is not None:
            raise InputError(f"{option} and {other}: {words} take a radial load alone; leave one of them out")


@dataclass(frozen=True)
class ContactLaw:
    """Contact stiffness k_c of a bearing by all that is known of it, N/m^1.5 or N/m^(10/9); None where unknown.

    Attributes:
        configured: of ``[rig]``.
        geometry, elliptic: from the radii, by the thesis' formulas and by exact elliptic Hertz.
        estimate: where radii are unknown, with its bound.
        formulas: of rollers, by formula of the line contact.
        used: the one with which stiffness is computed.
        filled: the bearing with estimates in the place of unknown radii.
    """

    configured: float | None
    geometry: float | None
    elliptic: float | None
    estimate: StiffnessEstimate | None
    formulas: dict[str, dict[str, Any]] | None
    used: float | None
    filled: Bearing

    @property
    def partner(self) -> tuple[Bearing, float] | None:
        """Bearing and k_c of the analytic answer, None where there is none."""
        return None if self.used is None else (self.filled, self.used)


def contact_law(config: Config, entry: CatalogueEntry, load: float, line_contact: LineContact) -> ContactLaw:
    """Return the contact stiffness of a bearing under a load, N."""
    bearing = entry.bearing
    configured = bearing.element == "ball" or config.rig.k_c_newton_per_m109 is not None
    k_c = config.rig_of(entry).k_c if config.owns_rig(entry) and configured else None
    geometry, elliptic = contact_stiffnesses(bearing)
    estimate = None if geometry is not None and not entry.estimated else _estimate(entry, line_contact, load)
    formulas = None if bearing.element == "ball" else _formulas(entry, load)
    used = k_c if k_c is not None else geometry
    if used is None and estimate is not None:
        used = estimate.value
    if formulas is not None and line_contact != "palmgren":
        used = formulas[line_contact]["value"]
    filled = bearing if estimate is None else estimate.bearing
    return ContactLaw(k_c, geometry, elliptic, estimate, formulas, used, filled)


def describe(
    config: Config,
    entry: CatalogueEntry,
    load: float,
    speed: float,
    clearance: float,
    law: ContactLaw,
    defect: Defect | None = None,
) -> dict[str, Any]:
    """Return the keys of the interface; None for values that need data missing from the catalogue."""
    bearing = entry.bearing
    lines = kinematics(bearing, speed)
    k_c = law.configured
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
        f"k_c_geometry_newton_per_{_power(bearing)}": law.geometry,
        "k_c_elliptic_newton_per_m15": law.elliptic,
        f"k_c_estimate_newton_per_{_power(bearing)}": None if law.estimate is None else _bounded(law.estimate),
        "k_c_line_contact_newton_per_m109": law.formulas,
        **origin_values(entry),
        **analytic_statics(bearing, config.rig_of(entry), load, law.used, clearance, defect),
        "contact_areas_um": None if law.used is None else areas_known(law.filled, load, law.used, clearance),
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
        yield from static_lines(values)
    if values["ball_statics"] is not None:
        yield from ball_lines(values["ball_statics"])
    for name, extra in _extras().items():
        if values[name] is not None:
            yield from extra.lines(values[name])
    if values["l10h_days"] is not None:
        yield f"L10h life           {values['l10h_days']:.2f} days"
    verdicts = Counter(figure["verdict"] for figure in values["published"])
    if verdicts:
        counts = ", ".join(f"{count} {verdict}" for verdict, count in verdicts.items())
        yield f"printed figures     {counts} (--json lists them)"


def _power(bearing: Bearing) -> str:
    return "m15" if bearing.element == "ball" else "m109"
