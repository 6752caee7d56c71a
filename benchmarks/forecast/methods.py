"""How good the trackers and forecasts are on simulated lives that nothing was fitted on: all methods, one set of cases.

Run as ``python -m benchmarks.forecast.methods [--quick] [--json FILE]``. The lives are those of
``forecast_population``: test runs with loads, speeds, growth laws, gains, floors, rig parameters, slip and missing
blocks of their own, and a library that forecasters are fitted on. At 1/4, 1/2 and 3/4 of the time from the onset to the
threshold every method is asked with the blocks up to then; a missing answer is scored as the constant guess. Means are
over runs. Tables:

1. every method: CRPS of TT (of a single number the absolute error, at most 1500 min), coverage and width of the 80 %
   intervals, rms error of ln V_eq, refusals;
2. the figures that are asked for, beside what was found;
3. the forecasters by growth law, 4. by speed, 5. how far they are from the bound that is reached where the true V_eq is
   known, 6. with each law left out of the library;
7. every block of some runs before the threshold: scores, refusals, and thread time of a block;
8. the thesis' method on maps of each run's very load and speed, on some runs: what reading between nodes costs it.

``--quick`` takes few runs and a coarse map: it shows that all works, its figures mean little. The full run simulates
1600 lives (about six minutes on one core) and maps (five) and keeps them in the user's cache folder.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from benchmarks.common import Row, arguments, print_table, write_json
from benchmarks.forecast.cases import Answers, Cases, Floats, Scores, cases_of, means, score
from benchmarks.forecast.filter import floors_map, track
from benchmarks.forecast.library import ask, fitted, without_law
from benchmarks.forecast.lives import cached_lives
from benchmarks.forecast.naive import constant, of_elapsed_time, of_tracked_volume, of_true_volume
from benchmarks.forecast.population import FRACTIONS, LIBRARY, LIBRARY_RUNS, TEST, TEST_RUNS
from benchmarks.forecast.thesis import exact_maps, map_plan, on_map, rough_map, thesis
from models.lives.laws import LAWS
from models.lives.life import LifeHistory
from models.maps.file import cached_map

THESIS = "thesis, smooth map"
CLIMATOLOGY = "climatology"
BOUND = "bound: true V_eq known"
LIBRARIES = {"rms": "library, rms", "rms+harmonics": "library, rms and harmonics"}
COVERAGE = (0.75, 0.87)
FILTERS = {"rms": "filter, rms", "rms+harmonics": "filter, rms and harmonics"}
ON_FLOORS = {features: f"{name}, mean over floors" for features, name in FILTERS.items()}
V_ERROR = {"rms": 0.6, "rms+harmonics": 0.3}
OVER_THESIS = {"rms": 0.40, "rms+harmonics": 0.33}
OVER_CLIMATOLOGY = {"rms": (0.95, 0.95, 0.75), "rms+harmonics": (0.80, 0.75, 0.55)}
REFUSED = 0.10
SPEEDS = (20.0, 28.0, 37.0, 45.0)
Chosen = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Scored:
    """All methods on one set of cases."""

    cases: Cases
    scores: Mapping[str, Scores]

    def time_error(self, name: str, moment: int, chosen: Chosen | None = None) -> float:
        """Return the mean CRPS of a method at a moment, s."""
        return means(self.scores[name].error, chosen)[moment].mean

    def ratio(self, name: str, other: str, moment: int, chosen: Chosen | None = None) -> float:
        """Return the mean CRPS of a method over that of another."""
        return self.time_error(name, moment, chosen) / self.time_error(other, moment, chosen)

    def v_error(self, name: str, moment: int, chosen: Chosen | None = None) -> float:
        """Return the rms error of ln V_eq at a moment."""
        return math.sqrt(means(np.square(self.scores[name].v_error), chosen)[moment].mean)

    def coverage(self, name: str, quantity: str, moment: int, chosen: Chosen | None = None) -> float:
        """Return the coverage of the intervals of "V_eq" or "TT"."""
        inside = self.scores[name].v_inside if quantity == "V_eq" else self.scores[name].tt_inside
        return means(inside, chosen)[moment].mean


def method_rows(scored: Scored) -> list[Row]:
    """Return the table of all methods."""
    rows: list[Row] = []
    for name, scores in scored.scores.items():
        columns = {
            "crps_min": means(scores.error / 60.0),
            "tt_coverage": means(scores.tt_inside),
            "tt_width_min": means(scores.tt_width / 60.0),
            "v_coverage": means(scores.v_inside),
            "v_width_ln": means(scores.v_width),
            "refused": means(scores.refused),
        }
        for m, fraction in enumerate(FRACTIONS):
            row: dict[str, float | int | str | None] = {"method": name, "at": fraction}
            for column, found in columns.items():
                row[column] = _or_none(found[m].mean)
            row["crps_se_min"] = _or_none(columns["crps_min"][m].standard_error)
            row["coverage_se"] = _or_none(columns["tt_coverage"][m].standard_error)
            row["v_rms_ln"] = _or_none(scored.v_error(name, m))
            rows.append(row)
    return rows


def _or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None


def target_rows(scored: Scored) -> list[Row]:
    """Return what was asked for beside what was found, for both sets of features."""
    rows: list[Row] = []

    def add(figure: str, name: str, m: int, found: float, low: float, high: float) -> None:
        met = "yes" if low <= found <= high else "no"
        asked = f"{low:g} to {high:g}" if low > 0.0 and math.isfinite(high) else f"<= {high:g}"
        rows.append({"figure": figure, "method": name, "at": FRACTIONS[m], "found": found, "asked": asked, "met": met})

    for features in V_ERROR:
        for m in range(len(FRACTIONS)):
            for name in (LIBRARIES[features], FILTERS[features]):
                add("coverage of V_eq", name, m, scored.coverage(name, "V_eq", m), *COVERAGE)
                add("rms error of ln V_eq", name, m, scored.v_error(name, m), 0.0, V_ERROR[features])
            name = LIBRARIES[features]
            add("coverage of TT", name, m, scored.coverage(name, "TT", m), *COVERAGE)
            add("CRPS over thesis", name, m, scored.ratio(name, THESIS, m), 0.0, OVER_THESIS[features])
            over = OVER_CLIMATOLOGY[features][m]
            add("CRPS over climatology", name, m, scored.ratio(name, CLIMATOLOGY, m), 0.0, over)
            for name in (LIBRARIES[features], FILTERS[features]):
                add("refused", name, m, means(scored.scores[name].refused)[m].mean, 0.0, REFUSED)
    return rows


def group_rows(scored: Scored, names: Sequence[str], label: str, groups: Mapping[str, Chosen]) -> list[Row]:
    """Return the figures of methods by groups of runs."""
    rows: list[Row] = []
    for group, chosen in groups.items():
        for name in names:
            for m, fraction in enumerate(FRACTIONS):
                rows.append(
                    {
                        label: group,
                        "runs": int(chosen.sum()),
                        "method": name,
                        "at": fraction,
                        "crps_min": _or_none(scored.time_error(name, m, chosen) / 60.0),
                        "over_climatology": _or_none(scored.ratio(name, CLIMATOLOGY, m, chosen)),
                        "tt_coverage": _or_none(scored.coverage(name, "TT", m, chosen)),
                        "v_rms_ln": _or_none(scored.v_error(name, m, chosen)),
                        "v_coverage": _or_none(scored.coverage(name, "V_eq", m, chosen)),
                    }
                )
    return rows


def unseen_rows(scored: Scored, library: Sequence[LifeHistory], guess: Answers, laws: Sequence[str]) -> list[Row]:
    """Return the figures of each law's test runs by a library without that law."""
    rows: list[Row] = []
    for law in laws:
        chosen = scored.cases.law == law
        cases = cases_of([life for life in scored.cases.runs if life.law == law])
        part = Answers(guess.v_eq[chosen], guess.v_lower[chosen], guess.v_upper[chosen], guess.tt[chosen])
        without = fitted(without_law(library, law))
        found = {name: score(cases, ask(without, cases, features), part) for features, name in LIBRARIES.items()}
        found[CLIMATOLOGY] = _chosen(scored.scores[CLIMATOLOGY], chosen)
        everyone = np.ones(len(cases.runs), dtype=bool)
        rows += group_rows(Scored(cases, found), list(LIBRARIES.values()), "law left out", {law: everyone})
    return rows


