"""How well the catalogue of series knows the internal geometry of bearings: docs/evidence/catalogue.md.

python -m benchmarks.catalogue.bearings writes benchmarks/results/catalogue.json and renews the tables of the page.

1. Bearings whose internal geometry is known from elsewhere (benchmarks/catalogue_known.csv), against the entry of the
   series. They were looked at while the derivation was written, so they check it but are not held out.
2. Bearings of another maker, SKF, derived from its ratings (benchmarks/catalogue_skf.csv); nothing was fitted to them.
3. The rules of design, fitted to even bore codes, against the derived geometry of odd ones, which were held out.
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from benchmarks.catalogue.ratings import DERIVE
from models.machine.bearing import Bearing, CatalogueEntry, kinematics, kinematics_uncertainty, with_count
from models.machine.catalogue.designation import BALLS, ROLLERS, Family
from models.machine.catalogue.ratings import Internal, dynamic_rating, static_rating
from models.machine.catalogue.series import Estimate, Geometry, estimate, families, geometry, published_row, series_of

ROOT = Path(__file__).resolve().parents[2]

KNOWN = Path(__file__).with_name("known.csv")
SKF = Path(__file__).with_name("skf.csv")
RESULTS = ROOT / "benchmarks" / "results" / "catalogue.json"
PAGE = ROOT / "docs" / "evidence" / "catalogue.md"
RATES = ("bpfo", "bpfi", "ftf", "bsf")


def bearing_of(found: Geometry) -> Bearing:
    """Return the bearing of a series with its likeliest count."""
    return Bearing(
        designation=found.designation,
        n_elements=found.n_elements,
        element_diameter=found.element_diameter,
        pitch_diameter=found.pitch_diameter,
        contact_angle=found.contact_angle,
        rows=found.rows,
    )


def errors(truth: Bearing, found: Geometry) -> dict[str, Any]:
    """Return how far the entry of a series is from a bearing: count, rates, and stated uncertainty."""
    uncertainty = kinematics_uncertainty(CatalogueEntry(bearing_of(found), found.origins, found.counts))
    right = kinematics(truth, 1.0)
    likeliest, counted = (
        kinematics(bearing_of(found), 1.0),
        kinematics(with_count(bearing_of(found), truth.n_elements), 1.0),
    )
    return {
        "designation": found.designation,
        "n_elements": [truth.n_elements, found.n_elements],
        "stated_probability": found.counts[0][1],
        "probability": dict(found.counts).get(truth.n_elements, 0.0),
        "bpfo_factor": [right.bpfo, likeliest.bpfo],
        "bpfo_error": likeliest.bpfo / right.bpfo - 1.0,
        **{f"{rate}_error_counted": getattr(counted, rate) / getattr(right, rate) - 1.0 for rate in RATES},
        **{f"{rate}_stated": getattr(uncertainty, rate) for rate in RATES},
    }


def known_bearings() -> list[dict[str, Any]]:
    """Return the errors of the series for the bearings of known geometry."""
    lines = [line for line in KNOWN.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    found: list[dict[str, Any]] = []
    for row in csv.DictReader(lines):
        truth = Bearing(
            designation=row["designation"],
            n_elements=int(row["z"]),
            element_diameter=1e-3 * float(row["element"]),
            pitch_diameter=1e-3 * float(row["pitch"]),
            contact_angle=math.radians(float(row["angle"])),
        )
        found.append({**errors(truth, geometry(row["designation"])), "source": row["source"]})
    return found


def other_maker() -> list[dict[str, Any]]:
    """Return the errors of the series for the bearings whose geometry follows from the ratings of another maker."""
    text = SKF.read_text(encoding="utf-8").splitlines()
    found: list[dict[str, Any]] = []
    for row in csv.DictReader(line for line in text if not line.startswith("#")):
        family = cast("Family", row["family"])
        derived, series = DERIVE[family](row), geometry(row["designation"])
        size = derived["ball"] if family in BALLS else derived["roller"]
        truth = Bearing(
            designation=row["designation"],
            n_elements=int(derived["z"]),
            element_diameter=1e-3 * float(size),
            pitch_diameter=0.5e-3 * (float(row["bore"]) + float(row["outside"])),
            contact_angle=math.atan(float(row["e"]) / 1.5) if row["e"] else series.contact_angle,
        )
        found.append({**errors(truth, series), "source": "SKF, derived from its load ratings"})
    return found


def held_out() -> list[dict[str, Any]]:
    """Return the errors of the rules for the derived bearings of odd bore code."""
    return list(_rule_errors(odd=True))


def _rule_errors(*, odd: bool) -> Iterator[dict[str, Any]]:
    for designation, family in _rated():
        base = designation.removesuffix("E")
        if int(base[-2:]) % 2 != int(odd):
            continue
        derived = geometry(designation)
        bore, outside, width = (1e3 * value for value in (derived.bore, derived.outside, derived.width))
        series = series_of(base) + ("E" if designation.endswith("E") else "")
        ruled = _by_rule(derived, estimate(series, bore, outside, width))
        truth = bearing_of(derived)
        yield {**errors(truth, ruled), "series": series, "family": family}


def _rated() -> Iterator[tuple[str, Family]]:
    """Yield the designations whose geometry was derived from load ratings; NJ has that of NU."""
    for base, family in families().items():
        for designation in (base, f"{base}E") if family == "cylindrical" else (base,):
            if not base.startswith("NJ") and "derived" in geometry(designation).source:
                yield designation, family


def _by_rule(derived: Geometry, ruled: Estimate) -> Geometry:
    """Return the geometry that the rule gives in the place of the derived one; the angle is not the rule's."""
    origins = dict(derived.origins)
    origins["element_diameter"] = replace(origins["element_diameter"], spread=ruled.size_spread)
    return replace(
        derived,
        counts=ruled.counts,
        element_diameter=1e-3 * ruled.element_diameter,
        pitch_diameter=1e-3 * ruled.pitch_diameter,
        origins=origins,
    )


