"""Stiffness k_i of a shaft on its support bearings by finite elements: against beams, and the trend of Table 15.

The thesis prints no dimension of its shaft; those of ``fe_shaft.toml`` are chosen, so that k_i at 1 kN and the mass are
settled by hand, and what is judged is how k_i grows with the load: the law of the supports, not the shaft.
"""

from __future__ import annotations

import itertools
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.common import Row, arguments, print_table, write_json
from models.fe.meshes.shaft_mesh import ShaftMeshRule, Step
from models.fe.shafts.shaft import Seat, ShaftModel, SteppedShaft, Support, condense_shaft
from models.fe.shafts.spring import RadialSpring, bearing_spring
from models.machine.bearing import catalogue_entry
from models.machine.contact_estimates import STEEL_DENSITY, estimate_stiffness
from models.machine.shaft_beam import Shaft, element_matrices
from monitor.fe.config_shaft import read_shaft

FILE = Path(__file__).with_suffix(".toml")
PRINTED = {500.0: 73.72, 1000.0: 74.61, 2000.0: 75.45, 3000.0: 75.93}
"""Table 15: k_i, MN/m, under a load, N."""
_BALLS = "6207"


def trend(shaft: SteppedShaft, rule: ShaftMeshRule) -> list[Row]:
    """Return k_i over the load beside Table 15."""
    model = ShaftModel(shaft, rule)
    first = model.solve(500.0).stiffness
    rows: list[Row] = []
    for load, printed in PRINTED.items():
        state = model.solve(load)
        rows.append(
            {
                "load_newton": load,
                "k_i_mn_per_m": state.stiffness / 1e6,
                "growth_percent": 100.0 * (state.stiffness / first - 1.0),
                "printed_mn_per_m": printed,
                "printed_growth_percent": 100.0 * (printed / PRINTED[500.0] - 1.0),
                "k_i_seat_mn_per_m": state.seat_stiffness / 1e6,
                "status": "converged" if state.converged else "not_in_equilibrium",
            }
        )
    return rows


def printed_law() -> list[Row]:
    """Return how well 1/k_i = c + a F^(1/n - 1) fits the four printed values, for rollers and for balls."""
    loads, compliance = np.array(list(PRINTED)), 1.0 / np.array(list(PRINTED.values()))
    rows: list[Row] = []
    for name, exponent in (("rollers, n = 10/9", 10.0 / 9.0), ("balls, n = 3/2", 1.5)):
        basis = np.stack((np.ones(4), loads ** (1.0 / exponent - 1.0)), axis=1)
        found = np.linalg.lstsq(basis, compliance, rcond=None)[0]
        miss = basis @ found / compliance - 1.0
        rows.append(
            {
                "supports": name,
                "largest_error_percent": 100.0 * float(np.abs(miss).max()),
                "rounding_of_table_percent": 100.0 * 0.005 / 73.72,
                "shaft_alone_mn_per_m": 1.0 / float(found[0]),
                "supports_share_at_1_kn": float(basis[1, 1] * found[1] / compliance[1]),
            }
        )
    return rows


def meshes(shaft: SteppedShaft, *, quick: bool) -> list[Row]:
    """Return k_i at 1 kN, unknowns and time over the mesh; the error is against the finest."""
    base = ShaftMeshRule()
    rules = [
        replace(base, order=1, finest=0.25),
        replace(base, order=1, eighth=2, finest=0.125, size=0.4),
        replace(base, finest=0.5),
        replace(base, finest=0.25),
        base,
        replace(base, finest=0.0625),
    ]
    if not quick:
        rules += [replace(base, eighth=2), replace(base, finest=0.03125)]
    rows: list[dict[str, float | int | str | None]] = []
    for rule in rules:
        begun = time.perf_counter()
        condensed = condense_shaft(shaft, rule)
        rows.append(
            {
                "nodes_a_cell": 8 if rule.order == 1 else 27,
                "eighth": rule.eighth,
                "size": rule.size,
                "finest": rule.finest,
                "unknowns": condensed.unknowns,
                "seconds": time.perf_counter() - begun,
                "k_i_mn_per_m": ShaftModel(shaft, rule).solve(1000.0).stiffness / 1e6,
            }
        )
    finest = rows[-1]["k_i_mn_per_m"]
    assert isinstance(finest, float)
    for row in rows:
        k_i = row["k_i_mn_per_m"]
        assert isinstance(k_i, float)
        row["from_finest_percent"] = 100.0 * (k_i / finest - 1.0)
    return list(rows)


def beams(shaft: SteppedShaft) -> list[Row]:
    """Return how far Timoshenko beams are from the solid, on slender shafts and on the short one."""
    spring = RadialSpring((1e-6, 1e-5), (2e3, 2e3 * 10.0 ** (10.0 / 9.0)))
    rows: list[Row] = []
    for ratio in (40.0, 20.0, 10.0, 5.0):
        length, diameter = 0.6, 0.6 / ratio
        width = 0.2 * diameter
        slender = SteppedShaft(
            (Step(length, diameter),),
            Seat(0.0, width),
            tuple(Support(Seat(at, at + width), spring) for at in (0.4 * length, length - width)),
        )
        rows.append(_beam_row(f"even shaft, length {ratio:g} diameters", slender, 500.0))
    rows.append(_beam_row("the short shaft of Table 15", shaft, 1000.0))
    return rows


