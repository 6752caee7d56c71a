"""Casings of finite elements: plates against closed forms, a box against its own refinement and direct solutions.

Plates: hard simple supports against Mindlin (J. Applied Mechanics 18 (1951) 31), and the in-plane shear mode that is
known exactly; clamped and cantilevered squares against Leissa (J. Sound and Vibration 31 (1973) 257). The box has
bosses, seats with covers and two feet; its finest mesh is the reference of the coarser ones. Responses are compared
with solutions of K + i w C - w^2 M by scipy's sparse LU, with C = alpha M + beta K, of which the modes are those
without damping.
"""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.sparse.linalg import splu

from benchmarks.common import Row, arguments, print_table, write_json
from models.fe.casing.model import Casing, Point
from models.fe.casing.modes import Damping, Modes, first_modes, modal_responses, modes_below
from models.fe.casing.shape import CAST_IRON, STEEL, CasingMeshRule, CasingShape, Foot, Seat, Wall
from models.fe.casing.surface import radiating_surface
from models.gears.transfer.mode_sets import ModeSet, assurance, paired

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

SIMPLY = {"x0": (1, 2), "x1": (1, 2), "y0": (0, 2), "y1": (0, 2)}
LEISSA = {
    # w a^2 sqrt(rho h / D) of the square plate, Poisson's ratio 0.3.
    "clamped": (dict.fromkeys(("x0", "x1", "y0", "y1"), (0, 1, 2)), (35.992, 73.413, 73.413, 108.27, 131.64, 132.24)),
    "cantilever": ({"x0": (0, 1, 2)}, (3.4917, 8.5246, 21.429, 27.331, 31.111, 54.443)),
}
WALLS: tuple[Wall, Wall] = ("z0", "z1")
SIDE = 0.4
HIGHEST = 2818.0
POINTS = (Point("acc1", (0.25, 0.40, 0.15)), Point("acc2", (0.50, 0.20, 0.15)), Point("acc3", (0.18, 0.30, 0.30)))
ALPHA, BETA = 60.0, 4e-6


def box_shape() -> CasingShape:
    """Return a box for three shafts, 0.5 by 0.4 by 0.3 m, walls of 12 mm."""
    seats = tuple(
        Seat(f"{name}{end}", wall, (x, 0.2), 0.08, 0.12, 0.03, cover=0.006, mass=4.0)
        for name, x in (("in", 0.11), ("middle", 0.25), ("out", 0.39))
        for end, wall in enumerate(WALLS, 1)
    )
    return CasingShape.box(
        (0.5, 0.4, 0.3), 0.012, seats, (Foot((0.0, 0.08), (0.0, 0.3)), Foot((0.42, 0.5), (0.0, 0.3)))
    )


def mindlin(m: int, n: int, thickness: float) -> float:
    """Return a natural frequency, Hz, of a square steel plate on hard simple supports, shear factor 5/6."""
    square = (m * math.pi / SIDE) ** 2 + (n * math.pi / SIDE) ** 2
    shear = 5.0 / 6.0 * 0.5 * STEEL.modulus / (1.0 + STEEL.poisson) * thickness
    bending = STEEL.modulus * thickness**3 / 12.0 / (1.0 - STEEL.poisson**2)
    inertia = np.array([[STEEL.density * thickness], [STEEL.density * thickness**3 / 12.0]])
    root = math.sqrt(square)
    stiffness = np.array([[shear * square, -shear * root], [-shear * root, shear + bending * square]])
    return math.sqrt(float(np.linalg.eigvals(stiffness / inertia).real.min())) / math.tau


