"""Mesh stiffness of gears against plane finite elements and ISO 6336-1: teeth, bodies, cracks, whole meshes, cost.

``python -m benchmarks.gears.stiffness [--json FILE] [--quick]``. The constant of the body's deflection at the next
tooth (``models.gears.teeth.tooth._NEIGHBOUR``) is the mean of that of the fitted gears (seed 1), those of cracks
(``_CRACK``) are fitted to seed 3; the gears of seeds 2 and 4 were set aside and are judged. Compliances are of a face
of unit width, times Young's modulus.
"""

from __future__ import annotations

import json
import math
import time
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.common import arguments, circumstances, print_table
from benchmarks.gears.plane_teeth import deflections
from models.gears.teeth.contacts import Springs, share_force
from models.gears.teeth.faults import ToothCrack
from models.gears.teeth.geometry import GearPair, TipRelief, ToothedWheel
from models.gears.teeth.rack import BasicRack, ToothProfile
from models.gears.teeth.stiffness import iso_stiffness, loaded_mesh, mesh_stiffness
from models.gears.teeth.tooth import (
    StiffnessMethod,
    crack_compliance,
    critical_section,
    loaded_point,
    shared_compliance,
    tooth_compliance,
    wind_up,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

FITTED, JUDGED = 1, 2
FITTED_CRACKS, JUDGED_CRACKS = 3, 4
MODULUS = 206e9
ANGLE = math.radians(20.0)
LOAD = 200e3  # N per m of face
FINENESS = 6.0
# Teeth, hub radii in m; module 3 mm, face 20 mm.
PAIRS = (
    ((20, 31), (10e-3, 15e-3)),
    ((23, 23), (12e-3, 12e-3)),
    ((30, 60), (15e-3, 25e-3)),
    ((40, 100), (30e-3, 60e-3)),
)


def pair_of(case: tuple[tuple[int, int], tuple[float, float]], **options: Any) -> GearPair:
    """Return a pair of ``PAIRS``."""
    driver, driven = (ToothedWheel(z, 20e-3, hub, **options) for z, hub in zip(*case, strict=True))
    return GearPair(driver, driven, 3e-3)


def drawn_gears(seed: int, count: int) -> list[tuple[ToothProfile, ToothedWheel]]:
    """Return gears of 18 to 110 teeth, shifts to 0.5, root over hub radius 1.5 to 6."""
    rng, gears = np.random.default_rng(seed), []
    for _ in range(count):
        z, x, ratio = (
            round(math.exp(rng.uniform(math.log(18), math.log(110)))),
            rng.uniform(0, 0.5),
            rng.uniform(1.5, 6),
        )
        tooth = ToothProfile(z, 3e-3, ANGLE, 0.0, x, BasicRack())
        gears.append((tooth, ToothedWheel(z, 20e-3, tooth.root_radius / ratio, x)))
    return gears


def teeth_rows(seed: int, count: int) -> list[dict[str, Any]]:
    """Return each gear's differences from finite elements, in percent; of the tooth: mean over the flank."""
    rows = []
    for tooth, wheel in drawn_gears(seed, count):
        low, high = tooth.roll(tooth.form_radius), tooth.roll(tooth.tip_radius)
        rolls = low + np.array([0.12, 0.39, 0.65, 0.92]) * (high - low)
        found = deflections(tooth, wheel, rolls, fineness=FINENESS)
        ways = {
            kind: tooth_compliance(tooth, wheel, rolls, StiffnessMethod(foundation=kind, shared_body=False))
            for kind in ("sainsot", "weber")
        }
        next_tooth = float(found.neighbour.mean())
        share = (
            2.0
            / math.pi
            * math.log((tooth.root_radius - wheel.hub_radius) / (math.tau * tooth.root_radius / tooth.teeth))
        )
        rows.append(
            {
                "teeth": wheel.teeth,
                "shift": round(wheel.profile_shift, 2),
                "root/hub": round(tooth.root_radius / wheel.hub_radius, 2),
                **{f"{kind} %": float(100.0 * np.mean(way / found.structure - 1.0)) for kind, way in ways.items()},
                "next tooth": MODULUS * next_tooth,
                "next tooth %": 100.0 * (shared_compliance(tooth, wheel, "stress") / next_tooth - 1.0),
                "constant": MODULUS * (next_tooth - wind_up(tooth, wheel)) - share,
            }
        )
    return rows


def element_mesh(pair: GearPair, phases: Array, force: float) -> Array:
    """Return the secant stiffness at phases with both teeth and bodies by finite elements, contact by Weber."""
    begin, end = pair.contact_path
    paths = begin + pair.base_pitch * (phases[:, np.newaxis] + np.arange(2))
    inside = paths < end
    paths = np.minimum(paths, end)
    own, cross = np.zeros(paths.shape), np.zeros(len(phases))
    lengths = (paths, pair.tangent_length - paths)
    for side, (tooth, wheel) in enumerate(zip(pair.profiles, pair.wheels, strict=True)):
        rolls = lengths[side] / tooth.base_radius
        # The pair that has been in contact for longer is ahead: on the loaded side of the driver's tooth only.
        found = deflections(
            tooth,
            wheel,
            rolls.T.ravel(),
            fineness=FINENESS,
            neighbour=(1 if side == 0 else -1, np.concatenate((rolls[:, 1], rolls[:, 1]))),
        )
        own += found.structure.reshape(2, -1).T
        cross += found.neighbour[: len(phases)]
    depths = np.stack(
        [loaded_point(t, length / t.base_radius).depth for t, length in zip(pair.profiles, lengths, strict=True)]
    )
    # Equal displacement by the other's force: what both share is in series, the rest is each pair's own.
    b = pair.face_width
    springs = Springs(
        gap=np.zeros((*paths.shape, 1)),
        width=b * inside[..., np.newaxis].astype(float),
        teeth=(own - cross[:, np.newaxis]) / b,
        depths=depths[..., np.newaxis],
        radius=(lengths[0] * lengths[1] / pair.tangent_length)[..., np.newaxis],
        factor=1.0,
    )
    approach = share_force(springs, pair.wheels, force, "weber").approach
    return force / (approach + cross / b * force)


def mesh_rows() -> list[dict[str, Any]]:
    """Return mean and variation of the stiffness by finite elements and by the ways of the model."""
    rows, phases = [], np.arange(12) / 12 + 1.0 / 24.0
    for case in PAIRS:
        pair = pair_of(case)
        force = LOAD * pair.face_width
        elements = element_mesh(pair, phases, force)
        row: dict[str, Any] = {"teeth": "/".join(map(str, case[0])), "elements N/m": float(elements.mean())}
        row["variation"] = float(np.ptp(elements) / elements.mean())
        for name, method in (
            ("model", StiffnessMethod()),
            ("not shared", StiffnessMethod(shared_body=False)),
            ("weber body", StiffnessMethod(foundation="weber")),
            ("linear contact", StiffnessMethod(contact="linear")),
        ):
            whole = loaded_mesh(pair, force, samples=24, method=method).stiffness[1::2]
            row[f"{name} mean %"] = float(100.0 * (whole.mean() / elements.mean() - 1.0))
            row[f"{name} variation"] = float(np.ptp(whole) / whole.mean())
        rows.append(row)
    return rows


def iso_rows() -> list[dict[str, Any]]:
    """Return c_gamma of the standard and of the model; the model without the ring's torsion, which ISO leaves out."""
    rows = []
    cases = [(case, 0.0) for case in PAIRS] + [(PAIRS[2], 10.0), (PAIRS[2], 20.0), (PAIRS[2], 30.0)]
    for (teeth, hubs), helix in cases:
        wheels = [ToothedWheel(z, 40e-3, hub) for z, hub in zip(teeth, hubs, strict=True)]
        pair = GearPair(wheels[0], wheels[1], 3e-3, helix_angle=math.radians(helix))
        iso = iso_stiffness(pair)
        row: dict[str, Any] = {"teeth": "/".join(map(str, teeth)), "helix deg": helix, "iso N/mm/um": iso.mesh / 1e9}
        row["iso single"] = iso.single / 1e9
        for plane in ("stress", "strain"):
            mesh = loaded_mesh(pair, LOAD * 40e-3, samples=64, method=StiffnessMethod(plane=plane))
            torsion = sum(wind_up(p, w) for p, w in zip(pair.profiles, pair.wheels, strict=True)) / 40e-3
            solid = 1.0 / (1.0 / mesh.stiffness - torsion) / 40e-3
            row[f"plane {plane}"] = float(solid.mean() / 1e9)
            row[f"plane {plane} single"] = float(solid.min() / 1e9) if helix == 0.0 else None
        rows.append(row)
    return rows


def crack_rows(seed: int, count: int) -> tuple[list[dict[str, Any]], Array]:
    """Return errors of the cracks' compliance, percent, and rows of (share, arm, cosine, compliance times E)."""
    rows, points = [], []
    for tooth, wheel in drawn_gears(seed, count):
        low, high = tooth.roll(tooth.form_radius), tooth.roll(tooth.tip_radius)
        rolls = low + np.array([0.4, 0.6, 0.8, 0.93]) * (high - low)
        x, y = critical_section(tooth)
        loads = loaded_point(tooth, rolls)
        across = np.cos(loads.angle)
        arm = (across * (loads.x - x) - np.sin(loads.angle) * loads.y) / (2.0 * y)
        sound = deflections(tooth, wheel, rolls, fineness=FINENESS).structure
        for degrees in (90.0, 70.0):
            angle, errors = math.radians(degrees), []
            for share in (0.06, 0.12, 0.2, 0.3, 0.4, 0.5) if degrees == 90.0 else (0.12, 0.3, 0.5):
                depth = share * 2.0 * y
                added = deflections(tooth, wheel, rolls, fineness=FINENESS, crack=(depth, angle)).structure - sound
                errors.append(crack_compliance(tooth, wheel, rolls, depth, angle, "stress") / added - 1.0)
                if degrees == 90.0:
                    points += list(zip([share] * 4, arm, across, MODULUS * added, strict=True))
            rows.append(
                {
                    "teeth": wheel.teeth,
                    "shift": round(wheel.profile_shift, 2),
                    "crack deg": degrees,
                    "rms %": float(100.0 * np.sqrt(np.mean(np.square(errors)))),
                    "least %": float(100.0 * np.min(errors)),
                    "most %": float(100.0 * np.max(errors)),
                }
            )
    return rows, np.array(points)


def fitted_crack(points: Array) -> list[list[float]]:
    """Return the coefficients of ``models.gears.teeth.tooth._CRACK`` with the least relative errors."""
    share, arm, across, added = points.T
    scale = 24.0 * share**1.5 / (1.0 - share) / added
    terms = [scale * share**k * term for term in (arm**2, arm * across, across**2) for k in (0, 1)]
    found, *_ = np.linalg.lstsq(np.stack(terms, axis=1), np.ones(len(share)), rcond=None)
    return found.reshape(3, 2).round(3).tolist()


def station_rows() -> list[dict[str, Any]]:
    """Return errors of tables with few stations against 8192, as the solver interpolates them, relative to the mean."""
    rows = []
    relief = TipRelief(15e-6, 2.5e-3)
    spur, relieved = pair_of(PAIRS[0]), pair_of(PAIRS[0], tip_relief=relief)
    wheels = relieved.driver, relieved.driven
    helical = GearPair(wheels[0], wheels[1], 3e-3, helix_angle=math.radians(15.0))
    turns = np.arange(8192) / 8192 / 20
    for n in (16, 32, 64, 128, 256, 512):
        row: dict[str, Any] = {"stations": n}
        for name, pair in (("spur", spur), ("relieved", relieved), ("helical", helical)):
            fine = mesh_stiffness(pair, 4000.0, samples=2048 if name == "helical" else 8192)
            k = mesh_stiffness(pair, 4000.0, samples=n).at(turns, 0.0)[0]
            exact = fine.at(turns, 0.0)[0]
            row[f"{name} mean"] = float(abs(k.mean() / exact.mean() - 1.0))
            row[f"{name} rms"] = float(np.sqrt(np.mean((k - exact) ** 2)) / exact.mean())
        rows.append(row)
    return rows


def relief_rows() -> list[dict[str, Any]]:
    """Return peak to peak of the loaded transmission error, um, over the force, for amounts of relief."""
    rows = []
    for amount in (0.0, 5e-6, 10e-6, 15e-6, 20e-6, 30e-6):
        pair = pair_of(PAIRS[2], tip_relief=TipRelief(amount, 6.3e-3))
        row: dict[str, Any] = {"relief um": 1e6 * amount}
        for force in (1000.0, 2000.0, 4000.0, 6000.0):
            row[f"{force:.0f} N"] = float(1e6 * np.ptp(loaded_mesh(pair, force).loaded_error))
        rows.append(row)
    return rows


def cost_rows(quick: bool) -> list[dict[str, Any]]:
    """Return thread times, ms, the best of several."""
    spur = pair_of(PAIRS[2])
    helical = GearPair(spur.driver, spur.driven, 3e-3, helix_angle=math.radians(15.0))
    cracked = [ToothCrack(3, 1e-3)]
    found = []
    for name, call in (
        ("spur", lambda: mesh_stiffness(spur, 4000.0)),
        ("helical, 24 slices", lambda: mesh_stiffness(helical, 4000.0)),
        ("spur with a crack", lambda: mesh_stiffness(spur, 4000.0, driver_faults=cracked)),
    ):
        times = []
        for _ in range(3 if quick else 10):
            start = time.thread_time()
            call()
            times.append(1e3 * (time.thread_time() - start))
        found.append({"mesh of 128 stations": name, "ms": min(times)})
    return found


def main() -> None:
    """Print all tables; write them where asked."""
    options = arguments(__doc__ or "")
    counts = (3, 2) if options.quick else (10, 8)
    cracks, points = crack_rows(FITTED_CRACKS, 2 if options.quick else 8)
    tables: dict[str, Any] = {
        "fitted": teeth_rows(FITTED, counts[0]),
        "judged": teeth_rows(JUDGED, counts[1]),
        "mesh": mesh_rows(),
        "cracks fitted": cracks,
        "cracks judged": crack_rows(JUDGED_CRACKS, counts[1] // 2)[0],
        "iso": iso_rows(),
        "stations": station_rows(),
        "relief": relief_rows(),
        "cost": cost_rows(options.quick),
    }
    tables["neighbour_constant"] = float(np.mean([row["constant"] for row in tables["fitted"]]))
    tables["crack_coefficients"] = fitted_crack(points)
    for name, rows in tables.items():
        if isinstance(rows, list) and isinstance(rows[0], dict):
            print_table(name, rows)
    print(f"\nconstant of the fitted gears: {tables['neighbour_constant']:.3f}; cracks {tables['crack_coefficients']}")
    if options.json:
        options.json.write_text(json.dumps({**circumstances(), **tables}, indent=1) + "\n")


if __name__ == "__main__":
    main()
