"""What the factorisation of a body costs, against its unknowns: the law of ``models.fe.cost``.

Run as ``python -m benchmarks.fe_cost [--quick] [--json FILE]``. Bodies of 27-node hexahedra, three displacements a
node, one end fixed: a cube, which fills in most, a bar of 1:1:6 and a plate of 5:5:1, each at several sizes. Each is
made and factorised in a process of its own. "planned" are the entries at the peak that the plan of the factorisation
says before it begins, by which meshes are refused; "peak" is the rise of the resident set over all of it: assembly,
matrix, factor and work space.
"""

from __future__ import annotations

import math
import multiprocessing
import resource
import time

import numpy as np

from benchmarks.common import Row, arguments, print_table, write_json
from models.fe.elastic import ElasticBody
from models.fe.extra import require_skfem

SHAPES: dict[str, tuple[int, int, int]] = {"cube": (1, 1, 1), "bar": (1, 1, 6), "plate": (5, 5, 1)}
UNKNOWNS = (2_000, 5_000, 10_000, 20_000, 34_000, 50_000, 72_000)
MODULUS, POISSON = 210e9, 0.3


def measure(shape: tuple[int, int, int]) -> Row:
    """Make and factorise a body of ``shape`` cubes; return its size and its cost."""
    fem = require_skfem()
    grid = fem.MeshHex.init_tensor(*(np.linspace(0.0, count, count + 1) for count in shape))
    mesh = fem.MeshHex2.from_mesh(grid).with_boundaries({"end": lambda x: x[2] < 1e-9})
    # Loads what is loaded once: the libraries of sparse matrices and of the factorisation.
    ElasticBody(
        fem.MeshHex2().with_boundaries({"end": lambda x: x[2] < 1e-9}), MODULUS, POISSON, {"end": (0, 1, 2)}
    ).factorise()
    before = _resident()
    began = time.process_time()
    body = ElasticBody(mesh, MODULUS, POISSON, {"end": (0, 1, 2)})
    assembled = time.process_time()
    planned = body.plan
    decided = time.process_time()
    body.factorise()
    done = time.process_time()
    load = np.zeros((3 * body.nodes.shape[1], 64))
    load[-3:] = 1.0
    body.solve(load)
    return {
        "unknowns": body.unknowns,
        "entries": planned.entries,
        "planned": planned.peak_entries,
        "Gflop": 1e-9 * planned.operations,
        "s to assemble": assembled - began,
        "s to plan": decided - assembled,
        "s to factorise": done - decided,
        "s a solution": (time.process_time() - done) / 64,
        "peak bytes": 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before,
    }


def _resident() -> int:
    with open("/proc/self/status") as status:  # noqa: PTH123
        return 1024 * next(int(line.split()[1]) for line in status if line.startswith("VmRSS"))


def main() -> None:
    """Measure all bodies."""
    options = arguments(__doc__ or "")
    rows: list[Row] = []
    context = multiprocessing.get_context("spawn")
    for name, ratio in SHAPES.items():
        for unknowns in UNKNOWNS[:3] if options.quick else UNKNOWNS:
            count = (unknowns / 24.0 / math.prod(ratio)) ** (1.0 / 3.0)
            shape = tuple(max(1, round(part * count)) for part in ratio)
            with context.Pool(1) as pool:
                rows.append({"body": name, **pool.apply(measure, (shape,))})
    print_table("Factorisation", rows)
    write_json(options.json, {"factorisation": rows})


if __name__ == "__main__":
    main()