def plates(cells: tuple[int, ...]) -> tuple[list[Row], list[Row]]:
    """Return errors of the first frequencies of simply supported plates, and those of Leissa's."""
    simply: list[Row] = []
    for thickness in (0.04, 0.01):
        expected = np.array(sorted(mindlin(m, n, thickness) for m in range(1, 6) for n in range(1, 6))[:6])
        for through in (1, 2):
            for count in cells:
                shape = CasingShape.plate(SIDE, SIDE, thickness)
                casing = Casing(shape, STEEL, CasingMeshRule(SIDE / count, through), SIMPLY)
                found = first_modes(casing, 24).frequency
                # The modes in the plane are not among Mindlin's.
                bending = np.array([found[np.argmin(np.abs(found - f))] for f in expected])
                simply.append(
                    {"thickness by side": thickness / SIDE, "cells a side": count, "through": through,
                     "unknowns": casing.unknowns, "first, percent": 100.0 * float(bending[0] / expected[0] - 1.0),
                     "worst of six, percent": 100.0 * float(np.abs(bending / expected - 1.0).max())}
                )  # fmt: skip
    others: list[Row] = []
    thickness = 0.004
    rigidity = STEEL.modulus * thickness**3 / 12.0 / (1.0 - STEEL.poisson**2)
    for name, (fixed, known) in LEISSA.items():
        for count in (*cells, 2 * cells[-1]):
            casing = Casing(CasingShape.plate(SIDE, SIDE, thickness), STEEL, CasingMeshRule(SIDE / count), fixed)
            scale = math.tau * SIDE**2 * math.sqrt(STEEL.density * thickness / rigidity)
            error = 100.0 * (scale * first_modes(casing, 6).frequency / np.array(known) - 1.0)
            row: Row = {"plate": name, "cells a side": count, "unknowns": casing.unknowns}
            worst = float(np.abs(error).max())
            others.append({**row, "first, percent": float(error[0]), "worst of six, percent": worst})
    return simply, others


def shear_orders() -> list[Row]:
    """Return the errors and orders of the in-plane shear mode that is known exactly."""
    exact = (
        0.5 * math.sqrt(0.5 * STEEL.modulus / (1.0 + STEEL.poisson) / STEEL.density) * math.hypot(1 / SIDE, 1 / SIDE)
    )
    rows: list[Row] = []
    before = math.nan
    for count in (2, 4, 8, 16):
        casing = Casing(CasingShape.plate(SIDE, SIDE, 0.1), STEEL, CasingMeshRule(SIDE / count), SIMPLY)
        error = float(np.abs(first_modes(casing, 12).frequency / exact - 1.0).min())
        rows.append({"cells a side": count, "error": error, "order": math.log2(before / error) if rows else None})
        before = error
    return rows


def box(size: float, highest: float = 1.25 * HIGHEST) -> tuple[Casing, Modes, Row]:
    """Return the box of cells of a size, its modes up to a frequency, Hz, and what they cost."""
    start = time.process_time()
    casing = Casing(box_shape(), CAST_IRON, CasingMeshRule(size))
    assembled = time.process_time()
    casing.solve(np.zeros((casing.unknowns, 1)))
    factorised = time.process_time()
    modes = modes_below(casing, highest)
    cost: Row = {"cells, mm": 1e3 * size, "unknowns": casing.unknowns, "modes": len(modes),
                 "assembly, s": assembled - start, "factor, s": factorised - assembled,
                 "modes, s": time.process_time() - factorised, "residual": float(modes.residual.max())}  # fmt: skip
    return casing, modes, cost


def measured(casing: Casing) -> Array:
    """Return the columns of 3 directions at 3 points, shape (unknowns, 9)."""
    columns = casing.columns(POINTS)
    return np.stack([columns[f"{point.name}.{axis}"] for point in POINTS for axis in "xyz"], axis=1)


def all_places(casing: Casing) -> Array:
    """Return the columns of a coarse set of places on four walls, as for an experimental modal analysis."""
    places = [Point(f"p{i}{j}", (0.05 + 0.1 * i, 0.05 + 0.1 * j, 0.0)) for i in range(5) for j in range(4)]
    places += [Point(f"q{i}{j}", (0.05 + 0.1 * i, 0.05 + 0.1 * j, 0.3)) for i in range(5) for j in range(4)]
    places += [Point(f"t{i}{j}", (0.05 + 0.1 * i, 0.4, 0.05 + 0.1 * j)) for i in range(5) for j in range(3)]
    places += [Point(f"s{i}{j}", (0.5, 0.05 + 0.1 * i, 0.05 + 0.1 * j)) for i in range(4) for j in range(3)]
    columns = casing.columns(places)
    return np.stack([columns[f"{point.name}.{axis}"] for point in places for axis in "xyz"], axis=1)


