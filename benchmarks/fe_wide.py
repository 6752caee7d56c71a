"""Rollers with profile, cages, and a self-aligning bearing at full width, by finite elements.

Run as ``python -m benchmarks.fe_wide [--quick] [--json FILE]``. Times are process CPU time unless they say "wall".

1. profiles: pressure along the rollers of NU 202 ECP, straight with rounded edges, crowned (0.01 mm at the ends) and
   logarithmic (ISO 16281), in the middle against the plane value, its peak, and the approach, at both races; and the
   peak against the size of the elements about the roller's end;
2. spacing: what elements that lie unevenly in pockets with play do to the stiffness of NU 202 ECP;
3. cage: its bars touch the rollers without play (section 3.5.1): a rigid cage, one of steel and one of polyamide, and
   one of steel with play, at the loads of Fig. 25; and the time that it takes;
4. self-aligning: 1205 ETN9, both rows at full width, against Table 17 and Fig. 36.

The dimensions of the cage are not printed. Chosen: radii 11.3 and 13.5 mm, pockets 6.2 mm long (0.1 mm of play to each
side, as printed), width 10 mm. ``--quick`` takes coarse meshes: its figures are not those of the page.
"""

from __future__ import annotations

import math
import time
from dataclasses import replace

import numpy as np

from benchmarks.common import Row, arguments, print_table, write_json
from models.fe.bearings.balance import PowerLaw
from models.fe.bearings.cage import (
    CageCoupling,
    caged_state,
    drawn_angles,
    even_angles,
    plane_bulge,
    spaced_state,
    spacing_bound,
    squeeze_law,
)
from models.fe.bearings.cage_mesh import CageGeometry, CageRule, cage_opening, roller_bulge
from models.fe.bearings.element import element_law
from models.fe.bearings.law import ElementLaw
from models.fe.bearings.oblique import AXIAL, ObliqueBearing, RowInfluence, oblique_geometry
from models.fe.bearings.oblique_bodies import RULE as OBLIQUE_RULE
from models.fe.bearings.oblique_bodies import oblique_bearing
from models.fe.bearings.profiles import END_SIZE, lundberg_load, roller_on_race
from models.fe.bearings.profiles import RULE as PROFILE_RULE
from models.fe.extra import require_skfem
from models.fe.meshes.geometry import FeGeometry, fe_geometry
from models.fe.meshes.grid import FeMesh
from models.fe.meshes.sizing import MeshRule
from models.fe.solid.condense import ContactCells, ContactFrame, cell_loads
from models.fe.solid.contact import ContactState, press, press_to_force
from models.fe.solid.elastic import ElasticBody
from models.machine import hertz
from models.machine.bearing import catalogue_entry
from models.words.numerics import find_root

ROLLER, SELF_ALIGNING = "NU 202 ECP", "1205 ETN9"
LOADS = (100.0, 500.0, 1000.0, 2500.0, 5000.0, 10000.0)
CAGE = CageGeometry(11, 12.4e-3, 2.75e-3, 11.3e-3, 13.5e-3, 6.2e-3, 10e-3)
# Polyamide with a quarter of glass fibre, of which cages with suffix P are: order of makers' data. Its line of contact
# with the roller is taken as that of steel, so that the effect shown is an upper bound.
POLYAMIDE = (5e9, 0.38)
COARSE = MeshRule(patch=1.5, size=0.75, growth=3.0, along=2, coarse=2.0)
SEED = 21


def profiled() -> dict[str, FeGeometry]:
    """Return the roller bearing with each profile."""
    entry = catalogue_entry(ROLLER)
    return {
        "straight": fe_geometry(entry),
        "crowned": fe_geometry(entry, profile="crowned", crown_radius=0.392),
        "logarithmic": fe_geometry(entry, profile="logarithmic"),
    }


