"""How wrong RMS maps are between their nodes, loads and speeds, and how far floors and rig parameters move them.

Run as ``python -m benchmarks.maps.thesis [--quick] [--json FILE]``. All errors and spreads are in per cent; errors are
relative to the largest value of the map at its load and speed, against fresh simulations. Bearing, rig and band are
those of the thesis (1205 ETN9, RMS in 0 to 9500 Hz, 40 Hz and 4 kN unless said). Tables:

1. grid: extents and depths evenly spaced, and refined to a tolerance; nodes, time, error of RMS and of the first line;
2. loads, 3. speeds: error half-way or at random between nodes, linear as ``RmsMap.slice_at`` does it, linear in the
   logarithm, and for speeds a cubic spline through all of them; at nodes of extent and depth;
4. spread: standard deviation of RMS and of the first line over rough floors and over rig parameters, by depth.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from benchmarks.common import Row, Tables, benchmark
from models.machine.scene import Floor, Slip
from models.maps.build import build_map, build_refined_map
from models.maps.data import RmsMap
from models.maps.nodes import simulate_node_row, simulate_point
from models.maps.plan import MapPlan, scene_at

Floats = NDArray[np.float64]
SEED = 90


def plan_of(extents: int, depths: int) -> MapPlan:
    """Return the plan of an evenly spaced map of 50 degrees and 32 um."""
    return MapPlan(
        load=(4000.0,),
        speed=(40.0,),
        h_d=tuple(np.linspace(0.0, 32e-6, depths).tolist()),
        dphi_d=tuple(np.radians(np.linspace(0.0, 50.0, extents)).tolist()),
        rms_band=(0.0, 9500.0),
    )


def per_cent(errors: Floats) -> float:
    """Return the RMS of relative errors in per cent."""
    return 100.0 * float(np.sqrt(np.mean(np.square(errors))))


def grid_row(name: str, make: Callable[[], RmsMap], points: int) -> Row:
    """Return what a grid costs and how wrong it is at random points of its own."""
    start = time.process_time()
    built = make()
    seconds = time.process_time() - start
    at, rng = built.slice_at(4000.0, 40.0), np.random.default_rng(SEED)
    places = np.column_stack((rng.uniform(0.0, built.h_d[-1], points), rng.uniform(0.0, built.dphi_d[-1], points)))
    true = np.array([_true(built.plan, h, x) for h, x in places.tolist()])
    rms = (at.interpolate(places[:, 1], places[:, 0]) - true[:, 0]) / at.rms.max()
    line = at.interpolate_harmonics(places[:, 1], places[:, 0])[:, 0] - true[:, 1]
    line /= at.harmonic_amplitude[..., 0].max()
    return {
        "grid": name,
        "depths": len(built.h_d),
        "extents": len(built.dphi_d),
        "nodes": built.rms.size,
        "cpu s": seconds,
        "rms error": per_cent(rms),
        "p99": 100.0 * float(np.quantile(np.abs(rms), 0.99)),
        "max": 100.0 * float(np.abs(rms).max()),
        "stated": 100.0 * float(built.attributes["interpolation_error"]),
        "line 1 error": per_cent(line),
        "falls with depth": 100.0 * float(np.mean(built.falling("h_d"))),
        "falls with extent": 100.0 * float(np.mean(built.falling("dphi_d"))),
    }


def _true(plan: MapPlan, h_d: float, dphi_d: float) -> tuple[float, float]:
    """Return RMS and first line, averaged over the plan's floors."""
    found = [simulate_point(plan, scene_at(plan, 4000.0, 40.0, h_d, dphi_d, n)) for n in range(plan.floors)]
    return float(np.mean([r.rms for r in found])), float(np.mean([r.harmonics[0] for r in found]))


