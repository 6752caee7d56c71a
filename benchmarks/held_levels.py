"""Damage that grows to a level and is then held: V_eq over the true one, and what is said of TT.

Run as ``python -m benchmarks.held_levels [--quick] [--json FILE]``. The lives are standing ones of the library
population of ``benchmarks.forecast_population``; every second of them is judged by a library of all other lives.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from benchmarks.common import Row, arguments, print_table, write_json
from benchmarks.forecast_library import fitted
from benchmarks.forecast_lives import cached_lives
from benchmarks.forecast_population import LIBRARY, LIBRARY_RUNS, THRESHOLD
from models.lives.life import LifeHistory
from monitor.health.size import TtStatus
from monitor.health.size.library.fit import stands_still
from monitor.health.size.library.forecaster import LibrarySettings, LibraryState, step
from monitor.health.size.library.model import Library
from tests.support.followed_lives import block_of

STANDSTILL = "standstill"
FEATURES = ("rms", "rms+harmonics", "v_eq")
HELD_BLOCKS = (25, 50, 100, 200)
MAX_LIVES = 30


def held(tested: Sequence[LifeHistory], library: Library, features: str) -> list[Row]:
    """Score standing lives so many blocks after they came to a stand."""
    settings = LibrarySettings(features=features)
    found: dict[int, list[tuple[float, bool, bool, float]]] = {blocks: [] for blocks in HELD_BLOCKS}
    for life in tested:
        began = int(np.argmax(stands_still(life.v_eq)))
        state = LibraryState()
        for k in range(began + HELD_BLOCKS[-1] + 1):
            state, damage, (forecast,) = step(state, block_of(life, k), library, settings, thresholds=[THRESHOLD])
            if k - began in found and math.isfinite(damage.v_eq):
                inside = damage.v_eq_lower <= life.v_eq[k] <= damage.v_eq_upper
                said = forecast.status == TtStatus.NO_GROWTH
                found[k - began].append((math.log(damage.v_eq / life.v_eq[k]), inside, said, damage.p_no_growth))
    rows: list[Row] = []
    for blocks, answers in found.items():
        error, inside, said, p = np.array(answers, dtype=float).T
        rows.append(
            {
                "features": features,
                "blocks_held": blocks,
                "lives": len(error),
                "asked": len(tested),
                "v_over_true": math.exp(float(error.mean())),
                "v_rms_ln": float(np.sqrt(np.mean(error**2))),
                "v_coverage": float(inside.mean()),
                "no_growth": float(said.mean()),
                "mean_p": float(p.mean()),
            }
        )
    return rows


def main() -> None:
    """Print the table and write it."""
    options = arguments(__doc__ or "")
    lives = cached_lives(LIBRARY, 200 if options.quick else LIBRARY_RUNS)
    still = [life for life in lives if life.law == STANDSTILL][::2]
    library = fitted([life for life in lives if life.number not in {one.number for one in still}])
    long = [life for life in still if np.count_nonzero(stands_still(life.v_eq)) > HELD_BLOCKS[-1] + 1]
    rows = [row for features in FEATURES for row in held(long[:MAX_LIVES], library, features)]
    print_table("damage that is held", rows)
    write_json(options.json, {"held": rows, "made": {"library": library.hash}})


if __name__ == "__main__":
    main()
