"""Judge what init, replay and Python make of sixty invented loggers.

    python -m benchmarks.loggers [--set NAME] [--seeds N ...] [--json FILE] [--keep FOLDER] [--quick]

Each fact of each logger is right, asked (a question was printed), missed (stated, not read, and nothing false said),
refused, or silently wrong. The design set may be looked at; the held-out set is judged once.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from benchmarks.common import print_table, write_json
from benchmarks.loggers.judge import ASKED, REFUSED, RIGHT, WRONG
from benchmarks.loggers.trial import judged

SETS = {
    "design": range(60),
    "held-out": range(1000, 1060),
    "second held-out": range(5000, 5060),
    "third held-out": range(9000, 9060),
}
"""The first two held-out sets have been looked at since they were judged; the third is judged once."""


def totals(rows: list[dict[str, Any]]) -> dict[str, float | int]:
    """Return the shares of all loggers."""
    silent = [row for row in rows if WRONG in (row["by_init"], row["by_hand"], row["by_read"])]
    answerable = [row for row in rows if row["answerable"] == "True"]
    read = [row for row in rows if row["by_init"] == RIGHT]
    return {
        "loggers": len(rows),
        "read_without_question": len(read) / len(rows),
        "read_of_answerable": sum(row["by_init"] == RIGHT for row in answerable) / max(1, len(answerable)),
        "asked": sum(row["by_init"] == ASKED for row in rows) / len(rows),
        "missed": sum(row["by_init"] == "missed" for row in rows) / len(rows),
        "refused": sum(row["by_init"] == REFUSED for row in rows) / len(rows),
        "refused_of_answerable": sum(row["by_init"] == REFUSED for row in answerable) / max(1, len(answerable)),
        "refused_without_a_file": sum(row["by_init"] == REFUSED and row["names_file"] == "False" for row in rows),
        "wrong_by_init": sum(row["by_init"] == WRONG for row in rows),
        "wrong_by_any_way": len(silent),
    }


def main() -> None:
    """Judge a set, print the tables, and write them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--set", choices=SETS, default="design")
    parser.add_argument("--seeds", type=int, nargs="+", help="these alone")
    parser.add_argument("--json", type=Path, metavar="FILE")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="keep the files of each logger")
    parser.add_argument("--quick", action="store_true", help="every sixth logger")
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args()
    seeds = options.seeds or list(SETS[options.set])[:: 6 if options.quick else 1]
    with tempfile.TemporaryDirectory() as scratch, ProcessPoolExecutor(options.processes, get_context("spawn")) as pool:
        folder = str((options.keep or Path(scratch)).resolve())
        rows = list(pool.map(judged, seeds, [folder] * len(seeds)))
    print_table(
        "what came of each logger", [{key: value for key, value in row.items() if key != "details"} for row in rows]
    )
    for row in rows:
        for text in row["details"]:
            print(f"{row['seed']:04d} {row['format']} {' '.join(text.split())[:400]}")
    counts = Counter((row["format"], row["by_init"]) for row in rows)
    print_table(
        "by format",
        [{"format": form, "by_init": word, "loggers": count} for (form, word), count in sorted(counts.items())],
    )
    print_table("totals", [totals(rows)])
    print(json.dumps(totals(rows)))
    write_json(
        options.json, {"set": {"name": options.set, "seeds": len(seeds)}, "totals": totals(rows), "loggers": rows}
    )


if __name__ == "__main__":
    main()
