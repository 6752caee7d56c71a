"""Names of seeded faults: 500 machines drawn by seeds that constants may be fitted on, and 500 that were set aside.

Run as ``python -m benchmarks.naming.seeded [--json FILE] [--quick] [--held-out] [--validation] [--baseline]``. Each
record of ``benchmarks/naming/faults.py`` goes through the program as one block with its stated speed, up to 6 %
wrong, in the band that a person would configure. A fault is findable if its comb is ``FINDABLE`` deep at the
frequency at which the passages really came (``benchmarks/naming/truth.py``). A foreign comb is that of a gear wheel
whose first, second or third line stands within the reach of a family (slip of 0 to 4 %): then what the name rests on
may be the gear.
Tables: all, and by part, bearing, speed, error of the stated speed, length, gears; then what was wrong.

``--held-out`` judges the seeds that were set aside, ``--validation`` those of the rules before. Every run keeps
the tables of the other kinds in its file: ``first_rule_held_out`` is what commit 5dc111c said of seeds 10,000 to
10,499, ``second_rule_held_out`` what the rule said of 20,000 to 20,499 before it was changed by them.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from benchmarks.common import Row, circumstances, print_table, write_json
from benchmarks.naming.faults import HELD_OUT, TRAINING, VALIDATION, Plan, Seeded, kept
from benchmarks.naming.truth import FINDABLE, comb_depth, envelope_spectrum
from models.machine.bearing import from_catalogue
from monitor.config.load import Config
from monitor.health.state import SourceSettings
from monitor.service.setup import source_settings
from reference.recordings import judge
from reference.steps import Steps
from streams.types.block import Block

VERDICTS = ("right", "joined", "silent", "wrong", "healthy named", "quiet")
_SLIPS = (0.96, 1.0)
_CHANNEL = "casing"
_SPEED_NEAR = 0.01


@dataclass(frozen=True)
class Judged:
    """What was said of a record.

    Attributes:
        plan: of the record.
        fault: the name in its record, or None.
        depth: of the comb of the damaged part, 0 where there is none.
        found: what else was found: the deepest family, the speed over the stated one, and its standard deviation
            where the shaft shows it.
    """

    plan: Plan
    fault: str | None
    depth: float
    found: Row

    @property
    def verdict(self) -> str:
        """Return one of ``VERDICTS``."""
        return judge(self.plan.part, self.fault)

    @property
    def findable(self) -> bool:
        """Whether the comb is deep enough to be expected to be found."""
        return self.depth >= FINDABLE

    @property
    def speed(self) -> str:
        """Return whether the shaft was found, within 1 % of its speed or not."""
        factor = self.found["speed_factor"]
        if self.found["speed_factor_sd"] is None or factor is None:
            return "not found"
        near = abs(float(factor) * self.plan.stated / self.plan.speed - 1.0) < _SPEED_NEAR
        return "found" if near else "found elsewhere"

    @property
    def foreign(self) -> bool:
        """Whether a comb of the gear stands where a family may be."""
        gear, lines = self.plan.gear, self.plan.lines
        if gear is None:
            return False
        balls = from_catalogue(self.plan.bearing).n_elements
        # A slower cage lets the balls pass the inner race faster.
        ranges = [(slip * line, line) for slip in _SLIPS[:1] for line in (lines.bpfo, 2.0 * lines.bsf, lines.ftf)]
        ranges.append((lines.bpfi, lines.bpfi + (1.0 - _SLIPS[0]) * balls * lines.ftf))
        lines_of_gear = [gear.other * order for order in (1, 2, 3)]
        return any(0.99 * low <= line <= 1.01 * high for low, high in ranges for line in lines_of_gear)

    def row(self) -> Row:
        """Return what was drawn and what was said."""
        plan = self.plan
        gear = plan.gear
        return {
            "seed": plan.seed,
            "part": plan.part,
            "named": self.fault,
            "verdict": self.verdict,
            "true_depth": round(self.depth, 3),
            "bearing": plan.bearing,
            "model": plan.model,
            "speed_hz": round(plan.speed, 3),
            "error_%": round(100 * (plan.stated / plan.speed - 1), 2),
            "slip_%": round(100 * plan.slip, 2),
            "jitter_%": round(100 * plan.jitter, 2),
            "duration_s": round(plan.duration, 2),
            "rate_hz": plan.rate,
            "gear": None if gear is None else f"{gear.other / plan.speed:.3f} x, knock {gear.knock:.1f}",
            "foreign": self.foreign,
            **self.found,
        }


@cache
def settings_of(bearing: str, band: tuple[float, float], stated: float = 20.0) -> SourceSettings:
    """Return the settings of a machine with one channel."""
    config = Config.model_validate(
        {
            "bearing": [{"name": "test", "designation": bearing}],
            "operating": {"speed_hz": stated},
            "source": [{"name": "recording", "url": "unused", "block_s": "file"}],
            "channel": [
                {"name": _CHANNEL, "source": "recording", "unit": "m/s2", "bearing": "test", "band_hz": [list(band)]}
            ],
        }
    )
    return source_settings(config, config.source[0])


def block_of(record: Seeded) -> Block:
    """Return a record as a block that states its nominal speed."""
    plan = record.plan
    return Block(
        samples=record.samples[None, :],
        rate=plan.rate,
        channels=(_CHANNEL,),
        units=("m/s2",),
        source="recording",
        sequence=1,
        name=f"seed {plan.seed}",
        elapsed=0.0,
        speed=plan.stated,
    )


def judged(record: Seeded) -> Judged:
    """Take a record through the program."""
    plan = record.plan
    steps = Steps(settings_of(plan.bearing, plan.band))
    said = steps.take(block_of(record))
    output = steps.outputs[_CHANNEL]
    values: dict[str, Any] = dict(said.channels[_CHANNEL])
    depth = 0.0
    if record.line is not None:
        depth = comb_depth(envelope_spectrum(record.samples, plan.rate, plan.band), record.line)
    evidence = None if output.naming is None else output.naming.evidence
    found: Row = {
        "best": None if output.naming is None else output.naming.best,
        "best_depth": None if evidence is None else round(evidence.depth, 3),
        "speed_factor": values.get("speed_factor"),
        "speed_factor_sd": values.get("speed_factor_sd"),
    }
    fault: Any = values.get("fault")
    return Judged(plan, fault, depth, found)


def records(seeds: Iterable[int], folder: Path | None) -> Iterator[Judged]:
    """Make and judge the records of some seeds; ``folder`` keeps them between runs."""
    for seed in seeds:
        yield judged(kept(seed, folder))


def counts(found: Sequence[Judged], name: str, value: str) -> Row:
    """Return the counts of verdicts under a name; of the findable ones those named and those silent."""
    tally = Counter(one.verdict for one in found)
    deep = Counter(one.verdict for one in found if one.findable)
    return {
        name: value,
        **{verdict: tally[verdict] for verdict in VERDICTS},
        "findable": sum(deep.values()),
        "of these named": deep["right"] + deep["joined"],
        "findable but silent": deep["silent"],
        "wrong, foreign comb": sum(one.foreign and one.verdict in ("wrong", "healthy named") for one in found),
    }


def _range(value: float, edges: Sequence[float]) -> str:
    """Return the range between two edges that holds a value."""
    place = sum(value >= edge for edge in edges)
    low = "" if place == 0 else f"{edges[place - 1]:g}"
    return f"{low}-{'' if place == len(edges) else f'{edges[place]:g}'}"


GROUPS: dict[str, Callable[[Judged], str]] = {
    "part": lambda one: one.plan.part or "none",
    "bearing": lambda one: one.plan.bearing,
    "model": lambda one: one.plan.model if one.plan.part not in (None, "cage") else "none",
    "speed_hz": lambda one: _range(one.plan.speed, (3.0, 10.0, 20.0)),
    "speed_error_%": lambda one: _range(100 * abs(one.plan.stated / one.plan.speed - 1), (1.0, 2.0, 4.0)),
    "turns": lambda one: _range(one.plan.speed * one.plan.duration, (10.0, 20.0, 50.0)),
    "slip_%": lambda one: _range(100 * one.plan.slip, (1.0, 2.0, 3.0)),
    "gear": lambda one: "none" if one.plan.gear is None else ("knocks" if one.plan.gear.knock else "mesh"),
    "shaft": lambda one: one.speed,
    "shaft lines": lambda one: "yes" if one.plan.shaft[0] > 0.0 or one.plan.shaft[1] > 0.0 else "no",
}


def tables_of(found: Sequence[Judged]) -> dict[str, list[Row]]:
    """Return all tables by name."""
    tables = {"all": [counts(found, "records", f"{len(found)}")]}
    for name, group in GROUPS.items():
        values = sorted({group(one) for one in found})
        tables[f"by {name}"] = [counts([one for one in found if group(one) == value], name, value) for value in values]
    noted = [one.row() for one in found if one.verdict in ("wrong", "healthy named")]
    tables["wrong"] = noted
    return tables


def main() -> None:
    """Run, print, write."""
    parser = argparse.ArgumentParser(description="Names of seeded faults.")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the same figures to this file")
    parser.add_argument("--quick", action="store_true", help="the first 50 seeds only")
    parser.add_argument("--held-out", action="store_true", help="the seeds that were set aside")
    parser.add_argument("--validation", action="store_true", help="the seeds that were set aside for earlier rules")
    parser.add_argument("--baseline", action="store_true", help="keep the figures as those to compare with")
    parser.add_argument("--records", type=Path, metavar="DIR", help="keep the records there between runs")
    options = parser.parse_args()
    kind = "held_out" if options.held_out else "validation" if options.validation else "training"
    seeds = {"training": TRAINING, "validation": VALIDATION, "held_out": HELD_OUT}[kind]
    found = list(records(seeds[:50] if options.quick else seeds, options.records))
    tables = tables_of(found)
    for name, rows in tables.items():
        if rows:
            print_table(name, rows)
    kind = f"baseline_{kind}" if options.baseline else kind
    written: dict[str, Any] = {}
    if options.json is not None and options.json.is_file():
        written = json.loads(options.json.read_text(encoding="utf-8"))
    written[kind] = {"run": circumstances(), **tables}
    write_json(options.json, written)


if __name__ == "__main__":
    main()