def summary(rows: Iterable[dict[str, Any]]) -> dict[str, Any]:
    """Return shares and percentiles of some errors."""
    rows = list(rows)
    bpfo = np.abs([row["bpfo_error"] for row in rows])
    counted = {rate: np.abs([row[f"{rate}_error_counted"] for row in rows]) for rate in RATES}
    return {
        "bearings": len(rows),
        "count_exact": float(np.mean([row["n_elements"][0] == row["n_elements"][1] for row in rows])),
        "count_exact_stated": float(np.mean([row["stated_probability"] for row in rows])),
        "count_listed": float(np.mean([row["probability"] > 0.0 for row in rows])),
        "bpfo_error": [float(np.percentile(bpfo, share)) for share in (68, 95)],
        "error_counted": {
            rate: [float(np.percentile(values, share)) for share in (68, 95)] for rate, values in counted.items()
        },
        "within_one_stated": {rate: _within(rows, rate, 1.0) for rate in RATES},
        "within_two_stated": {rate: _within(rows, rate, 2.0) for rate in RATES},
    }


def _within(rows: list[dict[str, Any]], rate: str, deviations: float) -> float:
    return float(np.mean([abs(row[f"{rate}_error_counted"]) <= deviations * row[f"{rate}_stated"] for row in rows]))


def ratings_reproduced() -> dict[str, list[float]]:
    """Return the 50th and 100th percentile of the relative difference of both ratings of the derived bearings."""
    static: list[float] = []
    dynamic: list[float] = []
    for designation, family in _rated():
        found, rated = geometry(designation), published_ratings(designation)
        inside = internal(found, family)
        static.append(abs(static_rating(inside) / rated[1] - 1.0))
        dynamic.append(abs(dynamic_rating(inside) / rated[0] - 1.0))
    return {
        "static": [float(np.percentile(static, share)) for share in (50, 100)],
        "dynamic": [float(np.percentile(dynamic, share)) for share in (50, 100)],
    }


