"""What RMS maps and V_eq change when the stiffness of finite elements replaces the analytic one.

The bearing is the thesis' 1205 ETN9 on its rig. The k_c of finite elements is that with which the lumped bearing has
the mean stiffness along the load of a meshed one (``models.fe.bearings.rig``), k_i that of the shaft of
``fe_shaft.toml``.

1. Maps of RMS over extent and depth with each rig: ratio to the map of the analytic rig, node by node.
2. Records of lives that were simulated with the rig of finite elements (growth, rough floors, scatter), tracked through
   both maps by the filter: ratio of both V_eq of the same records, and how far each is from the truth.

    python -m benchmarks.fe_maps [--json FILE] [--quick]
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.common import Row, arguments, print_table, write_json
from benchmarks.filter import FEATURES, follow, slices_of
from models.fe.bearings.oblique import oblique_geometry
from models.fe.bearings.rig import EffectiveStiffness, rig_stiffness
from models.fe.bearings.self_aligning import self_aligning_bearing
from models.fe.shafts.shaft import ShaftModel
from models.lives.life import simulate_lives
from models.lives.population import Population
from models.machine.bearing import catalogue_entry
from models.machine.hertz import contact_stiffness
from models.machine.rig import Rig
from models.maps.build import build_map
from models.maps.data import RmsMap
from models.maps.plan import MapPlan
from monitor.fe.config_shaft import read_shaft
from monitor.health.size.filter.particle_filter import FilterSettings

Floats = NDArray[np.float64]

ENTRY = catalogue_entry("1205 ETN9")
LOAD, SPEED = 4000.0, 40.0
SHAFT = Path(__file__).with_name("fe_shaft.toml")
LIFE_SEED = 2115
PLAN = MapPlan(
    load=(LOAD,),
    speed=(SPEED,),
    h_d=tuple(2e-6 * i for i in range(17)),
    dphi_d=tuple(math.radians(i) for i in range(51)),
    rms_band=(0.0, 9500.0),
)


def stiffnesses() -> tuple[list[Row], EffectiveStiffness]:
    """Return k_c by each way, and that of finite elements as ``bearing --fe --write-rig`` writes it."""
    bearing = self_aligning_bearing(oblique_geometry(ENTRY), LOAD).assembled
    found = rig_stiffness(bearing, ENTRY.bearing, LOAD, mesh_error=bearing.law.mesh_error)
    rows: list[Row] = [
        _plain("printed (Table 14)", Rig.k_c),
        _plain("Hertz, fits of Brewe and Hamrock", contact_stiffness(ENTRY.bearing)),
        _plain("Hertz, exact", contact_stiffness(ENTRY.bearing, "elliptic")),
        {
            "k_c": "finite elements",
            "value": found.value / 1e6,
            "low": found.low / 1e6,
            "high": found.high / 1e6,
            "spread_percent": 100.0 * found.spread,
            "mesh_percent": 100.0 * found.mesh_error,
        },
    ]
    rows += [_plain(f"finite elements, {name} at {load:g} N alone", k_c) for name, load, k_c in found.matched]
    return rows, found


def _plain(name: str, k_c: float) -> Row:
    blank = dict.fromkeys(("low", "high", "spread_percent", "mesh_percent"))
    return {"k_c": name, "value": k_c / 1e6, **blank}


def ratio_row(name: str, rig: Rig, ratio: Floats) -> Row:
    """Return how a ratio is spread over nodes or records."""
    low, quarter, middle, upper, high = np.percentile(ratio, (5.0, 25.0, 50.0, 75.0, 95.0))
    return {
        "rig": name,
        "k_c": rig.k_c / 1e6,
        "k_i": rig.k_i / 1e6,
        "median": float(middle),
        "from_25": float(quarter),
        "to_75": float(upper),
        "from_5": float(low),
        "to_95": float(high),
        "least": float(ratio.min()),
        "most": float(ratio.max()),
    }


def map_rows(maps: Mapping[str, RmsMap], rigs: Mapping[str, Rig], first: str) -> list[Row]:
    """Return the ratio of the RMS of each map to that of the first over the damaged nodes."""
    own = maps[first].rms[0, 0, 1:, 1:]
    return [ratio_row(name, rigs[name], maps[name].rms[0, 0, 1:, 1:] / own) for name in maps if name != first]


def extent_rows(maps: Mapping[str, RmsMap], first: str, other: str) -> list[Row]:
    """Return the ratio of the RMS of two maps over ranges of the extent, all depths."""
    ratio = maps[other].rms[0, 0, 1:] / np.where(maps[first].rms[0, 0, 1:] > 0.0, maps[first].rms[0, 0, 1:], np.nan)
    extents = np.degrees(maps[first].dphi_d)
    rows: list[Row] = []
    for low, high in ((0.0, 5.0), (5.0, 10.0), (10.0, 20.0), (20.0, 35.0), (35.0, 50.0)):
        values = ratio[:, (extents > low) & (extents <= high)]
        least, middle, most = np.percentile(values, (5.0, 50.0, 95.0))
        rows.append(
            {
                "dphi_d_deg": f"{low:g} to {high:g}",
                "nodes": int(values.size),
                "median": float(middle),
                "from_5": float(least),
                "to_95": float(most),
            }
        )
    return rows


def volume_rows(maps: Mapping[str, RmsMap], rigs: Mapping[str, Rig], first: str, truth: str, lives: int) -> list[Row]:
    """Return V_eq of records of the rig ``truth`` through each map over that through its own, and over the truth."""
    population = Population(
        rig=rigs[truth], rig_spread=(), load=(LOAD, LOAD), speed=(SPEED, SPEED), interval=900.0, seed=LIFE_SEED
    )
    histories = list(simulate_lives(population, range(lives)))
    rows: list[Row] = []
    for features, lines in FEATURES.items():
        tracked = {
            name: follow(histories, slices_of(one), FilterSettings(one.part_radius, lines=lines))
            for name, one in maps.items()
        }
        own = tracked[truth]
        for name, one in tracked.items():
            known = np.isfinite(one.v_eq) & np.isfinite(own.v_eq)
            error = np.log(one.v_eq[known] / one.true[known])
            rows.append(
                {
                    "features": features,
                    "records": int(known.sum()),
                    **ratio_row(name, rigs[name], one.v_eq[known] / own.v_eq[known]),
                    "within_interval": float(
                        np.mean((one.lower[known] <= one.true[known]) & (one.true[known] <= one.upper[known]))
                    ),
                    "bias_ln": float(np.mean(error)),
                    "rms_ln": float(np.sqrt(np.mean(error**2))),
                }
            )
    return rows


def main() -> None:
    """Run the benchmark."""
    options = arguments(__doc__ or "")
    lives = 2 if options.quick else 24
    plan = replace(PLAN, h_d=PLAN.h_d[::4], dphi_d=PLAN.dphi_d[::2]) if options.quick else PLAN
    began = time.process_time()
    stiffness, k_c = stiffnesses()
    seconds = time.process_time() - began
    k_i = ShaftModel(read_shaft(SHAFT)).solve(LOAD).stiffness
    first, own = "analytic, as printed", "finite elements"
    rigs = {
        first: Rig(),
        "analytic, exact Hertz": Rig(k_c=contact_stiffness(ENTRY.bearing, "elliptic")),
        own: Rig(k_c=k_c.value),
        "finite elements, k_i of the shaft": Rig(k_c=k_c.value, k_i=k_i),
        "finite elements, low": Rig(k_c=k_c.low),
        "finite elements, high": Rig(k_c=k_c.high),
    }
    maps = {name: build_map(replace(plan, rig=rig)) for name, rig in rigs.items()}
    spread = build_map(
        replace(plan, rig=rigs[own], rig_draws=8, rig_spread=0.0, rig_spread_k_r=0.0, rig_spread_k_c=k_c.spread)
    )
    damaged = spread.rms_rig_std[0, 0, 1:, 1:] / spread.rms[0, 0, 1:, 1:]
    tables: dict[str, list[Row]] = {
        "stiffness": stiffness,
        "rms": map_rows(maps, rigs, first),
        "rms_by_extent": extent_rows(maps, first, own),
        "rms_spread_of_k_c": [
            {
                "spread_of_k_c_percent": 100.0 * k_c.spread,
                "median_percent": 100.0 * float(np.median(damaged)),
                "to_95_percent": 100.0 * float(np.percentile(damaged, 95.0)),
            }
        ],
        "v_eq": volume_rows({name: maps[name] for name in (first, own)}, rigs, first, own, lives),
    }
    for title, rows in tables.items():
        print_table(title, rows)
    write_json(options.json, {**tables, "cost": {"finite_elements_cpu_s": seconds}})


if __name__ == "__main__":
    main()
