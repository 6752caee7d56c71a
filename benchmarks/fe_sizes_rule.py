"""The own rule of meshes: error of one contact's approach against unknowns and time, on bearings of several sizes.

Errors are those of the approach of element half and inner sector against ``REFERENCE``. The constants of
``MeshRule()`` are judged once on ``HELD_OUT``, bearings and loads in no other part of this study.
"""

from __future__ import annotations

import time
from dataclasses import replace

from benchmarks.common import Row
from models.fe.meshes.geometry import FeGeometry, fe_geometry
from models.fe.meshes.sizing import MeshRule, contact_grid, uniform_rule
from models.fe.solid.condense import ContactCells
from models.fe.submodel.sector import SectorState, pressed, sector_cells, sector_contact
from models.machine.bearing import catalogue_entry

REFERENCE = MeshRule(patch=1.6, size=0.267, growth=1.45, along=7)
# Groove radii of deep groove ball bearings that the catalogue does not have, by the ball's diameter.
OSCULATION = 0.52
TRIED = (("NU 202 ECP", 3706.0), ("6210", 2000.0), ("NU 310", 2000.0))
HELD_OUT = (("NU 208", 2500.0), ("NU 2210", 400.0), ("6308", 3000.0), ("6004", 60.0))
BASE = MeshRule()
VARIANTS: dict[str, MeshRule] = {
    "own": BASE,
    "size 1.6": replace(BASE, size=1.6),
    "size 0.8": replace(BASE, size=0.8),
    "size 0.53": replace(BASE, size=0.534),
    "patch 1.2": replace(BASE, patch=1.2),
    "growth 1.4": replace(BASE, growth=1.4),
    "growth 2.2": replace(BASE, growth=2.2),
    "along 3": replace(BASE, along=3),
    "size 0.53, growth 2.2": replace(BASE, size=0.534, growth=2.2),
    "size 0.8, growth 2.2": replace(BASE, size=0.8, growth=2.2),
}
"""One constant of the rule changed at a time, and two that make it cheaper."""
UNIFORM_MM = {"NU 202 ECP": (0.5, 0.35, 0.25, 0.18, 0.13)}


def study_geometry(name: str) -> FeGeometry:
    """Return a bearing of the catalogue, a ball bearing without known grooves with those of ``OSCULATION``."""
    entry = catalogue_entry(name)
    bearing = entry.bearing
    if bearing.element == "ball" and bearing.inner_groove_radius is None:
        groove = OSCULATION * bearing.element_diameter
        entry = replace(entry, bearing=replace(bearing, inner_groove_radius=groove, outer_groove_radius=groove))
    return fe_geometry(entry)


def inner_contact(geometry: FeGeometry, force: float, rule: MeshRule, cells: ContactCells | None = None) -> SectorState:
    """Return the state of the contact with the inner race alone."""
    start = time.process_time()
    grid = contact_grid(geometry, "inner", force, rule)
    state = pressed(geometry, [sector_contact(geometry, "inner", grid, rule, cells=cells)], force)
    return replace(state, seconds=time.process_time() - start)


def _row(name: str, force: float, what: str, state: SectorState, exact: float) -> Row:
    return {
        "bearing": name,
        "Q N": force,
        "rule": what,
        "error %": 100.0 * (state.approach / exact - 1.0),
        "unknowns": state.unknowns,
        "seconds": state.seconds,
    }


def rule_rows() -> list[Row]:
    """Return error, unknowns and time of all variants on the bearings that were tried."""
    rows: list[Row] = []
    for name, force in TRIED:
        geometry = study_geometry(name)
        exact = inner_contact(geometry, force, REFERENCE)
        rows.append(_row(name, force, "reference", exact, exact.approach))
        for what, rule in VARIANTS.items():
            rows.append(_row(name, force, what, inner_contact(geometry, force, rule), exact.approach))
    return rows


def held_out_rows() -> list[Row]:
    """Return the own rule on bearings and loads held out."""
    rows: list[Row] = []
    for name, force in HELD_OUT:
        geometry = study_geometry(name)
        exact = inner_contact(geometry, force, REFERENCE)
        rows.append(_row(name, force, "reference", exact, exact.approach))
        rows.append(_row(name, force, "own", inner_contact(geometry, force, BASE), exact.approach))
    return rows


def uniform_rows() -> list[Row]:
    """Return meshes of one size throughout and meshes that follow the load, both loads of the roller bearing.

    Both have the same layers along the roller, so that they differ across it only. Meshes of one size have the pressure
    cells of the own rule: cells as large as their elements would not see the gap of a contact that is narrower.
    """
    rows: list[Row] = []
    name = "NU 202 ECP"
    # Rings hardly longer than the contact: layers beyond it would be of one size too.
    geometry = replace(study_geometry(name), width=6e-3)
    for force in (37.0, 3706.0):
        base = replace(BASE, along=5)
        exact = inner_contact(geometry, force, replace(REFERENCE, along=5))
        rows.append(_row(name, force, "reference", exact, exact.approach))
        for size in (1.6, 0.8, 0.534, 0.4):
            state = inner_contact(geometry, force, replace(base, size=size, growth=2.2))
            rows.append(_row(name, force, f"own, {size:g} b", state, exact.approach))
        cells = sector_cells(contact_grid(geometry, "inner", force, base))
        for size in UNIFORM_MM[name]:
            rule = replace(uniform_rule(geometry, "inner", force, 1e-3 * size, along=5), end=base.end)
            state = inner_contact(geometry, force, rule, cells)
            rows.append(_row(name, force, f"uniform, {size:g} mm", state, exact.approach))
    return rows
