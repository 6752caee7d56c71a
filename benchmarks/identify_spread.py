"""Whether V_eq of a machine whose rig was identified lies within its interval: spread of the posterior, or assumed.

A hidden rig (m_r, beta_c and c_r drawn in their limits) is identified from simulated tests with 3 % of noise: six at
two speeds, or two at one speed, which leave one feature more than unknowns. Maps of the best fit are built with draws
of the posterior, with the assumed 3.5 % (k_r 1.4 %), with 5 %, and, for comparison, of the true rig. They are held
against

1. the hidden machine itself, node by node: share of the nodes whose RMS lies within the 80 % interval of the map;
2. lives of the hidden machine with growth, rough floors, gains of the sensor and scatter of their own
   (``models.lives``), tracked by the filter: share of the lives whose V_eq lies within the stated 80 % interval.

    python -m benchmarks.identify_spread [--json FILE] [--quick]
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.common import Row, arguments, print_table, write_json
from benchmarks.filter import FEATURES, Tracked, follow, slices_of
from models.identify.evaluate import Evaluator
from models.identify.run import Identification, IdentifyOptions, identify
from models.identify.space import Space
from models.identify.trials import Condition, Trial, gather
from models.lives.life import LifeHistory, simulate_lives
from models.lives.population import Population
from models.machine.bearing import from_catalogue
from models.machine.rig import Rig
from models.maps.build import build_map
from models.maps.data import RmsMap
from models.maps.plan import MapPlan
from models.published.thesis import EXTENTS_DEG, SEEDED_DEPTH
from models.work.choose import local_runner
from monitor.health.size.filter.particle_filter import FilterSettings

Floats = NDArray[np.float64]

NOISE, BAND, LOAD = 0.03, (0.0, 9500.0), 2000.0
BEARING = from_catalogue("1205 ETN9")
FREE = ("m_r", "beta_c", "c_r")
_EXTENTS = tuple(EXTENTS_DEG.values())
TESTS = {"six tests": ((30.0, 40.0), _EXTENTS), "two tests": ((40.0,), _EXTENTS[::2])}
"""Speeds, Hz, and extents, degrees."""
# Places of the hidden parameters on their coordinates: c_r mostly low, where it is found.
PLACES = ((0.1, 0.9), (0.2, 0.9), (0.05, 0.5))
LEVEL = 0.8
PLAN = MapPlan(
    load=(4000.0,),
    speed=(40.0,),
    h_d=tuple(2e-6 * i for i in range(17)),
    dphi_d=tuple(math.radians(i) for i in range(51)),
    rms_band=BAND,
)


def hidden_rig(seed: int) -> dict[str, float]:
    """Return the parameters of a machine."""
    space = Space(Rig(), BEARING, (LOAD,), free=FREE)
    rng = np.random.default_rng([seed, 1506])
    values = space.decode(np.array([rng.uniform(*places) for places in PLACES]))
    assert values is not None
    return values


def identified(truth: Mapping[str, float], case: str, seed: int, workers: int) -> Identification:
    """Return what noisy tests tell of a machine."""
    speeds, extents = TESTS[case]
    conditions = [Condition(LOAD, speed, math.radians(extent), SEEDED_DEPTH) for speed in speeds for extent in extents]
    space = Space(Rig(), BEARING, (LOAD,), free=FREE)
    level = Evaluator(space, conditions, BAND).levels([truth])[0]
    noise = np.random.default_rng([seed, 1507]).standard_normal(level.features.shape)
    noisy = (level.features * np.exp(NOISE * noise)).tolist()
    trials = gather([Trial(condition, *row) for condition, row in zip(conditions, noisy, strict=True)])
    with local_runner(workers) as runner:
        return identify(trials, space, IdentifyOptions(band=BAND, seed=seed), runner=runner)


def maps_of(found: Identification, truth: Rig, draws: int, plan: MapPlan) -> dict[str, RmsMap]:
    """Return the maps that are compared."""
    best = replace(found.space.rig_of(found.best.values), calibrated=True, identification=found.hash)
    posterior = found.posterior.draws.first(draws)
    plans = {
        "posterior": replace(plan, rig=best, rig_draws=draws, rig_posterior=posterior),
        "assumed 3.5 %": replace(plan, rig=best, rig_draws=draws),
        "assumed 5 %": replace(plan, rig=best, rig_draws=draws, rig_spread=0.05, rig_spread_k_r=0.05),
        "true rig": replace(plan, rig=truth),
    }
    return {name: build_map(one) for name, one in plans.items()}


def node_figures(rms_map: RmsMap, true: RmsMap) -> dict[str, float]:
    """Return how the true RMS lies to a map, over its damaged nodes: its error, the stated one, and the coverage."""
    own, spread, truth = (a[0, 0, 1:, 1:] for a in (rms_map.rms, rms_map.rms_rig_std, true.rms))
    error = np.log(truth / own)
    stated = np.sqrt(np.log1p((spread / own) ** 2))
    return {
        "error": float(np.sqrt(np.mean(error**2))),
        "common": float(np.mean(error)),
        "stated": float(np.sqrt(np.mean(stated**2))),
        "within": float(np.mean(np.abs(error) <= 1.2816 * stated)),
    }


def lives_of(rig: Rig, seed: int, count: int) -> list[LifeHistory]:
    """Return lives of one machine."""
    population = Population(
        rig=rig, rig_spread=(), load=(4000.0, 4000.0), speed=(40.0, 40.0), interval=900.0, seed=1000 + seed
    )
    return list(simulate_lives(population, range(count)))


def volume_rows(case: str, features: str, name: str, tracked: list[Tracked]) -> Row:
    """Return error, coverage and width of V_eq over all moments of all lives."""
    true, v_eq, lower, upper = (
        np.concatenate([getattr(one, key).ravel() for one in tracked]) for key in ("true", "v_eq", "lower", "upper")
    )
    known = np.isfinite(v_eq)
    error = np.log(v_eq[known] / true[known])
    return {
        "case": case,
        "features": features,
        "spread": name,
        "moments": true.size,
        "no answer": int(np.count_nonzero(~known)),
        "coverage": float(np.mean((lower[known] <= true[known]) & (true[known] <= upper[known]))),
        "rms_ln": float(np.sqrt(np.mean(error**2))),
        "bias_ln": float(np.mean(error)),
        "width_ln": float(np.median(np.log(upper[known] / lower[known]))),
    }


def node_row(case: str, name: str, figures: list[dict[str, float]]) -> Row:
    """Return the figures of the nodes over all machines: errors as root mean squares."""
    rms = {key: float(np.sqrt(np.mean([one[key] ** 2 for one in figures]))) for key in ("error", "common", "stated")}
    worst = float(np.min([one["within"] for one in figures]))
    return {
        "case": case,
        "spread": name,
        "machines": len(figures),
        **rms,
        "within": float(np.mean([one["within"] for one in figures])),
        "worst": worst,
    }


def main() -> None:
    """Run the benchmark."""
    options = arguments(__doc__ or "")
    machines, lives, draws = (1, 2, 4) if options.quick else (8, 6, 16)
    plan = replace(PLAN, h_d=PLAN.h_d[::2], dphi_d=PLAN.dphi_d[::2]) if options.quick else PLAN
    details: list[dict[str, Any]] = []
    nodes: dict[tuple[str, str], list[dict[str, float]]] = {}
    volumes: dict[tuple[str, str, str], list[Tracked]] = {}
    tables: dict[str, list[Row]] = {}
    for seed in range(machines):
        truth = hidden_rig(seed)
        rig = Space(Rig(), BEARING, (LOAD,), free=FREE).rig_of(truth)
        histories = lives_of(rig, seed, lives)
        for case in TESTS:
            began = time.process_time()
            found = identified(truth, case, seed, 1)
            seconds = time.process_time() - began
            maps = maps_of(found, rig, draws, plan)
            details.append(
                {
                    "machine": seed,
                    "case": case,
                    "truth": {name: truth[name] for name in FREE},
                    "best": {name: found.best.values[name] for name in FREE},
                    "intervals": {name: [i.low, i.high] for name, i in found.intervals.items()},
                    "undetermined": found.undetermined,
                    "effective": found.posterior.effective,
                    "candidates": found.posterior.candidates,
                    "evaluations": found.evaluations,
                    "cpu_s": seconds,
                }
            )
            for name, one in maps.items():
                if name != "true rig":
                    figures = node_figures(one, maps["true rig"])
                    nodes.setdefault((case, name), []).append(figures)
                    details[-1][name] = figures
                for features, lines in FEATURES.items():
                    settings = FilterSettings(one.part_radius, lines=lines, interval=LEVEL)
                    volumes.setdefault((case, features, name), []).append(follow(histories, slices_of(one), settings))
            print(details[-1], flush=True)
            tables["nodes"] = [node_row(*key, rows) for key, rows in sorted(nodes.items())]
            tables["volumes"] = [volume_rows(*key, rows) for key, rows in sorted(volumes.items())]
            # Written after each machine: a long run that is stopped leaves what it has.
            write_json(options.json, {**tables, "machines": details})
    for title, rows in tables.items():
        print_table(title, rows)


if __name__ == "__main__":
    main()
