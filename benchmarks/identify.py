"""How well the parameters of a rig are found again from simulated tests, and what the tests do not tell.

The truth is Table 18 of the thesis (zeta_i 4.749 % at 400 Hz, zeta_r 0.11 % at 8 kHz), the tests are its 18
conditions (20, 30, 40 Hz x 1, 2 kN x D1 to D3), each feature with 3 % of noise. ``beta_c`` of the truth is the upper
limit that the thesis prints, so there are two cases: limits that leave room above it, and the printed ones.

    python -m benchmarks.identify [--seeds 20] [--more-free k_c k_i m_o m_i] [--resonance-sd 0.003]
                                 [--json FILE] [--quick]
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.common import Row, print_table, write_json
from models.identify.evaluate import Evaluator
from models.identify.evidence import Evidence, Peak
from models.identify.limits import Limits
from models.identify.run import Identification, IdentifyOptions, identify
from models.identify.search import design_points
from models.identify.space import DEFAULT_FREE, Space
from models.identify.trials import Condition, Trial, gather
from models.machine.bearing import from_catalogue
from models.machine.rig import Rig
from models.published.thesis import EXTENTS_DEG, SEEDED_DEPTH
from models.work.choose import local_runner

NOISE = 0.03
BAND = (0.0, 9500.0)
LOADS, SPEEDS = (1000.0, 2000.0), (20.0, 30.0, 40.0)
# zeta_2 = 15 % alone would keep beta_c below 3.2e-5 s.
CASES = {
    "room above beta_c": Limits(beta_c=(0.25e-5, 5e-5), zeta_2=(1e-3, 0.3)),
    "limits as printed": Limits(),
}
NAMED = ("m_r", "k_r", "beta_c", "c_i")


def conditions() -> list[Condition]:
    """Return the 18 conditions."""
    return [
        Condition(load, speed, float(np.radians(extent)), SEEDED_DEPTH)
        for speed in SPEEDS
        for load in LOADS
        for extent in EXTENTS_DEG.values()
    ]


def run(
    limits: Limits, free: tuple[str, ...], seed: int, workers: int, resonance_sd: float = 0.0
) -> tuple[Identification, dict[str, float]]:
    """Identify the hidden truth from noisy tests; return the result and the truth.

    ``resonance_sd`` adds the highest resonance along each load, measured with that relative uncertainty.
    """
    space = Space(Rig(), from_catalogue("1205 ETN9"), LOADS, free=free, limits=limits)
    truth = space.known
    level = Evaluator(space, conditions(), BAND).levels([truth])[0]
    draws = np.random.default_rng([seed, 15])
    noise = draws.standard_normal(level.features.shape)
    noisy = level.features * np.exp(NOISE * noise)
    trials = gather([Trial(c, rms, a) for c, (rms, a) in zip(conditions(), noisy.tolist(), strict=True)])
    peaks: list[Peak] = []
    for load, resonance in zip(LOADS, space.resonances(truth)[1::2], strict=True) if resonance_sd else ():
        measured = resonance * float(np.exp(resonance_sd * draws.standard_normal()))
        peaks.append(Peak(load, "along", measured, resonance_sd * measured))
    options = IdentifyOptions(band=BAND, seed=seed)
    with local_runner(workers) as runner:
        return identify(trials, space, options, Evidence(tuple(peaks)), runner=runner), truth


def row_of(case: str, seed: int, found: Identification, truth: Mapping[str, float], cpu: float) -> dict[str, Any]:
    """Return the figures of one seed: errors in percent, and whether the intervals hold the truth."""
    space = found.space
    f_r = float(np.mean(found.resonances)) / float(np.mean(space.resonances(truth))) - 1.0
    errors = {name: 100.0 * (found.best.values[name] / truth[name] - 1.0) for name in NAMED}
    slack = 1e-6
    inside = [
        name
        for name, interval in found.intervals.items()
        if interval.low * (1.0 - slack) <= truth[name] <= interval.high * (1.0 + slack)
    ]
    return {
        "case": case,
        "seed": seed,
        "f_r %": 100.0 * f_r,
        **{f"{name} %": error for name, error in errors.items()},
        "cost": found.best.cost,
        "covered": " ".join(inside),
        "all covered": len(inside) == len(found.intervals),
        "undetermined": " ".join(found.undetermined),
        "intervals": {name: [i.low, i.high, i.sd] for name, i in found.intervals.items()},
        "best": {name: found.best.values[name] for name in space.free},
        "evaluations": found.evaluations,
        "cpu_s": cpu,
        "wall_s": found.seconds,
    }


def summary(case: str, rows: list[dict[str, Any]]) -> Row:
    """Return how often a case meets what is asked."""
    chosen = [row for row in rows if row["case"] == case]

    def within(name: str, limit: float) -> int:
        return sum(abs(row[f"{name} %"]) <= limit for row in chosen)

    covered: dict[str, int] = {}
    for row in chosen:
        for name in row["covered"].split():
            covered[name] = covered.get(name, 0) + 1
    return {
        "case": case,
        "seeds": len(chosen),
        "f_r in 0.5 %": within("f_r", 0.5),
        "m_r in 5 %": within("m_r", 5.0),
        "k_r in 5 %": within("k_r", 5.0),
        **{f"{name} covered": covered.get(name, 0) for name in DEFAULT_FREE},
        "cpu_s": float(np.mean([row["cpu_s"] for row in chosen])),
        "evaluations": float(np.mean([row["evaluations"] for row in chosen])),
    }


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the same figures to this file")
    parser.add_argument("--quick", action="store_true", help="one seed, two unknowns, one case: ends within a minute")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--case", choices=list(CASES), action="append", help="default: both")
    parser.add_argument("--resonance-sd", type=float, default=0.0, help="relative; adds measured resonances")
    parser.add_argument("--more-free", nargs="+", default=[], metavar="NAME", help="such as k_c k_i m_o m_i")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    chosen = parser.parse_args()
    cases = chosen.case or list(CASES)[: 1 if chosen.quick else None]
    seeds = [chosen.first_seed] if chosen.quick else list(range(chosen.first_seed, chosen.first_seed + chosen.seeds))
    free = ("m_r", "beta_c") if chosen.quick else (*DEFAULT_FREE, *chosen.more_free)
    print(f"unknown: {', '.join(free)}; {design_points(len(free))} points of the design")
    rows: list[dict[str, Any]] = []
    for case in cases:
        for seed in seeds:
            began = time.process_time()
            found, truth = run(CASES[case], free, seed, chosen.workers, chosen.resonance_sd)
            rows.append(row_of(case, seed, found, truth, time.process_time() - began))
            print(rows[-1], flush=True)
            table: list[Row] = [summary(name, rows) for name in cases if any(row["case"] == name for row in rows)]
            # Written after each seed: a long run that is stopped leaves what it has.
            write_json(chosen.json, {"summary": table, "seeds": rows})
    print_table("hidden truth, 18 conditions, 3 % noise", [summary(name, rows) for name in cases])


if __name__ == "__main__":
    main()
