"""The radiating surface: a closed mesh of triangles and flat quadrangles, or one that is open at the plane z = 0."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from models.gears.sound.panels import Panels
from models.words.errors import WrongInputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

_FLAT = 1e-3
"""Distance of a quadrangle's corners from its mean plane, by the longest edge, up to which it counts as flat."""
_ON_PLANE = 1e-9
"""Height that counts as zero, by the size of the surface."""


class SurfaceError(WrongInputError):
    """A surface that encloses no body, or has elements that cannot be used; the message names the first of them."""


@dataclass(frozen=True, eq=False)
class Surface:
    """The boundary of a body in air.

    Attributes:
        vertices: (vertices, 3) m.
        elements: (elements, 4) vertices of each, counterclockwise seen from the air; a triangle repeats its last one.
        over_plane: whether z = 0 is a rigid plane. The surface lies above it, and where it touches it is open: an
            edge that only one element has must lie on the plane.
    """

    vertices: NDArray[np.float64]
    elements: NDArray[np.int64]
    over_plane: bool = False

    def __post_init__(self) -> None:
        """Raise a SurfaceError that names the element at fault."""
        vertices, elements = np.asarray(self.vertices), np.asarray(self.elements)
        if vertices.ndim != 2 or vertices.shape[1] != 3 or not np.all(np.isfinite(vertices)):
            raise SurfaceError(f"vertices must be finite, of shape (vertices, 3), got {vertices.shape}")
        if elements.ndim != 2 or elements.shape[1] != 4 or not len(elements):
            raise SurfaceError(f"elements must have the shape (elements, 4), got {elements.shape}")
        if elements.min() < 0 or elements.max() >= len(vertices):
            raise SurfaceError(f"elements must name vertices 0 to {len(vertices) - 1}, got {int(elements.max())}")
        self._check_elements()
        self._check_closed()
        volume = float(np.sum(self.panels.area[:, None] * self.panels.normal * self.panels.middle)) / 3.0
        if volume <= 0.0:
            raise SurfaceError("elements must run counterclockwise as seen from the air: the volume is negative")

    @cached_property
    def panels(self) -> Panels:
        """The elements as flat panels."""
        return Panels(self.vertices[self.elements])

    @property
    def middle(self) -> NDArray[np.float64]:
        """Centroids of the elements, (elements, 3) m: where a velocity is one value an element."""
        return self.panels.middle

    @property
    def normal(self) -> NDArray[np.float64]:
        """Unit normals into the air, (elements, 3)."""
        return self.panels.normal

    @property
    def area(self) -> NDArray[np.float64]:
        """Areas of the elements, m2."""
        return self.panels.area

    def __len__(self) -> int:
        """Return the number of elements."""
        return len(self.elements)

    def _check_elements(self) -> None:
        panels = self.panels
        longest = panels.longest
        for element in np.flatnonzero(panels.area < 1e-6 * longest**2)[:1]:
            raise SurfaceError(f"element {element} has no area: vertices {self.elements[element].tolist()}")
        warp = np.abs(np.einsum("px,px->p", panels.corners[:, 1] - panels.corners[:, 0], panels.normal))
        for element in np.flatnonzero((warp > _FLAT * longest) & ~panels.triangles)[:1]:
            raise SurfaceError(f"element {element} is not flat: split it into two triangles")
        if not self.over_plane:
            return
        height = panels.corners[..., 2]
        zero = _ON_PLANE * float(np.ptp(panels.corners))
        for element in np.flatnonzero(height.min(axis=1) < -zero)[:1]:
            raise SurfaceError(f"element {element} reaches below the plane z = 0, to {height[element].min():.4g} m")
        for element in np.flatnonzero(height.max(axis=1) <= zero)[:1]:
            raise SurfaceError(f"element {element} lies on the plane z = 0: the surface is open there")

    def _check_closed(self) -> None:
        """Refuse an edge that has not one element on either side, but for those on the plane."""
        ends = np.stack((self.elements, np.roll(self.elements, -1, axis=1)), axis=2).reshape(-1, 2)
        ends = ends[ends[:, 0] != ends[:, 1]]
        directed = ends[:, 0] * np.int64(len(self.vertices)) + ends[:, 1]
        backwards = ends[:, 1] * np.int64(len(self.vertices)) + ends[:, 0]
        if len(np.unique(directed)) < len(directed):
            values, counts = np.unique(directed, return_counts=True)
            a, b = divmod(int(values[counts > 1][0]), len(self.vertices))
            raise SurfaceError(f"the edge of the vertices {a} and {b} has two elements that run along it the same way")
        alone = ends[~np.isin(directed, backwards)]
        if self.over_plane:
            zero = _ON_PLANE * float(np.ptp(self.vertices))
            alone = alone[np.any(np.abs(self.vertices[alone][..., 2]) > zero, axis=1)]
        if len(alone):
            where = "is no edge of the plane z = 0 and " if self.over_plane else ""
            a, b = alone[0]
            raise SurfaceError(
                f"the surface is not closed: the edge of the vertices {a} and {b} {where}has one element"
            )
