"""The outside of a casing as a surface that radiates: plane quadrangles and the mean normal motion of each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from models.fe.casing.shape import SIDES
from models.fe.solid.sparse import sparse_matrix
from models.fe.solid.traction import boundary_points

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.fe.casing.model import Casing

    Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RadiatingSurface:
    """Elements of the outside, in the axes of a half space: the casing's (x, y, z) is (x, -z, y) here.

    Attributes:
        corners: m, shape (corners, 3); the underside of the casing is the plane z = 0.
        elements: corners of each, anticlockwise from outside, shape (elements, 4).
        columns: name -> column b of the mean normal displacement of an element, outwards, shape (unknowns,) each; the
            names are "0", "1", ... in the order of the elements.
    """

    corners: Array
    elements: NDArray[np.int64]
    columns: dict[str, Array]


def radiating_surface(casing: Casing) -> RadiatingSurface:
    """Return the outer sides of a casing but its underside, which stands on a plane.

    The inside of open bores is left out, so that the surface is closed only where seats have covers and sides walls.
    """
    body = casing.body
    facets = np.asarray(body.mesh.facets, np.int64)
    corners: list[NDArray[np.int64]] = []
    normals: list[Array] = []
    columns: list[Array] = []
    for side in (side for side in SIDES if side != "y0"):
        chosen = np.asarray(body.mesh.boundaries[side], np.int64)
        if not chosen.size:
            continue
        points = boundary_points(body, side)
        corners.append(facets[:, chosen].T)
        normals.append(points.normals.mean(axis=2).T)
        area = points.weights.sum(axis=1)
        shares = np.einsum("afp,ifp,fp->afi", points.values, points.normals, points.weights) / area[:, None]
        rows = 3 * points.nodes[:, :, None] + np.arange(3)
        places = np.broadcast_to(np.arange(len(chosen))[:, None], rows.shape[1:])
        where = np.broadcast_to(places, rows.shape)
        weights = sparse_matrix(shares.ravel(), rows.ravel(), where.ravel(), (3 * body.nodes.shape[1], len(chosen)))
        columns.append(np.asarray((casing.transform.T @ weights).toarray(), np.float64))
    used, numbers = np.unique(np.concatenate(corners), return_inverse=True)
    places = np.asarray(body.mesh.p, np.float64)[:, used].T
    elements = _anticlockwise(places, numbers.reshape(-1, 4), np.concatenate(normals))
    turned = np.stack((places[:, 0], -places[:, 2], places[:, 1]), axis=1)
    names = [str(number) for number in range(len(elements))]
    return RadiatingSurface(turned, elements, dict(zip(names, np.concatenate(columns, axis=1).T, strict=True)))


def _anticlockwise(places: Array, elements: NDArray[np.int64], normals: Array) -> NDArray[np.int64]:
    """Return the corners of elements in order round their middles, anticlockwise about the normals."""
    offset = places[elements] - places[elements].mean(axis=1, keepdims=True)
    across = np.cross(normals, offset[:, 0])
    angle = np.arctan2(np.einsum("eci,ei->ec", offset, across), np.einsum("eci,ei->ec", offset, offset[:, 0]))
    return np.take_along_axis(elements, np.argsort(angle, axis=1), axis=1)
