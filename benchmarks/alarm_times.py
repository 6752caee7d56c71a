"""The time to the alarm level by trend, on eleven runs to failure and on simulated levels, beside other rules.

Run as ``python -m benchmarks.alarm_times [--quick] [--json FILE]``. Tables:

1. recorded runs (``femto_histories``, both axes), levels of 2, 3 and 4 times the baseline, at 1/4, 1/2, 3/4 of the time
   from the onset (as the detector dates it) to the first sustained crossing, and at five moments drawn uniformly: CRPS
   over that time, and how often the 80 % interval holds the crossing. Means over runs. All moments are scored, also
   those at which the stage says that there is no trend;
2. the same at moments where the stage answers, and how often it does not;
3. levels that were never reached: how often there is no trend, how often the interval is open at the end of the
   record, and the probability that was given to a crossing before it;
4. constants fitted on ten runs and scored on the eleventh, beside those of the program, which were set on all eleven;
5. simulated levels of five families, with seeds that no shape and no constant was set on.

The prior of the Bayesian exponential is fitted on the other runs. Without the recordings (``SPALLWATCH_DATA``) tables 1
to 4 are left out.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from benchmarks.alarm_time_cases import FAMILIES, Case, cases_of, recorded, simulated
from benchmarks.alarm_time_rules import (
    GRID,
    Exponential,
    Floats,
    by_run,
    covers,
    crps_share,
    doubling,
    exponential,
    line,
    trend,
)
from benchmarks.common import Row, arguments, interleaved_ms, print_table, write_json
from monitor.health.alarms import AlarmSettings
from monitor.health.rest.trend import TrendInput, TtaStatus, step
from monitor.health.rest.trend.growth import PRIOR
from tests.conftest import recordings_folder

SIMULATED_SEED = 20271130
"""Of table 5, one more for each family: drawn once, after all shapes and constants were set on other seeds."""
NAMES = ("trend", "doubling", "line", "exponential", "Bayesian exponential")
POINTS = ("line", "exponential")
ANSWERS = (TtaStatus.OK, TtaStatus.BEYOND_HORIZON)


Probabilities = dict[str, list[Floats]]


def probabilities(cases: Sequence[Case]) -> Probabilities:
    """Return the probabilities of each rule for all cases; the prior of the Bayesian one is of the other runs."""
    priors: dict[str, Exponential] = {}
    found: Probabilities = {name: [] for name in NAMES}
    for case in cases:
        run = case.history.run
        if run not in priors:
            priors[run] = Exponential.fit([other for other in cases if other.history.run != run])
        for name, method in zip(NAMES, (trend, doubling, line, exponential, priors[run]), strict=True):
            found[name].append(method(case))
    return found


def rows_of(cases: Sequence[Case], found: Probabilities, keep: Sequence[bool], label: dict[str, str]) -> list[Row]:
    """Return one row for each rule: CRPS over life and coverage, of the cases that are kept."""
    places = [place for place, kept in enumerate(keep) if kept]
    chosen = [cases[place] for place in places]
    rows: list[Row] = []
    for name in NAMES:
        reached = [found[name][place] for place in places]
        pairs = list(zip(chosen, reached, strict=True))
        rows.append(
            {
                **label,
                "rule": name,
                "crps": by_run(chosen, [crps_share(case, one) for case, one in pairs]),
                "coverage": None
                if name in POINTS
                else by_run(chosen, [float(covers(case, one)) for case, one in pairs]),
                "runs": len({case.history.run for case in chosen}),
                "cases": len(chosen),
            }
        )
    return rows


def answered(case: Case) -> bool:
    """Return whether the stage answers; else it says that there is no trend."""
    return case.history.answer(case.place, case.factor).status in ANSWERS


def recorded_tables(cases: Sequence[Case]) -> dict[str, list[Row]]:
    """Tables 1 to 3."""
    found = probabilities(cases)
    told = [answered(case) for case in cases]
    closed = [not case.open for case in cases]
    moments, answers = list[Row](), list[Row]()
    for share in ("1/4", "1/2", "3/4", "uniform"):
        keep = [case.share == share and done for case, done in zip(cases, closed, strict=True)]
        moments += rows_of(cases, found, keep, {"moment": share})
    for factor in (2.0, 3.0, 4.0):
        keep = [case.factor == factor and done for case, done in zip(cases, closed, strict=True)]
        moments += rows_of(cases, found, keep, {"moment": f"all, level {factor:g}"})
    moments += rows_of(cases, found, closed, {"moment": "all"})
    for label, keep in (
        ("answered", [here and done for here, done in zip(told, closed, strict=True)]),
        ("no trend", [not here and done for here, done in zip(told, closed, strict=True)]),
    ):
        answers += rows_of(cases, found, keep, {"stage": label})
    return {"moments": moments, "answers": answers, "open": never_reached(cases, found, told)}


def never_reached(cases: Sequence[Case], found: Probabilities, told: Sequence[bool]) -> list[Row]:
    """Table 3."""
    rows: list[Row] = []
    places = [place for place, case in enumerate(cases) if case.open]
    chosen = [cases[place] for place in places]
    for name in NAMES:
        given = [float(np.interp(cases[p].left / cases[p].elapsed, GRID, found[name][p])) for p in places]
        beyond = [float(covers(cases[p], found[name][p])) for p in places]
        rows.append(
            {
                "rule": name,
                "no trend": by_run(chosen, [float(not told[p]) for p in places]) if name == "trend" else None,
                "interval beyond the record": None if name in POINTS else by_run(chosen, beyond),
                "probability given": by_run(chosen, given),
                "runs": len({case.history.run for case in chosen}),
                "cases": len(chosen),
            }
        )
    return rows


def fitted(cases: Sequence[Case]) -> list[Row]:
    """Table 4: constants chosen by the CRPS of the other runs, out of a small grid."""
    closed = [case for case in cases if not case.open]
    grid = [
        replace(PRIOR, rate=rate, rate_sd=rate_sd, walk=walk, trust=trust)
        for rate, rate_sd, walk, trust in itertools.product(
            (0.0, 0.2, 0.4), (0.5, 1.0, 2.0), (0.1, 0.2, 0.4), (0.5, 1.0)
        )
    ]
    steps = (0.5, 1.0, 2.0)
    scores = {
        (prior, ahead): [crps_share(case, trend(case, replace(prior, step=ahead))) for case in closed]
        for prior in grid
        for ahead in steps
    }
    runs = sorted({case.history.run for case in closed})

    def mean(values: Sequence[float], keep: Sequence[bool]) -> float:
        return (
            by_run(
                [c for c, k in zip(closed, keep, strict=True) if k], [v for v, k in zip(values, keep, strict=True) if k]
            )
            or 0.0
        )

    rows: list[Row] = []
    chosen_all: list[float] = []
    held: list[float] = []
    for run in runs:
        mine = [case.history.run == run for case in closed]
        best = min(scores, key=lambda one: mean(scores[one], [not here for here in mine]))
        chosen_all.append(mean(scores[best], mine))
        prior = replace(best[0], step=best[1])
        here = [case for case in closed if case.history.run == run]
        held.append(float(np.mean([covers(case, trend(case, prior)) for case in here])))
    everything = [True] * len(closed)
    default = [crps_share(case, trend(case)) for case in closed]
    cover = by_run(closed, [float(covers(case, trend(case))) for case in closed])
    rows.append({"constants": "of the program", "crps": mean(default, everything), "coverage": cover})
    rows.append(
        {"constants": "fitted on the other runs", "crps": float(np.mean(chosen_all)), "coverage": float(np.mean(held))}
    )
    ranked = sorted(mean(values, everything) for values in scores.values())
    rows.append({"constants": "best of the grid, in sample", "crps": ranked[0], "coverage": None})
    rows.append({"constants": "worst of the grid, in sample", "crps": ranked[-1], "coverage": None})
    return rows


def simulated_tables(count: int) -> list[Row]:
    """Table 5."""
    rows: list[Row] = []
    for place, family in enumerate(FAMILIES):
        cases = cases_of(simulated(family, count, SIMULATED_SEED + place), (3.0,))
        found = probabilities(cases)
        told = [answered(case) for case in cases]
        closed = [not case.open for case in cases]
        withheld = float(np.mean([not one for one in told]))
        if any(closed):
            rows += [{**row, "no trend": withheld} for row in rows_of(cases, found, closed, {"family": family})]
        for row in never_reached(cases, found, told) if not all(closed) else ():
            if row["rule"] in ("trend", "doubling"):
                label = {"family": f"{family}, never reached", "rule": row["rule"], "crps": None}
                rows.append(
                    {
                        **label,
                        "coverage": row["interval beyond the record"],
                        "runs": row["runs"],
                        "cases": row["cases"],
                        "no trend": row["no trend"],
                    }
                )
    return rows


def cost(rounds: int) -> Row:
    """Return the thread time of one block, ms, with a full history."""
    history = simulated("power", 1, SIMULATED_SEED)[0]
    place = len(history.time) - 1
    block = TrendInput(place + 1, float(history.time[place]), 1.5, baseline=(0.0, 0.05), elevated=True, final=True)
    state = history.states[place - 1]
    return interleaved_ms({"block, ms": lambda: step(state, block, AlarmSettings())}, rounds)


def main() -> None:
    """Run, print, write."""
    options = arguments("The time to the alarm level by trend, on recorded and simulated levels.")
    tables: dict[str, Sequence[Row] | Row] = {}
    if recordings_folder().is_dir():
        cases = cases_of(recorded(recordings_folder()))
        found = recorded_tables(cases)
        print_table("1. Recorded runs, all moments", found["moments"])
        print_table(
            "2. Recorded runs, where the stage answers and where it says that there is no trend", found["answers"]
        )
        print_table("3. Levels that were never reached", found["open"])
        tables |= found
        if not options.quick:
            tables["constants"] = fitted(cases)
            print_table("4. Constants", tables["constants"])
    else:
        print("no recordings: SPALLWATCH_DATA names no folder")
    tables["simulated"] = simulated_tables(8 if options.quick else 60)
    print_table("5. Simulated levels", tables["simulated"])
    tables["cost"] = cost(50 if options.quick else 500)
    print_table("Cost of a block", [tables["cost"]])
    write_json(options.json, tables)


if __name__ == "__main__":
    main()
