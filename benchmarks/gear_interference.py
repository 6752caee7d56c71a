"""Gears as interference: what is named on geared machines, healthy and damaged, before and after their lines go.

Run as ``python -m benchmarks.gear_interference [--held-out] [--quick] [--json FILE]``. The machines of
``benchmarks/seeded_gears.py``: gears at +20 dB over the noise of the band where they are loaded, at +10 dB where they
rattle (three in ten). Every record goes through the program as one block with its stated speed, up to 6 % wrong, in
three ways: "nothing" is configured of the gears; ``[gear]`` is; "no gears" is the same record without them. Tables:

1. healthy machines: what is named, by state of the gears, and the rate that the counts exclude at 95 %;
2. damaged machines, by the level of the damage below the gears, RMS in the band: named rightly (or as a pair of parts
   with the right one), wrongly, or not;
3. the same at all levels, by damaged part.

Without ``--held-out`` the seeds are those on which constants were fitted. ``--held-out`` judges the seeds that were
set aside; the figures of the other kind stay in the file.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.common import Row, circumstances, print_table, write_json
from benchmarks.naming_seeded import block_of, settings_of
from benchmarks.naming_undamaged import limit
from benchmarks.seeded_faults import Plan, Seeded, draw, realise
from benchmarks.seeded_gears import (
    GEAR_DAMAGED,
    GEAR_HEALTHY,
    GEAR_TRAINING,
    GearDraw,
    added_gears,
    draw_gears,
    level_below,
)
from monitor.health.gears.interference import gear_interference
from monitor.health.gears.settings import GearPairing, GearSettings, GearWheel
from monitor.health.signal.shaft import ACCEPTED
from monitor.health.state import SourceSettings
from tests.support.recordings import judge
from tests.support.steps import Steps

WAYS = ("nothing", "[gear]", "no gears")
BELOW = tuple(range(0, -45, -5))
"""Level of the damage over that of the gears, dB."""
RECORDS = 50
"""Damaged machines."""


@dataclass(frozen=True)
class Said:
    """What was said of a record.

    Attributes:
        seed, part: of the record.
        state: of the gears.
        way: what is configured, of ``WAYS``.
        below: level of the damage, dB, or None.
        fault: what was named.
    """

    seed: int
    part: str | None
    state: str
    way: str
    below: int | None
    fault: str | None

    @property
    def verdict(self) -> str:
        """Return right, joined, wrong, silent, quiet or healthy named."""
        return judge(self.part, self.fault)


def settings_with(plan: Plan, gears: GearDraw, way: str) -> SourceSettings:
    """Return the settings of a record in one of the ways."""
    settings = settings_of(plan.bearing, plan.band)
    if way != "[gear]":
        return settings
    wheels = GearWheel("driver", gears.driver, 1.0), GearWheel("driven", gears.driven, gears.turns)
    lines = gear_interference(GearSettings(wheels, (GearPairing("driver", "driven"),)), ACCEPTED)
    channels = {name: replace(channel, interference=lines) for name, channel in settings.channels.items()}
    return replace(settings, channels=channels)


def named(record: Seeded, settings: SourceSettings) -> str | None:
    """Return what the program names in a record."""
    said = Steps(settings).take(block_of(record))
    (channel,) = said.channels.values()
    fault: Any = dict(channel).get("fault")
    return fault


def healthy(seed: int) -> Iterator[Said]:
    """Yield what is said of a machine without damage."""
    plan, gears = replace(draw(seed), part=None, gear=None), draw_gears(seed)
    record = realise(plan)
    geared = replace(record, samples=record.samples + added_gears(seed, plan, gears))
    for way in WAYS:
        fault = named(record if way == "no gears" else geared, settings_with(plan, gears, way))
        yield Said(seed, None, gears.state, way, None, fault)


def damaged(seed: int) -> Iterator[Said]:
    """Yield what is said of a machine with damage at each level below its gears."""
    plan, gears = replace(draw(seed), gear=None), draw_gears(seed)
    # The samples are linear in the level of the damage.
    none, one = (realise(replace(plan, level=level)).samples.astype(np.float64) for level in (0.0, 1.0))
    beside = added_gears(seed, plan, gears).astype(np.float64)
    for below in BELOW:
        bearing = none + level_below(gears, below) * (one - none)
        for way in WAYS:
            x: NDArray[np.float64] = bearing if way == "no gears" else bearing + beside
            record = Seeded(plan, x.astype(np.float32), None)
            fault = named(record, settings_with(plan, gears, way))
            yield Said(seed, plan.part, gears.state, way, below, fault)


def healthy_rows(said: Sequence[Said]) -> list[Row]:
    """Table 1."""
    rows: list[Row] = []
    for way in WAYS:
        for state in ("loaded", "idle", "both"):
            of = [one for one in said if one.way == way and state in (one.state, "both")]
            names = Counter(one.fault for one in of if one.fault not in (None, "undecided"))
            count = sum(names.values())
            rows.append(
                {
                    "configured": way,
                    "gears": state,
                    "records": len(of),
                    "named": count,
                    "undecided": sum(one.fault == "undecided" for one in of),
                    "limit_95_%": 100.0 * limit(count, len(of)) if of else None,
                    "names": ", ".join(f"{name} {number}" for name, number in names.items()),
                }
            )
    return rows


def damaged_rows(said: Sequence[Said], key: str) -> list[Row]:
    """Tables 2 and 3, by ``below`` or ``part``."""
    groups: defaultdict[tuple[Any, str], list[Said]] = defaultdict(list)
    for one in said:
        groups[getattr(one, key), one.way].append(one)
    rows: list[Row] = []
    for (value, way), of in groups.items():
        tally = Counter(one.verdict for one in of)
        found = {"right": tally["right"], "joined": tally["joined"], "wrong": tally["wrong"], "silent": tally["silent"]}
        loaded = [one.verdict in ("right", "joined") for one in of if one.state == "loaded"]
        rows.append(
            {key: value, "configured": way, "records": len(of), **found}
            | {"loaded": len(loaded), "loaded: named": sum(loaded)}
        )
    return rows


def noted_rows(said: Sequence[Said]) -> list[Row]:
    """Return what was named wrongly."""
    rows: list[Row] = []
    for one in said:
        if one.verdict in ("wrong", "healthy named"):
            plan, gears = draw(one.seed), draw_gears(one.seed)
            rows.append(
                {
                    "seed": one.seed,
                    "part": one.part,
                    "named": one.fault,
                    "configured": one.way,
                    "below_db": one.below,
                    "gears": f"{one.state} {gears.driver}/{gears.driven}",
                    "bearing": plan.bearing,
                    "turns": round(plan.speed * plan.duration),
                    "error_%": round(100 * (plan.stated / plan.speed - 1), 2),
                }
            )
    return rows


def main() -> None:
    """Run, print, write."""
    parser = argparse.ArgumentParser(description="Gears as interference: names.")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the same figures to this file")
    parser.add_argument("--quick", action="store_true", help="few records")
    parser.add_argument("--held-out", action="store_true", help="the seeds that were set aside")
    parser.add_argument("--only", choices=("healthy", "damaged"), help="one of the tables")
    options = parser.parse_args()
    well: Sequence[int] = GEAR_HEALTHY if options.held_out else GEAR_TRAINING
    ill = [seed for seed in (GEAR_DAMAGED if options.held_out else GEAR_TRAINING) if draw(seed).part is not None]
    ill = ill[: 5 if options.quick else RECORDS]
    well = well[: 20 if options.quick else None]
    tables: dict[str, list[Row]] = {}
    if options.only != "damaged":
        said = [one for seed in well for one in healthy(seed)]
        tables["healthy"] = healthy_rows(said)
        tables["healthy, named"] = noted_rows(said)
    if options.only != "healthy":
        said = [one for seed in ill for one in damaged(seed)]
        by = partial(damaged_rows, said)
        tables |= {"damaged": by("below"), "by part": by("part"), "damaged, wrong": noted_rows(said)}
    for name, rows in tables.items():
        if rows:
            print_table(name, rows)
    written: dict[str, Any] = {}
    if options.json is not None and options.json.is_file():
        written = json.loads(options.json.read_text(encoding="utf-8"))
    kind = "held_out" if options.held_out else "training"
    written[kind] = {**written.get(kind, {}), "run": circumstances(), **tables}
    write_json(options.json, written)


if __name__ == "__main__":
    main()
