"""Small bodies that tests of finite elements share."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.fe.solid.elastic import ElasticBody

skfem: Any = pytest.importorskip("skfem", reason="needs the extra fe (scikit-fem)")

MODULUS, POISSON = 210e9, 0.3
KINDS = ("MeshHex1", "MeshHex2", "MeshTet1", "MeshTet2", "MeshQuad1", "MeshQuad2", "MeshTri1", "MeshTri2")


def unit_mesh(kind: str, refinements: int = 1) -> Any:
    """A square or cube of 1 m with the boundaries x0, y0, z0 and contact (y = 1)."""
    mesh = getattr(skfem, kind.replace("2", "1"))().refined(refinements)
    return name_sides(mesh if kind.endswith("1") else getattr(skfem, kind).from_mesh(mesh))


def block_mesh(x: NDArray[np.float64], y: NDArray[np.float64], z: NDArray[np.float64] | None = None) -> Any:
    """A quadratic block between edges, contact at the largest y."""
    edges = (x, y) if z is None else (x, y, z)
    name = "MeshQuad" if z is None else "MeshHex"
    mesh = getattr(skfem, name + "1").init_tensor(*edges)
    return name_sides(getattr(skfem, name + "2").from_mesh(mesh))


def name_sides(mesh: Any) -> Any:
    low, high = mesh.doflocs.min(axis=1), mesh.doflocs.max(axis=1)
    size = 1e-9 * float((high - low).max())
    sides: dict[str, Any] = {
        f"{axis}0": lambda x, i=i: np.abs(x[i] - low[i]) < size for i, axis in enumerate("xyz"[: mesh.dim()])
    }
    return mesh.with_boundaries(sides | {"contact": lambda x: np.abs(x[1] - high[1]) < size})


def cut_free(mesh: Any, *, order: int | None = None) -> ElasticBody:
    """A body on three planes of symmetry, in which a uniform pressure makes a uniform stress."""
    from models.fe.solid.elastic import ElasticBody

    planes = {name: (i,) for i, name in enumerate(("x0", "y0", "z0")[: mesh.dim()])}
    return ElasticBody(mesh, MODULUS, POISSON, planes, order=order)