def internal(found: Geometry, family: Family) -> Internal:
    """Return what the ratings depend on, mm; the ratings of angular contact bearings are those of 40 degrees."""
    angle = math.radians(40.0) if family == "angular_contact" else found.contact_angle
    return Internal(
        family,
        found.n_elements,
        1e3 * found.element_diameter,
        1e3 * found.pitch_diameter,
        found.rows,
        angle,
        1e3 * (found.effective_length or 0.0),
    )


def published_ratings(designation: str) -> tuple[float, float]:
    """Return the published basic dynamic and static load rating of a derived bearing, N."""
    row = published_row(designation)
    return 1e3 * float(row["dynamic"]), 1e3 * float(row["static"])


def percent(values: Iterable[float]) -> str:
    """Return shares as percentages, joined by a slash."""
    return " / ".join(f"{100.0 * value:.2g}" for value in values)


def tables(results: Mapping[str, Any]) -> dict[str, str]:
    """Return the tables of the page by name."""
    known = [
        "| bearing | elements, known and found | BPFO factor, known and found | error, % | with the right number, % | "
        "stated, % | source |",
        "|---|---|---|---|---|---|---|",
    ]
    known += [
        f"| {row['designation']} | {row['n_elements'][0]}, {row['n_elements'][1]} | "
        f"{row['bpfo_factor'][0]:.3f}, {row['bpfo_factor'][1]:.3f} | {100 * row['bpfo_error']:+.2f} | "
        f"{100 * row['bpfo_error_counted']:+.2f} | {100 * row['bpfo_stated']:.2f} | {row['source']} |"
        for row in (*results["known"], *results["other_maker"])
    ]
    head = (
        "| bearings | number | exact, % | stated, % | right one listed, % | BPFO error 68 / 95 %, % | "
        "with the right number: BPFO | BPFI | FTF | BSF | within one / two stated, %: BPFO | BSF |"
    )
    held = [head, "|---" * 12 + "|"]
    held += [_summary_line(name, found) for name, found in results["summaries"].items()]
    return {"known": "\n".join(known), "held-out": "\n".join(held)}


def _summary_line(name: str, found: Mapping[str, Any]) -> str:
    counted = " | ".join(percent(found["error_counted"][rate]) for rate in RATES)
    covered = " | ".join(
        f"{100 * found['within_one_stated'][rate]:.0f} / {100 * found['within_two_stated'][rate]:.0f}"
        for rate in ("bpfo", "bsf")
    )
    exact, stated = 100 * found["count_exact"], 100 * found["count_exact_stated"]
    return (
        f"| {name} | {found['bearings']} | {exact:.0f} | {stated:.0f} | "
        f"{100 * found['count_listed']:.0f} | {percent(found['bpfo_error'])} | {counted} | {covered} |"
    )


def renewed(page: str, made: Mapping[str, str]) -> str:
    """Return the page with its tables replaced; each stands between two comments that name it."""
    for name, table in made.items():
        before, rest = page.split(f"<!-- {name} -->\n", 1)
        after = rest.split(f"<!-- end of {name} -->", 1)[1]
        page = f"{before}<!-- {name} -->\n{table}\n<!-- end of {name} -->{after}"
    return page


def measure() -> dict[str, Any]:
    """Return all results."""
    known, other, rules = known_bearings(), other_maker(), held_out()
    by_family = {
        family.replace("_", " "): [row for row in rules if row["family"] == family] for family in (*BALLS, *ROLLERS)
    }
    return {
        "known": known,
        "other_maker": other,
        "summaries": {
            "known elsewhere": summary(known),
            "SKF by its ratings": summary(other),
            "rules, held out": summary(rules),
            **{f"rules, {name}": summary(rows) for name, rows in by_family.items()},
            "rules, fitted half": summary(_rule_errors(odd=False)),
        },
        "ratings_reproduced": ratings_reproduced(),
        "designations": len(families()),
    }


def main() -> None:
    """Measure, write the results and renew the page."""
    results = measure()
    RESULTS.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    PAGE.write_text(renewed(PAGE.read_text(encoding="utf-8"), tables(results)), encoding="utf-8")
    print(*tables(results).values(), sep="\n\n")
    print(results["ratings_reproduced"], results["designations"])


if __name__ == "__main__":
    main()
