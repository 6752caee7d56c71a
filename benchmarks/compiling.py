"""What compiling the kernels costs: ``spallwatch warmup`` with an empty cache, and once more.

python -m benchmarks.compiling [--quick] [--json FILE]

The parts run in two processes where there are two cores. Seconds of a core are those that numba's compiler had; the
elapsed time of a part has its imports in it, which is all that is left the second time.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from typing import Any

from benchmarks.common import Row, arguments, print_table, write_json

COSTLIEST = 12


def start(cache: str) -> dict[str, Any]:
    """Return what warmup says in a process of its own with its cache in some folder."""
    done = subprocess.run(
        [sys.executable, "-c", "from monitor.cli import main; main()", "warmup", "--quiet", "--json"],
        env={**os.environ, "NUMBA_CACHE_DIR": cache},
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(done.stdout)


def part_rows(starts: dict[str, dict[str, Any]]) -> list[Row]:
    """Return what each start cost, in all and by part."""
    rows: list[Row] = []
    for name, values in starts.items():
        parts = {"all": {**values, "kernels": len(values["kernels"])}, **values["parts"]}
        rows += [
            {
                "start": name,
                "part": part,
                "elapsed s": cost["elapsed_seconds"],
                "compiler s of a core": cost["compile_seconds"],
                "functions compiled": cost["kernels"],
            }
            for part, cost in parts.items()
        ]
    return rows


def main() -> None:
    """Print the tables and write the JSON file if one was asked for."""
    options = arguments("Compile time of the kernels.")
    with tempfile.TemporaryDirectory() as folder:
        starts = {name: start(folder) for name in ("first", "second")}
    kernels = list(starts["first"]["kernels"].items())
    shown = kernels if not options.quick else kernels[:COSTLIEST]
    tables = {
        "starts": part_rows(starts),
        "functions": [{"function": name, "compiler s of a core": seconds} for name, seconds in shown],
    }
    for title, rows in tables.items():
        print_table(title, rows)
    write_json(options.json, tables)


if __name__ == "__main__":
    main()