def refinement(sizes: tuple[float, ...]) -> tuple[list[Row], list[Row], list[tuple[Casing, Modes, Row]]]:
    """Return errors of each mesh against the finest, costs, and the bodies."""
    found = [box(size) for size in sizes]
    frequency = np.geomspace(562.0, HIGHEST, 400)
    finest, reference, _ = found[-1]
    levels = band_levels(finest, reference, frequency)
    shapes = all_places(finest).T @ reference.shapes
    rows: list[Row] = []
    for size, (casing, modes, _) in zip(sizes[:-1], found[:-1], strict=True):
        count = min(20, len(modes), len(reference))
        match = assurance(all_places(casing).T @ modes.shapes, shapes)
        partner = match[:count].argmax(axis=1)
        shift = 100.0 * (modes.frequency[:count] / reference.frequency[partner] - 1.0)
        rows.append(
            {"cells, mm": 1e3 * size, "first, percent": float(shift[0]),
             "worst of 20, percent": float(np.abs(shift).max()),
             "least MAC of 20": float(match[:count].max(axis=1).min()),
             "level in the band, dB": float(np.abs(band_levels(casing, modes, frequency) - levels).max())}
        )  # fmt: skip
    return rows, [cost for *_, cost in found], found


def as_measured(casing: Casing, modes: Modes, noise: float, damping: Damping) -> ModeSet:
    """Return what a test would give of a casing's modes: shapes with noise, SD by the RMS of each, and damping."""
    shapes = all_places(casing).T @ modes.shapes
    scatter = np.random.default_rng(0).standard_normal((2, *shapes.shape)) * np.sqrt(0.5 * np.mean(shapes**2, axis=0))
    names = tuple(f"{n}.{axis}" for n in range(len(shapes) // 3) for axis in "xyz")
    return ModeSet(modes.frequency, names, shapes + noise * (scatter[0] + 1j * scatter[1]), damping.at(modes.frequency))


def given_set(fine: tuple[Casing, Modes, Row], coarse: tuple[Casing, Modes, Row]) -> list[Row]:
    """Return Table 25 for the box: the fine mesh with noise stands for the test, the first modes in the band."""
    band = fine[1].frequency >= 562.0
    first = Modes(*(part[..., band][..., :5] for part in (fine[1].frequency, fine[1].shapes, fine[1].residual)))
    computed = as_measured(coarse[0], coarse[1], 0.0, Damping.constant(0.03))
    rows: list[Row] = []
    for noise in (0.0, 0.3):
        for pair in paired(as_measured(fine[0], first, noise, Damping.constant(0.03)), computed):
            if pair is None:
                raise RuntimeError("a mode of the fine mesh has none near it")
            rows.append(
                {"noise by RMS": noise, "given, Hz": pair.given_frequency, "computed, Hz": pair.computed_frequency,
                 "difference, percent": 100.0 * pair.difference, "MAC": pair.assurance}
            )  # fmt: skip
    return rows


def band_levels(casing: Casing, modes: Modes, frequency: Array) -> Array:
    """Return levels, dB, of the mean square response over the band to all forces, for each direction at the points."""
    frf = modal_responses(casing, modes, Damping.constant(0.03), frequency, ports(casing, POINTS), seats(casing))
    return 10.0 * np.log10(np.mean(np.abs(frf.h) ** 2, axis=(0, 2)))


def seats(casing: Casing) -> Mapping[str, Array]:
    """Return the columns of forces across the shafts."""
    return {name: column for name, column in casing.columns().items() if not name.endswith("z")}


def ports(casing: Casing, points: tuple[Point, ...]) -> Mapping[str, Array]:
    """Return the columns of the directions at points."""
    names = {point.name for point in points}
    return {name: column for name, column in casing.columns(points).items() if name.split(".")[0] in names}


def against_direct(casing: Casing, modes: Modes) -> list[Row]:
    """Return errors of modal responses against direct solutions, by the highest mode that is kept."""
    frequency = np.array([600.0, 828.0, 1221.0, 1700.0, 2300.0, HIGHEST])
    inputs, outputs = seats(casing), ports(casing, POINTS)
    b, out = (np.stack(list(columns.values()), axis=1) for columns in (inputs, outputs))
    direct = np.array([-((math.tau * f) ** 2) * (out.T @ solved(casing, f, b)) for f in frequency])
    rows: list[Row] = []
    for highest in (1.0, 1.25, 1.5, 2.0):
        kept = modes.below(highest * HIGHEST)
        natural = math.tau * kept.frequency
        ratio = 0.5 * (ALPHA / natural + BETA * natural)
        damping = Damping(tuple(kept.frequency.tolist()), tuple(ratio.tolist()))
        row: dict[str, Any] = {"modes up to, Hz": highest * HIGHEST, "modes": len(kept)}
        for name, static in (("with static part, dB", True), ("without, dB", False)):
            h = modal_responses(casing, kept, damping, frequency, outputs, inputs, static=static).h
            row[name] = float(20.0 * np.log10(1.0 + np.abs(h - direct).max() / np.abs(direct).max()))
        rows.append(row)
    return rows


def solved(casing: Casing, frequency: float, right: Array) -> Any:
    """Return the displacement under forces at one frequency without modes."""
    omega = math.tau * frequency
    dynamic = casing.stiffness * (1.0 + 1j * omega * BETA) - casing.mass * (omega**2 - 1j * omega * ALPHA)
    return splu(dynamic.tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}).solve(
        right.astype(complex)
    )


def other_checks(casing: Casing, modes: Modes) -> list[Row]:
    """Return reciprocity, the agreement of modes with themselves, and the surface."""
    frequency = np.geomspace(562.0, HIGHEST, 200)
    every = {**seats(casing), **ports(casing, POINTS)}
    h = modal_responses(casing, modes, Damping.constant(0.03), frequency, every, every).h
    missed = float(np.abs(h - h.transpose(0, 2, 1)).max() / np.abs(h).max())
    own = assurance(all_places(casing).T @ modes.shapes[:, :20], all_places(casing).T @ modes.shapes[:, :20])
    surface = radiating_surface(casing)
    start = time.process_time()
    modal_responses(casing, modes, Damping.constant(0.03), frequency, surface.columns, seats(casing), "m/s")
    return [
        {"what": "reciprocity, of the greatest response", "value": missed},
        {"what": "MAC of a mode with itself, deviation from 1", "value": float(np.abs(np.diag(own) - 1.0).max())},
        {"what": "greatest MAC of two different modes of 20", "value": float(own[~np.eye(20, dtype=bool)].max())},
        {"what": "elements of the surface", "value": len(surface.elements)},
        {"what": "velocities of it for 12 forces at 200 lines, s", "value": time.process_time() - start},
        {"what": "mass, kg", "value": casing.total_mass},
        {"what": "stiffer seats (rigid) over soft: first mode, percent", "value": soft_seats(casing, modes)},
    ]  # fmt: skip


def soft_seats(casing: Casing, modes: Modes) -> float:
    """Return by how much the first mode is higher with rigid seats than with seats that may deform, percent."""
    shape = casing.shape
    soft = replace(shape, seats=tuple(replace(seat, spider="mean") for seat in shape.seats))
    found = first_modes(Casing(soft, casing.material, casing.rule), 1)
    return 100.0 * float(modes.frequency[0] / found.frequency[0] - 1.0)


def main() -> None:
    """Measure, print and write."""
    options = arguments(__doc__.splitlines()[0] if __doc__ else "")
    simply, others = plates((4, 8) if options.quick else (4, 8, 16))
    print_table("plates on simple supports, against Mindlin", simply)
    print_table("thin plates, thickness a hundredth of the side, against Leissa", others)
    orders = shear_orders()
    print_table("shear in the plane, against the exact frequency", orders)
    rows, costs, found = refinement((0.1, 0.05) if options.quick else (0.1, 0.05, 0.03))
    print_table("box, against its finest mesh", rows)
    print_table("cost of the box, processor time", costs)
    coarsest = found[0][:2]
    given = given_set(found[-1], found[-2])
    print_table("modes of the next mesh against a given set: the finest with noise", given)
    direct = against_direct(coarsest[0], modes_below(coarsest[0], 2.0 * HIGHEST))
    print_table("responses of the coarsest box, against direct solutions, of the greatest response", direct)
    checks = other_checks(*coarsest)
    print_table("further checks", checks)
    results = {"simply supported": simply, "leissa": others, "shear": orders, "box": rows, "cost": costs}
    write_json(options.json, {**results, "given set": given, "direct": direct, "checks": checks})


if __name__ == "__main__":
    main()
