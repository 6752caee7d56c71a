"""What the factorisation of a body costs, against its unknowns: the law by which ``models.fe.cost`` refuses meshes.

Run as ``python -m benchmarks.fe_cost [--quick] [--json FILE]``. Bodies of 27-node hexahedra, three displacements a
node, one end fixed: a cube, which fills in most, a bar of 1:1:6 and a plate of 5:5:1, each at several sizes. Each is
factorised as ``models.fe.elastic`` does, in a process of its own; its peak memory is the rise of the resident set from
before the matrix: matrix, factors and work space.
"""

from __future__ import annotations

import itertools
import math
import multiprocessing
import resource
import time
from typing import Any

import numpy as np
import scipy.sparse as sparse

from benchmarks.common import Row, arguments, print_table, write_json
from models.fe.extra import require_skfem

SHAPES: dict[str, tuple[int, int, int]] = {"cube": (1, 1, 1), "bar": (1, 1, 6), "plate": (5, 5, 1)}
UNKNOWNS = (2_000, 5_000, 10_000, 20_000, 34_000, 50_000, 72_000)
MODULUS, POISSON = 210e9, 0.3


def element_matrix() -> Any:
    """Return the stiffness of one cube of 27 nodes, shape (81, 81), and the places of its nodes in a 3 x 3 x 3 grid."""
    fem = require_skfem()
    from skfem.models.elasticity import lame_parameters, linear_elasticity

    mesh = fem.MeshHex.init_tensor(*3 * [np.array([0.0, 1.0])])
    basis = fem.Basis(mesh, fem.ElementVector(fem.ElementHex2()))
    matrix = linear_elasticity(*lame_parameters(MODULUS, POISSON)).assemble(basis).toarray()
    places = np.rint(2.0 * basis.doflocs).astype(int)
    direction = np.empty(81, int)
    # The three displacements of a node follow each other in the lists of unknowns.
    dofs = basis.dofs
    for part in (dofs.nodal_dofs, dofs.edge_dofs, dofs.facet_dofs, dofs.interior_dofs):
        direction[part] = np.arange(3)[:, None]
    return matrix, places, direction


def body_matrix(shape: tuple[int, int, int]) -> Any:
    """Return the stiffness of a body of ``shape`` cubes whose end z = 0 is fixed."""
    matrix, places, direction = element_matrix()
    nodes = [2 * count + 1 for count in shape]
    corner = np.array(list(itertools.product(*(range(count) for count in shape)))).T
    at = 2 * corner[:, :, None] + places[:, None, :]
    unknowns = 3 * ((at[2] * nodes[1] + at[1]) * nodes[0] + at[0]) + direction
    rows = np.repeat(unknowns, 81, axis=1).ravel()
    columns = np.tile(unknowns, (1, 81)).ravel()
    size, fixed = 3 * math.prod(nodes), 3 * nodes[0] * nodes[1]
    values = np.tile(matrix.ravel(), corner.shape[1])
    return sparse.coo_matrix((values, (rows, columns)), (size, size)).tocsc()[fixed:, fixed:]


def measure(shape: tuple[int, int, int]) -> Row:
    """Factorise one body; return its size and its cost."""
    from scipy.sparse.linalg import splu

    matrix = body_matrix(shape)
    size = matrix.shape[0]
    before = _resident()
    began, timed = time.perf_counter(), time.process_time()
    factor = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    seconds, wall = time.process_time() - timed, time.perf_counter() - began
    peak = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    load = np.ones(size)
    began_solve = time.process_time()
    factor.solve(load)
    return {
        "unknowns": size,
        "matrix entries": matrix.nnz,
        "factor entries": factor.L.nnz + factor.U.nnz,
        "s": seconds,
        "s wall": wall,
        "s a solution": time.process_time() - began_solve,
        "peak bytes": peak - before + matrix.data.nbytes + matrix.indices.nbytes,
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
            print(rows[-1], flush=True)
    print_table("Factorisation", rows)
    write_json(options.json, {"factorisation": rows})


if __name__ == "__main__":
    main()