def profile_rows(quick: bool) -> tuple[list[Row], list[Row]]:
    """Return the pressures along rollers, and the peak at straight ends against the elements' size there."""
    geometries = profiled()
    rule = COARSE if quick else PROFILE_RULE
    rows: list[Row] = []
    for race in ("inner", "outer"):
        for load in (741.0, 3706.0):
            pair = roller_on_race(geometries["straight"], race, load, rule)
            for name, geometry in geometries.items():
                found = pair.press(geometry, load)
                rows.append({
                    "race": race, "profile": name, "load_newton": load, "approach_um": 1e6 * found.approach,
                    "middle_gpa": 1e-9 * found.middle, "middle_to_plane": found.middle / found.middle_hertz,
                    "peak_to_middle": found.peak / found.middle, "peak_place_mm": 1e3 * found.peak_place,
                    "pressed_length_mm": 1e3 * found.loaded_length, "middle_line_load_to_mean":
                    float(found.line_load[0]) / found.mean_line_load, "unevenness": found.unevenness,
                    "converged": str(found.converged), "unknowns": sum(pair.unknowns),
                })  # fmt: skip
    sizes: list[Row] = []
    for size in (0.02, END_SIZE) if quick else (0.04, 0.02, 0.01, END_SIZE):
        begin = time.process_time()
        pair = roller_on_race(geometries["straight"], "inner", 3706.0, rule, end_size=size)
        found = pair.press(geometries["straight"], 3706.0)
        sizes.append({
            "end_size_um": 1e6 * size * 2.8e-3, "peak_to_middle": found.peak / found.middle,
            "approach_um": 1e6 * found.approach, "unknowns": sum(pair.unknowns), "cpu_s": time.process_time() - begin,
        })  # fmt: skip
    return rows, sizes


def roller_law(quick: bool) -> tuple[ElementLaw, float]:
    """Return the law of a roller on rings with rigid seats from 3 N to 4 kN, and the CPU time that it took, s."""
    begin = time.process_time()
    rule = COARSE if quick else MeshRule(patch=1.5, size=0.5)
    law = element_law(profiled()["straight"], (25.0, 125.0, 625.0, 3125.0), rule)
    return law, time.process_time() - begin


def spacing_rows(law: ElementLaw) -> list[Row]:
    """Return the change of stiffness by uneven spacing: its bound, and of drawn places."""
    rng = np.random.default_rng(SEED)
    rows: list[Row] = []
    for load in (1000.0, 10000.0):
        for play in (0.1e-3, 0.3e-3):
            turns = 2.0 * math.pi / 11.0 * np.arange(8) / 8.0
            even = np.array([np.diagonal(spaced_state(law, even_angles(11, float(t)), load).stiffness) for t in turns])
            bound = np.max(
                [spacing_bound(law, even_angles(11, float(t)), load, 0.5 * play / CAGE.pitch_radius) for t in turns],
                axis=0,
            )
            changes: list[np.ndarray] = []
            for _ in range(25):
                for t, base in zip(turns, even, strict=True):
                    angles = drawn_angles(11, play, CAGE.pitch_radius, rng, float(t))
                    changes.append(np.diagonal(spaced_state(law, angles, load).stiffness) / base - 1.0)
            spread = np.array(changes)
            rows.append({
                "load_newton": load, "play_mm": 1e3 * play,
                **{f"{name}_{what}_percent": 100.0 * float(value[i])
                   for i, name in enumerate(("k_yy", "k_xx"))
                   for what, value in (("sd", spread.std(axis=0)), ("largest", np.abs(spread).max(axis=0)),
                                       ("bound", bound), ("pass", np.ptp(even, axis=0) / even.mean(axis=0)))},
            })  # fmt: skip
    return rows


