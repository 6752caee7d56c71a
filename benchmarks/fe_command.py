"""``spallwatch bearing --fe`` as a user runs it: processor time, memory and results of each mesh, first and kept.

Run as ``python -m benchmarks.fe_command [--quick] [--json FILE]``. Each row is a process with an empty cache, then
another one with what the first has kept; both include the start of Python. ``--quick``: coarse meshes alone.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from benchmarks.common import Row, arguments, print_table, write_json

CASES = (("NU 202 ECP", 2500.0), ("6210", 2500.0))
MESHES = ("coarse", "default", "fine")
_MAIN = "from monitor.cli import main; main()"


def run(designation: str, load: float, mesh: str, cache: Path) -> tuple[dict[str, Any], float]:
    """Return the answer of finite elements, and the processor time of the process, s."""
    words = ["bearing", designation, "--load-newton", str(load), "--fe", "--fe-mesh", mesh, "--json"]
    before = os.times()
    done = subprocess.run(
        [sys.executable, "-c", _MAIN, *words],
        env=os.environ | {"XDG_CACHE_HOME": str(cache)},
        stdout=subprocess.PIPE,
        check=True,
    )
    after = os.times()
    seconds = after.children_user + after.children_system - before.children_user - before.children_system
    return json.loads(done.stdout)["fe"], seconds


def measure(designation: str, load: float, mesh: str) -> Row:
    """Run the command twice; return what it cost and what it said."""
    with tempfile.TemporaryDirectory() as folder:
        first, seconds = run(designation, load, mesh, Path(folder))
        again, later = run(designation, load, mesh, Path(folder))
    if not again["from_cache"] or again["k_yy_newton_per_m"] != first["k_yy_newton_per_m"]:
        raise RuntimeError(f"{designation}, {mesh}: the kept result is not that of the first run")
    k_c = next(value for name, value in first.items() if name.startswith("k_c_newton"))
    return {
        "bearing": designation,
        "load_newton": load,
        "mesh": mesh,
        "largest body": max(first["unknowns"].values()),
        "cpu_s": seconds,
        "kept_cpu_s": later,
        "peak_gb": first["memory_peak_gb"],
        "mesh_error_percent": first["mesh_error_percent"],
        "k_c": k_c,
        "k_xx_mn_per_m": 1e-6 * first["k_xx_newton_per_m"],
        "k_yy_mn_per_m": 1e-6 * first["k_yy_newton_per_m"],
        "status": first["status"],
    }


def main() -> None:
    """Measure all cases."""
    options = arguments(__doc__ or "")
    meshes = MESHES[:1] if options.quick else MESHES
    rows = [measure(*case, mesh) for case in CASES for mesh in meshes]
    print_table("bearing --fe", rows)
    write_json(options.json, {"command": rows})


if __name__ == "__main__":
    main()
