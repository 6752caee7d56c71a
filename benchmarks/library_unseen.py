"""The library on growth laws that it does not hold, on damage that stands still, and what mixed-in lifetimes are worth.

Run as ``python -m benchmarks.library_unseen [--quick] [--json FILE]``. Lives are those of the library population of
``benchmarks.forecast_population``. Tables:

1. each law left out of the library in turn, scored on the lives of that law at 1/4, 1/2 and 3/4 of the time to the
   threshold: CRPS over that of climatology and over that of the elapsed time alone, coverage, by the share of plain
   lifetimes in the sample of TT;
2. the same by law, with the share that is used;
3. the probability of no growth out of fold: how many of the moments with each probability stood still, and how often it
   is one half or more on growing lives of each law.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from benchmarks.common import Row, arguments, print_table, write_json
from benchmarks.forecast_cases import LEVELS, Answers, Cases, cases_of, crps
from benchmarks.forecast_library import ask, fitted, without_law
from benchmarks.forecast_lives import cached_lives
from benchmarks.forecast_naive import lifetimes, of_elapsed_time
from benchmarks.forecast_population import FRACTIONS, LIBRARY, LIBRARY_RUNS, THRESHOLD
from models.lives.laws import LAWS
from models.lives.life import LifeHistory
from monitor.health.size.library.fit import POOL
from monitor.health.size.library.model import FeatureFit, Library

STANDSTILL = "standstill"
FEATURES = ("rms", "rms+harmonics", "v_eq")
POOLS = (0.0, 0.05, 0.1, 0.2, 0.3)
MAX_LIVES = 60
"""Lives of one law that are scored."""
PROBABILITIES = (0.0, 0.02, 0.1, 0.3, 0.5, 0.7, 0.9, 1.0)


def with_pool(library: Library, features: str, share: float) -> Library:
    """Return a library that mixes another share of lifetimes into its samples."""
    fit = library.fit_for(features)
    return replace(library, fits={features: replace(fit, pool=np.full_like(fit.pool, share))})


def row_of(answers: Answers, cases: Cases, naive: dict[str, Answers], m: int) -> Row:
    """Return the scores of answers at a moment; CRPS as a sum over cases, s."""
    lower, upper = answers.tt[:, m, LEVELS.tolist().index(0.1)], answers.tt[:, m, LEVELS.tolist().index(0.9)]
    known = np.asarray(np.isfinite(answers.tt[:, m]).all(axis=1))
    truth = cases.tt[known, m]
    error = np.log(answers.v_eq[known, m] / cases.v_eq[known, m])
    inside_v = (answers.v_lower[known, m] <= cases.v_eq[known, m]) & (cases.v_eq[known, m] <= answers.v_upper[known, m])
    row: Row = {
        "n": int(known.sum()),
        "asked": len(known),
        "crps_s": float(crps(answers.tt[known][:, [m]], cases.tt[known][:, [m]]).sum()),
        "covered": int(np.count_nonzero((lower[known] <= truth) & (truth <= upper[known]))),
        "v_covered": int(np.count_nonzero(inside_v)),
        "v_squares": float(np.square(error).sum()),
    }
    for name, answer in naive.items():
        row[name] = float(crps(answer.tt[known][:, [m]], cases.tt[known][:, [m]]).sum())
    return row


def unseen(lives: Sequence[LifeHistory], laws: Sequence[str]) -> list[Row]:
    """Return the sums of scores by law left out, features, share of lifetimes and moment."""
    rows: list[Row] = []
    for law in laws:
        rest = without_law(lives, law)
        library = fitted(rest)
        runs = [life for life in lives if life.law == law and math.isfinite(life.crossing(THRESHOLD))][:MAX_LIVES]
        cases = cases_of(runs)
        naive = dict(of_elapsed_time(cases, rest))
        for features in FEATURES:
            for share in POOLS:
                answers = ask(with_pool(library, features, share), cases, features)
                for m, fraction in enumerate(FRACTIONS):
                    row = row_of(answers, cases, naive, m)
                    rows.append({"law": law, "features": features, "pool": share, "at": fraction, **row})
    return rows


def summed(rows: Sequence[Row], keys: Sequence[str]) -> list[Row]:
    """Return ratios and shares of the sums of rows that are equal in some keys."""
    groups: dict[tuple[object, ...], list[Row]] = {}
    for row in rows:
        groups.setdefault(tuple(row[key] for key in keys), []).append(row)
    found: list[Row] = []
    for values, group in groups.items():
        total = {
            name: float(sum(float(row[name] or 0.0) for row in group))
            for name in ("n", "crps_s", "covered", "v_covered", "v_squares", "climatology", "elapsed time alone")
        }
        found.append(
            {
                **dict(zip(keys, values, strict=True)),  # pyright: ignore[reportArgumentType]
                "lives": int(total["n"]),
                "crps_over_climatology": total["crps_s"] / total["climatology"],
                "crps_over_elapsed": total["crps_s"] / total["elapsed time alone"],
                "tt_coverage": total["covered"] / total["n"],
                "v_coverage": total["v_covered"] / total["n"],
                "v_rms_ln": math.sqrt(total["v_squares"] / total["n"]),
            }
        )
    return found


def no_growth(lives: Sequence[LifeHistory], fit: FeatureFit) -> tuple[list[Row], list[Row]]:
    """Return how many moments with each probability of no growth stood still, and its excess of one half by law."""
    found = [fit.p_no_growth(float(s), 300, int(n)) for s, n in zip(fit.said[:, -1], fit.life, strict=True)]
    p, stood = np.array(found), fit.standing
    rows: list[Row] = []
    for low, high in zip(PROBABILITIES, (*PROBABILITIES[1:-1], 1.01), strict=False):
        within = (p >= low) & (p < high)
        rows.append(
            {
                "features": fit.features,
                "from": low,
                "moments": int(within.sum()),
                "mean_p": float(p[within].mean()) if within.any() else None,
                "stood_still": float(stood[within].mean()) if within.any() else None,
            }
        )
    law = np.array([life.law for life in lives])[fit.life]
    by_law: list[Row] = [
        {
            "features": fit.features,
            "law": name,
            "moments": int(np.count_nonzero(growing)),
            "p_from_a_tenth": float(np.mean(p[growing] > 0.1)),
            "p_from_one_half": float(np.mean(p[growing] >= 0.5)),
        }
        for name in LAWS
        if (growing := (law == name) & ~stood).any()
    ]
    return rows, by_law


def main() -> None:
    """Print the tables and write them."""
    options = arguments(__doc__ or "")
    lives = cached_lives(LIBRARY, 100 if options.quick else LIBRARY_RUNS)
    laws = [law for law in LAWS if law != STANDSTILL][: 2 if options.quick else None]
    rows = unseen(lives, laws)
    tables: dict[str, list[Row]] = {"by_pool": summed(rows, ("features", "pool", "at"))}
    print_table("laws left out of the library, by share of lifetimes in the sample", tables["by_pool"])
    used = [row for row in rows if row["pool"] == POOL[str(row["features"])]]
    tables["by_law"] = summed(used, ("law", "features", "at"))
    print_table("laws left out of the library, by law", tables["by_law"])
    library = fitted(lives)
    tables["no_growth"], tables["no_growth_by_law"] = [], []
    for features in FEATURES:
        by_p, by_law = no_growth(lives, library.fit_for(features))
        tables["no_growth"] += by_p
        tables["no_growth_by_law"] += by_law
    print_table("probability of no growth", tables["no_growth"])
    print_table("probability of no growth on growing lives", tables["no_growth_by_law"])
    tables["runs"] = [{"lives": len(lives), "laws": len(laws), "lifetimes": len(lifetimes(lives))}]
    write_json(options.json, tables)


if __name__ == "__main__":
    main()