def cage_rows(law: ElementLaw, law_s: float, quick: bool) -> tuple[list[Row], list[Row], list[Row]]:
    """Return the effect of cages on the stiffness, what they are made of, and the printed figures."""
    geometry = profiled()["straight"]
    length = geometry.effective_length
    assert length is not None
    begin = time.process_time()
    bulge, bulge_unknowns = roller_bulge(geometry, 3706.0, COARSE if quick else None)
    bulge_s = time.process_time() - begin
    begin = time.process_time()
    steel = cage_opening(CAGE, length)
    opening_s = time.process_time() - begin
    finer = cage_opening(CAGE, length, CageRule(3, 2, 4, 3, 2)) if not quick else steel
    soft = cage_opening(replace(CAGE, modulus=POLYAMIDE[0], poisson=POLYAMIDE[1]), length)
    squeeze = squeeze_law(geometry.element_radius, length, geometry.modulus, geometry.poisson, steel.strip, highest=2e3)
    rollers_alone = squeeze_law(geometry.element_radius, length, geometry.modulus, geometry.poisson, None, highest=2e3)
    cages = {
        "rigid bars": CageCoupling(bulge, rollers_alone, 1e-6 * steel.matrix()),
        "steel": CageCoupling(bulge, squeeze, steel.matrix()),
        "polyamide": CageCoupling(bulge, squeeze, soft.matrix()),
        "steel, play 2 um": CageCoupling(bulge, squeeze, steel.matrix(), 2e-6),
    }
    rows: list[Row] = []
    begin = time.process_time()
    for load in LOADS:
        angles = even_angles(11)
        free = np.diagonal(spaced_state(law, angles, load).stiffness)
        row: dict[str, float | str] = {"load_newton": load, "k_yy_free": 1e-6 * float(free[0])}
        for name, coupling in cages.items():
            state = caged_state(law, coupling, angles, load)
            gain = np.diagonal(state.balance.stiffness) / free - 1.0
            row |= {f"{name}: k_yy_percent": 100.0 * float(gain[0]), f"{name}: bars_newton": float(state.bars.max())}
        rows.append(row)
    states_s = (time.process_time() - begin) / (len(LOADS) * (len(cages) + 1))
    parts: list[Row] = [{
        "bulge_m_per_newton": bulge, "bulge_by_plane": bulge / plane_bulge(length, geometry.modulus, geometry.poisson),
        "opening_um_per_100_newton": 1e8 * float(steel.by_distance[0]),
        "opening_finer_percent": 100.0 * float(finer.by_distance[0] / steel.by_distance[0] - 1.0),
        "cage_unknowns": steel.unknowns, "finer_unknowns": finer.unknowns, "roller_unknowns": bulge_unknowns,
        "law_s": law_s, "bulge_s": bulge_s, "opening_s": opening_s, "state_s": states_s,
        "time_with_by_without": (law_s + bulge_s + opening_s) / law_s,
    }]  # fmt: skip
    last, others = rows[-1], rows[:-1]
    published = [
        _published("Fig. 25", ROLLER, "stiffness with a cage", "10 kN, rigid bars: at most", "%", 3.7,
                   float(last["rigid bars: k_yy_percent"] or 0.0)),
        _published("Fig. 25", ROLLER, "stiffness with a cage", "10 kN, steel", "%", 3.7,
                   float(last["steel: k_yy_percent"] or 0.0)),
        _published("Fig. 25", ROLLER, "stiffness with a cage", "up to 5 kN, steel: at most", "%", 1.4,
                   max(float(row["steel: k_yy_percent"] or 0.0) for row in others)),
        _published("Fig. 25", ROLLER, "time with a cage by that without", "all loads", "1", "2 to 4",
                   float(parts[0]["time_with_by_without"] or 0.0)),
    ]  # fmt: skip
    return rows, parts, published


