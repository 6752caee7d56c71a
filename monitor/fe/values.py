"""What ``spallwatch bearing --fe`` prints and draws: finite elements and the analytic answer side by side."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from models.fe.bearings.self_aligning import SelfAligning
from models.fe.meshes.geometry import fe_geometry
from models.fe.meshes.sizing import half_sizes
from models.machine.bearing import Bearing
from models.machine.hertz import BALL_EXPONENT, point_contact_semi_axes
from models.machine.load_distribution import load_distribution, stiffness_against_load, stiffness_over_passage
from monitor.commands.bearing.statics import LOAD_STEPS, distribution_rows, load_rows, passage_values
from monitor.commands.common import finite
from monitor.fe.shaft import shaft_lines
from monitor.words.numbers import figure

if TYPE_CHECKING:
    from models.fe.bearings.assembly import FePassage
    from models.fe.bearings.bearing import FeContact
    from models.fe.meshes.geometry import FeGeometry, Race
    from monitor.fe.case import FeCase
    from monitor.fe.figure import BearingPicture, Pressure

Partner = tuple[Bearing, float]
_MAX_BODIES = 4
_STATUS_WORDS = {
    "not_in_equilibrium": "the forces of the elements do not balance the load",
    "contact_violated": "an element is loaded with an open contact, or free with a closed one",
    "outside_law": "an element carries more than the meshes were made for",
}
# Quantity, unit, factor from SI or from the key of the answer, digits.
_BESIDE: tuple[tuple[str, str, str, float], ...] = (
    ("stiffness across the load, k_xx", "k_xx_newton_per_m", "MN/m", 1e-6),
    ("stiffness along it, k_yy", "k_yy_newton_per_m", "MN/m", 1e-6),
    ("largest cross term, k_xy", "stiffness_over_passage.k_xy_largest_newton_per_m", "MN/m", 1e-6),
    ("swing of k_xx over a pass", "stiffness_over_passage.k_xx_swing_percent", "%", 1.0),
    ("swing of k_yy over a pass", "stiffness_over_passage.k_yy_swing_percent", "%", 1.0),
    ("displacement along the load", "displacement_um", "um", 1.0),
    ("load of the most loaded element", "largest_element_load_newton", "N", 1.0),
    ("approach of the races there", "approach_um", "um", 1.0),
    ("contact stiffness k_c", "k_c", "", 1.0),
    ("the same by exact elliptic Hertz", "k_c_elliptic", "", 1.0),
    ("pressure in the middle, inner race", "contacts.inner.middle_pressure_mpa", "MPa", 1.0),
    ("pressure in the middle, outer race", "contacts.outer.middle_pressure_mpa", "MPa", 1.0),
    ("largest pressure of a cell, inner race", "contacts.inner.largest_pressure_mpa", "MPa", 1.0),
    ("largest pressure of a cell, outer race", "contacts.outer.largest_pressure_mpa", "MPa", 1.0),
    ("half width on the inner race", "contacts.inner.half_width_um", "um", 1.0),
    ("half width on the outer race", "contacts.outer.half_width_um", "um", 1.0),
    ("half length on the inner race", "contacts.inner.half_length_um", "um", 1.0),
    ("half length on the outer race", "contacts.outer.half_length_um", "um", 1.0),
)


def fe_values(case: FeCase, analytic: Mapping[str, Any], partner: Partner | None) -> dict[str, Any]:
    """Return the answer of finite elements for a program.

    Args:
        analytic: the analytic answer of the command, for the values side by side.
        partner: bearing and contact stiffness of the analytic answer, None where there is none.
    """
    from models.fe.solid.cost import factor_cost
    from models.platform.memory import peak_memory

    made, first = case.bearing, case.first
    assembled = made.assembled
    top = float(first.loads.max())
    approach = float(assembled.law.approach_of(np.array([top]))[0])
    mean = case.passage.mean
    largest = factor_cost(max(made.unknowns.values(), default=0))
    peak = peak_memory()
    values: dict[str, Any] = {
        "support": case.options.support,
        "mesh": case.options.mesh,
        "status": status_of(case.passage),
        "mesh_error_percent": _finite(100.0 * first.mesh_error),
        "below_law_percent": 100.0 * max(state.below_law for state in case.passage.states),
        "estimated": list(case.estimated),
        "k_xx_newton_per_m": _finite(mean[1, 1]),
        "k_yy_newton_per_m": _finite(mean[0, 0]),
        "displacement_um": 1e6 * float(first.displacement[0]),
        "bore_line_displacement_um": 1e6 * first.bore_line,
        "bore_line_stiffness_newton_per_m": first.bore_line_stiffness,
        "load_zone_deg": _loaded_zone(case.passage),
        "largest_element_load_newton": top,
        "load_distribution": distribution_rows(first.angles, first.loads),
        "stiffness_over_passage": {key: _finite(value) for key, value in passage_values(case.passage).items()},
        "radial_stiffness": [
            {key: _finite(value) for key, value in row.items()}
            for row in load_rows(case.loads, case.displacement, case.stiffness)
        ],
        "k_xx_swing_axially_free_percent": _free_swing(case),
        "approach_um": 1e6 * approach,
        **law_values(case, top),
        "contacts": {race: _contact_values(case, race, contact) for race, contact in made.contacts.items()},
        "unknowns": dict(made.unknowns),
        "seconds": case.seconds,
        "from_cache": case.from_cache,
        "memory_estimate_gb": 1e-9 * largest.memory,
        "memory_peak_gb": None if peak is None else 1e-9 * peak,
    }
    return values | {"beside": list(_beside(case, values, analytic, partner))}


def status_of(passage: FePassage) -> str:
    """Return "converged" where all states of a passage are, else what the first other one says."""
    return next((state.status for state in passage.states if not state.converged), "converged")


def status_in_words(status: str) -> str:
    """Return a status with what it means."""
    return f"{status} ({_STATUS_WORDS[status]})" if status in _STATUS_WORDS else status


def _finite(value: Any) -> float | None:
    return finite(float(value))


def _free_swing(case: FeCase) -> float | None:
    """Return the swing of k_xx of a ring that is free along the shaft, None where that changes nothing."""
    assembled = case.bearing.assembled
    if not isinstance(assembled, SelfAligning):
        return None
    return _finite(100.0 * replace(assembled, axial="free").stiffness_over_passage(case.load).swing[1])


def _loaded_zone(passage: FePassage) -> float:
    """Return the extent of the angles at which elements carry load while they pass, degrees."""
    loaded = [np.abs(state.angles[state.loads > 0.0]).max(initial=0.0) for state in passage.states]
    return math.degrees(2.0 * float(max(loaded)))


def law_values(case: FeCase, top: float) -> dict[str, Any]:
    """Return k_c of Q = k_c delta^n with the n of Hertz at a load, N, its range, and the local exponent."""
    law, n = case.bearing.assembled.law, case.exponent
    unit = "m15" if _is_ball(case) else "m109"
    forces = np.array([share * top for share in LOAD_STEPS if law.covers(share * top)])
    range_of = forces / law.approach_of(forces) ** n
    at = law.approach_of(np.array([top]))
    force, slope = law.force(at)
    return {
        f"k_c_newton_per_{unit}": float(top / at[0] ** n),
        f"k_c_range_newton_per_{unit}": [float(range_of.min()), float(range_of.max())],
        "exponent": float(slope[0] * at[0] / force[0]),
    }


def _contact_values(case: FeCase, race: Race, contact: FeContact) -> dict[str, float]:
    ball = _is_ball(case)
    length, width = _hertz_sizes(fe_geometry(case.entry), race, contact.force)
    return {
        "load_newton": contact.force,
        "middle_pressure_mpa": 1e-6 * _middle(contact, ball=ball),
        "largest_pressure_mpa": 1e-6 * float(contact.pressure.max()),
        "hertz_pressure_mpa": 1e-6 * _peak(contact.force, width, length, ball=ball),
        "approach_um": 1e6 * contact.approach,
        "half_width_um": 1e6 * contact.found_half_width,
        "hertz_half_width_um": 1e6 * width,
        "half_length_um": 1e6 * contact.found_half_length,
        "hertz_half_length_um": 1e6 * length,
    }


def _hertz_sizes(geometry: FeGeometry, race: Race, force: float) -> tuple[float, float]:
    """Return half length and half width of a contact by Hertz, without the fits of Eqs. 8 to 10, m."""
    groove = geometry.groove_radius(race)
    if groove is None:
        return half_sizes(geometry, race, force)
    curvature = 1.0 / geometry.element_radius
    rolling = 1.0 / (curvature + (1.0 if race == "inner" else -1.0) / geometry.race_radius(race))
    across = 1.0 / (curvature - 1.0 / groove)
    modulus = geometry.modulus / (1.0 - geometry.poisson**2)
    return point_contact_semi_axes(rolling, across, force, "elliptic", modulus=modulus)


def _is_ball(case: FeCase) -> bool:
    return case.exponent == BALL_EXPONENT


def _middle(contact: FeContact, *, ball: bool) -> float:
    """Return the pressure in the middle of a Hertzian contact of the size found, Pa.

    It carries the force of a ball's contact, and the force a metre in the middle of a roller's: a cell there holds the
    mean over its width only.
    """
    if ball:
        return _peak(contact.force, contact.found_half_width, contact.found_half_length, ball=True)
    cells = contact.cells
    middle = cells.z0 == cells.z0.min()
    per_length = 2.0 * float(np.sum(contact.pressure[middle] * (cells.x1 - cells.x0)[middle]))
    return 2.0 * per_length / (math.pi * contact.found_half_width)


def _peak(force: float, half_width: float, half_length: float, *, ball: bool) -> float:
    return (1.5 if ball else 1.0) * force / (math.pi * half_width * half_length)


def _beside(
    case: FeCase, values: Mapping[str, Any], analytic: Mapping[str, Any], partner: Partner | None
) -> Iterator[dict[str, Any]]:
    """Yield quantity, unit, both values and their difference: % of the analytic one, of swings in points."""
    ball = _is_ball(case)
    unit = "m15" if ball else "m109"
    other = dict(analytic)
    top = analytic["largest_element_load_newton"]
    other["contacts"] = {} if top is None else {race: _hertz_values(case, race, top) for race in case.bearing.contacts}
    if partner is not None and top is not None:
        other["k_c"] = partner[1]
        other["k_c_elliptic"] = analytic["k_c_elliptic_newton_per_m15"]
        other["approach_um"] = 1e6 * (top / partner[1]) ** (1.0 / case.exponent)
    k_c = values[f"k_c_newton_per_{unit}"]
    own = {**values, "k_c": k_c, "k_c_elliptic": k_c}
    for words, key, shown, factor in _BESIDE:
        if key == "k_c_elliptic" and other.get(key) is None:
            continue
        found, known = _at(own, key), _at(other, key)
        if found is None and known is None:
            continue
        shown = f"N/m^{'1.5' if ball else '(10/9)'}" if key.startswith("k_c") else shown
        difference = None
        if found is not None and known:
            difference = found - known if shown == "%" else 100.0 * (found / known - 1.0)
        # A cross term that vanishes by symmetry has no relative difference.
        if key.endswith("k_xy_largest_newton_per_m"):
            difference = None
        yield {
            "quantity": words,
            "unit": shown,
            "analytic": None if known is None else factor * known,
            "finite_elements": None if found is None else factor * found,
            "difference_percent": difference,
        }


def _hertz_values(case: FeCase, race: Race, force: float) -> dict[str, float]:
    length, width = _hertz_sizes(fe_geometry(case.entry), race, force)
    return {
        "half_length_um": 1e6 * length,
        "half_width_um": 1e6 * width,
        "middle_pressure_mpa": 1e-6 * _peak(force, width, length, ball=_is_ball(case)),
    }


def _at(values: Mapping[str, Any], key: str) -> float | None:
    found: Any = values
    for part in key.split("."):
        found = None if found is None else found.get(part)
    return found


def contact_pressures(case: FeCase) -> dict[str, float]:
    """Return the pressure in the middle of both contacts of the most loaded element, Pa."""
    return {race: _middle(contact, ball=_is_ball(case)) for race, contact in case.bearing.contacts.items()}


def fe_lines(values: Mapping[str, Any]) -> Iterator[str]:
    """Yield the lines of finite elements for people."""
    status = values["status"]
    error = values["mesh_error_percent"]
    unknowns = _unknowns(values)
    yield (
        f"finite elements     {values['support']}, {values['mesh']} mesh: {status_in_words(status)}"
        + f"; mesh error {'unknown' if error is None else f'{error:.2g} %'}"
        + (f"; estimated: {', '.join(values['estimated'])}" if values["estimated"] else "")
    )
    source = "kept from before" if values["from_cache"] else f"{values['memory_estimate_gb']:.2g} GB for the largest"
    yield f"  unknowns          {unknowns}; {values['seconds']:.1f} s, {source}"
    yield f"  {'':40}{'analytic':>12}{'elements':>12}{'difference':>12}"
    for row in values["beside"]:
        name = f"{row['quantity']}{', ' if row['unit'] else ''}{row['unit']}"
        cells = "".join(f"{_cell(row[key]):>12}" for key in ("analytic", "finite_elements"))
        points = " pts" if row["unit"] == "%" else " %"
        change = "" if row["difference_percent"] is None else f"{row['difference_percent']:+.1f}{points}"
        yield f"  {name:<40}{cells}{change:>12}"
    if values["support"] == "sinusoidal":
        yield (
            f"  by the bore's line under the load, as in the thesis: {values['bore_line_displacement_um']:.3g} um, "
            f"{1e-6 * values['bore_line_stiffness_newton_per_m']:.4g} MN/m"
        )
    free = values["k_xx_swing_axially_free_percent"]
    if free is not None:
        yield f"  the ring is held along the shaft; free, k_xx swings by {free:.2f} %"
    yield f"  k_c follows Q = k_c delta^{values['exponent']:.3f} there, over load/4 to 4 load {_range(values)}"
    for row in values["radial_stiffness"]:
        if row["k_xx_newton_per_m"] is None or row["k_yy_newton_per_m"] is None:
            yield f"  at {row['load_newton']:8g} N     not computed: beyond the loads of the meshes"
        else:
            yield (
                f"  at {row['load_newton']:8g} N     {row['k_xx_newton_per_m'] / 1e6:.1f} and "
                f"{row['k_yy_newton_per_m'] / 1e6:.1f} MN/m, {row['displacement_um']:.2f} um"
            )

    if values["shaft"] is not None:
        yield from shaft_lines(values["shaft"])


def _unknowns(values: Mapping[str, Any]) -> str:
    """Return the unknowns of all bodies, of many only how many."""
    counts: dict[str, int] = values["unknowns"]
    if len(counts) > _MAX_BODIES:
        return f"{len(counts)} bodies, up to {max(counts.values()):,}"
    return ", ".join(f"{name} {count:,}" for name, count in counts.items())


def _range(values: Mapping[str, Any]) -> str:
    key = next(key for key in values if key.startswith("k_c_range_"))
    low, high = values[key]
    return f"it is {low:.4g} to {high:.4g}"


def _cell(value: float | None) -> str:
    if value is None:
        return "-"
    return f"{value:.4g}" if abs(value) < 1e5 else f"{value:.4e}"


def fe_picture(case: FeCase, values: Mapping[str, Any], partner: Partner | None) -> BearingPicture:
    """Return what is drawn of finite elements, beside the analytic answer where there is one."""
    from monitor.fe.figure import BearingPicture

    made, first = case.bearing, case.first
    known = None if partner is None else _analytic(case, *partner)
    return BearingPicture(
        f"{case.entry.bearing.designation} by finite elements",
        f"{figure(case.load)} N radial, radial clearance {figure(1e6 * case.clearance, 2)} µm, {case.options.support}, "
        f"{case.options.mesh} mesh: {status_in_words(values['status'])}.",
        _facts(values),
        {race: _pressure(case, race, contact) for race, contact in made.contacts.items()},
        (None if known is None else known[0], (first.angles, first.loads)),
        case.passage.cage_angle,
        (None if known is None else known[1], case.passage.matrix),
        np.array(case.loads),
        (None if known is None else known[2], case.stiffness),
    )


def _facts(values: Mapping[str, Any]) -> list[tuple[str, str]]:
    error = values["mesh_error_percent"]
    return [
        ("Mesh error", "unknown" if error is None else f"{figure(error, 2)} % of the approach"),
        ("Unknowns", _unknowns(values)),
        *([("Estimated", ", ".join(values["estimated"]).replace("_", " "))] if values["estimated"] else []),
    ]


def _analytic(
    case: FeCase, bearing: Bearing, k_c: float
) -> tuple[tuple[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64], NDArray[np.float64]]:
    """Return angles, rad, and loads, N, of elements, and stiffness, N/m: over the same passage, against the load."""
    shared = load_distribution(bearing, case.load, k_c, clearance=case.clearance)
    passage = stiffness_over_passage(bearing, case.load, k_c, clearance=case.clearance)
    _, stiffness = stiffness_against_load(bearing, case.loads, k_c, clearance=case.clearance)
    # The analytic passage has cage angles of its own.
    turns = case.passage.cage_angle
    spacing = 2.0 * math.pi / bearing.n_elements
    matrix = np.empty((len(turns), 2, 2))
    for i in range(2):
        for j in range(2):
            matrix[:, i, j] = np.interp(turns, passage.cage_angle, passage.matrix[:, i, j], period=spacing)
    return (shared.angles, shared.loads), matrix, stiffness


def _pressure(case: FeCase, race: Race, contact: FeContact) -> Pressure:
    from monitor.fe.figure import Pressure

    cells = contact.cells
    x = np.append(np.unique(cells.x0), cells.x1.max())
    z = np.append(np.unique(cells.z0), cells.z1.max())
    pressure = contact.pressure.reshape(len(x) - 1, len(z) - 1)
    length, width = _hertz_sizes(fe_geometry(case.entry), race, contact.force)
    ball = _is_ball(case)
    return Pressure(x, z, pressure, width, length, _peak(contact.force, width, length, ball=ball), not ball)
