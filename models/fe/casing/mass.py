"""Consistent mass matrix of a body of hexahedra."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from models.fe.solid.elastic import FeError, jacobians
from models.fe.solid.shape import quadrature, shapes
from models.fe.solid.sparse import SparseMatrix, sparse_matrix

if TYPE_CHECKING:
    from models.fe.solid.elastic import ElasticBody

_ELEMENTS_AT_ONCE = 256


def mass_matrix(body: ElasticBody, density: float) -> SparseMatrix:
    """Return the mass matrix, kg, sparse (dim * nodes, dim * nodes), of a density, kg/m3.

    The points of the stiffness integrate it exactly for cells with parallel faces.

    Raises:
        FeError: the cells are tetrahedra or triangles, for which those points are too few.
    """
    if str(body.mesh.elem.refdom.name) not in ("Hexahedral", "Quadrilateral"):
        raise FeError(f"{body.name}: masses need hexahedra or quadrilaterals, got {body.mesh.elem.refdom.name}")
    points, weights = quadrature(body.mesh, body.element)
    values, _ = shapes(body.element, points)
    table = np.asarray(body.dofs.element_dofs, np.int64)
    functions, elements = table.shape
    count = body.nodes.shape[1]
    total = sparse_matrix(np.zeros(0), np.zeros(0, int), np.zeros(0, int), (count, count))
    for start in range(0, elements, _ELEMENTS_AT_ONCE):
        chunk = np.arange(start, min(start + _ELEMENTS_AT_ONCE, elements))
        _, volume = jacobians(body.mesh, chunk, points)
        blocks = density * np.einsum("aq,bq,eq->eab", values, values, volume * weights, optimize=True)
        rows = table[:, chunk].T
        i, j = np.repeat(rows, functions, axis=1).ravel(), np.tile(rows, (1, functions)).ravel()
        total = total + sparse_matrix(blocks.ravel(), i, j, (count, count))
    # The same for each component: node and component to the unknown dim * node + component.
    entries = total.tocoo()
    values_, row, column = (np.asarray(part) for part in (entries.data, entries.row, entries.col))
    parts = [(values_, body.dim * row + k, body.dim * column + k) for k in range(body.dim)]
    stacked = [np.concatenate([part[n] for part in parts]) for n in range(3)]
    return sparse_matrix(stacked[0], stacked[1], stacked[2], (body.dim * count, body.dim * count))
