"""One verdict a bearing: what two axes say alone and together, on real runs and on drawn names.

Run as ``python -m benchmarks.machine [--quick] [--json FILE]``. Tables:

1. four PRONOSTIA runs, two axes of one bearing each: the block at which an onset was known and the first name of each
   axis, the block from which the bearing is named, as what, its support at the end, and how often names change;
2. names drawn block by block for two channels, 20 seeds: how often the name of a block and that of the bearing change,
   and what the bearing is called in the second half;
3. thread time of one block of two channels, from the values of its record to what is said, least of 20 rounds.

Without the recordings (``SPALLWATCH_DATA``) table 1 is left out; ``--quick`` takes the two short runs and 4 seeds.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from benchmarks.common import Row, arguments, print_table, write_json
from monitor.health.name.evidence import Heard, heard_in
from monitor.health.name.machine import BearingVerdict, MachineState, step
from tests.conftest import recordings_folder
from tests.support.recordings import RUNS, Run, watch

SHORT = ("Bearing3_1", "Bearing2_7")
BLOCKS = 2300


@dataclass(frozen=True)
class Drawn:
    """A channel whose blocks are named independently of each other.

    Attributes:
        shares: of the blocks, by name; the rest is silent.
        depth: mean depth of its names; that of a block is log-normal, 0.3 in ln.
        onset: block from which its final stage is open, or None.
    """

    shares: tuple[tuple[str, float], ...]
    depth: float = 0.3
    onset: int | None = None


CASES: dict[str, tuple[Drawn, ...]] = {
    "healthy, one axis named in 42 % of the blocks": (Drawn((("outer", 0.42),)), Drawn(())),
    "the same, named in 10 %": (Drawn((("outer", 0.1),)), Drawn(())),
    "inner|ball on one axis, outer on the other": (
        Drawn((("inner|ball", 0.6),), 0.5, 500),
        Drawn((("outer", 0.5),), 0.35, 700),
    ),
    "inner|ball on one axis, inner on the other": (
        Drawn((("inner|ball", 0.6),), 0.4, 500),
        Drawn((("inner", 0.3),), 0.3, 700),
    ),
    "equally deep and often: outer, inner": (
        Drawn((("outer", 0.4),), 0.3, 500),
        Drawn((("inner", 0.4),), 0.3, 500),
    ),
    "outer, a tenth of its blocks inner": (Drawn((("outer", 0.5), ("inner", 0.05)), 0.4, 500), Drawn(())),
}


def changes(names: Sequence[str | None]) -> int:
    """Return how often a name differs from the one before."""
    return sum(one != other for one, other in pairwise(names))


def bearing_row(run: Run) -> Row:
    """Return what the axes and the bearing of a run say."""
    said: list[tuple[int, BearingVerdict]] = []
    names: dict[str, list[str | None]] = {}
    known: dict[str, int | None] = {}
    for _, steps, record in watch(run.config, recordings_folder() / run.file):
        for channel, values in record.channels.items():
            names.setdefault(channel, []).append(values.get("fault"))
            known[channel] = values.get("t_fs_known_block", known.get(channel))
        said.append((record.sequence, next(iter(steps.bearings.values()))))
    verdicts = [sequence for sequence, found in said if found.basis == "verdict"]
    hints = [sequence for sequence, found in said if found.basis == "hint"]
    last = said[-1][1]
    firsts = {
        channel: next((place + 1 for place, name in enumerate(found) if name is not None), None)
        for channel, found in names.items()
    }
    support = [found.support for _, found in said if found.support is not None]
    return {
        "run": run.name,
        "blocks": len(said),
        **{f"{channel}_known": known[channel] for channel in names},
        **{f"{channel}_first_name": firsts[channel] for channel in names},
        **{f"{channel}_named": sum(name is not None for name in found) for channel, found in names.items()},
        "hints": len(hints),
        "verdict_from": verdicts[0] if verdicts else None,
        "fault": last.fault,
        "basis": last.basis,
        "support": last.support,
        "support_highest": max(support, default=None),
        "disagreement": "; ".join(f"{channel}: {name}" for channel, name in last.disagreement.items()),
        "changes_of_blocks": sum(changes(found) for found in names.values()),
        "changes_of_bearing": changes([found.fault for _, found in said]),
    }


def drawn_blocks(channels: Sequence[Drawn], seed: int) -> Iterator[dict[str, Heard]]:
    """Yield what each channel says of block after block."""
    rng = np.random.default_rng(seed)
    for number in range(BLOCKS):
        heard = {}
        for place, channel in enumerate(channels):
            fault, at = None, rng.random()
            for name, share in channel.shares:
                fault = name if fault is None and 0.0 <= at < share else fault
                at -= share
            depth = channel.depth * float(np.exp(0.3 * rng.standard_normal()))
            final = channel.onset is not None and number >= channel.onset
            heard[f"x{place}"] = Heard(fault=fault, depth=depth, final=final)
        yield heard


def drawn_row(case: str, seeds: int) -> Row:
    """Return how often names change in a case, and what the bearing is called."""
    bearings = {"bearing": tuple(f"x{place}" for place in range(len(CASES[case])))}
    of_blocks = of_bearing = 0
    called: Counter[str] = Counter()
    for seed in range(seeds):
        state, said, names = MachineState(), [], []
        for heard in drawn_blocks(CASES[case], seed):
            state, found = step(state, heard, bearings)
            said.append(found["bearing"])
            names.append([one.fault for one in heard.values()])
        of_blocks += sum(changes(column) for column in zip(*names, strict=True))
        of_bearing += changes([found.fault for found in said])
        called.update(f"{found.fault} ({found.basis})" if found.fault else "none" for found in said[BLOCKS // 2 :])
    per = 1000.0 / (seeds * BLOCKS)
    total = sum(called.values())
    return {
        "case": case,
        "changes_of_blocks_per_1000": of_blocks * per,
        "changes_of_bearing_per_1000": of_bearing * per,
        "called": ", ".join(f"{name} {100 * number / total:.1f} %" for name, number in called.most_common()),
    }


def cost_row(fault: str | None) -> Row:
    """Return the time of a block of two channels, one of which names a part."""
    quiet: dict[str, Any] = {"quality_status": "ok", "fault": None}
    values = {"x": quiet | {"fault": fault, "fault_depth": 0.4, "t_fs_block": 3}, "y": quiet}
    state, times = MachineState(), []
    for _ in range(20):
        began = time.thread_time()
        for _ in range(200):
            state, _ = step(state, heard_in(values), {"bearing": ("x", "y")})
        times.append(time.thread_time() - began)
    return {"named": fault or "nothing", "us": 1e6 * min(times) / 200}


def main() -> None:
    """Run the benchmark."""
    options = arguments(__doc__ or "")
    tables: dict[str, list[Row]] = {}
    if recordings_folder().is_dir():
        runs = [run for run in RUNS if not options.quick or run.name in SHORT]
        tables["runs"] = [bearing_row(run) for run in runs]
    tables["drawn"] = [drawn_row(case, 4 if options.quick else 20) for case in CASES]
    tables["cost"] = [cost_row(fault) for fault in (None, "outer")]
    for title, rows in tables.items():
        print_table(title, rows)
    write_json(options.json, tables)


if __name__ == "__main__":
    main()
