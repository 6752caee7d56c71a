"""What a first answer costs in compiling: wall and processor time of a new process with an empty cache, and the next.

Run as ``python -m benchmarks.compiling [--baseline COMMIT] [--part NAME ...] [--json FILE]``. A part is one of
``models.warmup.PARTS`` (one settled scene). The tables: times of a process that has to compile, and of one that finds
all compiled, imports included, of this tree and of the commit; the dearest functions of this tree, in seconds of the
compiler without those that they call. Processes run one after the other; beside other work both times grow.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from benchmarks.common import Row, print_table, write_json
from benchmarks.regression.trees import ROOT, baseline_tree, full_hash

BASELINE = "59899cc63"
_DEAREST = 20
_RUN = """
import json, sys
from models.warmup import compile_part
kernels = {}
for name in sys.argv[1:]:
    for kernel, seconds in compile_part(name).kernels.items():
        kernels[kernel] = kernels.get(kernel, 0.0) + seconds
print(json.dumps(kernels))
"""


def run(tree: Path, parts: list[str], compiled: Path) -> tuple[dict[str, float], float, float]:
    """Run parts in a process of a tree; return its compiler's seconds by function, wall and processor time, s."""
    environment = {**os.environ, "PYTHONPATH": str(tree), "NUMBA_CACHE_DIR": str(compiled)}
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    command = [sys.executable, "-c", _RUN, *parts]
    done = subprocess.run(command, cwd=tree, env=environment, check=True, stdout=subprocess.PIPE, text=True)
    wall, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    return json.loads(done.stdout), wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def measure(name: str, tree: Path, parts: list[str]) -> tuple[Row, dict[str, float]]:
    """Return the row of a tree, and its compiler's seconds by function."""
    with tempfile.TemporaryDirectory(prefix="compiling-") as folder:
        kernels, wall, processor = run(tree, parts, Path(folder))
        _, next_wall, next_processor = run(tree, parts, Path(folder))
    row: dict[str, Any] = {"tree": name, "functions": len(kernels), "wall s": wall, "processor s": processor}
    return row | {"next: wall s": next_wall, "processor s, next": next_processor}, kernels


def main() -> None:
    """Measure both trees and print."""
    parser = argparse.ArgumentParser(description="what a first answer costs in compiling")
    parser.add_argument("--baseline", default=BASELINE, metavar="COMMIT", help="compare with this commit; '' with none")
    parser.add_argument("--part", nargs="+", default=["one settled scene"], metavar="NAME", help="parts of warmup")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the same figures to this file")
    options = parser.parse_args()
    rows: list[Row] = []
    if options.baseline:
        commit = full_hash(options.baseline)
        with (
            tempfile.TemporaryDirectory(prefix="compiling-") as folder,
            baseline_tree(commit, Path(folder)) as tree,
        ):
            rows.append(measure(commit[:12], tree.root, options.part)[0])
    row, kernels = measure("present", ROOT, options.part)
    rows.append(row)
    dearest = sorted(kernels.items(), key=lambda item: -item[1])[:_DEAREST]
    print_table("first answer and next", rows)
    print_table("dearest functions", [{"function": name, "s": seconds} for name, seconds in dearest])
    write_json(options.json, {"first": rows, "functions": kernels})


if __name__ == "__main__":
    main()
