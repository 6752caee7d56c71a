"""Names on records without damage, at an unknown speed: there should be none.

Run as ``python -m benchmarks.naming.undamaged [--quick] [--json FILE]``. 5,000 records of 0.2 to 5 s through the whole
program, the stated speed up to 8 % wrong; 1 to 40 Hz, four bearings, five sampling rates. White noise; coloured noise
of a structure with balls that pass the load zone; the same with harmonics of the shaft in signal and envelope; the same
with gear mesh and its sidebands at the turns of both wheels. With no name in n records, the rate of names is below
1 - 0.05^(1/n) at 95 %.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.common import Row, Tables, benchmark
from benchmarks.naming.faults import Gear, Plan, Seeded, draw, realise
from benchmarks.naming.seeded import block_of, settings_of
from reference.steps import Steps

FIRST_SEED = 200_000
"""Seeds from 100,000 on showed that lines closer than eight bins must not be named; these came after it."""
KINDS = ("white", "coloured", "shaft", "gear")
RECORDS = 1250
"""Of each kind."""
_UNKNOWN = 0.08


def record_of(kind: str, seed: int) -> Seeded:
    """Return a record without damage."""
    rng = np.random.default_rng([23, seed])
    drawn = draw(seed)
    plan: Plan = replace(
        drawn,
        part=None,
        stated=drawn.speed * (1.0 + rng.uniform(-_UNKNOWN, _UNKNOWN)),
        duration=float(np.exp(rng.uniform(math.log(0.2), math.log(5.0)))),
        gear=None,
        shaft=(0.0, 0.0),
    )
    if kind == "white":
        n = round(plan.rate * plan.duration)
        return Seeded(plan, rng.standard_normal(n).astype(np.float32), None)
    if kind in ("shaft", "gear"):
        plan = replace(plan, shaft=(float(np.exp(rng.uniform(-2.0, 1.5))), rng.uniform(0.05, 0.5)))
    if kind == "gear":
        ratio = float(np.exp(rng.uniform(math.log(0.2), math.log(5.0))))
        teeth = int(rng.integers(13, 61))
        plan = replace(plan, gear=Gear(teeth, plan.speed * ratio, rng.uniform(0.1, 3.0), rng.uniform(0.1, 0.9), 0.0))
    return realise(plan)


def named(record: Seeded) -> tuple[str | None, str | None]:
    """Return the name that a record gets, and its family that stands clear of the noise, if any does."""
    plan = record.plan
    steps = Steps(settings_of(plan.bearing, plan.band))
    said = steps.take(block_of(record))
    channel: dict[str, Any] = dict(next(iter(said.channels.values())))
    naming = next(iter(steps.outputs.values())).naming
    clear = naming is not None and naming.evidence is not None and naming.evidence.comb_score >= naming.threshold
    return channel.get("fault"), naming.best if naming is not None and clear else None


def rows_of(kind: str, count: int) -> tuple[Row, list[Row]]:
    """Return the counts of a kind, and what was named."""
    tally: Counter[str] = Counter()
    noted: list[Row] = []
    for i in range(count):
        record = record_of(kind, FIRST_SEED + KINDS.index(kind) * RECORDS + i)
        fault, clear = named(record)
        tally["clear"] += clear is not None
        tally["undecided"] += fault == "undecided"
        if fault is None:
            continue
        tally["named"] += fault != "undecided"
        plan = record.plan
        noted.append(
            {
                "kind": kind,
                "seed": plan.seed,
                "fault": fault,
                "bearing": plan.bearing,
                "speed_hz": plan.speed,
                "stated_hz": plan.stated,
                "duration_s": plan.duration,
                "rate_hz": plan.rate,
                "gear_hz": None if plan.gear is None else plan.gear.other,
            }
        )
    row: Row = {
        "kind": kind,
        "records": count,
        "named": tally["named"],
        "undecided": tally["undecided"],
        "a family clear of noise": tally["clear"],
        "limit_95_%": 100.0 * limit(tally["named"], count),
    }
    return row, noted


def limit(named: int, count: int) -> float:
    """Return the rate that ``named`` of ``count`` exclude at 95 %, one-sided (exact binomial)."""
    if named == 0:
        return 1.0 - 0.05 ** (1.0 / count)
    low, high = named / count, 1.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        at_most = sum(
            math.exp(
                math.lgamma(count + 1) - math.lgamma(k + 1) - math.lgamma(count - k + 1)
                + k * math.log(middle) + (count - k) * math.log1p(-middle)
            )
            for k in range(named + 1)
        )  # fmt: skip
        low, high = (middle, high) if at_most > 0.05 else (low, middle)
    return high


@benchmark("Names on records without damage.")
def main(quick: bool) -> Tables:
    """Run, print, write."""
    count = 50 if quick else RECORDS
    rows: list[Row] = []
    noted: list[Row] = []
    for kind in KINDS:
        row, found = rows_of(kind, count)
        rows.append(row)
        noted += found
    total = sum(count for _ in KINDS)
    names = sum(row["fault"] != "undecided" for row in noted)
    rows.append(
        {
            "kind": "all",
            "records": total,
            "named": names,
            "undecided": len(noted) - names,
            "a family clear of noise": sum(int(row["a family clear of noise"] or 0) for row in rows),
            "limit_95_%": 100.0 * limit(names, total),
        }
    )
    return {"undamaged": rows, "named": noted}