def _chosen(scores: Scores, chosen: Chosen) -> Scores:
    return Scores(**{name: value[chosen] for name, value in vars(scores).items()})


def bound_rows(scored: Scored) -> list[Row]:
    """Return how far the forecasters are from the one that knows the true V_eq."""
    return [
        {
            "method": name,
            "at": fraction,
            "crps_min": scored.time_error(name, m) / 60.0,
            "bound_min": scored.time_error(BOUND, m) / 60.0,
            "over_bound": scored.ratio(name, BOUND, m),
            "gain_reached": _reached(scored, name, m),
        }
        for name in LIBRARIES.values()
        for m, fraction in enumerate(FRACTIONS)
    ]


def _reached(scored: Scored, name: str, m: int) -> float:
    """Return the share of the way from climatology to the bound."""
    start, end = scored.time_error(CLIMATOLOGY, m), scored.time_error(BOUND, m)
    return (start - scored.time_error(name, m)) / (start - end)


def exact_rows(cases: Cases, guess: Answers, on_nodes: Answers, runs: int) -> list[Row]:
    """Return the thesis' errors on maps between nodes and on maps of each run's own load and speed."""
    few = cases_of(cases.runs[:runs])
    part = Answers(guess.v_eq[:runs], guess.v_lower[:runs], guess.v_upper[:runs], guess.tt[:runs])
    between = Answers(on_nodes.v_eq[:runs], on_nodes.v_lower[:runs], on_nodes.v_upper[:runs], on_nodes.tt[:runs])
    found = {"between nodes": score(few, between, part), "own maps": score(few, thesis(few, exact_maps)[0], part)}
    scored = Scored(few, found)
    return [
        {
            "map": name,
            "runs": runs,
            "at": fraction,
            "error_min": scored.time_error(name, m) / 60.0,
            "v_rms_ln": scored.v_error(name, m),
        }
        for name in found
        for m, fraction in enumerate(FRACTIONS)
    ]


