"""Spherical roller bearing 22207 by finite elements: what its unknown profile does to the stiffness.

Run as ``python -m benchmarks.fe_spherical [--quick] [--json FILE]``.

The catalogue's 22207 is estimated from boundary dimensions and has no profile, for which ``oblique_geometry`` refuses
it. Here the profile is varied: barrels whose radius is a share (osculation) of the sphere's, the inner race with the
same radius as the outer one. A barrel on a race is a crowned roller on a cylinder of the difference of curvatures, so
that one pair of bodies at each race serves all osculations; both rows are assembled at the contact angle on rigid
seats. The bodies are those of one row, half as wide as the bearing; radii count along the normal.
"""

from __future__ import annotations

import math
import time
from dataclasses import replace

import numpy as np

from benchmarks.common import Row, arguments, print_table, write_json
from models.fe.bearings.law import ElementLaw, LawTable
from models.fe.bearings.oblique import ObliqueBearing, ObliqueError, RowInfluence, oblique_geometry
from models.fe.bearings.profiles import RULE, RollerOnRace, roller_on_race
from models.fe.meshes.geometry import FeGeometry
from models.fe.meshes.sizing import MeshRule
from models.machine.bearing import catalogue_entry

DESIGNATION = "22207"
OSCULATIONS = (0.95, 0.96, 0.97, 0.98, 0.99)
LOADS = (2000.0, 10000.0)
MADE_FOR = (120.0, 600.0, 2500.0)
SHARES = (0.2, 0.35, 0.6, 1.0)


def refusal() -> str:
    """Return why the catalogue's bearing is refused."""
    try:
        oblique_geometry(catalogue_entry(DESIGNATION))
    except ObliqueError as error:
        return str(error)
    raise RuntimeError(f"{DESIGNATION} was expected to be refused")


def one_row() -> FeGeometry:
    """Return one row of the estimated bearing, its radii along the normal of the contacts."""
    entry = catalogue_entry(DESIGNATION)
    bearing, length = entry.bearing, entry.series_length
    if entry.dimensions is None or length is None:
        raise RuntimeError(f"{DESIGNATION}: dimensions and series_length are expected in the catalogue")
    bore, outside, width = entry.dimensions
    radius = 0.5 * bearing.element_diameter
    centre = 0.5 * bearing.pitch_diameter / math.cos(bearing.contact_angle)
    return FeGeometry(
        designation=DESIGNATION, element="roller", n_elements=bearing.n_elements, rows=1, contact_angle=0.0,
        element_radius=radius, inner_race_radius=centre - radius, outer_race_radius=centre + radius,
        bore_radius=0.5 * bore, outside_radius=0.5 * outside, width=0.5 * width, effective_length=length,
        roller_length=length + 0.4e-3, edge_radius=0.2e-3,
    )  # fmt: skip


def barrel(geometry: FeGeometry, osculation: float) -> FeGeometry:
    """Return the row with crowned rollers: the difference of the curvatures of barrel and race."""
    race = geometry.outer_race_radius
    return replace(geometry, profile="crowned", crown_radius=1.0 / (1.0 / (osculation * race) - 1.0 / race))


def law(pairs: list[tuple[float, list[RollerOnRace]]], geometry: FeGeometry) -> ElementLaw:
    """Return the law of a roller of one osculation between both races."""
    tables: list[LawTable] = []
    for made_for, races in pairs:
        loads = made_for * np.array(SHARES)
        approach = [sum(race.press(geometry, float(load)).approach for race in races) for load in loads]
        tables.append(LawTable(loads, np.array(approach), made_for))
    return ElementLaw.from_tables(tables)


def main() -> None:
    """Print the tables and write them."""
    options = arguments(__doc__ or "")
    reason = refusal()
    print(reason)
    entry, row = catalogue_entry(DESIGNATION).bearing, one_row()
    rule = MeshRule(patch=1.6, size=0.8, growth=3.0, coarse=2.0) if options.quick else RULE
    begin, wall = time.process_time(), time.perf_counter()
    # Crowned rollers press a part of their length: the contact in the middle is wider than that of the even line.
    pairs = [
        (load, [roller_on_race(row, race, 2.0 * load, rule, end_size=0.03) for race in ("inner", "outer")])
        for load in MADE_FOR
    ]
    found: list[Row] = []
    for osculation in OSCULATIONS:
        geometry = barrel(row, osculation)
        element = law(pairs, geometry)
        bearing = ObliqueBearing(entry.n_elements, entry.contact_angle, element, RowInfluence.none(entry.n_elements))
        for load in LOADS:
            passage = bearing.stiffness_over_passage(load, 30, axial="held")
            largest = float(bearing.state(load, axial="held").forces.max())
            pressed = pairs[-1][1][0].press(geometry, min(largest, MADE_FOR[-1]))
            found.append({
                "osculation": osculation, "load_newton": load, "k_yy": 1e-6 * float(passage.mean[0, 0]),
                "k_xx": 1e-6 * float(passage.mean[1, 1]), "largest_force_newton": largest,
                "pressed_length_mm": 1e3 * pressed.loaded_length, "peak_gpa": 1e-9 * pressed.peak,
                "mesh_error_percent": 100.0 * element.mesh_error, "covers": str(element.covers(largest)),
            })  # fmt: skip
    spread: list[Row] = [
        {"load_newton": load, "k_yy_spread_percent": _spread(found, load, "k_yy"),
         "k_xx_spread_percent": _spread(found, load, "k_xx"), "cpu_s": time.process_time() - begin,
         "wall_s": time.perf_counter() - wall}
        for load in LOADS
    ]  # fmt: skip
    print_table("osculations", found)
    print_table("spread", spread)
    write_json(options.json, {"refusal": {"reason": reason}, "osculations": found, "spread": spread})


def _spread(rows: list[Row], load: float, name: str) -> float:
    """Return largest less smallest value over the mean, percent."""
    values = np.array([float(row[name] or 0.0) for row in rows if row["load_newton"] == load])
    return 100.0 * float(np.ptp(values) / values.mean())


if __name__ == "__main__":
    main()
