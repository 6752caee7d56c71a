"""How V_eq and TT hold on lives that nobody simulated for them: other laws, other machines, other noise.

Run as ``python -m benchmarks.unseen.judge [--judged | --development] [--runs-per-law N] [--library FILE |
--library-runs N] [--json FILE] [--quick]``. The lives are those of ``unseen_lives`` with the laws of ``unseen_laws``;
the library is that of ``library build`` with its default settings over all loads and speeds, or that of a file. At 1/4,
1/2 and 3/4 of the time from the onset to the threshold each method is asked with the blocks up to then. Means are over
lives; a missing answer is scored as the constant guess. Tables:

1. all methods: CRPS of TT (of one number the absolute error), coverage and refusals of TT and V_eq, rms of ln V_eq;
   ``tt_open``: share of the intervals of TT without an upper end;
2. the library by law;
3. the floor and the goal that were asked for, and whether they are met.

Methods: the library with the RMS alone and with lines; the same forecaster given the true V_eq ("own bound"); on a part
of the lives the filter, alone and beside the library as in the daemon; climatology (lifetimes of other lives of the
library's population), the clock (the same weighted by what the elapsed time says, ``baselines.elapsed_alone``), "as
long again as it has lasted" (whose median is exact at 1/2 by the choice of the moments), and the constant.

``--judged`` takes the range of seeds that is scored once; without it, the lives are those on which choices are made
(``--development``), or for trying the code (``unseen_seeds``).
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.common import Row, print_table, write_json
from benchmarks.forecast.cases import LEVELS, Answers, Cases, Scores, means, no_volume, only_time, score
from benchmarks.unseen.ask import (
    FRACTIONS,
    Said,
    ask,
    independent_lifetimes,
    library_for,
    map_for,
    moments_of,
    settings_for,
)
from benchmarks.unseen.cache import lives_of
from benchmarks.unseen.laws import LAWS, Floats
from benchmarks.unseen.lives import UnseenLife
from benchmarks.unseen.seeds import seed_of
from monitor.health.size.library.model import Library
from monitor.report.score import baselines

RMS, LINES, BOUND = "library, rms", "library, rms and lines", "own bound: true V_eq"
CLIMATOLOGY, CLOCK, AGAIN, CONSTANT = "climatology", "clock", "as long again", "constant"
FILTERS = {"rms": "filter, rms", "rms+harmonics": "filter, rms and lines"}
ISSUED = {"rms": "library beside filter, rms", "rms+harmonics": "library beside filter, rms and lines"}
FEATURES = {RMS: "rms", LINES: "rms+harmonics", BOUND: "v_eq"}

FLOOR_COVERAGE, GOAL_COVERAGE = (0.75, 0.87), 0.65
FLOOR_V, GOAL_V = {RMS: 0.60, LINES: 0.25}, {RMS: 0.55, LINES: 0.22}
GOAL_BOUND = 1.3


@dataclass(frozen=True, eq=False)
class Scored:
    """Scores and statuses of all methods; those on a part of the lives have scores of it alone.

    Attributes:
        law: of each life, shape (lives,).
        scores: by method.
        said: statuses of the methods that have any.
    """

    law: NDArray[np.str_]
    scores: Mapping[str, Scores]
    said: Mapping[str, Said]

    def mean(self, name: str, figure: str, law: str | None = None) -> list[float]:
        """Return a figure of a method at each moment, over all lives or those of a law; NaN where there is none."""
        scores = self.scores[name]
        values = {
            "crps_min": scores.error / 60.0,
            "tt_inside": scores.tt_inside,
            "v_inside": scores.v_inside,
            "v_rms": np.square(scores.v_error),
            "refused": scores.refused,
        }[figure]
        chosen = None if law is None else self.law == law
        found = [one.mean for one in means(values, chosen)]
        return [math.sqrt(one) for one in found] if figure == "v_rms" else found


_FIGURES = ("crps_min", "tt_inside", "v_rms", "v_inside", "refused")


def naive(cases: Cases, lifetimes: Floats, v_eq: Floats) -> dict[str, Answers]:
    """Return the answers that know of nothing but the time gone.

    Args:
        cases: the moments.
        lifetimes: of other lives, s, shape (others,).
        v_eq: of them at the moments, m2.
    """
    moments, shape = cases.t.ravel(), cases.t.shape
    methods = {CLIMATOLOGY: baselines.climatology, CLOCK: baselines.elapsed_alone}
    found = {
        name: only_time(np.array([of(t, lifetimes).quantiles(LEVELS) for t in moments.tolist()]).reshape(*shape, -1))
        for name, of in methods.items()
    }
    found[AGAIN] = only_time(baselines.doubling(moments, LEVELS).reshape(*shape, -1))
    _, lower, upper = no_volume(shape)
    guess = baselines.constant(cases.t, lifetimes)[..., None]
    return found | {CONSTANT: Answers(np.full(shape, np.median(v_eq)), lower, upper, guess)}


def score_all(
    lives: Sequence[UnseenLife], library: Library, *, filtered: Sequence[UnseenLife], coarse: bool = True
) -> Scored:
    """Return the scores of all methods.

    Args:
        lives: the lives.
        library: that is judged.
        filtered: lives of the filter, some of them.
        coarse: whether its map is.
    """
    cases = moments_of(lives)
    others = independent_lifetimes(library, 2000)
    answers = naive(cases, *others)
    said = {name: ask(lives, cases, settings_for(library, features)) for name, features in FEATURES.items()}
    answers |= {name: one.answers for name, one in said.items()}
    scores = {name: score(cases, one, answers[CONSTANT]) for name, one in answers.items()}
    scores |= {name: as_issued(scores[name], cases, one) for name, one in said.items()}
    few = moments_of(filtered)
    guess = naive(few, *others)[CONSTANT]
    rms_map = map_for(coarse=coarse) if filtered else None
    for features, name in FILTERS.items() if filtered else ():
        said[name] = ask(filtered, few, settings_for(None, features, "filter", rms_map))
        scores[name] = score(few, said[name].answers, guess)
    for features, name in ISSUED.items() if filtered else ():
        said[name] = ask(filtered, few, settings_for(library, features, "library", rms_map))
        scores[name] = as_issued(score(few, said[name].answers, guess), few, said[name])
    return Scored(cases.law, scores, said)


def as_issued(scores: Scores, cases: Cases, said: Said) -> Scores:
    """Return scores with the coverage of the bounds of TT that were issued, of which the upper may be infinite."""
    inside = ((cases.tt >= said.lower) & (cases.tt <= said.upper)).astype(float)
    return replace(scores, tt_inside=np.where(np.isnan(said.lower) | np.isnan(said.upper), np.nan, inside))


def method_rows(scored: Scored) -> list[Row]:
    """Return the figures of all methods at each moment."""
    rows: list[Row] = []
    for name, scores in scored.scores.items():
        columns = {figure: scored.mean(name, figure) for figure in _FIGURES}
        error = [one.standard_error for one in means(scores.error / 60.0)]
        for m, fraction in enumerate(FRACTIONS):
            row = {figure: _or_none(values[m]) for figure, values in columns.items()}
            extra = {"crps_se": _or_none(error[m]), "v_refused": _v_refused(scored, name, m)}
            extra["tt_open"] = float(np.mean(np.isinf(scored.said[name].upper[:, m]))) if name in scored.said else None
            rows.append({"method": name, "lives": scores.error.shape[0], "at": fraction, **row, **extra})
    return rows


def _v_refused(scored: Scored, name: str, moment: int) -> float | None:
    if name not in scored.said:
        return None
    return float(np.mean(~(scored.said[name].answers.v_eq[:, moment] > 0.0)))


def law_rows(scored: Scored) -> list[Row]:
    """Return the figures of the library by law."""
    rows: list[Row] = []
    for law in dict.fromkeys(scored.law.tolist()):
        for name in (RMS, LINES, BOUND):
            row: dict[str, float | str | None] = {"law": law, "method": name}
            for figure in _FIGURES:
                values = scored.mean(name, figure, law)
                row |= {f"{figure}_{at:g}": _or_none(value) for at, value in zip(FRACTIONS, values, strict=True)}
            rows.append(row)
    return rows


def status_rows(scored: Scored) -> list[Row]:
    """Return how often each status was given at the moments, as shares of the lives."""
    rows: list[Row] = []
    for name, said in scored.said.items():
        for quantity, statuses in (("V_eq", said.edv), ("TT", said.tt)):
            for status in np.unique(statuses):
                shares = np.mean(statuses == status, axis=0).tolist()
                at = {f"at_{fraction:g}": share for fraction, share in zip(FRACTIONS, shares, strict=True)}
                rows.append({"method": name, "of": quantity, "status": str(status), **at})
    return rows


def asked_rows(scored: Scored) -> list[Row]:
    """Return what was asked for, beside what was found."""
    rows: list[Row] = []

    def add(kind: str, what: str, asked: str, found: Sequence[float], *, met: Sequence[bool]) -> None:
        at = {f"at_{fraction:g}": value for fraction, value in zip(FRACTIONS, found, strict=True)}
        rows.append({"kind": kind, "what": what, "asked": asked, **at, "met": "pass" if all(met) else "MISS"})

    climatology, clock = scored.mean(CLIMATOLOGY, "crps_min"), scored.mean(CLOCK, "crps_min")
    low, high = FLOOR_COVERAGE
    for name in (RMS, LINES):
        for quantity, figure in (("TT", "tt_inside"), ("V_eq", "v_inside")):
            found = scored.mean(name, figure)
            met = [low <= value <= high for value in found]
            add("floor", f"coverage of {quantity}, {name}", f"{low:g} to {high:g}", found, met=met)
        ratio = _ratios(scored.mean(name, "crps_min"), climatology)
        met = [value <= 1.0 if name == RMS else value < 1.0 for value in ratio]
        add("floor", f"CRPS over climatology, {name}", "1", ratio, met=met)
        found = scored.mean(name, "v_rms")
        for kind, limit in (("floor", FLOOR_V[name]), ("goal", GOAL_V[name])):
            add(kind, f"rms of ln V_eq, {name}", f"{limit:g}", found, met=[value <= limit for value in found])
    lines = scored.mean(LINES, "crps_min")
    for what, limit, others in (("own bound", GOAL_BOUND, scored.mean(BOUND, "crps_min")), ("clock", 1.0, clock)):
        ratio = _ratios(lines, others)
        add("goal", f"CRPS over {what}, {LINES}", f"{limit:g}", ratio, met=[value <= limit for value in ratio])
    for name in (RMS, LINES):
        for law in dict.fromkeys(scored.law.tolist()):
            found = scored.mean(name, "tt_inside", law)
            met = [value >= GOAL_COVERAGE for value in found]
            add("goal", f"coverage of TT, {law}, {name}", f"{GOAL_COVERAGE:g}", found, met=met)
    return rows


def _ratios(values: Sequence[float], others: Sequence[float]) -> list[float]:
    return [value / other for value, other in zip(values, others, strict=True)]


def _or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None


def main() -> None:
    """Score, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the same figures to this file")
    parser.add_argument("--quick", action="store_true", help="three lives a law: shows that all works")
    parser.add_argument("--judged", action="store_true", help="the lives of the judged score")
    parser.add_argument("--development", action="store_true", help="lives on which choices are made")
    parser.add_argument("--runs-per-law", type=int, default=100, metavar="N")
    parser.add_argument("--filter-runs-per-law", type=int, default=10, metavar="N")
    parser.add_argument("--library", type=Path, metavar="FILE")
    parser.add_argument("--library-runs", type=int, default=1000, metavar="N", help="of the library that is built")
    options = parser.parse_args()
    first_seed = seed_of(judged=options.judged, development=options.development)
    count = 3 if options.quick else options.runs_per_law
    few = min(1 if options.quick else options.filter_runs_per_law, count)
    lives = {law: lives_of(law, count, first_seed) for law in LAWS}
    library = library_for(options.library, 60 if options.quick else options.library_runs)
    every = [life for of_law in lives.values() for life in of_law]
    some = [life for of_law in lives.values() for life in of_law[:few]]
    scored = score_all(every, library, filtered=some)
    tables = {
        "methods": method_rows(scored),
        "laws": law_rows(scored),
        "statuses": status_rows(scored),
        "asked": asked_rows(scored),
    }
    for title, rows in tables.items():
        print_table(title, rows)
    made = {"seeds": first_seed, "runs_per_law": count, "library": library.hash, "prior": library.prior}
    write_json(options.json, {**tables, "made": made})


if __name__ == "__main__":
    main()
