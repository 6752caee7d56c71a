"""Integrals over a boundary of a body: loads of a traction, weights of a mean displacement.

The points are placed on the facets of the reference element and not sought from places in space, so that cells of any
shape are served.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from models.fe.solid.elastic import FeError
from models.fe.solid.shape import boundary_facets, shapes

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.fe.solid.elastic import ElasticBody

_POINTS = 4
_CORNERS = 4


@dataclass(frozen=True, eq=False)
class BoundaryPoints:
    """Points of integration on a boundary.

    Attributes:
        nodes: of the elements behind the facets, shape (functions, facets).
        values: of the shape functions, shape (functions, facets, points).
        places: m, shape (3, facets, points).
        normals: outward unit normals, shape (3, facets, points).
        weights: m2, shape (facets, points).
    """

    nodes: NDArray[np.int64]
    values: NDArray[np.float64]
    places: NDArray[np.float64]
    normals: NDArray[np.float64]
    weights: NDArray[np.float64]


def boundary_points(body: ElasticBody, name: str) -> BoundaryPoints:
    """Return the points of integration on a boundary: four Gauss points each way on every facet, or on a triangle six.

    Raises:
        FeError: the body is plane.
        WrongInputError: the mesh has no boundary of that name.
    """
    mesh: Any = body.mesh
    facets = boundary_facets(mesh, name)
    domain = mesh.elem.refdom
    if body.dim != 3:
        raise FeError(f"boundary {name!r}: integrals over it need a body in space, this one is plane")
    element = np.asarray(mesh.f2t)[0, facets]
    local = np.argmax(np.asarray(mesh.t2f)[:, element] == facets, axis=0)
    nodes = np.asarray(body.dofs.element_dofs)[:, element].astype(np.int64)
    corners = np.asarray(mesh.doflocs, dtype=np.float64)[:, np.asarray(mesh.dofs.element_dofs)[:, element]]
    s, t, share = _square_rule() if len(domain.facets[0]) == _CORNERS else _triangle_rule()
    values = np.empty((len(nodes), len(facets), len(s)))
    places, edges = np.empty((3, len(facets), len(s))), np.empty((2, 3, len(facets), len(s)))
    for number in np.unique(local):
        these = local == number
        face = np.asarray(domain.p, dtype=np.float64).T[np.asarray(domain.facets[number])]
        along = np.stack((face[1] - face[0], face[-1] - face[0]))
        reference = face[0][:, None] + along[0][:, None] * s + along[1][:, None] * t
        values[:, these] = shapes(body.element, reference)[0][:, None, :]
        curved, gradients = shapes(mesh.elem(), reference)
        places[:, these] = np.einsum("iaf,ap->ifp", corners[:, :, these], curved)
        edges[:, :, these] = np.einsum("iaf,akp,ek->eifp", corners[:, :, these], gradients, along)
    area = np.cross(edges[0], edges[1], axis=0)
    size = np.linalg.norm(area, axis=0)
    middle = corners.mean(axis=1)
    outward = np.sign(np.sum(area * (places - middle[:, :, None]), axis=0))
    return BoundaryPoints(nodes, values, places, outward * area / size, size * share)


def _square_rule() -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return places (s, t) and weights on the unit square, degree 7."""
    line, weights = np.polynomial.legendre.leggauss(_POINTS)
    s, t = (grid.ravel() for grid in np.meshgrid(0.5 + 0.5 * line, 0.5 + 0.5 * line))
    return s, t, 0.25 * np.outer(weights, weights).ravel()


def _triangle_rule() -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return places (s, t) and weights on the unit triangle, degree 4 (Strang and Fix 1973)."""
    a, b, weight = 0.445948490915965, 0.091576213509771, 0.223381589678011
    s = np.array([a, a, 1.0 - 2.0 * a, b, b, 1.0 - 2.0 * b])
    t = np.array([a, 1.0 - 2.0 * a, a, b, 1.0 - 2.0 * b, b])
    return s, t, 0.5 * np.array([weight] * 3 + [1.0 / 3.0 - weight] * 3)


def traction_loads(body: ElasticBody, points: BoundaryPoints, traction: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the loads, N, shape (3 nodes,), of a traction, Pa, shape (3, facets, points)."""
    loads = np.zeros((body.nodes.shape[1], 3))
    for component in range(3):
        shares = np.einsum("afp,fp->af", points.values, traction[component] * points.weights)
        np.add.at(loads[:, component], points.nodes, shares)
    return loads.ravel()


def mean_weights(body: ElasticBody, points: BoundaryPoints, component: int) -> NDArray[np.float64]:
    """Return the weights, shape (3 nodes,), whose product with a displacement is its mean component over a boundary."""
    direction = np.zeros_like(points.places)
    direction[component] = 1.0 / float(np.sum(points.weights))
    return traction_loads(body, points, direction)
