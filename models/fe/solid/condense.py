"""Contact cells of the tangent plane, and the compliance of a body under uniform pressure on each of them.

The pressure p_m is constant on cell m, a rectangle of the tangent plane (x along rolling, z along the shaft), so that
both bodies carry the same cells whatever their meshes, the force along the contact normal y is sum A_m p_m exactly, and
a uniform pressure passes through unequal meshes (patch test). It acts at right angles to the surface y = h(x, z) in
which the bodies touch: b_m = -+ integral over the cell of N (-dh/dx, 1, -dh/dz) dx dz. The same vector reads how far
the surface recedes along y at fixed x and z. By default h is flat, as in Hertz's theory; where the contact is long
against the radii (a groove's ellipse with a / R = 0.5) the slope of the common surface matters: the mean of both
bodies' for equal moduli, as both yield alike; that of a rigid one where one is rigid.

C_mn = b_m' K^-1 b_n, m^3/Pa: what the surface of cell m yields, integrated over it, per pressure on cell n. It is
symmetric and positive semi-definite; it is singular where there are more cells than the trace of the displacement can
tell apart (cells finer than the facets), and then the pressure is not unique, but force and approach are.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from models.fe.solid.elastic import FeError
from models.fe.solid.sparse import sparse_matrix
from models.fe.solid.surface import Pieces, cut_facets, piece_points, surface_values

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from models.fe.solid.elastic import ElasticBody
    from models.fe.solid.sparse import SparseMatrix

    # Values at places (x, z) of the tangent plane, m, of any one shape.
    OverPlane = Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]
    # Slopes (dy/dx, dy/dz) at places (x, z) of the tangent plane, m, shapes (p,).
    Slope = Callable[[NDArray[np.float64], NDArray[np.float64]], tuple[NDArray[np.float64], NDArray[np.float64]]]

# A cell whose covered area differs from its own by more than this share reaches beyond the surface.
COVER_TOLERANCE = 1e-6
_GAUSS = np.polynomial.legendre.leggauss(4)


@dataclass(frozen=True)
class ContactFrame:
    """Where a contact is on a body.

    Attributes:
        origin: the point of the contact, m, shape (dim,).
        axes: rows are the unit vectors of rolling (x), of the contact normal (y, towards the contact from the middle of
            the body or of the ring; the outward sense is found from the surface) and, in space, along the shaft (z);
            shape (dim, dim).
    """

    origin: NDArray[np.float64]
    axes: NDArray[np.float64]

    @classmethod
    def aligned(cls, dim: int = 3) -> ContactFrame:
        """Return the frame along the axes of the mesh."""
        return cls(np.zeros(dim), np.eye(dim))

    @classmethod
    def rotated(cls, angle: float) -> ContactFrame:
        """Return the frame of a contact at an angle about the shaft axis z, rad, from y towards x.

        The contact normal is (sin angle, cos angle, 0), rolling is along (cos angle, -sin angle, 0):
        tangential x counts from the point of the contact, along the race towards larger angles.
        """
        s, c = np.sin(angle), np.cos(angle)
        return cls(np.zeros(3), np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]))


@dataclass(frozen=True)
class ContactCells:
    """Rectangles of the tangent plane that carry a uniform pressure each, m; all arrays have shape (cells,).

    In plane strain z0 = 0 and z1 = 1 m.
    """

    x0: NDArray[np.float64]
    x1: NDArray[np.float64]
    z0: NDArray[np.float64]
    z1: NDArray[np.float64]

    @classmethod
    def grid(cls, x: NDArray[np.float64], z: NDArray[np.float64] | None = None) -> ContactCells:
        """Return the cells between edges x and z, increasing, m: z runs fastest; without z one metre of plane strain.

        Raises:
            FeError: if edges do not increase.
        """
        along = np.array([0.0, 1.0]) if z is None else np.asarray(z, float)
        across = np.asarray(x, float)
        for name, edges in (("x", across), ("z", along)):
            if len(edges) < 2 or not np.all(np.diff(edges) > 0.0):
                raise FeError(f"contact cells: edges {name} must increase, got {edges.tolist()}")
        i, k = (index.ravel() for index in np.meshgrid(range(len(across) - 1), range(len(along) - 1), indexing="ij"))
        return cls(across[i], across[i + 1], along[k], along[k + 1])

    def mean(self, function: OverPlane) -> NDArray[np.float64]:
        """Return the mean of a function of the tangent plane over each cell, shape (cells,), by four Gauss points."""
        points, weights = 0.5 + 0.5 * _GAUSS[0], 0.5 * _GAUSS[1]
        x = (self.x0 + np.multiply.outer(points, self.x1 - self.x0))[:, None]
        z = (self.z0 + np.multiply.outer(points, self.z1 - self.z0))[None]
        values = function(*np.broadcast_arrays(x, z))
        return np.asarray(np.einsum("i,k,ikm->m", weights, weights, values), dtype=np.float64)

    @classmethod
    def about_nodes(
        cls, x: NDArray[np.float64], z: NDArray[np.float64] | None = None, *, order: int = 2
    ) -> ContactCells:
        """Return one cell about each node of the facets between lines x and z, m: the cells to take.

        Their edges are at a quarter and three quarters of each facet of order 2 (in its middle for order 1), the first
        and last at the ends. There are as many pressures as the surface can tell apart. Cells that halve each facet are
        as many, but the pressure that alternates between them makes no load, and is found everywhere
        (tests/models/fe/test_hertz.py).
        """
        return cls.grid(_about(np.asarray(x, float), order), None if z is None else _about(np.asarray(z, float), order))

    def __len__(self) -> int:
        """Return the number of cells."""
        return len(self.x0)

    @property
    def area(self) -> NDArray[np.float64]:
        """Areas, m^2."""
        return (self.x1 - self.x0) * (self.z1 - self.z0)

    @property
    def centre(self) -> NDArray[np.float64]:
        """Centres (x, z), m, shape (2, cells)."""
        return np.stack((0.5 * (self.x0 + self.x1), 0.5 * (self.z0 + self.z1)))


def _about(lines: NDArray[np.float64], order: int) -> NDArray[np.float64]:
    """Return the edges of cells about the nodes of facets between lines."""
    width = np.diff(lines)
    shares = (0.25, 0.75) if order == 2 else (0.5,)
    inner = np.stack([lines[:-1] + share * width for share in shares], axis=1)
    return np.concatenate((lines[:1], inner.ravel(), lines[-1:]))


def cell_loads(
    body: ElasticBody,
    surface: str,
    cells: ContactCells,
    frame: ContactFrame | None = None,
    slope: Slope | None = None,
) -> SparseMatrix:
    """Return the loads of unit pressures on the cells, N/Pa, sparse (dim * nodes, cells).

    The same matrix reads displacements: its transpose times a displacement is how far the surface of each cell gives
    way along the contact normal, integrated over it, m^3; divided by the area it is the mean, m.

    Args:
        surface: boundary of the mesh on which the cells lie; its facets may be larger or smaller than the cells and of
            any shape, those that face away from the contact normal are left out.
        frame: where the contact is; by default along the axes of the mesh.
        slope: of the surface in which both bodies touch, in the frame: (dy/dx, dy/dz) at (x, z), arrays in m. By
            default it is flat. Give both bodies the same surface (each in its own frame): for equal moduli the mean of
            both undeformed ones.

    Raises:
        FeError: if cells reach beyond the surface, or it faces both ways under a cell.
    """
    frame = ContactFrame.aligned(body.dim) if frame is None else frame
    pieces, outward = cut_facets(body, surface, cells, frame)
    _refuse_uncovered(pieces, cells, surface)
    points = piece_points(pieces)
    nodes, values = surface_values(body, points, frame)
    weighted = values * points.weight
    normal = np.repeat(frame.axes[1][:, None], len(points.weight), axis=1)
    if slope is not None:
        along = points.place[:, 1] if body.dim == 3 else np.zeros(len(points.weight))
        tilt = slope(points.place[:, 0], along)
        for axis, part in zip((0, 2)[: body.dim - 1], tilt, strict=False):
            normal -= np.multiply.outer(frame.axes[axis], np.asarray(part))
    rows = np.stack([body.dim * nodes + i for i in range(body.dim)])
    entries = np.stack([-outward * normal[i] * weighted for i in range(body.dim)])
    columns = np.broadcast_to(points.cell, rows.shape)
    loads = sparse_matrix(entries.ravel(), rows.ravel(), columns.ravel(), (body.nodes.size, len(cells)))
    loads.eliminate_zeros()
    return loads


def compliance(
    body: ElasticBody,
    surface: str,
    cells: ContactCells,
    frame: ContactFrame | None = None,
    slope: Slope | None = None,
) -> NDArray[np.float64]:
    """Return C of one body, m^3/Pa, shape (cells, cells), symmetric; arguments and errors as of :func:`cell_loads`."""
    return body.flexibility(cell_loads(body, surface, cells, frame, slope))


def _refuse_uncovered(pieces: Pieces, cells: ContactCells, surface: str) -> None:
    """Raise where the surface does not cover every cell exactly once."""
    covered = np.bincount(pieces.cell, pieces.area, minlength=len(cells)) / cells.area
    wrong = np.nonzero(np.abs(covered - 1.0) > COVER_TOLERANCE)[0]
    if not len(wrong):
        return
    m = int(wrong[np.argmax(np.abs(covered[wrong] - 1.0))])
    raise FeError(
        f"contact cells: surface {surface!r} covers {covered[m]:.6f} of cell {m} (x {cells.x0[m]:.6g} to"
        f" {cells.x1[m]:.6g} m, z {cells.z0[m]:.6g} to {cells.z1[m]:.6g} m), expected 1; {len(wrong)} cells are such"
    )