def grid_rows(quick: bool) -> list[Row]:
    """Return the table of grids."""
    points = 200 if quick else 1000
    even = (51, 101) if quick else (26, 51, 101, 201, 401)
    rows = [
        grid_row(f"even, {50.0 / (n - 1):g} deg", lambda n=n: build_map(plan_of(n, 17 if quick else 33)), points)
        for n in even
    ]
    floors = 2 if quick else 16
    rough = replace(plan_of(51, 17), floor=Floor("rough"), floors=floors)
    rows.append(grid_row(f"even, 1 deg, {floors} floors", lambda: build_map(rough), points // 4))
    start = plan_of(51, 33)
    for tolerance in (0.02,) if quick else (0.02, 0.01, 0.005, 0.002):
        name = f"refined to {100 * tolerance:g} %"
        rows.append(grid_row(name, lambda t=tolerance: build_refined_map(start, t), points))
    return rows


class Levels:
    """RMS and first line over a set of extents and depths at any load and speed, simulated once each."""

    def __init__(self, quick: bool, slip: Slip | None = None, records: int = 1) -> None:
        """Take the extents and depths; with slip, the mean over records."""
        plan = plan_of(11 if quick else 51, 3 if quick else 5)
        self.plan = replace(plan, h_d=plan.h_d[1:], dphi_d=plan.dphi_d[1:], slip=slip, floors=records)
        self.at = cache(self._at)

    def _at(self, load: float, speed: float) -> tuple[Floats, Floats]:
        """Return both, shape (H, D) each."""
        if self.plan.slip is not None:
            from models.maps.ensemble import ensemble_nodes

            nodes = ensemble_nodes(replace(self.plan, load=(load,), speed=(speed,)))
            return nodes.rms[0, 0], nodes.harmonic_amplitude[0, 0, ..., 0]
        extents = np.array(self.plan.dphi_d)
        rows = [simulate_node_row(self.plan, load, speed, h, extents) for h in self.plan.h_d]
        return np.array([r.rms for r in rows]), np.array([r.harmonics[:, 0] for r in rows])


def between(low: tuple[Floats, Floats], high: tuple[Floats, Floats], true: tuple[Floats, Floats], u: float) -> Floats:
    """Return the errors of linear and logarithmic RMS and of the linear first line, shape (3, H, D)."""
    linear = (1.0 - u) * low[0] + u * high[0] - true[0]
    logarithmic = np.exp((1.0 - u) * np.log(low[0]) + u * np.log(high[0])) - true[0]
    line = (1.0 - u) * low[1] + u * high[1] - true[1]
    top, top_line = (max(low[k].max(), high[k].max()) for k in (0, 1))
    return np.array([linear / top, logarithmic / top, line / top_line])


def summary(errors: Floats) -> Mapping[str, float]:
    """Return the columns that the tables of loads and speeds share, from errors of shape (3, ...)."""
    return {
        "linear": per_cent(errors[0]),
        "max": 100.0 * float(np.abs(errors[0]).max()),
        "bias": 100.0 * float(errors[0].mean()),
        "logarithmic": per_cent(errors[1]),
        "line 1": per_cent(errors[2]),
    }


def load_rows(levels: Levels) -> list[Row]:
    """Return the errors half-way between loads."""
    rows = []
    for low, high in ((3000.0, 4000.0), (4000.0, 4700.0), (4700.0, 5000.0), (3000.0, 5000.0)):
        at = [levels.at(load, 40.0) for load in (low, high, 0.5 * (low + high))]
        rows.append({"loads N": f"{low:g}, {high:g}", **summary(between(at[0], at[1], at[2], 0.5))})
    return rows


def speed_rows(name: str, levels: Levels, steps: tuple[float, ...], count: int) -> list[Row]:
    """Return the errors at random speeds between nodes so many Hz apart."""
    rows = []
    speeds = np.random.default_rng(SEED).uniform(20.0, 45.0, count).tolist()
    for step in steps:
        errors, cubic = [], []
        for speed in speeds:
            low = 20.0 + step * int((speed - 20.0) / step)
            u = (speed - low) / step
            ends = levels.at(4000.0, low), levels.at(4000.0, low + step)
            true = levels.at(4000.0, speed)
            errors.append(between(*ends, true, u))
            if step >= 5.0:
                nodes = np.arange(20.0, 45.0 + 0.5 * step, step)
                spline = CubicSpline(nodes, [levels.at(4000.0, float(s))[0] for s in nodes])
                cubic.append((spline(speed) - true[0]) / max(ends[0][0].max(), ends[1][0].max()))
        columns = summary(np.moveaxis(np.array(errors), 1, 0))
        rows.append({"motion": name, "step Hz": step, **columns, "cubic": per_cent(np.array(cubic)) if cubic else None})
    return rows


def spread_rows(quick: bool) -> list[Row]:
    """Return relative spreads over floors and rig parameters, medians over the extents, by depth."""
    plan = plan_of(11 if quick else 51, 9)
    count = 8 if quick else 24
    rough = build_map(replace(plan, floor=Floor("rough"), floors=count, rig_draws=count))
    smooth = build_map(replace(plan, rig_draws=count))
    rows = []
    for k in range(1, len(plan.h_d)):
        row: dict[str, float | int | str | None] = {"depth um": plan.h_d[k] * 1e6}
        for name, built in (("rough", rough), ("smooth", smooth)):
            rms, line = built.rms[0, 0, k, 1:], built.harmonic_amplitude[0, 0, k, 1:, 0]
            if name == "rough":
                row["floors"] = _median(built.rms_std[0, 0, k, 1:] / rms)
                row["floors, line 1"] = _median(built.harmonic_std[0, 0, k, 1:, 0] / line)
                row["standard error"] = _median(built.rms_se[0, 0, k, 1:] / rms)
            row[f"rig, {name}"] = _median(built.rms_rig_std[0, 0, k, 1:] / rms)
            row[f"rig, {name}, line 1"] = _median(built.harmonic_rig_std[0, 0, k, 1:, 0] / line)
        rows.append(row)
    return rows


def _median(values: Floats) -> float:
    return 100.0 * float(np.median(values))


@benchmark("RMS maps: errors between nodes, loads and speeds; spread over floors and rig parameters.")
def main(quick: bool) -> Tables:
    """Print the tables and write the JSON file if one was asked for."""
    build_map(plan_of(3, 3))
    levels = Levels(quick)
    steps = (5.0, 1.0) if quick else (5.0, 2.5, 1.0, 0.5, 0.25, 0.1)
    tables = {
        "grid": grid_rows(quick),
        "loads": load_rows(levels),
        "speeds": speed_rows("settled", levels, steps, 5 if quick else 16),
        "spread": spread_rows(quick),
    }
    slipping = Levels(True, Slip(0.01), 4 if quick else 32)
    slow = (5.0,) if quick else (5.0, 2.5, 1.0)
    tables["speeds"] += speed_rows("slip up to 0.01 rad", slipping, slow, 2 if quick else 8)
    return tables