def between(values: Floats, edges: Sequence[float]) -> dict[str, Chosen]:
    """Return which values lie between neighbouring edges."""
    return {f"{low:g} to {high:g}": (values >= low) & (values <= high) for low, high in pairwise(edges)}


def main() -> None:
    """Run the tables and print them, and write them where asked."""
    options = arguments("All trackers and forecasts on simulated lives that nothing was fitted on.")
    quick = options.quick
    library = cached_lives(LIBRARY, 60 if quick else LIBRARY_RUNS)
    cases = cases_of(cached_lives(TEST, 15 if quick else TEST_RUNS))
    guess = constant(cases, library)
    smooth, floors = cached_map(map_plan(coarse=quick)), floors_map(coarse=quick)
    on_smooth, histories = thesis(cases, on_map(smooth))
    answers = {"constant": guess, **of_elapsed_time(cases, library), **of_tracked_volume(cases, histories)}
    answers[THESIS] = on_smooth
    if not quick:
        answers["thesis, map of a rough floor"] = thesis(cases, rough_map())[0]
    answers["thesis, true V_eq known"] = of_true_volume(cases)
    forecaster = fitted(library)
    answers |= {name: ask(forecaster, cases, features) for features, name in LIBRARIES.items()}
    answers[BOUND] = ask(forecaster, cases, "v_eq")
    answers |= {name: track(cases, features, smooth) for features, name in FILTERS.items()}
    answers |= {name: track(cases, features, floors) for features, name in ON_FLOORS.items()}
    scored = Scored(cases, {name: score(cases, answer, guess) for name, answer in answers.items()})
    names = [*LIBRARIES.values(), *FILTERS.values()]
    speed = np.array([life.speed[0] for life in cases.runs])
    laws = {law: cases.law == law for law in LAWS if np.any(cases.law == law)}
    tables: dict[str, Callable[[], list[Row]]] = {
        "runs": lambda: [{"test_runs": len(cases.runs), "library_runs": len(library), "quick": str(quick)}],
        "methods": lambda: method_rows(scored),
        "asked": lambda: target_rows(scored),
        "by_law": lambda: group_rows(scored, [*names, BOUND], "law", laws),
        "by_speed": lambda: group_rows(scored, names, "speed_hz", between(speed, SPEEDS)),
        "bound": lambda: bound_rows(scored),
        "unseen_law": lambda: unseen_rows(scored, library, guess, list(laws)[:1] if quick else list(laws)),
        "exact_maps": lambda: exact_rows(cases, guess, on_smooth, 2 if quick else 40),
    }
    figures: dict[str, list[Row]] = {}
    for title, table in tables.items():
        figures[title] = table()
        print_table(title, figures[title])
        sys.stdout.flush()
        write_json(options.json, figures)


if __name__ == "__main__":
    main()