def plane_check(load: float, refinements: int = 7, start: int = 4) -> Row:
    """Return both contacts of a roller, with races and with rigid bars, solved at once on one disc in plane strain.

    Beside it what the cage's model says: one squeeze law, one bulge, reciprocity. ``load`` is that of 5.6 mm, N.
    """
    radius, modulus, poisson = 2.75e-3, 210e9, 0.3
    plane, line = modulus / (1.0 - poisson**2), load / 5.6e-3
    body = ElasticBody(_quarter_disc(radius, refinements, start), modulus, poisson, {"x0": (0,), "y0": (1,)}, order=2)
    width = _flat_width(line, radius, plane)
    top = ContactCells.grid(np.linspace(0.0, 1.6 * width, 17))
    side = ContactCells.grid(np.linspace(-1.6 * _flat_width(0.15 * line, radius, plane), 0.0, 17))
    frames = (
        ContactFrame(np.array([0.0, radius]), np.eye(2)),
        ContactFrame(np.array([radius, 0.0]), np.array([[0.0, -1.0], [1.0, 0.0]])),
    )
    loads = [cell_loads(body, "arc", cells, frame) for cells, frame in zip((top, side), frames, strict=True)]
    u = np.column_stack([body.solve(part) for part in loads])
    c = np.vstack([part.T @ u for part in loads])
    c, n = 0.5 * (c + c.T), len(top)
    gaps = [(cells.x1**3 - cells.x0**3) / (6.0 * radius * (cells.x1 - cells.x0)) for cells in (top, side)]
    free = press_to_force(c[:n, :n], gaps[0], top.area, 0.5 * line)
    area = np.concatenate((top.area, side.area))

    def pressed(approach: float) -> ContactState:
        # The bars stay where they are: no approach there.
        return press(c, np.concatenate((gaps[0], approach + gaps[1])), area, approach)

    low, high = 0.5 * free.approach, 1.1 * free.approach
    half = find_root(lambda d: float(pressed(d).pressure[:n] @ top.area) - 0.5 * line, low, high, rtol=1e-12)
    bars = 2.0 * float(pressed(half).pressure[n:] @ side.area)
    bulge = plane_bulge(1.0, modulus, poisson)

    def missing(force: float) -> float:
        depth = 2.0 * force / (math.pi * plane)
        return depth * (2.0 * math.log(4.0 * radius / _flat_width(force, radius, plane)) - 1.0) - bulge * line

    model = find_root(missing, 1e-6 * line, line, rtol=1e-12)
    return {
        "load_newton": load, "bars_by_load": bars / line, "model_bars_by_load": model / line,
        "less_approach_percent": 100.0 * (1.0 - half / free.approach),
        "model_less_approach_percent": 50.0 * bulge * model / free.approach, "unknowns": body.unknowns,
    }  # fmt: skip


def _flat_width(line: float, radius: float, plane: float) -> float:
    """Return the half width of a roller on a rigid flat, m (Eq. 4 with one elastic body)."""
    return math.sqrt(4.0 * radius * line / (math.pi * plane))


def _quarter_disc(radius: float, refinements: int, start: int) -> FeMesh:
    """Return a quarter of a disc of triangles, fine about both ends of its arc."""
    skfem = require_skfem()
    mesh = skfem.MeshTri.init_circle(start)
    middle = mesh.p[:, mesh.t].mean(axis=1)
    mesh = mesh.restrict(np.nonzero((middle[0] > 0.0) & (middle[1] > 0.0))[0])
    mesh = skfem.MeshTri(radius * mesh.p, mesh.t)
    for turn in range(refinements):
        x, y = mesh.p[:, mesh.t].mean(axis=1)
        near = np.minimum(np.hypot(x, y - radius), np.hypot(x - radius, y)) < 0.9 * radius * 0.55**turn
        mesh = mesh.refined(np.nonzero(near)[0])
        places, edge = mesh.p.copy(), np.unique(mesh.facets[:, mesh.boundary_facets()])
        arc = edge[(places[0, edge] > 1e-6 * radius) & (places[1, edge] > 1e-6 * radius)]
        places[:, arc] *= radius / np.hypot(*places[:, arc])
        mesh = skfem.MeshTri(places, mesh.t)
    return mesh.with_boundaries(
        {
            "x0": lambda x: x[0] < 1e-6 * radius,
            "y0": lambda x: x[1] < 1e-6 * radius,
            "arc": lambda x: (np.hypot(x[0], x[1]) > 0.9 * radius) & (x[0] > 1e-6 * radius) & (x[1] > 1e-6 * radius),
        }
    )


def _published(
    place: str, bearing: str, quantity: str, condition: str, unit: str, printed: float | str, obtained: float
) -> Row:
    return {
        "place": place, "bearing": bearing, "quantity": quantity, "condition": condition, "unit": unit,
        "printed": printed, "obtained": obtained,
    }  # fmt: skip


