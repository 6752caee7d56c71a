"""The inner ring on a meshed shaft instead of a sinusoidal pressure: shares of the rollers and time (thesis, 3.4.3).

The shaft is a disc as wide as the ring, loaded at its centre, that touches the bore without friction and may part from
it; or does not part; or is rigid and bonded. The shares are held against the analytic ones (Eqs. 20-25; Eq. 27
without clearance). "Cut" models have only the half of ring and shaft towards the load (3.4.2).

    python -m benchmarks.fe_loaded_shaft [--json FILE] [--quick]
"""

from __future__ import annotations

import math
import time
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.common import Row, arguments, print_table, write_json
from models.fe.bearings.assembled import AssembledBearing
from models.fe.bearings.bearing import analytic_law, fe_bearing
from models.fe.bearings.ring_bodies import INFLUENCE_RULE
from models.fe.meshes.geometry import FeGeometry, fe_geometry
from models.fe.meshes.shaft_mesh import ShaftMeshRule
from models.fe.shafts.solid_shaft import FitRule, SolidShaft
from models.machine.bearing import catalogue_entry

BEARINGS = ("NU 202 ECP", "6210")
LOADS = {"NU 202 ECP": (100.0, 10000.0), "6210": (5000.0,)}
"""Loads of Fig. 22, N, and one for the balls, for which the thesis prints none."""
# The thesis: its loaded shaft departs from Eq. 27 by up to 8.3 % at the roller at 62.4 degrees, its sinusoidal pressure
# by up to 3 %; the shaft costs 28.7 % of time at 0.1 kN and 56.8 % at 10 kN.
PRINTED_SHARE, PRINTED_SINUSOIDAL, PRINTED_TIME = 8.3, 3.0, {100.0: 28.7, 10000.0: 56.8}


def compare(name: str, load: float) -> tuple[list[Row], Row]:
    """Return the loads of the elements of one side by each support, and what each costs."""
    geometry = fe_geometry(catalogue_entry(name))
    began = time.process_time()
    sinusoidal = fe_bearing(geometry, load, support="sinusoidal").assembled
    seconds = time.process_time() - began
    began = time.process_time()
    rigid = fe_bearing(geometry, load, support="rigid-shaft").assembled
    rigid_seconds = time.process_time() - began
    began = time.process_time()
    fit = SolidShaft(geometry)
    touching = fit.solve(rigid, load)
    solid_seconds = time.process_time() - began
    cut = SolidShaft(geometry, cut=True)
    others = {
        "shaft_not_parting": fit.solve(rigid, load, fit="held"),
        "cut_sinusoidal": cut.solve(rigid, load, fit="sinusoidal"),
        "cut_shaft": cut.solve(rigid, load),
    }
    assert touching.converged
    assert all(state.converged for state in others.values())
    analytic = AssembledBearing(analytic_law(geometry), geometry.n_elements).state(load)
    states = {"sinusoidal": sinusoidal.state(load), "rigid": rigid.state(load)}
    rows: list[Row] = [
        {
            "bearing": name,
            "load": load,
            "angle_deg": math.degrees(touching.angles[i]),
            "analytic_newton": float(analytic.loads[i]),
            **{f"{key}_percent": _off(state.loads[i], analytic.loads[i]) for key, state in states.items()},
            "shaft_percent": _off(touching.loads[i], analytic.loads[i]),
            **{f"{key}_percent": _off(state.loads[i], analytic.loads[i]) for key, state in others.items()},
        }
        for i in range(len(others["cut_shaft"].angles))
        if analytic.loads[i] > 0.0
    ]
    cost: Row = {
        "bearing": name,
        "load": load,
        "sinusoidal_cpu_s": seconds,
        "shaft_cpu_s": rigid_seconds + solid_seconds,
        "more_percent": 100.0 * ((rigid_seconds + solid_seconds) / seconds - 1.0),
        "unknowns_ring": fit.unknowns["inner ring"],
        "unknowns_shaft": fit.unknowns["shaft"],
        "parted_from_deg": math.degrees(touching.parted),
        "displacement_um": 1e6 * touching.displacement,
        "sinusoidal_um": 1e6 * float(states["sinusoidal"].displacement[0]),
        "rigid_um": 1e6 * float(states["rigid"].displacement[0]),
    }
    return rows, cost


def _off(value: float, reference: float) -> float:
    return 100.0 * (float(value) / float(reference) - 1.0)


