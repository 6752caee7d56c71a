"""What factorising a body costs, against its unknowns: the law by which ``models.fe.solid.cost`` refuses meshes.

Run as ``python -m benchmarks.fe.cost [--quick] [--json FILE]``. Bodies of 27-node hexahedra, three displacements a
node, one end fixed: a cube, which fills in most, a bar of 1:1:6 and a plate of 5:5:1, each at several sizes, each in a
process of its own; the peak memory is the rise of the resident set from before the body was assembled. Beside it stands
SuperLU with minimum degree, as scipy has it, for the same matrix, where it is not too dear.
"""

from __future__ import annotations

import math
import multiprocessing
import resource
import time

import numpy as np

from benchmarks.common import Row, Tables, benchmark
from models.fe.extra import require_skfem
from models.fe.solid.elastic import ElasticBody

SHAPES: dict[str, tuple[int, int, int]] = {"cube": (1, 1, 1), "bar": (1, 1, 6), "plate": (5, 5, 1)}
UNKNOWNS = (2_000, 5_000, 10_000, 20_000, 34_000, 50_000, 72_000, 110_000)
SUPERLU_UNKNOWNS = 40_000
MODULUS, POISSON = 210e9, 0.3
SOLUTIONS = 100


def body_of(shape: tuple[int, int, int]) -> ElasticBody:
    """Return a body of ``shape`` cubes whose end z = 0 is fixed."""
    fem = require_skfem()
    mesh = fem.MeshHex2.from_mesh(fem.MeshHex1.init_tensor(*(np.arange(count + 1.0) for count in shape)))
    return ElasticBody(mesh.with_boundaries({"end": lambda x: x[2] < 1e-9}), MODULUS, POISSON, {"end": (0, 1, 2)})


def measure(shape: tuple[int, int, int]) -> Row:
    """Assemble and factorise one body; return its size and its cost."""
    body_of((1, 1, 1)).factorise()
    before, times = _resident(), [time.process_time()]
    body = body_of(shape)
    times.append(time.process_time())
    plan = body.plan
    times.append(time.process_time())
    body.factorise()
    times.append(time.process_time())
    # Before the solutions and SuperLU, which need more.
    peak = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    loads = np.zeros((body.nodes.size, SOLUTIONS))
    loads[np.arange(SOLUTIONS) + body.nodes.size - SOLUTIONS, np.arange(SOLUTIONS)] = 1.0
    began = time.process_time()
    body.solve(loads)
    seconds = (time.process_time() - began) / SOLUTIONS
    lu_seconds, lu_entries = _superlu(body) if body.unknowns < SUPERLU_UNKNOWNS else (None, None)
    return {
        "unknowns": body.unknowns,
        "matrix entries": int(body.stiffness.nnz),
        "factor entries": plan.entries,
        "peak entries": plan.peak_entries,
        "operations": plan.operations,
        "assembly s": times[1] - times[0],
        "plan s": times[2] - times[1],
        "factor s": times[3] - times[2],
        "s a solution": seconds,
        "peak bytes": peak,
        "SuperLU s": lu_seconds,
        "SuperLU entries": lu_entries,
    }


def _superlu(body: ElasticBody) -> tuple[float, int]:
    """Return processor time, s, and entries of both factors of SuperLU for a body."""
    from scipy.sparse.linalg import splu

    matrix = (body.admissible.T @ body.stiffness @ body.admissible).tocsc()
    began = time.process_time()
    factor = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    return time.process_time() - began, int(factor.L.nnz + factor.U.nnz)


def _resident() -> int:
    with open("/proc/self/status") as status:  # noqa: PTH123
        return 1024 * next(int(line.split()[1]) for line in status if line.startswith("VmRSS"))


@benchmark(__doc__ or "")
def main(quick: bool) -> Tables:
    """Measure all bodies."""
    rows: list[Row] = []
    context = multiprocessing.get_context("spawn")
    for name, ratio in SHAPES.items():
        for unknowns in UNKNOWNS[:3] if quick else UNKNOWNS:
            count = (unknowns / 24.0 / math.prod(ratio)) ** (1.0 / 3.0)
            shape = tuple(max(1, round(part * count)) for part in ratio)
            with context.Pool(1) as pool:
                rows.append({"body": name, **pool.apply(measure, (shape,))})
            print(rows[-1], flush=True)
    return {"factorisation": rows}
