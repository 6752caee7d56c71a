"""How much levels of a sound machine scatter from block to block, and how far they drift: 11 recorded runs.

Run as ``python -m benchmarks.block_scatter [--json FILE]``. From the first half of the histories of
``$SPALLWATCH_DATA/femto_histories`` (0.1 s every 10 s), each channel: the scatter of ln RMS and of the ln amplitude of
the outer race's line between neighbouring blocks, by the median of the absolute changes, and of the means of 10 blocks
(as long as a block of a second); the drift is the standard deviation of ln RMS over the first half, medians of a
thirtieth of it. The ranges of ``models.lives.population.Population`` (scatter, line_scatter, gain_drift) are read from
these figures.
"""

from __future__ import annotations

import argparse
import csv
import math
import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.common import Row, print_table, write_json

Floats = NDArray[np.float64]

_SD_PER_MAD, _BLOCKS, _PARTS = 1.4826, 10, 30
_LEVELS = (0.0, 0.1, 0.5, 0.9, 1.0)


def scatter_of(ln_level: Floats) -> float:
    """Return the standard deviation of a block from the changes between neighbours, robust against steps."""
    changes = np.diff(ln_level)
    return float(_SD_PER_MAD * np.median(np.abs(changes - np.median(changes))) / math.sqrt(2.0))


def rows_of(path: Path) -> list[Row]:
    """Return the figures of both channels of a run."""
    with path.open(encoding="utf-8", newline="") as lines:
        blocks = list(csv.DictReader(lines))
    rows: list[Row] = []
    for axis in "hv":
        rms, line = (_sound([block[f"{axis}_{name}_g"] for block in blocks]) for name in ("rms", "h_or"))
        means = rms[: rms.size // _BLOCKS * _BLOCKS].reshape(-1, _BLOCKS).mean(axis=1)
        drift = [float(np.median(part)) for part in np.array_split(rms, _PARTS)]
        rows.append(
            {
                "run": path.stem,
                "axis": axis,
                "scatter_rms": scatter_of(rms),
                "scatter_rms_1s": scatter_of(means),
                "scatter_line": scatter_of(line),
                "drift": float(np.std(drift)),
            }
        )
    return rows


def _sound(values: list[str]) -> Floats:
    level = np.array([float(value) if value else math.nan for value in values[: len(values) // 2]])
    return np.log(level[level > 0.0])


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the same figures to this file")
    options = parser.parse_args()
    folder = Path(os.environ["SPALLWATCH_DATA"]) / "femto_histories"
    rows = [row for path in sorted(folder.glob("*.csv")) for row in rows_of(path)]
    spread: list[Row] = []
    for figure in ("scatter_rms", "scatter_rms_1s", "scatter_line", "drift"):
        least, tenth, median, most_of, most = np.quantile([float(row[figure] or 0.0) for row in rows], _LEVELS).tolist()
        spread.append(
            {"figure": figure, "least": least, "10 %": tenth, "median": median, "90 %": most_of, "most": most}
        )
    print_table("runs", rows)
    print_table("over runs and channels", spread)
    write_json(options.json, {"runs": rows, "spread": spread})


if __name__ == "__main__":
    main()