def aligning_rows(quick: bool) -> tuple[list[Row], list[Row], list[Row]]:
    """Return stiffness and swing of the 1205 step by step, what its meshes are, and the printed figures."""
    geometry = oblique_geometry(catalogue_entry(SELF_ALIGNING))
    wall, begin = time.perf_counter(), time.process_time()
    rule = MeshRule(patch=1.4, size=0.7, growth=2.5, along=2, along_patch=1.25, coarse=1.2) if quick else OBLIQUE_RULE
    found = oblique_bearing(geometry, (60.0, 420.0), rule)
    cpu, wall = time.process_time() - begin, time.perf_counter() - wall
    k_c = hertz.in_series(*_hertz_stiffness(geometry.relative_radii), 1.5)
    count, angle, rigid = geometry.n_elements, geometry.contact_angle, RowInfluence.none(geometry.n_elements)
    steps = {
        "thesis: k_c 5927, no angle": (ObliqueBearing(count, 0.0, PowerLaw(5927e6), rigid), "held"),
        "exact Hertz, no angle": (ObliqueBearing(count, 0.0, PowerLaw(k_c), rigid), "held"),
        "exact Hertz at 10.2 degrees": (ObliqueBearing(count, angle, PowerLaw(k_c), rigid), "held"),
        "law of finite elements": (ObliqueBearing(count, angle, found.law.law(), rigid), "held"),
        "and the rings' influence": (found.bearing, "held"),
        "axially free": (found.bearing, "free"),
    }
    rows: list[Row] = []
    for load in (1000.0, 2000.0):
        for name, (bearing, axial) in steps.items():
            assert axial in AXIAL
            # Free, k_xx has a narrow dip where an element begins to carry: 60 places miss half of it.
            passage = bearing.stiffness_over_passage(load, 960 if axial == "free" else 60, axial=axial)
            rows.append({
                "step": name, "load_newton": load, "k_xx": 1e-6 * float(passage.mean[1, 1]),
                "k_yy": 1e-6 * float(passage.mean[0, 0]), "swing_xx_percent": 100.0 * float(passage.swing[1]),
                "swing_yy_percent": 100.0 * float(passage.swing[0]),
                "largest_force_newton": float(bearing.state(load, axial=axial).forces.max()),
            })  # fmt: skip
    law = found.law
    meshes: list[Row] = [{
        "k_c_small_loads": 1e-6 * law.contact_stiffness, "k_c_hertz": 1e-6 * k_c,
        "depth_share_at_420_newton_percent": 100.0 * law.depth * 420.0 / (law.hertz * 420.0 ** (2.0 / 3.0)),
        "mesh_error_percent": 100.0 * law.residual, "asymmetry_percent": 100.0 * found.asymmetry,
        "converged": str(found.converged), "largest_unknowns": max(found.unknowns.values()),
        "bodies": len(found.unknowns), "cpu_s": cpu, "wall_s": wall,
    }]  # fmt: skip
    printed = {1000.0: (102.3, 152.3), 2000.0: (128.8, 192.2)}
    published: list[Row] = []
    for row in rows:
        if row["step"] != "and the rings' influence":
            continue
        load = float(row["load_newton"] or 0.0)
        for name, value in zip(("k_xx", "k_yy"), printed[load], strict=True):
            obtained = float(row[name] or 0.0)
            title = f"{name} by finite elements"
            published.append(_published("Table 17", SELF_ALIGNING, title, f"{load:g} N", "MN/m", value, obtained))
        published.append(_published(
            "Fig. 36 (text)", SELF_ALIGNING, "swing of k_xx by finite elements", f"{load:g} N", "%", 7.5,
            float(row["swing_xx_percent"] or 0.0),
        ))  # fmt: skip
    return rows, meshes, published


def _hertz_stiffness(radii: tuple[tuple[float, float], tuple[float, float]]) -> tuple[float, float]:
    inner, outer = (hertz.point_contact_stiffness(*pair, "elliptic") for pair in radii)
    return inner, outer


def main() -> None:
    """Print the tables and write them."""
    options = arguments(__doc__ or "")
    tables: dict[str, list[Row]] = {}
    tables["profiles"], tables["edge_sizes"] = profile_rows(options.quick)
    print(f"logarithmic profile: even at {lundberg_load(profiled()['logarithmic']):.0f} N (Lundberg)")
    law, law_s = roller_law(options.quick)
    tables["spacing"] = spacing_rows(law)
    tables["cage"], tables["cage_parts"], published = cage_rows(law, law_s, options.quick)
    tables["cage_check"] = [
        plane_check(load, 5 if options.quick else 7, 2 if options.quick else 3) for load in (370.0, 3706.0)
    ]
    tables["self_aligning"], tables["self_aligning_meshes"], more = aligning_rows(options.quick)
    tables["published"] = published + more
    for name, rows in tables.items():
        print_table(name, rows)
    write_json(options.json, tables)


if __name__ == "__main__":
    main()
