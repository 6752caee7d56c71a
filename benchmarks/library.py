"""The library forecaster: what a block costs, and what it is worth on unseen lives by features and by size.

Run as ``python -m benchmarks.library [--quick] [--json FILE]``. Three tables:

1. milliseconds per block and bytes of state, after a hundred and after ten thousand blocks, one and three thresholds;
2. out-of-fold figures of libraries of 100 to 1000 lives at shares of the time to the threshold, beside climatology (the
   lifetimes of the others that were longer than the time up to now);
3. the same of two libraries whose lives have no slip: at constant load and speed, and with both changing from block to
   block by up to 10 % either way.

Nothing here sees the test population of ``benchmarks.forecast``: lives are those of its library population, and each is
scored by fits that were made without it.
"""

from __future__ import annotations

import json
import math
import statistics
import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from benchmarks.common import (
    REFERENCE_MS,
    Row,
    arguments,
    calibration_kernel,
    interleaved_ms,
    print_table,
    write_json,
)
from benchmarks.forecast_lives import cached_lives
from benchmarks.forecast_population import LIBRARY, LIBRARY_RUNS, THRESHOLD
from models.lives.life import LifeHistory
from monitor.health.size import DamageInput
from monitor.health.size.library.fit import fit_library
from monitor.health.size.library.forecaster import LibrarySettings, LibraryState, step
from monitor.health.size.library.model import LINES, Library

THRESHOLDS = (0.03e-6, 0.04e-6, 0.05e-6)
TARGET_MS = 2.0
CHANGE = 0.1
"""Change of load and speed from block to block, either way."""
LONG = 10_000
"""Blocks of a long history."""


def fitted(lives: Sequence[LifeHistory], thresholds: Sequence[float] = (THRESHOLD,)) -> Library:
    """Return the library of lives, fitted as ``spallwatch library build`` does."""
    return fit_library(lives, thresholds=thresholds, interval=LIBRARY.interval, prior="benchmark", made_of={})


def block_of(life: LifeHistory, index: int, t: float) -> DamageInput:
    """Return a block of a life, said to be at another time."""
    return DamageInput(
        time=t,
        rms=float(life.rms[index]),
        harmonics=tuple(life.harmonics[index].tolist()),
        load=float(life.load[index]),
        speed=float(life.speed[index]),
        v_eq=float(life.v_eq[index]),
    )


def cost(library: Library, life: LifeHistory, features: str, blocks: int, thresholds: Sequence[float]) -> Row:
    """Return the time of the last hundred blocks of a history, and the size of its state.

    A long history is a life that is walked through again and again, and the library is told that lives may last for
    ever: it is about time and memory, not about sense.
    """
    settings = LibrarySettings(features=features)
    library = replace(library, fits={features: replace(library.fit_for(features), longest=math.inf)})
    spent: list[float] = []
    state = LibraryState()
    for number in range(blocks):
        block = block_of(life, number % life.t.size, number * LIBRARY.interval)
        begun = time.thread_time()
        state, _, _ = step(state, block, library, settings, thresholds=thresholds)
        spent.append(1e3 * (time.thread_time() - begun))
    return {
        "features": features,
        "blocks": blocks,
        "thresholds": len(thresholds),
        "median_ms": statistics.median(spent[-100:]),
        "p99_ms": float(np.percentile(spent[-100:], 99)),
        "state_bytes": len(json.dumps(state.to_dict())),
    }


def costs(lives: Sequence[LifeHistory]) -> list[Row]:
    """Return the cost table, each figure also scaled to the machine that targets refer to."""
    library = fitted(lives, THRESHOLDS)
    life = max(lives, key=lambda one: one.t.size)
    kernel = interleaved_ms({"fft": calibration_kernel()}, 200)["fft"]
    rows: list[Row] = []
    for features in LINES:
        for blocks, thresholds in ((100, (THRESHOLD,)), (100, THRESHOLDS), (LONG, (THRESHOLD,))):
            row = cost(library, life, features, blocks, thresholds)
            scaled = float(row["median_ms"] or math.nan) * REFERENCE_MS / kernel
            rows.append({**row, "scaled_ms": scaled, "target_ms": TARGET_MS, "library_lives": len(lives)})
    return rows


def worth(lives: Sequence[LifeHistory]) -> list[Row]:
    """Return the out-of-fold figures of a library of lives, by features and share."""
    library = fitted(lives)
    key = f"{THRESHOLD * 1e6:g}"
    rows: list[Row] = []
    for features in LINES:
        for share, score in library.scores[features][key].items():
            naive = float(library.scores["climatology"][key][share]["crps_s"])
            rows.append(
                {
                    "lives": len(lives),
                    "features": features,
                    "share": share,
                    **score,
                    "crps_over_climatology": score["crps_s"] / naive,
                }
            )
    return rows


def main() -> None:
    """Print the tables and write them."""
    options = arguments(__doc__ or "")
    sizes = (20, 40) if options.quick else (100, 250, 500, LIBRARY_RUNS)
    lives = cached_lives(LIBRARY, sizes[-1])
    table = costs(lives)
    print_table("cost of a block", table)
    rows = [row for size in sizes for row in worth(lives[:size])]
    print_table("unseen lives, out of fold, by size of the library", rows)
    steady = replace(LIBRARY, slip=(0.0, 0.0))
    changing = replace(steady, load_variation=CHANGE, speed_variation=CHANGE)
    count = 20 if options.quick else 250
    changes: list[Row] = [
        {"conditions": name, **row}
        for name, population in (("constant", steady), ("changing", changing))
        for row in worth(cached_lives(population, count))
        if row["features"] != "v_eq"
    ]
    print_table("unseen lives, out of fold, load and speed constant or changing", changes)
    tables = {"quick": {"quick": str(options.quick)}, "cost": table, "worth": rows, "conditions": changes}
    write_json(options.json, tables)


if __name__ == "__main__":
    main()
