# pyright: standard
"""Shape functions on the reference element, and where the nodes of a mesh are.

A mesh is one of scikit-fem: MeshHex1, MeshHex2, MeshTet1, MeshTet2 in space, MeshQuad1, MeshQuad2, MeshTri1, MeshTri2
in plane strain. Geometry and displacement may be of different order; scikit-fem is imported when a body is made.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from models.words.errors import WrongInputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

# scikit-fem has no types: its meshes, elements and tables of unknowns pass as these.
FeMesh = Any
FeElement = Any
FeDofs = Any

# Name of the reference domain: (element of order 1, of order 2).
_ELEMENTS = {
    "Hexahedral": ("ElementHex1", "ElementHex2"),
    "Tetrahedral": ("ElementTetP1", "ElementTetP2"),
    "Quadrilateral": ("ElementQuad1", "ElementQuad2"),
    "Triangular": ("ElementTriP1", "ElementTriP2"),
}
# Degree of the quadrature of the stiffness: full integration of an undistorted element, weights positive.
_DEGREES = {"Hexahedral": (3, 5), "Tetrahedral": (1, 5), "Quadrilateral": (3, 5), "Triangular": (1, 4)}


def displacement_element(mesh: FeMesh, order: int | None = None) -> FeElement:
    """Return the scikit-fem element of the displacement on a mesh: of the mesh's own order, or of order 1 or 2.

    Raises:
        WrongInputError: if the mesh is of no kind named in this module, or the order is not 1 or 2.
    """
    import skfem

    names = _ELEMENTS.get(str(mesh.elem.refdom.name))
    if names is None:
        raise WrongInputError(
            f"mesh: expected hexahedra, tetrahedra, quadrilaterals or triangles, got {mesh.elem.refdom.name}"
        )
    if order is None:
        return mesh.elem()
    if order not in (1, 2):
        raise WrongInputError(f"order of the displacement must be 1 or 2, got {order!r}")
    element: FeElement = getattr(skfem, names[order - 1])()
    return element


def quadrature(mesh: FeMesh, element: FeElement) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return points (dim, q) and weights (q,) on the reference element that integrate the stiffness."""
    from skfem.quadrature import get_quadrature

    linear, quadratic = _DEGREES[str(mesh.elem.refdom.name)]
    order = max(2 if len(e.doflocs) > len(e.refdom.p.T) else 1 for e in (element, mesh.elem()))
    degree = linear if order == 1 else quadratic
    points, weights = get_quadrature(mesh.elem.refdom, degree)
    return np.asarray(points, float), np.asarray(weights, float)


def shapes(element: FeElement, points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return values (functions, p) and gradients (functions, dim, p) at reference points (dim, p)."""
    count = len(element.doflocs)
    values, gradients = zip(*(element.lbasis(points, i) for i in range(count)), strict=True)
    full = [np.stack([np.broadcast_to(g, points.shape[1:]) for g in gradient]) for gradient in gradients]
    return np.stack([np.broadcast_to(v, points.shape[1:]) for v in values]).astype(float), np.stack(full).astype(float)


def mesh_dofs(mesh: FeMesh, element: FeElement) -> tuple[FeDofs, NDArray[np.float64]]:
    """Return scikit-fem's table of scalar unknowns of an element on a mesh, and their locations (dim, nodes), m."""
    if type(element) is type(mesh.elem()):
        return mesh.dofs, np.asarray(mesh.doflocs, float)
    from skfem import Basis

    basis: Any = Basis(mesh, element, intorder=1)
    return basis.dofs, np.asarray(basis.doflocs, float)


def boundary_facets(mesh: FeMesh, name: str) -> NDArray[np.int64]:
    """Return the indices of the facets of a named boundary.

    Raises:
        WrongInputError: if the mesh has no boundary of that name; the message lists those that it has.
    """
    known: dict[str, Any] = dict(mesh.boundaries or {})
    if name not in known:
        raise WrongInputError(f"mesh: no boundary {name!r}; it has {', '.join(sorted(known)) or 'none'}")
    return np.asarray(known[name], np.int64)
