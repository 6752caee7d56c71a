"""How well the search finds a known rig again from noisy tests, and whether what it finds fits better than the truth.

The truth is Table 18 of the thesis, the tests are its 18 conditions (20, 30, 40 Hz, 1, 2 kN, D1 to D3) with 3 % of
noise in each feature, the limits leave room above beta_c. Beside the best fit stands the one from the truth itself:
where that is no better, the tests do not tell the right valley of f_r, however well it is searched. Seeds from 20 to 39
are set aside.

    python -m benchmarks.identify.truth [--first-seed 0] [--seeds 4] [--whole] [--json FILE] [--quick]
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.common import print_table, write_json
from models.identify.evaluate import Evaluator
from models.identify.limits import AdmissibleLimits
from models.identify.problem import Problem
from models.identify.run import IdentifyOptions, identify
from models.identify.search import search
from models.identify.space import DEFAULT_FREE, Space
from models.identify.trials import Condition, Trial, Trials, gather
from models.machine.bearing import from_catalogue
from models.machine.rig import Rig
from models.published.thesis import EXTENTS_DEG, SEEDED_DEPTH

NOISE, BAND, LOADS, SPEEDS = 0.03, (0.0, 9500.0), (1000.0, 2000.0), (20.0, 30.0, 40.0)
LIMITS = AdmissibleLimits(beta_c=(0.25e-5, 5e-5), zeta_2=(1e-3, 0.3))
CONDITIONS = tuple(
    Condition(load, speed, float(np.radians(extent)), SEEDED_DEPTH)
    for speed in SPEEDS
    for load in LOADS
    for extent in EXTENTS_DEG.values()
)


def noisy_trials(space: Space, seed: int) -> Trials:
    """Return the tests of the known rig of a space."""
    features = Evaluator(space, CONDITIONS, BAND).levels([space.known])[0].features
    noisy = features * np.exp(NOISE * np.random.default_rng([seed, 15]).standard_normal(features.shape))
    return gather([Trial(c, rms, a) for c, (rms, a) in zip(CONDITIONS, noisy.tolist(), strict=True)])


def run(seed: int, free: tuple[str, ...], *, whole: bool) -> dict[str, Any]:
    """Return the figures of one seed; with ``whole`` the intervals, too."""
    space = Space(Rig(), from_catalogue("1205 ETN9"), LOADS, free=free, limits=LIMITS)
    trials, truth = noisy_trials(space, seed), space.known
    problem = Problem(trials, Evaluator(space, trials.conditions, BAND))
    from_truth = problem.fit(space, space.encode(truth), calls=25)
    problem.evaluator.kept.clear()
    problem.evaluator.simulated = 0
    began, wall = time.process_time(), time.perf_counter()
    covered: dict[str, bool] = {}
    if whole:
        found = identify(trials, space, IdentifyOptions(band=BAND, seed=seed))
        best, evaluator = found.best, found.problem.evaluator
        covered = {name: i.low <= truth[name] <= i.high for name, i in found.intervals.items()}
    else:
        best, evaluator = search(problem, seed)[0], problem.evaluator
    f_r = float(np.mean(space.resonances(best.values))) / float(np.mean(space.resonances(truth)))
    return {
        "seed": seed,
        "cost": best.cost,
        "from the truth": None if from_truth is None else from_truth.cost,
        "f_r %": 100.0 * (f_r - 1.0),
        "k_r %": 100.0 * (best.values["k_r"] / truth["k_r"] - 1.0),
        "covered": f"{sum(covered.values())} of {len(covered)}",
        "candidates": evaluator.simulated,
        "cpu_s": time.process_time() - began,
        "wall_s": time.perf_counter() - wall,
    }


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the same figures to this file")
    parser.add_argument("--quick", action="store_true", help="one seed, one unknown")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--whole", action="store_true", help="with intervals")
    chosen = parser.parse_args()
    free = ("m_r",) if chosen.quick else DEFAULT_FREE
    rows: list[dict[str, Any]] = []
    for seed in range(chosen.first_seed, chosen.first_seed + (1 if chosen.quick else chosen.seeds)):
        rows.append(run(seed, free, whole=chosen.whole))
        print(rows[-1], flush=True)
        write_json(chosen.json, {"seeds": rows})
    right = sum(abs(row["f_r %"]) <= 0.5 and abs(row["k_r %"]) <= 5.0 for row in rows)
    print_table(f"f_r within 0.5 % and k_r within 5 %: {right} of {len(rows)}", rows)


if __name__ == "__main__":
    main()
