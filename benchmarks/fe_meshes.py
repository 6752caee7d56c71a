"""Meshes that follow the load: their unknowns, and the error of an approach against a much finer mesh.

Run as ``python -m benchmarks.fe_meshes [--quick] [--json FILE] [--picture FILE]``. The inner contact of one element
is pressed to the loads of section 3.3 (Q1, Q2): the element held in its middle plane, the ring at its bore.
"deviation" is that of the approach, element and race together, from the finest rule; the other tables have the largest
pressure with and without cells on the roller's rounded edge, and what the slope of the common surface does to a ball's
approach.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from benchmarks.common import Row, print_table, write_json
from models.fe.bearings.element import surface_gap
from models.fe.meshes.ball_mesh import ball_mesh
from models.fe.meshes.common_surface import common_slopes
from models.fe.meshes.geometry import FeGeometry, Race, fe_geometry
from models.fe.meshes.grid import mesh_quality
from models.fe.meshes.ring_mesh import ring_mesh
from models.fe.meshes.roller_mesh import roller_mesh
from models.fe.meshes.sizing import MeshRule, contact_grid
from models.fe.solid.condense import ContactCells, compliance
from models.fe.solid.contact import press_to_force
from models.fe.solid.elastic import ElasticBody
from models.machine.bearing import catalogue_entry

RULES = {
    "default": MeshRule(),
    "size 0.5": MeshRule(patch=1.5, size=0.5),
    "size 0.8": MeshRule(patch=1.6, size=0.8, growth=2.0, along=4),
}
FINEST = MeshRule(size=0.27, growth=1.5, along=7, end=0.125, coarse=1.5)
LOADS = {"NU 202 ECP": (37.0, 3706.0), "6210": (219.0, 10052.0)}
EDGE_RULES = (MeshRule(patch=1.5, size=0.5), MeshRule(patch=1.5, size=0.5, along=8, end=0.06))


@dataclass(frozen=True)
class Pressed:
    """One contact: unknowns, approach, m, largest pressure, Pa, least relative Jacobian of both meshes, time, s."""

    element_unknowns: int
    ring_unknowns: int
    approach: float
    pressure: float
    least_jacobian: float
    seconds: float


def press(geometry: FeGeometry, race: Race, force: float, rule: MeshRule, *, sloped: bool = True) -> Pressed:
    """Return the contact of one element with a race on the meshes of a rule."""
    start = time.perf_counter()
    grid = contact_grid(geometry, race, force, rule)
    cells = ContactCells.about_nodes(grid.x, grid.z)
    make = ball_mesh if geometry.element == "ball" else roller_mesh
    meshes = (make(geometry, grid, rule), ring_mesh(geometry, race, grid, rule))
    back = "bore" if race == "inner" else "outside"
    supports: Any = ({"x0": (0,), "y0": (1,), "z0": (2,)}, {"x0": (0,), "z0": (2,), back: (0, 1, 2)})
    slopes = common_slopes(geometry, race) if sloped else (None, None)
    bodies = [ElasticBody(meshes[i], geometry.modulus, geometry.poisson, supports[i]) for i in (0, 1)]
    parts = [compliance(bodies[i], "contact", cells, slope=slopes[i]) for i in (0, 1)]
    state = press_to_force(parts[0] + parts[1], surface_gap(geometry, race, cells), cells.area, 0.25 * force)
    return Pressed(
        element_unknowns=bodies[0].nodes.size,
        ring_unknowns=bodies[1].nodes.size,
        approach=float(state.approach),
        pressure=float(state.pressure.max()),
        least_jacobian=min(mesh_quality(mesh).least_jacobian for mesh in meshes),
        seconds=time.perf_counter() - start,
    )


def rows_of_rules(loads: dict[str, tuple[float, ...]]) -> list[Row]:
    """Return unknowns and deviations from the finest rule."""
    rows: list[Row] = []
    for name, forces in loads.items():
        geometry = fe_geometry(catalogue_entry(name))
        for force in forces:
            fine = press(geometry, "inner", force, FINEST)
            for rule_name, rule in RULES.items():
                found = press(geometry, "inner", force, rule)
                rows.append(
                    {
                        "bearing": name,
                        "load, N": force,
                        "rule": rule_name,
                        "unknowns, element": found.element_unknowns,
                        "unknowns, ring": found.ring_unknowns,
                        "unknowns, finest": fine.element_unknowns + fine.ring_unknowns,
                        "approach, um": 1e6 * found.approach,
                        "deviation, %": 100.0 * (found.approach / fine.approach - 1.0),
                        "least Jacobian": found.least_jacobian,
                        "time, s": found.seconds,
                    }
                )
    return rows


def rows_of_edges() -> list[Row]:
    """Return the largest pressure of the roller with and without cells on its rounded edge, on two meshes."""
    geometry = fe_geometry(catalogue_entry("NU 202 ECP"))
    rows: list[Row] = []
    for over in (0, 2):
        for rule in EDGE_RULES:
            found = press(geometry, "inner", 3706.0, replace(rule, over=over))
            rows.append(
                {
                    "cells on the edge": over,
                    "layers along": rule.along,
                    "largest pressure, GPa": 1e-9 * found.pressure,
                    "approach, um": 1e6 * found.approach,
                }
            )
    return rows


def rows_of_slopes(forces: tuple[float, ...]) -> list[Row]:
    """Return what the slope of the common surface adds to the approach of the 6210, %."""
    geometry = fe_geometry(catalogue_entry("6210"))
    rows: list[Row] = []
    for force in forces:
        for race in ("inner", "outer"):
            flat, sloped = (press(geometry, race, force, RULES["size 0.5"], sloped=on) for on in (False, True))
            change = 100.0 * (sloped.approach / flat.approach - 1.0)
            rows.append({"race": race, "load, N": force, "approach by the slope, %": change})
    return rows


def draw(path: Path) -> None:
    """Draw the meshes of both bearings at the load Q2."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    from monitor.fe.figure_mesh import draw_boundary

    figure = Figure(figsize=(11.0, 6.4), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(2, 4)
    for row, (name, forces) in zip(axes, LOADS.items(), strict=True):
        geometry = fe_geometry(catalogue_entry(name))
        grid = contact_grid(geometry, "inner", forces[1])
        make = ball_mesh if geometry.element == "ball" else roller_mesh
        element, ring = make(geometry, grid), ring_mesh(geometry, "inner", grid)
        reach = 4.0 * grid.half_width
        for place, (mesh, boundary, shown, near, title) in zip(
            row,
            (
                (element, "z0", (0, 1), None, f"{name}: eighth of an element"),
                (element, "z0", (0, 1), reach, "at the contact"),
                (element, "x0", (2, 1), None, "along the shaft"),
                (ring, "z0", (0, 1), None, "half the inner ring"),
            ),
            strict=True,
        ):
            draw_boundary(place, mesh, boundary, shown, near)
            place.set_title(title, fontsize=9)
    figure.savefig(path, dpi=85)


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path, metavar="FILE")
    parser.add_argument("--picture", type=Path, metavar="FILE")
    parser.add_argument("--quick", action="store_true")
    options = parser.parse_args()
    if options.picture is not None:
        draw(options.picture)
    loads = {"NU 202 ECP": (3706.0,)} if options.quick else LOADS
    rules, edges = rows_of_rules(loads), rows_of_edges()
    slopes = rows_of_slopes((10052.0,) if options.quick else (219.0, 2000.0, 10052.0))
    print_table("Rules against the finest", rules)
    print_table("Cells on the rounded edge, NU 202 ECP at 3706 N", edges)
    print_table("Slope of the common surface, 6210", slopes)
    write_json(options.json, {"rules": rules, "edges": edges, "slopes": slopes})


if __name__ == "__main__":
    main()