def sizes(geometry: FeGeometry, load: float) -> list[Row]:
    """Return the loads of the elements on the shaft over the sizes of pressures and meshes."""
    bearing = fe_bearing(geometry, load).assembled
    base = FitRule()
    rules = {
        "default": base,
        "17 points around": replace(base, angles=17),
        "37 points around, finer shaft": replace(base, angles=37, shaft=ShaftMeshRule(eighth=12, size=0.2, finest=0.5)),
        "5 points along": replace(base, layers=5),
        "finer ring": replace(base, ring=replace(INFLUENCE_RULE, size=0.4, coarse=0.35, along=5)),
    }
    first: NDArray[np.float64] | None = None
    first_cut: NDArray[np.float64] | None = None
    rows: list[Row] = []
    for name, rule in rules.items():
        state = SolidShaft(geometry, rule).solve(bearing, load)
        loaded = state.loads[state.loads > 0.0]
        first = loaded if first is None else first
        cut = SolidShaft(geometry, rule, cut=True).solve(bearing, load)
        first_cut = cut.loads if first_cut is None else first_cut
        rows.append(
            {
                "rule": name,
                **{f"load_{i}": float(value) for i, value in enumerate(loaded)},
                "largest_change_percent": 100.0 * float(np.abs(loaded / first - 1.0).max()),
                "displacement_um": 1e6 * state.displacement,
                "cut_largest_change_percent": 100.0 * float(np.abs(cut.loads / first_cut - 1.0).max()),
                "converged": str(state.converged and cut.converged),
            }
        )
    return rows


def published(shares: list[Row], costs: list[Row]) -> list[Row]:
    """Return the printed figures of section 3.4.3 beside those obtained."""
    rollers = [row for row in shares if row["bearing"] == "NU 202 ECP"]
    last = max(float(row["angle_deg"] or 0.0) for row in rollers)
    away = [row for row in rollers if float(row["angle_deg"] or 0.0) == last]
    common = {"place": "3.4.3", "bearing": "NU 202 ECP", "unit": "%"}
    rows: list[Row] = [
        {
            **common,
            "quantity": "load of the roller at 62.4 degrees on a loaded shaft against Eq. 27",
            "condition": "0.1 and 10 kN, largest",
            "printed": PRINTED_SHARE,
            "obtained": max(abs(float(row["shaft_percent"] or 0.0)) for row in away),
            "status": "differs",
            "note": "whole rings; the next row has them cut",
        },
        {
            **common,
            "quantity": "the same with ring and shaft cut to the loaded half, as in the thesis",
            "condition": "0.1 and 10 kN, largest",
            "printed": PRINTED_SHARE,
            "obtained": max(abs(float(row["cut_shaft_percent"] or 0.0)) for row in away),
            "status": "agrees",
            "note": "the ends of the cut ring give way",
        },
        {
            **common,
            "quantity": "loads under a sinusoidal pressure against Eq. 27",
            "condition": "0.1 and 10 kN, largest",
            "printed": PRINTED_SINUSOIDAL,
            "obtained": max(abs(float(row["sinusoidal_percent"] or 0.0)) for row in rollers),
            "status": "agrees",
            "note": "",
        },
    ]
    for row in costs:
        load = float(row["load"] or 0.0)
        if row["bearing"] == "NU 202 ECP" and load in PRINTED_TIME:
            rows.append(
                {
                    **common,
                    "quantity": "time that the shaft adds",
                    "condition": f"{load:g} N",
                    "printed": PRINTED_TIME[load],
                    "obtained": row["more_percent"],
                    "status": "in kind",
                    "note": "noise: ring and shaft are factorised once, a load costs an exchange of closed points",
                }
            )
    return rows


def main() -> None:
    """Run the benchmark."""
    options = arguments(__doc__ or "")
    shares: list[Row] = []
    costs: list[Row] = []
    for name in BEARINGS[: 1 if options.quick else None]:
        for load in LOADS[name]:
            rows, cost = compare(name, load)
            shares += rows
            costs.append(cost)
    tables: dict[str, list[Row]] = {"shares": shares, "costs": costs}
    if not options.quick:
        tables["sizes"] = sizes(fe_geometry(catalogue_entry("NU 202 ECP")), 10000.0)
    for title, rows in tables.items():
        print_table(title, rows)
    write_json(options.json, {**tables, "published": published(shares, costs)})


if __name__ == "__main__":
    main()