def _beam_row(name: str, shaft: SteppedShaft, load: float) -> Row:
    state = ShaftModel(shaft).solve(load)
    secants = [abs(r / q) for r, q in zip(state.reactions, state.seats[:, 0], strict=True)]
    soft, stiff = (_beam_shift(shaft, load, secants, rigid=rigid) for rigid in (False, True))
    return {
        "shaft": name,
        "solid_mn_per_m": state.stiffness / 1e6,
        "beam_held_in_the_middle_percent": 100.0 * (load / soft / state.stiffness - 1.0),
        "beam_rigid_in_its_seats_percent": 100.0 * (load / stiff / state.stiffness - 1.0),
    }


def _beam_shift(shaft: SteppedShaft, load: float, springs: list[float], *, rigid: bool) -> float:
    """Return the shift of the first end by Timoshenko beams on linear springs, m; seats are rigid or are not."""
    cuts = np.concatenate(([0.0], np.cumsum([step.length for step in shaft.steps])))
    marks = [*cuts, shaft.loaded.middle]
    for support in shaft.supports:
        marks += [support.seat.begin, support.seat.middle, support.seat.end]
    places = [float(place) for place in np.unique(np.round(marks, 12))]
    k = np.zeros((2 * len(places), 2 * len(places)))
    own = np.ix_([0, 4, 6, 10], [0, 4, 6, 10])
    for i, (low, high) in enumerate(itertools.pairwise(places)):
        middle = 0.5 * (low + high)
        step = shaft.steps[int(np.searchsorted(cuts, middle)) - 1]
        inside = any(support.seat.begin < middle < support.seat.end for support in shaft.supports)
        modulus = shaft.modulus * (1e4 if rigid and inside else 1.0)
        beam = Shaft(high - low, step.diameter, step.bore, 1, modulus, shaft.poisson)
        k[2 * i : 2 * i + 4, 2 * i : 2 * i + 4] += element_matrices(beam)[0][own]
    for support, spring in zip(shaft.supports, springs, strict=True):
        at = 2 * places.index(round(support.seat.middle, 12))
        k[at, at] += spring
    force = np.zeros(len(k))
    force[2 * places.index(round(shaft.loaded.middle, 12))] = load
    return float(np.linalg.solve(k, force)[0])


def _settled(model: ShaftModel, load: float) -> float:
    state = model.solve(load)
    assert state.converged, f"the shaft does not settle under {load} N"
    return state.stiffness


def supports(shaft: SteppedShaft, rule: ShaftMeshRule) -> list[Row]:
    """Return k_i at 1 kN and its growth from 500 to 3000 N over what is not known of the supports."""
    entry = catalogue_entry("22207")
    estimate, balls = estimate_stiffness(entry), estimate_stiffness(catalogue_entry(_BALLS))
    condensed = ShaftModel(shaft, rule).condensed
    cases = {
        "22207, k_c of its geometry": bearing_spring(estimate.bearing, estimate.value),
        "22207, k_c at its lower bound": bearing_spring(estimate.bearing, estimate.low),
        "22207, k_c at its upper bound": bearing_spring(estimate.bearing, estimate.high),
        "22207, clearance 5 um": bearing_spring(estimate.bearing, estimate.value, 5e-6),
        f"{_BALLS} (balls)": bearing_spring(balls.bearing, balls.value),
    }
    rows: list[Row] = []
    for name, spring in cases.items():
        changed = replace(shaft, supports=tuple(replace(support, spring=spring) for support in shaft.supports))
        model = ShaftModel(changed, rule)
        # The condensed shaft is the same: the springs come after it.
        model.__dict__["condensed"] = condensed
        low, middle, high = (_settled(model, load) for load in (500.0, 1000.0, 3000.0))
        rows.append(
            {
                "supports": name,
                "k_i_mn_per_m": middle / 1e6,
                "growth_500_to_3000_newton_percent": 100.0 * (high / low - 1.0),
            }
        )
    return rows


def main() -> None:
    """Print and write the tables."""
    options = arguments(__doc__ or "")
    shaft, rule = read_shaft(FILE), ShaftMeshRule()
    mass = STEEL_DENSITY * condense_shaft(shaft, rule).volume
    facts: list[Row] = [
        {
            "mass_kg": mass,
            "printed_mass_kg": 3.48,
            "length_mm": 1e3 * shaft.length,
        }
    ]
    tables = {
        "shaft": facts,
        "table_15": trend(shaft, rule),
        "law_of_table_15": printed_law(),
        "supports": supports(shaft, rule),
        "meshes": meshes(shaft, quick=options.quick),
        "beams": beams(shaft),
    }
    grown = tables["table_15"][-1]
    published: list[Row] = [
        {
            "place": "Table 15",
            "bearing": "1205 ETN9",
            "quantity": "stiffness of the shaft",
            "condition": f"{row['load_newton']:g} N",
            "unit": "MN/m",
            "printed": row["printed_mn_per_m"],
            "obtained": row["k_i_mn_per_m"],
            "status": "CALIB",
            "note": "its dimensions are not printed: chosen for k_i at 1 kN and the mass of Table 14",
        }
        for row in tables["table_15"]
    ]
    published.append(
        {
            "place": "Table 15",
            "bearing": "1205 ETN9",
            "quantity": "growth of the stiffness of the shaft",
            "condition": "500 to 3000 N",
            "unit": "%",
            "printed": grown["printed_growth_percent"],
            "obtained": grown["growth_percent"],
            "status": "agrees",
            "note": "analytic stiffness of two 22207; not fitted",
        }
    )
    for title, rows in tables.items():
        print_table(title, rows)
    write_json(options.json, {**tables, "published": published})


if __name__ == "__main__":
    main()
